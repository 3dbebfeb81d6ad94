#include "agents/coordination/signal_adaptation.h"

#include <gtest/gtest.h>

namespace lanewise {
namespace {

// Cycle 60 s: link 0, then link 1.
const std::vector<SignalPhase> kProgram = {{25.0, "Gr"}, {3.0, "yr"}, {2.0, "rr"},
                                           {25.0, "rG"}, {3.0, "ry"}, {2.0, "rr"}};
const std::vector<double> kDurations = {25, 3, 2, 25, 3, 2};
const std::vector<double> kMinimum = {5, 3, 2, 5, 3, 2};

LaneDemand Lane(std::int32_t link, double rate, double queue = 0.0) {
  return {0, {link}, std::vector<double>(60, rate), queue};
}

TEST(SignalAdaptation, DelayOfOneQueueByHand) {
  AdviceParams flow;
  flow.headway = 2.0;
  flow.start_delay = 0.0;
  // Three vehicles wait at green: half a vehicle leaves a second. After k s 3 - k / 2 stand: 2.5 + 2 + ... +
  // 0.5 = 7.5.
  const std::vector<LaneDemand> waiting = {Lane(0, 0.0, 3.0)};
  EXPECT_DOUBLE_EQ(PredictDelay(flow, kProgram, kDurations, kDurations, waiting, 0.0, 30.0), 7.5);
  // At red for link 1 all wait for 30 s, 90 vehicle seconds, then leave likewise.
  const std::vector<LaneDemand> red = {Lane(1, 0.0, 3.0)};
  EXPECT_DOUBLE_EQ(PredictDelay(flow, kProgram, kDurations, kDurations, red, 0.0, 60.0), 97.5);
  // A start-up delay of 2 s costs each of the three 2 s.
  flow.start_delay = 2.0;
  EXPECT_DOUBLE_EQ(PredictDelay(flow, kProgram, kDurations, kDurations, waiting, 0.0, 30.0), 13.5);
}

TEST(SignalAdaptation, LinksThatYieldLeaveAtHalfTheRate) {
  AdviceParams flow;
  flow.headway = 2.0;
  flow.start_delay = 0.0;
  std::vector<SignalPhase> phases = kProgram;
  phases[0].state = "gr";
  // 3 - k / 4 after k s: 2.75 + 2.5 + ... + 0.25 = 16.5.
  const std::vector<LaneDemand> waiting = {Lane(0, 0.0, 3.0)};
  EXPECT_DOUBLE_EQ(PredictDelay(flow, phases, kDurations, kDurations, waiting, 0.0, 25.0), 16.5);
}

TEST(SignalAdaptation, GreenGoesToTheLaneWithMoreVehicles) {
  const std::vector<LaneDemand> lanes = {Lane(0, 0.25, 2.0), Lane(1, 0.05)};
  const SignalPlan plan = ChoosePlan({}, kProgram, kMinimum, kDurations, lanes, 0.0);
  EXPECT_DOUBLE_EQ(plan.base[0], 29.0);
  EXPECT_DOUBLE_EQ(plan.base[3], 21.0);
}

TEST(SignalAdaptation, EqualDemandLeavesTheSplitAsItIs) {
  const std::vector<LaneDemand> lanes = {Lane(0, 0.1), Lane(1, 0.1)};
  const SignalPlan plan = ChoosePlan({}, kProgram, kMinimum, kDurations, lanes, 0.0);
  EXPECT_EQ(plan.base, kDurations);
}

TEST(SignalAdaptation, NoGreenFallsBelowItsMinimum) {
  std::vector<double> base = {43, 3, 2, 7, 3, 2};
  const std::vector<LaneDemand> lanes = {Lane(0, 0.4, 20.0), Lane(1, 0.0)};
  const SignalPlan plan = ChoosePlan({}, kProgram, kMinimum, base, lanes, 0.0);
  EXPECT_GE(plan.base[3], 5.0);
  EXPECT_GE(plan.next[3], 5.0);
}

TEST(SignalAdaptation, TheOffsetMovesTowardsAPlatoon) {
  // A platoon of link 0 comes from the 26th second of the cycle on, when its green has just ended: the
  // cycle's first green is stretched, so that the head of the platoon passes at once.
  LaneDemand platoon = Lane(0, 0.0);
  for (int second = 24; second < 30; ++second) platoon.arrivals[second] = 0.5;
  const SignalPlan plan =
      ChoosePlan({}, kProgram, kMinimum, kDurations, std::vector<LaneDemand>{platoon}, 0.0);
  EXPECT_GT(plan.next[0], 25.0);
  double length = 0.0;
  for (const double duration : plan.next) length += duration;
  EXPECT_LE(length, 60.0 + SignalParams{}.max_cycle_change);
}

TEST(SignalAdaptation, WithoutDemandNothingChanges) {
  const std::vector<LaneDemand> lanes = {Lane(0, 0.0), Lane(1, 0.0)};
  const SignalPlan plan = ChoosePlan({}, kProgram, kMinimum, kDurations, lanes, 17.0);
  EXPECT_EQ(plan.next, kDurations);
  EXPECT_EQ(plan.offset_change, 0.0);
}

}  // namespace
}  // namespace lanewise
