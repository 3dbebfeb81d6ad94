#pragma once

#include <array>
#include <limits>

#include "agents/agent_params.h"
#include "agents/sensing/road_view.h"
#include "agents/vehicle/vehicle_params.h"

namespace lanewise {

inline constexpr int kMaxCourses = 64;
inline constexpr int kMaxSpeedProfiles = 32;

/// Speeds reachable within one period: [v - b dt, v + a dt], not below 0 ([C]: period 30 ms, 30 m/s, 5
/// m/s^2: 29.85 to 30.15 m/s).
struct DynamicWindow {
  double min;
  double max;
};
DynamicWindow ReachableSpeeds(double speed, double max_decel, double max_accel, double period);
/// Road-wheel angles reachable within one period, within the mechanical limit.
DynamicWindow ReachableSteering(double steering_angle, double max_rate, double max_angle, double period);

/// What a plan starts from: the ego in the frame of its reference path, and what it wants.
struct PlanContext {
  double d{0.0};                                ///< [m] left of the path.
  double heading_error{0.0};                    ///< [rad]
  double slip{0.0};                             ///< [rad] present slip angle beta.
  double speed{0.0};                            ///< [m/s]
  double target_d{0.0};                         ///< [m] wanted lateral position.
  double corridor_min{0.0}, corridor_max{0.0};  ///< [m] lateral positions a course may aim at.
  double free_speed{0.0};                       ///< [m/s] wanted without obstacles.
  double leader_gap{
      std::numeric_limits<double>::infinity()};  ///< [m] to the leader on the lane, in the view or beyond.
  double leader_speed{0.0};                      ///< [m/s] of that leader.
  double leader_accel{0.0};                      ///< [m/s^2] of that leader.
  AgentIndex leader_row{kNone};                  ///< It, if it is a vehicle on the way.
  double time_gap{1.0};                          ///< [s] kept to what is ahead.
  /// Cooperative cruise behind leader_row: the acceleration it asks for, and the leader's braking.
  bool cruising{false};
  double cruise_accel{0.0}, leader_decel{0.0};  ///< [m/s^2]
  const VehicleParams* vehicle{nullptr};
};

/// Candidate courses: the bicycle model's lateral motion along the path, one lane of the arrays each.
/// The kinematic bicycle's path does not depend on its speed while steering is a function of the distance
/// driven, so C courses and P speed profiles make C x P rollouts from C + P simulations.
struct CourseSet {
  int count{0};
  alignas(64) std::array<float, kMaxCourses> target;  ///< [m] lateral position aimed at.
  /// [m] lateral position of the middle of the front and of the rear bumper when the front is at path node n.
  alignas(64) float front[kPathNodes][kMaxCourses], rear[kPathNodes][kMaxCourses];
  /// [m] range of both over the nodes, from n on, where the ego may be beside what it reaches at n.
  alignas(64) float front_min[kPathNodes][kMaxCourses], front_max[kPathNodes][kMaxCourses];
  alignas(64) float rear_min[kPathNodes][kMaxCourses], rear_max[kPathNodes][kMaxCourses];
  /// Likewise of the middle of the body. Is the path `bent`, so that it lies farther inside than both
  /// bumpers?
  bool bent{false};
  alignas(64) float middle[kPathNodes][kMaxCourses];
  alignas(64) float middle_min[kPathNodes][kMaxCourses], middle_max[kPathNodes][kMaxCourses];
  alignas(64) std::array<float, kMaxCourses> comfort_speed;  ///< [m/s] braking comfortably for what stands in
                                                             ///< the course.
  alignas(64) std::array<float, kMaxCourses> safe_speed;     ///< [m/s] the admissible limit.
  alignas(64)
      std::array<float, kMaxCourses> clearance;  ///< [m] to what is passed; < 0 where overlap is forgiven.
  float leader_gap{0.0f},
      leader_speed{0.0f};        ///< Of course 0: the nearest obstacle in it (infinite gap if none).
  AgentIndex leader_row{kNone};  ///< It.
};

/// Per-thread working memory of a planner: about 45 KiB, reused.
struct PlanScratch {
  WayAhead way;
  RoadView view;
  CourseSet courses;
  alignas(64) float blocked_clearance[kMaxSpeedProfiles][kMaxCourses];
};

enum class PlanStatus : std::uint8_t { kOk, kNoFeasibleCommand };

struct Plan {
  double accel{0.0};     ///< [m/s^2] for the next period.
  double target_d{0.0};  ///< [m] lateral position to steer to.
  PlanStatus status{
      PlanStatus::kOk};  ///< kNoFeasibleCommand: brake as hard as the vehicle can, where there is most room.
};

/// Simulates `count` courses: course 0 aims at context.target_d, the rest spread over the corridor.
void RollOutCourses(const DrivingParams& driving, const RoadView& view, const PlanContext& context, int count,
                    CourseSet* courses);
/// For each course, the speeds from which the ego can still stop behind what is in it, and the clearance to
/// what it passes.
void LimitCourseSpeeds(const AgentParams& params, const RoadView& view, const PlanContext& context,
                       CourseSet* courses);

/// Dynamic Window Approach ([C]; Fox, Burgard, Thrun 1997) over 15 x 20 rollouts. Nothing feasible is a
/// result, not an error.
Plan PlanDwa(const AgentParams& params, const PlanContext& context, PlanScratch* scratch) noexcept;
/// IDM along the reference course.
Plan PlanIdm(const AgentParams& params, const PlanContext& context, PlanScratch* scratch) noexcept;

}  // namespace lanewise
