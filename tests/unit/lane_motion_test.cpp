#include "analysis/lane_motion.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <span>
#include <string>
#include <vector>

#include "tests/support/small_nets.h"

namespace lanewise {
namespace {

constexpr double kLength = 4.0;  // [m] of the one vehicle of the frames below.

/// One vehicle on a lane, its front bumper at `pose`.
TrafficFrame FrameOf(const RoadNetwork& network, const std::vector<std::string>& path, double lane_pos,
                     Pose2 pose, double speed) {
  TrafficFrame frame;
  frame.Resize(1);
  for (std::size_t k = 0; k < path.size(); ++k) frame.path[0].lane[k] = network.FindLane(path[k]);
  frame.lane[0] = frame.path[0].lane[0];
  frame.lane_pos[0] = lane_pos;
  frame.x[0] = pose.x;
  frame.y[0] = pose.y;
  frame.heading[0] = pose.heading;
  frame.speed[0] = speed;
  frame.vx[0] = speed * std::cos(pose.heading);
  frame.vy[0] = speed * std::sin(pose.heading);
  frame.length[0] = kLength;
  frame.width[0] = 2.0;
  return frame;
}

BoxPose PoseOf(const TrafficFrame& frame) {
  const Point2 u{std::cos(frame.heading[0]), std::sin(frame.heading[0])};
  return {{frame.x[0] - 0.5 * kLength * u.x, frame.y[0] - 0.5 * kLength * u.y}, u};
}

bool Turns(const LaneMotion& motion, const TrafficFrame& frame) {
  return motion.Turns(frame, 0, PoseOf(frame), 3.0);
}

void Follow(const LaneMotion& motion, const TrafficFrame& frame, double period, std::span<BoxPose> poses) {
  motion.Follow(frame, 0, PoseOf(frame), period, poses);
}

/// Front bumper on an arc of this radius about (0, radius) at arc length s, rear bumper on it too.
Pose2 OnArc(double radius, double s) {
  const double a = s / radius;
  // A chord has the tangent's direction in its middle.
  return {radius * std::sin(a), radius * (1.0 - std::cos(a)), a - std::asin(0.5 * kLength / radius)};
}

TEST(LaneMotion, GoesStraightOnAStraightRoad) {
  const RoadNetwork network = ChainNet(3, 2, 50.0);
  const LaneMotion motion(network);
  const std::vector<std::string> path{"e0_0", ":J1_0_0", "e1_0", ":J2_0_0", "e2_0"};
  EXPECT_FALSE(Turns(motion, FrameOf(network, path, 20.0, {20.0, 0.0, 0.0}, 13.0)));
  EXPECT_FALSE(Turns(motion, FrameOf(network, path, 20.0, {20.0, 0.5, 0.015}, 13.0)));
  // Out of line with the lane, it is going to come into line.
  EXPECT_TRUE(Turns(motion, FrameOf(network, path, 20.0, {20.0, 0.5, 0.1}, 13.0)));
  // Without a lane, or standing.
  EXPECT_FALSE(Turns(motion, FrameOf(network, {}, 20.0, {20.0, 0.5, 0.1}, 13.0)));
  EXPECT_FALSE(Turns(motion, FrameOf(network, path, 20.0, {20.0, 0.5, 0.1}, 0.0)));
}

TEST(LaneMotion, FollowsAnArc) {
  constexpr double kRadius = 12.0, kSpeed = 5.0;
  const RoadNetwork network = BendNet(kRadius, 3.0);
  const LaneMotion motion(network);
  const TrafficFrame frame = FrameOf(network, {"bend_0"}, 10.0, OnArc(kRadius, 10.0), kSpeed);
  EXPECT_TRUE(Turns(motion, frame));
  std::array<BoxPose, 7> poses;
  Follow(motion, frame, 0.5, poses);
  for (std::size_t k = 0; k < poses.size(); ++k) {
    const Pose2 front = OnArc(kRadius, 10.0 + 0.5 * kSpeed * static_cast<double>(k));
    const Point2 u{std::cos(front.heading), std::sin(front.heading)};
    // The lane is a polyline with points 1 m apart: it lies up to 1 / (8 R) = 0.0104 m inside the arc.
    EXPECT_NEAR(poses[k].center.x, front.x - 0.5 * kLength * u.x, 0.012) << k;
    EXPECT_NEAR(poses[k].center.y, front.y - 0.5 * kLength * u.y, 0.012) << k;
    EXPECT_NEAR(poses[k].u.x, u.x, 0.01) << k;
    EXPECT_NEAR(poses[k].u.y, u.y, 0.01) << k;
  }
}

TEST(LaneMotion, KeepsItsPlaceBesideTheLaneAndItsLateralMotion) {
  // 0.8 m to the left of a straight lane, 0.1 rad askew, and moving left at 0.5 m/s: along at sqrt(10^2 -
  // 0.5^2).
  const RoadNetwork network = ChainNet(2, 1, 50.0);
  const LaneMotion motion(network);
  TrafficFrame frame = FrameOf(network, {"e0_0", ":J1_0_0", "e1_0"}, 30.0, {30.0, 0.8, 0.1}, 10.0);
  frame.lateral_speed[0] = 0.5;
  std::array<BoxPose, 4> poses;
  Follow(motion, frame, 1.0, poses);
  const double center_x = 30.0 - 0.5 * kLength * std::cos(0.1),
               center_y = 0.8 - 0.5 * kLength * std::sin(0.1);
  for (std::size_t k = 0; k < poses.size(); ++k) {
    const double t = static_cast<double>(k);
    EXPECT_NEAR(poses[k].center.x, center_x + std::sqrt(99.75) * t, 1e-9) << k;
    EXPECT_NEAR(poses[k].center.y, center_y + 0.5 * t, 1e-9) << k;
    EXPECT_NEAR(poses[k].u.y, std::sin(0.1), 1e-9) << k;
  }
}

TEST(LaneMotion, SeesABendBehindTheJunctionAndOneUnderItsRear) {
  // The junction of ForkNet, from 400 m on, leaves "a" at 0.1 rad.
  const RoadNetwork network = ForkNet();
  const LaneMotion motion(network);
  const std::vector<std::string> path{"a_1", ":J_1_0", "b_0"};
  EXPECT_FALSE(Turns(motion, FrameOf(network, path, 360.0, {360.0, 3.2, 0.0}, 12.0)));  // To 396 m.
  EXPECT_TRUE(Turns(motion, FrameOf(network, path, 370.0, {370.0, 3.2, 0.0}, 12.0)));   // To 406 m.
  const double angle = std::atan2(0.8, 8.0);
  TrafficFrame frame = FrameOf(network, {":J_1_0"}, 2.0,
                               {400.0 + 2.0 * std::cos(angle), 3.2 + 2.0 * std::sin(angle), angle}, 1.0);
  EXPECT_FALSE(Turns(motion, frame));
  frame.lane_behind[0] = network.FindLane("a_1");
  EXPECT_TRUE(Turns(motion, frame));  // Its rear has still to come around.
}

TEST(LaneMotion, GoesStraightOnWhereItsWayEndsOrIsFarAway) {
  const RoadNetwork network = BendNet(12.0, 1.5);  // 18 m.
  const LaneMotion motion(network);
  std::array<BoxPose, 4> poses;
  Follow(motion, FrameOf(network, {"bend_0"}, 17.0, OnArc(12.0, 17.0), 10.0), 1.0, poses);
  const Point2 first{poses[2].center.x - poses[1].center.x, poses[2].center.y - poses[1].center.y};
  const Point2 last{poses[3].center.x - poses[2].center.x, poses[3].center.y - poses[2].center.y};
  EXPECT_NEAR(first.x, last.x, 1e-9);
  EXPECT_NEAR(first.y, last.y, 1e-9);
  // Drawn 20 m beside its lane: its own velocity counts.
  Follow(motion, FrameOf(network, {"bend_0"}, 5.0, {5.0, -20.0, 0.0}, 10.0), 1.0, poses);
  EXPECT_NEAR(poses[3].center.x, 5.0 - 0.5 * kLength + 30.0, 1e-9);
  EXPECT_NEAR(poses[3].center.y, -20.0, 1e-9);
}

}  // namespace
}  // namespace lanewise
