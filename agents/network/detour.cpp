#include "agents/network/detour.h"

#include <algorithm>
#include <functional>
#include <queue>
#include <utility>

#include "agents/network/route_plan.h"

namespace lanewise {
namespace {

/// What a stretch of road takes. Junctions are left out.
struct Cost {
  double time{0.0};    // [s] at the speed limits.
  double length{0.0};  // [m]
};

Cost operator+(const Cost& a, const Cost& b) {
  return {a.time + b.time, a.length + b.length};
}

Cost CostOf(const RoadNetwork& network, EdgeIndex edge) {
  const Lane& lane = network.lanes[network.edges[edge].first_lane];
  return {lane.length / std::max(0.1, lane.speed_limit), lane.length};
}

/// Calls visit(edge) for each edge that `lane` leads to.
template <typename Visit>
void ForEachNext(const RoadNetwork& network, LaneIndex lane, VehicleClassMask vehicle_class, Visit visit) {
  if (!MayUse(network.lanes[lane], vehicle_class)) return;
  for (const std::int32_t index : network.lanes[lane].outgoing) {
    const Connection& connection = network.connections[index];
    if (!MayUse(network.lanes[connection.to], vehicle_class)) continue;
    if (connection.via != kNone && !MayUse(network.lanes[connection.via], vehicle_class)) continue;
    visit(network.lanes[connection.to].edge);
  }
}

/// An edge the search has reached.
struct Reached {
  Cost cost;              // To its start, from the end of the edge that is left.
  EdgeIndex from{kNone};  // Kept back: the edge before it; kNone: the edge that is left.
  bool seen{false}, settled{false};
};

}  // namespace

std::optional<Detour> FindDetour(const RoadNetwork& network, std::span<const EdgeIndex> route,
                                 std::size_t position, std::size_t back_by, LaneIndex lane,
                                 VehicleClassMask vehicle_class, double max_extra_time) {
  // What is left of the route from the start of each of its edges on.
  std::vector<Cost> to_go(route.size() + 1);
  for (std::size_t k = route.size(); k-- > position + 1;) to_go[k] = CostOf(network, route[k]) + to_go[k + 1];

  // Dijkstra 1959; of equally quick edges the one first in the file.
  std::vector<Reached> reached(network.edges.size());
  using Entry = std::pair<double, EdgeIndex>;
  std::priority_queue<Entry, std::vector<Entry>, std::greater<>> open;
  const auto reach = [&](EdgeIndex edge, const Cost& cost, EdgeIndex from) {
    Reached& r = reached[edge];
    if (r.seen && r.cost.time <= cost.time) return;
    r = {cost, from, true, false};
    open.emplace(cost.time, edge);
  };
  ForEachNext(network, lane, vehicle_class, [&](EdgeIndex edge) { reach(edge, {}, kNone); });
  const double longest = to_go[position + 1].time + max_extra_time;
  double best = longest;
  std::size_t rejoins = route.size();
  while (!open.empty() && open.top().first <= best) {
    const auto [time, edge] = open.top();
    open.pop();
    if (std::exchange(reached[edge].settled, true)) continue;
    for (std::size_t k = position + 1; k <= back_by; ++k) {
      if (route[k] == edge && time + to_go[k].time <= best) {
        best = time + to_go[k].time;
        rejoins = k;
      }
    }
    const Cost behind = reached[edge].cost + CostOf(network, edge);
    const Edge& e = network.edges[edge];
    for (LaneIndex out = e.first_lane; out < e.first_lane + e.lane_count; ++out) {
      ForEachNext(network, out, vehicle_class, [&](EdgeIndex next) { reach(next, behind, edge); });
    }
  }
  if (rejoins == route.size()) return std::nullopt;
  Detour detour;
  detour.extra_time = best - to_go[position + 1].time;
  detour.extra_length =
      reached[route[rejoins]].cost.length + to_go[rejoins].length - to_go[position + 1].length;
  for (EdgeIndex edge = reached[route[rejoins]].from; edge != kNone; edge = reached[edge].from)
    detour.route.push_back(edge);
  detour.route.push_back(route[position]);
  std::reverse(detour.route.begin(), detour.route.end());
  detour.route.insert(detour.route.end(), route.begin() + static_cast<std::ptrdiff_t>(rejoins), route.end());
  return detour;
}

}  // namespace lanewise
