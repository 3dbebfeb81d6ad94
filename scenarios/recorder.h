#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "agents/network/road_network.h"
#include "agents/traffic.h"
#include "analysis/comfort_histogram.h"
#include "analysis/coordination_event.h"
#include "analysis/edge_recorder.h"
#include "analysis/results_file.h"
#include "analysis/rule_watch.h"
#include "analysis/safety_monitor.h"
#include "analysis/traffic_frame.h"
#include "analysis/trip_recorder.h"
#include "libsumo_bridge/vehicle_bridge.h"

namespace lanewise {

struct RecorderParams {
  double begin{0.0};          ///< [s] simulated time before the first step.
  double step_length{0.1};    ///< [s]
  double sample_period{1.0};  ///< [s] of trajectory rows; 0 = every step.
  double edge_interval{0.0};  ///< [s] of rows of edge_interval; 0 = none.
  SafetyLevel safety_level{SafetyLevel::kFull};
  SafetyParams safety;
};

/// Turns the traffic of each step into results: safety events, trips, samples, summaries. Works without
/// a results file too (then only the totals are kept).
class Recorder {
 public:
  Recorder(const RoadNetwork& network, const RecorderParams& params, RunWriter* writer);

  void Observe(std::int64_t step, double time, double wall_time, const Traffic& traffic,
               const VehicleBridge& bridge);
  void Add(const std::vector<CoordinationEvent>& events);
  /// Closes all that is open at the end of the run.
  void Finish(double time);

  std::int64_t vehicle_steps() const { return vehicle_steps_; }
  std::int64_t agent_steps() const { return agent_steps_; }
  std::int64_t inserted() const { return inserted_; }
  std::int64_t arrived() const { return arrived_; }
  std::int64_t vaporized() const { return vaporized_; }
  std::int64_t running() const { return inserted_ - arrived_ - vaporized_; }
  std::vector<PolicyShareRow> policy_shares() const;
  const RuleWatch& rules() const { return rules_; }
  double safety_time() const {
    return safety_time_;
  }  ///< [s] wall time in the safety engine and for its events.
  double sampling_time() const { return sampling_time_; }  ///< [s] wall time for trajectory samples.

 private:
  void FillFrame(std::int64_t step, double time, const Traffic& traffic, const VehicleBridge& bridge);
  void Depart(const Traffic& traffic, const VehicleBridge& bridge);
  void FillWay(const Traffic& traffic, std::size_t row);
  void FinishTrip(std::int32_t number, double time, TripEnd end);
  void Sample();
  void Summarize(double wall_time, const VehicleBridge& bridge);
  void Flush();

  /// A vehicle's lanes ahead and behind; they change only with its lane or its route.
  struct Way {
    const RoutePlan* plan{nullptr};
    std::int32_t route_position{kNone};
    LaneIndex lane{kNone}, behind{kNone};
    LanePath path;
    double mass{0.0};  // [kg]
  };

  const RoadNetwork& network_;
  RecorderParams params_;
  RunWriter* writer_;
  TrafficFrame frame_;
  std::vector<Way> ways_;  // By vehicle number.
  SafetyMonitor safety_;
  TripRecorder trips_;
  EdgeRecorder edges_;
  ComfortHistogram comfort_;
  RuleWatch rules_;
  std::vector<VehicleRow> vehicles_;
  std::vector<TripRow> finished_trips_;
  std::vector<TrajectoryRow> samples_;
  std::vector<StepSummaryRow> summaries_;
  std::vector<PolicyShareRow> shares_;            // By Policy.
  double safety_time_{0.0}, sampling_time_{0.0};  // [s]
  std::int64_t vehicle_steps_{0}, agent_steps_{0}, inserted_{0}, arrived_{0}, vaporized_{0};
};

}  // namespace lanewise
