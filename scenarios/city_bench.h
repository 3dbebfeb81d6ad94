#pragma once

#include "scenarios/run_config.h"

namespace lanewise {

/// Drives a scenario natively and under `config.policy` on the same demand and seed, and prints how the
/// coupled run compares: arrivals, time loss, contacts, audit, wall time per vehicle-step, memory.
/// @param thread_counts more runs of the policy, whose state hashes must all be equal.
/// @return true if every row is within its target.
bool BenchCity(const RunConfig& config, const std::vector<int>& thread_counts);

}  // namespace lanewise
