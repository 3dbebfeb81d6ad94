#include "agents/planning/sector_drive.h"

#include <algorithm>
#include <cmath>

namespace lanewise {
namespace {

/// Does the edge reach into a box of the sensor's frame (Liang, Barsky 1984)?
bool ReachesInto(const ReflectingEdge& edge, double x0, double x1, double y0, double y1) {
  double t0 = 0.0, t1 = 1.0;
  const auto clip = [&](double value, double slope) {
    if (slope == 0.0) return value >= 0.0;
    const double t = -value / slope;
    if (slope > 0.0) {
      t0 = std::max(t0, t);
    } else {
      t1 = std::min(t1, t);
    }
    return t0 <= t1;
  };
  const double ex = edge.b.x - edge.a.x, ey = edge.b.y - edge.a.y;
  return clip(edge.a.x - x0, ex) && clip(x1 - edge.a.x, -ex) && clip(edge.a.y - y0, ey) &&
         clip(y1 - edge.a.y, -ey);
}

bool AnyIn(const LidarScene& scene, double x0, double x1, double y0, double y1) {
  return std::any_of(scene.edges().begin(), scene.edges().end(),
                     [&](const ReflectingEdge& e) { return ReachesInto(e, x0, x1, y0, y1); });
}

/// Greatest slip angle [rad] to each side at which the flank does not sweep over what is beside it. Turning
/// about a centre R beside the rear axle, the flank's inner circle is R - w / 2 wide: a point (x from the
/// rear axle, y beside) stays free if x^2 + (R - y)^2 < (R - w / 2 - margin)^2.
struct TurnLimits {
  double left, right;
};

TurnLimits LimitTurns(const AgentParams& params, const VehicleParams& vehicle, const LidarScene& scene) {
  const double l_r = vehicle.rear_axle_to_front, half = 0.5 * vehicle.width + params.sector.flank_clearance;
  const double max_slip = params.open_road.max_course, reach = params.sector.standstill;
  double radius[2] = {0.0, 0.0};  // Least one to the left and to the right.
  for (const ReflectingEdge& edge : scene.edges()) {
    for (int k = 0; k <= 4; ++k) {
      const double x = l_r + edge.a.x + 0.25 * k * (edge.b.x - edge.a.x);
      const double y = edge.a.y + 0.25 * k * (edge.b.y - edge.a.y);
      if (x < 0.0 || x > l_r + reach || std::abs(y) > reach || std::abs(y) < 0.25 * vehicle.width) continue;
      double& least = radius[y > 0.0 ? 0 : 1];
      const double room = std::abs(y) - half;
      least = std::max(least, room <= 0.01 ? 1e3 : (x * x + y * y - half * half) / (2.0 * room));
    }
  }
  const auto slip = [&](double r) {
    return std::min(max_slip, r >= 1e3 ? 0.0 : std::atan(l_r / std::max(r, 0.1)));
  };
  return {slip(radius[0]), slip(radius[1])};
}

/// Keeps the course from turning more than the flanks allow.
double GuardFlanks(const AgentParams& params, const VehicleParams& vehicle, const LidarScene& scene,
                   double heading_error, double course) {
  const TurnLimits limits = LimitTurns(params, vehicle, scene);
  return heading_error + std::clamp(course - heading_error, -limits.right, limits.left);
}

/// The strip just ahead, where the two front sectors are narrower than the vehicle: is something in its left
/// or right half? @return a bit each.
int InBlindStrip(const AgentParams& params, const VehicleParams& vehicle, const LidarScene& scene) {
  constexpr double kTanSector = 0.41421356;  // tan 22.5 deg
  const double half = 0.5 * vehicle.width + params.sector.corner_clearance;
  const double end = half / kTanSector;
  return (AnyIn(scene, 0.0, end, 0.0, half) ? 1 : 0) + (AnyIn(scene, 0.0, end, -half, 0.0) ? 2 : 0);
}

/// Free ahead it goes as fast as it likes; else it brakes to the speed at which it turns aside, and stops
/// where there is no side, or something is just ahead.
double SectorAccel(const AgentParams& params, const VehicleParams& vehicle, double speed, double free_speed,
                   bool ahead_free, bool nothing_free, const LidarScene& scene) {
  double wanted = free_speed;
  const double half = 0.5 * vehicle.width;
  if (nothing_free || AnyIn(scene, 0.0, params.sector.stop_distance, -half, half)) {
    wanted = 0.0;
  } else if (!ahead_free) {
    wanted = std::min(free_speed, params.sector.turn_speed);
  }
  return std::clamp((wanted - speed) / params.driving.response_time, -params.sector.decel, vehicle.max_accel);
}

/// The sum of the repelling forces, in the sensor's frame.
Point2 Repulsion(const ApfParams& apf, double half_width, const LidarScene& scene) {
  Point2 force;
  for (const ReflectingEdge& edge : scene.edges()) {
    const double ex = edge.b.x - edge.a.x, ey = edge.b.y - edge.a.y;
    const double t =
        std::clamp(-(edge.a.x * ex + edge.a.y * ey) / std::max(1e-12, ex * ex + ey * ey), 0.0, 1.0);
    const double x = edge.a.x + t * ex, y = edge.a.y + t * ey, distance = std::hypot(x, y);
    const double gap = std::max(0.1, distance - half_width);
    if (gap >= apf.range || x < -0.5) continue;
    const double f = apf.gain * (1.0 / gap - 1.0 / apf.range) / (gap * gap);
    force.x -= f * x / std::max(distance, 1e-6);
    force.y -= f * y / std::max(distance, 1e-6);
  }
  return force;
}

}  // namespace

OpenRoadPlan DriveBySectors(const World& world, AgentIndex ego, const AgentParams& params, double free_speed,
                            const SectorScan& scan, Avoidance advice, const LidarScene& reflectors,
                            Avoidance* committed) {
  const Traffic& traffic = *world.traffic;
  const VehicleParams& vehicle = traffic.params[ego];
  const double speed = traffic.now.speed[ego], heading = traffic.now.heading_error[ego];
  const int blind = InBlindStrip(params, vehicle, reflectors);
  const bool ahead_free = AheadIsFree(scan.code) && blind == 0;
  OpenRoadPlan plan;
  plan.accel = SectorAccel(params, vehicle, speed, free_speed, ahead_free, scan.code == 0, reflectors);
  if (ahead_free) {
    *committed = Avoidance::kForward;  // Straight along the road.
  } else if (scan.code == 0 || speed > params.sector.turn_speed + 1.0) {
    // Only near enough do the side sectors tell which side is free.
    plan.course = heading;
  } else {
    // A side once chosen is kept until the strip ahead is free: else it would turn to and fro before a wall.
    if (*committed == Avoidance::kForward) *committed = advice;
    if (*committed == Avoidance::kForward && blind != 3)
      *committed = blind == 1 ? Avoidance::kRight : Avoidance::kLeft;
    const double side = *committed == Avoidance::kLeft ? 1.0 : (*committed == Avoidance::kRight ? -1.0 : 0.0);
    plan.course = side == 0.0 ? heading : side * params.open_road.max_course;
  }
  plan.course = GuardFlanks(params, vehicle, reflectors, heading, plan.course);
  return plan;
}

OpenRoadPlan DriveByPotential(const World& world, AgentIndex ego, const AgentParams& params,
                              double free_speed, double target_d, const SectorScan& scan,
                              const LidarScene& reflectors) {
  const Traffic& traffic = *world.traffic;
  const VehicleParams& vehicle = traffic.params[ego];
  const double speed = traffic.now.speed[ego], heading = traffic.now.heading_error[ego];
  const double reach = std::max(params.driving.tracking_distance, speed * params.driving.tracking_time);
  const double goal = std::clamp((target_d - traffic.now.d[ego]) / reach, -params.driving.max_course_angle,
                                 params.driving.max_course_angle) -
                      heading;
  const Point2 repulsion = Repulsion(params.apf, 0.5 * vehicle.width, reflectors);
  const double x = std::cos(goal) + repulsion.x, y = std::sin(goal) + repulsion.y;
  OpenRoadPlan plan;
  // Pushed back more than drawn on: a local minimum of the potential, where it stops.
  plan.accel = SectorAccel(params, vehicle, speed, free_speed, AheadIsFree(scan.code),
                           x <= 0.0 || scan.code == 0, reflectors);
  plan.course = std::clamp(heading + std::atan2(y, std::max(x, 1e-3)), -params.open_road.max_course,
                           params.open_road.max_course);
  plan.course = GuardFlanks(params, vehicle, reflectors, heading, plan.course);
  return plan;
}

double ShiftByPotential(const AgentParams& params, const VehicleParams& vehicle,
                        const LidarScene& reflectors) {
  const Point2 repulsion = Repulsion(params.apf, 0.5 * vehicle.width, reflectors);
  return std::clamp(repulsion.y, -1.0, 1.0);
}

}  // namespace lanewise
