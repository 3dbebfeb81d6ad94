#include "agents/v2x/cruise.h"

#include <algorithm>
#include <cmath>

#include "agents/v2x/channel.h"

namespace lanewise {
namespace {

/// [1/s] at which the time gap of ordinary following grows back after a platoon has dissolved.
constexpr double kGapEase = 0.15;
/// [m/s^3] bound on how a leader's plan is carried on.
constexpr double kMaxJerk = 2.5;
/// [s] of gap beyond the wanted one from which a leader is joined, and [m] besides.
constexpr double kJoinTime = 1.0;
constexpr double kJoinDistance = 5.0;

}  // namespace

Cruise DecideCruise(const World& world, const V2xParams& params, AgentIndex ego, const Leader& leader,
                    const Tactics& tactics, double dt) {
  const Traffic& traffic = *world.traffic;
  const VehicleParams& vehicle = traffic.params[ego];
  Cruise cruise;
  cruise.time_gap = std::min(vehicle.time_gap, traffic.now.time_gap[ego] + kGapEase * dt);
  if (params.cruise == 0 || traffic.policy[ego] != Policy::kDwa || leader.row == kNone ||
      traffic.hazard[leader.row] || tactics.lane_change != 0)
    return cruise;
  const double speed = traffic.now.speed[ego];
  const double error = leader.gap - vehicle.min_gap - params.cruise_gap * speed;
  if (error > kJoinTime * speed + kJoinDistance) return cruise;
  const StationId station = traffic.number[leader.row];
  const auto heard = world.channel->LastFrom(traffic.number[ego], station);
  if (!heard || heard->age > params.cruise_max_age) return cruise;

  const Message& told = *heard->message;
  const double leader_accel =
      told.planned_accel + std::clamp<double>(told.planned_jerk, -kMaxJerk, kMaxJerk) * heard->age;
  const double error_rate = leader.speed - speed - params.cruise_gap * traffic.now.accel[ego];
  const double last = traffic.now.planned_accel[ego];
  cruise.follows = station;
  cruise.accel = last + dt / params.cruise_gap *
                            (-last + params.cruise_kp * error + params.cruise_kd * error_rate + leader_accel);
  cruise.leader_decel = told.max_decel;
  cruise.time_gap = std::min(
      vehicle.time_gap, std::max(params.cruise_gap, (leader.gap - vehicle.min_gap) / std::max(1.0, speed)));
  return cruise;
}

}  // namespace lanewise
