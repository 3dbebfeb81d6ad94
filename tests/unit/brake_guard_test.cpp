#include "agents/planning/brake_guard.h"

#include <gtest/gtest.h>

#include "tests/support/scene.h"
#include "tests/support/small_nets.h"

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

}  // namespace
}  // namespace lanewise
