#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "agents/control/pid.h"
#include "agents/core/types.h"
#include "agents/network/route_plan.h"
#include "agents/vehicle/vehicle_params.h"

namespace lanewise {

/// Avoidance policy of a vehicle.
enum class Policy : std::uint8_t { kSumo, kIdm, kDwa, kBp, kBls, kBpDwa, kApf };
inline constexpr std::string_view kPolicyNames[] = {"sumo", "idm", "dwa", "bp", "bls", "bp_dwa", "apf"};

/// Who answers for signals and right of way.
enum class Rules : std::uint8_t { kSumo, kAgent };
inline constexpr std::string_view kRulesNames[] = {"sumo", "agent"};

/// Why the rules of the road stop an agent.
enum class RuleReason : std::uint8_t { kGo, kSignal, kHalt, kYield, kOccupied, kRoom };

/// What an agent was told by the rules in the last step; others see whether it is going.
struct RuleState {
  std::int32_t line_link{kNone};  ///< Link whose stop line is the next one (index of JunctionMap).
  float at_line{0.0f};            ///< [s] since it halted there; 0: it has not.
  std::int32_t stop_link{kNone};  ///< Link at which it must stop, and where on it [m].
  float stop_at{0.0f};
  std::int32_t waits_for{kNone};  ///< Vehicle number.
  RuleReason reason{RuleReason::kGo};
  std::uint8_t forced{0};  ///< Its turn in a circle of waiting vehicles: rules that no longer bind it.
};

/// What changes of a vehicle from step to step: column i of every vector is row i of Traffic.
/// A step reads `now` and writes `next`; agent i writes only row i.
struct Motion {
  std::vector<LaneIndex> lane;        ///< Lane of the front bumper; kNone while off the road (teleporting).
  std::vector<double> s;              ///< [m] front bumper on the lane, SUMO's position.
  std::vector<double> d;              ///< [m] front bumper left of the lane's reference path.
  std::vector<double> heading_error;  ///< [rad] heading minus path tangent.
  std::vector<double> speed;          ///< [m/s] of the front bumper's middle.
  std::vector<double> accel;          ///< [m/s^2] realised by the powertrain.
  std::vector<double>
      speed_ref;  ///< [m/s] the plan's speed for this moment; the speed PID works on the difference.
  std::vector<double> planned_accel;     ///< [m/s^2] the last plan's; what SUMO drives: as `accel`.
  std::vector<double> planned_jerk;      ///< [m/s^3] its change in that step.
  std::vector<double> time_gap;          ///< [s] ordinary following keeps to the leader.
  std::vector<std::int32_t> follows;     ///< Number of whom it follows by cooperative cruise; kNone: nobody.
  std::vector<double> steering_angle;    ///< [rad] realised at the road wheel.
  std::vector<double> x, y, heading;     ///< World pose of the front bumper's middle [m, m, rad].
  std::vector<double> curvature;         ///< [1/m] of the reference path at s.
  std::vector<std::int8_t> blinker;      ///< Side the vehicle asks for (seen by others): +1, -1, 0.
  std::vector<std::uint8_t> urgent;      ///< The asked change is needed to follow the route.
  std::vector<float> since_change;       ///< [s] since it joined its lane by a change.
  std::vector<float> waited;             ///< [s] since the vehicle last went at walking speed.
  std::vector<float> refused;            ///< [s] of Tactics::refused since the vehicle last made way.
  std::vector<std::int32_t> yielded_to;  ///< Vehicle number last let in on this edge; kNone if none.
  std::vector<PidState> speed_pid, steering_pid;
  std::vector<RuleState> rule;

  void Resize(std::size_t n);
  /// Moves row `from` to row `to` (a vehicle left; the last row takes its place).
  void MoveRow(std::size_t from, std::size_t to);
};

/// All road users of a step. The first vehicle_count rows are vehicles, the rest persons.
struct Traffic {
  std::size_t vehicle_count{0};
  // Set once per vehicle.
  std::vector<std::int32_t> number;    ///< Running number in the run: key in the results.
  std::vector<std::uint64_t> id_hash;  ///< HashText of SUMO's id: what the vehicle's draws depend on.
  std::vector<VehicleClassMask> vehicle_class;
  std::vector<Policy> policy;
  std::vector<VehicleParams> params;
  std::vector<const RoutePlan*> plan;  ///< Null for vehicles without a road route (rail, ships) and persons.
  // Set by the coupling in each step.
  std::vector<std::int32_t>
      route_position;                ///< Route edge the vehicle is on, or has just left (in junctions).
  std::vector<std::uint8_t> driven;  ///< Its agent drives it in this step.
  std::vector<std::uint8_t>
      hazard;  ///< Stands at a planned stop on the road, or is broken down: hazard lights.
  std::vector<double> stop_distance;  ///< [m] to the next planned stop; huge if none.
  std::vector<std::int32_t>
      stop_lane;                    ///< Lane number of the planned stop on the present edge; kNone if none.
  std::vector<double> speed_limit;  ///< [m/s] wanted here: limit x speed factor, at most the type's maximum.
  Motion now, next;
  std::vector<std::string> signal_states;  ///< What each signal shows: SUMO's letter by link index.

  std::size_t size() const { return number.size(); }
  void Resize(std::size_t n);
  void RemoveRow(std::size_t row);
};

/// What an agent asks of the simulation for one step.
struct Commands {
  std::vector<double> lane_speed;  ///< [m/s] progress along SUMO's lane.
  std::vector<std::int8_t>
      change_lane;                      ///< Joins the neighbour lane in this step, its body later: +1, -1, 0.
  std::vector<double> change_shift;     ///< [m] position on the new lane minus that on the old one.
  std::vector<std::uint8_t> emergency;  ///< Braking harder than the type's decel.
  std::vector<std::uint8_t>
      passed_on_lane;                     ///< The front has just passed a standing vehicle of the same lane.
  std::vector<std::uint8_t> leave_route;  ///< Drives on where its lane leads, off its route.
  void Resize(std::size_t n);
};

/// [B] of memory a vehicle's row takes in Traffic (both motions) and Commands.
std::size_t AgentStateBytes();

}  // namespace lanewise
