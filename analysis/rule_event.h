#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "agents/core/types.h"

namespace lanewise {

/// What happened against, or for want of, the rules of the road.
enum class RuleEventKind : std::uint8_t { kRedLight, kJunctionBlocked, kStandstill, kForcedEntry };
inline constexpr std::string_view kRuleEventNames[] = {"red_light", "junction_blocked", "standstill",
                                                       "forced_entry"};

struct RuleEventRow {
  double time{0.0};  ///< [s]
  std::int32_t vehicle_number{kNone};
  RuleEventKind kind{RuleEventKind::kRedLight};
  LaneIndex lane{kNone};  ///< The lane left at a red light; else where the vehicle stands.
};

/// Events by kind.
using RuleEventCounts = std::array<std::int64_t, std::size(kRuleEventNames)>;

}  // namespace lanewise
