#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "agents/core/types.h"

namespace lanewise {

/// The lanes a vehicle is going to drive on.
struct LanePath {
  static constexpr std::size_t kLanes = 8;
  /// From its present lane on, as far as they lead along its route without a lane change; then kNone.
  std::array<LaneIndex, kLanes> lane{kNone, kNone, kNone, kNone, kNone, kNone, kNone, kNone};
};

/// All vehicles and pedestrians of one step, after it. Row i of every column is one road user; the order of
/// the rows is free and may change from step to step.
struct TrafficFrame {
  std::int64_t step{0};
  double time{0.0};  ///< [s] simulated.

  std::vector<std::int32_t> vehicle_number;  ///< Running number within the run, unique, pedestrians included.
  std::vector<double> x, y;                  ///< [m] middle of the front bumper, world.
  std::vector<double> heading;               ///< [rad]
  std::vector<double> speed;                 ///< [m/s] >= 0.
  std::vector<double> accel;                 ///< [m/s^2] along the heading.
  std::vector<double> yaw_rate;              ///< [rad/s]
  std::vector<double> lateral_accel;         ///< [m/s^2] yaw rate * speed, left positive.
  std::vector<double> vx, vy;                ///< [m/s] world.
  std::vector<double> length, width;         ///< [m]
  std::vector<LaneIndex> lane;               ///< kNone when off the network.
  std::vector<double> lane_pos;              ///< [m] s of the front bumper.
  std::vector<LaneIndex> lane_behind;  ///< The lane before the present one along the way; kNone: unknown.
  std::vector<LanePath> path;          ///< All kNone: unknown.
  std::vector<double> mass;            ///< [kg] 0: unknown.
  std::vector<double> lateral_offset;  ///< [m] d, left of the lane's center.
  std::vector<double> lateral_speed;   ///< [m/s] to the left of the lane, of who is steered freely; else 0.
  std::vector<double> allowed_speed;   ///< [m/s] limit here times the driver's factor; for the time loss.
  std::vector<std::uint8_t> in_junction;
  std::vector<std::uint8_t> agent_driven;  ///< 1 = our agent drives it now, 0 = SUMO does.
  std::vector<std::uint8_t> planned_stop;  ///< Stands at a stop of its route (bus stop, parking).
  std::vector<std::uint8_t> pedestrian;
  std::vector<double> co2_rate;          ///< [mg/s]
  std::vector<double> nox_rate;          ///< [mg/s]
  std::vector<double> pmx_rate;          ///< [mg/s]
  std::vector<double> fuel_rate;         ///< [mg/s] SUMO >= 1.14 without --emissions.volumetric-fuel.
  std::vector<double> electricity_rate;  ///< [Wh/s]

  std::size_t size() const { return vehicle_number.size(); }

  /// Sets the number of rows. New rows are zero; kept rows keep their values.
  void Resize(std::size_t rows) {
    vehicle_number.resize(rows);
    lane.resize(rows, kNone);
    lane_behind.resize(rows, kNone);
    path.resize(rows);
    for (auto* column :
         {&x, &y, &heading, &speed, &accel, &yaw_rate, &lateral_accel, &vx, &vy, &length, &width, &mass}) {
      column->resize(rows);
    }
    for (auto* column : {&lane_pos, &lateral_offset, &lateral_speed, &allowed_speed, &co2_rate, &nox_rate,
                         &pmx_rate, &fuel_rate, &electricity_rate}) {
      column->resize(rows);
    }
    for (auto* column : {&in_junction, &agent_driven, &planned_stop, &pedestrian}) column->resize(rows);
  }
};

}  // namespace lanewise
