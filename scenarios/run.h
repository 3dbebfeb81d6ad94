#pragma once

#include <cstdint>
#include <string>

#include "agents/v2x/channel_counts.h"
#include "analysis/results_file.h"
#include "analysis/rule_event.h"
#include "libsumo_bridge/coupling_audit.h"
#include "scenarios/run_config.h"

namespace lanewise {

/// What a run came to.
struct RunReport {
  RunOutcome outcome;
  CouplingAudit audit;
  ChannelCounts v2x;       ///< All zero without V2X.
  std::int64_t run_id{0};  ///< In the results file; 0 without one.
  std::int64_t lane_end_halts{0};
  std::int64_t detours{0};    ///< See VehicleBridge.
  double detour_length{0.0};  ///< [m]
  std::int64_t emergency_stops{0};
  std::int64_t samples{0};            ///< Sector-scan samples recorded.
  RuleEventCounts rule_events{};      ///< By RuleEventKind.
  CoordinationCounts coordination{};  ///< By CoordinationKind.
  double agent_time{0.0};             ///< [s] wall time in the agents' step.
  double coupling_time{0.0};          ///< [s] wall time reading from and writing to SUMO.
  double record_time{0.0};            ///< [s] wall time for measures and results.
  double finish_time{0.0};            ///< [s] wall time after the last step, until the results are closed.
  double safety_time{0.0};            ///< [s] of record_time in the safety engine and for its events.
  double sampling_time{0.0};          ///< [s] of record_time for trajectory samples.
  double writing_time{0.0};           ///< [s] in writing the results: processor time; wall time for indexes.
  double cpu_time{0.0};  ///< [s] of processor time of all threads, from the first step to the end.
};

/// Runs a resolved configuration to its end, or until SIGINT (then the outcome is kInterrupted).
/// @throws ConfigError, SumoError; a started run is then marked failed in the results file.
RunReport Run(const RunConfig& config);

}  // namespace lanewise
