#include "agents/sensing/road_view.h"

#include <algorithm>
#include <cmath>

#include "agents/core/geometry.h"
#include "agents/rules/junction_rules.h"
#include "agents/vehicle/kinematic_bicycle.h"

namespace lanewise {
namespace {

/// [m/s] below which a road user stands, or only creeps.
constexpr double kStanding = 0.1, kCreeping = 0.5;
/// [s] of waiting after which what stands on another road is crept by: it waits for us; or, at the yield
/// line of a junction that is none of ours, for others, and will go.
constexpr float kPatience = 12.0f, kOthersPatience = 90.0f;
/// [s] for which one that stands in a junction is let go before it is crept by.
constexpr float kTimeToGo = 4.0f;
/// [s] likewise, persons at the kerb of a turn: by who reaches a little into the way, and by anybody.
constexpr float kPersonPatience = 8.0f, kLongPatience = 25.0f;
/// Cosine of the angle to the path from which a road user goes along it.
constexpr float kGoesAlong = 0.6f;
/// [s] for which a vehicle's lateral motion is taken to last.
constexpr float kDriftTime = 1.0f;
/// [s] likewise, that of a long body's rear.
constexpr float kRearDriftTime = 2.0f;
/// [m/s^2] and [s]: who brakes by more and stands within this time is taken to be where it will stand.
constexpr double kBrakes = 1.0, kStopsSoon = 2.0;
/// [m/s] and [s]: likewise who is so slow and slows down; how long it goes on at that speed.
constexpr double kCreepsUp = 1.0, kLastCreep = 0.5;
/// [s] likewise, a corner in the way of one that stands too near to turn away from it.
constexpr float kWedged = 100.0f;
/// [m] of overlap forgiven.
constexpr float kReach = 0.05f, kCorner = 0.3f, kALittle = 0.6f, kWholly = 1e3f;

/// The lane a junction's internal lane leads to: its next part, or the lane behind the junction.
LaneIndex NextOfInternal(const RoadNetwork& network, const Lane& lane) {
  if (lane.outgoing.empty()) return kNone;
  const Connection& connection = network.connections[lane.outgoing.front()];
  return connection.via != kNone ? connection.via : connection.to;
}

/// The first vehicle on `way` whose front is ahead of the ego's.
/// @param straddling also take vehicles that only reach over from the neighbour lane.
Leader FirstOnWay(const World& world, AgentIndex ego, const WayAhead& way, bool straddling) {
  const Traffic& traffic = *world.traffic;
  for (int k = 0; k < way.count; ++k) {
    for (const Occupant& occupant : world.occupancy->On(way.lanes[k].lane)) {
      const double ahead = way.lanes[k].start + occupant.s;
      if (ahead < 0.0 || (ahead == 0.0 && occupant.row <= ego) || occupant.row == ego) continue;
      if (!straddling && traffic.now.lane[occupant.row] != way.lanes[k].lane) continue;
      return {occupant.row, ahead - traffic.params[occupant.row].length, traffic.now.speed[occupant.row]};
    }
  }
  return {};
}

/// The nearest vehicle behind `s` on `lane`, looking back through the lanes that lead here. Who stands at a
/// yield line before them goes after the ego.
void SearchBack(const World& world, AgentIndex ego, LaneIndex lane, double s, double lookback, int depth,
                bool behind_yield_line, Leader* nearest) {
  const auto occupants = world.occupancy->On(lane);
  for (auto it = occupants.rbegin(); it != occupants.rend(); ++it) {
    if (it->row == ego || it->s > s) continue;
    if (it->s > world.network->lanes[lane].length) continue;  // Only its tail: its front is farther on.
    if (behind_yield_line && world.traffic->now.speed[it->row] < kStanding) return;
    const double gap = s - it->s;
    if (gap < nearest->gap) *nearest = {it->row, gap, world.traffic->now.speed[it->row]};
    return;
  }
  if (s >= lookback || depth == 0) return;
  const RoadNetwork& network = *world.network;
  for (const std::int32_t index : network.lanes[lane].incoming) {
    const Connection& connection = network.connections[index];
    // A connection that runs through an internal lane is followed from that lane, not from here.
    const bool direct = connection.via == kNone ? connection.to == lane : connection.via == lane;
    if (!direct) continue;
    SearchBack(world, ego, connection.from, s + network.lanes[connection.from].length, lookback, depth - 1,
               MustYield(connection), nearest);
  }
}

void SamplePath(const World& world, const WayAhead& way, double horizon, RoadView* view) {
  view->spacing = static_cast<float>(horizon / (kPathNodes - 1));
  const LaneCurve& own = (*world.curves)[way.lanes[0].lane];
  const PathPoint origin = own.At(-way.lanes[0].start);
  view->origin_x = origin.x;
  view->origin_y = origin.y;
  const auto place = [&](int node, double s, const PathPoint& point) {
    view->s[node] = static_cast<float>(s);
    view->x[node] = static_cast<float>(point.x - origin.x);
    view->y[node] = static_cast<float>(point.y - origin.y);
    view->cos_heading[node] = static_cast<float>(std::cos(point.heading));
    view->sin_heading[node] = static_cast<float>(std::sin(point.heading));
  };
  for (int n = 0; n < kNodesBehind; ++n) {
    const double s = (n - kNodesBehind) * static_cast<double>(kSpacingBehind);
    place(n, s, own.At(s - way.lanes[0].start));
  }
  int k = 0;
  double heading = 0.0;
  for (int n = 0; n < kPathNodes; ++n) {
    const double ahead = n * static_cast<double>(view->spacing);
    while (k + 1 < way.count && way.lanes[k + 1].start <= ahead) ++k;
    const PathPoint point = (*world.curves)[way.lanes[k].lane].At(ahead - way.lanes[k].start);
    place(kNodesBehind + n, ahead, point);
    // The mean from node to node: a joint of decimetres that bends by much is neither missed nor overrated.
    if (n > 0)
      view->curvature[n - 1] = static_cast<float>(WrapAngle(point.heading - heading)) / view->spacing;
    heading = point.heading;
    view->curvature[n] = static_cast<float>(point.curvature);
  }
}

/// A point in the frame of the path.
struct OnPath {
  float s, d;
  float cos_heading, sin_heading;  // Of the path's tangent there.
};

/// Projects a point, given relative to the view's origin, on the tangent of the nearest node.
OnPath Project(const RoadView& view, float x, float y) {
  int nearest = 0;
  float best = 1e30f;
  for (int n = 0; n < kNodesBehind + kPathNodes; ++n) {
    const float dx = x - view.x[n], dy = y - view.y[n];
    const float squared = dx * dx + dy * dy;
    if (squared < best) {
      best = squared;
      nearest = n;
    }
  }
  const float c = view.cos_heading[nearest], s = view.sin_heading[nearest];
  const float dx = x - view.x[nearest], dy = y - view.y[nearest];
  return {view.s[nearest] + dx * c + dy * s, dy * c - dx * s, c, s};
}

/// [m] where in the frame of the path, to its left, the front of vehicle `row` will be when it has followed
/// its own lanes for `time` [s].
float PlaceAfter(const World& world, AgentIndex row, float time, const RoadView& view) {
  const Motion& now = world.traffic->now;
  const double distance = now.speed[row] * time;
  const WayAhead way = LookAheadFrom(world, row, now.lane[row], now.s[row], distance);
  const LaneAhead& last = way.lanes[way.count - 1];
  const PathPoint point = (*world.curves)[last.lane].At(distance - last.start);
  const double x = point.x - now.d[row] * std::sin(point.heading),
               y = point.y + now.d[row] * std::cos(point.heading);
  return Project(view, static_cast<float>(x - view.origin_x), static_cast<float>(y - view.origin_y)).d;
}

/// [rad] from its heading to the course of its front bumper's middle; 0 if an agent does not steer it.
double SlipOf(const Traffic& traffic, AgentIndex row) {
  const VehicleParams& params = traffic.params[row];
  if (!traffic.driven[row]) return 0.0;
  return SlipAngle(traffic.now.steering_angle[row], params.wheelbase, params.rear_axle_to_front);
}

/// [m/s] at which its rear bumper, at `rear`, moves to the left of the path: the rear axle follows the
/// heading, and what is behind it swings out.
float RearDrift(const Traffic& traffic, AgentIndex row, const OnPath& rear) {
  const VehicleParams& params = traffic.params[row];
  const double slip = SlipOf(traffic, row), heading = traffic.now.heading[row];
  const double along = std::cos(heading) * rear.cos_heading + std::sin(heading) * rear.sin_heading;
  const double across = std::sin(heading) * rear.cos_heading - std::cos(heading) * rear.sin_heading;
  const double swing = (params.length - params.rear_axle_to_front) / params.rear_axle_to_front;
  return static_cast<float>(traffic.now.speed[row] *
                            (std::cos(slip) * across - swing * std::sin(slip) * along));
}

/// Places road user `row` in the frame of the path. Of one that goes along the path, or comes towards us,
/// both ends are projected: in a bend the frame turns along the body, and a neighbour that keeps to its lane
/// neither widens nor drifts.
Obstacle Place(const World& world, AgentIndex row, const RoadView& view) {
  const Traffic& traffic = *world.traffic;
  const VehicleParams& params = traffic.params[row];
  const float half_length = static_cast<float>(0.5 * params.length);
  const float half_width = static_cast<float>(0.5 * params.width);
  const float cos_heading = static_cast<float>(std::cos(traffic.now.heading[row]));
  const float sin_heading = static_cast<float>(std::sin(traffic.now.heading[row]));
  const float x = static_cast<float>(world.center_x[row] - view.origin_x);
  const float y = static_cast<float>(world.center_y[row] - view.origin_y);
  OnPath at = Project(view, x, y);
  float along = cos_heading * at.cos_heading + sin_heading * at.sin_heading;   // cos of the relative heading.
  float across = sin_heading * at.cos_heading - cos_heading * at.sin_heading;  // sin of it.
  Obstacle obstacle;
  if (std::abs(along) > kGoesAlong) {
    const OnPath front = Project(view, x + half_length * cos_heading, y + half_length * sin_heading);
    const OnPath rear = Project(view, x - half_length * cos_heading, y - half_length * sin_heading);
    auto [right, left] = std::minmax({front.d, rear.d});
    if (params.length >= kLongBody) {  // In a bend its middle cuts the corner, and its rear will.
      const float rear_soon = rear.d + kRearDriftTime * RearDrift(traffic, row, rear);
      right = std::min({right, at.d, rear_soon});
      left = std::max({left, at.d, rear_soon});
    }
    obstacle.s = 0.5f * (front.s + rear.s);
    obstacle.d = 0.5f * (left + right);
    obstacle.half_length = 0.5f * std::abs(front.s - rear.s) + half_width * std::abs(across);
    obstacle.half_width = 0.5f * (left - right) + half_width * std::abs(along);
    // The front follows the road: its motion is told by the tangent there.
    along = cos_heading * front.cos_heading + sin_heading * front.sin_heading;
    across = sin_heading * front.cos_heading - cos_heading * front.sin_heading;
  } else {
    obstacle.s = at.s;
    obstacle.d = at.d;
    obstacle.half_length = half_length * std::abs(along) + half_width * std::abs(across);
    obstacle.half_width = half_length * std::abs(across) + half_width * std::abs(along);
  }
  // It moves along its course, which in a bend is not its heading.
  const float slip = static_cast<float>(SlipOf(traffic, row));
  const float speed = static_cast<float>(traffic.now.speed[row]);
  obstacle.speed_s = speed * (along * std::cos(slip) - across * std::sin(slip));
  obstacle.speed_d = speed * (across * std::cos(slip) + along * std::sin(slip));
  // Those who drive steer back, or into their new lane; persons walk on.
  const bool person = row >= static_cast<AgentIndex>(traffic.vehicle_count);
  obstacle.drift_time = person ? 3.0f : kDriftTime;
  // Who comes towards us follows its own lane through the bend, not its tangent, which may point at us.
  if (!person && along < 0.0f && traffic.plan[row] != nullptr && speed > kStanding) {
    obstacle.speed_d = (PlaceAfter(world, row, kDriftTime, view) - obstacle.d) / kDriftTime;
  }
  obstacle.accel = static_cast<float>(traffic.now.accel[row]);
  obstacle.along = along;
  obstacle.row = row;
  obstacle.hazard = traffic.hazard[row] != 0;
  return obstacle;
}

/// [m] until it stands; 0: it stands, or it will not soon.
double StopsWithin(const Motion& now, AgentIndex row) {
  const double speed = now.speed[row], decel = -now.accel[row];
  // Who creeps up to the place where it waits is as good as there.
  if (speed < kCreepsUp && decel > 0.0) return kLastCreep * speed;
  return decel > kBrakes && speed < kStopsSoon * decel ? speed * speed / (2.0 * decel) : 0.0;
}

/// Moves an obstacle on to where it will stand.
void LetStop(double distance, double speed, Obstacle* obstacle) {
  const float time = static_cast<float>(distance / speed);
  obstacle->s += time * obstacle->speed_s;
  obstacle->d += time * obstacle->speed_d;
  obstacle->speed_s = obstacle->speed_d = obstacle->accel = 0.0f;
}

bool IsInJunction(const World& world, AgentIndex row) {
  const LaneIndex lane = world.traffic->now.lane[row];
  return lane != kNone && world.network->lanes[lane].internal;
}

/// The lane before the junction of an internal lane; a normal lane itself.
LaneIndex LaneBefore(const RoadNetwork& network, LaneIndex lane) {
  while (network.lanes[lane].internal && !network.lanes[lane].incoming.empty())
    lane = network.connections[network.lanes[lane].incoming.front()].from;
  return lane;
}

/// Did it come from this edge so lately that its tail may still be there?
bool TailIsOn(const World& world, AgentIndex row, EdgeIndex edge) {
  const Traffic& traffic = *world.traffic;
  if (row >= static_cast<AgentIndex>(traffic.vehicle_count) || traffic.plan[row] == nullptr) return false;
  const auto route = traffic.plan[row]->route();
  const auto position = static_cast<std::size_t>(traffic.route_position[row]);
  return traffic.now.s[row] < traffic.params[row].length && position > 0 && position <= route.size() &&
         route[position - 1] == edge;
}

/// Neither on a road of the ego's way nor, in a junction, come from there.
bool IsOnOtherRoad(const World& world, AgentIndex ego, AgentIndex row, const WayAhead& way) {
  const RoadNetwork& network = *world.network;
  const LaneIndex lane = world.traffic->now.lane[row];
  if (lane == kNone) return false;
  const LaneIndex before = LaneBefore(network, lane);
  if (TailIsOn(world, row, network.lanes[way.lanes[0].lane].edge)) return false;
  const bool same_road =
      std::any_of(way.lanes.begin(), way.lanes.begin() + way.count, [&](const LaneAhead& ahead) {
        return network.lanes[ahead.lane].edge == network.lanes[lane].edge || ahead.lane == before;
      });
  return !same_road && before != LaneBefore(network, world.traffic->now.lane[ego]);
}

/// A long body that turns with its front beyond its lane's border, where SUMO knows of nobody.
bool SwingsOut(const World& world, AgentIndex row) {
  const Traffic& traffic = *world.traffic;
  const LaneIndex lane = traffic.now.lane[row];
  return lane != kNone && traffic.driven[row] && traffic.params[row].length >= kLongBody &&
         std::abs(traffic.now.d[row]) > 0.5 * world.network->lanes[lane].width;
}

/// Is it on a road of the ego's way, or on a link beside the ego's own?
bool IsParallel(const World& world, AgentIndex row, const WayAhead& way) {
  const RoadNetwork& network = *world.network;
  const LaneIndex lane = world.traffic->now.lane[row];
  return lane != kNone &&
         std::any_of(way.lanes.begin(), way.lanes.begin() + way.count, [&](const LaneAhead& a) {
           return network.lanes[a.lane].edge == network.lanes[lane].edge && a.lane != lane;
         });
}

/// Does the lane of this row end at a junction on the ego's way?
bool MeetsUsAhead(const World& world, AgentIndex row, const WayAhead& way) {
  const RoadNetwork& network = *world.network;
  const auto junction = [&](LaneIndex lane) { return network.edges[network.lanes[lane].edge].to_junction; };
  const std::int32_t its_junction = junction(world.traffic->now.lane[row]);
  return std::any_of(way.lanes.begin(), way.lanes.begin() + way.count,
                     [&](const LaneAhead& ahead) { return junction(ahead.lane) == its_junction; });
}

/// How the lane of this row leads on; null: not at all.
const Connection* WayOut(const World& world, AgentIndex row) {
  const Lane& lane = world.network->lanes[world.traffic->now.lane[row]];
  return lane.outgoing.empty() ? nullptr : &world.network->connections[lane.outgoing.front()];
}

/// Has it, ahead of the ego and from the ego's own lane, begun another way through the junction?
bool TurnsOff(const World& world, AgentIndex ego, AgentIndex row, const WayAhead& way) {
  if (!IsInJunction(world, row)) return false;
  const RoadNetwork& network = *world.network;
  const LaneIndex lane = world.traffic->now.lane[row];
  return LaneBefore(network, lane) == LaneBefore(network, world.traffic->now.lane[ego]) &&
         std::none_of(way.lanes.begin(), way.lanes.begin() + way.count,
                      [&](const LaneAhead& ahead) { return ahead.lane == lane; });
}

/// Keeps the nearest kMaxObstacles.
void Keep(const Obstacle& obstacle, RoadView* view) {
  if (view->obstacle_count < kMaxObstacles) {
    view->obstacles[view->obstacle_count++] = obstacle;
    return;
  }
  auto farthest =
      std::max_element(view->obstacles.begin(), view->obstacles.end(),
                       [](const Obstacle& a, const Obstacle& b) { return std::abs(a.s) < std::abs(b.s); });
  if (std::abs(obstacle.s) < std::abs(farthest->s)) *farthest = obstacle;
}

}  // namespace

LaneIndex NextLane(const RoadNetwork& network, const RoutePlan& plan, std::size_t position, LaneIndex lane) {
  const Lane& current = network.lanes[lane];
  if (current.internal) return NextOfInternal(network, current);
  if (position + 1 >= plan.route().size() || plan.route()[position] != current.edge) return kNone;
  const LaneAdvice& advice = plan.At(position, current.index);
  const LaneIndex via = advice.connection == kNone ? kNone : network.connections[advice.connection].via;
  return via != kNone ? via : advice.next;
}

WayAhead LookAheadFrom(const World& world, AgentIndex ego, LaneIndex lane, double s, double distance) {
  const RoadNetwork& network = *world.network;
  const RoutePlan& plan = *world.traffic->plan[ego];
  std::size_t position = static_cast<std::size_t>(world.traffic->route_position[ego]);
  WayAhead way;
  double start = -s;
  while (true) {
    way.lanes[way.count++] = {lane, start};
    start += network.lanes[lane].length;
    way.length = start;
    if (start >= distance || way.count == WayAhead::kMaxLanes) return way;
    const LaneIndex next = NextLane(network, plan, position, lane);
    if (next == kNone) {
      way.leads_on = position + 1 >= plan.route().size();
      return way;
    }
    if (!network.lanes[next].internal) ++position;
    lane = next;
  }
}

WayAhead LookAhead(const World& world, AgentIndex ego, double distance) {
  return LookAheadFrom(world, ego, world.traffic->now.lane[ego], world.traffic->now.s[ego], distance);
}

Leader FindLeader(const World& world, AgentIndex ego, const WayAhead& way) {
  return FirstOnWay(world, ego, way, false);
}

Leader FindLeaderOnLane(const World& world, AgentIndex ego, LaneIndex lane, double s, double lookahead) {
  return FirstOnWay(world, ego, LookAheadFrom(world, ego, lane, s, lookahead), true);
}

Leader FindFollowerOnLane(const World& world, AgentIndex ego, LaneIndex lane, double s, double lookback) {
  Leader follower;
  SearchBack(world, ego, lane, s, lookback, 6, false, &follower);
  follower.gap -= world.traffic->params[ego].length;
  return follower;
}

void SenseRoad(const World& world, AgentIndex ego, const WayAhead& way, double horizon, bool crossing_traffic,
               RoadView* view) {
  SamplePath(world, way, horizon, view);
  view->obstacle_count = 0;
  // One circle around the path ahead: its middle node is the centre.
  const int middle = kPathNodes / 2;
  const double center_x = view->origin_x + view->x[middle], center_y = view->origin_y + view->y[middle];
  const bool own_rules = world.rules != nullptr;
  const double ego_length = world.traffic->params[ego].length;
  const double radius = 0.5 * horizon + ego_length + 8.0;
  const float reach_across = 9.0f;
  world.grid->ForEachNear(center_x, center_y, radius, [&](AgentIndex row) {
    if (row == ego) return;
    const double dx = world.center_x[row] - center_x, dy = world.center_y[row] - center_y;
    if (dx * dx + dy * dy > radius * radius) return;
    Obstacle obstacle = Place(world, row, *view);
    if (std::abs(obstacle.d) > reach_across + obstacle.half_width) return;
    if (obstacle.s + obstacle.half_length < -ego_length - 10.0) return;
    const bool person = row >= static_cast<AgentIndex>(world.traffic->vehicle_count);
    obstacle.forgiven = 0.0f;
    // Its rear follows its front out of the way as fast as it drives, not as fast as its heading says.
    if (!person && obstacle.along > 0.0f && TurnsOff(world, ego, row, way))
      obstacle.speed_s = static_cast<float>(world.traffic->now.speed[row]);
    // Who stands does not swing out with us in a bend, and a long body swings farther.
    obstacle.parallel = obstacle.along > kGoesAlong && obstacle.speed_s > kCreeping &&
                        world.traffic->params[row].length < kLongBody && IsParallel(world, row, way);
    if (!obstacle.hazard) {
      const double speed = world.traffic->now.speed[row];
      bool stands = speed < kStanding;
      // SUMO, or the rules, decide who goes first, and who moves across is left to them. But what stands is
      // in the way, outside the junction and in it; whom we wait for is until it has gone; and so are those
      // of whom no rule tells: who turns off our own road, and who comes towards us on a way that crosses
      // none of ours; under SUMO's rules a bus that turns over the lane beside its own.
      const bool waited_for = !person && world.traffic->number[row] == world.traffic->now.rule[ego].waits_for;
      const auto unruled = [&] {
        if (!own_rules) return !person && SwingsOut(world, row);
        return (obstacle.along < -kGoesAlong && !world.rules->Conflict(world, ego, row)) ||
               !IsOnOtherRoad(world, ego, row, way);
      };
      if (!crossing_traffic && !person && obstacle.along <= 0.5f && !stands && !waited_for && !unruled()) {
        const double stop = own_rules ? StopsWithin(world.traffic->now, row) : 0.0;
        if (stop == 0.0) return;
        LetStop(stop, speed, &obstacle);
        stands = true;
      }
      const bool creeping = world.traffic->now.speed[ego] < kWalkingSpeed;
      if (person) {
        // Whoever still stands there after a while waits for us to go.
        const float waited = world.traffic->now.waited[ego];
        if (!crossing_traffic && stands && creeping && waited > kPersonPatience)
          obstacle.forgiven = waited > kLongPatience ? kWholly : kReach;
      } else if (IsOnOtherRoad(world, ego, row, way)) {
        // Who stands in the junction, on another way through it, may reach a little into ours. Where that
        // would block us the shapes of the lanes overlap: we creep by, of two outside it the elder; who is
        // inside goes first, if it can. Who waits for a signal, or for others than us, will go.
        const bool elder = world.traffic->number[ego] < world.traffic->number[row];
        const float own_wait = world.traffic->now.waited[ego], its_wait = world.traffic->now.waited[row];
        const bool waits_for_ego = !own_rules || !world.traffic->driven[row] ||
                                   world.traffic->now.rule[row].waits_for == world.traffic->number[ego];
        const bool waits_inside = stands && IsInJunction(world, row);
        const Connection* way_out = WayOut(world, row);
        const bool has_signal = way_out != nullptr && way_out->signal != kNone;
        const bool waits_for_others =
            way_out != nullptr && !has_signal && MustYield(*way_out) && !MeetsUsAhead(world, row, way);
        const float patience = waits_for_others ? kOthersPatience : kPatience;
        const bool waits_for_us = waits_inside ? its_wait > kPatience && (own_wait > kTimeToGo || !own_rules)
                                               : (elder && speed < kCreeping && !has_signal &&
                                                  !waits_for_others && waits_for_ego) ||
                                                     (stands && own_wait > patience);
        if (creeping && waits_for_us) {
          obstacle.forgiven = kWholly;
        } else if (waits_inside && (creeping || !own_rules)) {
          obstacle.forgiven = kALittle;
        }
      } else if (stands && creeping && world.traffic->now.waited[ego] > kWedged) {
        obstacle.forgiven = kCorner;
      }
    }
    if (own_rules && !person && world.traffic->now.speed[row] < kStanding) {
      const Motion& now = world.traffic->now;
      obstacle.body = {{now.x[row] - view->origin_x, now.y[row] - view->origin_y, now.heading[row]},
                       world.traffic->params[row].length,
                       world.traffic->params[row].width};
    }
    Keep(obstacle, view);
  });
}

}  // namespace lanewise
