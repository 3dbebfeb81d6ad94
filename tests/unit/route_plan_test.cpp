#include "agents/network/route_plan.h"

#include <gtest/gtest.h>

#include <string>

#include "tests/support/net_builder.h"

namespace lanewise {
namespace {

const VehicleClassMask kCar = VehicleClassBit("passenger");
constexpr double kBeyond = 1e6;  // What the last edge adds.

// a (100 m, 3 lanes) -> b (50 m, 3 lanes) -> c (80 m, 1 lane). Lanes a_0 and a_1 lead to b_0, a_1 and a_2 to
// b_1, a_2 to b_2 as well; only b_2 leads on to c.
//
//   b_2: 50 + 80, b_1: 50, one change; b_0: 50, two changes.
//   a_2: may choose b_1 or b_2, takes b_2: 100 + 50 + 80.
//   a_1: b_0 and b_1 are equally long, b_1 is nearer to b_2: 100 + 50.    a_0: b_0: 100 + 50.
NetBuilder ThreeLanes() {
  NetBuilder net;
  net.AddEdge("a", 3, 100.0).AddEdge("b", 3, 50.0).AddEdge("c", 1, 80.0);
  net.Connect("a_0", "b_0")
      .Connect("a_1", "b_0")
      .Connect("a_1", "b_1")
      .Connect("a_2", "b_1")
      .Connect("a_2", "b_2");
  net.Connect("b_2", "c_0");
  return net;
}

TEST(RoutePlan, ThreeLanesByHand) {
  const NetBuilder net = ThreeLanes();
  const RoutePlan plan(net.network, {0, 1, 2}, kCar);
  const auto next = [&](std::size_t k, int lane) {
    return plan.At(k, lane).next == kNone ? "" : net.network.lanes[plan.At(k, lane).next].id;
  };
  EXPECT_DOUBLE_EQ(plan.At(2, 0).free_distance, 80.0 + kBeyond);
  EXPECT_DOUBLE_EQ(plan.At(1, 2).free_distance, 130.0 + kBeyond);
  EXPECT_DOUBLE_EQ(plan.At(1, 1).free_distance, 50.0);
  EXPECT_EQ(plan.At(1, 0).changes, 2);
  EXPECT_EQ(plan.At(1, 1).changes, 1);
  EXPECT_EQ(plan.At(1, 2).changes, 0);
  EXPECT_EQ(next(1, 0), "");
  EXPECT_EQ(plan.At(1, 0).connection, kNone);
  EXPECT_EQ(next(1, 2), "c_0");
  EXPECT_EQ(next(0, 0), "b_0");
  EXPECT_EQ(next(0, 1), "b_1");
  EXPECT_EQ(next(0, 2), "b_2");
  EXPECT_EQ(plan.At(0, 0).changes, 2);
  EXPECT_EQ(plan.At(0, 1).changes, 1);
  EXPECT_EQ(plan.At(0, 2).changes, 0);
  EXPECT_DOUBLE_EQ(plan.At(0, 1).free_distance, 150.0);
  EXPECT_DOUBLE_EQ(plan.At(0, 2).free_distance, 230.0 + kBeyond);
  EXPECT_DOUBLE_EQ(plan.RemainingLength(0), 230.0);
  EXPECT_DOUBLE_EQ(plan.RemainingLength(2), 80.0);
  EXPECT_EQ(plan.route().size(), 3U);
  const Connection& taken = net.network.connections[plan.At(0, 1).connection];
  EXPECT_EQ(taken.to, plan.At(0, 1).next);
}

TEST(RoutePlan, RightmostNextLaneWinsATie) {
  NetBuilder net;
  net.AddEdge("a", 1, 100.0).AddEdge("b", 2, 50.0).Connect("a_0", "b_1").Connect("a_0", "b_0");
  const RoutePlan plan(net.network, {0, 1}, kCar);
  EXPECT_EQ(net.network.lanes[plan.At(0, 0).next].id, "b_0");
}

TEST(RoutePlan, ChangesGoToTheNearestBestLaneToTheLeftOnATie) {
  NetBuilder net;  // Lanes 0, 2 and 4 lead on: from 1 it is one change either way, left wins.
  net.AddEdge("a", 5, 100.0).AddEdge("b", 5, 50.0);
  net.Connect("a_0", "b_0").Connect("a_2", "b_2").Connect("a_4", "b_4");
  const RoutePlan plan(net.network, {0, 1}, kCar);
  const int expected[] = {0, 1, 0, 1, 0};
  for (int i = 0; i < 5; ++i) EXPECT_EQ(plan.At(0, i).changes, expected[i]) << i;
}

TEST(RoutePlan, ForbiddenLanesAreNoWay) {
  NetBuilder net = ThreeLanes();
  net.At("a_2").allowed = VehicleClassBit("bus");
  net.At("b_1").allowed = VehicleClassBit("bus");
  const RoutePlan car(net.network, {0, 1, 2}, kCar);
  EXPECT_FALSE(car.At(0, 2).allowed);
  EXPECT_DOUBLE_EQ(car.At(0, 2).free_distance, 0.0);
  EXPECT_EQ(car.At(0, 2).next, kNone);
  EXPECT_TRUE(car.At(0, 1).allowed);
  EXPECT_EQ(net.network.lanes[car.At(0, 1).next].id, "b_0");
  EXPECT_EQ(car.At(0, 2).changes, -1);
  const RoutePlan bus(net.network, {0, 1, 2}, VehicleClassBit("bus"));
  EXPECT_TRUE(bus.At(0, 2).allowed);
  EXPECT_EQ(bus.At(0, 1).changes, 1);
}

TEST(RoutePlan, IgnoringVehiclesUseEvenClosedLanes) {
  NetBuilder net = ThreeLanes();
  net.At("a_2").allowed = 0;
  const RoutePlan plan(net.network, {0, 1, 2}, VehicleClassBit("ignoring"));
  EXPECT_TRUE(plan.At(0, 2).allowed);
  EXPECT_EQ(plan.At(0, 2).changes, 0);
}

TEST(RoutePlan, EndsWhereTheRouteIsBroken) {
  const NetBuilder net = ThreeLanes();
  const RoutePlan plan(net.network, {0, 2}, kCar);  // No lane of a leads to c.
  for (int i = 0; i < 3; ++i) {
    EXPECT_TRUE(plan.At(0, i).allowed);
    EXPECT_DOUBLE_EQ(plan.At(0, i).free_distance, 100.0);
    EXPECT_EQ(plan.At(0, i).next, kNone);
    EXPECT_EQ(plan.At(0, i).changes, 0);
  }
}

// Parallel lanes stay equally good when the way over the junction differs by decimetres.
TEST(RoutePlan, JunctionLanesCountAsDistanceButDecideNothing) {
  NetBuilder net;
  net.AddEdge("a", 2, 100.0)
      .AddEdge("b", 2, 50.0)
      .AddEdge(":x", 1, 12.0)
      .AddEdge(":y", 1, 12.5)
      .AddEdge(":z", 1, 3.0);
  net.Connect("a_0", "b_0", ":x_0").Connect("a_1", "b_1", ":y_0");
  net.Connect(":x_0", "b_0").Connect(":y_0", "b_1", ":z_0").Connect(":z_0", "b_1");
  const RoutePlan plan(net.network, {0, 1}, kCar);
  EXPECT_DOUBLE_EQ(plan.At(0, 0).free_distance, 162.0 + kBeyond);
  EXPECT_DOUBLE_EQ(plan.At(0, 1).free_distance, 165.5 + kBeyond);
  EXPECT_EQ(plan.At(0, 0).changes, 0);
  EXPECT_EQ(plan.At(0, 1).changes, 0);
  EXPECT_DOUBLE_EQ(plan.RemainingLength(0), 162.0);
}

// Both lanes lead on, but a_0 has to yield to a_1 where they merge: better be on a_1, and come from z_1.
TEST(RoutePlan, LanesThatMustYieldAreLeftBeforeTheyMerge) {
  NetBuilder net;
  net.AddEdge("z", 1, 30.0).AddEdge("a", 2, 100.0).AddEdge("b", 1, 50.0);
  net.Connect("z_0", "a_0").Connect("z_0", "a_1").Connect("a_0", "b_0").Connect("a_1", "b_0");
  net.network.connections[2].state = 'm';
  const RoutePlan plan(net.network, {0, 1, 2}, kCar);
  EXPECT_EQ(plan.At(1, 0).changes, 1);
  EXPECT_EQ(plan.At(1, 1).changes, 0);
  EXPECT_DOUBLE_EQ(plan.At(1, 0).free_distance, 150.0 + kBeyond);  // It can be driven all the same.
  EXPECT_EQ(net.network.lanes[plan.At(0, 0).next].id, "a_1");
  net.network.connections[2].signal = 0;  // A signal settles who goes.
  EXPECT_EQ(RoutePlan(net.network, {0, 1, 2}, kCar).At(1, 0).changes, 0);
}

// Two lanes enter a ring; only the right one leaves it. Where the entry has to yield the change can wait
// until in the ring, unless that is too short.
TEST(RoutePlan, ChangesCanWaitUntilBehindAYieldLine) {
  const auto plan_for = [](char state, double ring_length) {
    NetBuilder net;
    net.AddEdge("a", 2, 100.0).AddEdge("ring", 2, ring_length).AddEdge("c", 1, 80.0);
    net.Connect("a_0", "ring_0").Connect("a_1", "ring_1").Connect("ring_0", "c_0");
    net.network.connections[0].state = net.network.connections[1].state = state;
    return RoutePlan(net.network, {0, 1, 2}, kCar);
  };
  const RoutePlan yields = plan_for('m', 30.0);
  EXPECT_EQ(yields.At(0, 1).changes, -1);
  EXPECT_TRUE(yields.At(0, 1).can_wait);
  EXPECT_DOUBLE_EQ(yields.At(0, 1).change_distance, 130.0);
  EXPECT_FALSE(yields.At(1, 1).can_wait);  // In the ring it cannot wait any more.
  EXPECT_FALSE(plan_for('M', 30.0).At(0, 1).can_wait);
  const RoutePlan short_ring = plan_for('m', 14.0);
  EXPECT_FALSE(short_ring.At(0, 1).can_wait);
  EXPECT_DOUBLE_EQ(short_ring.At(0, 1).change_distance, 100.0);
  EXPECT_DOUBLE_EQ(short_ring.At(1, 1).change_distance, 0.0);
}

TEST(RoutePlan, EmptyRoute) {
  EXPECT_TRUE(RoutePlan(RoadNetwork{}, {}, kCar).route().empty());
}

}  // namespace
}  // namespace lanewise
