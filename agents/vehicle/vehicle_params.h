#pragma once

#include <string_view>

namespace lanewise {

/// Geometry and limits of one vehicle. SI, rad. Poses refer to the middle of the front bumper.
/// Lengths, accelerations, gaps and speeds come from the vehicle's SUMO type; what SUMO does not
/// know (axles, steering, lags) from its class, see AxlesAndActuators.
struct VehicleParams {
  double length{5.0};           ///< [m] bumper to bumper.
  double width{1.8};            ///< [m]
  double min_gap{2.5};          ///< [m] to the leader at standstill.
  double max_accel{2.6};        ///< [m/s^2]
  double max_decel{4.5};        ///< [m/s^2] service braking, a magnitude.
  double emergency_decel{9.0};  ///< [m/s^2] a magnitude.
  double time_gap{1.0};         ///< [s] wanted to the leader, SUMO's tau.
  double max_speed{55.55};      ///< [m/s]
  double speed_factor{1.0};     ///< Wanted speed over the speed limit.

  double wheelbase{2.8};           ///< [m] rear to front axle, L.
  double rear_axle_to_front{3.9};  ///< [m] rear axle to front bumper: l_r of [C] for our reference point.
  double max_steering_angle{0.7};  ///< [rad] at the road wheel.
  double max_steering_rate{1.2};   ///< [rad/s] at the road wheel.
  double accel_lag{0.15};          ///< [s] first-order lag of the powertrain and the brakes.
  double steering_lag{0.10};       ///< [s] first-order lag of the steering.
};

/// Fills the fields SUMO does not know, scaled to `params->length`, for a SUMO vehicle class ("passenger",
/// "bus", ...).
void AxlesAndActuators(std::string_view vehicle_class, VehicleParams* params);

}  // namespace lanewise
