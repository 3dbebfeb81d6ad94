#include "agents/planning/brake_guard.h"

#include <gtest/gtest.h>

#include "tests/support/ruled_crossing.h"

namespace lanewise {
namespace {

/// The ego on the right lane, 4 m/s; another on the left lane, whose body may reach over.
class BrakeGuard : public testing::Test {
 protected:
  BrakeGuard() {
    scene_.Add({"e0"}, 0, 50.0, 4.0);
    scene_.Add({"e0"}, 1, 60.0, 0.0);
    Traffic& traffic = scene_.traffic();
    // One step of 0.1 s, the braking distance and a metre: 0.4 + 16 / 16 + 1 = 2.4 m.
    traffic.params[0].emergency_decel = 8.0;
    spacing_ = 0.5 * (network_.lanes[0].width + network_.lanes[1].width);
  }
  /// @param gap [m] bumper to bumper. @param beside [m] between the flanks; negative: they overlap.
  bool MustBrake(double gap, double beside, double steering_angle = 0.0) {
    Traffic& traffic = scene_.traffic();
    traffic.now.s[1] = 50.0 + gap + traffic.params[1].length;
    traffic.now.d[1] = beside + 0.5 * (traffic.params[0].width + traffic.params[1].width) - spacing_;
    const World world = scene_.Look();
    SenseRoad(world, 0, LookAhead(world, 0, 30.0), 30.0, true, &view_);
    return MustBrakeNow(world, 0, kNone, view_, steering_angle, 4.0, 0.1);
  }

  RoadNetwork network_ = ChainNet(/*edges=*/1, /*lanes=*/2, /*length=*/100.0);
  Scene scene_{network_};
  RoadView view_;
  double spacing_;
};

TEST_F(BrakeGuard, WithinTheBrakingDistance) {
  EXPECT_TRUE(MustBrake(2.3, -0.3));
  EXPECT_FALSE(MustBrake(2.5, -0.3));
}

TEST_F(BrakeGuard, OnlyWhatTheBodyWouldTouch) {
  EXPECT_FALSE(MustBrake(1.0, 0.1));
  EXPECT_FALSE(MustBrake(-2.0, 0.1));  // Side by side.
  // 0.25 m to the flank ahead: straight on it is passed, turning left it is not.
  EXPECT_FALSE(MustBrake(0.6, 0.25));
  EXPECT_TRUE(MustBrake(0.6, 0.25, 0.5));
}

TEST_F(BrakeGuard, NotForWhomBrakingDoesNotHelp) {
  EXPECT_FALSE(MustBrake(-1.0, -0.1));  // They touch already.
  scene_.traffic().now.speed[1] = 5.0;  // It drives: the planner foresees it.
  EXPECT_FALSE(MustBrake(1.0, -0.3));
}

TEST_F(BrakeGuard, WhoWalksAwayIsNotTouched) {
  scene_.traffic().now.speed[1] = 1.9;
  EXPECT_FALSE(MustBrake(1.5, -0.3));
  EXPECT_TRUE(MustBrake(0.3, -0.3));
}

// The metre to turn away in is given up, the touch is not.
TEST_F(BrakeGuard, WhoHasWaitedUsesTheLastBitOfRoom) {
  EXPECT_TRUE(MustBrake(1.5, -0.3));
  scene_.traffic().now.waited[0] = 10.0f;
  EXPECT_FALSE(MustBrake(1.5, -0.3));
  EXPECT_TRUE(MustBrake(0.5, -0.3));
}

// A long body at an angle to its path touches with its flank what is far beside its front.
TEST_F(BrakeGuard, AlongTheWholeBodyOfABus) {
  Traffic& traffic = scene_.traffic();
  traffic.params[0].length = 12.0;
  traffic.params[0].rear_axle_to_front = 9.0;
  traffic.params[0].wheelbase = 6.0;
  traffic.now.heading_error[0] = -0.5;
  traffic.now.d[0] = -1.0;
  // 6 m behind the front its left flank is at 6 tan(0.5) + 0.9 / cos(0.5) - 1 = 3.3 m, where straight on it
  // stays.
  EXPECT_FALSE(MustBrake(-6.0, 2.55));
  EXPECT_TRUE(MustBrake(-6.0, 2.55, 0.6));
}

// Faster it cannot stop any more, but it can keep from steering in.
TEST_F(BrakeGuard, FasterForTheNextMomentOnly) {
  Traffic& traffic = scene_.traffic();
  traffic.now.s[1] = 50.0 + 2.0 + traffic.params[1].length;
  traffic.now.d[1] = -spacing_;
  const World world = scene_.Look();
  SenseRoad(world, 0, LookAhead(world, 0, 30.0), 30.0, true, &view_);
  EXPECT_FALSE(MustBrakeNow(world, 0, kNone, view_, 0.0, 6.1, 0.1));  // 1.83 m in 0.3 s.
  EXPECT_TRUE(MustBrakeNow(world, 0, kNone, view_, 0.0, 8.0, 0.1));
  EXPECT_FALSE(MustBrakeNow(world, 0, kNone, view_, 0.0, 9.1, 0.1));
}

/// The ego drives along "a", another across it on "b".
class RuledGuard : public RuledCrossing {
 protected:
  RuledGuard() {
    scene_.Add({"a"}, 0, 45.0, 4.0);
    scene_.Add({"b"}, 0, 50.0, 5.0);
    scene_.traffic().params[0].emergency_decel = 8.0;
  }
  bool MustBrake(bool agents_rule = true) {
    const World world = Sense(agents_rule, 30.0);
    if (forgiven_ > 0.0f)
      for (int m = 0; m < view_.obstacle_count; ++m) view_.obstacles[m].forgiven = forgiven_;
    return MustBrakeNow(world, 0, kNone, view_, 0.0, 4.0, 0.1);
  }

