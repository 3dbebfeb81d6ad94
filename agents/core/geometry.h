#pragma once

#include <span>

#include "agents/core/types.h"

namespace lanewise {

/// Oriented box of a vehicle. The pose is the middle of the front bumper (SUMO's reference point).
struct Footprint {
  Pose2 front;
  double length{0.0};  ///< [m]
  double width{0.0};   ///< [m]
};

/// [rad] wrapped to [-pi, pi].
double WrapAngle(double angle);

/// The point at `share`, in [0, 1], of the length of a polyline of at least one vertex.
Point2 PointOn(std::span<const Point2> line, double share);

/// Penetration depth of two boxes [m]: > 0 when they overlap (the smallest shift that separates
/// them), <= 0 when a separating axis exists (then minus the gap along the best axis, a lower bound of the
/// distance).
double PenetrationDepth(const Footprint& a, const Footprint& b);

/// Exact distance of two boxes' outlines [m]; 0 when they overlap.
double Distance(const Footprint& a, const Footprint& b);

}  // namespace lanewise
