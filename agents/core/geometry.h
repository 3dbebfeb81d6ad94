#pragma once

#include <array>
#include <optional>

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

/// Penetration depth of two boxes [m]: > 0 when they overlap (the smallest shift that separates
/// them), <= 0 when a separating axis exists (then minus the gap along the best axis, a lower bound of the
/// distance).
double PenetrationDepth(const Footprint& a, const Footprint& b);

/// Exact distance of two boxes' outlines [m]; 0 when they overlap.
double Distance(const Footprint& a, const Footprint& b);

/// When two boxes that keep their velocity [m/s, world] and heading first touch: seconds from now in
/// [0, horizon], or nothing. Separating axes swept in time: exact for that motion.
std::optional<double> TimeToContact(const Footprint& a, Point2 velocity_a, const Footprint& b,
                                    Point2 velocity_b, double horizon);

}  // namespace lanewise
