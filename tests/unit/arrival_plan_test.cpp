#include "agents/coordination/arrival_plan.h"

#include <gtest/gtest.h>

#include <cmath>

namespace lanewise {
namespace {

Arrival At(double distance, double speed) {
  return {distance, speed, 10.0, 10.0, 0.0};
}

TEST(EarliestArrival, FollowsFromTheProfile) {
  EXPECT_NEAR(EarliestArrival(At(100.0, 10.0)), 10.0, 1e-9);
  // From rest at 1.5 m/s^2: 48 m and 8 s to 12 m/s; 12 m are enough for 6 m/s.
  const Arrival rest{48.0, 0.0, 12.0, 12.0, 0.0}, near{12.0, 0.0, 12.0, 12.0, 0.0};
  EXPECT_NEAR(EarliestArrival(rest), 8.0, 1e-9);
  EXPECT_NEAR(LineSpeed(rest), 12.0, 1e-9);
  EXPECT_NEAR(EarliestArrival(near), 4.0, 1e-9);
  EXPECT_NEAR(LineSpeed(near), 6.0, 1e-9);
  // Before a bend: 60 m at 12 m/s, then 2 s and 18 m down to 6 m/s at 3 m/s^2.
  EXPECT_NEAR(EarliestArrival({78.0, 12.0, 12.0, 6.0, 0.0}), 7.0, 1e-9);
  // Without a limit it speeds up from 6 to 10 m/s in 2.67 s and slows down again in 1.33 s.
  EXPECT_NEAR(EarliestArrival({32.0, 6.0, 50.0, 6.0, 0.0}), 4.0, 1e-9);
  // Too fast for the bend: it passes the line at the speed that braking leaves.
  const Arrival fast{8.0, 10.0, 10.0, 2.0, 0.0};
  EXPECT_NEAR(LineSpeed(fast), std::sqrt(100.0 - 48.0), 1e-9);
  EXPECT_NEAR(EarliestArrival(fast), 16.0 / (10.0 + std::sqrt(52.0)), 1e-9);
}

// At 5 m/s: 12.5 m and 1.67 s to slow down, 25 m and 3.33 s to speed up, 62.5 m and 12.5 s between them.
TEST(CruiseToArrive, LeavesTheRunUp) {
  EXPECT_NEAR(CruiseToArrive(At(100.0, 10.0), 17.5), 5.0, 0.01);
  EXPECT_DOUBLE_EQ(CruiseToArrive(At(100.0, 10.0), 9.0), 10.0);  // Late already: as fast as it may.
  // 5 m before the line it cannot come back to 10 m/s: down to u, and up again over the line.
  const double u = CruiseToArrive(At(5.0, 4.0), 2.5);
  const double line = std::sqrt(u * u + 2.0 * kProfileAccel * (5.0 - (16.0 - u * u) / (2.0 * kProfileDecel)));
  EXPECT_NEAR((4.0 - u) / kProfileDecel + (line - u) / kProfileAccel, 2.5, 0.05);
  EXPECT_LE(CruiseToArrive(At(5.0, 4.0), 60.0), 5.0 / 60.0);
}

TEST(PlanArrivals, WhoIsAloneDrivesOnAsItLikes) {
  const Arrival alone[] = {At(100.0, 10.0)};
  const auto times = PlanArrivals(alone, {});
  ASSERT_EQ(times.size(), 1u);
  EXPECT_NEAR(times[0], 10.0, 1e-9);
  EXPECT_TRUE(PlanArrivals({}, {}).empty());
}

// Two that would be there at once: the first keeps its speed, the second loses the separation.
TEST(PlanArrivals, TheSecondMakesRoom) {
  const Arrival both[] = {At(100.0, 10.0), At(100.0, 10.0)};
  const Separation apart[] = {{0, 1, 2.0}};
  const auto times = PlanArrivals(both, apart);
  EXPECT_NEAR(times[0], 10.0, 0.05);
  EXPECT_GE(times[1], times[0] + 2.0 - 1e-9);
  EXPECT_NEAR(times[1], 12.0, 0.05);
}

TEST(PlanArrivals, NobodyComesBeforeItMay) {
  Arrival arrivals[] = {At(100.0, 10.0), At(120.0, 10.0)};
  arrivals[0].not_before = 13.0;
  const Separation apart[] = {{0, 1, 1.5}};
  const auto times = PlanArrivals(arrivals, apart);
  EXPECT_NEAR(times[0], 13.0, 0.05);
  EXPECT_NEAR(times[1], 14.5, 0.1);
}

TEST(PlanArrivals, AChainOfSeparationsHolds) {
  std::vector<Arrival> arrivals;
  std::vector<Separation> separations;
  for (int k = 0; k < 12; ++k) {
    arrivals.push_back(At(60.0 + 5.0 * k, 10.0));
    for (int i = 0; i < k; ++i) {
      if ((k - i) % 2 == 1) separations.push_back({i, k, 1.5});
    }
  }
  const auto first = FirstTimes(arrivals, separations);
  const auto times = PlanArrivals(arrivals, separations);
  for (const Separation& s : separations) {
    EXPECT_GE(times[static_cast<std::size_t>(s.second)],
              times[static_cast<std::size_t>(s.first)] + 1.5 - 1e-9);
  }
  for (std::size_t k = 0; k < times.size(); ++k) {
    EXPECT_GE(times[k], EarliestArrival(arrivals[k]) - 1e-9);
    EXPECT_NEAR(times[k], first[k], 0.5);  // Comfort costs little.
  }
}

}  // namespace
}  // namespace lanewise
