#include "agents/coordination/arrival_plan.h"

#include <gtest/gtest.h>

namespace lanewise {
namespace {

Arrival At(double distance, double speed) {
  return {distance, speed, 10.0, 10.0, distance / 10.0};
}

TEST(PlanArrivals, WhoIsAloneDrivesOnAsItLikes) {
  const Arrival alone[] = {At(100.0, 10.0)};
  const auto times = PlanArrivals(alone, {});
  ASSERT_EQ(times.size(), 1u);
  EXPECT_NEAR(times[0], 10.0, 1e-3);
  EXPECT_TRUE(PlanArrivals({}, {}).empty());
}

// Two that would be there at once: the first keeps its speed, the second loses the separation.
TEST(PlanArrivals, TheSecondMakesRoom) {
  const Arrival both[] = {At(100.0, 10.0), At(100.0, 10.0)};
  const Separation apart[] = {{0, 1, 2.0}};
  const auto times = PlanArrivals(both, apart);
  EXPECT_NEAR(times[0], 10.0, 0.1);
  EXPECT_GE(times[1], times[0] + 2.0 - 1e-9);
  EXPECT_NEAR(times[1], 12.0, 0.1);
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
  const auto times = PlanArrivals(arrivals, separations);
  for (const Separation& s : separations) {
    EXPECT_GE(times[static_cast<std::size_t>(s.second)], times[static_cast<std::size_t>(s.first)] + 1.5 - 1e-9);
  }
  for (std::size_t k = 0; k < times.size(); ++k) EXPECT_GE(times[k], arrivals[k].earliest - 1e-9);
}

// 100 m in 12 s, passing at 10 m/s: u for (100 - (100 - u^2) / 3) / u + (10 - u) / 1.5 = 12.
TEST(SpeedToPass, LeavesTheRunUp) {
  const double u = SpeedToPass(100.0, 12.0, 10.0, 10.0);
  EXPECT_NEAR((100.0 - (100.0 - u * u) / 3.0) / u + (10.0 - u) / 1.5, 12.0, 1e-5);
  EXPECT_LT(u, 100.0 / 12.0);
  EXPECT_DOUBLE_EQ(SpeedToPass(100.0, 9.0, 10.0, 10.0), 10.0);  // Late already.
  // 5 m before the line there is no room to speed up from 4 m/s: at the mean speed, then.
  EXPECT_NEAR(SpeedToPass(5.0, 2.5, 10.0, 10.0), 2.0, 1e-9);
}

}  // namespace
}  // namespace lanewise
