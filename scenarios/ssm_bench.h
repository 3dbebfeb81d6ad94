#pragma once

#include <string>

#include "scenarios/run_config.h"

namespace lanewise {

/// Drives the scenario natively with SUMO's device.ssm on every vehicle, and compares what it found in
/// following with the encounters of Lanewise's safety engine in the same run. Prints the comparison.
/// @return whether at least 98 % of SUMO's encounters with TTC < 3 s were found, and as many of their
/// smallest TTC agree within 0.05 s or what one step changes.
bool BenchSsm(const RunConfig& config, const std::string& differences_file);

}  // namespace lanewise