  float forgiven_{0.0f};
};

// The rules grant it the way, so it is not in the view; its tail is still to leave ours.
TEST_F(RuledGuard, WhatTheRulesGrantIsNotTouched) {
  scene_.traffic().now.s[0] = 48.5;
  EXPECT_TRUE(MustBrake());
  EXPECT_EQ(view_.obstacle_count, 0);
  EXPECT_FALSE(MustBrake(false));    // SUMO's checks answer for it.
  scene_.traffic().now.s[0] = 40.0;  // 1.4 m of braking.
  EXPECT_FALSE(MustBrake());
  scene_.traffic().now.s[0] = 48.5;
  scene_.traffic().now.s[1] = 60.0;  // Gone.
  EXPECT_FALSE(MustBrake());
}

// Of a longer one beside the ego the middle may still be behind.
TEST_F(RuledGuard, WhoHasItsFrontAheadOfTheEgosMiddleIsLookedAt) {
  Traffic& traffic = scene_.traffic();
  const auto must_brake = [&](double steering_angle) {
    const World world = Sense(true, 30.0);
    return MustBrakeNow(world, 0, kNone, RoadView{}, steering_angle, 4.0, 0.1);
  };
  traffic.now.lane[1] = traffic.now.lane[0];
  traffic.params[1].length = 12.0;
  traffic.now.d[1] = 0.5 * (traffic.params[0].width + traffic.params[1].width) + 0.1;
  traffic.now.s[1] = traffic.now.s[0];
  EXPECT_TRUE(must_brake(0.3));
  EXPECT_FALSE(must_brake(-0.1));
  traffic.now.s[1] = traffic.now.s[0] - 4.0;  // It drives up from behind.
  EXPECT_FALSE(must_brake(0.3));
}

// The way is not quite the arc that is looked at: a centimetre is left, where SUMO's checks answer a
// millimetre.
TEST_F(RuledGuard, ACentimetreIsLeftAndWhatIsTouchedIsNotPressedInto) {
  Traffic& traffic = scene_.traffic();
  const auto must_brake = [&](bool agents_rule, double beside) {
    traffic.now.lane[1] = traffic.now.lane[0];
    traffic.now.s[1] = traffic.now.s[0] + 1.0;
    traffic.now.d[1] = beside + 0.5 * (traffic.params[0].width + traffic.params[1].width);
    traffic.now.speed[1] = 0.0;
    traffic.now.waited[0] = 10.0f;
    const World world = Sense(agents_rule, 30.0);
    return MustBrakeNow(world, 0, kNone, view_, 0.003, 1.0, 0.1);
  };
  EXPECT_FALSE(must_brake(true, 0.02));
  EXPECT_FALSE(must_brake(false, 0.005));
  EXPECT_TRUE(must_brake(true, 0.005));
  EXPECT_FALSE(must_brake(false, -0.01));
  EXPECT_TRUE(must_brake(true, -0.01));
}

// At 1 m/s a step is 0.1 m: on a lane that bends left by 0.1 /m the ego drifts left by 0.5 mm a step, 5 mm a
// metre, towards what stands there a centimetre from its flank.
TEST_F(RuledGuard, TheDriftIntoABendIsForeseen) {
  Traffic& traffic = scene_.traffic();
  traffic.now.lane[1] = traffic.now.lane[0];
  traffic.now.s[1] = traffic.now.s[0] + 1.0;
  traffic.now.d[1] = 0.0102 + 0.5 * (traffic.params[0].width + traffic.params[1].width);
  traffic.now.speed[1] = 0.0;
  traffic.now.waited[0] = 10.0f;
  const World world = Sense(true, 30.0);
  for (const double curvature : {-0.1, 0.0, 0.1}) {
    traffic.now.curvature[0] = curvature;
    EXPECT_EQ(MustBrakeNow(world, 0, kNone, view_, 0.0, 1.0, 0.1), curvature > 0.0) << curvature;
  }
}

// Two that creep by each other took turns in coming nearer: each counted on the other's moving away.
TEST_F(RuledGuard, RoomThatOneWhoCreepsMakesIsNotCountedOn) {
  Traffic& traffic = scene_.traffic();
  traffic.now.lane[1] = traffic.now.lane[0];
  traffic.now.s[1] = traffic.now.s[0] + traffic.params[1].length + 0.04;  // 3.6 cm to stop from 0.3 m/s.
  traffic.now.waited[0] = 10.0f;
  const auto must_brake = [&](bool agents_rule, double its_speed) {
    traffic.now.speed[1] = its_speed;
    const World world = Sense(agents_rule, 30.0);
    return MustBrakeNow(world, 0, kNone, view_, 0.0, 0.3, 0.1);
  };
  EXPECT_TRUE(must_brake(true, 0.4));
  EXPECT_FALSE(must_brake(true, 0.6));
  EXPECT_FALSE(must_brake(false, 0.4));
}

// Its middle is past the ego's, its tail is not: turning left the ego would touch it.
TEST(TailGuard, WhoComesTowardsTheEgoIsLookedAtUntilItsTailIsPast) {
  const RoadNetwork network =
      PlainNet({{"a", "A", "B", 100, "0,0 100,0"}, {"b", "B", "A", 100, "100,3.6 0,3.6"}}, "");
  Scene scene(network);
  scene.Add({"a"}, 0, 50.0, 4.0);
  scene.Add({"b"}, 0, 64.0, 8.0);  // From x = 36 to 56 m.
  scene.traffic().params[1].length = 20.0;
  scene.traffic().params[1].width = 5.0;  // 0.2 m beside the ego.
  const AgentParams params;
  JunctionRules rules(network, FitLaneCurves(network, {}), params);
  World world = scene.Look();
  rules.Build(world);
  world.rules = &rules;
  const RoadView nothing_in_view{};
  EXPECT_FALSE(MustBrakeNow(world, 0, kNone, nothing_in_view, 0.0, 4.0, 0.1));
  EXPECT_TRUE(MustBrakeNow(world, 0, kNone, nothing_in_view, 0.5, 4.0, 0.1));
}

// By whom it creeps it does not touch, but where nothing else would end a standstill.
TEST_F(RuledGuard, WhatIsForgivenIsNotTouchedUntilPatienceEnds) {
  scene_.traffic().now.s[0] = 48.0;
  scene_.traffic().now.speed[1] = 0.0;
  forgiven_ = 1e3f;
  EXPECT_TRUE(MustBrake());
  scene_.traffic().now.waited[0] = 61.0f;
  EXPECT_FALSE(MustBrake());
}

}  // namespace
}  // namespace lanewise
