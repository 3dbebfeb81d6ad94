// The whole step of all agents, without SUMO.

#include <benchmark/benchmark.h>
#include <omp.h>

#include "tests/support/crowd.h"

namespace lanewise {
namespace {

// Always the same step, so that every iteration is the same work.
void BM_AgentStep(benchmark::State& state) {
  omp_set_num_threads(static_cast<int>(state.range(1)));
  Crowd crowd(static_cast<int>(state.range(0)));
  const std::vector<std::uint8_t> guarded(crowd.fleet.traffic.size(), 0);
  for (auto _ : state) {
    crowd.fleet.pipeline().Step(0.1, guarded, &crowd.fleet.traffic, &crowd.fleet.commands);
  }
  benchmark::DoNotOptimize(crowd.fleet.traffic.next.s.data());
  state.counters["time_per_agent"] =
      benchmark::Counter(static_cast<double>(state.range(0)),
                         benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}
BENCHMARK(BM_AgentStep)->ArgNames({"agents", "threads"})->ArgsProduct({{100, 1000}, {1, 2}})->UseRealTime();

}  // namespace
}  // namespace lanewise
