#include "agents/vehicle/kinematic_bicycle.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace lanewise {
namespace {

constexpr double kWheelbase = 2.8, kRearToFront = 3.9;  // [m]

// Our reference point lies l_r ahead of the rear axle, which circles with radius L / tan(delta). So the
// point's radius is the hypotenuse of both; [C]'s yaw equation says l_r / sin(beta). They must be the same
// circle.
TEST(KinematicBicycle, SlipAngleGivesTheGeometricTurningRadius) {
  for (const double delta : {-0.6, -0.05, 0.01, 0.3, 0.7}) {
    const double beta = SlipAngle(delta, kWheelbase, kRearToFront);
    const double rear_radius = kWheelbase / std::tan(delta);
    EXPECT_NEAR(kRearToFront / std::abs(std::sin(beta)), std::hypot(rear_radius, kRearToFront), 1e-9);
    EXPECT_EQ(std::signbit(beta), std::signbit(delta));
    EXPECT_NEAR(SteeringAngle(beta, kWheelbase, kRearToFront), delta, 1e-12);
  }
}

// With heading -beta the course points east: the circle's centre is (0, R), a quarter turn ends at (R, R).
TEST(KinematicBicycle, QuarterCircleMatchesClosedForm) {
  const double beta = SlipAngle(0.1, kWheelbase, kRearToFront);
  const double radius = kRearToFront / std::sin(beta), v = 10.0;
  const int steps = 20000;
  const double dt = 0.5 * std::numbers::pi * radius / v / steps;
  Pose2 pose{0.0, 0.0, -beta};
  double speed = v;
  for (int k = 0; k < steps; ++k) StepBicycle(0.0, beta, kRearToFront, dt, &pose, &speed);
  // Explicit Euler turns each chord late by half a step's angle: error = chord * pi / (4 steps)
  // = 28.3 m * 1.41 * 3.9e-5 = 1.6 mm.
  EXPECT_NEAR(pose.x, radius, 2e-3);
  EXPECT_NEAR(pose.y, radius, 2e-3);
  EXPECT_NEAR(pose.heading + beta, 0.5 * std::numbers::pi, 1e-9);
  EXPECT_DOUBLE_EQ(speed, v);
}

// Semi-implicit: after n steps v = v0 + a n dt, and the way is the sum of the new speeds.
TEST(KinematicBicycle, AcceleratesLikeSumosEulerUpdate) {
  Pose2 pose{};
  double speed = 2.0;
  for (int k = 0; k < 10; ++k) StepBicycle(1.5, 0.0, kRearToFront, 0.1, &pose, &speed);
  EXPECT_NEAR(speed, 3.5, 1e-12);
  EXPECT_NEAR(pose.x, 10 * 0.1 * 2.0 + 1.5 * 0.01 * (10 * 11 / 2), 1e-12);
}

/// World pose of a road pose on a circular path of this curvature that starts eastward at the origin.
Pose2 OnCircle(const RoadPose& road, double curvature) {
  const double angle = road.s * curvature, radius = 1.0 / curvature;
  return {radius * std::sin(angle) - road.d * std::sin(angle),
          radius * (1.0 - std::cos(angle)) + road.d * std::cos(angle), angle + road.heading_error};
}

// The same drive (changing speed and steering) in both frames.
TEST(KinematicBicycle, OnRoadEqualsInWorldOnACurvedPath) {
  for (const double curvature : {-0.02, 0.005, 0.05}) {
    Pose2 world{0.0, 0.5, 0.05};
    RoadPose road{0.0, 0.5, 0.05};
    double world_speed = 5.0, road_speed = 5.0, driven = 0.0;
    const double dt = 1e-4;
    for (int k = 0; k < 60000; ++k) {
      const double t = k * dt;
      const double accel = std::sin(t);
      // Around the path's own slip angle, so the drive stays near it.
      const double slip = std::asin(kRearToFront * curvature) + 0.05 * std::sin(0.9 * t);
      StepBicycle(accel, slip, kRearToFront, dt, &world, &world_speed);
      driven += StepBicycleOnRoad(accel, slip, kRearToFront, curvature, dt, &road, &road_speed);
    }
    const Pose2 expected = OnCircle(road, curvature);
    // First-order scheme: about 40 m driven at an error of some dt * v each: millimetres.
    EXPECT_NEAR(world.x, expected.x, 5e-3) << curvature;
    EXPECT_NEAR(world.y, expected.y, 5e-3) << curvature;
    EXPECT_NEAR(world.heading, expected.heading, 1e-3) << curvature;
    EXPECT_EQ(world_speed, road_speed);
    EXPECT_DOUBLE_EQ(driven, road.s);
    EXPECT_GT(road.s, 20.0);
  }
}

TEST(KinematicBicycle, SpeedIsNeverNegative) {
  Pose2 world{};
  RoadPose road{};
  double world_speed = 1.0, road_speed = 1.0;
  for (int k = 0; k < 10; ++k) {
    StepBicycle(-9.0, 0.2, kRearToFront, 0.1, &world, &world_speed);
    const double progress = StepBicycleOnRoad(-9.0, 0.2, kRearToFront, 0.01, 0.1, &road, &road_speed);
    EXPECT_GE(world_speed, 0.0);
    EXPECT_GE(road_speed, 0.0);
    EXPECT_GE(progress, 0.0);
  }
  EXPECT_EQ(world_speed, 0.0);
  EXPECT_EQ(road_speed, 0.0);
  // 1 - 0.9 = 0.1 m/s for one step, then it stands: 0.01 m driven.
  EXPECT_NEAR(std::hypot(world.x, world.y), 0.01, 1e-9);
}

}  // namespace
}  // namespace lanewise
