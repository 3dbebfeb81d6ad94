#pragma once

#include <filesystem>
#include <string>

namespace lanewise {

/// Everything in a file; empty if it cannot be read.
std::string ReadText(const std::filesystem::path& file);

/// "xxh3:" and 16 hex digits: what provenance knows of an input file's content.
std::string HashFile(const std::filesystem::path& file);

}  // namespace lanewise
