#include "agents/sensing/road_view.h"

#include <fmt/core.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "agents/vehicle/kinematic_bicycle.h"
#include "tests/support/ruled_crossing.h"

namespace lanewise {
namespace {

class ChainView : public testing::Test {
 protected:
  RoadNetwork network_ = ChainNet(/*edges=*/3, /*lanes=*/2, /*length=*/100.0);
  Scene scene_{network_};
};

// From s = 90 of 100 m: the junction (8 m) begins in 10 m, the next edge in 18 m, and ends in 118 m.
TEST_F(ChainView, LookAheadCrossesTheJunction) {
  scene_.Add({"e0", "e1", "e2"}, 0, 90.0, 10.0);
  const WayAhead way = LookAhead(scene_.Look(), 0, 60.0);
  ASSERT_EQ(way.count, 3);
  EXPECT_EQ(network_.lanes[way.lanes[0].lane].id, "e0_0");
  EXPECT_EQ(network_.lanes[way.lanes[1].lane].id, ":J1_0_0");
  EXPECT_EQ(network_.lanes[way.lanes[2].lane].id, "e1_0");
  EXPECT_NEAR(way.lanes[0].start, -90.0, 1e-9);
  EXPECT_NEAR(way.lanes[1].start, 10.0, 1e-9);
  EXPECT_NEAR(way.lanes[2].start, 18.0, 1e-9);
  EXPECT_NEAR(way.length, 118.0, 1e-9);
  EXPECT_TRUE(way.leads_on);
}

TEST_F(ChainView, LookAheadFromWithinTheJunction) {
  scene_.Add({"e0", "e1", "e2"}, 0, 90.0, 10.0);
  scene_.traffic().now.lane[0] = network_.FindLane(":J1_0_0");
  scene_.traffic().now.s[0] = 3.0;
  const WayAhead way = LookAhead(scene_.Look(), 0, 50.0);
  ASSERT_EQ(way.count, 2);
  EXPECT_EQ(network_.lanes[way.lanes[1].lane].id, "e1_0");
  EXPECT_NEAR(way.lanes[1].start, 5.0, 1e-9);
}

TEST_F(ChainView, TheTripsEndIsNoDeadEnd) {
  scene_.Add({"e0"}, 0, 90.0, 10.0);
  const WayAhead way = LookAhead(scene_.Look(), 0, 60.0);
  EXPECT_EQ(way.count, 1);
  EXPECT_NEAR(way.length, 10.0, 1e-9);
  EXPECT_TRUE(way.leads_on);
}

TEST(ForkView, ALaneThatDoesNotFollowTheRouteEndsTheWay) {
  const RoadNetwork network = ForkNet();
  Scene scene(network);
  scene.Add({"a", "b"}, 0, 350.0, 10.0);  // Right lane: leads to "c".
  scene.Add({"a", "b"}, 1, 350.0, 10.0);
  const World world = scene.Look();
  const WayAhead wrong = LookAhead(world, 0, 100.0);
  EXPECT_FALSE(wrong.leads_on);
  EXPECT_EQ(wrong.count, 1);
  EXPECT_NEAR(wrong.length, 50.0, 1e-9);
  const WayAhead right = LookAhead(world, 1, 100.0);
  EXPECT_TRUE(right.leads_on);
  ASSERT_EQ(right.count, 3);
  EXPECT_EQ(network.lanes[right.lanes[1].lane].id, ":J_1_0");
  EXPECT_EQ(network.lanes[right.lanes[2].lane].id, "b_0");
}

// Fronts: 10 m to the junction + 8 m + 20 m = 38 m apart; minus the leader's 5 m: a gap of 33 m.
TEST_F(ChainView, LeaderAndFollowerThroughTheJunction) {
  scene_.Add({"e0", "e1", "e2"}, 0, 90.0, 10.0);
  scene_.Add({"e1", "e2"}, 0, 20.0, 7.0);
  scene_.Add({"e1", "e2"}, 1, 15.0, 3.0);  // On the other lane: nobody's leader here.
  const World world = scene_.Look();
  const Leader leader = FindLeader(world, 0, LookAhead(world, 0, 80.0));
  EXPECT_EQ(leader.row, 1);
  EXPECT_NEAR(leader.gap, 33.0, 1e-9);
  EXPECT_EQ(leader.speed, 7.0);
  const Leader follower = FindFollowerOnLane(world, 1, network_.FindLane("e1_0"), 20.0, 80.0);
  EXPECT_EQ(follower.row, 0);
  EXPECT_NEAR(follower.gap, 33.0, 1e-9);  // Minus the ego's own 5 m.
  EXPECT_EQ(follower.speed, 10.0);
  // Not as far back as that: only the 20 m to the lane's start were looked at.
  EXPECT_EQ(FindFollowerOnLane(world, 1, network_.FindLane("e1_0"), 20.0, 15.0).row, kNone);
}

// Who stands at a yield line before the lane goes after the ego; who comes on may not stop any more.
TEST_F(ChainView, WhoStandsAtAYieldLineFollowsNobody) {
  for (Connection& connection : network_.connections) {
    if (!network_.lanes[connection.from].internal) connection.state = 'm';
  }
  scene_.Add({"e0", "e1", "e2"}, 0, 99.0, 0.0);
  scene_.Add({"e1", "e2"}, 1, 10.0, 5.0);
  const LaneIndex lane = network_.FindLane("e1_0");
  EXPECT_EQ(FindFollowerOnLane(scene_.Look(), 1, lane, 10.0, 80.0).row, kNone);
  scene_.traffic().now.speed[0] = 5.0;
  EXPECT_EQ(FindFollowerOnLane(scene_.Look(), 1, lane, 10.0, 80.0).row, 0);
}

TEST_F(ChainView, NobodyAheadGivesAnInfiniteGap) {
  scene_.Add({"e0", "e1", "e2"}, 0, 50.0, 10.0);
  scene_.Add({"e0", "e1", "e2"}, 0, 30.0, 10.0);
  const World world = scene_.Look();
  const Leader leader = FindLeader(world, 0, LookAhead(world, 0, 80.0));
  EXPECT_EQ(leader.row, kNone);
  EXPECT_TRUE(std::isinf(leader.gap));
}

// Beside counts, with a negative gap: fronts 2 m apart, 5 m long.
TEST_F(ChainView, NeighborsBesideHaveANegativeGap) {
  scene_.Add({"e0", "e1"}, 0, 50.0, 10.0);
  scene_.Add({"e0", "e1"}, 1, 52.0, 10.0);
  scene_.Add({"e0", "e1"}, 1, 48.0, 10.0);
  const World world = scene_.Look();
  const LaneIndex left = network_.FindLane("e0_1");
  const Leader ahead = FindLeaderOnLane(world, 0, left, 50.0, 60.0);
  const Leader behind = FindFollowerOnLane(world, 0, left, 50.0, 60.0);
  EXPECT_EQ(ahead.row, 1);
  EXPECT_NEAR(ahead.gap, -3.0, 1e-9);
  EXPECT_EQ(behind.row, 2);
  EXPECT_NEAR(behind.gap, -3.0, 1e-9);
}

TEST_F(ChainView, ObstaclesOnAStraightRoad) {
  scene_.Add({"e0", "e1"}, 0, 50.0, 10.0);
  scene_.Add({"e0", "e1"}, 1, 70.0, 6.0);
  RoadView view;
  const World world = scene_.Look();
  SenseRoad(world, 0, LookAhead(world, 0, 80.0), 45.0, true, &view);
  ASSERT_EQ(view.obstacle_count, 1);
  const Obstacle& o = view.obstacles[0];
  EXPECT_EQ(o.row, 1);
  EXPECT_NEAR(o.s, 20.0 - 2.5, 1e-3);  // Its middle.
  EXPECT_NEAR(o.d, kLaneWidth, 1e-3);
  EXPECT_NEAR(o.half_length, 2.5, 1e-3);
  EXPECT_NEAR(o.half_width, 0.9, 1e-3);
  EXPECT_NEAR(o.speed_s, 6.0, 1e-3);
  EXPECT_NEAR(o.speed_d, 0.0, 1e-3);
  EXPECT_NEAR(o.along, 1.0, 1e-6);
}

// On an arc of radius 50 m. The other's front is 30 m of arc ahead and `d` m left; its middle is 2.5 m back
// along its tangent, so about 27.5 m ahead on the path, and right of it by 2.5^2 / (2 R) = 0.06 m. Projecting
// on the nearest of nodes 3 m apart costs at most 1.5^2 / (2 R) = 0.023 m more.
TEST(BendView, ObstaclesOnACurvedPath) {
  const RoadNetwork network = BendNet(50.0, 1.5);
  for (const double d : {0.0, 2.0, -2.0}) {
    Scene scene(network);
    scene.Add({"bend"}, 0, 15.0, 10.0);
    scene.Add({"bend"}, 0, 45.0, 8.0);
    scene.traffic().now.d[1] = d;
    RoadView view;
    const World world = scene.Look();
    SenseRoad(world, 0, LookAhead(world, 0, 60.0), 45.0, true, &view);
    ASSERT_EQ(view.obstacle_count, 1);
    // Offset d on the outside (or inside) of the bend scales the 2.5 m by R / (R - d).
    EXPECT_NEAR(view.obstacles[0].s, 30.0 - 2.5 * 50.0 / (50.0 - d), 0.12) << d;
    EXPECT_NEAR(view.obstacles[0].d, d - 0.06, 0.08) << d;
    EXPECT_NEAR(view.curvature[8], 1.0 / 50.0, 2e-3);
    EXPECT_NEAR(view.obstacles[0].speed_s, 8.0, 0.1);
  }
}

// Two cars abreast on an arc, 3.2 m apart, each in steady motion on its circle of radius R: its heading is
// less than the tangent by the slip angle beta, sin beta = l_r / R. Neither drifts nor seems wider.
TEST(BendView, ANeighborThatKeepsItsLaneNeitherDriftsNorWidens) {
  constexpr double kRadius = 20.0;
  const RoadNetwork network = BendNet(kRadius, 1.5);
  Scene scene(network);
  scene.Add({"bend"}, 0, 12.0, 6.0);
  scene.Add({"bend"}, 0, 14.0, 6.0);
  Traffic& traffic = scene.traffic();
  const VehicleParams& vehicle = traffic.params[1];
  const double beta = std::asin(vehicle.rear_axle_to_front / (kRadius + 3.2));
  traffic.now.d[1] = -3.2;
  traffic.now.heading_error[1] = -beta;
  traffic.now.steering_angle[1] = SteeringAngle(beta, vehicle.wheelbase, vehicle.rear_axle_to_front);
  RoadView view;
  const World world = scene.Look();
  SenseRoad(world, 0, LookAhead(world, 0, 60.0), 30.0, true, &view);
  ASSERT_EQ(view.obstacle_count, 1);
  EXPECT_NEAR(view.obstacles[0].speed_d, 0.0, 0.45);  // Nodes 2 m apart turn by 0.1 rad: 6 m/s * 0.05, and d.
  EXPECT_LT(view.obstacles[0].half_width, 0.5 * vehicle.width + 0.3);
}

// A bus of 12 m on the same circle, beside a car: the middle of its chord lies (L / 2)^2 / (2 R) = 0.78 m
// nearer to the centre than its ends, and so does its left side.
TEST(BendView, ABusReachesIntoTheInsideOfTheBend) {
  constexpr double kRadius = 23.2;
  const RoadNetwork network = BendNet(20.0, 1.5);
  Scene scene(network);
  scene.Add({"bend"}, 0, 12.0, 6.0);
  scene.Add({"bend"}, 0, 20.0, 6.0);
  Traffic& traffic = scene.traffic();
  VehicleParams& bus = traffic.params[1];
  bus.length = 12.0;
  bus.width = 2.5;
  bus.rear_axle_to_front = 6.0;
  traffic.now.d[1] = -3.2;
  const double beta = std::asin(6.0 / kRadius);  // Both its ends are on the circle, and stay there.
  traffic.now.heading_error[1] = -beta;
  traffic.now.steering_angle[1] = SteeringAngle(beta, bus.wheelbase, bus.rear_axle_to_front);
  RoadView view;
  const World world = scene.Look();
  SenseRoad(world, 0, LookAhead(world, 0, 60.0), 30.0, true, &view);
  ASSERT_EQ(view.obstacle_count, 1);
  const Obstacle& o = view.obstacles[0];
  EXPECT_FALSE(o.parallel);
  // Its rear does not drift, but for the tangent at the nearest node, which over two seconds tells a little.
  EXPECT_NEAR(o.d + o.half_width, -3.2 + 6.0 * 6.0 / (2.0 * kRadius) + 1.25, 0.25);
  EXPECT_NEAR(o.d - o.half_width, -3.2 - 1.25, 0.15);
}

// The rear of a bus that turns away, 3 m behind its axle, swings out: at 6 m/s and a slip of 0.2 rad 9 m
// ahead of that axle it yaws by 6 sin(0.2) / 9 rad/s, so the rear moves by three times that in a second; it
// is kept clear of for two.
TEST(RoadView, TheRearOfABusSwingsOut) {
  const RoadNetwork network = ChainNet(1, 2, 200.0);
  for (const double slip : {0.0, -0.2}) {
    Scene scene(network);
    scene.Add({"e0"}, 1, 20.0, 6.0);
    scene.Add({"e0"}, 0, 35.0, 6.0);
    Traffic& traffic = scene.traffic();
    VehicleParams& bus = traffic.params[1];
    bus.length = 12.0;
    bus.width = 2.5;
    bus.rear_axle_to_front = 9.0;
    traffic.now.steering_angle[1] = SteeringAngle(slip, bus.wheelbase, bus.rear_axle_to_front);
    RoadView view;
    const World world = scene.Look();
    SenseRoad(world, 0, LookAhead(world, 0, 60.0), 30.0, true, &view);
    ASSERT_EQ(view.obstacle_count, 1);
    const Obstacle& o = view.obstacles[0];
    EXPECT_NEAR(o.d + o.half_width, -3.2 + 1.25 + 2.0 * 3.0 * 6.0 * std::sin(-slip) / 9.0, 1e-3);
    EXPECT_NEAR(o.d - o.half_width, -3.2 - 1.25, 1e-3);
  }
}

// A car that stands across our way on another road is forgiven only while we creep, and only after patience.
TEST_F(ChainView, WhoHasWaitedLongCreepsByWhatStandsOnAnotherRoad) {
  scene_.Add({"e0", "e1"}, 0, 50.0, 0.0);
  scene_.Add({"e2"}, 0, 20.0, 0.0);
  Traffic& traffic = scene_.traffic();
  traffic.number[0] = 2;  // The other is the elder.
  traffic.number[1] = 1;
  RoadView view;
  const auto forgiven = [&] {
    World world = scene_.Look();
    // Put its body 12 m in front of us.
    traffic.now.x[1] = traffic.now.x[0] + 12.0;
    std::vector<double> x(world.center_x.begin(), world.center_x.end());
    x[1] = traffic.now.x[1] - 2.5;
    world.center_x = x;
    SpatialGrid grid(20.0);
    grid.Build(world.center_x, world.center_y);
    world.grid = &grid;
    SenseRoad(world, 0, LookAhead(world, 0, 20.0), 30.0, true, &view);
    return view.obstacle_count == 1 ? view.obstacles[0].forgiven : -1.0f;
  };
  EXPECT_EQ(forgiven(), 0.0f);
  traffic.now.waited[0] = 13.0f;
  EXPECT_GT(forgiven(), 100.0f);
  traffic.now.speed[0] = 5.0;
  EXPECT_EQ(forgiven(), 0.0f);
}

// A car stands across our way at a yield line, its front past us: it waits for others and will go.
TEST(CrossView, WhoYieldsToOthersIsNotCreptThroughForLong) {
  const auto forgiven = [](const std::string& state, float waited) {
    const RoadNetwork network =
        PlainNet({{"a", "A", "B", 100, "0,0 100,0"},
                  {"b", "C", "D", 55, "46,-50 46,5"},
                  {"c", "D", "E", 50, "46,5 46,55"}},
                 R"(<connection from="b" to="c" fromLane="0" toLane="0" dir="s" state=")" + state + R"("/>)");
    Scene scene(network);
    scene.Add({"b", "c"}, 0, 52.0, 0.0);
    scene.Add({"a"}, 0, 40.0, 0.0);
    scene.traffic().now.waited[1] = waited;
    RoadView view;
    const World world = scene.Look();
    SenseRoad(world, 1, LookAhead(world, 1, 20.0), 30.0, true, &view);
    return view.obstacle_count == 1 ? view.obstacles[0].forgiven : -1.0f;
  };
  EXPECT_EQ(forgiven("M", 11.0f), 0.0f);
  EXPECT_GT(forgiven("M", 13.0f), 100.0f);
  EXPECT_EQ(forgiven("m", 13.0f), 0.0f);
  EXPECT_GT(forgiven("m", 91.0f), 100.0f);
}

// Inside a junction it may reach a little into our way, and goes first, however long we have waited before
// it; only when it is stuck there itself do we creep by.
TEST(CrossView, WhoStandsInAJunctionIsGivenTimeToLeaveIt) {
  RoadNetwork network =
      PlainNet({{"a", "A", "B", 100, "0,0 100,0"}, {"b", "C", "D", 105, "46,-50 46,55"}}, "");
  network.lanes[1].internal = true;
  Scene scene(network);
  scene.Add({"a"}, 0, 40.0, 0.0);
  scene.Add({"b"}, 0, 52.0, 0.0);
  Traffic& traffic = scene.traffic();
  traffic.now.waited[0] = 50.0f;
  RoadView view;
  const auto forgiven = [&] {
    const World world = scene.Look();
    SenseRoad(world, 0, LookAhead(world, 0, 20.0), 30.0, true, &view);
    return view.obstacle_count == 1 ? view.obstacles[0].forgiven : -1.0f;
  };
  traffic.now.waited[1] = 11.0f;
  EXPECT_NEAR(forgiven(), 0.6f, 1e-6f);
  traffic.now.waited[1] = 13.0f;
  EXPECT_GT(forgiven(), 100.0f);
}

// Its tangent points across our path; its lane bends and passes us 3.2 m to the left.
TEST(BendView, WhoComesTowardsUsFollowsItsLane) {
  const RoadNetwork network =
      PlainNet({{"a", "A", "B", 100, "-50,0 50,0"}, {"b", "C", "A", 115, "50,32 30,8 24,4 18,3.2 -50,3.2"}});
  Scene scene(network);
  scene.Add({"a"}, 0, 65.0, 5.0);
  scene.Add({"b"}, 0, 34.0, 9.0);
  RoadView view;
  const World world = scene.Look();
  SenseRoad(world, 0, LookAhead(world, 0, 35.0), 30.0, true, &view);
  ASSERT_EQ(view.obstacle_count, 1);
  const Obstacle& o = view.obstacles[0];
  EXPECT_LT(o.along, 0.0f);
  const Traffic& traffic = scene.traffic();
  EXPECT_LT(traffic.now.y[1] + 9.0 * std::sin(traffic.now.heading[1]), 3.0);  // By its tangent.
  EXPECT_NEAR(o.d + o.speed_d * o.drift_time, 4.0, 1.0);
}

// Who turns off ahead of us and stands with its tail still on our edge is in our way, however long we have
// waited.
TEST(ForkView, ATailOnOurRoadIsNotCreptThrough) {
  const RoadNetwork network = ForkNet();
  Scene scene(network);
  scene.Add({"a", "b"}, 1, 395.0, 0.0);
  scene.Add({"a", "c"}, 0, 0.0, 0.0);
  Traffic& traffic = scene.traffic();
  traffic.now.waited[0] = 13.0f;
  traffic.now.lane[1] = network.FindLane("c_0");
  traffic.route_position[1] = 1;
  RoadView view;
  const auto forgiven = [&](double s) {
    traffic.now.s[1] = s;
    SenseRoad(scene.Look(), 0, LookAhead(scene.Look(), 0, 60.0), 45.0, true, &view);
    return view.obstacle_count == 1 ? view.obstacles[0].forgiven : -1.0f;
  };
  EXPECT_EQ(forgiven(3.0), 0.0f);
  EXPECT_GT(forgiven(12.0), 100.0f);  // Its tail has left.
}

// One lane leads straight on to "b" and to the right to "c": whoever turns off there before us makes room as
// fast as it drives.
TEST(TurnOffView, WhoTurnsOffBeforeUsMakesRoomAsFastAsItDrives) {
  const RoadNetwork network = LoadNetText(R"(<net version="1.9">
    <edge id=":J_0" function="internal">
      <lane id=":J_0_0" index="0" speed="13.89" length="13" shape="100,0 104,-0.6 107,-3 108,-8"/></edge>
    <edge id=":J_1" function="internal"><lane id=":J_1_0" index="0" speed="13.89" length="12" shape="100,0 112,0"/></edge>
    <edge id="a" from="A" to="J"><lane id="a_0" index="0" speed="13.89" length="100" shape="0,0 100,0"/></edge>
    <edge id="b" from="J" to="B"><lane id="b_0" index="0" speed="13.89" length="100" shape="112,0 212,0"/></edge>
    <edge id="c" from="J" to="C"><lane id="c_0" index="0" speed="13.89" length="100" shape="108,-8 108,-108"/></edge>)" +
                                          ForkLinks("a_0", 0) + "</net>");
  Scene scene(network);
  scene.Add({"a", "b"}, 0, 90.0, 6.0);
  scene.Add({"a", "c"}, 0, 90.0, 6.0);
  scene.traffic().now.lane[1] = network.FindLane(":J_0_0");
  RoadView view;
  const auto speed_at = [&](double s) {
    scene.traffic().now.s[1] = s;
    const World world = scene.Look();
    SenseRoad(world, 0, LookAhead(world, 0, 60.0), 45.0, true, &view);
    return view.obstacle_count == 1 ? view.obstacles[0].speed_s : -1.0f;
  };
  EXPECT_NEAR(speed_at(1.0), 6.0f, 0.1f);
  EXPECT_NEAR(speed_at(7.0), 6.0f, 1e-3f);
  // On the road behind the junction it is one that drives across.
  scene.traffic().now.lane[1] = network.FindLane("c_0");
  scene.traffic().route_position[1] = 1;
  EXPECT_LT(speed_at(0.5), 2.0f);
}

// A car that comes towards us is left out while SUMO's checks guard the junction.
TEST_F(ChainView, CrossingTrafficOnlyWhenAskedFor) {
  scene_.Add({"e0", "e1"}, 0, 50.0, 10.0);
  scene_.Add({"e0", "e1"}, 1, 70.0, 6.0);
  scene_.traffic().now.heading_error[1] = 2.0;  // More than a right angle.
  RoadView view;
  const World world = scene_.Look();
  SenseRoad(world, 0, LookAhead(world, 0, 80.0), 45.0, true, &view);
  EXPECT_EQ(view.obstacle_count, 1);
  SenseRoad(world, 0, LookAhead(world, 0, 80.0), 45.0, false, &view);
  EXPECT_EQ(view.obstacle_count, 0);
}

/// Row 0 on "a", its front at x = 40 of a straight path; row 1 on "b", which crosses it at x = 50. The rules
/// decide who goes first: what crosses is left out.
class GuardedCrossView : public RuledCrossing {
 protected:
  void Add(double speed, double other_s, double other_speed) {
    scene_.Add({"a"}, 0, 40.0, speed);
    scene_.Add({"b"}, 0, other_s, other_speed);
  }
  /// @return how many obstacles row 0 sees.
  int Look(bool agents_rule) {
    Sense(agents_rule, 20.0);
    return view_.obstacle_count;
  }
};

// It will stand after 5 m, its front 1 m past our path's middle.
TEST_F(GuardedCrossView, WhoBrakesIsWhereItWillStand) {
  Add(5.0, 46.0, 6.0);
  EXPECT_EQ(Look(true), 0);
  scene_.traffic().now.accel[1] = -3.6;  // 6^2 / (2 * 3.6) = 5 m.
  ASSERT_EQ(Look(true), 1);
  const Obstacle& it = view_.obstacles[0];
  EXPECT_NEAR(it.d + it.half_width, 1.0, 0.01);
  EXPECT_EQ(it.speed_d, 0.0f);
  EXPECT_EQ(Look(false), 0);             // SUMO may let it go on.
  scene_.traffic().now.accel[1] = -2.0;  // It would stand in 3 s: much may change until then.
  EXPECT_EQ(Look(true), 0);
}

// Who creeps up to the place where it waits will hardly move any more.
TEST_F(GuardedCrossView, WhoCreepsToAHaltIsSeen) {
  Add(5.0, 46.0, 0.8);
  EXPECT_EQ(Look(true), 0);              // It may be about to start.
  scene_.traffic().now.accel[1] = -0.2;  // It slows down.
  ASSERT_EQ(Look(true), 1);
  EXPECT_NEAR(view_.obstacles[0].d + view_.obstacles[0].half_width, -4.0 + 0.5 * 0.8, 0.01);
  EXPECT_EQ(Look(false), 0);
}

// SUMO knows a bus on its lane only, not over the one beside it.
TEST_F(GuardedCrossView, ABusThatSwingsOutIsSeenUnderSumosRules) {
  Add(5.0, 46.0, 4.0);
  scene_.traffic().params[1].length = 12.0;
  EXPECT_EQ(Look(false), 0);
  scene_.traffic().now.d[1] = -2.0;  // Its lane is 3.2 m wide.
  EXPECT_EQ(Look(false), 1);
  scene_.traffic().params[1].length = 5.0;
  EXPECT_EQ(Look(false), 0);
}

// Whom we wait for is in our way until it has gone.
TEST_F(GuardedCrossView, WhoIsWaitedForIsSeenWhileItMoves) {
  Add(0.0, 52.0, 1.0);
  EXPECT_EQ(Look(true), 0);
  scene_.traffic().now.rule[0].waits_for = scene_.traffic().number[1];
  EXPECT_EQ(Look(true), 1);
}

/// How many obstacles row 0 sees where SUMO's checks guard the junction, or the agents' own rules do.
int SeenNearAJunction(const RoadNetwork& network, bool agents_rule, Scene* scene) {
  const AgentParams params;
  JunctionRules rules(network, FitLaneCurves(network, {}), params);
  World world = scene->Look();
  rules.Build(world);
  if (agents_rule) world.rules = &rules;
  RoadView view;
  SenseRoad(world, 0, LookAhead(world, 0, 80.0), 45.0, false, &view);
  return view.obstacle_count;
}

// Of who comes towards us no rule says who goes first, here on the other side of a road.
TEST(RoadView, WhoComesTowardsUsIsSeenWhereNoRuleSaysWhoGoesFirst) {
  const RoadNetwork network =
      PlainNet({{"a", "A", "B", 100, "0,0 100,0"}, {"b", "B", "A", 100, "100,3.5 0,3.5"}}, "");
  Scene scene(network);
  scene.Add({"a"}, 0, 40.0, 5.0);
  scene.Add({"b"}, 0, 40.0, 5.0);
  EXPECT_EQ(SeenNearAJunction(network, false, &scene), 0);
  EXPECT_EQ(SeenNearAJunction(network, true, &scene), 1);
}

// It turns off our road; no rule makes it wait for us, or us for it.
TEST_F(ChainView, WhoTurnsOffOurRoadIsSeenUnderTheAgentsRules) {
  scene_.Add({"e0", "e1"}, 0, 50.0, 10.0);
  scene_.Add({"e0", "e1"}, 0, 70.0, 6.0);
  scene_.traffic().now.heading_error[1] = 1.3;
  EXPECT_EQ(SeenNearAJunction(network_, false, &scene_), 0);
  EXPECT_EQ(SeenNearAJunction(network_, true, &scene_), 1);
}

TEST_F(ChainView, TheNearestObstaclesAreKept) {
  scene_.Add({"e0", "e1", "e2"}, 0, 10.0, 10.0);
  for (int k = 0; k < 2 * kMaxObstacles; ++k) {
    scene_.Add({"e0", "e1", "e2"}, k % 2, 20.0 + 1.5 * k, 0.0);
  }
  RoadView view;
  const World world = scene_.Look();
  SenseRoad(world, 0, LookAhead(world, 0, 120.0), 100.0, true, &view);
  ASSERT_EQ(view.obstacle_count, kMaxObstacles);
  for (int m = 0; m < view.obstacle_count; ++m) EXPECT_LE(view.obstacles[m].row, kMaxObstacles);
}

}  // namespace
}  // namespace lanewise
