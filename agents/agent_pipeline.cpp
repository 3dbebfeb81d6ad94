#include "agents/agent_pipeline.h"

#include <omp.h>

#include <algorithm>
#include <cmath>

#include "agents/core/geometry.h"
#include "agents/planning/brake_guard.h"
#include "agents/planning/car_following.h"
#include "agents/planning/tactics.h"
#include "agents/v2x/cruise.h"
#include "agents/vehicle/kinematic_bicycle.h"

namespace lanewise {
namespace {

/// Below this many rows a step runs on one thread: forking a team costs more than it saves.
constexpr std::size_t kMinParallelAgents = 64;

/// [m/s] and [m] below which a vehicle behind a standing leader has nothing to plan.
constexpr double kStandingSpeed = 0.05;
constexpr double kQueueGap = 0.6;

/// [m/s] below which steering does not move the vehicle sideways.
constexpr double kSteersFrom = 0.5;

/// A turn that begins and ends straight bends this much more in its middle than over a car's length.
constexpr double kPeakOverMean = 1.4;

/// [m] how far from the lane's centre a vehicle may go for a person, and from where it does.
constexpr double kSwing = 1.2;
constexpr float kPersonNear = 3.0f;

/// [m] ahead within which what stands in its course holds a standing vehicle.
constexpr float kHeldWithin = 10.0f;
/// [s] after which one that stands too near to another to steer as it wants turns its wheels away.
constexpr float kWedgedTime = 8.0f;
/// [s] after which one that finds no gap opens a circle of vehicles that wait for each other.
constexpr float kCirclePatience = 10.0f;

/// A turning body sweeps more than its lane. Past a person beside it a driver swings wide.
void SwingForPersons(const Traffic& traffic, const RoadView& view, PlanContext* context) {
  for (int m = 0; m < view.obstacle_count; ++m) {
    const Obstacle& o = view.obstacles[m];
    if (o.row < static_cast<AgentIndex>(traffic.vehicle_count) || std::abs(o.d) > kPersonNear) continue;
    if (o.d < 0.0f) {
      context->corridor_max = std::max(context->corridor_max, kSwing);
    } else {
      context->corridor_min = std::min(context->corridor_min, -kSwing);
    }
  }
}

/// The steering angle [rad] after a step of who would touch something as it steers, `wanted`: towards wheels
/// that are straight, or turned all the way, and with which it can drive on.
template <class MustBrake>
double TurnAway(const VehicleParams& vehicle, double angle, double wanted, double dt,
                const MustBrake& must_brake) {
  for (const double target : {0.0, vehicle.max_steering_angle, -vehicle.max_steering_angle}) {
    if (must_brake(target)) continue;
    const double step = vehicle.max_steering_rate * dt;
    return std::clamp(target, angle - step, angle + step);
  }
  return wanted;
}

/// Speed [m/s] the ego wants without other traffic: limits, bends and speed limits ahead.
double FreeSpeed(const World& world, AgentIndex i, const DrivingParams& driving, const WayAhead& way) {
  const Traffic& traffic = *world.traffic;
  const double speed = traffic.now.speed[i];
  const double here = world.network->lanes[way.lanes[0].lane].speed_limit;
  double wanted = traffic.speed_limit[i];
  const double preview = speed * driving.response_time;
  // The turn the vehicle is in: it may be tighter, or last longer, than the path's.
  const VehicleParams& vehicle = traffic.params[i];
  const double turn = std::abs(std::sin(SlipAngle(traffic.now.steering_angle[i], vehicle.wheelbase,
                                                  vehicle.rear_axle_to_front))) /
                      vehicle.rear_axle_to_front;
  wanted = std::min(wanted, std::sqrt(kPeakOverMean * driving.max_lateral_accel / std::max(turn, 1e-6)));
  for (int k = 0; k < way.count; ++k) {
    const LaneCurve& curve = (*world.curves)[way.lanes[k].lane];
    const double distance = way.lanes[k].start - preview;
    if (distance <= 0.0) {
      const double s = -distance;
      if (s <= curve.length()) wanted = std::min(wanted, curve.SpeedCap(s));
      continue;
    }
    if (distance > speed * speed / (2.0 * driving.comfort_decel) + 1.0) break;
    const double limit = std::min(curve.SpeedCap(0.0), world.network->lanes[way.lanes[k].lane].speed_limit /
                                                           std::max(0.1, here) * traffic.speed_limit[i]);
    wanted = std::min(wanted, BrakingSpeed(distance, limit, driving.comfort_decel));
  }
  return wanted;
}

/// The plan's acceleration, a PID on what was missed of the planned speed, then the powertrain's lag.
/// Emergencies go to the brakes at once. @return acceleration [m/s^2].
double ControlSpeed(const ControlParams& control, const VehicleParams& vehicle, const Plan& plan,
                    bool emergency, double speed_error, double accel_now, double dt, PidState* pid) {
  if (emergency) {
    *pid = {};
    return -vehicle.emergency_decel;
  }
  const PidGains gains{control.speed_kp, control.speed_ki, control.speed_kd, control.derivative_filter,
                       vehicle.max_accel};
  const double command = plan.accel + StepPid(gains, speed_error, dt, pid);
  const double share = dt / (vehicle.accel_lag + dt);
  return std::clamp(accel_now + share * (command - accel_now), -vehicle.emergency_decel, vehicle.max_accel);
}

/// PID on the lateral error gives the wanted course; the steering follows through its rate limit and lag.
/// @return new steering angle [rad].
double ControlSteering(const AgentParams& params, const VehicleParams& vehicle, double lateral_error,
                       double heading_error, double speed, double steering_now, double dt, PidState* pid) {
  const double reach = std::max(params.driving.tracking_distance, speed * params.driving.tracking_time);
  const PidGains gains{params.control.steering_kp, params.control.steering_ki, params.control.steering_kd,
                       params.control.derivative_filter, params.driving.max_course_angle};
  const double integral = pid->integral;
  const double course = StepPid(gains, lateral_error / reach, dt, pid);
  // Standing, no steering changes the error: it must not wind the integral up.
  if (speed < kSteersFrom) pid->integral = integral;
  const double max_slip =
      SlipAngle(vehicle.max_steering_angle, vehicle.wheelbase, vehicle.rear_axle_to_front);
  const double slip = std::clamp(course - heading_error, -max_slip, max_slip);
  const double wanted = SteeringAngle(slip, vehicle.wheelbase, vehicle.rear_axle_to_front);
  const double lagged = steering_now + dt / (vehicle.steering_lag + dt) * (wanted - steering_now);
  const DynamicWindow window =
      ReachableSteering(steering_now, vehicle.max_steering_rate, vehicle.max_steering_angle, dt);
  return std::clamp(lagged, window.min, window.max);
}

/// Did the ego's front, in its last step, pass another of the same lane?
bool PassedOnLane(const World& world, AgentIndex i, double progress) {
  const Traffic& traffic = *world.traffic;
  const LaneIndex lane = traffic.now.lane[i];
  const auto occupants = world.occupancy->On(lane);
  const double s = traffic.now.s[i];
  // In this step or the last one: one step more costs nothing and covers SUMO's rounding.
  return std::any_of(occupants.begin(), occupants.end(), [&](const Occupant& o) {
    return o.row != i && traffic.now.lane[o.row] == lane && o.s <= s && o.s > s - 2.0 * progress - 0.01 &&
           traffic.now.speed[o.row] < traffic.now.speed[i];
  });
}

/// [m] as SUMO counts along lanes, of `progress` [m] along their paths.
double LaneDistance(const World& world, const WayAhead& way, double s, double progress) {
  double distance = 0.0;
  for (int k = 0;; ++k) {
    const LaneIndex lane = way.lanes[k].lane;
    const double left = world.network->lanes[lane].length - (k == 0 ? s : 0.0);
    const double scale = (*world.curves)[lane].scale();
    if (progress <= left * scale || k + 1 == way.count) return distance + progress / scale;
    progress -= left * scale;
    distance += left;
  }
}

/// [rad] by which the path turns over the next `distance` [m, as SUMO counts].
double TurnAhead(const World& world, AgentIndex i, const WayAhead& way, double distance) {
  const Motion& now = world.traffic->now;
  int k = 0;
  while (k + 1 < way.count && way.lanes[k + 1].start <= distance) ++k;
  const double heading = (*world.curves)[way.lanes[k].lane].At(distance - way.lanes[k].start).heading;
  return WrapAngle(heading - (now.heading[i] - now.heading_error[i]));
}

/// [1/m] mean curvature of the path over the next `distance` [m]. A joint of decimetres may bend by much: who
/// passes it in one step must neither miss it nor take it for a long bend.
double CurvatureAhead(const World& world, AgentIndex i, const WayAhead& way, double distance) {
  constexpr double kLeastDistance = 0.2;  // [m]
  if (distance < kLeastDistance) return world.traffic->now.curvature[i];
  return TurnAhead(world, i, way, distance) / distance;
}

}  // namespace

AgentPipeline::AgentPipeline(const RoadNetwork& network, const std::vector<LaneCurve>& curves,
                             const AgentParams& params, Rules rules)
    : network_(network),
      curves_(curves),
      params_(params),
      occupancy_(network),
      avoider_(network, params),
      channel_(network, params.v2x) {
  if (rules == Rules::kAgent) rules_ = std::make_unique<JunctionRules>(network, curves, params);
  for (int t = 0; t < omp_get_max_threads(); ++t) scratch_.push_back(std::make_unique<PlanScratch>());
}

AgentPipeline::~AgentPipeline() = default;

void AgentPipeline::UpdatePoses(Traffic* traffic) const {
  Motion& now = traffic->now;
#pragma omp parallel for schedule(static) if (traffic->size() >= kMinParallelAgents)
  for (std::size_t i = 0; i < traffic->vehicle_count; ++i) {
    if (!traffic->driven[i]) continue;
    const PathPoint point = curves_[now.lane[i]].At(now.s[i]);
    now.x[i] = point.x - now.d[i] * std::sin(point.heading);
    now.y[i] = point.y + now.d[i] * std::cos(point.heading);
    now.heading[i] = WrapAngle(point.heading + now.heading_error[i]);
    now.curvature[i] = point.curvature;
  }
}

void AgentPipeline::Step(double dt, const std::vector<std::uint8_t>& guarded, Traffic* traffic,
                         Commands* commands) {
  const std::size_t n = traffic->size();
  center_x_.resize(n);
  center_y_.resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    const double half = 0.5 * traffic->params[i].length;
    center_x_[i] = traffic->now.x[i] - half * std::cos(traffic->now.heading[i]);
    center_y_[i] = traffic->now.y[i] - half * std::sin(traffic->now.heading[i]);
  }
  grid_.Build(center_x_, center_y_);
  occupancy_.Build(*traffic);
  avoider_.BeginStep(*traffic);
  const World world{&network_, &curves_,  traffic,   &occupancy_, &grid_,
                    center_x_, center_y_, &channel_, rules_.get()};
  if (rules_) rules_->Build(world);
  commands->Resize(n);
  channel_.Exchange(dt, *traffic);
  advice_.assign(traffic->vehicle_count, {});
#pragma omp parallel for schedule(dynamic, 16) if (n >= kMinParallelAgents)
  for (std::size_t i = 0; i < traffic->vehicle_count; ++i) {
    if (!traffic->driven[i]) continue;
    StepAgent(world, static_cast<AgentIndex>(i), dt, guarded[i] != 0, scratch_[omp_get_thread_num()].get(),
              traffic, commands);
  }
}

