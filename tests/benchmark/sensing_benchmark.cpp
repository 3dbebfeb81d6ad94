// Who is where: the stages that all agents share, and one agent's view.

#include <benchmark/benchmark.h>
#include <omp.h>

#include "agents/sensing/road_view.h"
#include "tests/support/crowd.h"
#include "tests/support/fleet_world.h"

namespace lanewise {
namespace {

void PerAgent(benchmark::State& state, std::int64_t agents) {
  state.counters["time_per_agent"] =
      benchmark::Counter(static_cast<double>(agents),
                         benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}

void BM_GridBuild(benchmark::State& state) {
  omp_set_num_threads(1);
  const Crowd crowd(static_cast<int>(state.range(0)));
  FleetWorld seen(crowd.network, crowd.fleet);
  for (auto _ : state) seen.grid.Build(seen.x, seen.y);
  PerAgent(state, state.range(0));
}
BENCHMARK(BM_GridBuild)->ArgName("agents")->Arg(100)->Arg(1000);

void BM_GridQuery(benchmark::State& state) {
  omp_set_num_threads(1);
  const Crowd crowd(static_cast<int>(state.range(0)));
  FleetWorld seen(crowd.network, crowd.fleet);
  std::int64_t found = 0;
  for (auto _ : state) {
    for (std::size_t i = 0; i < seen.x.size(); ++i) {
      seen.grid.ForEachNear(seen.x[i], seen.y[i], 30.0, [&](AgentIndex) { ++found; });
    }
  }
  benchmark::DoNotOptimize(found);
  PerAgent(state, state.range(0));
}
BENCHMARK(BM_GridQuery)->ArgName("agents")->Arg(100)->Arg(1000);

void BM_LaneOccupancy(benchmark::State& state) {
  omp_set_num_threads(1);
  const Crowd crowd(static_cast<int>(state.range(0)));
  FleetWorld seen(crowd.network, crowd.fleet);
  for (auto _ : state) seen.occupancy.Build(crowd.fleet.traffic);
  PerAgent(state, state.range(0));
}
BENCHMARK(BM_LaneOccupancy)->ArgName("agents")->Arg(100)->Arg(1000);

void BM_LookAheadAndFindLeader(benchmark::State& state) {
  omp_set_num_threads(1);
  const Crowd crowd(100);
  FleetWorld seen(crowd.network, crowd.fleet);
  for (auto _ : state) {
    const WayAhead way = LookAhead(seen.world, 50, 60.0);
    benchmark::DoNotOptimize(FindLeader(seen.world, 50, way));
  }
}
BENCHMARK(BM_LookAheadAndFindLeader);

void BM_SenseRoad(benchmark::State& state) {
  omp_set_num_threads(1);
  const Crowd crowd(100);
  FleetWorld seen(crowd.network, crowd.fleet);
  const WayAhead way = LookAhead(seen.world, 50, 60.0);
  RoadView view;
  for (auto _ : state) {
    SenseRoad(seen.world, 50, way, 40.0, true, &view);
    benchmark::DoNotOptimize(view);
  }
  state.counters["obstacles"] = view.obstacle_count;
}
BENCHMARK(BM_SenseRoad);

}  // namespace
}  // namespace lanewise
