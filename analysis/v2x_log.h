#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "agents/v2x/channel.h"

namespace lanewise {

/// What went over the radio in an interval of time.
struct V2xIntervalRow {
  double begin{0.0}, end{0.0};  ///< [s]
  double station_time{0.0};     ///< [s] of all that carry a radio together.
  std::int64_t sent{0}, delivered{0}, dropped{0}, faded{0}, collided{0};
  double pair_time{0.0};             ///< [s] over pairs, from one message to the next: what mean_age is over.
  std::optional<double> mean_age{};  ///< [s] of the last message known; nothing: no pair heard twice.
  std::optional<double> mean_busy{};  ///< Channel busy ratio over station_time; nothing: load not modelled.
  std::optional<double> max_busy{};
  double cruise_time{0.0};  ///< [s] of vehicles that follow by cooperative cruise.
  std::int64_t platoon_joins{0}, platoon_leaves{0};
};

/// A bin of the distribution of the ages over pairs and time.
struct V2xAgeRow {
  double age{0.0};        ///< [s]
  double pair_time{0.0};  ///< [s]
};

/// Turns the channel's running totals into rows of intervals.
class V2xLog {
 public:
  V2xLog(double begin, double step_length, bool loaded)
      : step_length_(step_length), loaded_(loaded), begin_(begin) {}

  /// After each step that ended at `time` [s].
  void Observe(double time, const ChannelCounts& counts);
  /// Closes the interval under way.
  void Finish(double time, const ChannelCounts& counts);
  /// Closed intervals; each is handed out once.
  std::vector<V2xIntervalRow> TakeFinished();
  std::vector<V2xAgeRow> AgeRows(const ChannelCounts& counts) const;

 private:
  void Close(double time, const ChannelCounts& counts);

  double step_length_;  // [s]
  bool loaded_;
  double begin_;  // [s] of the interval under way.
  double max_busy_{0.0};
  ChannelCounts before_;  // At begin_.
  std::vector<V2xIntervalRow> finished_;
};

}  // namespace lanewise
