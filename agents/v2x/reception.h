#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "agents/agent_params.h"
#include "agents/v2x/channel_counts.h"

namespace lanewise {

/// What becomes of a message at a receiver within range, and when it is there, by two 32-bit draws. The odds
/// are formulas of exponentials (radio.h); here they are tabulated as bounds that decide nearly every draw,
/// and the formula decides the rest: results are those of the formula.
class Reception {
 public:
  /// @param loaded hidden stations send into messages.
  Reception(const V2xParams& params, bool loaded);

  /// Bounds of the odds as draws, over one cell of load and squared distance: a draw below the first of a
  /// pair passes, one above the second does not.
  struct Bounds {
    std::uint32_t delivered_low, delivered_high;
    std::uint32_t not_faded_low, not_faded_high;
  };
  /// The bounds by distance at a receiver whose channel is busy for the share `load`, for FateOf.
  const Bounds* AtLoad(double load) const {
    const auto row = static_cast<std::size_t>(load * static_cast<double>(loads_));
    return &bounds_[std::min(row, loads_ - 1) * kDistances];
  }
  /// One draw decides, in this order of causes: more of a later cause takes no earlier one's messages.
  /// @param bounds AtLoad(load). @param distance2 [m^2], within range.
  Fate FateOf(const Bounds* bounds, double load, double distance2, std::uint32_t draw) const {
    const Bounds& b = bounds[std::min(static_cast<std::size_t>(distance2 * bin_scale_), kDistances - 1)];
    const bool unsure = (draw - b.delivered_low <= b.delivered_high - b.delivered_low) |
                        (draw - b.not_faded_low <= b.not_faded_high - b.not_faded_low);
    if (unsure) return ExactFateOf(load, distance2, draw);
    const int causes = (draw >= b.delivered_low) + (draw >= b.not_faded_low) + (draw >= not_dropped_);
    return static_cast<Fate>((4 - causes) & 3);
  }
  Fate ExactFateOf(double load, double distance2, std::uint32_t draw) const;

  /// Steps of `dt` [s] after which a message is there: shifted exponential latency, cut off.
  std::int32_t ExactLatency(double dt, std::uint32_t draw) const;
  /// Prepares Latency for steps of `dt`.
  void SetStep(double dt);
  /// Whether Latency is 1, as it mostly is.
  bool IsThereNextStep(std::uint32_t draw) const { return draw - next_step_first_ < next_step_count_; }
  /// ExactLatency of the step set.
  std::int32_t Latency(std::uint32_t draw) const {
    const auto on_time =
        std::partition_point(late_.begin(), late_.end(), [&](std::uint64_t end) { return draw < end; });
    return static_cast<std::int32_t>(on_time - late_.begin());
  }

 private:
  static constexpr std::size_t kDistances = 128, kLoads = 64;

  /// Shares of messages that a cause and those before it leave. They fall with distance and load.
  struct Odds {
    double not_faded, delivered;
  };
  Odds OddsAt(double load, double distance2) const;

  V2xParams params_;
  bool loaded_;
  std::size_t loads_;          // Rows of bounds_.
  double bin_scale_;           // [1/m^2]
  std::uint64_t not_dropped_;  // A draw from here on is lost whatever the distance.
  std::vector<Bounds> bounds_;
  double dt_{0.0};                                         // [s]
  std::vector<std::uint64_t> late_;                        // late_[k]: draws below it take more than k steps.
  std::uint64_t next_step_first_{0}, next_step_count_{0};  // Draws that take one step.
};

}  // namespace lanewise
