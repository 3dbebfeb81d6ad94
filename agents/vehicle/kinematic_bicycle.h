#pragma once

#include <cmath>

#include "agents/core/types.h"

namespace lanewise {

/// Slip angle [rad] of a reference point that lies l_r ahead of the rear axle, for a road-wheel
/// steering angle: tan(beta) = l_r / L * tan(delta).
inline double SlipAngle(double steering_angle, double wheelbase, double l_r) {
  return std::atan(l_r / wheelbase * std::tan(steering_angle));
}

/// Inverse of SlipAngle.
inline double SteeringAngle(double slip_angle, double wheelbase, double l_r) {
  return std::atan(wheelbase / l_r * std::tan(slip_angle));
}

/// One step of the kinematic bicycle in the world, [C] Fig. 2-4:
///   x' = v cos(psi + beta), y' = v sin(psi + beta), psi' = v / l_r sin(beta), v' = a.
/// Semi-implicit: the new speed acts in the step, as in SUMO's own Euler update. Speed stays >= 0.
inline void StepBicycle(double accel, double slip_angle, double l_r, double dt, Pose2* pose, double* speed) {
  *speed = std::fmax(0.0, *speed + accel * dt);
  const double course = pose->heading + slip_angle;
  pose->x += *speed * std::cos(course) * dt;
  pose->y += *speed * std::sin(course) * dt;
  pose->heading += *speed / l_r * std::sin(slip_angle) * dt;
}

/// The same motion in the frame of a reference path: s along, d left, heading relative to the tangent.
struct RoadPose {
  double s{0.0};              ///< [m] world metres along the path.
  double d{0.0};              ///< [m] left positive.
  double heading_error{0.0};  ///< [rad] heading minus path tangent.
};

/// @param curvature of the path at s [1/m]. @return progress along the path [m] in this step.
inline double StepBicycleOnRoad(double accel, double slip_angle, double l_r, double curvature, double dt,
                                RoadPose* pose, double* speed) {
  *speed = std::fmax(0.0, *speed + accel * dt);
  const double course = pose->heading_error + slip_angle;
  // 1 - curvature * d: metres along the path per metre driven at offset d; bounded away from the path's
  // centre of curvature.
  const double stretch = std::fmax(0.3, 1.0 - curvature * pose->d);
  const double progress = std::fmax(0.0, *speed * std::cos(course) / stretch * dt);
  pose->s += progress;
  pose->d += *speed * std::sin(course) * dt;
  pose->heading_error += *speed / l_r * std::sin(slip_angle) * dt - curvature * progress;
  return progress;
}

}  // namespace lanewise
