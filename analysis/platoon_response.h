#pragma once

#include <cstdint>
#include <vector>

#include "agents/agent_params.h"
#include "agents/v2x/channel.h"

namespace lanewise {

/// A platoon on a straight road behind a leader whose speed swings: v = speed + amplitude sin(2 pi f t).
struct PlatoonTrial {
  int cars{10};             ///< Behind the leader.
  double speed{13.0};       ///< [m/s]
  double max_swing{1.0};    ///< [m/s] greatest amplitude.
  double max_accel{0.6};    ///< [m/s^2] of the leader: lowers the amplitude of fast swings.
  double step_length{0.1};  ///< [s]
  int swings{8};            ///< At least; but two minutes.
  V2xLevel level{V2xLevel::kIdeal};
  std::uint64_t seed{1};
};

/// What the swing becomes along the platoon, of the second half of the trial. Car 0 is the leader.
struct PlatoonResponse {
  double frequency{0.0};                   ///< [Hz]
  std::vector<double> amplitude;           ///< [m/s] of each car's speed at that frequency.
  std::vector<double> gain;                ///< Of each follower: its amplitude by that of the car ahead.
  std::vector<double> time_gap;            ///< [s] of each follower, mean: (gap - standstill gap) / speed.
  double least_gap{0.0};                   ///< [m] bumper to bumper, of all followers.
  double cruise_share{0.0};                ///< Of the followers' time: by cooperative cruise.
  std::vector<double> time;                ///< [s]
  std::vector<std::vector<double>> speed;  ///< [m/s] by car, at `time`.
};

/// Drives it with the agents' own step: planner, controller, actuator lag, bicycle and channel. The frequency
/// [Hz] must be such that its period is a whole number of steps.
PlatoonResponse DrivePlatoon(const AgentParams& params, const PlatoonTrial& trial, double frequency);

}  // namespace lanewise
