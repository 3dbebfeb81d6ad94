#pragma once

#include <CLI/CLI.hpp>
#include <functional>

namespace lanewise {

/// Adds the subcommand `report`; if the user chooses it, *chosen becomes what it does and returns its exit
/// code.
void AddReportCommand(CLI::App* app, std::function<int()>* chosen);

}  // namespace lanewise
