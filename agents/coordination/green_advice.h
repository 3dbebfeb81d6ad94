#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "agents/agent_params.h"
#include "agents/coordination/coordination_params.h"
#include "agents/coordination/roadside.h"
#include "agents/coordination/signal_timing.h"
#include "agents/sensing/road_view.h"

namespace lanewise {

/// When [s] from now a vehicle passes a stop line that it could reach at `reach` [s], behind one that passes
/// at `ahead` [s] (negative if there is none): a headway behind it, while the link is green, and a start-up
/// delay after a green that begins. @return nothing if no green is in sight.
std::optional<double> PassingTime(const AdviceParams& params, const SignalTiming& timing, std::int32_t link,
                                  double reach, double ahead);

/// [s] when others pass the signal: the last one ahead on the lane to the line (negative: none), and the
/// first one behind on the present lane, whatever line it is bound for.
struct PassingTimes {
  double ahead{-1.0}, behind{1e9};
};
/// @param to_line lane that leads to the line of `ego`; `on` the one it is on; `distance` [m] to the line.
PassingTimes PassesAround(std::span<const ExpectedPass> expected, StationId ego, LaneIndex to_line,
                          LaneIndex on, double distance);

/// [s] until a vehicle at `speed` has come `distance` [m] further, speeding up at `accel` to `limit`.
double TimeToReach(double distance, double speed, double limit, double accel);

/// Speed [m/s] that brings a vehicle `distance` [m] further in `time` [s] if it first slows down to it at
/// `decel` [m/s^2]: v (t - (v0 - v) / b) + (v0^2 - v^2) / (2 b) = s. 0 if even stopping comes too far.
double SpeedToArrive(double distance, double speed, double time, double decel);

/// A vehicle's advice: how fast to drive towards the next signal.
struct Advice {
  std::int32_t signal{kNone};  ///< The one ahead that is heard, index in RoadNetwork::signal_ids.
  double speed{0.0};           ///< [m/s] to arrive with; 0: as fast as it likes.
  double speed_cap{1e9};       ///< [m/s] for this step: slows down no harder than advice.decel.
};

/// [m/s^2] with which vehicles are expected to speed up.
inline constexpr double kExpectedAccel = 1.5;

/// Green-light speed advice (GLOSA; Katsaros et al. 2011): a vehicle that hears what the signal ahead will
/// show and who is ahead of it arrives there when it can pass.
Advice AdviseSpeed(const World& world, const Roadside& roadside, const DrivingParams& driving,
                   AgentIndex ego);

}  // namespace lanewise
