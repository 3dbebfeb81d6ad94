#pragma once

#include <numbers>

#include "agents/core/geometry.h"

namespace lanewise {

/// SUMO's angle (degrees clockwise from north) as heading [rad] counter-clockwise from east, in [-pi, pi].
inline double HeadingFromSumo(double angle_deg) {
  return WrapAngle(std::numbers::pi / 2.0 - angle_deg * std::numbers::pi / 180.0);
}

}  // namespace lanewise
