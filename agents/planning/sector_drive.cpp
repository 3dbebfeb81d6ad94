#include "agents/planning/sector_drive.h"

#include <algorithm>
#include <cmath>

#include "agents/planning/car_following.h"
#include "agents/vehicle/kinematic_bicycle.h"

namespace lanewise {
namespace {

/// Part [t0, t1] of an edge; empty if t0 > t1.
struct Part {
  double t0{0.0}, t1{1.0};

  bool empty() const { return t0 > t1; }
  /// Keeps where value + t * slope >= 0 (Liang, Barsky 1984).
  void Keep(double value, double slope) {
    if (slope > 0.0) {
      t0 = std::max(t0, -value / slope);
    } else if (slope < 0.0) {
      t1 = std::min(t1, -value / slope);
    } else if (value < 0.0) {
      t1 = -1.0;
    }
  }
};

/// [m] that a strip in direction `course` is free, at most `reach`. At the bumper it is as wide as the
/// vehicle, and widens by `clearance` on both sides over `taper`: things beside the bumper are the guard's.
double FreeLength(const LidarScene& scene, double course, double half_width, double clearance, double reach) {
  constexpr double kTaper = 3.0;  // [m]
  const double c = std::cos(course), n = std::sin(course), widening = clearance / kTaper;
  double length = reach;
  for (const ReflectingEdge& edge : scene.edges()) {
    const Point2 a{edge.a.x * c + edge.a.y * n, edge.a.y * c - edge.a.x * n};
    const Point2 e{edge.b.x * c + edge.b.y * n - a.x, edge.b.y * c - edge.b.x * n - a.y};
    Part part;
    part.Keep(a.x, e.x);
    part.Keep(length - a.x, -e.x);
    part.Keep(half_width + clearance - a.y, -e.y);
    part.Keep(half_width + clearance + a.y, e.y);
    part.Keep(half_width + widening * a.x - a.y, widening * e.x - e.y);
    part.Keep(half_width + widening * a.x + a.y, widening * e.x + e.y);
    if (!part.empty()) length = std::min({length, a.x + part.t0 * e.x, a.x + part.t1 * e.x});
  }
  return length;
}

/// Does anything reach into the outline, grown by `margin`? @param pose of the front bumper's middle.
bool Touches(const LidarScene& scene, const Pose2& pose, const VehicleParams& vehicle, double margin) {
  const double c = std::cos(pose.heading), n = std::sin(pose.heading);
  const double half = 0.5 * vehicle.width + margin;
  return std::any_of(scene.edges().begin(), scene.edges().end(), [&](const ReflectingEdge& edge) {
    const double ax = edge.a.x - pose.x, ay = edge.a.y - pose.y;
    const double ex = edge.b.x - edge.a.x, ey = edge.b.y - edge.a.y;
    const double x = ax * c + ay * n, y = ay * c - ax * n, dx = ex * c + ey * n, dy = ey * c - ex * n;
    Part part;
    part.Keep(margin - x, -dx);
    part.Keep(x + vehicle.length + margin, dx);
    part.Keep(half - y, -dy);
    part.Keep(half + y, dy);
    return !part.empty();
  });
}

/// [m] the front bumper can go with this slip angle until the outline, grown by `margin`, would touch.
double FreeArc(const LidarScene& scene, double turn, double slip, const VehicleParams& vehicle, double margin,
               double reach) {
  constexpr double kStep = 0.2;  // [m]
  Pose2 pose{0.0, 0.0, turn};
  double speed = 1.0;
  for (double gone = 0.0; gone < reach; gone += kStep) {
    StepBicycle(0.0, slip, vehicle.rear_axle_to_front, kStep, &pose, &speed);
    if (Touches(scene, pose, vehicle, margin)) return gone;
  }
  return reach;
}

double MaxSlip(const VehicleParams& vehicle) {
  return SlipAngle(vehicle.max_steering_angle, vehicle.wheelbase, vehicle.rear_axle_to_front);
}

/// Holds a wanted course and speed within what the vehicle can do without touching anything.
OpenRoadPlan Guard(const Traffic& traffic, AgentIndex ego, const AgentParams& params, const RoadScan& scan,
                   double course, double wanted_speed) {
  constexpr double kStep = 0.1;  // [s] ahead of which the steering is looked at.
  constexpr int kSlips = 33;
  const SectorParams& p = params.sector;
  const VehicleParams& vehicle = traffic.params[ego];
  const LidarScene& scene = scan.reflectors;
  const double speed = traffic.now.speed[ego], heading = traffic.now.heading_error[ego];
  const double steering = traffic.now.steering_angle[ego];
  const double slip_now = SlipAngle(steering, vehicle.wheelbase, vehicle.rear_axle_to_front);
  // Where it already stands nearer, that is enough.
  double margin = p.flank_clearance;
  while (margin > 0.01 && Touches(scene, {0.0, 0.0, scan.turn}, vehicle, margin)) margin *= 0.8;
  if (margin < p.flank_clearance) margin *= 0.8;

  const double braking = speed * (p.reaction_time + kStep) + speed * speed / (2.0 * p.decel);
  const double near = p.stop_distance + p.guard_reach, reach = std::max(near, p.stop_distance + braking);
  const double tightest = std::min(
      MaxSlip(vehicle), std::asin(std::min(1.0, vehicle.rear_axle_to_front * params.open_road.lateral_accel /
                                                    std::max(1.0, speed * speed))));
  const double wanted = std::clamp(course - heading, -tightest, tightest);
  double slip = wanted, arc = FreeArc(scene, scan.turn, wanted, vehicle, margin, near);
  if (arc < near) {
    // The one nearest to the wanted one that is as free as any.
    for (int k = 0; k < kSlips; ++k) {
      const double other = tightest * (2.0 * k / (kSlips - 1) - 1.0);
      const double free = FreeArc(scene, scan.turn, other, vehicle, margin, near);
      if (free > arc || (free == arc && std::abs(other - wanted) < std::abs(slip - wanted))) {
        slip = other;
        arc = free;
      }
    }
  }
  // It must be able to stop whatever the steering reaches until the next step.
  const double next = SlipAngle(SteerCourse(vehicle, heading + slip, heading, steering, kStep),
                                vehicle.wheelbase, vehicle.rear_axle_to_front);
  const double next_arc = FreeArc(scene, scan.turn, next, vehicle, margin, reach);
  const double now_arc = FreeArc(scene, scan.turn, slip_now, vehicle, margin, reach);
  OpenRoadPlan plan;
  plan.course = heading + slip;
  double free = next_arc;
  const double needed = std::min(braking + 0.1, near);
  if (next_arc < needed && now_arc >= needed) {
    plan.course = heading + slip_now;
    free = now_arc;
  }
  const double room = std::max(0.0, free - 0.1);
  const double safe = free >= reach ? wanted_speed : BrakingSpeed(room, 0.0, 0.5 * p.decel);
  const double accel = (std::min(wanted_speed, safe) - speed) / params.driving.response_time;
  plan.accel = std::clamp(accel, -p.decel, vehicle.max_accel);
  return plan;
}

/// Directions in which a vehicle looks for a free strip.
constexpr int kCourses = 41;

struct Strip {
  double course{0.0}, length{-1.0};
};

/// The strip of a side (-1 right, 1 left, 0 either one) that is free the farthest; of equal ones the one
/// nearest to `wanted`.
Strip BestStrip(const LidarScene& scene, double half_width, double clearance, double reach, double max_course,
                int side, double wanted) {
  Strip best;
  for (int k = 0; k < kCourses; ++k) {
    const double course = max_course * (2.0 * k / (kCourses - 1) - 1.0);
    if (side * course < 0.0) continue;
    const double length = FreeLength(scene, course, half_width, clearance, reach);
    if (length > best.length + 0.01 ||
        (length > best.length - 0.01 && std::abs(course - wanted) < std::abs(best.course - wanted)))
      best = {course, length};
  }
  return best;
}

/// The direction along the road that leads back to the vehicle's path.
double CourseToPath(const AgentParams& params, double offset, double speed) {
  const double reach = std::max(params.driving.tracking_distance, speed * params.driving.tracking_time);
  return std::clamp(std::atan2(offset, reach), -params.driving.max_course_angle,
                    params.driving.max_course_angle);
}

int SideOf(Avoidance way) {
  return way == Avoidance::kLeft ? 1 : (way == Avoidance::kRight ? -1 : 0);
}

std::uint8_t CodeOf(const RoadScan& scan, const AvoidanceZone& zone, int min_points) {
  return scan.lidar.Code(scan.reflectors, scan.errors, zone, min_points);
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

bool IsSure(const AvoidanceTable& table, std::uint8_t code) {
  unsigned mirrored = 0;
  for (int i = 0; i < kSectors; ++i) mirrored |= (code >> i & 1u) << (kSectors - 1 - i);
  return SideOf(table[code]) != 0 && SideOf(table[code]) == -SideOf(table[mirrored]);
}

OpenRoadPlan DriveBySectors(const World& world, AgentIndex ego, const AgentParams& params, double free_speed,
                            double target_d, const RoadScan& scan, const AvoidanceTable& table,
                            Avoidance* committed) {
  const Traffic& traffic = *world.traffic;
  const SectorParams& p = params.sector;
  const double speed = traffic.now.speed[ego], half = 0.5 * traffic.params[ego].width;
  AvoidanceZone zone = TurnZone(params, traffic.params[ego].width, speed);
  std::uint8_t code = CodeOf(scan, zone, p.min_points);
  const bool ahead_free = AheadIsFree(code);
  while (code == 0 && zone.far > p.stop_distance) {
    zone = DrawnIn(zone, 0.8);
    code = CodeOf(scan, zone, p.min_points);
  }
  const double reach = std::min(zone.far, p.turn_reach);
  const auto best = [&](Avoidance side, double wanted) {
    return BestStrip(scan.reflectors, half, p.strip_clearance, reach, params.open_road.max_course,
                     SideOf(side), wanted);
  };
  if (ahead_free) {
    *committed = Avoidance::kForward;
    // Back to its path, as far as that side is free.
    constexpr unsigned kLeft = 0x07, kRight = 0xe0;
    const double to_path = CourseToPath(params, target_d - traffic.now.d[ego], speed);
    const unsigned beside = to_path > 0.0 ? kLeft : kRight;
    const double wanted = (code & beside) == beside ? to_path : 0.0;
    return Guard(traffic, ego, params, scan, best(Avoidance::kForward, wanted).course, free_speed);
  }
  // A side once chosen is kept while it leads farther than straight on: else it would turn to and fro.
  Strip strip{0.0, FreeLength(scan.reflectors, 0.0, half, p.strip_clearance, reach)};
  if (*committed != Avoidance::kForward && best(*committed, 0.0).course == 0.0)
    *committed = Avoidance::kForward;
  const bool asks = code != 0 && !AheadIsFree(code) && (IsSure(table, code) || strip.length < p.decide_by);
  if (*committed == Avoidance::kForward && asks) *committed = table[code];
  if (*committed != Avoidance::kForward) strip = best(*committed, 0.0);
  const double stopping = BrakingSpeed(strip.length, 0.0, 0.5 * p.decel);
  return Guard(traffic, ego, params, scan, strip.course,
               code == 0 ? 0.0 : std::min({free_speed, p.turn_speed, stopping}));
}

OpenRoadPlan DriveByPotential(const World& world, AgentIndex ego, const AgentParams& params,
                              double free_speed, double target_d, const RoadScan& scan) {
  const Traffic& traffic = *world.traffic;
  const VehicleParams& vehicle = traffic.params[ego];
  const double speed = traffic.now.speed[ego];
  const std::uint8_t code =
      CodeOf(scan, ZoneForSpeed(params, vehicle.width, speed), params.sector.min_points);
  const double goal = CourseToPath(params, target_d - traffic.now.d[ego], speed);
  const Point2 repulsion = Repulsion(params.apf, 0.5 * vehicle.width, scan.reflectors);
  const double x = std::cos(goal) + repulsion.x, y = std::sin(goal) + repulsion.y;
  const double course =
      std::clamp(std::atan2(y, std::max(x, 1e-3)), -params.open_road.max_course, params.open_road.max_course);
  // Pushed back more than drawn on: a local minimum of the potential, where it stops.
  double wanted_speed = x <= 0.0 || code == 0 ? 0.0 : free_speed;
  if (!AheadIsFree(code)) wanted_speed = std::min(wanted_speed, params.sector.turn_speed);
  return Guard(traffic, ego, params, scan, course, wanted_speed);
}

double ShiftByPotential(const AgentParams& params, const VehicleParams& vehicle,
                        const LidarScene& reflectors) {
  const Point2 repulsion = Repulsion(params.apf, 0.5 * vehicle.width, reflectors);
  return std::clamp(repulsion.y, -1.0, 1.0);
}

}  // namespace lanewise
