#include "agents/sensing/sector_scan.h"

#include <gtest/gtest.h>

#include <limits>

#include "tests/support/scene.h"
#include "tests/support/small_nets.h"

namespace lanewise {
namespace {

struct Seen {
  std::vector<double> ranges;
  std::uint8_t code;
};

/// The zone reaches 5 m ahead at standstill.
AgentParams Params() {
  AgentParams params;
  params.sector.standstill = 5.0;
  params.sector.side_clearance = 0.4;
  return params;
}

Seen Look(Scene* scene, const AgentParams& params, double leader_speed = 0.0) {
  const World world = scene->Look();
  const WayAhead way = LookAhead(world, 0, 80.0);
  RoadView view;
  SenseRoad(world, 0, way, 40.0, true, &view);
  const Lidar lidar(params.lidar);
  LidarScene reflectors;
  Seen seen;
  seen.code = ScanSectors(world, 0, way, view, params, lidar, leader_speed, {}, &reflectors);
  CollectReflectors(world, 0, way, view, params.lidar.max_range, 0.0, &reflectors);
  seen.ranges.resize(1081);
  lidar.Cast(reflectors, {}, seen.ranges);
  const AvoidanceZone zone = ZoneForSpeed(params, 1.8, world.traffic->now.speed[0], leader_speed);
  EXPECT_EQ(seen.code, SectorCode(lidar.Count(seen.ranges, zone), params.sector.min_points));
  return seen;
}

// Lanes of 3.2 m, the ego in the right one of two: the borders are 1.6 m to its right and 4.8 m to its left.
TEST(SectorScan, BordersAreThoseOfTheRoad) {
  const RoadNetwork network = ChainNet(1, 2, 500.0);
  Scene scene(network);
  scene.Add({"e0"}, 0, 200.0, 0.0);
  const Seen seen = Look(&scene, Params());
  EXPECT_NEAR(seen.ranges[180], 1.6, 0.01);  // -90 deg
  EXPECT_NEAR(seen.ranges[900], 4.8, 0.01);  // +90 deg
  EXPECT_EQ(seen.ranges[540], std::numeric_limits<double>::infinity());
  // The borders block the side sectors, not the strip ahead.
  EXPECT_EQ(seen.code & 0b00011000, 0b00011000);
  EXPECT_EQ(seen.code & 0b11100000, 0);
}

// A car 4 m ahead (its rear) fills the strip; one beside and ahead on the left lane blocks left sectors only.
TEST(SectorScan, VehiclesAheadAndBeside) {
  const RoadNetwork network = ChainNet(1, 2, 500.0);
  Scene scene(network);
  scene.Add({"e0"}, 0, 200.0, 0.0);
  scene.Add({"e0"}, 1, 207.0, 0.0);
  const Seen beside = Look(&scene, Params());
  EXPECT_EQ(beside.code & 0b00011000, 0b00011000);
  EXPECT_EQ(beside.code & 0b00000111, 0);
  scene.Add({"e0"}, 0, 209.0, 0.0);  // 5 m long: rear at 204.
  const Seen ahead = Look(&scene, Params());
  EXPECT_NEAR(ahead.ranges[540], 4.0, 1e-6);
  EXPECT_EQ(ahead.code & 0b00011000, 0);
}

// At 10 m/s a car 15 m ahead is within the 20.75 m of the zone; one that drives as fast needs no braking for.
TEST(SectorScan, ALeaderAtTheSameSpeedDoesNotBlock) {
  const RoadNetwork network = ChainNet(1, 1, 500.0);
  Scene scene(network);
  scene.Add({"e0"}, 0, 200.0, 10.0);
  scene.Add({"e0"}, 0, 220.0, 10.0);
  EXPECT_EQ(Look(&scene, Params()).code & 0b00011000, 0);
  EXPECT_EQ(Look(&scene, Params(), 10.0).code & 0b00011000, 0b00011000);
}

// Persons are rows behind the vehicles; they reflect as boxes of their size.
TEST(SectorScan, PersonsReflect) {
  const RoadNetwork network = ChainNet(1, 1, 500.0);
  Scene scene(network);
  scene.Add({"e0"}, 0, 200.0, 0.0);
  const std::size_t person = scene.Add({"e0"}, 0, 203.0, 0.0);
  Traffic& traffic = scene.traffic();
  traffic.params[person].length = 0.3;
  traffic.params[person].width = 0.5;
  traffic.vehicle_count = 1;
  scene.Look();
  // The pose of a person comes from SUMO.
  traffic.now.heading[person] = 0.0;
  traffic.now.x[person] = traffic.now.x[0] + 3.0;
  traffic.now.y[person] = traffic.now.y[0];
  const Seen seen = Look(&scene, Params());
  EXPECT_NEAR(seen.ranges[540], 2.7, 1e-6);
}

}  // namespace
}  // namespace lanewise
