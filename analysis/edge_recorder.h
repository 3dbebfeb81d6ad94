#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "agents/core/types.h"
#include "agents/network/road_network.h"
#include "analysis/traffic_frame.h"

namespace lanewise {

/// What an edge number in the results means.
struct EdgeRow {
  EdgeIndex edge{kNone};
  std::string id{};  ///< SUMO's id.
  std::int32_t lanes{0};
  double length{0.0};  ///< [m] of its first lane.
  bool in_junction{false};
};

/// Traffic on one edge over one interval. Flow, density and speed are Edie's generalised definitions (L. C.
/// Edie, Discussion of traffic stream measurements and definitions, 1963): of the region length x interval
/// in space and time, flow is the distance driven in it over its area, density the time spent in it over its
/// area, speed their ratio.
struct EdgeIntervalRow {
  double begin{0.0}, end{0.0};  ///< [s]
  EdgeIndex edge{kNone};
  double vehicle_time{0.0};      ///< [s]
  double vehicle_distance{0.0};  ///< [m]
  double flow{0.0};              ///< [veh/s]
  double density{0.0};           ///< [veh/m]
  double speed{0.0};             ///< [m/s] space mean.
  double speed_variance{0.0};    ///< [m^2/s^2] over vehicle time.
  double waiting_time{0.0};      ///< [s] slower than the halting speed, planned stops excluded.
  double time_loss{0.0};         ///< [s]
  std::int64_t entered{0};       ///< Drove in or were inserted.
  double co2{0.0}, nox{0.0}, pmx{0.0}, fuel{0.0};  ///< [mg]
  double electricity{0.0};                         ///< [Wh]
};

/// Sums up the traffic on every edge over intervals of time. A step in which a vehicle passes from one edge
/// to the next is split between the two by the distance driven on each; edges passed whole within one step
/// get nothing of it.
class EdgeRecorder {
 public:
  /// interval [s]: a multiple of step_length is best; 0 records nothing.
  EdgeRecorder(const RoadNetwork& network, double begin, double step_length, double interval);

  /// Adds one step: the vehicles' positions after it.
  void Observe(const TrafficFrame& frame);

  /// Rows of the intervals completed since the last call, in order of time and edge.
  std::vector<EdgeIntervalRow> TakeFinished();

  /// Ends the last, shorter interval.
  void Finish(double time);

 private:
  struct Sums {
    double time{0.0}, distance{0.0}, speed{0.0}, speed_square{0.0}, waiting{0.0}, time_loss{0.0};
    double co2{0.0}, nox{0.0}, pmx{0.0}, fuel{0.0}, electricity{0.0};
    std::int64_t entered{0};
  };
  void Add(const TrafficFrame& frame, std::size_t row, EdgeIndex edge, double time, double distance);
  void CloseInterval(double end);

  const RoadNetwork& network_;
  double step_length_, interval_;   // [s]
  double interval_begin_;           // [s]
  std::vector<Sums> sums_;          // By edge.
  std::vector<EdgeIndex> edge_of_;  // By vehicle number: where it was last; kNone before it was seen.
  std::vector<EdgeIntervalRow> finished_;
};

}  // namespace lanewise
