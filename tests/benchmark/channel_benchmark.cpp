// One step of the radio channel: every vehicle sends in every step (10 Hz) and is heard within 300 m.

#include <benchmark/benchmark.h>
#include <omp.h>

#include <cmath>
#include <random>

#include "agents/v2x/channel.h"
#include "tests/support/small_nets.h"

namespace lanewise {
namespace {

/// Vehicles on the streets of a grid town, 200 m apart, evenly drawn: `density` [1/km^2] of them.
struct Town {
  Town(std::size_t vehicles, double density) : network(ChainNet(1, 1, 1000.0)) {
    traffic.vehicle_count = vehicles;
    traffic.Resize(vehicles);
    const double extent = 1000.0 * std::sqrt(static_cast<double>(vehicles) / density);
    std::mt19937_64 random(1);
    std::uniform_real_distribution<double> place(0.0, extent);
    for (std::size_t i = 0; i < vehicles; ++i) {
      traffic.number[i] = static_cast<std::int32_t>(i);
      traffic.id_hash[i] = MixBits(i);
      traffic.now.lane[i] = 0;
      traffic.plan[i] = nullptr;
      const double along = place(random), street = 200.0 * std::round(place(random) / 200.0);
      traffic.now.x[i] = i % 2 == 0 ? along : street;
      traffic.now.y[i] = i % 2 == 0 ? street : along;
      traffic.now.speed[i] = 10.0;
      traffic.now.follows[i] = kNone;
    }
  }

  /// To and fro along the streets.
  void Move(int step) {
    const double way = step / 50 % 2 == 0 ? 1.0 : -1.0;
    for (std::size_t i = 0; i < traffic.vehicle_count; ++i)
      (i % 2 == 0 ? traffic.now.x : traffic.now.y)[i] += way;
  }

  RoadNetwork network;
  Traffic traffic;
};

void BM_Channel(benchmark::State& state) {
  omp_set_num_threads(1);
  const auto vehicles = static_cast<std::size_t>(state.range(0));
  Town town(vehicles, static_cast<double>(state.range(2)));
  V2xParams params;
  params.cam_max_interval = params.cam_min_interval;  // Everybody in every step.
  Channel channel(town.network, params);
  channel.Open(static_cast<V2xLevel>(state.range(1)), 1);
  int step = 0;
  for (; step < 40; ++step) {
    channel.Exchange(0.1, town.traffic);
    town.Move(step);
  }
  std::int64_t before = 0;
  for (const std::int64_t count : channel.counts().fates) before += count;
  const int first = step;
  for (auto _ : state) {
    channel.Exchange(0.1, town.traffic);
    town.Move(step++);
  }
  std::int64_t heard = -before;
  for (const std::int64_t count : channel.counts().fates) heard += count;
  const auto vehicle_steps = static_cast<double>(vehicles) * (step - first);
  state.counters["in_range"] = static_cast<double>(heard) / vehicle_steps;
  state.counters["time_per_vehicle"] =
      benchmark::Counter(static_cast<double>(vehicles),
                         benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}
// Levels range, lossy, loaded; 150 vehicles a km^2 is what Bologna's inner town holds at its peak.
BENCHMARK(BM_Channel)
    ->ArgNames({"vehicles", "level", "per_km2"})
    ->ArgsProduct({{10000}, {2, 3, 4}, {150, 400}})
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace lanewise
