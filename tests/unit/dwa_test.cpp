#include "agents/planning/dwa.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "agents/planning/car_following.h"
#include "agents/vehicle/kinematic_bicycle.h"
#include "tests/support/straight_view.h"

namespace lanewise {
namespace {

class DwaTest : public testing::Test {
 protected:
  DwaTest() {
    context_.vehicle = &vehicle_;
    context_.corridor_min = -0.6;
    context_.corridor_max = 0.6;
    context_.speed = 10.0;
    context_.free_speed = 13.9;
    scratch_->view = PathView(ViewHorizon(10.0));
  }
  Plan MakePlan() { return PlanDwa(params_, context_, scratch_.get()); }
  void AddObstacle(double gap, double d, double speed, double half_width) {
    lanewise::AddObstacle(gap, d, speed, half_width, &scratch_->view);
  }

  AgentParams params_;
  VehicleParams vehicle_;
  PlanContext context_;
  std::unique_ptr<PlanScratch> scratch_ = std::make_unique<PlanScratch>();
};

TEST_F(DwaTest, ThreeHundredRolloutsByDefault) {
  EXPECT_EQ(params_.dwa.speed_samples, 15);
  EXPECT_EQ(params_.dwa.path_samples, 20);
  MakePlan();
  EXPECT_EQ(scratch_->courses.count, 20);
}

TEST_F(DwaTest, AFreeRoadAcceleratesTowardsTheLimitOnThePath) {
  const Plan plan = MakePlan();
  EXPECT_EQ(plan.status, PlanStatus::kOk);
  EXPECT_GT(plan.accel, 0.5 * vehicle_.max_accel);
  EXPECT_LE(plan.accel, vehicle_.max_accel + 1e-6);
  EXPECT_NEAR(plan.target_d, 0.0, 1e-6);
  context_.d = 0.5;
  EXPECT_NEAR(MakePlan().target_d, 0.0, 1e-6);  // Back to the path.
}

TEST_F(DwaTest, AtTheLimitItHoldsTheSpeedAndAboveItBrakes) {
  context_.speed = 13.9;
  EXPECT_NEAR(MakePlan().accel, 0.0, 0.05);
  context_.speed = 15.0;
  EXPECT_LT(MakePlan().accel, -0.5);
}

TEST_F(DwaTest, TheTargetIsTheTactics) {
  context_.target_d = 3.2;
  context_.corridor_max = 3.2;
  EXPECT_NEAR(MakePlan().target_d, 3.2, 1e-6);
}

// Closed loop on a point mass towards a wall across the corridor: the speed after the response time is never
// one from which the ego could no longer stop, and it does stop before the wall, not far from it.
TEST_F(DwaTest, AStoppedObstacleAheadIsNeverApproachedAboveSafeSpeed) {
  double gap = 80.0;
  const double dt = 0.1;
  for (int k = 0; k < 400; ++k) {
    scratch_->view = PathView(ViewHorizon(context_.speed));
    AddObstacle(gap, 0.0, 0.0, 2.5);
    const Plan plan = MakePlan();
    ASSERT_EQ(plan.status, PlanStatus::kOk) << "gap " << gap << ", speed " << context_.speed;
    const double safe = SafeSpeed(gap - vehicle_.min_gap, 0.0, vehicle_.max_decel, vehicle_.time_gap);
    ASSERT_LE(context_.speed + plan.accel * params_.driving.response_time, safe + 1e-3) << "gap " << gap;
    context_.speed = std::max(0.0, context_.speed + plan.accel * dt);
    gap -= context_.speed * dt;
    ASSERT_GT(gap, 0.0);
  }
  EXPECT_LT(context_.speed, 0.05);
  EXPECT_GE(gap, 0.8 * vehicle_.min_gap);
  EXPECT_LE(gap, vehicle_.min_gap + 2.0);
}

// The leader beyond the view (a gap and a speed only) limits the speed just as an obstacle does.
TEST_F(DwaTest, TheLeaderOfTheLaneLimitsTheSpeed) {
  context_.leader_gap = 20.0;
  context_.leader_speed = 5.0;
  const Plan plan = MakePlan();
  EXPECT_EQ(plan.status, PlanStatus::kOk);
  const double safe = SafeSpeed(20.0 - vehicle_.min_gap, 5.0, vehicle_.max_decel, vehicle_.time_gap);
  EXPECT_LE(context_.speed + plan.accel * params_.driving.response_time, safe + 1e-3);
}

// Who speeds up or brakes ahead is followed as it will drive when the ego has answered, 0.45 s later.
TEST_F(DwaTest, TheLeadersAccelerationIsAnticipated) {
  context_.leader_gap = 12.0;
  context_.leader_speed = 8.0;
  RollOutCourses(params_.driving, scratch_->view, context_, 1, &scratch_->courses);
  const double lag = params_.driving.response_time + vehicle_.accel_lag;
  for (const double accel : {-2.0, 0.0, 1.5}) {
    context_.leader_accel = accel;
    LimitCourseSpeeds(params_, scratch_->view, context_, &scratch_->courses);
    const double room = 12.0 - vehicle_.min_gap, speed = 8.0 + lag * accel;
    EXPECT_NEAR(scratch_->courses.safe_speed[0],
                SafeSpeed(room, speed, vehicle_.max_decel, vehicle_.time_gap), 1e-4);
    EXPECT_NEAR(scratch_->courses.comfort_speed[0],
                SafeSpeed(room, speed, params_.driving.comfort_decel, vehicle_.time_gap), 1e-4);
  }
}

// A car drives beside us at our speed, its right side at 3.2 - 0.9 = 2.3 m. Our left side is at d + 0.9, so
// with the margin of 0.25 m no course may go beyond 1.15 m (0.02 m is the planner's own tolerance).
TEST_F(DwaTest, AnObstacleBesideBlocksTheLaneChange) {
  context_.target_d = 3.2;
  context_.corridor_max = 3.2;
  AddObstacle(-5.0, 3.2, context_.speed, 0.9);  // Its rear beside our rear, its front beside our front.
  const Plan plan = MakePlan();
  EXPECT_EQ(plan.status, PlanStatus::kOk);
  EXPECT_LE(plan.target_d, 1.17);
  for (int j = 0; j < scratch_->courses.count; ++j) {
    if (scratch_->courses.target[j] < 3.1f) continue;
    // At constant speed (the middle profile keeps nearly 10 m/s) the course over there is blocked.
    EXPECT_LT(scratch_->blocked_clearance[0][j], 0.0f) << j;
  }
}

// A bus beside, its side at 1.6 m, moves away to its lane at 1 m/s. Where it only creeps it may stop at once,
// and no course may go beyond 1.6 - 0.9 - 0.25 m; if it drives it will be 2.6 m away in a second.
TEST_F(DwaTest, RoomThatACreepingBusMakesIsNotCountedOn) {
  context_.speed = 5.0;
  context_.target_d = 1.2;
  context_.corridor_max = 1.2;
  for (const double its_speed : {1.0, 5.0}) {
    scratch_->view = PathView(ViewHorizon(5.0));
    AddObstacle(-8.0, 2.5, its_speed, 0.9);
    Obstacle& bus = scratch_->view.obstacles[0];
    bus.half_length = 6.0f;
    bus.s = -1.0f;
    bus.speed_d = 1.0f;
    bus.drift_time = 1.0f;
    const Plan plan = MakePlan();
    EXPECT_EQ(plan.status, PlanStatus::kOk);
    if (its_speed < 2.0) {
      EXPECT_LE(plan.target_d, 0.47);
    } else {
      EXPECT_GT(plan.target_d, 0.8);
    }
  }
}

// The same lane, but the car is well behind and keeps its distance: the way is free.
TEST_F(DwaTest, WhatIsBehindDoesNotBlock) {
  context_.target_d = 3.2;
  context_.corridor_max = 3.2;
  AddObstacle(-20.0, 3.2, context_.speed, 0.9);
  EXPECT_NEAR(MakePlan().target_d, 3.2, 1e-6);
}

// 20 m/s needs 20^2 / 9 = 44 m; the wall is 3 m ahead.
TEST_F(DwaTest, NothingFeasibleBrakesFullyAndHoldsTheCourse) {
  context_.speed = 20.0;
  context_.d = 0.3;
  scratch_->view = PathView(ViewHorizon(20.0));
  AddObstacle(3.0, 0.0, 0.0, 2.5);
  const Plan plan = MakePlan();
  EXPECT_EQ(plan.status, PlanStatus::kNoFeasibleCommand);
  EXPECT_LE(plan.accel, -vehicle_.max_decel);
  EXPECT_EQ(plan.target_d, context_.d);
}

// Too late to stop behind what reaches into the right half of the way: at least not towards it.
TEST_F(DwaTest, NothingFeasibleBrakesWhereThereIsMostRoom) {
  context_.corridor_min = -1.5;
  context_.corridor_max = 1.5;
  for (const double side : {-1.0, 1.0}) {
    scratch_->view = PathView(ViewHorizon(10.0));
    AddObstacle(7.0, side * 1.5, 0.0, 0.9);
    AddObstacle(12.0, 0.0, 0.0, 2.5);
    const Plan plan = MakePlan();
    EXPECT_EQ(plan.status, PlanStatus::kNoFeasibleCommand);
    EXPECT_LT(side * plan.target_d, -1.0);
  }
}

// On its way out from behind a bus that reaches to d = -1.7 m, its front is past the corner's line with less
// than the margin and too fast to stop: it goes on outwards, and does not straighten up into the corner.
TEST_F(DwaTest, NothingFeasibleGoesOnPastACorner) {
  context_.d = -0.96;
  context_.heading_error = 0.2;
  context_.speed = 9.1;
  context_.corridor_min = -0.96;
  scratch_->view = PathView(ViewHorizon(9.1));
  AddObstacle(1.5, -3.08, 0.0, 1.36);
  const Plan plan = MakePlan();
  EXPECT_EQ(plan.status, PlanStatus::kNoFeasibleCommand);
  EXPECT_GT(plan.target_d, 0.4);
}

// Where between two nodes an obstacle begins makes no leap in the room beside it.
TEST_F(DwaTest, RoomBesideAnObstacleChangesSmoothly) {
  context_.d = -1.0;
  context_.heading_error = 0.3;
  double before = 0.0;
  for (double gap = 3.0; gap < 9.0; gap += 0.1) {
    scratch_->view = PathView(ViewHorizon(10.0));
    AddObstacle(gap, -3.0, 0.0, 1.3);
    RollOutCourses(params_.driving, scratch_->view, context_, 1, &scratch_->courses);
    LimitCourseSpeeds(params_, scratch_->view, context_, &scratch_->courses);
    const double room = scratch_->courses.clearance[0];
    if (gap > 3.0) {
      EXPECT_LT(std::abs(room - before), 0.06) << gap;
    }
    before = room;
  }
}

// Cars at our speed on both sides come nearer whatever we do: braking would only lose the place. The speed
// goes on, the course is held.
TEST_F(DwaTest, SqueezedFromBothSidesItDoesNotBrakeInVain) {
  for (const double side : {-1.0, 1.0}) {
    AddObstacle(-4.6, side * 2.2, context_.speed, 0.9);
    Obstacle& o = scratch_->view.obstacles[scratch_->view.obstacle_count - 1];
    o.speed_d = static_cast<float>(-side * 0.8);
    o.drift_time = 1.0f;
  }
  const Plan plan = MakePlan();
  EXPECT_EQ(plan.status, PlanStatus::kNoFeasibleCommand);
  EXPECT_GT(plan.accel, -0.5);
  EXPECT_EQ(plan.target_d, context_.d);
  // But it does not speed up against a limit, whatever room that would give.
  context_.free_speed = 0.5 * context_.speed;
  EXPECT_LE(MakePlan().accel, 1e-6);
}

// It cannot stop before what stands 14 m ahead, and could pass it on the right but for the car beside it.
TEST_F(DwaTest, TheWayOutIsNotThroughWhatIsBeside) {
  context_.corridor_min = -2.5;
  context_.corridor_max = 2.5;
  context_.speed = 14.0;
  AddObstacle(14.0, 1.2, 0.0, 1.3);
  EXPECT_LT(MakePlan().target_d, -1.5);
  AddObstacle(-2.3, -2.4, 0.0, 0.9);
  const Plan plan = MakePlan();
  EXPECT_EQ(plan.status, PlanStatus::kNoFeasibleCommand);
  EXPECT_GE(plan.target_d, -0.1);
}

// The road is blocked too near to stop: it goes on as it steers where that leads away from what is beside it,
// else it holds its place.
TEST_F(DwaTest, WithNothingFeasibleItDoesNotSteerTowardsWhatIsNearest) {
  context_.speed = 14.0;
  AddObstacle(8.0, 0.0, 0.0, 5.0);
  AddObstacle(-2.3, -2.4, 0.0, 0.9);
  context_.heading_error = -0.03;
  EXPECT_EQ(MakePlan().status, PlanStatus::kNoFeasibleCommand);
  EXPECT_EQ(MakePlan().target_d, context_.d);
  context_.heading_error = 0.03;
  EXPECT_EQ(MakePlan().status, PlanStatus::kNoFeasibleCommand);
  EXPECT_GT(MakePlan().target_d, context_.d);
}

// Both come on at 10 m/s, 40 m apart: the room is shared, so we plan to stop in less than if it stood.
TEST_F(DwaTest, WhoComesTowardsUsNeedsRoomToo) {
  AddObstacle(40.0, 0.0, -10.0, 0.9);
  MakePlan();
  const float oncoming = scratch_->courses.comfort_speed[0];
  scratch_->view.obstacles[0].speed_s = 0.0f;
  MakePlan();
  EXPECT_LT(oncoming, scratch_->courses.comfort_speed[0] - 3.0f);
}

// Half the road is blocked 8 m ahead. Waiting behind it costs goal_weight * (13.9 - 3.5) / 13.9 = 0.75
// (comfortable speed there: sqrt(3^2 + 2 * 3 * 5.5) - 3 = 3.5 m/s); passing costs path_weight * 1.4 m = 0.5.
TEST_F(DwaTest, SwervesAroundAnObstacleWithinTheCorridor) {
  context_.speed = 3.0;
  context_.corridor_min = -2.5;
  context_.corridor_max = 2.5;
  scratch_->view = PathView(ViewHorizon(3.0));
  AddObstacle(8.0, 1.2, 0.0, 0.9);
  const Plan plan = MakePlan();
  EXPECT_EQ(plan.status, PlanStatus::kOk);
  // Right side of the obstacle at 0.3 m, our half width 0.9 m: left of -0.6 m nothing passes.
  EXPECT_LT(plan.target_d, -0.6);
  EXPECT_GT(plan.accel, -0.5);
}

/// The tracking law of RollOutCourses, integrated with the bicycle itself in small steps of time.
/// @return lateral position of the front when it has driven n * spacing along the path.
std::array<double, kPathNodes> SimulateCourse(const DrivingParams& driving, const VehicleParams& vehicle,
                                              const PlanContext& c, double target, double curvature,
                                              double spacing) {
  const double dt = 1e-3;
  const double gain = 1.0 / std::max(driving.tracking_distance, c.speed * driving.tracking_time);
  RoadPose pose{0.0, c.d, c.heading_error};
  double speed = c.speed, slip = c.slip;
  std::array<double, kPathNodes> front{};
  for (int n = 0; n < kPathNodes;) {
    if (pose.s >= n * spacing - 1e-9) {
      front[n++] = pose.d;
      continue;
    }
    const double course =
        std::clamp(gain * (target - pose.d), -driving.max_course_angle, driving.max_course_angle);
    const double max_turn = vehicle.max_steering_rate * dt;
    slip += std::clamp(course - pose.heading_error - slip, -max_turn, max_turn);
    StepBicycleOnRoad(0.0, slip, vehicle.rear_axle_to_front, curvature, dt, &pose, &speed);
  }
  return front;
}

class CourseAccuracy : public testing::TestWithParam<std::tuple<double, double, double>> {};

// The planner's 16 coarse steps against 1 ms steps of the same law and model.
TEST_P(CourseAccuracy, RolloutsAgreeWithStepByStepSimulation) {
  const auto [speed, curvature, target] = GetParam();
  VehicleParams vehicle;
  DrivingParams driving;
  PlanContext context;
  context.vehicle = &vehicle;
  context.speed = speed;
  context.d = 0.3;
  context.heading_error = 0.02;
  context.slip = std::asin(vehicle.rear_axle_to_front * curvature);
  context.heading_error -= context.slip;  // Course 0.02 rad off the path's direction.
  context.target_d = target;
  context.corridor_min = context.corridor_max = target;
  const RoadView view = PathView(std::max(10.0, speed * 3.0 + 4.0), curvature);
  const auto courses = std::make_unique<CourseSet>();
  RollOutCourses(driving, view, context, 1, courses.get());
  const auto expected = SimulateCourse(driving, vehicle, context, target, curvature, view.spacing);
  double worst = 0.0;
  for (int n = 0; n < kPathNodes; ++n) worst = std::max(worst, std::abs(courses->front[n][0] - expected[n]));
  // A few centimetres within the lane; over a whole lane change a tenth of the shift.
  const double shift = std::abs(target - context.d);
  EXPECT_LT(worst, shift < 1.0 ? 0.05 : 0.10 * shift);
}

INSTANTIATE_TEST_SUITE_P(SpeedCurvatureTarget, CourseAccuracy,
                         testing::Combine(testing::Values(5.0, 10.0, 20.0), testing::Values(0.0, 0.01),
                                          testing::Values(0.0, -0.6, 3.2)));

// A body whose bumpers' middles are on a circle of radius r: its middle lies r - sqrt(r^2 - (l / 2)^2)
// inside.
TEST_F(DwaTest, TheMiddleOfTheBodyLiesInsideABend) {
  const double radius = 8.0, length = vehicle_.length;
  scratch_->view = PathView(10.0, 1.0 / radius);
  context_.speed = 3.0;
  context_.slip = std::asin(vehicle_.rear_axle_to_front / radius);
  context_.heading_error = -context_.slip;
  RollOutCourses(params_.driving, scratch_->view, context_, 1, &scratch_->courses);
  const CourseSet& courses = scratch_->courses;
  EXPECT_TRUE(courses.bent);
  const double inside = radius * (1.0 - std::cos(0.5 * length / radius));
  EXPECT_GT(inside, 0.3);
  for (int n = 0; n < kPathNodes; ++n) {
    const double between = 0.5 * (courses.front[n][0] + courses.rear[n][0]);
    EXPECT_NEAR(courses.middle[n][0] - between, inside, 0.02) << "node " << n;
  }
  scratch_->view = PathView(10.0, 0.0);
  RollOutCourses(params_.driving, scratch_->view, context_, 1, &scratch_->courses);
  EXPECT_FALSE(courses.bent);
}

// Stopping before what reaches a little into the way, it goes aside meanwhile; behind a queue it stays.
TEST_F(DwaTest, WhoStopsBeforeALittleOverlapMakesRoom) {
  context_.speed = 4.0;
  context_.corridor_min = -0.2;
  context_.corridor_max = 0.2;
  AddObstacle(8.0, 0.5 * vehicle_.width + 0.3, 0.0, 0.4);
  const Plan plan = MakePlan();
  EXPECT_LT(plan.accel, 0.0);
  EXPECT_LT(plan.target_d, -0.15);
  scratch_->view.obstacle_count = 0;
  AddObstacle(8.0, 0.1, 0.0, 0.9);
  EXPECT_EQ(MakePlan().target_d, 0.0);
}

TEST_F(DwaTest, IdmFollowsTheReferenceCourse) {
  AddObstacle(20.0, 0.0, 5.0, 0.9);
  const Plan plan = PlanIdm(params_, context_, scratch_.get());
  EXPECT_NEAR(plan.accel,
              IdmAccel(10.0, 13.9, 20.0, 5.0, vehicle_.max_accel, params_.driving.comfort_decel,
                       vehicle_.time_gap, vehicle_.min_gap),
              1e-5);
  EXPECT_EQ(plan.target_d, 0.0);
}

}  // namespace
}  // namespace lanewise
