#pragma once

#include <CLI/CLI.hpp>
#include <functional>

namespace lanewise {

/// `lanewise verify`: recorded runs again, from what their file says of them. Sets `chosen` if it is the
/// subcommand.
void AddVerifyCommand(CLI::App* app, std::function<int()>* chosen);

}  // namespace lanewise
