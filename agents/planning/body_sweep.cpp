#include "agents/planning/body_sweep.h"

#include <algorithm>
#include <cmath>

#include "agents/core/geometry.h"
#include "agents/planning/car_following.h"
#include "agents/vehicle/kinematic_bicycle.h"

namespace lanewise {
namespace {

/// Poses of a sweep, and [m] between them at least: it covers the whole view, and past the longest body.
constexpr int kPoses = 51;
constexpr double kLeastStride = 0.5;
/// [rad] of a bend over the body's length, and between body and path, up to which the bumpers tell enough.
constexpr double kBend = 1.0, kTurned = 0.5;
/// [m] by which a plan may seem to come nearer to what it stands beside, and the least it leaves.
constexpr double kRounding = 0.02, kLeastGap = 0.05;

/// Distance of two boxes [m]; < 0: how deep they overlap.
double GapBetween(const Footprint& a, const Footprint& b) {
  const double depth = PenetrationDepth(a, b);
  return depth > 0.0 ? -depth : Distance(a, b);
}

/// Drives the course to `target` [m] by the tracking law: its body every `stride` [m], relative to the view's
/// origin.
std::array<Footprint, kPoses> Drive(const DrivingParams& driving, const RoadView& view, const PlanContext& c,
                                    double target, double stride) {
  const VehicleParams& vehicle = *c.vehicle;
  const double law = 1.0 / std::max(driving.tracking_distance, c.speed * driving.tracking_time);
  const double max_slip =
      SlipAngle(vehicle.max_steering_angle, vehicle.wheelbase, vehicle.rear_axle_to_front);
  const double max_turn = vehicle.max_steering_rate * stride / std::max(1.0, c.speed);
  const double path_heading = std::atan2(view.sin_heading[kNodesBehind], view.cos_heading[kNodesBehind]);
  RoadPose road{0.0, c.d, c.heading_error};
  Pose2 pose{-c.d * std::sin(path_heading), c.d * std::cos(path_heading), path_heading + c.heading_error};
  double slip = c.slip, speed = stride;  // Steps of 1 s.
  std::array<Footprint, kPoses> bodies;
  for (Footprint& body : bodies) {
    body = {pose, vehicle.length, vehicle.width};
    const double course =
        std::clamp(law * (target - road.d), -driving.max_course_angle, driving.max_course_angle);
    slip += std::clamp(course - road.heading_error - slip, -max_turn, max_turn);
    slip = std::clamp(slip, -max_slip, max_slip);
    const int node = std::min(kPathNodes - 1, static_cast<int>(road.s / view.spacing));
    StepBicycleOnRoad(0.0, slip, vehicle.rear_axle_to_front, view.curvature[node], 1.0, &road, &speed);
    // The same step in the world, along the chord of its arc: strides are long for a bend.
    const double turn = stride / vehicle.rear_axle_to_front * std::sin(slip);
    pose.x += stride * std::cos(pose.heading + slip + 0.5 * turn);
    pose.y += stride * std::sin(pose.heading + slip + 0.5 * turn);
    pose.heading += turn;
  }
  return bodies;
}

}  // namespace

bool SweepsAcross(const RoadView& view, const PlanContext& c) {
  if (c.vehicle->length < kLongBody) return false;
  return std::abs(c.heading_error) > kTurned ||
         std::any_of(view.curvature.begin(), view.curvature.end(),
                     [&](float curvature) { return std::abs(curvature) * c.vehicle->length > kBend; });
}

void LimitBySweep(const AgentParams& params, const RoadView& view, const PlanContext& c, float margin,
                  CourseSet* courses) {
  const VehicleParams& vehicle = *c.vehicle;
  const double comfort_decel = std::min(params.driving.comfort_decel, vehicle.max_decel);
  const double stride = std::max(kLeastStride, view.spacing * (kPathNodes - 1.0) / (kPoses - 1));
  for (int j = 0; j < courses->count; ++j) {
    const auto bodies = Drive(params.driving, view, c, courses->target[j], stride);
    for (int m = 0; m < view.obstacle_count; ++m) {
      const Obstacle& o = view.obstacles[m];
      if (o.body.length == 0.0) continue;
      const double gap_now = GapBetween(bodies[0], o.body);
      const double rounding = std::clamp(gap_now - kLeastGap, 0.0, kRounding);
      const double least = std::min<double>(margin - o.forgiven, gap_now - rounding);
      double gap = gap_now;
      int k = 1;
      for (; k < kPoses; ++k) {
        gap = std::min(gap, GapBetween(bodies[k], o.body));
        if (gap < least) break;
      }
      courses->clearance[j] = std::min(courses->clearance[j], static_cast<float>(std::max(0.0, gap)));
      if (k == kPoses) continue;
      const double free = (k - 1) * stride;
      const auto limit = [&](double decel) {
        return static_cast<float>(SafeSpeed(free - vehicle.min_gap, 0.0, decel, c.time_gap));
      };
      courses->safe_speed[j] = std::min(courses->safe_speed[j], limit(vehicle.max_decel));
      courses->comfort_speed[j] =
          std::min({courses->comfort_speed[j], courses->safe_speed[j], limit(comfort_decel)});
      if (j == 0 && free < courses->leader_gap) {
        courses->leader_gap = static_cast<float>(free);
        courses->leader_row = o.row;
        courses->leader_speed = 0.0f;
      }
    }
  }
}

}  // namespace lanewise
