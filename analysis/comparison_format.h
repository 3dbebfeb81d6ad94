#pragma once

#include <span>
#include <string>

#include "analysis/comparison.h"

namespace lanewise {

enum class TableFormat : std::uint8_t { kText, kMarkdown, kCsv, kJson, kLatex };

/// @throws ConfigError naming `origin` and what is allowed.
TableFormat ParseTableFormat(const std::string& name, const std::string& origin);

/// The comparison for a terminal (kText), a page, a paper or a program. CSV holds one line a comparison; JSON
/// everything. A partial comparison says so in every format.
std::string FormatComparison(const Comparison& comparison, TableFormat format);

/// What an A/A test found, for a terminal.
std::string FormatAaResults(std::span<const AaResult> results, bool against);

}  // namespace lanewise
