#pragma once

#include <CLI/CLI.hpp>
#include <functional>

namespace lanewise {

/// Adds `slots` to `bench`: the delay at a crossing by the rule of priority and by slots. Sets `chosen` if it
/// is what the user asks for.
void AddSlotsCommand(CLI::App* bench, std::function<int()>* chosen);

}  // namespace lanewise
