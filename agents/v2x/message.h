#pragma once

#include <cstdint>

#include "agents/core/types.h"
#include "agents/network/road_network.h"

namespace lanewise {

/// Who sends and receives: a vehicle's running number (Traffic::number), or a roadside unit, below kNone.
using StationId = std::int32_t;
inline constexpr StationId RoadsideStation(std::int32_t unit) {
  return -2 - unit;
}
inline constexpr bool IsRoadside(StationId station) {
  return station < kNone;
}

/// What a station says of itself. A vehicle's is a cooperative awareness message (CAM, ETSI EN 302 637-2); a
/// roadside unit's has a sender, a step and a payload only.
struct Message {
  StationId sender{kNone};
  std::int32_t step{0};      ///< In which it was generated.
  std::uint64_t payload{0};  ///< Roadside units: what it means is their application's business.
  VehicleClassMask vehicle_class{0};
  double x{0.0}, y{0.0};            ///< [m] middle of the front bumper, as the sender's positioning says.
  double heading{0.0};              ///< [rad]
  float speed{0.0f};                ///< [m/s]
  float accel{0.0f};                ///< [m/s^2]
  float length{0.0f}, width{0.0f};  ///< [m]
  float max_decel{0.0f};            ///< [m/s^2] it may brake with, a magnitude.
  LaneIndex lane{kNone};
  std::int32_t next_link{kNone};  ///< Connection at the end of its edge, index in RoadNetwork::connections.
  float link_distance{0.0f};      ///< [m] from its front to that connection.
  // Intent.
  float wanted_speed{0.0f};    ///< [m/s] it drives at if it is free.
  std::int8_t lane_change{0};  ///< Side it asks for: +1 left, -1 right, 0.
  float planned_accel{0.0f};   ///< [m/s^2] its plan of the last step.
  float planned_jerk{0.0f};    ///< [m/s^3] how that changed.
  StationId follows{kNone};    ///< Whom it follows by cooperative cruise.
};

/// A message as its receiver has it.
struct Received {
  const Message* message{nullptr};
  double age{0.0};  ///< [s] since it was generated.
};

}  // namespace lanewise