void AgentPipeline::StepAgent(const World& world, AgentIndex i, double dt, bool guarded, PlanScratch* scratch,
                              Traffic* traffic, Commands* commands) {
  const Motion& now = traffic->now;
  Motion& next = traffic->next;
  const VehicleParams& vehicle = traffic->params[i];
  const DrivingParams& driving = params_.driving;
  const double speed = now.speed[i];

  // Sense.
  const double sight = std::max(60.0, 4.0 * speed + speed * speed / (2.0 * driving.comfort_decel));
  scratch->way = LookAhead(world, i, sight);
  const WayAhead& way = scratch->way;
  const Leader leader = FindLeader(world, i, way);

  // Decide.
  const bool in_circle = rules_ && now.waited[i] > kCirclePatience && rules_->IsInCircle(world, i);
  const Tactics tactics = DecideTactics(world, params_, i, way, leader, in_circle);

  const Cruise cruise = DecideCruise(world, params_.v2x, i, leader, tactics, dt);

  // Plan.
  PlanContext context;
  context.d = now.d[i];
  context.heading_error = now.heading_error[i];
  context.slip = SlipAngle(now.steering_angle[i], vehicle.wheelbase, vehicle.rear_axle_to_front);
  context.speed = speed;
  context.target_d = tactics.target_d;
  context.corridor_min = tactics.corridor_min;
  context.corridor_max = tactics.corridor_max;
  RuleAnswer rule;
  if (rules_) rule = rules_->Decide(world, i, way, leader, dt);
  if (roadside_ != nullptr) advice_[i] = AdviseSpeed(world, *roadside_, driving, i);
  context.free_speed =
      std::min({FreeSpeed(world, i, driving, way), tactics.speed_cap, rule.speed_cap, advice_[i].speed_cap});
  context.vehicle = &vehicle;
  const double horizon = std::max(
      {10.0, speed * params_.dwa.horizon + 4.0, speed * speed / (2.0 * vehicle.max_decel) + speed + 5.0});
  if (leader.row != kNone && !traffic->hazard[leader.row]) {
    context.leader_gap = leader.gap;
    context.leader_speed = leader.speed;
    context.leader_accel = now.accel[leader.row];
    context.leader_row = leader.row;
  }
  context.time_gap = cruise.time_gap;
  context.cruising = cruise.follows != kNone;
  context.cruise_accel = cruise.accel;
  context.leader_decel = cruise.leader_decel;
  Plan plan{0.0, now.d[i], PlanStatus::kOk};
  const bool queued = speed < kStandingSpeed && leader.row != kNone && leader.speed < kStandingSpeed &&
                      leader.gap < vehicle.min_gap + kQueueGap && tactics.lane_change == 0;
  double leader_gap = leader.gap, leader_speed = leader.speed;
  Avoider::Result avoided;
  if (!queued) {
    SenseRoad(world, i, way, horizon, !guarded, &scratch->view);
    SwingForPersons(*traffic, scratch->view, &context);
    if (avoider_.Applies(world, i)) {
      avoided = avoider_.Drive(world, i, leader, context, omp_get_thread_num(), scratch);
      plan = avoided.plan;
    } else {
      plan = traffic->policy[i] == Policy::kIdm ? PlanIdm(params_, context, scratch)
                                                : PlanDwa(params_, context, scratch);
    }
    if (scratch->courses.leader_gap < leader_gap || plan.target_d != context.target_d) {
      leader_gap = scratch->courses.leader_gap;
      leader_speed = scratch->courses.leader_speed;
    }
  } else {
    plan.accel = -speed / dt;
  }

  // Control.
  next.steering_pid[i] = now.steering_pid[i];
  double steering =
      avoided.steers ? SteerCourse(vehicle, avoided.course, now.heading_error[i], now.steering_angle[i], dt)
                     : ControlSteering(params_, vehicle, plan.target_d - now.d[i], now.heading_error[i],
                                       speed, now.steering_angle[i], dt, &next.steering_pid[i]);
  const auto control_speed = [&](bool emergency) {
    next.speed_pid[i] = now.speed_pid[i];
    return ControlSpeed(params_.control, vehicle, plan, emergency, now.speed_ref[i] - speed, now.accel[i], dt,
                        &next.speed_pid[i]);
  };
  const bool emergency =
      avoided.emergency || rule.emergency ||
      (plan.status == PlanStatus::kNoFeasibleCommand &&
       speed > SafeSpeed(leader_gap - 0.3, leader_speed, vehicle.emergency_decel - 1.0, 0.25));
  double accel = control_speed(emergency);
  const auto must_brake = [&](double angle) {
    return MustBrakeNow(world, i, leader.row, scratch->view, angle, std::max(0.0, speed + accel * dt), dt);
  };
  if (!queued && !avoided.steers && !emergency && must_brake(steering)) {
    if (speed >= kSteersFrom) {
      // Who steers back too soon beside something goes on as it steers now.
      if (!must_brake(now.steering_angle[i])) steering = now.steering_angle[i];
    } else if (now.waited[i] > kWedgedTime) {
      steering = TurnAway(vehicle, now.steering_angle[i], steering, dt, must_brake);
    }
    if (must_brake(steering)) accel = control_speed(true);
  }

  // Integrate.
  const LaneCurve& curve = curves_[now.lane[i]];
  RoadPose pose{now.s[i] * curve.scale(), now.d[i], now.heading_error[i]};
  double next_speed = speed;
  const double slip = SlipAngle(steering, vehicle.wheelbase, vehicle.rear_axle_to_front);
  const double curvature = CurvatureAhead(world, i, way, speed * dt);
  const double progress =
      StepBicycleOnRoad(accel, slip, vehicle.rear_axle_to_front, curvature, dt, &pose, &next_speed);
  const double lane_distance = LaneDistance(world, way, now.s[i], progress);
  next.d[i] = pose.d;
  // The body turns as it is steered, not as the path does between where it was and where it is.
  next.heading_error[i] =
      WrapAngle(pose.heading_error + curvature * progress - TurnAhead(world, i, way, lane_distance));
  next.speed[i] = next_speed;
  next.accel[i] = (next_speed - speed) / dt;
  next.speed_ref[i] = std::max(0.0, speed + plan.accel * dt);
  next.planned_accel[i] = plan.accel;
  next.planned_jerk[i] = (plan.accel - now.planned_accel[i]) / dt;
  next.time_gap[i] = cruise.time_gap;
  next.follows[i] = cruise.follows;
  next.steering_angle[i] = steering;
  next.s[i] = now.s[i] + lane_distance;
  next.lane[i] = now.lane[i];
  next.blinker[i] = tactics.blinker;
  next.urgent[i] = tactics.urgent;
  next.since_change[i] = now.since_change[i] + static_cast<float>(dt);
  next.waited[i] = speed < kWalkingSpeed ? now.waited[i] + static_cast<float>(dt) : 0.0f;
  next.refused[i] = tactics.refused ? now.refused[i] + static_cast<float>(dt)
                                    : (speed < kWalkingSpeed ? now.refused[i] : 0.0f);
  next.yielded_to[i] = tactics.yielded_to;
  if (rules_ && speed < kStandingSpeed && rule.state.waits_for == kNone) {
    // Who waits for whom, also where it is the body of one on another way that is in the course, or one
    // beside that leaves no gap.
    const AgentIndex holder = queued || avoided.steers ? kNone : scratch->courses.leader_row;
    const bool held = holder != kNone && holder < static_cast<AgentIndex>(traffic->vehicle_count) &&
                      scratch->courses.leader_gap < kHeldWithin && now.speed[holder] < kStandingSpeed;
    rule.state.waits_for = held ? traffic->number[holder] : tactics.held_by;
  }
  next.rule[i] = rule.state;

  commands->lane_speed[i] = lane_distance / dt;
  commands->emergency[i] = next_speed < speed - vehicle.max_decel * dt - 1e-9;
  commands->passed_on_lane[i] = PassedOnLane(world, i, lane_distance);
  commands->change_lane[i] = tactics.lane_change;
  commands->change_shift[i] = tactics.change_shift;
  commands->leave_route[i] = tactics.leaves_route;
}

}  // namespace lanewise
