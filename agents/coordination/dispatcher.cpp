#include "agents/coordination/dispatcher.h"

#include <algorithm>
#include <limits>
#include <queue>

#include "agents/core/random.h"

namespace lanewise {
namespace {

constexpr double kLookPeriod = 1.0;  // [s]
/// [m/s] at which a crowded edge is taken to be driven at least.
constexpr double kLeastSpeed = 0.5;
/// Share of crowded edges above which nobody should depart anywhere.
constexpr double kCrowdedNetwork = 0.2;
/// Weight of the last interval in the speed of an edge.
constexpr double kNews = 0.5;

}  // namespace

EdgeGraph::EdgeGraph(const RoadNetwork& network) : links_(network.edges.size()) {
  for (const Connection& connection : network.connections) {
    const Lane& from = network.lanes[connection.from];
    const Lane& to = network.lanes[connection.to];
    if (network.edges[from.edge].function != EdgeFunction::kNormal ||
        network.edges[to.edge].function != EdgeFunction::kNormal)
      continue;
    links_[static_cast<std::size_t>(from.edge)].push_back({to.edge, from.allowed & to.allowed});
  }
}

std::vector<EdgeIndex> EdgeGraph::FastestRoute(EdgeIndex from, EdgeIndex to, VehicleClassMask vehicle_class,
                                               std::span<const double> seconds) const {
  constexpr double kUnreached = std::numeric_limits<double>::infinity();
  std::vector<double> time(links_.size(), kUnreached);
  std::vector<EdgeIndex> before(links_.size(), kNone);
  using Entry = std::pair<double, EdgeIndex>;
  std::priority_queue<Entry, std::vector<Entry>, std::greater<>> open;
  time[static_cast<std::size_t>(from)] = 0.0;
  open.push({0.0, from});
  while (!open.empty()) {
    const auto [reached, edge] = open.top();
    open.pop();
    if (edge == to) break;
    if (reached > time[static_cast<std::size_t>(edge)]) continue;
    for (const Link& link : links_[static_cast<std::size_t>(edge)]) {
      if ((link.allowed & vehicle_class) == 0) continue;
      const auto next = static_cast<std::size_t>(link.to);
      const double there = reached + seconds[next];
      if (there >= time[next]) continue;
      time[next] = there;
      before[next] = edge;
      open.push({there, link.to});
    }
  }
  if (time[static_cast<std::size_t>(to)] == kUnreached) return {};
  std::vector<EdgeIndex> route{to};
  while (route.back() != from) route.push_back(before[static_cast<std::size_t>(route.back())]);
  std::reverse(route.begin(), route.end());
  return route;
}

CongestionWatch::CongestionWatch(const RoadNetwork& network, const DispatchParams& params)
    : network_(network),
      params_(params),
      seen_(network.edges.size()),
      crowded_(network.edges.size()),
      seconds_(network.edges.size()) {
  for (std::size_t e = 0; e < seconds_.size(); ++e) {
    const Edge& edge = network.edges[e];
    if (edge.first_lane == kNone) continue;
    const Lane& lane = network.lanes[edge.first_lane];
    seconds_[e] = lane.length / std::max(kLeastSpeed, lane.speed_limit);
  }
}

void CongestionWatch::See(EdgeIndex edge, double speed) {
  Seen& seen = seen_[static_cast<std::size_t>(edge)];
  seen.speed_sum += speed;
  ++seen.count;
}

void CongestionWatch::Judge() {
  if (looks_ == 0) return;
  int used = 0, crowded = 0;
  for (std::size_t e = 0; e < seen_.size(); ++e) {
    Seen& seen = seen_[e];
    const Edge& edge = network_.edges[e];
    if (edge.function != EdgeFunction::kNormal || edge.first_lane == kNone) continue;
    const Lane& lane = network_.lanes[edge.first_lane];
    const double free = lane.length / std::max(kLeastSpeed, lane.speed_limit);
    const double speed = seen.count > 0
                             ? std::max(kLeastSpeed, seen.speed_sum / static_cast<double>(seen.count))
                             : lane.speed_limit;
    const double density =
        static_cast<double>(seen.count) / static_cast<double>(looks_) / (lane.length * edge.lane_count);
    seconds_[e] += kNews * (std::max(free, lane.length / speed) - seconds_[e]);
    // Its time tells of the intervals before, too: one red light makes no crowd.
    const double pace = free / std::max(seconds_[e], 1e-6);
    if (crowded_[e] != 0) {
      crowded_[e] = pace < params_.relieved_speed;
    } else {
      crowded_[e] = pace < params_.crowded_speed && density > params_.crowded_density;
    }
    used += seen.count > 0;
    crowded += crowded_[e];
    seen = {};
  }
  looks_ = 0;
  crowded_share_ = used > 0 ? static_cast<double>(crowded) / used : 0.0;
}

Dispatcher::Dispatcher(const RoadNetwork& network, const CoordinationParams& params, std::uint64_t seed)
    : network_(network),
      params_(params.dispatch),
      seed_(seed),
      graph_(network),
      watch_(network, params.dispatch),
      next_judgement_(params.dispatch.interval) {}

void Dispatcher::Look(const Roadside& roadside, const Channel& channel) {
  heard_.clear();
  for (const StationId unit : roadside.units()) {
    if (unit == kNone) continue;
    channel.ForEachKnown(unit, [&](const Received& received) {
      const Message& message = *received.message;
      if (message.lane == kNone) return;
      const Message*& last = heard_[message.sender];
      if (last == nullptr || last->step < message.step) last = &message;
    });
  }
  // Sorted: sums must not depend on the order in which a table keeps its entries.
  std::vector<const Message*> messages;
  for (const auto& [sender, message] : heard_) messages.push_back(message);
  std::sort(messages.begin(), messages.end(),
            [](const Message* a, const Message* b) { return a->sender < b->sender; });
  for (const Message* message : messages) watch_.See(network_.lanes[message->lane].edge, message->speed);
  watch_.EndLook();
}

bool Dispatcher::IsReached(const Roadside& roadside, const Channel& channel, std::int32_t number) const {
  return std::any_of(roadside.units().begin(), roadside.units().end(), [&](StationId unit) {
    return unit != kNone && channel.LastFrom(number, unit).has_value();
  });
}

bool Dispatcher::FollowsAdvice(const Traffic& traffic, std::size_t row) const {
  return RandomStream(seed_, traffic.id_hash[row], RandomPurpose::kDispatchShare, 0).Uniform(0) <
         params_.share;
}

void Dispatcher::AdviseRoutes(double time, const Traffic& traffic, const Roadside& roadside,
                              const Channel& channel) {
  constexpr double kNoStop = 1e8;  // [m]
  for (std::size_t row = 0; row < traffic.vehicle_count; ++row) {
    if (!traffic.driven[row] || traffic.stop_distance[row] < kNoStop || !FollowsAdvice(traffic, row))
      continue;
    const auto route = traffic.plan[row]->route();
    const auto here = static_cast<std::size_t>(traffic.route_position[row]);
    // The next edge stays: the lane for it has been chosen.
    if (here + 2 >= route.size() || network_.lanes[traffic.now.lane[row]].edge != route[here]) continue;
    const auto ahead = route.subspan(here + 1);
    if (std::none_of(ahead.begin() + 1, ahead.end(), [&](EdgeIndex e) { return watch_.IsCrowded(e); }))
      continue;
    const std::int32_t number = traffic.number[row];
    const auto last = advised_.find(number);
    if (last != advised_.end() && time < last->second + params_.pause) continue;
    if (!IsReached(roadside, channel, number)) continue;
    std::vector<EdgeIndex> faster =
        graph_.FastestRoute(ahead.front(), ahead.back(), traffic.vehicle_class[row], watch_.seconds());
    const auto time_of = [&](std::span<const EdgeIndex> edges) {
      double sum = 0.0;
      for (const EdgeIndex edge : edges) sum += watch_.seconds()[static_cast<std::size_t>(edge)];
      return sum;
    };
    const double present = time_of(ahead), gain = present - time_of(faster);
    if (faster.empty() || gain < params_.min_gain * present || gain <= 0.0) continue;
    advised_[number] = time;
    faster.insert(faster.begin(), route[here]);
    reroutes_.push_back({row, std::move(faster), gain});
  }
}

void Dispatcher::Step(double time, const Traffic& traffic, std::span<const std::uint8_t> may_hold,
                      const Roadside& roadside, const Channel& channel) {
  reroutes_.clear();
  holds_.clear();
  releases_.clear();
  if (time >= next_look_) {
    next_look_ = time + kLookPeriod;
    Look(roadside, channel);
  }
  const bool crowded_network = watch_.crowded_share() > kCrowdedNetwork;
  for (std::size_t row = 0; row < traffic.vehicle_count; ++row) {
    if (!may_hold[row] || !FollowsAdvice(traffic, row)) continue;
    if (!crowded_network && !watch_.IsCrowded(network_.lanes[traffic.now.lane[row]].edge)) continue;
    if (!IsReached(roadside, channel, traffic.number[row])) continue;
    holds_.push_back(row);
    held_.emplace_back(traffic.number[row], time);
  }
  if (time < next_judgement_) return;
  next_judgement_ = time + params_.interval;
  watch_.Judge();
  AdviseRoutes(time, traffic, roadside, channel);
  if (watch_.crowded_share() > kCrowdedNetwork) return;
  // The first to be held are the first to go; half of them at a time, so that they do not make the next
  // crowd.
  const std::size_t count = (held_.size() + 1) / 2;
  for (std::size_t k = 0; k < count; ++k) releases_.push_back(held_[k].first);
  held_.erase(held_.begin(), held_.begin() + static_cast<std::ptrdiff_t>(count));
}

}  // namespace lanewise
