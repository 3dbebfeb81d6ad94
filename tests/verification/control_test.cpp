#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "agents/control/pid.h"
#include "agents/planning/dwa.h"

namespace lanewise {
namespace {

// [C]: period 30 ms, 30 m/s, 5 m/s^2.
TEST(DynamicWindow, ReachableSpeedsOfTheReport) {
  const DynamicWindow window = ReachableSpeeds(30.0, 5.0, 5.0, 0.03);
  EXPECT_NEAR(window.min, 29.85, 1e-12);
  EXPECT_NEAR(window.max, 30.15, 1e-12);
}

TEST(DynamicWindow, BrakingAndAccelerationDifferAndSpeedIsNeverNegative) {
  const DynamicWindow slow = ReachableSpeeds(0.2, 4.5, 2.6, 0.1);  // 0.2 - 0.45 < 0.
  EXPECT_EQ(slow.min, 0.0);
  EXPECT_NEAR(slow.max, 0.46, 1e-12);
  EXPECT_EQ(ReachableSpeeds(0.0, 9.0, 0.0, 1.0).max, 0.0);
}

TEST(DynamicWindow, SteeringFollowsTheRateWithinTheLimit) {
  const DynamicWindow middle = ReachableSteering(0.1, 1.2, 0.7, 0.1);  // +- 0.12 rad in 0.1 s.
  EXPECT_NEAR(middle.min, -0.02, 1e-12);
  EXPECT_NEAR(middle.max, 0.22, 1e-12);
  EXPECT_EQ(ReachableSteering(0.65, 1.2, 0.7, 0.1).max, 0.7);
  EXPECT_EQ(ReachableSteering(-0.65, 1.2, 0.7, 0.1).min, -0.7);
}

/// [C]'s example: a car at 60 km/h is to go 50. The powertrain follows its command with a first-order lag:
/// a' = (u - a) / lag, v' = a + disturbance (a slope).
struct CarAtSpeed {
  double lag{1.0};          // [s]
  double disturbance{0.0};  // [m/s^2]
  double speed{60.0 / 3.6}, accel{0.0};

  void Step(double command, double dt) {
    accel += dt / lag * (command - accel);
    speed += (accel + disturbance) * dt;
  }
};

struct Response {
  int crossings{0};         // Of the wanted speed.
  double lowest{1e9};       // [km/h]
  double final_error{0.0};  // [m/s] wanted minus real.
};

Response SlowDownTo50(const PidGains& gains, double disturbance) {
  const double dt = 0.001, wanted = 50.0 / 3.6;
  CarAtSpeed car;
  car.disturbance = disturbance;
  PidState pid;
  Response response;
  double last_error = wanted - car.speed;
  for (int k = 0; k < 60000; ++k) {
    const double error = wanted - car.speed;
    // A crossing counts when it goes on to more than 0.1 km/h; rounding around the aim does not.
    if (error * last_error < 0.0 && std::abs(error) > 0.1 / 3.6) {
      ++response.crossings;
      last_error = error;
    } else if (std::abs(error) > 0.1 / 3.6 && error * last_error > 0.0) {
      last_error = error;
    }
    response.lowest = std::min(response.lowest, car.speed * 3.6);
    car.Step(StepPid(gains, error, dt, &pid), dt);
  }
  response.final_error = wanted - car.speed;
  return response;
}

// lag s^2 + s + kp: damping 1 / (2 sqrt(kp lag)) = 0.354 for kp = 2, so the first swing overshoots by
// exp(-pi 0.354 / sqrt(1 - 0.125)) = 0.305 of the 10 km/h step: down to 46.95 km/h; then 50.93, 49.72, ...
TEST(Pid, ProportionalAloneOscillatesOnAPlantWithLag) {
  const Response p = SlowDownTo50({2.0, 0.0, 0.0, 0.0, 1e9}, 0.0);
  EXPECT_GE(p.crossings, 3);
  EXPECT_NEAR(p.lowest, 46.95, 0.05);
}

// lag s^2 + (1 + kd) s + kp: damping 4 / (2 sqrt 2) = 1.41 for kd = 3: no overshoot. A constant slope of
// -0.5 m/s^2 needs u = 0.5 = kp e: an offset of 0.25 m/s stays.
TEST(Pid, DerivativeDampsButAnOffsetStays) {
  const Response calm = SlowDownTo50({2.0, 0.0, 3.0, 0.0, 1e9}, 0.0);
  EXPECT_EQ(calm.crossings, 0);
  EXPECT_GT(calm.lowest, 49.99);
  const Response slope = SlowDownTo50({2.0, 0.0, 3.0, 0.0, 1e9}, -0.5);
  EXPECT_NEAR(slope.final_error, 0.25, 1e-3);
}

// Routh: (1 + kd) kp = 8 > lag ki = 0.5: stable; the integral carries the slope, so no offset.
TEST(Pid, IntegralRemovesTheOffset) {
  EXPECT_NEAR(SlowDownTo50({2.0, 0.5, 3.0, 0.0, 1e9}, -0.5).final_error, 0.0, 1e-3);
}

// kp e + ki I = 0.5 + 0.1 I saturates at the limit 1 when I = 5. From there the integral stands still; wound
// up for 100 s at e = 10 it would be 1000 and hold the output at +1 for another 100 s.
TEST(Pid, AntiWindupBoundsTheIntegral) {
  const PidGains gains{0.05, 0.1, 0.0, 0.0, 1.0};
  PidState pid;
  double output = 0.0;
  for (int k = 0; k < 10000; ++k) output = StepPid(gains, 10.0, 0.01, &pid);
  EXPECT_NEAR(output, 1.0, 0.011);
  EXPECT_LE(pid.integral, 5.0 + 1e-9);
  EXPECT_GT(pid.integral, 4.8);
  EXPECT_LE(StepPid(gains, -10.0, 0.01, &pid), 0.0);  // -0.5 + 0.1 (5 - 0.1) = -0.01: answers at once.
}

// An error that alternates by +-0.1 each 10 ms has a difference quotient of +-20. The low-pass with blend
// b = dt / (T + dt) = 1 / 21 leaves an amplitude of 20 b / (2 - b) = 0.488.
TEST(Pid, DerivativeFilterAttenuatesNoise) {
  const auto swing = [](double filter) {
    const PidGains gains{0.0, 0.0, 1.0, filter, 1e9};
    PidState pid;
    double largest = 0.0;
    for (int k = 0; k < 2000; ++k) {
      const double output = StepPid(gains, k % 2 == 0 ? 0.1 : -0.1, 0.01, &pid);
      if (k > 1000) largest = std::max(largest, std::abs(output));
    }
    return largest;
  };
  EXPECT_NEAR(swing(0.0), 20.0, 1e-9);
  EXPECT_NEAR(swing(0.2), 20.0 / 41.0, 1e-6);
}

TEST(Pid, TheFirstErrorHasNoDerivative) {
  PidState pid;
  EXPECT_EQ(StepPid({0.0, 0.0, 1.0, 0.0, 1e9}, 5.0, 0.1, &pid), 0.0);
  EXPECT_NEAR(StepPid({0.0, 0.0, 1.0, 0.0, 1e9}, 6.0, 0.1, &pid), 10.0, 1e-9);
}

}  // namespace
}  // namespace lanewise
