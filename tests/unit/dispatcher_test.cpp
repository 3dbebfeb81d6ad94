#include "agents/coordination/dispatcher.h"

#include <gtest/gtest.h>

#include "tests/support/small_nets.h"

namespace lanewise {
namespace {

/// Two ways from "a" to "d": over "b" (100 m) and over "c" (150 m, not for trucks).
RoadNetwork TwoWays() {
  return LoadNetText(R"(<net version="1.9">
    <edge id="a" from="A" to="B"><lane id="a_0" index="0" speed="10" length="100" shape="0,0 100,0"/></edge>
    <edge id="b" from="B" to="C"><lane id="b_0" index="0" speed="10" length="100" shape="100,0 200,0"/></edge>
    <edge id="c" from="B" to="C"><lane id="c_0" index="0" speed="10" length="150" disallow="truck" shape="100,0 150,50 200,0"/></edge>
    <edge id="d" from="C" to="D"><lane id="d_0" index="0" speed="10" length="100" shape="200,0 300,0"/></edge>
    <junction id="A" type="dead_end" incLanes="" intLanes=""/>
    <junction id="B" type="priority" incLanes="a_0" intLanes=""/>
    <junction id="C" type="priority" incLanes="b_0 c_0" intLanes=""/>
    <junction id="D" type="dead_end" incLanes="d_0" intLanes=""/>
    <connection from="a" to="b" fromLane="0" toLane="0" dir="s" state="M"/>
    <connection from="a" to="c" fromLane="0" toLane="0" dir="l" state="M"/>
    <connection from="b" to="d" fromLane="0" toLane="0" dir="s" state="M"/>
    <connection from="c" to="d" fromLane="0" toLane="0" dir="s" state="M"/>
  </net>)");
}

std::vector<std::string> Names(const RoadNetwork& network, const std::vector<EdgeIndex>& route) {
  std::vector<std::string> names;
  for (const EdgeIndex edge : route) names.push_back(network.edges[edge].id);
  return names;
}

TEST(EdgeGraph, TheFastestRouteFollowsTheTimesAndTheVehicleClass) {
  const RoadNetwork network = TwoWays();
  const EdgeGraph graph(network);
  const EdgeIndex a = network.FindEdge("a"), d = network.FindEdge("d");
  std::vector<double> seconds(network.edges.size(), 10.0);
  seconds[network.FindEdge("c")] = 15.0;
  const VehicleClassMask car = VehicleClassBit("passenger"), truck = VehicleClassBit("truck");
  EXPECT_EQ(Names(network, graph.FastestRoute(a, d, car, seconds)),
            (std::vector<std::string>{"a", "b", "d"}));
  seconds[network.FindEdge("b")] = 40.0;
  EXPECT_EQ(Names(network, graph.FastestRoute(a, d, car, seconds)),
            (std::vector<std::string>{"a", "c", "d"}));
  EXPECT_EQ(Names(network, graph.FastestRoute(a, d, truck, seconds)),
            (std::vector<std::string>{"a", "b", "d"}));
  EXPECT_TRUE(graph.FastestRoute(d, a, car, seconds).empty());
}

/// `vehicles` on edge "b" at `speed` in each of ten looks, judged once.
void Interval(CongestionWatch* watch, EdgeIndex edge, int vehicles, double speed) {
  for (int look = 0; look < 10; ++look) {
    for (int k = 0; k < vehicles; ++k) watch->See(edge, speed);
    watch->EndLook();
  }
  watch->Judge();
}

TEST(CongestionWatch, AnEdgeIsCrowdedIfSlowAndDenseAndStaysSoUntilRelieved) {
  const RoadNetwork network = TwoWays();
  const EdgeIndex b = network.FindEdge("b");
  DispatchParams params;  // Crowded below 0.4 of the limit and above 3 vehicles on 100 m, relieved above 0.6.
  CongestionWatch watch(network, params);
  Interval(&watch, b, 6, 1.0);
  // Half of (10 s, 100 s): 55 s, pace 0.18.
  EXPECT_NEAR(watch.seconds()[b], 55.0, 1e-9);
  EXPECT_TRUE(watch.IsCrowded(b));
  EXPECT_DOUBLE_EQ(watch.crowded_share(), 1.0);
  // At 5 m/s its time comes to (55 + 20) / 2 = 37.5 s, then 28.75 s, 24.375 s, 22.1875 s: a pace of 0.45, no
  // crowd if it had not been one.
  for (int k = 0; k < 4; ++k) Interval(&watch, b, 6, 5.0);
  EXPECT_NEAR(watch.seconds()[b], 22.1875, 1e-9);
  EXPECT_TRUE(watch.IsCrowded(b));
  Interval(&watch, b, 2, 10.0);  // 16.09 s: 0.62.
  EXPECT_FALSE(watch.IsCrowded(b));
}

TEST(CongestionWatch, SlowButEmptyIsNoCrowd) {
  const RoadNetwork network = TwoWays();
  const EdgeIndex b = network.FindEdge("b");
  CongestionWatch watch(network, {});
  Interval(&watch, b, 2, 0.5);
  EXPECT_FALSE(watch.IsCrowded(b));
}

TEST(CongestionWatch, AnEdgeNobodyIsOnBecomesFreeAgain) {
  const RoadNetwork network = TwoWays();
  const EdgeIndex b = network.FindEdge("b");
  CongestionWatch watch(network, {});
  Interval(&watch, b, 6, 1.0);
  for (int k = 0; k < 12; ++k) Interval(&watch, b, 0, 0.0);
  EXPECT_FALSE(watch.IsCrowded(b));
  EXPECT_NEAR(watch.seconds()[b], 10.0, 0.1);
}

}  // namespace
}  // namespace lanewise
