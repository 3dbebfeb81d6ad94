// The rules of the road: listing who approaches which link, and each agent's answer.

#include <benchmark/benchmark.h>

#include "agents/rules/junction_rules.h"
#include "tests/support/crossing_net.h"
#include "tests/support/fleet.h"

namespace lanewise {
namespace {

/// A crossing's four roads full of vehicles, 11 m apart, that have driven for a while: they queue, wait and
/// cross.
struct BusyCrossing {
  static constexpr int kPerRoad = 13;

  explicit BusyCrossing(const AgentParams& params)
      : network(PriorityCrossing()),
        fleet(network, params, Rules::kAgent),
        curves(FitLaneCurves(network, {})),
        occupancy(network) {
    const char* roads[][2] = {{"n", "s_out"}, {"e", "w_out"}, {"s", "n_out"}, {"w", "e_out"}};
    for (const auto& road : roads) {
      for (int k = 0; k < kPerRoad; ++k) fleet.Add({road[0], road[1]}, 0, kArm - 5.0 - 11.0 * k, 5.0);
    }
    for (int k = 0; k < 80; ++k) fleet.Step(0.1);
    const Traffic& traffic = fleet.traffic;
    for (std::size_t i = 0; i < traffic.size(); ++i) {
      const double half = 0.5 * traffic.params[i].length;
      x.push_back(traffic.now.x[i] - half * std::cos(traffic.now.heading[i]));
      y.push_back(traffic.now.y[i] - half * std::sin(traffic.now.heading[i]));
    }
    grid.Build(x, y);
    occupancy.Build(traffic);
    world = {&network, &curves, &traffic, &occupancy, &grid, x, y};
  }

  RoadNetwork network;
  Fleet fleet;
  std::vector<LaneCurve> curves;
  LaneOccupancy occupancy;
  SpatialGrid grid{20.0};
  std::vector<double> x, y;
  World world;
};

void BM_Rules(benchmark::State& state) {
  const AgentParams params;
  BusyCrossing crossing(params);
  JunctionRules rules(crossing.network, crossing.curves, params);
  const std::size_t n = crossing.fleet.traffic.vehicle_count;
  std::vector<WayAhead> ways;
  std::vector<Leader> leaders;
  for (std::size_t i = 0; i < n; ++i) {
    ways.push_back(LookAhead(crossing.world, static_cast<AgentIndex>(i), 60.0));
    leaders.push_back(FindLeader(crossing.world, static_cast<AgentIndex>(i), ways.back()));
  }
  for (auto _ : state) {
    rules.Build(crossing.world);
    for (std::size_t i = 0; i < n; ++i) {
      RuleAnswer answer = rules.Decide(crossing.world, static_cast<AgentIndex>(i), ways[i], leaders[i], 0.1);
      benchmark::DoNotOptimize(answer);
    }
  }
  state.counters["time_per_vehicle"] = benchmark::Counter(
      static_cast<double>(n), benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}
BENCHMARK(BM_Rules);

}  // namespace
}  // namespace lanewise
