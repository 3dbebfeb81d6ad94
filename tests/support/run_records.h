#pragma once

#include <string>

#include "analysis/run_metrics.h"

namespace lanewise {

/// A finished run whose every metric has this value, with label and demand set.
inline RunRecord MakeRun(const std::string& policy, std::int64_t seed, double value) {
  static std::int64_t next_id = 0;
  RunRecord run;
  run.run_id = ++next_id;
  run.scenario = "town";
  run.policy = policy;
  run.label = policy;
  run.seed = seed;
  run.status = "finished";
  run.demand = "d";
  run.rules = "sumo";
  run.state_hash = std::to_string(next_id);
  run.shares = {{policy, 1.0}};
  run.agent_share = policy == "sumo" ? 0.0 : 1.0;
  run.inserted = 10;
  run.arrived = 10;
  run.metrics.assign(AllMetrics().size(), value);
  return run;
}

}  // namespace lanewise
