#pragma once

#include <array>
#include <cstdint>
#include <vector>

namespace lanewise {

/// What became of a message at a receiver within range.
enum class Fate : std::uint8_t { kDelivered, kDropped, kFaded, kCollided };
inline constexpr std::size_t kFates = 4;

/// Totals of a run; `fates` by Fate. A message counts once per receiver within range.
struct ChannelCounts {
  std::int64_t station_steps{0};  ///< Equipped stations, summed over steps.
  std::int64_t sent{0};
  std::array<std::int64_t, kFates> fates{};
  /// Over pairs and steps: age of the last message known, from one message to the next.
  std::int64_t age_count{0}, age_steps{0};
  /// age_histogram[k]: pairs and steps at which it was k steps old.
  std::vector<std::int64_t> age_histogram;
  double busy_sum{0.0}, step_busy_max{0.0};  ///< Channel busy ratio, over station_steps and of the last step.
  std::int64_t cruise_steps{0};              ///< Vehicles that follow by cooperative cruise, over steps.
  std::int64_t platoon_joins{0}, platoon_leaves{0};
};

}  // namespace lanewise
