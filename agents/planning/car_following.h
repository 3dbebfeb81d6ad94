#pragma once

#include <cmath>

namespace lanewise {

/// Highest speed [m/s] from which a vehicle can still stop behind its leader if the leader brakes as hard as
/// it can: v such that v * reaction + v^2 / (2 b) <= gap + v_l^2 / (2 b)  (Krauss 1998; the safe speed of
/// SUMO's default model).
/// @param gap bumper to bumper [m], already less the standstill gap; <= 0 gives the speed for no gap.
inline double SafeSpeed(double gap, double leader_speed, double decel, double reaction) {
  const double bt = decel * reaction;
  const double under_root = bt * bt + leader_speed * leader_speed + 2.0 * decel * gap;
  return under_root <= 0.0 ? 0.0 : std::fmax(0.0, std::sqrt(under_root) - bt);
}

/// Highest speed [m/s] that comes down to `target_speed` within `distance` at `decel`.
inline double BrakingSpeed(double distance, double target_speed, double decel) {
  return distance <= 0.0 ? target_speed : std::sqrt(target_speed * target_speed + 2.0 * decel * distance);
}

/// Intelligent Driver Model, Treiber, Hennecke, Helbing 2000, Eq. (1)-(2), exponent 4.
/// @param gap bumper to bumper [m]. @return acceleration [m/s^2].
inline double IdmAccel(double speed, double wanted_speed, double gap, double leader_speed, double max_accel,
                       double comfort_decel, double time_gap, double min_gap) {
  const double ratio = speed / std::fmax(wanted_speed, 0.1);
  const double approach = speed * (speed - leader_speed) / (2.0 * std::sqrt(max_accel * comfort_decel));
  const double wanted_gap = min_gap + std::fmax(0.0, speed * time_gap + approach);
  const double pressure = wanted_gap / std::fmax(gap, 0.01);
  return max_accel * (1.0 - ratio * ratio * ratio * ratio - pressure * pressure);
}

}  // namespace lanewise
