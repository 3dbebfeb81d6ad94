#include "agents/planning/car_following.h"

#include <gtest/gtest.h>

#include <cmath>

namespace lanewise {
namespace {

// The safe speed is the one at which both stopping distances are equal: v t + v^2 / 2b = gap + v_l^2 / 2b.
TEST(SafeSpeed, MakesTheStoppingDistancesEqual) {
  for (const double gap : {0.5, 10.0, 80.0}) {
    for (const double leader : {0.0, 5.0, 25.0}) {
      for (const double reaction : {0.1, 1.0}) {
        const double b = 4.5, v = SafeSpeed(gap, leader, b, reaction);
        EXPECT_NEAR(v * reaction + v * v / (2.0 * b), gap + leader * leader / (2.0 * b), 1e-9);
      }
    }
  }
}

TEST(SafeSpeed, WorkedExamples) {
  // b t = 4.5; 40 m to a wall: sqrt(20.25 + 360) - 4.5 = 15.0.
  EXPECT_NEAR(SafeSpeed(40.0, 0.0, 4.5, 1.0), 15.0, 1e-12);
  EXPECT_EQ(SafeSpeed(0.0, 0.0, 4.5, 1.0), 0.0);
  EXPECT_EQ(SafeSpeed(-100.0, 3.0, 4.5, 1.0), 0.0);  // The root would be imaginary.
}

// Driving the safe speed in discrete steps of `reaction` behind a wall never reaches it.
TEST(SafeSpeed, DrivenStepByStepStopsBeforeTheWall) {
  double gap = 60.0, v = 13.9;
  for (int k = 0; k < 200; ++k) {
    const double safe = SafeSpeed(gap, 0.0, 4.5, 0.1);
    EXPECT_GE(safe, v - 4.5 * 0.1 - 1e-9) << "asks for more than b";
    v = std::min(safe, 13.9);
    gap -= v * 0.1;
    ASSERT_GE(gap, -1e-9);  // Rounding.
  }
  EXPECT_LT(gap, 0.5);
}

TEST(BrakingSpeed, ComesDownToTheTargetOverTheDistance) {
  EXPECT_NEAR(BrakingSpeed(30.0, 8.0, 3.0), std::sqrt(64.0 + 180.0), 1e-12);  // v^2 = v_t^2 + 2 b d.
  EXPECT_EQ(BrakingSpeed(0.0, 8.0, 3.0), 8.0);
  EXPECT_EQ(BrakingSpeed(-5.0, 8.0, 3.0), 8.0);
}

constexpr double kInfinity = 1e12;

// Standing on a free road: the acceleration is a; at the wanted speed it is 0.
TEST(Idm, FreeAcceleration) {
  EXPECT_NEAR(IdmAccel(0.0, 14.0, kInfinity, 14.0, 2.6, 3.0, 1.0, 2.5), 2.6, 1e-9);
  EXPECT_NEAR(IdmAccel(14.0, 14.0, kInfinity, 14.0, 2.6, 3.0, 1.0, 2.5), 0.0, 1e-9);
  // Half the wanted speed: a (1 - 1/16).
  EXPECT_NEAR(IdmAccel(7.0, 14.0, kInfinity, 14.0, 2.6, 3.0, 1.0, 2.5), 2.6 * 15.0 / 16.0, 1e-9);
}

// Treiber et al. 2000, Eq. (4): s_e(v) = (s0 + v T) / sqrt(1 - (v / v0)^4).
TEST(Idm, EquilibriumGap) {
  for (const double v : {0.0, 3.0, 10.0, 13.0}) {
    const double gap = (2.5 + v * 1.2) / std::sqrt(1.0 - std::pow(v / 14.0, 4));
    EXPECT_NEAR(IdmAccel(v, 14.0, gap, v, 2.6, 3.0, 1.2, 2.5), 0.0, 1e-9) << v;
    EXPECT_LT(IdmAccel(v, 14.0, gap - 0.5, v, 2.6, 3.0, 1.2, 2.5), 0.0) << v;
    EXPECT_GT(IdmAccel(v, 14.0, gap + 0.5, v, 2.6, 3.0, 1.2, 2.5), 0.0) << v;
  }
}

// v = 10, v_l = 5, gap 20: s* = 2.5 + 10 * 1.2 + 10 * 5 / (2 sqrt(2.6 * 3)) = 14.5 + 8.9514 = 23.4514;
// a (1 - (10 / 14)^4 - (23.4514 / 20)^2) = 2.6 (1 - 0.260308 - 1.374920) = -1.6516.
TEST(Idm, ApproachWorkedByHand) {
  EXPECT_NEAR(IdmAccel(10.0, 14.0, 20.0, 5.0, 2.6, 3.0, 1.2, 2.5), -1.6516, 1e-3);
}

}  // namespace
}  // namespace lanewise
