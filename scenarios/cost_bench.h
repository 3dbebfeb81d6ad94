#pragma once

#include "scenarios/run_config.h"

namespace lanewise {

/// `lanewise bench cost`: what the safety engine and recording cost a run, and how fast rows get into SQLite.
/// Each repetition drives the scenario without both, with the engine, and with recording, one after the
/// other; ratios are taken within a repetition, as a busy machine changes from one to the next.
/// @return did all meet their targets?
bool BenchCost(const RunConfig& config, int repetitions);

}  // namespace lanewise
