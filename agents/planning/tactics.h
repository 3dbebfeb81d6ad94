#pragma once

#include "agents/agent_params.h"
#include "agents/planning/dwa.h"
#include "agents/sensing/road_view.h"

namespace lanewise {

/// What the agent decides before it plans: which lane, where in it, how fast at most.
struct Tactics {
  double target_d{0.0};                         ///< [m] wanted lateral position on the present lane's path.
  double corridor_min{0.0}, corridor_max{0.0};  ///< [m] lateral positions a course may aim at.
  double speed_cap{1e9};       ///< [m/s] for a needed lane change, a merging neighbour, the lane's end.
  std::int8_t lane_change{0};  ///< Joins the neighbour lane now: +1 left, -1 right, 0.
  double change_shift{0.0};    ///< [m] position on the lane joined minus that on the present one.
  std::int8_t blinker{0};
  bool urgent{false};
  bool refused{false};  ///< Stands for want of a gap while the lane beside it moves.
  /// Takes the way its lane leads, for want of the lane change its route needs.
  bool leaves_route{false};
  std::int32_t yielded_to{kNone};
  std::int32_t held_by{kNone};  ///< Number of the vehicle beside which there is no gap for a needed change.
};

/// Lane choice along the route (needed changes first, then MOBIL, Kesting et al. 2007), gap acceptance,
/// letting others in, and passing what stands in the lane with hazard lights.
/// @param in_circle the ego is one of a circle of vehicles that stand for each other.
Tactics DecideTactics(const World& world, const AgentParams& params, AgentIndex ego, const WayAhead& way,
                      const Leader& leader, bool in_circle);

}  // namespace lanewise
