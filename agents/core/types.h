#pragma once

#include <cstdint>

namespace lanewise {

/// Dense row of an agent in the structure-of-arrays state; valid within one step.
using AgentIndex = std::int32_t;
/// Index of a lane (normal or internal) in RoadNetwork::lanes.
using LaneIndex = std::int32_t;
/// Index of an edge in RoadNetwork::edges.
using EdgeIndex = std::int32_t;
inline constexpr std::int32_t kNone = -1;

/// World frame: x east, y north [m].
struct Point2 {
  double x{0.0};
  double y{0.0};
};

/// A pose on a curve or of a vehicle. heading [rad] counter-clockwise from +x.
struct Pose2 {
  double x{0.0};        ///< [m] east.
  double y{0.0};        ///< [m] north.
  double heading{0.0};  ///< [rad] in [-pi, pi].
};

}  // namespace lanewise
