#include "analysis/edge_recorder.h"

#include <gtest/gtest.h>

#include "tests/support/small_nets.h"

namespace lanewise {
namespace {

constexpr double kStep = 0.5;  // [s] exact in binary.

/// Vehicles on lanes at positions, all at their speed.
struct Placed {
  std::int32_t number;
  std::string lane;
  double lane_pos, speed;
};

TrafficFrame FrameOf(const RoadNetwork& network, double time, const std::vector<Placed>& vehicles) {
  TrafficFrame frame;
  frame.Resize(vehicles.size());
  frame.time = time;
  for (std::size_t i = 0; i < vehicles.size(); ++i) {
    frame.vehicle_number[i] = vehicles[i].number;
    frame.lane[i] = network.FindLane(vehicles[i].lane);
    frame.lane_pos[i] = vehicles[i].lane_pos;
    frame.speed[i] = vehicles[i].speed;
    frame.allowed_speed[i] = 20.0;
    frame.co2_rate[i] = 100.0;
  }
  return frame;
}

TEST(EdgeRecorder, MeasuresFlowDensityAndSpeedByEdie) {
  // Two vehicles on e0 (100 m) for 2 s: 10 m/s and standing. 20 m and 4 s in 200 m s: flow 0.1 veh/s, density
  // 0.02 veh/m, speed 5 m/s; variance (25 + 25) / 2.
  const RoadNetwork network = ChainNet(2, 1, 100.0);
  EdgeRecorder edges(network, 0.0, kStep, 2.0);
  edges.Observe(FrameOf(network, 0.0, {{0, "e0_0", 10.0, 10.0}, {1, "e0_0", 60.0, 0.0}}));
  for (int k = 1; k <= 4; ++k) {
    edges.Observe(FrameOf(network, kStep * k, {{0, "e0_0", 10.0 + 5.0 * k, 10.0}, {1, "e0_0", 60.0, 0.0}}));
  }
  const std::vector<EdgeIntervalRow> rows = edges.TakeFinished();
  ASSERT_EQ(rows.size(), 1u);
  EXPECT_EQ(rows[0].edge, network.FindEdge("e0"));
  EXPECT_EQ(rows[0].begin, 0.0);
  EXPECT_EQ(rows[0].end, 2.0);
  EXPECT_NEAR(rows[0].vehicle_time, 4.0, 1e-12);
  EXPECT_NEAR(rows[0].vehicle_distance, 20.0, 1e-12);
  EXPECT_NEAR(rows[0].flow, 0.1, 1e-12);
  EXPECT_NEAR(rows[0].density, 0.02, 1e-12);
  EXPECT_NEAR(rows[0].speed, 5.0, 1e-12);
  EXPECT_NEAR(rows[0].speed_variance, 25.0, 1e-12);
  EXPECT_NEAR(rows[0].waiting_time, 2.0, 1e-12);
  EXPECT_NEAR(rows[0].time_loss, 2.0 * 0.5 + 2.0, 1e-12);
  EXPECT_NEAR(rows[0].co2, 400.0, 1e-12);
  EXPECT_EQ(rows[0].entered, 2);
}

TEST(EdgeRecorder, SplitsAStepOverAnEdgesEnd) {
  // 5 m in the step, 2 m of them on the junction's edge: 0.4 of its time.
  const RoadNetwork network = ChainNet(2, 1, 100.0);
  EdgeRecorder edges(network, 0.0, kStep, 1000.0);
  edges.Observe(FrameOf(network, 0.0, {{0, "e0_0", 97.0, 10.0}}));
  edges.Observe(FrameOf(network, kStep, {{0, ":J1_0_0", 2.0, 10.0}}));
  EXPECT_TRUE(edges.TakeFinished().empty());
  edges.Finish(kStep);
  const std::vector<EdgeIntervalRow> rows = edges.TakeFinished();
  ASSERT_EQ(rows.size(), 2u);
  for (const EdgeIntervalRow& row : rows) {
    const bool inside = row.edge == network.FindEdge(":J1_0");
    EXPECT_NEAR(row.vehicle_time, inside ? 0.2 : 0.3, 1e-12);
    EXPECT_NEAR(row.vehicle_distance, inside ? 2.0 : 3.0, 1e-12);
    EXPECT_EQ(row.end, kStep);
  }
}

TEST(EdgeRecorder, LeavesOutWhoIsOffTheRoadAndRecordsNothingIfNotAsked) {
  const RoadNetwork network = ChainNet(1, 1, 100.0);
  EdgeRecorder edges(network, 0.0, kStep, 1.0);
  for (int k = 0; k < 4; ++k) edges.Observe(FrameOf(network, kStep * k, {{0, "none", 0.0, 0.0}}));
  edges.Finish(1.5);
  EXPECT_TRUE(edges.TakeFinished().empty());
  EdgeRecorder off(network, 0.0, kStep, 0.0);
  for (int k = 0; k < 4; ++k) off.Observe(FrameOf(network, kStep * k, {{0, "e0_0", 10.0, 1.0}}));
  off.Finish(1.5);
  EXPECT_TRUE(off.TakeFinished().empty());
}

}  // namespace
}  // namespace lanewise
