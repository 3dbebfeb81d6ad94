#include "agents/planning/tactics.h"

#include <gtest/gtest.h>

#include "tests/support/scene.h"
#include "tests/support/small_nets.h"

namespace lanewise {
namespace {

class TacticsTest : public testing::Test {
 protected:
  RoadNetwork network_ = ForkNet();
  Scene scene_{network_};

  /// We on the left lane at 10 m/s; 15 m ahead on the right one a car that must come over and says so.
  void AddOneThatAsks(double its_speed) {
    scene_.Add({"a", "b"}, 1, 365.0, 10.0);
    scene_.Add({"a", "b"}, 0, 380.0, its_speed);
    scene_.traffic().now.urgent[1] = 1;
    scene_.traffic().now.blinker[1] = 1;
  }
};

// Lane 0 of "a" leads to "c", the route to "b" is on the left.
TEST_F(TacticsTest, ANeededChangeBeginsInTime) {
  // One lane to change: due 100 m of driving at the limit of 13.89 m/s plus 30 m before the lane's end.
  AgentParams params;
  params.lane_change.lookahead_time = 100.0 / 13.89;
  params.lane_change.lookahead_distance = 30.0;
  scene_.Add({"a", "b"}, 0, 400.0 - 140.0, 10.0);
  EXPECT_FALSE(scene_.Decide(0, params).urgent);
  scene_.traffic().now.s[0] = 400.0 - 120.0;
  const Tactics tactics = scene_.Decide(0, params);
  EXPECT_TRUE(tactics.urgent);
  EXPECT_EQ(tactics.lane_change, 1);
  EXPECT_EQ(tactics.blinker, 1);
  EXPECT_NEAR(tactics.target_d, kLaneWidth, 1e-9);
  EXPECT_GE(tactics.corridor_max, kLaneWidth);
}

// Where a trip begins SUMO inserts the next one as soon as it sees nobody on the lane: the tail must have
// left.
TEST_F(TacticsTest, NoChangeWhileTheTailIsWhereTheNextOneDeparts) {
  AgentParams params;
  params.lane_change.lookahead_time = 40.0;  // It needs the change at once.
  scene_.Add({"a", "b"}, 0, 0.0, 5.0);
  const VehicleParams& vehicle = scene_.traffic().params[0];
  scene_.traffic().now.s[0] = vehicle.length + vehicle.min_gap - 0.5;
  EXPECT_EQ(scene_.Decide(0, params).lane_change, 0);
  scene_.traffic().now.s[0] += 1.0;
  EXPECT_EQ(scene_.Decide(0, params).lane_change, 1);
}

TEST_F(TacticsTest, OnTheRightLaneNothingIsNeeded) {
  scene_.Add({"a", "c"}, 0, 350.0, 10.0);
  const Tactics tactics = scene_.Decide(0);
  EXPECT_FALSE(tactics.urgent);
  EXPECT_EQ(tactics.lane_change, 0);
  EXPECT_EQ(tactics.target_d, 0.0);
  EXPECT_GT(tactics.speed_cap, 100.0);
}

TEST_F(TacticsTest, AnOccupiedGapIsRefused) {
  scene_.Add({"a", "b"}, 0, 300.0, 10.0);
  scene_.Add({"a", "b"}, 1, 302.0, 10.0);
  const Tactics tactics = scene_.Decide(0);
  EXPECT_EQ(tactics.lane_change, 0);
  EXPECT_EQ(tactics.blinker, 1);  // But it asks for it.
  EXPECT_TRUE(tactics.urgent);
  EXPECT_NEAR(tactics.target_d, 0.0, 1e-9);
}

TEST_F(TacticsTest, AFastFollowerOnTheOtherLaneIsNotCutOff) {
  scene_.Add({"a", "b"}, 0, 300.0, 5.0);
  scene_.Add({"a", "b"}, 1, 300.0 - 5.0 - 3.0, 13.0);  // 3 m behind our rear, 8 m/s faster.
  EXPECT_EQ(scene_.Decide(0).lane_change, 0);
}

// Without the change done, it must be able to stop before the lane's end: 40 m left, 10 m/s.
TEST_F(TacticsTest, ARefusedNeededChangeLimitsTheSpeed) {
  scene_.Add({"a", "b"}, 0, 370.0, 12.0);
  scene_.Add({"a", "b"}, 1, 371.0, 12.0);
  // 16 m are left to the reserve of 14 m: at comfort_decel 4 at most sqrt(2 * 4 * 16) = 11.3 m/s.
  EXPECT_LT(scene_.Decide(0).speed_cap, 12.0);
}

// Nearly standing at its lane's end without a gap it drives on where the lane leads, to "c"; while it still
// moves, or when it has the gap, it does not.
TEST_F(TacticsTest, WhoWouldHaltAtItsLanesEndLeavesItsRoute) {
  scene_.Add({"a", "b"}, 0, 392.0, 0.8);
  scene_.Add({"a", "b"}, 1, 393.0, 0.8);
  AgentParams params;
  params.lane_change.max_detour = 300.0;
  EXPECT_TRUE(scene_.Decide(0, params).leaves_route);
  params.lane_change.max_detour = 0.0;  // Unless it may not.
  EXPECT_FALSE(scene_.Decide(0, params).leaves_route);
  params.lane_change.max_detour = 300.0;
  scene_.traffic().now.speed[0] = 2.0;
  EXPECT_FALSE(scene_.Decide(0, params).leaves_route);
  scene_.traffic().now.speed[0] = 0.8;
  scene_.traffic().now.s[1] = 370.0;
  EXPECT_EQ(scene_.Decide(0, params).lane_change, 1);
  EXPECT_FALSE(scene_.Decide(0, params).leaves_route);
}

// Where it stops for a gap, further back, its patience ends only while the lane beside it moves.
TEST_F(TacticsTest, PatienceEndsWhileOthersPass) {
  scene_.Add({"a", "b"}, 0, 385.0, 0.0);
  scene_.Add({"a", "b"}, 1, 384.0, 5.0);
  AgentParams params;
  params.lane_change.patience = 10.0;
  params.lane_change.max_detour = 300.0;
  EXPECT_TRUE(scene_.Decide(0, params).refused);
  EXPECT_FALSE(scene_.Decide(0, params).leaves_route);
  scene_.traffic().now.refused[0] = 11.0f;
  EXPECT_TRUE(scene_.Decide(0, params).leaves_route);
  scene_.traffic().now.speed[1] = 0.0;
  EXPECT_FALSE(scene_.Decide(0, params).refused);
}

// In a circle of vehicles that wait for each other nobody passes: it ends where one of them leaves it.
TEST_F(TacticsTest, WhoIsStuckForLongLeavesItsRoute) {
  scene_.Add({"a", "b"}, 0, 385.0, 0.0);
  scene_.Add({"a", "b"}, 1, 384.0, 0.0);
  AgentParams params;
  params.lane_change.max_detour = 300.0;
  scene_.traffic().now.waited[0] = 119.0f;
  EXPECT_FALSE(scene_.Decide(0, params).leaves_route);
  scene_.traffic().now.waited[0] = 121.0f;
  EXPECT_TRUE(scene_.Decide(0, params).leaves_route);
  scene_.Add({"a", "b"}, 0, 392.0, 0.0);  // Behind another it only waits in line.
  EXPECT_FALSE(scene_.Decide(0, params).leaves_route);
}

// Where the circle is seen, at once.
TEST_F(TacticsTest, WhoClosesACircleLeavesItsRoute) {
  scene_.Add({"a", "b"}, 0, 385.0, 0.0);
  scene_.Add({"a", "b"}, 1, 384.0, 0.0);
  AgentParams params;
  params.lane_change.max_detour = 300.0;
  EXPECT_EQ(scene_.Decide(0, params).held_by, scene_.traffic().number[1]);
  EXPECT_FALSE(scene_.Decide(0, params).leaves_route);
  EXPECT_TRUE(scene_.Decide(0, params, /*in_circle=*/true).leaves_route);
  scene_.traffic().now.s[1] = 300.0;  // It has a gap.
  EXPECT_EQ(scene_.Decide(0, params, true).held_by, kNone);
  EXPECT_FALSE(scene_.Decide(0, params, true).leaves_route);
  scene_.traffic().now.s[1] = 384.0;
  scene_.Add({"a", "b"}, 0, 392.0, 0.0);  // Behind another it waits for that one.
  EXPECT_FALSE(scene_.Decide(0, params, true).leaves_route);
}

// 20 m before the fork (only near the lane's end does one let in).
// We are on the left lane; the car 15 m ahead on the right lane must come over and says so. We let it in:
// braking no harder than cooperation_decel.
TEST_F(TacticsTest, AnUrgentNeighborIsLetIn) {
  AddOneThatAsks(6.0);
  const Tactics tactics = scene_.Decide(0);
  EXPECT_EQ(tactics.yielded_to, scene_.traffic().number[1]);
  EXPECT_LT(tactics.speed_cap, 10.0);
  const AgentParams params;
  EXPECT_GE(tactics.speed_cap,
            10.0 - params.lane_change.cooperation_decel * params.driving.response_time - 1e-9);
}

TEST_F(TacticsTest, AVehicleThatDoesNotAskIsNotLetIn) {
  scene_.Add({"a", "b"}, 1, 365.0, 10.0);
  scene_.Add({"a", "c"}, 0, 380.0, 6.0);
  const Tactics tactics = scene_.Decide(0);
  EXPECT_EQ(tactics.yielded_to, kNone);
  EXPECT_GT(tactics.speed_cap, 100.0);
}

// Zipper: who has let one in does not let in the next.
TEST_F(TacticsTest, OnlyOneIsLetInPerEdge) {
  AddOneThatAsks(6.0);
  scene_.traffic().now.yielded_to[0] = 77;
  const Tactics tactics = scene_.Decide(0);
  EXPECT_EQ(tactics.yielded_to, 77);
  EXPECT_GT(tactics.speed_cap, 100.0);
}

// It blocks all behind it: whoever stands 20 m before its lane's end is let in even by one who has done so.
TEST_F(TacticsTest, WhoBlocksItsLanesEndIsAlwaysLetIn) {
  AddOneThatAsks(0.0);
  scene_.traffic().now.yielded_to[0] = 77;
  const Tactics tactics = scene_.Decide(0);
  EXPECT_EQ(tactics.yielded_to, scene_.traffic().number[1]);
  EXPECT_LT(tactics.speed_cap, 10.0);
}

// It could not come: it stands 2 m behind another.
TEST_F(TacticsTest, WhoCannotTurnOutIsNotWaitedFor) {
  AddOneThatAsks(0.0);
  const std::size_t before_it = scene_.Add({"a", "c"}, 0, 387.0, 0.0);
  EXPECT_EQ(scene_.Decide(0).yielded_to, kNone);
  scene_.traffic().now.s[before_it] = 396.0;
  EXPECT_EQ(scene_.Decide(0).yielded_to, scene_.traffic().number[1]);
}

// Whoever has stood for ten seconds before the gap it leaves, and nobody has come, drives on.
TEST_F(TacticsTest, CourtesyEnds) {
  AddOneThatAsks(0.0);
  scene_.traffic().now.s[0] = 373.0;
  scene_.traffic().now.speed[0] = 0.0;
  scene_.traffic().now.waited[0] = 9.0f;
  EXPECT_EQ(scene_.Decide(0).yielded_to, scene_.traffic().number[1]);
  scene_.traffic().now.waited[0] = 11.0f;
  EXPECT_EQ(scene_.Decide(0).yielded_to, kNone);
  scene_.traffic().now.speed[1] = 2.0;
  EXPECT_EQ(scene_.Decide(0).yielded_to, scene_.traffic().number[1]);
}

// A queue passes one that stands at its lane's end. Who follows so closely that it cannot stop drives on; the
// first that can stop comfortably waits, though another is between.
TEST_F(TacticsTest, AMovingQueueLetsInWhoBlocksItsLanesEnd) {
  scene_.Add({"a", "b"}, 1, 345.0, 6.0);
  scene_.Add({"a", "c"}, 0, 386.0, 0.0);  // Its rear is at 381 m.
  scene_.Add({"a", "b"}, 1, 373.0, 6.0);
  scene_.traffic().now.urgent[1] = 1;
  scene_.traffic().now.blinker[1] = 1;
  EXPECT_EQ(scene_.Decide(0).yielded_to, scene_.traffic().number[1]);
  scene_.traffic().now.s[2] = 377.0;
  scene_.traffic().now.s[0] = 375.0;  // 6 m are less than 6^2 / (2 * 2) m.
  EXPECT_EQ(scene_.Decide(0).yielded_to, kNone);
}

// Side by side, each in the lane the other needs: the car, which is past the bus after less way, drives on
// past where it would have waited, the bus stays.
TEST_F(TacticsTest, TwoThatNeedEachOthersLaneChangePlaces) {
  const AgentParams params;
  scene_.Add({"a", "c"}, 1, 400.0 - params.lane_change.reserve, 0.0);
  scene_.Add({"a", "b"}, 0, 400.0 - params.lane_change.reserve, 0.0);
  scene_.traffic().params[1].length = 12.0;
  EXPECT_LT(scene_.Decide(0).speed_cap, 0.5);  // Nobody has said anything yet.
  for (const AgentIndex i : {0, 1}) scene_.traffic().now.urgent[i] = 1;
  scene_.traffic().now.blinker[0] = -1;
  scene_.traffic().now.blinker[1] = 1;
  EXPECT_GT(scene_.Decide(0).speed_cap, 2.0);
  EXPECT_LT(scene_.Decide(1).speed_cap, 0.5);
}

// Who drives on to change places with the one beside it keeps room for the change that follows.
TEST(TacticsChain, WhoGoesFirstKeepsRoomForTheNextChange) {
  const RoadNetwork network = ChainNet(/*edges=*/1, /*lanes=*/3, /*length=*/400.0);
  Scene scene(network);
  scene.Add({"e0"}, 0, 300.0, 0.0);
  scene.Add({"e0"}, 1, 300.0, 0.0);
  Traffic& traffic = scene.traffic();
  traffic.params[1].length = 12.0;
  traffic.now.urgent[1] = 1;
  traffic.now.blinker[1] = -1;
  const AgentParams params;
  traffic.stop_distance[0] = params.lane_change.reserve;
  traffic.stop_lane[0] = 1;
  EXPECT_GT(scene.Decide(0).speed_cap, 5.0);
  traffic.stop_lane[0] = 2;
  EXPECT_LT(scene.Decide(0).speed_cap, 0.5);
}

// The one that asks is 15 m ahead too, but behind the next junction, on an edge of 25 m: pieces of a
// roundabout are no longer than that.
TEST(TacticsChain, LetsInBehindTheJunctionToo) {
  const RoadNetwork network = ChainNet(3, 2, 25.0);
  Scene scene(network);
  scene.Add({"e0", "e1", "e2"}, 0, 22.0, 8.0);
  scene.Add({"e1", "e2"}, 1, 4.0, 5.0);
  scene.traffic().now.urgent[1] = 1;
  scene.traffic().now.blinker[1] = -1;
  EXPECT_EQ(scene.Decide(0).yielded_to, scene.traffic().number[1]);
  scene.traffic().now.blinker[1] = 1;  // It wants to the other side.
  EXPECT_EQ(scene.Decide(0).yielded_to, kNone);
}

// The left lane is free and faster, but leads astray in 305 m: with a long lookahead a change back would be
// due at once (35 s * 13.89 m/s + 30 m), with a short one (5 s) there is time to overtake.
TEST_F(TacticsTest, NoChangeOfChoiceThatMustBeTakenBackAtOnce) {
  scene_.Add({"a", "c"}, 0, 95.0, 12.0);
  scene_.Add({"a", "c"}, 0, 125.0, 3.0);
  AgentParams params;
  EXPECT_EQ(scene_.Decide(0, params).lane_change, 0);
  params.lane_change.lookahead_time = 5.0;
  EXPECT_EQ(scene_.Decide(0, params).lane_change, 1);
}

// 2 m behind a standing car nobody can steer around it: the change waits, though the other lane is free.
TEST_F(TacticsTest, AChangeNeedsRoomToTurnOut) {
  scene_.Add({"a", "b"}, 0, 300.0, 0.6);
  scene_.Add({"a", "c"}, 0, 307.0, 0.0);
  EXPECT_EQ(scene_.Decide(0).lane_change, 0);
  scene_.traffic().now.s[1] = 312.0;
  EXPECT_EQ(scene_.Decide(0).lane_change, 1);
}

// Nor into a gap that is as long as the car: from standing it could not steer over, and would block both
// lanes until the one ahead drives on. When that does, the gap will do.
TEST_F(TacticsTest, WhoStandsNeedsRoomToSteerOver) {
  scene_.Add({"a", "b"}, 0, 350.0, 0.0);
  scene_.Add({"a", "b"}, 1, 350.0 + 5.0 + 1.0, 0.0);
  EXPECT_EQ(scene_.Decide(0).lane_change, 0);
  EXPECT_TRUE(scene_.Decide(0).urgent);
  scene_.traffic().now.speed[1] = 3.0;
  EXPECT_EQ(scene_.Decide(0).lane_change, 1);
  scene_.traffic().now.speed[1] = 0.0;
  scene_.traffic().now.s[1] += 5.0;
  EXPECT_EQ(scene_.Decide(0).lane_change, 1);
}

/// Edge "a": its left lane begins 20 m further back; both count 300 m.
RoadNetwork SkewNet() {
  return LoadNetText(R"(<net version="1.9">
    <edge id="a" from="A" to="B">
      <lane id="a_0" index="0" speed="13.89" length="300" shape="0,0 300,0"/>
      <lane id="a_1" index="1" speed="13.89" length="300" shape="-20,3.2 300,3.2"/></edge>
    <junction id="A" type="dead_end" incLanes="" intLanes=""/>
    <junction id="B" type="dead_end" incLanes="a_0 a_1" intLanes=""/></net>)");
}

// A change leads to the place abeam, at another position as SUMO counts.
TEST(TacticsSkew, AChangeLeadsAbeam) {
  const RoadNetwork network = SkewNet();
  Scene scene(network);
  scene.Add({"a"}, 0, 100.0, 12.0);
  scene.Add({"a"}, 0, 130.0, 3.0);
  const Tactics tactics = scene.Decide(0);
  EXPECT_EQ(tactics.lane_change, 1);
  EXPECT_NEAR(tactics.change_shift, 12.5, 1e-6);
  // Back at x = -15 the right lane has not begun.
  scene.traffic().now.lane[0] = scene.traffic().now.lane[1] = network.FindLane("a_1");
  scene.traffic().now.s[0] = 5.0;
  scene.traffic().now.s[1] = 35.0;
  EXPECT_EQ(scene.Decide(0).lane_change, 0);
}

// Who is beside is found where it is: 112.5 m on the left lane is abeam of 100 m, 93 m is 20 m behind that.
TEST(TacticsSkew, GapsAreMeasuredAbeam) {
  const RoadNetwork network = SkewNet();
  Scene scene(network);
  scene.Add({"a"}, 0, 100.0, 12.0);
  scene.Add({"a"}, 0, 130.0, 3.0);
  scene.Add({"a"}, 1, 112.5, 12.0);
  EXPECT_EQ(scene.Decide(0).lane_change, 0);
  scene.traffic().now.s[2] = 93.0;
  EXPECT_EQ(scene.Decide(0).lane_change, 1);
}

// A bus of 12 m in a bend of 90 degrees: it keeps to the kerb's side, a car to its lane.
TEST(TacticsBend, LongVehiclesKeepToTheKerb) {
  for (const double side : {1.0, -1.0}) {  // Left-hand and right-hand bend.
    for (const bool left_hand : {false, true}) {
      RoadNetwork network = BendNet(side * 10.0, side * 1.57);
      network.left_hand = left_hand;
      Scene scene(network);
      scene.Add({"bend"}, 0, 2.0, 3.0);
      EXPECT_EQ(scene.Decide(0).target_d, 0.0);
      scene.traffic().params[0].length = 12.0;
      AxlesAndActuators("bus", &scene.traffic().params[0]);
      const double kerb = left_hand ? 1.0 : -1.0;
      EXPECT_GT(kerb * scene.Decide(0).target_d, 0.5) << "bend to " << side << ", left hand " << left_hand;
      EXPECT_LE(kerb * scene.Decide(0).target_d, 5.0);
    }
  }
}

// Ten cars crawl far ahead on the own lane, behind the next junction: too far for the car-following law, but
// reason enough to take the other lane.
TEST(TacticsChain, ShunsALongQueue) {
  const RoadNetwork network = ChainNet(/*edges=*/2, /*lanes=*/2, /*length=*/300.0);
  Scene scene(network);
  scene.Add({"e0", "e1"}, 0, 200.0, 12.0);
  for (int k = 0; k < 10; ++k) scene.Add({"e1"}, 0, 100.0 + 7.0 * k, 4.0);
  EXPECT_EQ(scene.Decide(0).lane_change, 1);
  AgentParams params;
  params.lane_change.queue_weight = 0.0;
  EXPECT_EQ(scene.Decide(0, params).lane_change, 0);
}

/// ForkNet whose left lane leads straight on to "c", too: who turns left to "b" there holds up others.
class TurnerTest : public testing::Test {
 protected:
  static RoadNetwork SharedLane() {
    RoadNetwork network = ForkNet();
    const LaneIndex from = network.FindLane("a_1");
    network.lanes[from].outgoing.push_back(static_cast<std::int32_t>(network.connections.size()));
    network.connections.push_back({.from = from, .to = network.FindLane("c_0")});
    return network;
  }
  RoadNetwork network_ = SharedLane();
  Scene scene_{network_};
};

// Standing behind one that waits to turn left, it takes the gap on the lane beside that leads on, without
// asking for it; behind one that goes straight on it waits.
TEST_F(TurnerTest, LeavesTheLaneBehindOne) {
  for (const char* to : {"b", "c"}) {
    Scene scene(network_);
    scene.Add({"a", "c"}, 1, 375.0, 0.0);
    scene.Add({"a", to}, 1, 390.0, 0.0);
    const Tactics tactics = scene.Decide(0);
    EXPECT_EQ(tactics.lane_change, *to == 'b' ? -1 : 0);
    EXPECT_FALSE(tactics.urgent);
    scene.Add({"a", "c"}, 0, 375.0, 5.0);
    EXPECT_EQ(scene.Decide(0).lane_change, 0);
  }
}

// One far ahead is reason enough not to queue up behind it.
TEST_F(TurnerTest, ShunsTheLaneOfOne) {
  scene_.Add({"a", "c"}, 1, 150.0, 12.0);
  EXPECT_EQ(scene_.Decide(0).lane_change, 0);
  scene_.Add({"a", "b"}, 1, 390.0, 0.0);
  EXPECT_EQ(scene_.Decide(0).lane_change, -1);
}

// The lane in the middle is free, but another across it needs it, and says so: both cannot have it.
TEST(TacticsChain, WhoNeedsTheSameLaneGoesFirst) {
  const RoadNetwork network = ChainNet(1, 3, 500.0);
  Scene scene(network);
  scene.Add({"e0"}, 0, 100.0, 12.0);
  scene.Add({"e0"}, 0, 125.0, 3.0);
  scene.Add({"e0"}, 2, 101.0, 12.0);
  EXPECT_EQ(scene.Decide(0).lane_change, 1);
  scene.traffic().now.urgent[2] = 1;
  scene.traffic().now.blinker[2] = -1;
  EXPECT_EQ(scene.Decide(0).lane_change, 0);
  scene.traffic().now.s[2] = 80.0;  // Behind.
  EXPECT_EQ(scene.Decide(0).lane_change, 1);
}

// A slow leader on the own lane, the other lane free and as good for the route: MOBIL changes.
TEST(TacticsChain, OvertakesASlowLeader) {
  const RoadNetwork network = ChainNet(/*edges=*/2, /*lanes=*/2, /*length=*/600.0);
  Scene scene(network);
  scene.Add({"e0", "e1"}, 0, 100.0, 12.0);
  scene.Add({"e0", "e1"}, 0, 130.0, 3.0);
  const Tactics tactics = scene.Decide(0);
  EXPECT_EQ(tactics.lane_change, 1);
  EXPECT_FALSE(tactics.urgent);
  // Not so soon after the last change.
  scene.traffic().now.since_change[0] = 1.0f;
  EXPECT_EQ(scene.Decide(0).lane_change, 0);
}

}  // namespace
}  // namespace lanewise
