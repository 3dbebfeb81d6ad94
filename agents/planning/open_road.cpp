#include "agents/planning/open_road.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "agents/planning/car_following.h"
#include "agents/vehicle/kinematic_bicycle.h"

namespace lanewise {
namespace {

/// [m/s] below which something stands.
constexpr double kStanding = 0.1;
/// [m] behind the front bumper from which things matter.
constexpr double kBehind = 12.0;
/// [m] of progress after which the way is searched on, and tried again; of deviation after which it no longer
/// holds.
constexpr double kSearchOn = 15.0, kSearchAgain = 2.0, kOffWay = 0.3;
/// [m] beyond the ego's own position that count as going to a side, as far as the way is bound to it.
constexpr double kSideSlack = 0.3, kBound = 12.0;
/// [m/s] above a way's speed limit with which it can still be taken.
constexpr double kSpeedSlack = 0.3;
/// [s] over which moving things are foreseen, and between checks.
constexpr double kForesight = 10.0, kCheckPeriod = 0.2;

/// Position on the curve nearest to a world point, from s0 on: coarse steps, then the tangent.
Point2 ToRoad(const LaneCurve& curve, double s0, double s1, Point2 p, double* tangent) {
  constexpr double kStep = 4.0;  // [m]
  double best_s = s0, best = 1e300;
  PathPoint at;
  for (double s = s0; s <= s1 + kStep; s += kStep) {
    const PathPoint c = curve.At(s);
    const double squared = (p.x - c.x) * (p.x - c.x) + (p.y - c.y) * (p.y - c.y);
    if (squared < best) {
      best = squared;
      best_s = s;
    }
  }
  for (int k = 0; k < 3; ++k) {
    at = curve.At(best_s);
    best_s += (p.x - at.x) * std::cos(at.heading) + (p.y - at.y) * std::sin(at.heading);
  }
  at = curve.At(best_s);
  *tangent = at.heading;
  return {best_s, (p.y - at.y) * std::cos(at.heading) - (p.x - at.x) * std::sin(at.heading)};
}

/// Signature of the standing things beside a part of the road; order does not matter.
std::uint64_t Signature(std::span<const Footprint> standing, double from, double to) {
  std::uint64_t sum = 0;
  for (const Footprint& box : standing) {
    if (box.front.x + box.length < from || box.front.x - box.length > to) continue;
    // A centimetre tells things apart; their projection wobbles less than that.
    const auto x = static_cast<std::int64_t>(std::lround(100.0 * box.front.x));
    const auto y = static_cast<std::int64_t>(std::lround(100.0 * box.front.y));
    sum += static_cast<std::uint64_t>(x) * 0x9e3779b97f4a7c15ULL ^
           static_cast<std::uint64_t>(y) * 0xbf58476d1ce4e5b9ULL;
  }
  return sum;
}

struct Ego {
  double s, d, heading_error, slip, speed;
  const VehicleParams& vehicle;
};

/// Highest speed [m/s] at each point of the way: bends, steering rate, nearness, and an end that leads
/// nowhere.
void SpeedCaps(const AgentParams& params, const VehicleParams& vehicle, double decel, const Way& way,
               bool ends_with_road, std::array<float, Way::kMaxPoints>* caps) {
  const OpenRoadParams& p = params.open_road;
  for (int k = 0; k < way.count; ++k) {
    const double curvature = std::abs(std::sin(way.slip[k])) / vehicle.rear_axle_to_front;
    double cap = std::sqrt(p.lateral_accel / std::max(curvature, 1e-4));
    // The steering turns between two points.
    const double change = k + 1 < way.count ? std::abs(way.slip[k + 1] - way.slip[k]) : 0.0;
    if (change > 0.0)
      cap = std::min(cap, p.steering_share * vehicle.max_steering_rate * Way::kSpacing * 2.0 / change);
    if (way.gap[k] < params.dwa.clearance_comfort) cap = std::min(cap, p.near_speed);
    (*caps)[k] = static_cast<float>(cap);
  }
  // Nothing is known of what comes behind the way.
  if (!ends_with_road) {
    for (int k = std::max(0, way.count - 3); k < way.count; ++k) (*caps)[k] = 0.0f;
  }
  for (int k = way.count - 2; k >= 0; --k) {
    (*caps)[k] = std::min((*caps)[k], static_cast<float>(BrakingSpeed(Way::kSpacing, (*caps)[k + 1], decel)));
  }
}

/// Can the ego, at its speed, follow the way with the brakes it has?
bool IsDrivable(const AgentParams& params, const Ego& ego, const Way& way) {
  std::array<float, Way::kMaxPoints> caps;
  SpeedCaps(params, ego.vehicle, ego.vehicle.max_decel, way, false, &caps);
  return way.count > 0 && ego.speed <= caps[0] + kSpeedSlack;
}

/// When does the ego, going by `speed_at` from now, first touch something that moves? kForesight if never.
template <class SpeedAt>
double FirstConflict(const Ego& ego, const Way& way, const OpenRoadView& view, double margin,
                     SpeedAt&& speed_at) {
  double s = ego.s, speed = ego.speed;
  const double reach = 0.5 * std::hypot(ego.vehicle.length, ego.vehicle.width) + margin;
  for (double t = 0.0; t < kForesight; t += kCheckPeriod) {
    const double d = way.At(way.d, s), heading = way.At(way.heading, s);
    const Footprint body{{s, d, heading}, ego.vehicle.length, ego.vehicle.width};
    const double x = s - 0.5 * ego.vehicle.length * std::cos(heading);
    const double y = d - 0.5 * ego.vehicle.length * std::sin(heading);
    for (const RoadThing& thing : view.moving) {
      Footprint box = thing.box;
      box.front.x += thing.velocity.x * t;
      box.front.y += thing.velocity.y * t;
      const double near = reach + 0.5 * (box.length + box.width);
      const double dx = box.front.x - x, dy = box.front.y - y;
      if (dx * dx + dy * dy > (near + box.length) * (near + box.length)) continue;
      if (-PenetrationDepth(body, box) < margin) return t;
    }
    const double next = speed_at(s, speed);
    s += 0.5 * (speed + next) * kCheckPeriod;
    speed = next;
  }
  return kForesight;
}

}  // namespace

void OpenRoadView::Clear() {
  standing.clear();
  moving.clear();
  vehicles = false;
}

bool IsOpenRoad(const RoadNetwork& network, LaneIndex lane, const OpenRoadParams& params) {
  return network.lanes[lane].width >= params.min_width && !network.lanes[lane].internal;
}

void SenseOpenRoad(const World& world, AgentIndex ego, double sight, OpenRoadView* view) {
  const Traffic& traffic = *world.traffic;
  view->Clear();
  const LaneIndex lane = traffic.now.lane[ego];
  const LaneCurve& curve = (*world.curves)[lane];
  const double s = traffic.now.s[ego], scale = curve.scale();
  const double half_width = 0.5 * world.network->lanes[lane].width;
  const PathPoint middle = curve.At(s + 0.5 * (sight - kBehind) / scale);
  const double radius = 0.5 * (sight + kBehind) + 10.0;
  world.grid->ForEachNear(middle.x, middle.y, radius, [&](AgentIndex row) {
    if (row == ego) return;
    const double dx = world.center_x[row] - middle.x, dy = world.center_y[row] - middle.y;
    if (dx * dx + dy * dy > radius * radius) return;
    double tangent;
    const Point2 p =
        ToRoad(curve, s - kBehind, s + sight / scale, {world.center_x[row], world.center_y[row]}, &tangent);
    const VehicleParams& params = traffic.params[row];
    if (row < static_cast<AgentIndex>(traffic.vehicle_count)) {
      view->vehicles = view->vehicles || std::abs(p.y) < half_width + 2.0;
      return;
    }
    const double heading = WrapAngle(traffic.now.heading[row] - tangent), speed = traffic.now.speed[row];
    const double c = std::cos(heading), n = std::sin(heading);
    const RoadThing thing{{{p.x * scale + 0.5 * params.length * c, p.y + 0.5 * params.length * n, heading},
                           params.length,
                           params.width},
                          {speed * c, speed * n}};
    if (speed >= kStanding) {
      view->moving.push_back(thing);
    } else if (std::abs(p.y) < half_width + 0.5 * params.length) {
      view->standing.push_back(thing.box);
    }
  });
}

OpenRoadPlan PlanOpenRoad(const World& world, AgentIndex row, const AgentParams& params, double free_speed,
                          double target_d, Avoidance advice, const OpenRoadView& view, WaySearch* search,
                          WayMemory* memory) {
  const Traffic& traffic = *world.traffic;
  const OpenRoadParams& p = params.open_road;
  const VehicleParams& vehicle = traffic.params[row];
  const LaneIndex lane = traffic.now.lane[row];
  const LaneCurve& curve = (*world.curves)[lane];
  const Ego ego{traffic.now.s[row] * curve.scale(),
                traffic.now.d[row],
                traffic.now.heading_error[row],
                SlipAngle(traffic.now.steering_angle[row], vehicle.wheelbase, vehicle.rear_axle_to_front),
                traffic.now.speed[row],
                vehicle};
  Way& way = memory->way;

  // The way: searched on as the ego comes forward, and anew when it no longer holds.
  const double road_end = world.network->lanes[lane].length * curve.scale();
  const bool known = memory->vehicle == traffic.number[row] && memory->lane == lane && way.count > 0;
  const bool holds = known && std::abs(ego.d - way.At(way.d, ego.s)) < kOffWay &&
                     memory->things == Signature(view.standing, way.begin_s - vehicle.length, way.end_s());
  const bool stale = ego.s > way.begin_s + kSearchOn && ego.s > memory->searched_at + kSearchAgain &&
                     way.end_s() < road_end - 1.0;
  if (!holds || stale || memory->advice != advice) {
    WayTask task;
    task.start = {ego.s, ego.d, ego.heading_error};
    task.slip = ego.slip;
    task.end_s = std::min(ego.s + p.sight, road_end);
    task.left = 0.5 * world.network->lanes[lane].width;
    task.right = -task.left;
    task.target_d = target_d;
    task.max_course = p.max_course;
    task.margin = params.dwa.clearance_margin;
    task.comfort = params.dwa.clearance_comfort;
    task.vehicle = &vehicle;
    task.things = view.standing;
    Way found;
    bool complete = false;
    if (advice != Avoidance::kForward) {
      task.side_until = ego.s + kBound;
      if (advice == Avoidance::kLeft) task.side_min = ego.d - kSideSlack;
      if (advice == Avoidance::kRight) task.side_max = ego.d + kSideSlack;
      complete = search->Search(task, &found);
      task.side_until = task.side_min = -1e9;
      task.side_max = 1e9;
    }
    // A way that holds is kept if the advised side has none, or none that can be driven from here.
    complete = complete && (!holds || IsDrivable(params, ego, found));
    bool keep = !complete && holds && !stale;
    if (!complete && !keep) complete = search->Search(task, &found);
    if (!complete && !keep) {
      // Squeeze through rather than stop.
      Way squeezed;
      task.margin *= 0.5;
      complete = search->Search(task, &squeezed);
      if (squeezed.count > found.count) found = squeezed;
    }
    keep = keep ||
           (holds && ((!found.complete && found.end_s() < way.end_s()) || !IsDrivable(params, ego, found)));
    if (!keep) way = found;
    memory->vehicle = traffic.number[row];
    memory->lane = lane;
    memory->searched_at = ego.s;
    memory->advice = advice;
    memory->things = Signature(view.standing, way.begin_s - vehicle.length, way.end_s());
  }

  std::array<float, Way::kMaxPoints> caps;
  SpeedCaps(params, vehicle, std::min(p.decel, vehicle.max_decel), way,
            way.complete && way.end_s() > road_end - 1.0, &caps);
  const auto cap_at = [&](double s) { return std::min(free_speed, way.At(caps, s)); };

  OpenRoadPlan plan;
  const double ahead = std::max(p.pursuit_distance, ego.speed * p.pursuit_time);
  plan.course =
      std::clamp(std::atan2(way.At(way.d, ego.s + ahead) - ego.d, ahead), -p.max_course, p.max_course);

  // The window of speeds.
  const double response = params.driving.response_time;
  const DynamicWindow window = ReachableSpeeds(ego.speed, vehicle.max_decel, vehicle.max_accel, response);
  const double wanted = std::min(cap_at(ego.s), cap_at(ego.s + ego.speed * response));
  const double fastest = std::clamp(wanted, window.min, window.max);
  if (view.moving.empty()) {
    plan.accel = (fastest - ego.speed) / response;
    return plan;
  }
  double best_conflict = -1.0;
  for (int k = 0; k < params.dwa.speed_samples; ++k) {
    const double share = static_cast<double>(k) / (params.dwa.speed_samples - 1);
    const double first = fastest + share * (window.min - fastest);
    const double accel = (first - ego.speed) / response;
    for (const bool go_on : {true, false}) {
      double t = 0.0;
      const double conflict = FirstConflict(ego, way, view, p.moving_margin, [&](double s, double v) {
        t += kCheckPeriod;
        if (t <= response + 1e-9) return std::max(0.0, v + accel * kCheckPeriod);
        if (!go_on) return std::max(0.0, v - params.driving.comfort_decel * kCheckPeriod);
        return std::clamp(cap_at(s), std::max(0.0, v - vehicle.max_decel * kCheckPeriod),
                          v + vehicle.max_accel * kCheckPeriod);
      });
      if (conflict >= kForesight) {
        plan.accel = accel;
        return plan;
      }
      if (conflict > best_conflict) {
        best_conflict = conflict;
        plan.accel = accel;
      }
    }
  }
  // No admissible speed: brake as hard as possible if that comes later to a conflict than all.
  const double braking = FirstConflict(ego, way, view, 0.0, [&](double, double v) {
    return std::max(0.0, v - (vehicle.emergency_decel - 1.0) * kCheckPeriod);
  });
  plan.emergency = braking > best_conflict;
  return plan;
}

double SteerCourse(const VehicleParams& vehicle, double course, double heading_error, double steering_now,
                   double dt) {
  const double max_slip =
      SlipAngle(vehicle.max_steering_angle, vehicle.wheelbase, vehicle.rear_axle_to_front);
  const double slip = std::clamp(course - heading_error, -max_slip, max_slip);
  const double wanted = SteeringAngle(slip, vehicle.wheelbase, vehicle.rear_axle_to_front);
  const double lagged = steering_now + dt / (vehicle.steering_lag + dt) * (wanted - steering_now);
  const DynamicWindow window =
      ReachableSteering(steering_now, vehicle.max_steering_rate, vehicle.max_steering_angle, dt);
  return std::clamp(lagged, window.min, window.max);
}

}  // namespace lanewise
