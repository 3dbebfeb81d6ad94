// Simulated lidar, sector code and choice of a way: one vehicle among twelve.

#include <benchmark/benchmark.h>
#include <omp.h>

#include "agents/planning/sector_drive.h"
#include "agents/sector_net/weight_file.h"
#include "agents/sensing/sector_scan.h"
#include "tests/support/fleet.h"
#include "tests/support/small_nets.h"

namespace lanewise {
namespace {

/// The ego in the middle of three lanes at 10 m/s, twelve cars around it within the lidar's sight.
struct TwelveNeighbors {
  TwelveNeighbors()
      : network(ChainNet(1, 3, 500.0)),
        curves(FitLaneCurves(network, {})),
        fleet(network),
        occupancy(network) {
    fleet.Add({"e0"}, 1, 200.0, 10.0);
    for (int k = 0; k < 12; ++k)
      fleet.Add({"e0"}, k % 3, 190.0 + 8.0 * (k / 3) + 2.0 * (k % 3) + (k % 3 == 1 ? 16.0 : 0.0), 10.0);
    fleet.pipeline().UpdatePoses(&fleet.traffic);
    for (std::size_t i = 0; i < fleet.traffic.size(); ++i) {
      x.push_back(fleet.traffic.now.x[i] - 0.5 * fleet.traffic.params[i].length);
      y.push_back(fleet.traffic.now.y[i]);
    }
    grid.Build(x, y);
    occupancy.Build(fleet.traffic);
    world = {&network, &curves, &fleet.traffic, &occupancy, &grid, x, y};
    way = LookAhead(world, 0, 60.0);
    SenseRoad(world, 0, way, 40.0, true, &view);
  }
  RoadNetwork network;
  std::vector<LaneCurve> curves;
  Fleet fleet;
  LaneOccupancy occupancy;
  SpatialGrid grid{20.0};
  std::vector<double> x, y;
  World world;
  WayAhead way;
  RoadView view;
};

/// @param range(0) millimetres of range noise.
void BM_ScanSectors(benchmark::State& state) {
  TwelveNeighbors scene;
  AgentParams params;
  params.lidar.range_noise = 0.001 * static_cast<double>(state.range(0));
  const Lidar lidar(params.lidar);
  LidarScene reflectors;
  std::int64_t step = 0;
  for (auto _ : state) {
    const ScanErrors errors(params.lidar, 1, 0, ++step);
    benchmark::DoNotOptimize(
        ScanSectors(scene.world, 0, scene.way, scene.view, params, lidar, 0.0, errors, &reflectors));
  }
  state.counters["edges"] = static_cast<double>(reflectors.edges().size());
}
BENCHMARK(BM_ScanSectors)->ArgName("noise_mm")->Arg(0)->Arg(10);

/// Sense and decide, as a step does: neighbours and borders to a code, the code to a way. With the lidar's
/// own noise. @param range(0) 0 looks the way up, as a step does; 1 asks BP, 2 broad learning anew.
void BM_SenseAndDecide(benchmark::State& state) {
  TwelveNeighbors scene;
  const AgentParams params;
  const Lidar lidar(params.lidar);
  const AvoidanceTable table = TableOf(DefaultBpNet());
  LidarScene reflectors;
  std::int64_t step = 0;
  for (auto _ : state) {
    const ScanErrors errors(params.lidar, 1, 0, ++step);
    const std::uint8_t code =
        ScanSectors(scene.world, 0, scene.way, scene.view, params, lidar, 0.0, errors, &reflectors);
    Avoidance way = table[code];
    if (state.range(0) == 1) way = WayOf(DefaultBpNet().Forward(InputsOfCode(code)));
    if (state.range(0) == 2) way = WayOf(DefaultBlsNet().Forward(InputsOfCode(code)));
    benchmark::DoNotOptimize(way);
  }
}
BENCHMARK(BM_SenseAndDecide)->ArgName("network")->Arg(0)->Arg(1)->Arg(2);

/// The same by casting all 1,081 beams.
void BM_CastAllBeams(benchmark::State& state) {
  TwelveNeighbors scene;
  const AgentParams params;
  const Lidar lidar(params.lidar);
  LidarScene reflectors;
  const AvoidanceZone zone = ZoneForSpeed(params, 1.8, 10.0);
  CollectReflectors(scene.world, 0, scene.way, scene.view, 30.0, 0.0, &reflectors);
  std::vector<double> ranges(1081);
  for (auto _ : state) {
    lidar.Cast(reflectors, {}, ranges);
    benchmark::DoNotOptimize(lidar.Count(ranges, zone));
  }
}
BENCHMARK(BM_CastAllBeams);

}  // namespace
}  // namespace lanewise
