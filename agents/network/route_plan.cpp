#include "agents/network/route_plan.h"

#include <algorithm>
#include <cstdlib>
#include <span>
#include <utility>
#include <vector>

namespace lanewise {
namespace {

/// [m] What lies behind the last edge of a route: more than any network, so arriving never counts as a lane's
/// end.
constexpr double kBehindArrival = 1e6;

/// SUMO's measure of a lane (MSVehicle::LaneQ). Its lengths leave junctions out: otherwise a few decimetres
/// between parallel internal lanes would make one of two equal lanes the only best one, and every vehicle
/// would change to it.
struct Continuation {
  double length{0.0};       ///< [m] of normal lanes that can be driven along the route without a lane change.
  std::int32_t changes{0};  ///< To the best lane; while an edge is in work, that of the lane it leads to.
  std::int32_t priority{
      -1};  ///< Of the link it takes: 1 major or signalised, 0 has to yield, -1 there is none.
};

/// SUMO's order of continuations: the longer is better, then the one nearer to the best lane further on, then
/// the one that need not yield.
bool IsBetter(const Continuation& a, const Continuation& b) {
  if (a.length != b.length) return a.length > b.length;
  if (std::abs(a.changes) != std::abs(b.changes)) return std::abs(a.changes) < std::abs(b.changes);
  return a.priority > b.priority;
}

/// SUMO asks a signalised link for its present color; a plan that outlives the color takes it for open.
std::int32_t LinkPriority(const Connection& connection) {
  return MustYield(connection) ? 0 : 1;
}

/// [m] of internal lanes a connection crosses.
double InternalLength(const RoadNetwork& network, LaneIndex via) {
  double length = 0.0;
  // Two parts is what SUMO builds; the bound keeps a net with a loop from hanging us.
  for (int part = 0; via != kNone && part < 8; ++part) {
    const Lane& lane = network.lanes[via];
    length += lane.length;
    via = lane.outgoing.empty() ? kNone : network.connections[lane.outgoing.front()].via;
  }
  return length;
}

/// The connection SUMO takes from `lane` to `next_edge`; kNone if there is none. On a tie the rightmost lane
/// wins, as SUMO looks at the next lanes from right to left.
std::int32_t BestConnection(const RoadNetwork& network, const Lane& lane, const Edge& next_edge,
                            std::span<const Continuation> next, VehicleClassMask vehicle_class) {
  std::int32_t best = kNone;
  for (const std::int32_t index : lane.outgoing) {
    const Connection& connection = network.connections[index];
    const std::int32_t number = connection.to - next_edge.first_lane;
    if (number < 0 || number >= next_edge.lane_count) continue;
    if (!MayUse(network.lanes[connection.to], vehicle_class)) continue;
    if (connection.via != kNone && !MayUse(network.lanes[connection.via], vehicle_class)) continue;
    if (best != kNone) {
      const std::int32_t other = network.connections[best].to - next_edge.first_lane;
      const bool wins =
          IsBetter(next[number], next[other]) || (!IsBetter(next[other], next[number]) && number < other);
      if (!wins) continue;
    }
    best = index;
  }
  return best;
}

/// Replaces each lane's inherited number of changes by the changes to the nearest of this edge's best lanes,
/// SUMO's best lane offset; of two equally near ones the left one. A lane that has to yield where the best
/// one need not ends here for the edges before, so that vehicles leave it before they merge.
void SetChanges(double edge_length, std::span<Continuation> lanes) {
  const Continuation best = *std::min_element(lanes.begin(), lanes.end(), IsBetter);
  std::vector<std::int32_t> best_lanes;
  for (std::size_t i = 0; i < lanes.size(); ++i) {
    if (!IsBetter(best, lanes[i])) best_lanes.push_back(static_cast<std::int32_t>(i));
  }
  for (std::size_t i = 0; i < lanes.size(); ++i) {
    Continuation& lane = lanes[i];
    lane.changes = best_lanes.front() - static_cast<std::int32_t>(i);
    for (const std::int32_t target : best_lanes) {
      const std::int32_t offset = target - static_cast<std::int32_t>(i);
      if (std::abs(offset) <= std::abs(lane.changes))
        lane.changes = offset;  // From right to left: left wins.
    }
    if (lane.priority < best.priority) lane.length = std::min(lane.length, edge_length);
    lane.priority = 0;  // It matters on this edge only.
  }
}

/// The next edge of the route with all that is already known about its lanes; empty behind the last edge.
struct NextEdge {
  const Edge* edge{nullptr};
  std::span<const Continuation> continuations;
  std::span<const LaneAdvice> advice;
};

/// Advice for one lane but for `changes`, which takes all lanes of its edge.
LaneAdvice Advise(const RoadNetwork& network, const Lane& lane, const NextEdge& next,
                  VehicleClassMask vehicle_class, Continuation* continuation) {
  LaneAdvice advice;
  advice.allowed = MayUse(lane, vehicle_class);
  if (!advice.allowed) return advice;
  const double behind = next.edge == nullptr ? kBehindArrival : 0.0;
  advice.free_distance = continuation->length = lane.length + behind;
  if (next.edge == nullptr) return advice;
  advice.connection = BestConnection(network, lane, *next.edge, next.continuations, vehicle_class);
  if (advice.connection == kNone) return advice;
  const Connection& connection = network.connections[advice.connection];
  advice.next = connection.to;
  const std::int32_t number = connection.to - next.edge->first_lane;
  advice.free_distance += InternalLength(network, connection.via) + next.advice[number].free_distance;
  continuation->length += next.continuations[number].length;
  continuation->changes = next.continuations[number].changes;
  continuation->priority = LinkPriority(connection);
  return advice;
}

/// Can the changes of a lane wait? Behind a link that has to yield the traffic has gaps to change into, and
/// who queues there on all lanes instead of the best one gets by in half the time.
bool CanWait(const RoadNetwork& network, const LaneAdvice& advice, const NextEdge& next) {
  constexpr double kRoomBehind = 20.0;  // [m] behind the link.
  if (advice.connection == kNone || advice.changes == 0) return false;
  const LaneAdvice& there = next.advice[network.lanes[advice.next].index];
  const bool yields = MustYield(network.connections[advice.connection]);
  return there.can_wait || (yields && there.changes != 0 && there.change_distance > kRoomBehind);
}

double ChangeDistance(const RoadNetwork& network, const LaneAdvice& advice, const NextEdge& next,
                      double edge_length) {
  if (advice.connection != kNone) {
    const LaneAdvice& there = next.advice[network.lanes[advice.next].index];
    if (there.changes != 0 && there.change_distance > 0.0)
      return edge_length + InternalLength(network, network.connections[advice.connection].via) +
             there.change_distance;
  }
  return edge_length < kRoomToChange ? 0.0 : edge_length;
}

/// [m] of the shortest way over the junction behind an edge; 0 if no lane leads on.
double CrossingLength(const RoadNetwork& network, std::span<const LaneAdvice> lanes) {
  double shortest = kBehindArrival;
  for (const LaneAdvice& lane : lanes) {
    if (lane.connection == kNone) continue;
    shortest = std::min(shortest, InternalLength(network, network.connections[lane.connection].via));
  }
  return shortest < kBehindArrival ? shortest : 0.0;
}

}  // namespace

RoutePlan::RoutePlan(const RoadNetwork& network, std::vector<EdgeIndex> route, VehicleClassMask vehicle_class)
    : route_(std::move(route)), offset_(route_.size()), remaining_(route_.size()) {
  std::size_t lane_total = 0;
  for (std::size_t k = 0; k < route_.size(); ++k) {
    offset_[k] = lane_total;
    lane_total += static_cast<std::size_t>(network.edges[route_[k]].lane_count);
  }
  advice_.resize(lane_total);
  std::vector<Continuation> continuations(lane_total);
  NextEdge next;
  double remaining = 0.0;
  for (std::size_t k = route_.size(); k-- > 0;) {
    const Edge& edge = network.edges[route_[k]];
    const auto lane_count = static_cast<std::size_t>(edge.lane_count);
    const std::span here = std::span(continuations).subspan(offset_[k], lane_count);
    const std::span advice = std::span(advice_).subspan(offset_[k], lane_count);
    for (std::size_t i = 0; i < lane_count; ++i) {
      const Lane& lane = network.lanes[edge.first_lane + static_cast<LaneIndex>(i)];
      advice[i] = Advise(network, lane, next, vehicle_class, &here[i]);
    }
    SetChanges(network.lanes[edge.first_lane].length, here);
    for (std::size_t i = 0; i < lane_count; ++i) {
      advice[i].changes = here[i].changes;
      advice[i].change_distance =
          ChangeDistance(network, advice[i], next, network.lanes[edge.first_lane].length);
      advice[i].can_wait = CanWait(network, advice[i], next);
    }
    remaining += network.lanes[edge.first_lane].length + CrossingLength(network, advice);
    remaining_[k] = remaining;
    next = {&edge, here, advice};
  }
}

}  // namespace lanewise
