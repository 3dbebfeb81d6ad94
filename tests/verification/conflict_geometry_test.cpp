// Measures of encounters against values worked out by hand, to 1e-9.

#include "analysis/conflict_geometry.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace lanewise {
namespace {

/// A box from the middle of its front bumper.
MovingBox Box(double x, double y, double heading, double speed, double length, double width) {
  const Point2 u{std::cos(heading), std::sin(heading)};
  return {{x - 0.5 * length * u.x, y - 0.5 * length * u.y},
          {speed * u.x, speed * u.y},
          u,
          0.5 * length,
          0.5 * width};
}

constexpr double kNorth = std::numbers::pi / 2.0;
constexpr double kSeen = 30.0;  // [s]

double Drac(const MovingBox& a, const MovingBox& b) {
  return DecelerationToAvoid(FindConflictRegion(a, b, kSeen, kSeen), std::hypot(a.velocity.x, a.velocity.y),
                             std::hypot(b.velocity.x, b.velocity.y))
      .value_or(-1.0);
}

TEST(ConflictGeometry, DracOfFollowingIsSpeedDifferenceSquaredOverTwiceTheGap) {
  struct Case {
    double follower_speed, leader_speed, gap;
  };
  for (const Case& c : {Case{20.0, 10.0, 25.0}, Case{12.0, 0.0, 18.0}, Case{14.0, 13.0, 2.0}}) {
    const double closing = c.follower_speed - c.leader_speed;
    const double expected = closing * closing / (2.0 * c.gap);
    const MovingBox follower = Box(0.0, 0.0, 0.0, c.follower_speed, 5.0, 1.8);
    const MovingBox leader = Box(c.gap + 4.0, 0.0, 0.0, c.leader_speed, 4.0, 1.8);
    EXPECT_NEAR(Drac(follower, leader), expected, 1e-9);
    EXPECT_NEAR(Drac(leader, follower), expected, 1e-9);
  }
}

// East at 10 m/s, 5 m x 2 m, front 20 m before the crossing's middle; north at 8 m/s, 4 m x 1.8 m. They share
// the square |x| <= 0.9, |y| <= 1. East is in it from (20 - 0.9) / 10 = 1.91 s to (20 + 0.9 + 5) / 10 = 2.59
// s.
MovingBox East() {
  return Box(-20.0, 0.0, 0.0, 10.0, 5.0, 2.0);
}

TEST(ConflictGeometry, DracOfACrossingIsTheMilderOfBothWaysToBrake) {
  // North's front 17 m before the middle: in it from (17 - 1) / 8 = 2 s to (17 + 1 + 4) / 8 = 2.75 s.
  // North waits for 2.59 s: 2 * 8 * (2.59 - 2) / 2.59^2 = 1.40725; east for 2.75 s: 2 * 10 * (2.75 - 1.91) /
  // 2.75^2 = 2.22149.
  EXPECT_NEAR(Drac(East(), Box(0.0, -17.0, kNorth, 8.0, 4.0, 1.8)), 16.0 * 0.59 / (2.59 * 2.59), 1e-9);
}

TEST(ConflictGeometry, WhoHasToStandBeforeTheOtherIsGoneBrakesForTheDistance) {
  // East is a train of 100 m: until (20 + 0.9 + 100) / 10 = 12.09 s. North has 16 m to stop in: 8^2 / (2 *
  // 16) = 2. The train could let north pass too: it is in the square from 1.91 s, north until 2.75 s,
  // so 2.22149 for it.
  EXPECT_NEAR(Drac(Box(-20.0, 0.0, 0.0, 10.0, 100.0, 2.0), Box(0.0, -17.0, kNorth, 8.0, 4.0, 1.8)), 2.0,
              1e-9);
}

TEST(ConflictGeometry, NoBrakingHelpsAgainstOneWhoDrivesIntoYou) {
  EXPECT_EQ(Drac(Box(0.0, 0.0, 0.0, 10.0, 5.0, 2.0), Box(30.0, 0.0, std::numbers::pi, 10.0, 5.0, 2.0)), -1.0);
}

TEST(ConflictGeometry, TimeGapOfACrossingIsEntryMinusExit) {
  // North's front 33 m before the middle enters at (33 - 1) / 8 = 4 s: 4 - 2.59 = 1.41 s after east has left.
  const MovingBox north = Box(0.0, -33.0, kNorth, 8.0, 4.0, 1.8);
  const ConflictRegion region = FindConflictRegion(East(), north, kSeen, kSeen);
  const ConflictRegion::Corner soonest = SoonestAfter(region);
  EXPECT_NEAR(soonest.b - soonest.a, 1.41, 1e-9);
  EXPECT_NEAR(soonest.b, 4.0, 1e-9);
  EXPECT_NEAR(soonest.a, 2.59, 1e-9);
}

TEST(ConflictGeometry, ParallelLanesNeverMeet) {
  EXPECT_TRUE(
      FindConflictRegion(Box(0.0, 0.0, 0.0, 10.0, 5.0, 1.8), Box(30.0, 3.2, 0.0, 5.0, 5.0, 1.8), kSeen, kSeen)
          .empty());
}

TEST(ModifiedTimeToCollision, SolvesTheQuadratic) {
  EXPECT_NEAR(*ModifiedTimeToCollision(18.0, 12.0, 0.0), 1.5, 1e-9);   // Without acceleration: TTC.
  EXPECT_NEAR(*ModifiedTimeToCollision(18.0, 12.0, -3.0), 2.0, 1e-9);  // 12 * 2 - 1.5 * 4 = 18.
  EXPECT_NEAR(*ModifiedTimeToCollision(16.0, 0.0, 2.0), 4.0, 1e-9);    // Equal speeds, the leader brakes.
  EXPECT_NEAR(*ModifiedTimeToCollision(6.0, -1.0, 4.0), 2.0, 1e-9);    // Falling back at first: -2 + 8 = 6.
  EXPECT_FALSE(ModifiedTimeToCollision(18.0, 12.0, -5.0));             // Stops 3.6 m short.
  EXPECT_FALSE(ModifiedTimeToCollision(18.0, -1.0, 0.0));
}

}  // namespace
}  // namespace lanewise
