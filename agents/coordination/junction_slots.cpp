#include "agents/coordination/junction_slots.h"

#include <algorithm>
#include <cmath>

#include "agents/coordination/arrival_plan.h"
#include "agents/coordination/green_advice.h"
#include "agents/core/check.h"

namespace lanewise {
namespace {

constexpr double kSlotsBytes = 60.0, kSlotBytes = 12.0;  // [B] on the air.
constexpr double kStandstillGap = 2.0;                   // [m] to whom one follows.
constexpr double kNever = 1e9;                           // [s]
constexpr double kBendDecel = 2.0;                       // [m/s^2] before a bend.
constexpr double kLastPlace = 0.5;                       // [m] before the stop line; nearer is behind it.

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
    units_.push_back({channel->AddRoadsideUnit(sum.x / std::max(1, count), sum.y / std::max(1, count),
                                               "slots " + place.id),
                      {},
                      -1});
  }
}

/// [s] by which the second has to come later to the stop line; nothing if their ways do not meet.
std::optional<double> JunctionSlots::TimeBetween(const Request& first, const Request& second) const {
  const JunctionLink& a = map_.links()[static_cast<std::size_t>(first.link)];
  const JunctionLink& b = map_.links()[static_cast<std::size_t>(second.link)];
  const double va = a.speed, vb = b.speed;
  const auto following = (first.length + kStandstillGap) / std::min(va, vb) + params_.headway;
  if (a.from == b.from) return following;
  std::optional<double> least;
  for (const ConflictArea& area : map_.Areas(a)) {
    if (area.foe != second.link) continue;
    const double time = area.merges ? a.length / va - b.length / vb + following
                                    : (area.end + first.length) / va - area.foe_begin / vb + params_.margin;
    least = std::max(least.value_or(0.0), time);
  }
  return least;
}

/// Who had a turn keeps its place among those who had one: an order that is changed under way costs whoever
/// has slowed down for it. The others are inserted one after the other, the nearest first, where the delays
/// are least in sum; behind those of their lane, and behind whoever is near.
void JunctionSlots::PutInOrder(std::vector<Request>* requests) const {
  std::vector<Request> fresh, order;
  std::sort(requests->begin(), requests->end(), [&](const Request& a, const Request& b) {
    return std::tuple(a.before, a.distance, a.vehicle) < std::tuple(b.before, b.distance, b.vehicle);
  });
  for (const Request& r : *requests) (r.before == kNone ? fresh : order).push_back(r);
  for (const Request& r : fresh) {
    const LaneIndex lane = map_.links()[static_cast<std::size_t>(r.link)].from;
    std::size_t from = 0, to = order.size();
    for (std::size_t k = 0; k < order.size(); ++k) {
      const bool same_lane = map_.links()[static_cast<std::size_t>(order[k].link)].from == lane;
      if (order[k].earliest < params_.fixed_time || (same_lane && order[k].distance < r.distance)) from = k + 1;
      if (same_lane && order[k].distance > r.distance) to = std::min(to, k);
    }
    from = std::min(from, to);
    std::size_t best = to;
    double least = kNever;
    for (std::size_t place = from; place <= to; ++place) {
      order.insert(order.begin() + static_cast<std::ptrdiff_t>(place), r);
      const double delay = SumOfDelays(order);
      order.erase(order.begin() + static_cast<std::ptrdiff_t>(place));
      if (delay < least) {
        least = delay;
        best = place;
      }
    }
    order.insert(order.begin() + static_cast<std::ptrdiff_t>(best), r);
  }
  *requests = std::move(order);
}

double JunctionSlots::SumOfDelays(const std::vector<Request>& order) const {
  std::vector<double> times;
  double sum = 0.0;
  for (const Request& r : order) {
    double time = r.earliest;
    for (std::size_t i = 0; i < times.size(); ++i) {
      if (const auto between = TimeBetween(order[i], r)) time = std::max(time, times[i] + *between);
    }
    times.push_back(time);
    sum += time - r.earliest;
  }
  return sum;
}

void JunctionSlots::Plan(const Channel& channel, Unit* unit) {
  std::vector<Request> requests;
  channel.ForEachKnown(unit->station, [&](const Received& received) {
    const Message& message = *received.message;
    if (message.next_link == kNone) return;
    const std::int32_t link = map_.LinkOfConnection(message.next_link);
    const std::int32_t junction = network_.connections[message.next_link].junction;
    if (link == kNone || unit_of_junction_[static_cast<std::size_t>(junction)] != unit - units_.data()) return;
    const double distance = message.link_distance - message.speed * received.age;
    if (distance < kLastPlace || distance > params_.range) return;
    const double limit = Limit(message.next_link), slower = limit - CrossingSpeed(message.next_link);
    const double earliest = TimeToReach(distance, message.speed, limit, kExpectedAccel) +
                            slower * slower / (2.0 * kBendDecel * limit);
    requests.push_back({message.sender, message.next_link, link, distance, message.speed, message.length, earliest,
                        HeardSlots{unit->slots, 0.0}.TurnOf(message.sender, message.next_link)});
  });
  PutInOrder(&requests);
  std::vector<Arrival> arrivals;
  std::vector<Separation> separations;
  for (std::size_t j = 0; j < requests.size(); ++j) {
    const Request& r = requests[j];
    arrivals.push_back({r.distance, r.speed, Limit(r.connection), CrossingSpeed(r.connection), r.earliest});
    for (std::size_t i = 0; i < j; ++i) {
      if (const auto time = TimeBetween(requests[i], r))
        separations.push_back({static_cast<std::int32_t>(i), static_cast<std::int32_t>(j), *time});
    }
  }
  const std::vector<double> times = PlanArrivals(arrivals, separations);
  unit->slots.clear();
  for (std::size_t k = 0; k < requests.size(); ++k)
    unit->slots.push_back({requests[k].vehicle, requests[k].connection, static_cast<float>(times[k])});
  unit->planned_at = step_;
}

void JunctionSlots::Broadcast(double dt, Channel* channel) {
  const auto steps = static_cast<std::size_t>(memory_ / dt) + 2;
  messages_.resize(steps * units_.size());
  const auto interval = std::max<std::int32_t>(1, static_cast<std::int32_t>(std::lround(params_.interval / dt)));
  for (Unit& unit : units_) {
    if (unit.planned_at < 0 || step_ - unit.planned_at >= interval) Plan(*channel, &unit);
    std::vector<Slot>& message = messages_[posted_ % messages_.size()];
    message = unit.slots;
    for (Slot& slot : message) slot.time -= static_cast<float>(dt * (step_ - unit.planned_at));
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

std::optional<double> JunctionSlots::ApproachSpeed(const Channel& channel, StationId vehicle,
                                                   std::int32_t connection, double distance) const {
  const auto heard = Heard(channel, vehicle, connection);
  if (!heard) return std::nullopt;
  const std::int32_t turn = heard->TurnOf(vehicle, connection);
  if (turn == kNone) return std::nullopt;
  return SpeedToPass(distance, heard->slots[static_cast<std::size_t>(turn)].time - heard->age,
                     Limit(connection), CrossingSpeed(connection));
}

double JunctionSlots::Limit(std::int32_t connection) const {
  return network_.lanes[network_.connections[connection].from].speed_limit;
}

double JunctionSlots::CrossingSpeed(std::int32_t connection) const {
  return std::min<double>(
      Limit(connection), map_.links()[static_cast<std::size_t>(map_.LinkOfConnection(connection))].speed);
}

}  // namespace lanewise
