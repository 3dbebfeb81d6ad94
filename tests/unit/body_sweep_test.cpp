#include "agents/planning/body_sweep.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "agents/planning/car_following.h"
#include "agents/vehicle/kinematic_bicycle.h"
#include "tests/support/straight_view.h"

namespace lanewise {
namespace {

/// A bus that drives its path's circle of 12 m steadily: its rear axle follows a circle of `axle_`, its outer
/// front corner one of `outer_`, its inner flank beside the rear axle one of `inner_` (elementary geometry of
/// the bicycle model).
class ABusOnACircle : public testing::Test {
 protected:
  ABusOnACircle() {
    bus_.length = 12.0;
    bus_.width = 2.5;
    bus_.wheelbase = 6.0;
    bus_.rear_axle_to_front = 9.0;
    bus_.max_steering_angle = 0.8;
    const double slip = std::asin(bus_.rear_axle_to_front / kRadius);
    axle_ = bus_.rear_axle_to_front / std::tan(slip);
    outer_ = std::hypot(axle_ + 0.5 * bus_.width, bus_.rear_axle_to_front);
    inner_ = axle_ - 0.5 * bus_.width;
    context_ = {.heading_error = -slip, .slip = slip, .speed = 2.0, .vehicle = &bus_};
    view_ = PathView(/*horizon=*/25.0, 1.0 / kRadius);
    courses_->count = 1;
    courses_->target[0] = 0.0f;
  }

  /// A box of 0.2 m at this angle [rad] ahead on the circle, and this far from its centre.
  void StandAt(double angle, double radius) {
    Obstacle o{};
    o.row = 7;
    o.body = {{radius * std::sin(angle), kRadius - radius * std::cos(angle), angle}, 0.2, 0.2};
    view_.obstacles[view_.obstacle_count++] = o;
  }

  void Limit() {
    courses_->safe_speed.fill(100.0f);
    courses_->comfort_speed.fill(100.0f);
    courses_->clearance.fill(100.0f);
    courses_->leader_gap = 1e3f;
    LimitBySweep(AgentParams{}, view_, context_, kMargin, courses_.get());
  }

  static constexpr double kRadius = 12.0;
  static constexpr float kMargin = 0.1f;
  VehicleParams bus_;
  double axle_, outer_, inner_;
  PlanContext context_;
  RoadView view_;
  std::unique_ptr<CourseSet> courses_ = std::make_unique<CourseSet>();
};

TEST_F(ABusOnACircle, NeedsASweepAndACarDoesNot) {
  EXPECT_TRUE(SweepsAcross(view_, context_));
  VehicleParams car;
  context_.vehicle = &car;
  EXPECT_FALSE(SweepsAcross(view_, context_));
  context_.vehicle = &bus_;
  context_.heading_error = 0.0;
  EXPECT_FALSE(SweepsAcross(PathView(25.0, 0.01), context_));
}

TEST_F(ABusOnACircle, WhatStandsOutsideItsFrontCornerIsFree) {
  StandAt(1.0, outer_ + 0.5);
  Limit();
  EXPECT_EQ(courses_->safe_speed[0], 100.0f);
  EXPECT_NEAR(courses_->clearance[0], 0.4, 0.05);
}

TEST_F(ABusOnACircle, WhatStandsInsideItsFlankIsFree) {
  StandAt(1.0, inner_ - 0.5);
  Limit();
  EXPECT_EQ(courses_->safe_speed[0], 100.0f);
  EXPECT_NEAR(courses_->clearance[0], 0.4, 0.05);
}

TEST_F(ABusOnACircle, WhatItWouldTouchEndsTheCourseThere) {
  for (const double radius : {outer_ - 0.3, inner_ + 0.3, kRadius}) {
    view_.obstacle_count = 0;
    StandAt(1.2, radius);
    Limit();
    EXPECT_LT(courses_->safe_speed[0], 100.0f) << radius;
    EXPECT_LE(courses_->comfort_speed[0], courses_->safe_speed[0]);
    EXPECT_LT(courses_->clearance[0], kMargin);
    EXPECT_EQ(courses_->leader_row, 7);
  }
  // The last one stands on the front's own circle: the front reaches it after that arc, less the box's half.
  EXPECT_NEAR(courses_->leader_gap, 1.2 * kRadius, 1.0);
  const double room = courses_->leader_gap - bus_.min_gap;
  EXPECT_NEAR(courses_->safe_speed[0], SafeSpeed(room, 0.0, bus_.max_decel, context_.time_gap), 1e-5);
}

// At speed it looks as far as the view does.
TEST_F(ABusOnACircle, WhatStandsFarAheadIsSeen) {
  view_ = PathView(/*horizon=*/60.0);
  context_.heading_error = context_.slip = 0.0;
  Obstacle o{};
  o.body = {{47.0, 0.0, 0.0}, 5.0, 1.8};
  view_.obstacles[view_.obstacle_count++] = o;
  Limit();
  EXPECT_LT(courses_->safe_speed[0], 100.0f);
  EXPECT_NEAR(courses_->leader_gap, 42.0, 1.5);
}

TEST_F(ABusOnACircle, WhatItStandsBesideStopsItOnlyIfItComesNearer) {
  // Left of the rear axle, which is l_r behind the front along the heading; the flank turns away from there.
  const double slip = context_.slip;
  StandAt(0.0, 0.0);
  const double side = 0.5 * bus_.width + 0.15;
  view_.obstacles[0].body.front = {-bus_.rear_axle_to_front * std::cos(slip) + side * std::sin(slip),
                                   bus_.rear_axle_to_front * std::sin(slip) + side * std::cos(slip), -slip};
  Limit();
  EXPECT_EQ(courses_->safe_speed[0], 100.0f);
  EXPECT_NEAR(courses_->clearance[0], 0.05, 0.02);
}

TEST_F(ABusOnACircle, WhatIsForgivenOrMovesDoesNotEndIt) {
  StandAt(1.2, kRadius);
  view_.obstacles[0].forgiven = 10.0f;
  StandAt(1.2, kRadius);
  view_.obstacles[1].body.length = 0.0;
  Limit();
  EXPECT_EQ(courses_->safe_speed[0], 100.0f);
}

}  // namespace
}  // namespace lanewise
