#pragma once

#include <CLI/CLI.hpp>
#include <functional>

namespace lanewise {

/// `lanewise merge`: results files, the shards of a study above all, as one. Sets `chosen` if it is the
/// subcommand.
void AddMergeCommand(CLI::App* app, std::function<int()>* chosen);

}  // namespace lanewise
