// The rules of the road: listing who approaches which link, and each agent's answer.

#include <benchmark/benchmark.h>

#include "agents/rules/junction_rules.h"
#include "tests/support/crossing_net.h"
#include "tests/support/fleet.h"
#include "tests/support/fleet_world.h"

namespace lanewise {
namespace {

/// A crossing's four roads full of vehicles, 11 m apart, that have driven for a while: they queue, wait and
/// cross.
void FillCrossing(Fleet* fleet) {
  constexpr int kPerRoad = 13;
  const char* roads[][2] = {{"n", "s_out"}, {"e", "w_out"}, {"s", "n_out"}, {"w", "e_out"}};
  for (const auto& road : roads) {
    for (int k = 0; k < kPerRoad; ++k) fleet->Add({road[0], road[1]}, 0, kArm - 5.0 - 11.0 * k, 5.0);
  }
  for (int k = 0; k < 80; ++k) fleet->Step(0.1);
}

void BM_Rules(benchmark::State& state) {
  const AgentParams params;
  const RoadNetwork network = PriorityCrossing();
  Fleet fleet(network, params, Rules::kAgent);
  FillCrossing(&fleet);
  const FleetWorld seen(network, fleet);
  JunctionRules rules(network, seen.curves, params);
  const std::size_t n = fleet.traffic.vehicle_count;
  std::vector<WayAhead> ways;
  std::vector<Leader> leaders;
  for (std::size_t i = 0; i < n; ++i) {
    ways.push_back(LookAhead(seen.world, static_cast<AgentIndex>(i), 60.0));
    leaders.push_back(FindLeader(seen.world, static_cast<AgentIndex>(i), ways.back()));
  }
  for (auto _ : state) {
    rules.Build(seen.world);
    for (std::size_t i = 0; i < n; ++i) {
      RuleAnswer answer = rules.Decide(seen.world, static_cast<AgentIndex>(i), ways[i], leaders[i], 0.1);
      benchmark::DoNotOptimize(answer);
    }
  }
  state.counters["time_per_vehicle"] = benchmark::Counter(
      static_cast<double>(n), benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}
BENCHMARK(BM_Rules);

}  // namespace
}  // namespace lanewise
