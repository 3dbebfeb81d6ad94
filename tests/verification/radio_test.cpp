#include "agents/v2x/radio.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace lanewise {
namespace {

// P(X > x) of a Gamma(3, 1/3) variable X, the power over its mean under Nakagami fading with m = 3, by
// Simpson's rule.
double PowerExceeds(double x) {
  const auto density = [](double p) { return 27.0 / 2.0 * p * p * std::exp(-3.0 * p); };
  const int n = 20000;
  const double h = (30.0 - x) / n;
  double sum = density(x) + density(30.0);
  for (int k = 1; k < n; ++k) sum += (k % 2 == 1 ? 4.0 : 2.0) * density(x + k * h);
  return sum * h / 3.0;
}

TEST(Radio, FadingIsThatOfNakagamiPower) {
  EXPECT_DOUBLE_EQ(FadingReception(0.0), 1.0);
  for (const double ratio2 : {0.05, 0.25, 0.5625, 1.0, 2.0})
    EXPECT_NEAR(FadingReception(ratio2), PowerExceeds(ratio2), 1e-6) << ratio2;
}

TEST(Radio, HiddenStationsAreTheCrescent) {
  EXPECT_NEAR(HiddenShare(0.0, 450.0), 0.0, 1e-12);
  EXPECT_NEAR(HiddenShare(900.0, 450.0), 1.0, 1e-12);
  // Two circles through each other's centres overlap in 2/3 - sqrt(3) / (2 pi) of one of them.
  EXPECT_NEAR(HiddenShare(450.0, 450.0), 1.0 / 3.0 + std::sqrt(3.0) / (2.0 * std::numbers::pi), 1e-12);
}

TEST(Radio, CollisionFreeIsAloha) {
  EXPECT_DOUBLE_EQ(CollisionFree(0.0, 1.0), 1.0);
  EXPECT_DOUBLE_EQ(CollisionFree(0.5, 0.0), 1.0);
  // Pure ALOHA at load 1/2: throughput 1 / (2 e), so a share of 1 / e gets through.
  EXPECT_NEAR(CollisionFree(0.5, 1.0), 1.0 / std::numbers::e, 1e-12);
}

TEST(Radio, AirtimeCountsSymbols) {
  // 350 bytes at 6 Mbit/s: 2822 bits in 59 symbols of 48 bits, 472 us after 40 us of preamble and signal.
  EXPECT_NEAR(Airtime(350.0, 6e6), 512e-6, 1e-9);
  // One byte more than fits takes a symbol more.
  EXPECT_NEAR(Airtime(351.0, 6e6) - Airtime(350.0, 6e6), 0.0, 1e-12);
  EXPECT_NEAR(Airtime(352.0, 6e6) - Airtime(351.0, 6e6), 8e-6, 1e-12);
}

}  // namespace
}  // namespace lanewise
