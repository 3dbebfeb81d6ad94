#include "agents/coordination/green_advice.h"

#include <gtest/gtest.h>

#include <cmath>

#include "agents/coordination/signal_timing.h"

namespace lanewise {
namespace {

/// 20 s green, 3 s yellow, 37 s red for link 0; link 1 is green in the meantime. Now: `phase`, for
/// `to_switch` s more.
SignalTiming TwoStages(std::int32_t phase, double to_switch) {
  return {true,
          {{20.0, "Gr"}, {3.0, "yr"}, {2.0, "rr"}, {30.0, "rg"}, {3.0, "ry"}, {2.0, "rr"}},
          phase,
          to_switch};
}

TEST(SignalTiming, TheNextGreenIsFoundAroundTheCycle) {
  // Green now, for 12 s more; the next one 60 s - 8 s from now.
  const SignalTiming timing = TwoStages(0, 12.0);
  const auto now = NextGreen(timing, 0, 5.0);
  ASSERT_TRUE(now);
  EXPECT_DOUBLE_EQ(now->begin, 0.0);
  EXPECT_DOUBLE_EQ(now->end, 12.0);
  const auto next = NextGreen(timing, 0, 12.0);
  ASSERT_TRUE(next);
  EXPECT_DOUBLE_EQ(next->begin, 52.0);
  EXPECT_DOUBLE_EQ(next->end, 72.0);
  const auto other = NextGreen(timing, 1, 0.0);
  ASSERT_TRUE(other);
  EXPECT_DOUBLE_EQ(other->begin, 17.0);  // 12 + 3 + 2.
  EXPECT_DOUBLE_EQ(other->end, 47.0);
}

TEST(SignalTiming, AGreenOverSeveralPhasesIsOne) {
  const SignalTiming timing{true, {{10.0, "G"}, {5.0, "g"}, {3.0, "y"}, {22.0, "r"}}, 3, 4.0};
  const auto green = NextGreen(timing, 0, 0.0);
  ASSERT_TRUE(green);
  EXPECT_DOUBLE_EQ(green->begin, 4.0);
  EXPECT_DOUBLE_EQ(green->end, 19.0);
}

TEST(SignalTiming, WhatCannotBeForeseenIsNot) {
  SignalTiming timing = TwoStages(0, 12.0);
  EXPECT_FALSE(NextGreen(timing, 7, 0.0));  // No such link.
  timing.fixed = false;
  EXPECT_FALSE(NextGreen(timing, 0, 0.0));
}

/// 2 s from car to car, 2 s after a green begins, 1 s before it ends.
AdviceParams TwoSeconds() {
  AdviceParams params;
  params.headway = params.start_delay = 2.0;
  params.green_margin = 1.0;
  return params;
}

TEST(GreenAdvice, WhoCanPassInTheGreenDoes) {
  const AdviceParams params = TwoSeconds();
  EXPECT_DOUBLE_EQ(*PassingTime(params, TwoStages(0, 12.0), 0, 8.0, -1.0), 8.0);
}

TEST(GreenAdvice, WhoComesLatePassesAtTheNextGreenAndItsStartUpDelay) {
  const AdviceParams params = TwoSeconds();
  // 11.5 s is within the last second of the green: margin 1 s. The next begins in 52 s.
  EXPECT_DOUBLE_EQ(*PassingTime(params, TwoStages(0, 12.0), 0, 11.5, -1.0), 54.0);
  EXPECT_DOUBLE_EQ(*PassingTime(params, TwoStages(0, 12.0), 0, 60.0, -1.0), 60.0);
}

// Green ends in 12 s, yellow lasts 3 s: 0.9 s into it counts as passed with a margin of -1 s, 1.1 s does not.
TEST(GreenAdvice, ANegativeMarginUsesTheYellow) {
  AdviceParams params = TwoSeconds();
  params.green_margin = -1.0;
  EXPECT_DOUBLE_EQ(*PassingTime(params, TwoStages(0, 12.0), 0, 12.9, -1.0), 12.9);
  EXPECT_DOUBLE_EQ(*PassingTime(params, TwoStages(0, 12.0), 0, 13.1, -1.0), 54.0);
  // Behind one that passes at 11 s, at 13 s: the last that does not count as passed.
  EXPECT_DOUBLE_EQ(*PassingTime(params, TwoStages(0, 12.0), 0, 5.0, 11.0), 54.0);
  EXPECT_DOUBLE_EQ(*PassingTime(params, TwoStages(0, 12.0), 0, 5.0, 10.5), 12.5);
}

TEST(GreenAdvice, AQueuePassesHeadwayByHeadway) {
  const AdviceParams params = TwoSeconds();
  const SignalTiming red = TwoStages(2, 2.0);  // Green for link 0 begins in 2 + 30 + 3 + 2 = 37 s.
  double ahead = -1.0;
  for (int k = 0; k < 9; ++k) {
    ahead = *PassingTime(params, red, 0, 1.0, ahead);
    EXPECT_DOUBLE_EQ(ahead, 39.0 + 2.0 * k);
  }
  // The tenth would pass at 57 s, the end of the green: next cycle.
  EXPECT_DOUBLE_EQ(*PassingTime(params, red, 0, 1.0, ahead), 99.0);
}

TEST(GreenAdvice, ALinkThatIsNeverGreenHasNoPassingTime) {
  EXPECT_FALSE(PassingTime(TwoSeconds(), {true, {{10.0, "r"}, {3.0, "r"}}, 0, 5.0}, 0, 1.0, -1.0));
  // Nor one whose greens are shorter than delay and margin.
  EXPECT_FALSE(PassingTime(TwoSeconds(), {true, {{2.5, "G"}, {3.0, "y"}}, 1, 1.0}, 0, 0.5, -1.0));
}

TEST(GreenAdvice, TimeToReachByHand) {
  EXPECT_DOUBLE_EQ(TimeToReach(100.0, 10.0, 10.0, 2.0), 10.0);
  // From 0 at 2 m/s^2 to 10 m/s: 5 s and 25 m; the other 75 m in 7.5 s.
  EXPECT_DOUBLE_EQ(TimeToReach(100.0, 0.0, 10.0, 2.0), 12.5);
  // 16 m from standstill at 2 m/s^2: 4 s.
  EXPECT_DOUBLE_EQ(TimeToReach(16.0, 0.0, 10.0, 2.0), 4.0);
}

TEST(GreenAdvice, SpeedToArriveByHand) {
  // From 14 to 10 m/s at 1 m/s^2: 4 s and 48 m; then 152 m at 10 m/s: 15.2 s. Together 200 m in 19.2 s.
  EXPECT_NEAR(SpeedToArrive(200.0, 14.0, 19.2, 1.0), 10.0, 1e-9);
  // There is time to spare even at the present speed: faster.
  EXPECT_DOUBLE_EQ(SpeedToArrive(100.0, 10.0, 8.0, 1.0), 12.5);
  // Braking at 1 m/s^2 from 14 m/s takes 98 m: within 60 m no speed arrives later than that.
  EXPECT_DOUBLE_EQ(SpeedToArrive(60.0, 14.0, 30.0, 1.0), 0.0);
}

TEST(GreenAdvice, SpeedToArriveSolvesItsEquation) {
  for (const double distance : {80.0, 150.0, 300.0}) {
    for (const double time : {15.0, 30.0, 70.0}) {
      const double v = SpeedToArrive(distance, 10.0, time, 1.0);
      if (v == 0.0 || v > 10.0) continue;
      EXPECT_NEAR((100.0 - v * v) / 2.0 + v * (time - (10.0 - v)), distance, 1e-9);
    }
  }
}

}  // namespace
}  // namespace lanewise
