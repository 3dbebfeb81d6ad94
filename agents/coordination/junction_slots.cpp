#include "agents/coordination/junction_slots.h"

#include <algorithm>
#include <cmath>
#include <tuple>

#include "agents/coordination/green_advice.h"
#include "agents/core/check.h"

namespace lanewise {
namespace {

constexpr double kSlotsBytes = 60.0, kSlotBytes = 12.0;  // [B] on the air.
constexpr double kStandstillGap = 2.5;                   // [m] to whom one follows.
constexpr double kNearest = 0.1;                         // [m] before the line; who is behind it says so.
constexpr double kHalfWidth = 0.9;                       // [m] of a car, for which conflict areas are drawn.
constexpr double kStanding = 0.5;                        // [m/s]
constexpr double kMoving = 1.0;                          // [m/s] with which a lost turn is given anew.
constexpr double kAtOnce = 0.3;                          // [s] later than possible is no waiting.
constexpr double kPatience = 3.0;                        // [s] for taking one's turn.
constexpr double kKept = 1.0;                            // [s] for which one that must have left is kept.
constexpr double kDelayedFrom = 0.05;                    // [s]
constexpr double kWorthAChange = 0.5;                    // [s] of delays, for another place in the order.
constexpr double kFree = -1e9;                           // [s] between two whose ways do not meet.

/// The times by which turns have to be apart, and who may be moved.
struct OrderProblem {
  std::vector<double> earliest;  // [s] by turn,
  std::vector<std::int32_t> lane;
  std::vector<double> distance;
  std::vector<std::uint8_t> fixed;
  std::vector<double> between;  // [s] first by second; kFree: no matter.

