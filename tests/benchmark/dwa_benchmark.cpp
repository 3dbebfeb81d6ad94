// One agent's plan on a road with `obstacles` cars around it.

#include <benchmark/benchmark.h>

#include <memory>

#include "tests/support/straight_view.h"

namespace lanewise {
namespace {

struct Planning {
  explicit Planning(std::int64_t obstacles) {
    context.vehicle = &vehicle;
    context.speed = 10.0;
    context.free_speed = 13.9;
    context.corridor_min = -0.6;
    context.corridor_max = 3.2;
    scratch->view = PathView(ViewHorizon(10.0));
    for (int k = 0; k < obstacles; ++k)
      AddObstacle(-8.0 + 4.0 * k, k % 2 == 0 ? 3.2 : -3.2, 9.0, 0.9, &scratch->view);
  }
  AgentParams params;
  VehicleParams vehicle;
  PlanContext context;
  std::unique_ptr<PlanScratch> scratch = std::make_unique<PlanScratch>();
};

void BM_RollOutCourses(benchmark::State& state) {
  Planning p(0);
  for (auto _ : state) {
    RollOutCourses(p.params.driving, p.scratch->view, p.context, static_cast<int>(state.range(0)),
                   &p.scratch->courses);
    benchmark::DoNotOptimize(p.scratch->courses);
  }
}
BENCHMARK(BM_RollOutCourses)->ArgName("courses")->Arg(1)->Arg(20)->Arg(64);

void BM_LimitCourseSpeeds(benchmark::State& state) {
  Planning p(state.range(0));
  RollOutCourses(p.params.driving, p.scratch->view, p.context, 20, &p.scratch->courses);
  for (auto _ : state) {
    LimitCourseSpeeds(p.params, p.scratch->view, p.context, &p.scratch->courses);
    benchmark::DoNotOptimize(p.scratch->courses);
  }
}
BENCHMARK(BM_LimitCourseSpeeds)->ArgName("obstacles")->Arg(0)->Arg(4)->Arg(12);

void BM_PlanDwa(benchmark::State& state) {
  Planning p(state.range(0));
  for (auto _ : state) benchmark::DoNotOptimize(PlanDwa(p.params, p.context, p.scratch.get()));
  state.counters["time_per_rollout"] =
      benchmark::Counter(300.0, benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}
BENCHMARK(BM_PlanDwa)->ArgName("obstacles")->Arg(0)->Arg(4)->Arg(12);

void BM_PlanIdm(benchmark::State& state) {
  Planning p(state.range(0));
  for (auto _ : state) benchmark::DoNotOptimize(PlanIdm(p.params, p.context, p.scratch.get()));
}
BENCHMARK(BM_PlanIdm)->ArgName("obstacles")->Arg(4);

}  // namespace
}  // namespace lanewise
