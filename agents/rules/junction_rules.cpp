#include "agents/rules/junction_rules.h"

#include <omp.h>

#include <algorithm>
#include <cmath>

#include "agents/planning/car_following.h"

namespace lanewise {
namespace {

constexpr double kNever = 1e6;     // [s]
constexpr float kNowhere = 1e9f;   // [m]
constexpr double kStanding = 0.1;  // [m/s]
/// [m] before a stop line within which a vehicle that stands has halted at it.
constexpr double kHaltZone = 3.0;
/// [m] kept to the place where a vehicle has to stop, and by which it may stop short of it or beyond.
constexpr float kOverrun = 0.6f;
constexpr double kStopMargin = 1.0, kWaitMargin = 0.3;
/// [s] of the agents' response when they brake for a stop line, and before they do so at all.
constexpr double kResponse = 0.3, kApproachResponse = 0.5;
/// [s] and [m] beyond braking distance from which a link is looked at; and from which vehicles are listed.
constexpr double kCheckTime = 1.0, kCheckDistance = 8.0, kListTime = 9.0, kListDistance = 50.0;
/// [m] half a car's width, for which conflict areas are drawn.
constexpr double kHalfWidth = 0.9;
/// [m] for which a vehicle that has left a link still counts on it: the map's conflicts reach as far.
constexpr double kBehindLink = 8.0;
/// [m] for how much longer a long body counts: in a turn its rear is beside its path.
constexpr double kLongBodyMore = 3.0;
/// [m/s^2] braking before a bend, and braking one may count on when one's patience is at its end.
constexpr double kBendDecel = 3.0, kImposedDecel = 2.0;
/// [s] after which a vehicle in front of whom one crosses must have left.
constexpr double kBehindGap = 0.3;
/// [m] kept behind who is let go first where ways merge.
constexpr double kMergeGap = 1.0;
/// [s] for which whoever moves behind the junction will make room; [m/s] faster than which it is no queue.
constexpr double kExitForesight = 1.5, kQueueSpeed = 1.0;
/// [s] of standing after which a circle of vehicles that wait for each other is broken: first rights of way,
/// then room behind the junction no longer count.
constexpr float kYieldPatience = 1.5f, kRoomPatience = 20.0f;
/// Longest chain of waiting vehicles that is followed.
constexpr int kLongestChain = 64;
/// Of its acceleration a vehicle with a turn is taken to use, and of slots.margin what has to be left of it.
constexpr double kTurnAccelShare = 0.6, kTurnMargin = 0.4;
/// [m] before a crossing's end where a pedestrian is taken to want to cross.
constexpr double kKerb = 1.5;

bool IsPriority(char state) {
  return state >= 'A' && state <= 'Z';
}
bool IsRed(char state) {
  return state == 'r' || state == 'u';
}
bool IsYellow(char state) {
  return state == 'y' || state == 'Y';
}
/// Must all halt here first?
bool MustHalt(char state) {
  return state == 's' || state == 'w';
}

struct Window {
  double begin, end;  // [m]
};

double ExtraWidth(const Traffic& traffic, AgentIndex row) {
  return std::max(0.0, 0.5 * traffic.params[row].width - kHalfWidth);
}

}  // namespace

double TimeToCover(double distance, double speed, double limit, double accel) {
  if (distance <= 0.0) return 0.0;
  if (speed >= limit) return distance / std::max(speed, 0.1);
  const double run_up = (limit * limit - speed * speed) / (2.0 * accel);
  if (run_up >= distance) return (std::sqrt(speed * speed + 2.0 * accel * distance) - speed) / accel;
  return (limit - speed) / accel + (distance - run_up) / limit;
}

double TimeToCoverBraking(double distance, double speed, double decel) {
  if (distance <= 0.0) return 0.0;
  if (decel <= 1e-6) return speed > 1e-3 ? distance / speed : kNever;
  const double under_root = speed * speed - 2.0 * decel * distance;
  return under_root <= 0.0 ? kNever : (speed - std::sqrt(under_root)) / decel;
}

bool CanStop(double distance, double speed, double decel, double reaction) {
  return speed * reaction + speed * speed / (2.0 * decel) <= distance;
}

JunctionRules::JunctionRules(const RoadNetwork& network, const std::vector<LaneCurve>& curves,
                             const AgentParams& params)
    : network_(network), params_(params), map_(network, curves) {
  link_start_.resize(map_.links().size() + 1);
  link_fill_.resize(map_.links().size() + 1);
  std::vector<double> x, y;
  for (const std::int32_t index : map_.crossings()) {
    const std::vector<Point2>& shape = network.lanes[map_.links()[index].to].shape;
    x.push_back(shape.empty() ? 1e9 : 0.5 * (shape.front().x + shape.back().x));
    y.push_back(shape.empty() ? 1e9 : 0.5 * (shape.front().y + shape.back().y));
  }
  crossing_grid_.Build(x, y);
}

char JunctionRules::StateOf(const Traffic& traffic, const JunctionLink& link) const {
  if (link.signal == kNone || link.signal >= std::ssize(traffic.signal_states)) return link.state;
  const std::string& states = traffic.signal_states[link.signal];
  return link.signal_link < std::ssize(states) ? states[link.signal_link] : link.state;
}

AgentIndex JunctionRules::RowOf(std::int32_t number) const {
  return number < 0 || number >= std::ssize(row_of_number_) ? kNone : row_of_number_[number];
}

Approach* JunctionRules::Append(AgentIndex row, std::int32_t link, double distance) {
  if (count_[row] == kMaxLinks) return nullptr;
  Approach& approach = own_[static_cast<std::size_t>(row) * kMaxLinks + count_[row]++];
  approach = {};
  approach.row = row;
  approach.link = link;
  approach.distance = static_cast<float>(distance);
  return &approach;
}

/// The link from an edge to `lane`, or to a lane beside it: the vehicle may have changed lanes since.
std::int32_t JunctionRules::LinkBehind(LaneIndex lane, EdgeIndex from) const {
  const auto link_to = [&](LaneIndex to) {
    for (const std::int32_t index : network_.lanes[to].incoming) {
      const std::int32_t link = map_.LinkOfConnection(index);
      if (link != kNone && network_.lanes[network_.connections[index].from].edge == from) return link;
    }
    return kNone;
  };
  std::int32_t link = link_to(lane);
  const Edge& edge = network_.edges[network_.lanes[lane].edge];
  for (LaneIndex beside = edge.first_lane; link == kNone && beside < edge.first_lane + edge.lane_count;
       ++beside)
    link = link_to(beside);
  return link;
}

void JunctionRules::ListLinks(const World& world, AgentIndex row) {
  const Traffic& traffic = *world.traffic;
  const Motion& now = traffic.now;
  count_[row] = 0;
  LaneIndex lane = now.lane[row];
  if (lane == kNone) return;
  const VehicleParams& vehicle = traffic.params[row];
  const RoutePlan* plan = traffic.plan[row];
  const double speed = now.speed[row], s = now.s[row];
  const double view = kListTime * speed + kListDistance;
  auto position = static_cast<std::size_t>(traffic.route_position[row]);
  double ahead = -s;  // From the front bumper to the start of `lane`.
  if (network_.lanes[lane].internal) {
    if (map_.LinkOfLane(lane) != kNone) Append(row, map_.LinkOfLane(lane), ahead - map_.OffsetOfLane(lane));
    while (lane != kNone && network_.lanes[lane].internal) {
      ahead += network_.lanes[lane].length;
      const Lane& here = network_.lanes[lane];
      if (here.outgoing.empty()) return;
      const Connection& onward = network_.connections[here.outgoing.front()];
      lane = onward.via != kNone ? onward.via : onward.to;
    }
    ++position;
  } else if (plan != nullptr && s < vehicle.length + kBehindLink && position > 0 &&
             position <= plan->route().size()) {
    const std::int32_t link = LinkBehind(lane, plan->route()[position - 1]);
    if (link != kNone) Append(row, link, ahead - map_.links()[link].length);
  }
  while (plan != nullptr && lane != kNone) {
    ahead += network_.lanes[lane].length;
    if (ahead > view || position + 1 >= plan->route().size() ||
        plan->route()[position] != network_.lanes[lane].edge)
      break;
    const LaneAdvice& advice = plan->At(position, network_.lanes[lane].index);
    if (advice.connection == kNone) break;
    const std::int32_t link = map_.LinkOfConnection(advice.connection);
    if (link != kNone) {
      if (Append(row, link, ahead) == nullptr) break;
      ahead += map_.links()[link].length;
    } else {
      for (LaneIndex via = network_.connections[advice.connection].via;
           via != kNone && network_.lanes[via].internal;) {
        ahead += network_.lanes[via].length;
        via = network_.lanes[via].outgoing.empty()
                  ? kNone
                  : network_.connections[network_.lanes[via].outgoing.front()].via;
      }
    }
    lane = advice.next;
    ++position;
  }

  // Where can it still halt, and will it go?
  const bool agent = traffic.driven[row] != 0;
  const double decel = agent ? std::min(params_.driving.comfort_decel, vehicle.max_decel) : vehicle.max_decel;
  const float braking = static_cast<float>(speed * kResponse + speed * speed / (2.0 * decel));
  const RuleState& told = now.rule[row];
  bool held = false;
  for (int k = 0; k < count_[row]; ++k) {
    Approach& approach = own_[static_cast<std::size_t>(row) * kMaxLinks + k];
    const JunctionLink& link = map_.links()[approach.link];
    const float p = approach.position();
    approach.stops_at = kNowhere;
    if (p < 0.0f && p + braking <= kOverrun) {
      approach.stops_at = 0.0f;
    } else if (link.wait_at > 0.0f && p + braking <= link.wait_at + kOverrun) {
      approach.stops_at = link.wait_at;
    }
    const bool told_to_stop = agent && told.reason != RuleReason::kGo && told.stop_link == approach.link;
    if (told_to_stop && p <= told.stop_at + kOverrun &&
        CanStop(told.stop_at + kOverrun - p, speed, vehicle.max_decel, 0.0)) {
      approach.stops_at = std::min(approach.stops_at, told.stop_at);
    }
    const char state = StateOf(traffic, link);
    const bool stoppable = approach.stops_at < kNowhere;
    if (p < 0.0f && (IsRed(state) || IsYellow(state)) && approach.stops_at == 0.0f) held = true;
    if (told_to_stop && stoppable) held = true;
    if (!agent && p < 0.0f && p > -5.0f && speed < kStanding && !IsPriority(state)) held = true;
    approach.going = !held;
  }
}

bool JunctionRules::IsBehindOneThatWaits(const World& world, AgentIndex row) const {
  const Motion& now = world.traffic->now;
  const LaneIndex lane = now.lane[row];
  if (lane == kNone || network_.lanes[lane].internal) return false;
  const auto on_lane = world.occupancy->On(lane);
  return std::any_of(on_lane.rbegin(), on_lane.rend(), [&](const Occupant& other) {
    if (other.s <= now.s[row] || now.lane[other.row] != lane) return false;
    const auto next =
        std::ranges::find_if(Of(other.row), [](const Approach& a) { return a.distance > 0.0f; });
    return next != Of(other.row).end() && !next->going;
  });
}

void JunctionRules::ListPersons(const World& world) {
  const Traffic& traffic = *world.traffic;
  for (std::size_t i = traffic.vehicle_count; i < traffic.size(); ++i) {
    const auto row = static_cast<AgentIndex>(i);
    count_[row] = 0;
    const double x = traffic.now.x[row], y = traffic.now.y[row];
    crossing_grid_.ForEachNear(x, y, 20.0, [&](AgentIndex k) {
      const std::int32_t index = map_.crossings()[k];
      const JunctionLink& link = map_.links()[index];
      const Lane& lane = network_.lanes[link.to];
      if (lane.shape.size() < 2 || link.length <= 0.0f) return;
      const Point2 a = lane.shape.front(), b = lane.shape.back();
      const double tx = (b.x - a.x) / link.length, ty = (b.y - a.y) / link.length;
      const double u = (x - a.x) * tx + (y - a.y) * ty, v = (y - a.y) * tx - (x - a.x) * ty;
      if (std::abs(v) > 0.5 * lane.width + 0.3 || u < -kKerb || u > link.length + kKerb) return;
      const double course = std::cos(traffic.now.heading[row]) * tx + std::sin(traffic.now.heading[row]) * ty;
      const bool on = u > 0.0 && u < link.length, stands = traffic.now.speed[row] < kStanding;
      // Beside the road, who stands or walks along it does not cross.
      if (!on && (stands || std::abs(course) < 0.5)) return;
      const bool backward = course < 0.0;
      Approach* approach = Append(row, index, backward ? u - link.length : -u);
      if (approach == nullptr) return;
      approach->person = true;
      approach->backward = backward;
      approach->stops_at = on ? kNowhere : 0.0f;
      const char state = StateOf(traffic, link);
      approach->going = on || !(IsRed(state) || IsYellow(state));
    });
  }
}

void JunctionRules::Build(const World& world) {
  const Traffic& traffic = *world.traffic;
  own_.resize(traffic.size() * kMaxLinks);
  count_.resize(traffic.size());
#pragma omp parallel for schedule(static) if (traffic.vehicle_count >= 256)
  for (std::size_t i = 0; i < traffic.vehicle_count; ++i) ListLinks(world, static_cast<AgentIndex>(i));
  ListPersons(world);
#pragma omp parallel for schedule(static) if (traffic.vehicle_count >= 256)
  for (std::size_t i = 0; i < traffic.vehicle_count; ++i) {
    if (count_[i] == 0 || !IsBehindOneThatWaits(world, static_cast<AgentIndex>(i))) continue;
    for (int k = 0; k < count_[i]; ++k) {
      Approach& approach = own_[i * kMaxLinks + k];
      approach.behind = approach.distance > 0.0f;  // Not where its tail still is.
    }
  }

  std::int32_t numbers = 0;
  for (std::size_t i = 0; i < traffic.vehicle_count; ++i) numbers = std::max(numbers, traffic.number[i] + 1);
  row_of_number_.assign(static_cast<std::size_t>(numbers), kNone);
  for (std::size_t i = 0; i < traffic.vehicle_count; ++i)
    row_of_number_[traffic.number[i]] = static_cast<AgentIndex>(i);

  std::fill(link_start_.begin(), link_start_.end(), 0u);
  for (std::size_t i = 0; i < traffic.size(); ++i) {
    for (const Approach& approach : Of(static_cast<AgentIndex>(i))) ++link_start_[approach.link + 1];
  }
  for (std::size_t k = 1; k < link_start_.size(); ++k) link_start_[k] += link_start_[k - 1];
  by_link_.resize(link_start_.back());
  std::copy(link_start_.begin(), link_start_.end(), link_fill_.begin());
  for (std::size_t i = 0; i < traffic.size(); ++i) {
    for (const Approach& approach : Of(static_cast<AgentIndex>(i)))
      by_link_[link_fill_[approach.link]++] = approach;
  }
  for (std::size_t k = 0; k + 1 < link_start_.size(); ++k) {
    if (link_start_[k + 1] - link_start_[k] < 2) continue;
    std::sort(by_link_.begin() + link_start_[k], by_link_.begin() + link_start_[k + 1],
              [&](const Approach& a, const Approach& b) {
                return a.distance != b.distance ? a.distance < b.distance
                                                : traffic.number[a.row] < traffic.number[b.row];
              });
  }
}

double JunctionRules::TimeTo(const World& world, const Approach& approach, double position,
                             double accel_share) const {
  const Traffic& traffic = *world.traffic;
  const JunctionLink& link = map_.links()[approach.link];
  const double speed = traffic.now.speed[approach.row];
  const double way = position - approach.position();
  if (way <= 0.0) return 0.0;
  if (approach.person) return way / std::max(speed, 1.0);
  const double accel = accel_share * traffic.params[approach.row].max_accel;
  const double limit = std::max(traffic.speed_limit[approach.row], 1.0);
  const double through = std::max(1.0, std::min<double>(link.speed, limit));
  const double to_line = std::max(0.0f, approach.distance);
  if (to_line <= 0.0) return TimeToCover(way, speed, through, accel);
  // Up to the stop line it speeds up, and slows down to the speed of the bend.
  const double b = kBendDecel;
  const double peak_squared =
      (2.0 * accel * b * to_line + b * speed * speed + accel * through * through) / (accel + b);
  double time, at_line = through;
  if (speed <= through && peak_squared <= through * through) {
    time = TimeToCover(to_line, speed, through, accel);
    at_line = std::min(through, std::sqrt(speed * speed + 2.0 * accel * to_line));
  } else if (peak_squared <= speed * speed) {
    time = 2.0 * to_line / (speed + through);
  } else {
    const double peak = std::min(std::sqrt(peak_squared), std::max(limit, speed));
    const double run_up = (peak * peak - speed * speed) / (2.0 * accel);
    const double run_out = (peak * peak - through * through) / (2.0 * b);
    time = (peak - speed) / accel + (peak - through) / b + std::max(0.0, to_line - run_up - run_out) / peak;
  }
  const double inside = position - std::max(0.0f, approach.position());
  return time + TimeToCover(inside, at_line, through, accel);
}

/// Nothing without a coordinator, or where none is heard.
std::optional<JunctionRules::OwnTurn> JunctionRules::TurnOf(const World& world, const Approach& own) const {
  if (slots_ == nullptr || own.distance <= 0.0f) return std::nullopt;
  const std::int32_t connection = map_.links()[own.link].connection;
  const StationId vehicle = world.traffic->number[own.row];
  const auto heard = slots_->Heard(*world.channel, vehicle, connection);
  if (!heard) return std::nullopt;
  const std::int32_t turn = heard->TurnOf(vehicle, connection);
  if (turn == kNone) return std::nullopt;
  return OwnTurn{*heard, turn, heard->TimeOf(turn)};
}

/// Has `own`, ahead of a conflict area, to let `other` go first?
bool JunctionRules::GivesWay(const World& world, const Approach& own, const ConflictArea& area,
                             const Approach& other, char state, int forced, const OwnTurn* turn,
                             bool* hard) const {
  const Traffic& traffic = *world.traffic;
  const JunctionLink& link = map_.links()[own.link];
  const JunctionLink& foe = map_.links()[other.link];
  const double length = traffic.params[own.row].length;
  double its_length = traffic.params[other.row].length;
  if (its_length > kSwingingBody && turn == nullptr) its_length += kLongBodyMore;  // Turns have margins.
  const double extra = ExtraWidth(traffic, own.row) + (other.person ? 0.0 : ExtraWidth(traffic, other.row));
  // An area that reaches back over a stop line begins there.
  double foe_begin = std::max(0.0, area.foe_begin - extra), foe_end = area.foe_end + extra;
  if (other.backward) {
    const double mirrored = foe.length - foe_end;
    foe_end = foe.length - foe_begin;
    foe_begin = mirrored;
  }
  const double begin = std::max(0.0, area.begin - extra), end = area.end + extra;
  const double p = own.position(), q = other.position();
  const bool inside = q > foe_begin;
  if (q - its_length >= foe_end || p > begin) return false;

  const bool own_bound = own.stops_at > begin, its_bound = other.stops_at > foe_begin;
  if (own_bound && !its_bound && !inside) return false;

  const float waited = traffic.now.waited[own.row];
  const double impatience = std::clamp(waited / params_.rules.patience, 0.0, 1.0);
  const double gap = params_.rules.gap_time * (1.0 - 0.6 * impatience);
  const double speed = traffic.now.speed[own.row], its_speed = traffic.now.speed[other.row];

  // Does the ego get through before it?
  double clear_at = end + length;
  double margin = gap;
  if (area.merges) {
    // Ahead of it by the ego's length when it comes to the area; and it must not come up from behind too
    // fast.
    clear_at = std::min(clear_at, link.length - foe.length + foe_begin + length + kMergeGap);
    const double closing = its_speed - std::min<double>(link.speed, speed + 3.0);
    if (closing > 0.0) margin += closing * closing / (2.0 * kBendDecel * std::max(1.0, its_speed));
  }
  const std::int32_t its_turn =
      turn == nullptr || other.person ? kNone : turn->heard.TurnOf(traffic.number[other.row], foe.connection);
  const bool goes_before = its_turn != kNone && turn->turn < its_turn;
  const bool goes_after = its_turn != kNone && turn->turn > its_turn;
  // Who comes later by its turn makes room by its speed.
  double its_arrival = TimeTo(world, other, foe_begin, goes_before ? kTurnAccelShare : 1.0);
  const double its_earliest = its_arrival;  // The same for both who compare.
  if (goes_before) margin = std::min(margin, kTurnMargin * slots_->params().margin);
  if (impatience > 0.0 && !other.person && !its_bound) {
    // The longer the ego has waited, the more it counts on the other to brake gently.
    const double braked = TimeToCoverBraking(foe_begin - q, its_speed, impatience * kImposedDecel);
    its_arrival += impatience * std::max(0.0, std::min(2.0 * its_arrival + 1.0, braked) - its_arrival);
  }
  const bool first = !inside && TimeTo(world, own, clear_at, 1.0) + margin < its_arrival;
  if (first) return false;
  // Or after it?
  const double its_way = foe_end + its_length - q;
  double its_leaving = kNever;
  if (its_speed > 2.0) {
    its_leaving = its_way / its_speed;
  } else if (other.going || its_speed > 0.5) {
    its_leaving = TimeTo(world, other, foe_end + its_length, 0.6) + 0.5;
  }
  // Who has a turn comes no earlier.
  const double delay = turn == nullptr ? 0.0 : std::max(0.0, turn->time - TimeTo(world, own, 0.0, 1.0));
  const double arrival = delay + TimeTo(world, own, begin, 1.0);
  if (goes_after && other.distance > 0.0f) {
    const double its_delay =
        std::max(0.0, turn->heard.TimeOf(its_turn) - TimeTo(world, other, 0.0, kTurnAccelShare));
    its_leaving = its_delay + TimeTo(world, other, foe_end + its_length, kTurnAccelShare);
    if (area.merges) {
      // Behind it on the common lane.
      const double its_exit =
          its_delay + TimeTo(world, other, foe.length + its_length + kMergeGap, kTurnAccelShare);
      if (delay + TimeTo(world, own, link.length, 1.0) > its_exit + kBehindGap) return false;
    }
  }
  if (!area.merges && arrival > its_leaving + kBehindGap) return false;

  if (inside) {
    if (forced > 1 && its_speed < kStanding) return false;  // Past its body, if there is room.
    *hard = true;
    return true;
  }
  if (its_bound && !own_bound) return its_speed > kStanding || (other.going && forced == 0);
  const bool comes_first =
      its_earliest != arrival ? its_earliest < arrival : traffic.number[other.row] < traffic.number[own.row];
  if (own_bound) {  // Both are.
    if (forced > 0 && its_speed < kStanding) return false;
    if (!CanStop(begin - p, speed, traffic.params[own.row].max_decel, 0.1)) return false;
    if (!CanStop(foe_begin - q, its_speed, traffic.params[other.row].max_decel, 0.1)) return true;
    if (area.yields != area.foe_yields && !IsPriority(state)) return area.yields;
    if (area.yields != area.foe_yields && area.foe_yields) return false;
    return comes_first;
  }
  // Neither is: the turns decide, and the right of way.
  if (forced > 0) return false;
  if (its_turn != kNone) return goes_after;
  // Whoever is held itself is not waited for, unless in the end it is the ego that holds it: they would both
  // start.
  if (!other.going && !WaitsFor(world, other.row, own.row)) return false;
  if (area.only_long) return comes_first;
  if (state == 'w') {
    const float here = traffic.now.rule[own.row].at_line, there = traffic.now.rule[other.row].at_line;
    if (here != there) return there > here;
    return area.yields;
  }
  if (state == 'Z') return area.merges && its_arrival < arrival;
  return !IsPriority(state) && area.yields;
}

AgentIndex JunctionRules::BlockerBehind(const World& world, AgentIndex ego, const Approach& own,
                                        const WayAhead& way, bool* blocked) const {
  const Traffic& traffic = *world.traffic;
  const JunctionLink& link = map_.links()[own.link];
  const VehicleParams& vehicle = traffic.params[ego];
  double last_conflict = 0.0;
  for (const ConflictArea& area : map_.Areas(link)) {
    if (!area.only_long) last_conflict = std::max<double>(last_conflict, area.end);
  }
  // Would the ego, its front at `front` [m] on the link, stand where others cross?
  const auto stands_in_the_way = [&](double front) {
    if (front <= 0.0 || front - vehicle.length > last_conflict) return false;
    const auto areas = map_.Areas(link);
    return std::any_of(areas.begin(), areas.end(), [&](const ConflictArea& area) {
      return !area.only_long && front > area.begin && front - vehicle.length < area.end;
    });
  };
  double filled = vehicle.min_gap;  // [m] for the ego's gap and those who go there before it.
  for (int k = 0; k < way.count; ++k) {
    if (way.lanes[k].start - own.distance - filled - vehicle.length > last_conflict) return kNone;
    for (const Occupant& occupant : world.occupancy->On(way.lanes[k].lane)) {
      const double front = way.lanes[k].start + occupant.s;
      if (front <= 0.0 || occupant.row == ego || traffic.now.lane[occupant.row] != way.lanes[k].lane)
        continue;
      const double speed = traffic.now.speed[occupant.row];
      const VehicleParams& other = traffic.params[occupant.row];
      if (front > own.distance && speed < kQueueSpeed &&
          stands_in_the_way(front - other.length + kExitForesight * speed - own.distance - filled)) {
        *blocked = true;
        return occupant.row;
      }
      filled += other.length + other.min_gap;
    }
  }
  return kNone;
}

bool JunctionRules::Conflict(const World& world, AgentIndex a, AgentIndex b) const {
  const auto its = Of(b);
  for (const Approach& own : Of(a)) {
    if (TurnOf(world, own)) return true;
    for (const ConflictArea& area : map_.Areas(map_.links()[own.link])) {
      if (!area.only_long && std::any_of(its.begin(), its.end(),
                                         [&](const Approach& other) { return other.link == area.foe; })) {
        return true;
      }
    }
  }
  return false;
}

bool JunctionRules::WaitsFor(const World& world, AgentIndex row, AgentIndex whom) const {
  for (int n = 0; n < kLongestChain && row != kNone; ++n) {
    if (row == whom) return true;
    row = RowOf(world.traffic->now.rule[row].waits_for);
  }
  return false;
}

bool JunctionRules::IsInCircle(const World& world, AgentIndex ego) const {
  return WaitsFor(world, RowOf(world.traffic->now.rule[ego].waits_for), ego);
}

/// If the ego is in a circle of standing vehicles that wait for each other and its turn it is: how far the
/// rules give way to it. 1: rights of way, 2: room behind the junction too.
int JunctionRules::Forced(const World& world, AgentIndex ego) const {
  const Traffic& traffic = *world.traffic;
  const Motion& now = traffic.now;
  if (now.speed[ego] > 1.0 || now.waited[ego] < kYieldPatience) return 0;
  if (now.rule[ego].forced && now.rule[ego].waits_for == kNone) return now.rule[ego].forced;
  AgentIndex best = ego;
  AgentIndex row = ego;
  for (int n = 0; n < kLongestChain; ++n) {
    row = RowOf(now.rule[row].waits_for);
    if (row == kNone) return 0;
    if (row == ego) {
      if (best != ego) return 0;
      return now.waited[ego] > kRoomPatience ? 2 : 1;
    }
    const bool ruled = now.rule[row].reason != RuleReason::kGo;
    if (ruled && (now.waited[row] != now.waited[best] ? now.waited[row] > now.waited[best]
                                                      : traffic.number[row] < traffic.number[best])) {
      best = row;
    }
  }
  return 0;
}

JunctionRules::Verdict JunctionRules::CheckLink(const World& world, AgentIndex ego, const Approach& own,
                                                const WayAhead& way, int forced, const OwnTurn* turn,
                                                RuleAnswer* answer) const {
  const Traffic& traffic = *world.traffic;
  const VehicleParams& vehicle = traffic.params[ego];
  const JunctionLink& link = map_.links()[own.link];
  const double speed = traffic.now.speed[ego], p = own.position();
  const RuleState& told = traffic.now.rule[ego];
  const double comfort = std::min(params_.driving.comfort_decel, vehicle.max_decel);
  const char state = StateOf(traffic, link);
  if (p < 0.0) {
    const bool stopping = told.stop_link == own.link && told.reason == RuleReason::kSignal;
    const bool comfortable = CanStop(-p, speed, comfort, kResponse);
    if ((IsRed(state) && (comfortable || CanStop(-p, speed, vehicle.max_decel, 0.0))) ||
        (IsYellow(state) && (comfortable || (stopping && CanStop(-p, speed, vehicle.max_decel, 0.0))))) {
      return {RuleReason::kSignal, 0.0f, kNone, false};
    }
    if (MustHalt(state) && (told.line_link != own.link || told.at_line <= 0.0f)) {
      return {RuleReason::kHalt, 0.0f, kNone, false};
    }
    if (link.keep_clear && link.area_count > 0 && forced < 2 && own.stops_at == 0.0f) {
      bool blocked = false;
      const AgentIndex by = BlockerBehind(world, ego, own, way, &blocked);
      if (blocked) return {RuleReason::kRoom, 0.0f, by, false};
    }
  }
  Verdict verdict;
  verdict.stop_at = kNowhere;
  for (const ConflictArea& area : map_.Areas(link)) {
    const double extra = ExtraWidth(traffic, ego);
    if (p > area.end + vehicle.length + extra) continue;
    const double begin = std::max(0.0, area.begin - extra);
    const bool may_wait_inside =
        link.wait_at > 0.0f && begin >= link.wait_at && p <= link.wait_at && !area.only_long;
    const bool can_halt_at_line = own.stops_at == 0.0f;
    const float stop_at = may_wait_inside    ? link.wait_at
                          : can_halt_at_line ? 0.0f
                                             : static_cast<float>(begin - kWaitMargin);
    Approach seen = own;
    seen.stops_at = may_wait_inside || can_halt_at_line ? stop_at : kNowhere;
    if (stop_at >= verdict.stop_at) continue;
    for (const Approach& other : On(area.foe)) {
      if (other.row == ego || other.behind) continue;
      if (area.only_long && !SwingsWide(link, vehicle.length) &&
          !SwingsWide(map_.links()[other.link], traffic.params[other.row].length)) {
        continue;
      }
      if (area.merges) {
        // Who is ahead of the ego on the way to the common lane, and will not stop, is followed, as far as
        // the ego does not halt before the area.
        const double ahead = (link.length - p) - (map_.links()[other.link].length - other.position());
        const double its_length = traffic.params[other.row].length;
        if (other.stops_at > area.foe_begin && ahead > 0.0 && other.position() - its_length < area.foe_end) {
          const double behind = SafeSpeed(ahead - its_length - vehicle.min_gap, traffic.now.speed[other.row],
                                          comfort, kApproachResponse);
          const double before = SafeSpeed(area.begin - p - kWaitMargin, 0.0, comfort, kApproachResponse);
          answer->speed_cap = std::min(answer->speed_cap, std::max(behind, before));
          if (ahead > its_length) continue;
        }
      }
      bool hard = false;
      if (GivesWay(world, seen, area, other, state, forced, turn, &hard)) {
        verdict = {hard ? RuleReason::kOccupied : RuleReason::kYield, stop_at, other.row, hard};
        break;
      }
      // Behind one that waits before the junction all wait.
      if (!other.going && other.position() < 0.0f) break;
    }
  }
  return verdict;
}

RuleAnswer JunctionRules::Decide(const World& world, AgentIndex ego, const WayAhead& way,
                                 const Leader& leader, double dt) const {
  const Traffic& traffic = *world.traffic;
  const Motion& now = traffic.now;
  const VehicleParams& vehicle = traffic.params[ego];
  const RuleState& told = now.rule[ego];
  const double speed = now.speed[ego];
  const double comfort = std::min(params_.driving.comfort_decel, vehicle.max_decel);
  const double reach = speed * speed / (2.0 * comfort) + kCheckTime * speed + kCheckDistance;
  RuleAnswer answer;
  bool first = true;
  int forced = -1;
  for (const Approach& own : Of(ego)) {
    const JunctionLink& link = map_.links()[own.link];
    if (own.position() >= link.length) continue;
    if (first && own.distance > 0.0f) {
      answer.state.line_link = own.link;
      const float before = told.line_link == own.link ? told.at_line : 0.0f;
      const bool halted = before > 0.0f || (speed < kStanding && own.distance < kHaltZone);
      answer.state.at_line = halted ? before + static_cast<float>(dt) : 0.0f;
      first = false;
    }
    const std::optional<OwnTurn> turn = TurnOf(world, own);
    if (turn) {
      const double approach =
          slots_->ApproachSpeed(link, own.distance, speed, traffic.speed_limit[ego], turn->time);
      answer.speed_cap =
          std::min(answer.speed_cap, std::max(approach, speed - comfort * params_.driving.response_time));
    }
    if (own.distance > reach) break;
    if (forced < 0) forced = Forced(world, ego);
    const Verdict verdict = CheckLink(world, ego, own, way, forced, turn ? &*turn : nullptr, &answer);
    if (verdict.reason == RuleReason::kGo) continue;
    const double margin = verdict.stop_at == 0.0f ? kStopMargin : kWaitMargin;
    const double gap = verdict.stop_at - own.position();
    answer.speed_cap = std::min(answer.speed_cap, SafeSpeed(gap - margin, 0.0, comfort, kApproachResponse));
    answer.emergency = verdict.hard && speed > 1.0 && !CanStop(gap, speed, vehicle.max_decel, 0.1);
    answer.state.reason = verdict.reason;
    answer.state.stop_link = own.link;
    answer.state.stop_at = verdict.stop_at;
    if (verdict.by != kNone && verdict.by < static_cast<AgentIndex>(traffic.vehicle_count))
      answer.state.waits_for = traffic.number[verdict.by];
    break;
  }
  answer.state.forced = static_cast<std::uint8_t>(std::max(0, forced));
  if (answer.state.reason == RuleReason::kGo && speed < kStanding && leader.row != kNone &&
      leader.speed < kStanding && leader.gap < vehicle.min_gap + 3.0) {
    answer.state.waits_for = traffic.number[leader.row];
  }
  return answer;
}

}  // namespace lanewise
