#pragma once

#include <array>
#include <cstdint>
#include <string_view>

namespace lanewise {

/// Why the motion SUMO realised may differ from the one commanded.
enum class AuditCause : std::uint8_t {
  kMidBlock,       ///< No reason to differ: commanded = realised to 1e-6, or it is a defect.
  kJunctionGuard,  ///< rules = sumo: SUMO's own checks lower the speed near and in a junction.
  kHandedBack,     ///< SUMO drives: a planned stop, or no room to change lanes. Counted, nothing to compare.
  kRouteChange,    ///< A rerouter changed the way.
  kOtherLink,      ///< SUMO took another link of the junction than foreseen.
  kLaneChangeMissed,  ///< The commanded lane change was not carried out in the next step.
  kTeleport,          ///< Off the road. Counted, nothing to compare.
};
inline constexpr std::size_t kAuditCauses = 7;
inline constexpr std::array<std::string_view, kAuditCauses> kAuditCauseNames{
    "mid_block",  "junction_guard",     "handed_back", "route_change",
    "other_link", "lane_change_missed", "teleport"};

/// Vehicle-steps by cause, and how far commanded and realised motion lay apart.
struct AuditCount {
  std::int64_t steps{0};           ///< Vehicle-steps checked under this cause.
  std::int64_t different{0};       ///< Of these, with a difference above 1e-6.
  double max_position_error{0.0};  ///< [m] along the lane.
  double max_speed_error{0.0};     ///< [m/s]
};

struct CouplingAudit {
  static constexpr double kTolerance = 1e-6;  ///< [m] and [m/s].
  std::array<AuditCount, kAuditCauses> by_cause;

  void Count(AuditCause cause, double position_error, double speed_error) {
    AuditCount& count = by_cause[static_cast<std::size_t>(cause)];
    ++count.steps;
    if (position_error > kTolerance || speed_error > kTolerance) ++count.different;
    if (position_error > count.max_position_error) count.max_position_error = position_error;
    if (speed_error > count.max_speed_error) count.max_speed_error = speed_error;
  }
};

}  // namespace lanewise
