// One agent's vehicle model and controller.

#include <benchmark/benchmark.h>

#include "agents/control/pid.h"
#include "agents/vehicle/kinematic_bicycle.h"

namespace lanewise {
namespace {

void BM_BicycleInWorld(benchmark::State& state) {
  Pose2 pose{};
  double speed = 10.0, slip = 0.05;
  for (auto _ : state) {
    benchmark::DoNotOptimize(slip);
    StepBicycle(0.0, slip, 3.9, 0.1, &pose, &speed);
    benchmark::DoNotOptimize(pose);
  }
}
BENCHMARK(BM_BicycleInWorld);

void BM_BicycleOnRoad(benchmark::State& state) {
  RoadPose pose{};
  double speed = 10.0, slip = 0.05;
  for (auto _ : state) {
    benchmark::DoNotOptimize(slip);
    pose = {};
    StepBicycleOnRoad(0.0, slip, 3.9, 0.01, 0.1, &pose, &speed);
    benchmark::DoNotOptimize(pose);
  }
}
BENCHMARK(BM_BicycleOnRoad);

void BM_Pid(benchmark::State& state) {
  const PidGains gains{2.0, 0.05, 0.1, 0.2, 3.0};
  PidState pid;
  double error = 0.5;
  for (auto _ : state) {
    error = -error;
    benchmark::DoNotOptimize(StepPid(gains, error, 0.1, &pid));
  }
}
BENCHMARK(BM_Pid);

}  // namespace
}  // namespace lanewise
