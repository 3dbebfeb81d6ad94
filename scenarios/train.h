#pragma once

#include <CLI/CLI.hpp>
#include <functional>

namespace lanewise {

/// `lanewise train bp|bls`. @param chosen what the command will do, once it is parsed.
void AddTrainCommand(CLI::App* app, std::function<int()>* chosen);

}  // namespace lanewise