  double Between(std::size_t first, std::size_t second) const {
    return between[first * earliest.size() + second];
  }
  /// [s] each, by place in the order.
  void Times(const std::vector<std::size_t>& order, std::vector<double>* times) const {
    times->clear();
    for (std::size_t k = 0; k < order.size(); ++k) {
      double time = earliest[order[k]];
      for (std::size_t i = 0; i < k; ++i) time = std::max(time, (*times)[i] + Between(order[i], order[k]));
      times->push_back(time);
    }
  }
  double SumOf(const std::vector<double>& times, const std::vector<std::size_t>& order) const {
    double sum = 0.0;
    for (std::size_t k = 0; k < order.size(); ++k) sum += times[k] - earliest[order[k]];
    return sum;
  }
};

/// Puts `turn` where the delays are least in sum, in doubt behind the others; behind those ahead of it on its
/// lane, before those behind it, and where nobody is delayed whose place is fixed. @return the sum [s].
double InsertBest(const OrderProblem& problem, std::size_t turn, std::vector<std::size_t>* order) {
  std::size_t from = 0, to = order->size();
  for (std::size_t k = 0; k < order->size(); ++k) {
    const std::size_t other = (*order)[k];
    if (problem.lane[other] != problem.lane[turn]) continue;
    if (problem.distance[other] < problem.distance[turn]) {
      from = k + 1;
    } else {
      to = std::min(to, k);
    }
  }
  from = std::min(from, to);
  std::vector<double> before, times;
  problem.Times(*order, &before);
  std::size_t best = to;
  double least = 1e9;
  for (std::size_t place = to + 1; place-- > from;) {
    order->insert(order->begin() + static_cast<std::ptrdiff_t>(place), turn);
    problem.Times(*order, &times);
    bool delays_fixed = false;
    for (std::size_t k = place; k < before.size(); ++k)
      delays_fixed |= problem.fixed[(*order)[k + 1]] != 0 && times[k + 1] > before[k] + kDelayedFrom;
    const double sum = problem.SumOf(times, *order);
    order->erase(order->begin() + static_cast<std::ptrdiff_t>(place));
    if (delays_fixed && place < to) continue;
    if (sum < least - 1e-6) {
      least = sum;
      best = place;
    }
  }
  order->insert(order->begin() + static_cast<std::ptrdiff_t>(best), turn);
  return least;
}

}  // namespace

std::int32_t HeardSlots::TurnOf(StationId vehicle, std::int32_t connection) const {
  for (std::size_t k = 0; k < slots.size(); ++k) {
    if (slots[k].vehicle == vehicle && slots[k].connection == connection) return static_cast<std::int32_t>(k);
  }
  return kNone;
}

JunctionSlots::JunctionSlots(const RoadNetwork& network, const JunctionMap& map, const SlotParams& params,
                             double memory)
    : network_(network),
      map_(map),
      params_(params),
      memory_(memory),
      unit_of_junction_(network.junctions.size(), kNone) {}

bool JunctionSlots::CanCoordinate(const RoadNetwork& network, const JunctionMap& map, std::int32_t junction) {
  bool conflicts = false;
  for (const JunctionLink& link : map.links()) {
    if (link.crossing || network.connections[link.connection].junction != junction) continue;
    if (link.signal != kNone) return false;
    conflicts |= link.area_count > 0;
  }
  return conflicts;
}

void JunctionSlots::Install(std::span<const std::int32_t> junctions, Channel* channel) {
  for (const std::int32_t junction : junctions) {
    LANEWISE_CHECK(CanCoordinate(network_, map_, junction));
    const Junction& place = network_.junctions[static_cast<std::size_t>(junction)];
    Point2 sum;
    int count = 0;
    for (const LaneIndex lane : place.incoming) {
      if (network_.lanes[lane].shape.empty()) continue;
      sum.x += network_.lanes[lane].shape.back().x;
      sum.y += network_.lanes[lane].shape.back().y;
      ++count;
    }
    unit_of_junction_[static_cast<std::size_t>(junction)] = static_cast<std::int32_t>(units_.size());
    Unit& unit = units_.emplace_back();
    unit.junction = junction;
    unit.station =
        channel->AddRoadsideUnit(sum.x / std::max(1, count), sum.y / std::max(1, count), "slots " + place.id);
  }
}

Arrival JunctionSlots::ArrivalAt(const JunctionLink& link, double distance, double speed, double wanted) {
  return {std::max(distance, kNearest), speed, wanted, std::min<double>(wanted, link.speed), 0.0};
}

/// [s] by which the second has to come later to its stop line; nothing if their ways do not meet.
std::optional<double> JunctionSlots::TimeBetween(const Turn& first, const Turn& second) const {
  const JunctionLink& a = LinkOf(first);
  const JunctionLink& b = LinkOf(second);
  const double line_a = LineSpeed(first.arrival), line_b = LineSpeed(second.arrival);
  const double through_a = std::max(line_a, first.arrival.crossing);
  const double through_b = std::max(line_b, second.arrival.crossing);
  // [s] from the stop line on.
  const auto a_after = [&](double way) { return TimeToReach(way, line_a, through_a, kProfileAccel); };
  const auto b_after = [&](double way) { return TimeToReach(way, line_b, through_b, kProfileAccel); };
  const double behind = first.length + kStandstillGap;
  if (a.from == b.from) return a_after(behind) + params_.headway;
  std::optional<double> least;
  for (const ConflictArea& area : map_.Areas(a)) {
    if (area.foe != second.link) continue;
    if (area.only_long && !SwingsWide(a, first.length) && !SwingsWide(b, second.length)) continue;
    const double extra = first.extra + second.extra;
    double time = a_after(area.end + extra + first.length) - b_after(std::max(0.0, area.foe_begin - extra)) +
                  params_.margin;
    if (area.merges) {
      // A follower on the common lane, which the first one still has to speed up on.
      const double slower = std::max(0.0, through_b - through_a);
      time = a_after(a.length + behind) - b_after(b.length) + params_.headway +
             slower * slower / (2.0 * kProfileAccel * through_b);
    }
    least = std::max(least.value_or(0.0), time);
  }
  return least;
}

/// Takes over what the unit has heard since.
void JunctionSlots::Update(const Channel& channel, double dt, double elapsed, Unit* unit) const {
  struct Known {
    const Message* message;
    double age;
  };
  std::vector<Known> known;
  channel.ForEachKnown(unit->station, [&](const Received& received) {
    if (!IsRoadside(received.message->sender)) known.push_back({received.message, received.age + dt});
  });
  std::sort(known.begin(), known.end(),
            [](const Known& a, const Known& b) { return a.message->sender < b.message->sender; });
  const auto find = [&](StationId vehicle) {
    return std::lower_bound(known.begin(), known.end(), vehicle,
                            [](const Known& k, StationId id) { return k.message->sender < id; });
  };

  std::vector<Turn> kept;
  for (Turn turn : unit->turns) {
    turn.time -= elapsed;
    const auto heard = find(turn.vehicle);
    if (!turn.passed) {
      if (heard == known.end() || heard->message->sender != turn.vehicle) continue;
      const Message& message = *heard->message;
      if (message.next_link == turn.connection) {
        turn.arrival = ArrivalAt(LinkOf(turn), message.link_distance - message.speed * heard->age,
                                 message.speed, message.wanted_speed);
      } else if (turn.arrival.distance < 0.5 * params_.range) {
        turn.passed = true;
        turn.placed = false;
        turn.time = std::min(turn.time, -heard->age);
        turn.arrival.distance = 0.0;
        turn.arrival.speed = message.speed;
      } else {
        continue;  // Another way.
      }
    }
    const double way = LinkOf(turn).length + turn.length + kStandstillGap;
    if (turn.passed &&
        -turn.time > kKept + TimeToReach(way, turn.arrival.speed, turn.arrival.crossing, kProfileAccel))
      continue;
    kept.push_back(turn);
  }
  for (const Known& k : known) {
    const Message& message = *k.message;
    if (message.next_link == kNone) continue;
    const std::int32_t link = map_.LinkOfConnection(message.next_link);
    if (link == kNone || network_.connections[message.next_link].junction != unit->junction) continue;
    const double distance = message.link_distance - message.speed * k.age;
    const bool has_turn = std::any_of(kept.begin(), kept.end(), [&](const Turn& t) {
      return t.vehicle == message.sender && t.connection == message.next_link;
    });
    if (has_turn || distance > params_.range) continue;
    Turn& turn = kept.emplace_back();
    turn.vehicle = message.sender;
    turn.connection = message.next_link;
    turn.link = link;
    turn.length = message.length;
    turn.extra = std::max(0.0, 0.5 * message.width - kHalfWidth);
    turn.arrival = ArrivalAt(LinkOf(turn), distance, message.speed, message.wanted_speed);
    turn.time = -1.0;
  }
  unit->turns = std::move(kept);
}

/// Who stands though it might go, and whoever stands behind it, has no turn until it moves.
void JunctionSlots::WithdrawRefused(double elapsed, std::vector<Turn>* turns) const {
  const auto lane_of = [&](const Turn& turn) { return LinkOf(turn).from; };
  for (Turn& turn : *turns) {
    if (turn.passed) continue;
    if (turn.arrival.speed > kMoving) {
      turn.lost = false;
      turn.refused = 0.0;
    } else if (turn.arrival.speed < kStanding && turn.placed &&
               turn.time + elapsed < EarliestArrival(turn.arrival) + kAtOnce) {
      turn.refused += elapsed;
    }
    if (turn.refused > kPatience) turn.lost = true;
  }
  for (Turn& turn : *turns) {
    if (turn.passed || turn.arrival.speed > kStanding) continue;
    turn.lost |= std::any_of(turns->begin(), turns->end(), [&](const Turn& other) {
      return other.lost && lane_of(other) == lane_of(turn) && other.arrival.distance < turn.arrival.distance;
    });
  }
  for (Turn& turn : *turns) turn.placed &= !turn.lost;
}

void JunctionSlots::PutInOrder(std::vector<Turn>* turns) const {
  const std::size_t n = turns->size();
  OrderProblem problem;
  problem.between.assign(n * n, kFree);
  std::vector<std::size_t> order, fresh;
  for (std::size_t i = 0; i < n; ++i) {
    Turn& turn = (*turns)[i];
    turn.arrival.not_before = 0.0;
    for (std::size_t j = 0; j < n; ++j) {
      if (j == i) continue;
      const Turn& other = (*turns)[j];
      const auto between = TimeBetween(other, turn);
      if (!between) continue;
      problem.between[j * n + i] = *between;
      if (other.passed) turn.arrival.not_before = std::max(turn.arrival.not_before, other.time + *between);
    }
    const double earliest = EarliestArrival(turn.arrival);
    problem.earliest.push_back(std::max(earliest, turn.arrival.not_before));
    problem.lane.push_back(LinkOf(turn).from);
    problem.distance.push_back(turn.arrival.distance);
    if (turn.passed || turn.lost) {
      turn.fixed = false;
    } else if (turn.placed) {
      turn.fixed |= earliest < params_.fixed_time;
      order.push_back(i);
    } else {
      turn.fixed = false;
      fresh.push_back(i);
    }
    problem.fixed.push_back(turn.fixed ? 1 : 0);
  }
  std::sort(fresh.begin(), fresh.end(), [&](std::size_t a, std::size_t b) {
    return std::tuple(problem.distance[a], (*turns)[a].vehicle) <
           std::tuple(problem.distance[b], (*turns)[b].vehicle);
  });
  for (const std::size_t turn : fresh) InsertBest(problem, turn, &order);
  // Whoever is not fixed may find a better place.
  std::vector<double> times;
  problem.Times(order, &times);
  double sum = problem.SumOf(times, order);
  for (const std::size_t turn : std::vector<std::size_t>(order)) {
    if (problem.fixed[turn] != 0) continue;
    std::vector<std::size_t> other = order;
    other.erase(std::find(other.begin(), other.end(), turn));
    const double changed = InsertBest(problem, turn, &other);
    if (changed > sum - kWorthAChange) continue;
    order = std::move(other);
    sum = changed;
  }

  std::vector<Turn> ordered;
  for (const std::size_t i : order) {
    ordered.push_back((*turns)[i]);
    ordered.back().placed = true;
  }
  for (const Turn& turn : *turns) {
    if (turn.passed || turn.lost) ordered.push_back(turn);
  }
  *turns = std::move(ordered);
}

void JunctionSlots::Plan(const Channel& channel, double dt, Unit* unit) const {
  const double elapsed = unit->planned_at < 0 ? 0.0 : dt * (step_ - unit->planned_at);
  Update(channel, dt, elapsed, unit);
  WithdrawRefused(elapsed, &unit->turns);
  PutInOrder(&unit->turns);
  std::vector<Arrival> arrivals;
  std::vector<Separation> separations;
  for (std::size_t j = 0; j < unit->turns.size() && unit->turns[j].placed; ++j) {
    arrivals.push_back(unit->turns[j].arrival);
    for (std::size_t i = 0; i < j; ++i) {
      if (const auto between = TimeBetween(unit->turns[i], unit->turns[j]))
        separations.push_back({static_cast<std::int32_t>(i), static_cast<std::int32_t>(j), *between});
    }
  }
  const std::vector<double> times = PlanArrivals(arrivals, separations);
  for (std::size_t k = 0; k < times.size(); ++k) unit->turns[k].time = times[k];
  unit->planned_at = step_;
}

void JunctionSlots::Broadcast(double dt, Channel* channel) {
  const auto steps = static_cast<std::size_t>(memory_ / dt) + 2;
  messages_.resize(steps * units_.size());
  const auto interval =
      std::max<std::int32_t>(1, static_cast<std::int32_t>(std::lround(params_.interval / dt)));
  for (Unit& unit : units_) {
    if (unit.planned_at < 0 || step_ - unit.planned_at >= interval) Plan(*channel, dt, &unit);
    const double elapsed = dt * (step_ - unit.planned_at);
    std::vector<Slot>& message = messages_[posted_ % messages_.size()];
    message.clear();
    for (const Turn& turn : unit.turns) {
      if (turn.placed)
        message.push_back({turn.vehicle, turn.connection, static_cast<float>(turn.time - elapsed)});
    }
    channel->Post(unit.station, posted_++, kSlotsBytes + kSlotBytes * static_cast<double>(message.size()));
  }
  ++step_;
}

std::optional<HeardSlots> JunctionSlots::Heard(const Channel& channel, StationId vehicle,
                                               std::int32_t connection) const {
  if (units_.empty()) return std::nullopt;
  const std::int32_t unit =
      unit_of_junction_[static_cast<std::size_t>(network_.connections[connection].junction)];
  if (unit == kNone) return std::nullopt;
  const auto received = channel.LastFrom(vehicle, units_[static_cast<std::size_t>(unit)].station);
  if (!received || received->age > params_.max_age) return std::nullopt;
  return HeardSlots{messages_[received->message->payload % messages_.size()], received->age};
}

double JunctionSlots::ApproachSpeed(const JunctionLink& link, double distance, double speed, double wanted,
                                    double time) {
  return CruiseToArrive(ArrivalAt(link, distance, speed, wanted), time);
}

}  // namespace lanewise
