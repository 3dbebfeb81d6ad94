#include "analysis/platoon_response.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace lanewise {
namespace {

constexpr double kFrequencies[] = {0.02, 0.05, 0.1, 0.2, 0.5};  // [Hz]

AgentParams Cruising() {
  AgentParams params;
  params.v2x.cruise = 1;
  return params;
}

double LargestGain(const PlatoonResponse& response) {
  return *std::max_element(response.gain.begin(), response.gain.end());
}

TEST(Platoon, IsStringStableAtShortGaps) {
  for (const double frequency : kFrequencies) {
    const PlatoonResponse response = DrivePlatoon(Cruising(), {}, frequency);
    EXPECT_NEAR(response.cruise_share, 1.0, 1e-9);
    for (std::size_t k = 0; k < response.gain.size(); ++k) {
      EXPECT_LE(response.gain[k], 1.0) << frequency << " Hz, car " << k + 1;
      EXPECT_NEAR(response.time_gap[k], 0.6, 0.02) << frequency << " Hz, car " << k + 1;
    }
  }
}

TEST(Platoon, IsStringStableOverALossyChannel) {
  for (const double frequency : {0.02, 0.05, 0.1, 0.2}) {
    const PlatoonResponse response = DrivePlatoon(Cruising(), {.level = V2xLevel::kLossy}, frequency);
    EXPECT_GT(response.cruise_share, 0.99);
    EXPECT_LE(LargestGain(response), 1.0) << frequency << " Hz";
  }
}

TEST(Platoon, WithoutMessagesFollowsAsADriver) {
  AgentParams lost = Cruising();
  lost.v2x.loss = 1.0;
  const PlatoonResponse deaf = DrivePlatoon(lost, {.cars = 3, .level = V2xLevel::kLossy}, 0.1);
  const PlatoonResponse off = DrivePlatoon({}, {.cars = 3, .level = V2xLevel::kOff}, 0.1);
  EXPECT_EQ(deaf.cruise_share, 0.0);
  EXPECT_EQ(deaf.speed, off.speed) << "to the last bit";
  for (const double gap : deaf.time_gap) EXPECT_NEAR(gap, 1.0, 0.1);
}

}  // namespace
}  // namespace lanewise
