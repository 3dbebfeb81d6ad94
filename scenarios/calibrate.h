#pragma once

#include <CLI/CLI.hpp>
#include <functional>

namespace lanewise {

/// `lanewise calibrate pid|idm`. @param chosen what the command will do, once it is parsed.
void AddCalibrateCommand(CLI::App* app, std::function<int()>* chosen);
/// Its `idm`.
void AddCalibrateIdm(CLI::App* calibrate, std::function<int()>* chosen);

}  // namespace lanewise
