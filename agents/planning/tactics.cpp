#include "agents/planning/tactics.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "agents/planning/car_following.h"

namespace lanewise {
namespace {

/// [s] an unforced change waits after the last one.
constexpr float kChangePause = 4.0f;
/// [m] how far a hazard ahead makes a vehicle leave the lane.
constexpr double kHazardLookahead = 100.0;
/// [m/s], [m] in a queue: slower is crawling; the room that is enough beside a vehicle that crawls.
constexpr double kCrawlSpeed = 1.0;
constexpr double kStandingGap = 0.2;
/// Share of the wanted speed below which a vehicle counts as queued.
constexpr double kQueueSpeed = 0.7;
/// [m] before its lane's end a vehicle is let in; further back it has time to find a gap itself.
constexpr double kLetInZone = 150.0;
/// [m] of use left in its lane with which a vehicle changes even just before a junction, or in it.
constexpr double kLastRoom = 50.0;
/// [s] for which one stands to let in another who stands.
constexpr float kCourtesy = 10.0f;
/// [m] ahead of which nobody is let in yet.
constexpr double kLetInReach = 50.0;
/// [m] to a standing leader from which the ego can steer around its corner.
constexpr double kTurnOutRoom = 5.0;
/// [m] before its lane's end a vehicle stops that drives on to change places with the one beside it.
constexpr double kSwapReserve = 1.0;
/// [m] of its body a vehicle may have on the neighbour lane and still begin another change.
constexpr double kBodyOver = 0.5;
/// [m] before the junction from which there is no room left to leave a lane that is held up.
constexpr double kRoomToLeave = 12.0;
/// [m] by which positions on neighbour lanes may differ and still count as the same.
constexpr double kEven = 0.05;
/// [m] of length from which a vehicle does not keep to its lane in turns, and [rad] of those turns.
constexpr double kLongVehicle = 9.0;
constexpr double kLeastTurn = 0.25;
/// Of rear axle to front: how much wider it turns a radian, and how far ahead it aims where it turns early.
constexpr double kWidening = 0.4, kAimAhead = 1.1;
/// [m] by which it turns wider, and cuts in, at most.
constexpr double kMaxWidening = 2.0, kMaxCut = 5.0;
/// [m] before its lane's end, and [m/s], at which a vehicle that has found no gap drives on where the lane
/// leads.
constexpr double kLastChance = 12.0, kLastChanceSpeed = 1.0;
/// [s] of waiting after which it does so even if nobody passes it: it may be a link of a circle of vehicles
/// that wait for each other, which nothing else would open.
constexpr float kStuck = 120.0f;
/// [m/s^2] braking an agent accepts to find a gap for a change it needs.
constexpr double kAlignDecel = 1.5;

/// The change the route, or something that stands in the lane, asks for.
struct NeededChange {
  int side{0};
  int count{0};
  double remaining{1e9};  ///< [m] until the lane is of no more use.
  bool asks{true};        ///< Others are asked to make room.
};

/// Everything the decision needs about the ego, gathered once.
struct Ego {
  const World& world;
  const AgentParams& params;
  AgentIndex row;
  const Lane& lane;
  const VehicleParams& vehicle;
  const RoutePlan& plan;
  std::size_t position;
  double s, d, speed, speed_limit;

