#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>

namespace lanewise {

/// What coordination over the roadside units did.
enum class CoordinationKind : std::uint8_t {
  kAdviceFollowed,  ///< A vehicle with green-light advice came to the signal without a stop; value: least
                    ///< advised m/s.
  kAdviceMissed,    ///< It stopped nevertheless.
  kSignalPlan,      ///< A signal's cycle differed from its program; value: s moved between greens.
  kSignalOffset,    ///< Its cycle was longer or shorter; value: by how many s.
  kReroute,         ///< A vehicle took another route; value: s expected to be gained.
  kHold,            ///< A vehicle was held where it departed.
  kRelease,         ///< A held vehicle was let go before its time.
};
inline constexpr std::string_view kCoordinationKindNames[] = {
    "advice_followed", "advice_missed", "signal_plan", "signal_offset", "reroute", "hold", "release"};
inline constexpr std::size_t kCoordinationKinds = std::size(kCoordinationKindNames);

struct CoordinationEvent {
  double time{0.0};  ///< [s]
  CoordinationKind kind{CoordinationKind::kAdviceFollowed};
  std::int32_t vehicle{-1};  ///< Running number; -1: none.
  std::string signal;        ///< SUMO's id; empty: none.
  double value{0.0};         ///< By kind.
};

/// Events by kind.
using CoordinationCounts = std::array<std::int64_t, kCoordinationKinds>;

}  // namespace lanewise
