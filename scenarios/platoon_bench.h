#pragma once

#include <CLI/CLI.hpp>
#include <functional>

namespace lanewise {

/// Adds `platoon` to `bench`: what a swing of the leader's speed becomes along a platoon. Sets `chosen` if it
/// is what the user asks for.
void AddPlatoonCommand(CLI::App* bench, std::function<int()>* chosen);

}  // namespace lanewise