  const Motion& now() const { return world.traffic->now; }
  const LaneAdvice& Advice(int side) const { return plan.At(position, lane.index + side); }
  double HalfSpan() const { return 0.5 * (lane.width - vehicle.width); }
};

/// Highest speed to follow at, with the ego's comfortable braking.
double FollowSpeed(const Ego& ego, double gap, double leader_speed, double decel) {
  return SafeSpeed(gap - ego.vehicle.min_gap, leader_speed, decel, ego.vehicle.time_gap);
}

/// A cap that brakes no harder than `decel` now.
double SoftCap(const Ego& ego, double wanted, double decel) {
  return std::max(wanted, ego.speed - decel * ego.params.driving.response_time);
}

/// The ego's position on the neighbour lane, as SUMO counts [m].
double PositionOn(const Ego& ego, LaneIndex neighbor) {
  const std::vector<LaneCurve>& curves = *ego.world.curves;
  const double there = Abeam(curves[ego.now().lane[ego.row]], ego.s, curves[neighbor]);
  return std::abs(there - ego.s) < kEven ? ego.s : there;
}

LaneIndex UsableNeighbor(const Ego& ego, int side) {
  const LaneIndex neighbor = ego.world.network->Neighbor(ego.now().lane[ego.row], side);
  if (neighbor == kNone || !ego.Advice(side).allowed) return kNone;
  const double there = PositionOn(ego, neighbor);
  return there >= 0.0 && there <= ego.world.network->lanes[neighbor].length ? neighbor : kNone;
}

/// Do the ego's lane and its neighbour cross the junction side by side?
bool LeadTogether(const Ego& ego, int side) {
  const LaneAdvice& here = ego.Advice(0);
  if (UsableNeighbor(ego, side) == kNone) return false;
  const LaneAdvice& there = ego.Advice(side);
  return here.next != kNone && there.next != kNone &&
         ego.world.network->Neighbor(here.next, side) == there.next;
}

NeededChange FindNeededChange(const Ego& ego) {
  const LaneAdvice& advice = ego.Advice(0);
  NeededChange needed;
  int changes = advice.can_wait ? 0 : advice.changes;
  const Traffic& traffic = *ego.world.traffic;
  if (traffic.stop_lane[ego.row] != kNone) changes = traffic.stop_lane[ego.row] - ego.lane.index;
  if (changes != 0) {
    needed = {changes > 0 ? 1 : -1, std::abs(changes), advice.change_distance - ego.s};
    if (traffic.stop_lane[ego.row] != kNone)
      needed.remaining = std::min(needed.remaining, traffic.stop_distance[ego.row]);
  }
  return needed;
}

/// Room in the target lane: may the ego go in now? `urgency` in [0, 1] asks more of the others.
bool GapAccepted(const Ego& ego, const Leader& ahead, const Leader& behind, double urgency) {
  const LaneChangeParams& p = ego.params.lane_change;
  const double reaction = 0.7 - 0.4 * urgency;
  const double decel = p.safe_decel + 1.5 * urgency;
  // Who stands behind has stopped to let the ego in, or will see it: any room is enough.
  const double min_behind = behind.speed < kCrawlSpeed ? kStandingGap : p.min_gap;
  // Who stands needs room to steer over, or stands across two lanes until the one ahead drives on.
  const bool both_stand = ego.speed < kCrawlSpeed && ahead.speed < kCrawlSpeed;
  const double min_ahead = both_stand ? kTurnOutRoom : urgency > 0.0 ? kStandingGap : p.min_gap;
  if (ahead.row != kNone &&
      (ahead.gap < min_ahead ||
       ego.speed > SafeSpeed(ahead.gap - kStandingGap, ahead.speed, decel, reaction) + 0.3)) {
    return false;
  }
  return behind.row == kNone ||
         (behind.gap >= min_behind &&
          behind.speed <= SafeSpeed(behind.gap - min_behind, ego.speed, decel, reaction) + 0.3);
}

/// Does another, on the far side of the lane the ego would join, need that lane too, beside the ego, and goes
/// first? Both would find it free. Who needs it goes before who only likes it, then the elder.
bool IsContested(const Ego& ego, LaneIndex neighbor, int side, bool needed) {
  constexpr double kBeside = 2.0;  // [m]
  const LaneIndex beyond = ego.world.network->Neighbor(neighbor, side);
  if (beyond == kNone) return false;
  const Traffic& traffic = *ego.world.traffic;
  const double s = PositionOn(ego, beyond);
  const auto occupants = ego.world.occupancy->On(beyond);
  return std::any_of(occupants.begin(), occupants.end(), [&](const Occupant& other) {
    return traffic.now.urgent[other.row] && traffic.now.blinker[other.row] == -side &&
           other.s > s - ego.vehicle.length - kBeside &&
           other.s - traffic.params[other.row].length < s + kBeside &&
           (!needed || traffic.number[other.row] < traffic.number[ego.row]);
  });
}

/// Can the ego's body leave its lane soon? Not behind one that stands close ahead of it.
bool CanTurnOut(const Leader& leader) {
  return leader.row == kNone || leader.gap > kTurnOutRoom || leader.speed > 2.0;
}

/// MOBIL incentive [m/s^2] for the neighbour lane.
double Advantage(const Ego& ego, const Leader& leader, const Leader& ahead, const Leader& behind,
                 double limit_there) {
  const double decel = ego.params.driving.comfort_decel;
  const VehicleParams& v = ego.vehicle;
  const auto accel = [&](const Leader& l, double limit) {
    return std::max(-v.max_decel,
                    IdmAccel(ego.speed, limit, l.gap, l.speed, v.max_accel, decel, v.time_gap, v.min_gap));
  };
  double follower_loss = 0.0;
  if (behind.row != kNone) {
    const VehicleParams& f = ego.world.traffic->params[behind.row];
    const double wanted = ego.world.traffic->speed_limit[behind.row];
    const double gap_now = behind.gap + v.length + std::max(0.0, ahead.gap);
    const double before =
        IdmAccel(behind.speed, wanted, gap_now, ahead.speed, f.max_accel, decel, f.time_gap, f.min_gap);
    const double after =
        IdmAccel(behind.speed, wanted, behind.gap, ego.speed, f.max_accel, decel, f.time_gap, f.min_gap);
    follower_loss = std::clamp(before - after, 0.0, 2.0 * f.max_decel);
  }
  return accel(ahead, limit_there) - accel(leader, ego.speed_limit) -
         ego.params.lane_change.politeness * follower_loss;
}

/// Does this turn cross the way of oncoming traffic, for which it may have to wait?
bool Crosses(const Ego& ego, const Connection& connection) {
  return connection.direction == (ego.world.network->left_hand ? 'r' : 'l');
}

/// Does one that stands or is slow turn across oncoming traffic from `lane`, ahead of `s` on it or already in
/// the junction behind it, instead of driving on with the ego to edge `next`?
bool HasTurner(const Ego& ego, LaneIndex lane, double s, EdgeIndex next) {
  const RoadNetwork& network = *ego.world.network;
  const Traffic& traffic = *ego.world.traffic;
  const double slow = kQueueSpeed * ego.speed_limit;
  for (const std::int32_t index : network.lanes[lane].outgoing) {
    const Connection& connection = network.connections[index];
    if (!Crosses(ego, connection) || network.lanes[connection.to].edge == next) continue;
    if (connection.via != kNone) {
      for (const Occupant& other : ego.world.occupancy->On(connection.via))
        if (traffic.now.speed[other.row] < slow) return true;
    }
    for (const Occupant& other : ego.world.occupancy->On(lane)) {
      if (other.s <= s || traffic.now.lane[other.row] != lane || traffic.now.speed[other.row] > slow ||
          traffic.plan[other.row] == nullptr) {
        continue;
      }
      const RoutePlan& plan = *traffic.plan[other.row];
      const auto position = static_cast<std::size_t>(traffic.route_position[other.row]);
      if (position < plan.route().size() && plan.route()[position] == network.lanes[lane].edge &&
          plan.At(position, network.lanes[lane].index).connection == index) {
        return true;
      }
    }
  }
  return false;
}

/// [s] until the slow vehicles ahead on the way that begins with a lane of the ego's edge have gone.
double QueueTime(const Ego& ego, LaneIndex lane, double s) {
  constexpr double kSight = 300.0, kHeadway = 2.0, kBlocked = 30.0;  // [m], [s], [s].
  const Traffic& traffic = *ego.world.traffic;
  const WayAhead ahead = LookAheadFrom(ego.world, ego.row, lane, s, kSight);
  const auto route = ego.plan.route();
  std::size_t position = ego.position;
  int queue = 0;
  bool blocked = false;
  for (int k = 0; k < ahead.count; ++k) {
    const LaneIndex here = ahead.lanes[k].lane;
    if (ego.world.network->lanes[here].internal) continue;
    if (k > 0) ++position;
    const double from = k == 0 ? s : 0.0;
    for (const Occupant& other : ego.world.occupancy->On(here)) {
      if (other.row != ego.row && other.s > from && traffic.now.lane[other.row] == here &&
          traffic.now.speed[other.row] <= kQueueSpeed * ego.speed_limit) {
        ++queue;
      }
    }
    blocked = blocked || (position + 1 < route.size() && HasTurner(ego, here, from, route[position + 1]));
  }
  return kHeadway * queue + (blocked ? kBlocked : 0.0);
}

struct Neighborhood {
  Leader ahead, behind;
};

Neighborhood LookBeside(const Ego& ego, LaneIndex neighbor) {
  const double lookahead = std::max(40.0, 6.0 * ego.speed), lookback = std::max(40.0, 5.0 * ego.speed_limit);
  const double s = PositionOn(ego, neighbor);
  return {FindLeaderOnLane(ego.world, ego.row, neighbor, s, lookahead),
          FindFollowerOnLane(ego.world, ego.row, neighbor, s, lookback)};
}

/// Lateral distance between the present lane's centre and its neighbour's.
double Spacing(const Ego& ego, LaneIndex neighbor) {
  return 0.5 * (ego.lane.width + ego.world.network->lanes[neighbor].width);
}

/// Joins the neighbour lane now.
void Join(const Ego& ego, LaneIndex neighbor, int side, Tactics* tactics) {
  tactics->lane_change = tactics->blinker = static_cast<std::int8_t>(side);
  tactics->target_d = side * Spacing(ego, neighbor);
  tactics->change_shift = PositionOn(ego, neighbor) - ego.s;
}

/// The lateral position that passes a standing vehicle within the lane, if there is room; else `fallback`.
bool PassWithinLane(const Ego& ego, const Leader& hazard, double* target_d) {
  const Traffic& traffic = *ego.world.traffic;
  const double need =
      0.5 * (traffic.params[hazard.row].width + ego.vehicle.width) + ego.params.driving.pass_clearance;
  const double hazard_d = traffic.now.d[hazard.row];
  const double left = hazard_d + need, right = hazard_d - need;
  const double limit = ego.HalfSpan() - 0.1;
  const bool left_fits = left <= limit, right_fits = right >= -limit;
  if (!left_fits && !right_fits) return false;
  *target_d = left_fits && (!right_fits || std::abs(left - ego.d) <= std::abs(right - ego.d)) ? left : right;
  return true;
}

/// The point of the way `distance` [m] ahead of the ego.
PathPoint PointAhead(const Ego& ego, const WayAhead& way, double distance) {
  int k = way.count - 1;
  while (k > 0 && way.lanes[k].start > distance) --k;
  return (*ego.world.curves)[way.lanes[k].lane].At(distance - way.lanes[k].start);
}

/// [m] lateral position a long vehicle aims at in a turn and just before it: on the lane's centre its rear
/// would cut the corner, where others wait, or its front, which turns no tighter than its steering allows,
/// would swing over the middle of the road. The kerb's side is free. A turn away from the kerb is driven
/// wider; one towards it begins early, on the line to a point ahead (pure pursuit).
double KeepToKerb(const Ego& ego, const WayAhead& way) {
  if (ego.vehicle.length < kLongVehicle || ego.lane.index > 0) return 0.0;  // Beside it drive others.
  const Motion& now = ego.now();
  const double length = ego.vehicle.rear_axle_to_front;
  const double kerb = ego.world.network->left_hand ? 1.0 : -1.0;
  const double angle =
      std::remainder(PointAhead(ego, way, length).heading - now.heading[ego.row], 2.0 * std::numbers::pi);
  if (std::abs(angle) < kLeastTurn) return 0.0;
  if (kerb * angle < 0.0) return kerb * std::min(kWidening * length * std::abs(angle), kMaxWidening);
  const PathPoint here = PointAhead(ego, way, 0.0), aim = PointAhead(ego, way, kAimAhead * length);
  const double dx = aim.x - now.x[ego.row], dy = aim.y - now.y[ego.row];
  const double c = std::cos(here.heading), s = std::sin(here.heading);
  const DrivingParams& driving = ego.params.driving;
  const double reach = std::max(driving.tracking_distance, ego.speed * driving.tracking_time);
  return ego.d + std::clamp(reach * std::atan2(dy * c - dx * s, dx * c + dy * s), -kMaxCut, kMaxCut);
}

/// Does `other`, on a lane at this side of the ego's way, ask to be let in here?
bool Asks(const Ego& ego, const Occupant& other, LaneIndex its_lane, int side) {
  const Traffic& traffic = *ego.world.traffic;
  return traffic.now.urgent[other.row] && traffic.now.blinker[other.row] == -side &&
         traffic.now.lane[other.row] == its_lane &&
         ego.world.network->lanes[its_lane].length - other.s <= kLetInZone;
}

/// Is the ego's waiting of use to it? Not if it stands too near behind another to turn out, nor once the ego
/// could have gone for long and it still stands.
bool WouldCome(const Ego& ego, const Leader& leader, const Occupant& other, LaneIndex its_lane) {
  if (ego.world.traffic->now.speed[other.row] > kCrawlSpeed) return true;
  if (ego.now().waited[ego.row] > kCourtesy && leader.gap > ego.vehicle.min_gap + 1.0) return false;
  return CanTurnOut(FindLeaderOnLane(ego.world, other.row, its_lane, other.s, kLetInReach));
}

/// Makes room for the nearest vehicle ahead on a lane beside the ego's way that must come over: one an edge,
/// so that lanes merge like a zipper, and whoever stands at its lane's end, where it blocks all behind it.
void LetIn(const Ego& ego, const WayAhead& way, const Leader& leader, Tactics* tactics) {
  const Traffic& traffic = *ego.world.traffic;
  const double leader_front = leader.row == kNone ? 1e9 : leader.gap + traffic.params[leader.row].length;
  for (const int side : {-1, +1}) {
    bool done = false;
    for (int k = 0; k < way.count && way.lanes[k].start < kLetInReach && !done; ++k) {
      const LaneIndex neighbor = ego.world.network->Neighbor(way.lanes[k].lane, side);
      if (neighbor == kNone || (k > 0 && ego.world.network->lanes[neighbor].length > 30.0)) continue;
      for (const Occupant& other : ego.world.occupancy->On(neighbor)) {
        const double front = way.lanes[k].start + Abeam((*ego.world.curves)[neighbor], other.s,
                                                        (*ego.world.curves)[way.lanes[k].lane]);
        if (front <= 0.0 || other.row == ego.row) continue;
        if (front > kLetInReach) break;
        if (!Asks(ego, other, neighbor, side) || !WouldCome(ego, leader, other, neighbor)) continue;
        // Whom SUMO drives asks for the follower's whole standstill gap.
        const double gap = front - traffic.params[other.row].length -
                           (traffic.driven[other.row] ? 0.0 : ego.vehicle.min_gap);
        // Beside a vehicle that stands, waiting makes no room: who is further back lets it in.
        if (gap < kStandingGap && traffic.now.speed[other.row] < kCrawlSpeed) continue;
        const std::int32_t number = traffic.number[other.row];
        const bool blocks_its_lane =
            traffic.now.speed[other.row] < kCrawlSpeed &&
            ego.world.network->lanes[neighbor].length - other.s < 2.0 * ego.params.lane_change.reserve;
        const double decel = ego.params.lane_change.cooperation_decel;
        // Between it and the ego drives another, who may be too fast to stop for it.
        if (front > leader_front && (!blocks_its_lane || BrakingSpeed(gap, 0.0, decel) < ego.speed)) continue;
        done = true;
        if (tactics->yielded_to != kNone && tactics->yielded_to != number && !blocks_its_lane) break;
        tactics->yielded_to = number;
        tactics->speed_cap =
            std::min(tactics->speed_cap,
                     SoftCap(ego, FollowSpeed(ego, gap, traffic.now.speed[other.row], decel), decel));
        break;
      }
    }
  }
}

/// Of two that stand side by side, each in need of the other's lane, does the ego drive on to let both
/// change? The one does that has less way to go until it is past the other.
bool GoesFirst(const Ego& ego, int side, const Neighborhood& beside) {
  const Traffic& traffic = *ego.world.traffic;
  for (const Leader* other : {&beside.ahead, &beside.behind}) {
    const AgentIndex row = other->row;
    if (row == kNone || other->gap >= kStandingGap || other->speed >= kCrawlSpeed ||
        !traffic.now.urgent[row] || traffic.now.blinker[row] != -side) {
      continue;
    }
    const double its_length = traffic.params[row].length;
    const double its_lead =
        other == &beside.ahead ? other->gap + its_length : -(other->gap + ego.vehicle.length);
    const double own_way = ego.vehicle.length + its_lead, its_way = its_length - its_lead;
    return own_way < its_way || (own_way == its_way && traffic.number[ego.row] < traffic.number[row]);
  }
  return false;
}

/// A needed change: how fast one may go while it is not done.
void PrepareChange(const Ego& ego, const NeededChange& needed, const Neighborhood& beside, double urgency,
                   Tactics* tactics) {
  const LaneChangeParams& p = ego.params.lane_change;
  // Who goes first drives on past the other, but leaves room for the changes that follow.
  const double reserve = GoesFirst(ego, needed.side, beside)
                             ? kSwapReserve + p.reserve * (needed.count - 1)
                             : std::min(p.reserve * needed.count, 0.5 * ego.lane.length);
  // Stop where the lane can still be left, not at its end.
  tactics->speed_cap = std::min(
      tactics->speed_cap, SafeSpeed(needed.remaining - reserve, 0.0, ego.params.driving.comfort_decel, 0.5));
  if (urgency > 0.4 && beside.ahead.row != kNone && ego.speed > 2.0) {
    const double wanted = std::max(
        2.0, FollowSpeed(ego, beside.ahead.gap, beside.ahead.speed, ego.params.driving.comfort_decel));
    tactics->speed_cap = std::min(tactics->speed_cap, SoftCap(ego, wanted, kAlignDecel));
  }
}

/// Until the ego's body has come over it goes slowly near the lane's end, where it may still be in the
/// way of others, or on a lane that ends.
void ComeOver(const Ego& ego, Tactics* tactics) {
  constexpr double kCreepSpeed = 4.0;  // [m/s]
  const double to_end = ego.lane.length - ego.s - ego.params.lane_change.reserve;
  const double brake = SafeSpeed(to_end, 0.0, ego.params.driving.comfort_decel, 0.5);
  tactics->speed_cap = std::min(tactics->speed_cap, std::max(brake, kCreepSpeed));
  tactics->blinker = ego.d < 0.0 ? 1 : -1;
}

/// The change to the lane beside that gets past who waits to turn across oncoming traffic, if the ego's own
/// lane is held up by one. It waits for a gap there, and asks nobody to stop for it.
NeededChange LeaveTurner(const Ego& ego, const Leader& leader) {
  const auto route = ego.plan.route();
  if (leader.row == kNone || leader.gap > kHazardLookahead || ego.position + 1 >= route.size() ||
      ego.lane.length - ego.s < kRoomToLeave) {
    return {};
  }
  const EdgeIndex next = route[ego.position + 1];
  const LaneIndex own = ego.now().lane[ego.row];
  if (!HasTurner(ego, own, ego.s, next)) return {};
  for (const int side : {-1, +1}) {
    const LaneIndex neighbor = UsableNeighbor(ego, side);
    if (neighbor == kNone || ego.Advice(side).changes != 0) continue;
    if (HasTurner(ego, neighbor, PositionOn(ego, neighbor), next)) continue;
    return {side, 1, leader.gap, false};
  }
  return {};
}

/// Comes over after a change, or begins one. A vehicle belongs to its new lane from the moment it has
/// accepted the gap: whoever follows there keeps it open while the body comes over.
void DecideChange(const Ego& ego, const NeededChange& needed, const Leader& leader, Tactics* tactics) {
  const LaneChangeParams& p = ego.params.lane_change;
  const double to_lane_end = ego.lane.length - ego.s;
  const double lookahead_per_lane = p.lookahead_time * ego.speed_limit + p.lookahead_distance;
  const double lookahead = needed.count * lookahead_per_lane;
  const bool urgent = needed.side != 0 && needed.remaining < lookahead;
  // Too near to the junction to bring the front across the border before it. On the short pieces between two
  // junctions the next one may still hold who left the lane in the last.
  const bool too_late = to_lane_end < 3.0 + 1.2 * ego.speed &&
                        !(urgent && (needed.remaining <= to_lane_end + 1.0 ||
                                     (needed.remaining < kLastRoom && ego.lane.length > kRoomToChange &&
                                      LeadTogether(ego, needed.side))));
  // Its rear, still in a bend, would swing out to the other side; or it still stands where SUMO inserts the
  // next one as soon as it sees nobody on the lane.
  const bool too_early = ego.position > 0 ? ego.vehicle.length > kLongVehicle && ego.s < ego.vehicle.length &&
                                                needed.remaining > kLastRoom
                                          : ego.s < ego.vehicle.length + ego.vehicle.min_gap;

  if (std::abs(ego.d) > ego.HalfSpan() + kBodyOver && needed.side * ego.d <= 0.0) {
    ComeOver(ego, tactics);
    return;
  }

  if (urgent) {
    const LaneIndex neighbor = UsableNeighbor(ego, needed.side);
    const double urgency = std::clamp(1.0 - needed.remaining / lookahead, 0.0, 1.0);
    tactics->blinker = static_cast<std::int8_t>(needed.side);
    tactics->urgent = needed.asks;
    Neighborhood beside;
    if (neighbor != kNone) beside = LookBeside(ego, neighbor);
    if (needed.asks) PrepareChange(ego, needed, beside, urgency, tactics);
    // Its tail must not stay in the junction behind it.
    if (ego.s > ego.vehicle.length) {
      tactics->speed_cap = std::min(tactics->speed_cap,
                                    FollowSpeed(ego, leader.gap - (kTurnOutRoom + 0.5 - ego.vehicle.min_gap),
                                                leader.speed, ego.params.driving.comfort_decel));
    }
    if (neighbor != kNone && !too_late && !too_early && CanTurnOut(leader) &&
        GapAccepted(ego, beside.ahead, beside.behind, urgency) &&
        !IsContested(ego, neighbor, needed.side, needed.asks)) {
      Join(ego, neighbor, needed.side, tactics);
      return;
    }
    const Leader& holder = beside.ahead.gap < ego.vehicle.min_gap ? beside.ahead : beside.behind;
    if (holder.row != kNone) tactics->held_by = ego.world.traffic->number[holder.row];
    // Before a red light nobody is held up.
    const bool moves = (beside.ahead.row != kNone && beside.ahead.speed > kWalkingSpeed) ||
                       (beside.behind.row != kNone && beside.behind.speed > kWalkingSpeed);
    tactics->refused = moves && ego.speed < kWalkingSpeed && leader.gap > needed.remaining;
    return;
  }

  if (too_late || too_early || ego.now().since_change[ego.row] < kChangePause || ego.speed < 0.5 ||
      !CanTurnOut(leader)) {
    return;
  }
  for (const int side : {+1, -1}) {
    const LaneIndex neighbor = UsableNeighbor(ego, side);
    if (neighbor == kNone) continue;
    const LaneAdvice& there = ego.Advice(side);
    const LaneAdvice& here = ego.Advice(0);
    const double useful = there.free_distance - ego.s;
    // Not to a lane from which a change back would be needed at once.
    if (!there.can_wait) {
      if (there.changes != 0 && useful < std::abs(there.changes) * lookahead_per_lane + 100.0) continue;
      if (there.free_distance < here.free_distance && useful < 300.0) continue;
    }
    const Neighborhood beside = LookBeside(ego, neighbor);
    if (!GapAccepted(ego, beside.ahead, beside.behind, 0.0) || IsContested(ego, neighbor, side, false))
      continue;
    const Lane& lane = ego.world.network->lanes[neighbor];
    const double limit_there = ego.speed_limit * lane.speed_limit / std::max(1.0, ego.lane.speed_limit);
    // Keep right where it costs nothing: the left lanes of a fast road are for overtaking.
    const double bias = ego.lane.speed_limit > 22.0 ? (side < 0 ? -0.25 : 0.1) : 0.0;
    const double queue = p.queue_weight * (QueueTime(ego, ego.now().lane[ego.row], ego.s) -
                                           QueueTime(ego, neighbor, PositionOn(ego, neighbor)));
    if (Advantage(ego, leader, beside.ahead, beside.behind, limit_there) + queue > p.gain_threshold + bias) {
      Join(ego, neighbor, side, tactics);
      return;
    }
  }
}

}  // namespace

Tactics DecideTactics(const World& world, const AgentParams& params, AgentIndex row, const WayAhead& way,
                      const Leader& leader, bool in_circle) {
  const Traffic& traffic = *world.traffic;
  const Lane& lane = world.network->lanes[traffic.now.lane[row]];
  const Ego ego{world,
                params,
                row,
                lane,
                traffic.params[row],
                *traffic.plan[row],
                static_cast<std::size_t>(traffic.route_position[row]),
                traffic.now.s[row],
                traffic.now.d[row],
                traffic.now.speed[row],
                traffic.speed_limit[row]};
  Tactics tactics;
  tactics.yielded_to = traffic.now.yielded_to[row];
  const double span = std::max(0.2, ego.HalfSpan() - 0.1);
  if (!lane.internal && ego.plan.route()[ego.position] == lane.edge) {
    NeededChange needed = FindNeededChange(ego);
    if (leader.row != kNone && traffic.hazard[leader.row] && leader.gap < kHazardLookahead &&
        !PassWithinLane(ego, leader, &tactics.target_d) && leader.gap < needed.remaining) {
      // The lane ends, for us, at the vehicle that stands in it.
      const int preferred = needed.side != 0 ? needed.side : +1;
      for (const int side : {preferred, -preferred}) {
        if (UsableNeighbor(ego, side) == kNone) continue;
        needed = {side, 1, leader.gap - 0.3 * params.lane_change.reserve};
        break;
      }
    }
    if (needed.side == 0) needed = LeaveTurner(ego, leader);
    DecideChange(ego, needed, leader, &tactics);
  } else if (lane.internal) {
    tactics.blinker = traffic.now.blinker[row];
    tactics.urgent = traffic.now.urgent[row] != 0;
  }
  if (tactics.target_d == 0.0) tactics.target_d = KeepToKerb(ego, way);
  if (tactics.lane_change == 0) LetIn(ego, way, leader, &tactics);
  if (!way.leads_on) {
    // Who gets no gap does not stand in the way of those behind for long.
    const bool stuck = (traffic.now.waited[row] > kStuck || in_circle) && leader.gap > way.length;
    tactics.leaves_route =
        params.lane_change.max_detour > 0.0 && tactics.lane_change == 0 && ego.speed < kLastChanceSpeed &&
        (way.length < kLastChance || stuck || traffic.now.refused[row] > params.lane_change.patience);
    tactics.speed_cap =
        std::min(tactics.speed_cap, SafeSpeed(way.length - 2.0, 0.0, params.driving.comfort_decel, 0.5));
  }
  tactics.corridor_min = std::min({-span, tactics.target_d, std::max(ego.d, -1.5 * lane.width)});
  tactics.corridor_max = std::max({span, tactics.target_d, std::min(ego.d, 1.5 * lane.width)});
  return tactics;
}

}  // namespace lanewise
