#include "analysis/v2x_log.h"

#include <algorithm>
#include <utility>

namespace lanewise {
namespace {

constexpr double kInterval = 60.0;  // [s]

}  // namespace

void V2xLog::Observe(double time, const ChannelCounts& counts) {
  max_busy_ = std::max(max_busy_, counts.step_busy_max);
  if (time - begin_ >= kInterval - 0.5 * step_length_) Close(time, counts);
}

void V2xLog::Finish(double time, const ChannelCounts& counts) {
  if (time - begin_ >= 0.5 * step_length_) Close(time, counts);
}

void V2xLog::Close(double time, const ChannelCounts& counts) {
  const auto grown = [](std::int64_t now, std::int64_t before) { return now - before; };
  const auto fate = [&](Fate f) {
    const auto k = static_cast<std::size_t>(f);
    return grown(counts.fates[k], before_.fates[k]);
  };
  const auto seconds = [&](std::int64_t steps) { return step_length_ * static_cast<double>(steps); };
  V2xIntervalRow& row = finished_.emplace_back();
  row.begin = begin_;
  row.end = time;
  const std::int64_t station_steps = grown(counts.station_steps, before_.station_steps);
  row.station_time = seconds(station_steps);
  row.sent = grown(counts.sent, before_.sent);
  row.delivered = fate(Fate::kDelivered);
  row.dropped = fate(Fate::kDropped);
  row.faded = fate(Fate::kFaded);
  row.collided = fate(Fate::kCollided);
  const std::int64_t pairs = grown(counts.age_count, before_.age_count);
  row.pair_time = seconds(pairs);
  if (pairs > 0)
    row.mean_age = seconds(grown(counts.age_steps, before_.age_steps)) / static_cast<double>(pairs);
  if (loaded_ && station_steps > 0) {
    row.mean_busy = (counts.busy_sum - before_.busy_sum) / static_cast<double>(station_steps);
    row.max_busy = max_busy_;
  }
  row.cruise_time = seconds(grown(counts.cruise_steps, before_.cruise_steps));
  row.platoon_joins = grown(counts.platoon_joins, before_.platoon_joins);
  row.platoon_leaves = grown(counts.platoon_leaves, before_.platoon_leaves);
  begin_ = time;
  max_busy_ = 0.0;
  before_ = counts;
}

std::vector<V2xIntervalRow> V2xLog::TakeFinished() {
  return std::exchange(finished_, {});
}

std::vector<V2xAgeRow> V2xLog::AgeRows(const ChannelCounts& counts) const {
  std::vector<V2xAgeRow> rows;
  for (std::size_t k = 0; k < counts.age_histogram.size(); ++k) {
    if (counts.age_histogram[k] > 0)
      rows.push_back({step_length_ * static_cast<double>(k),
                      step_length_ * static_cast<double>(counts.age_histogram[k])});
  }
  return rows;
}

}  // namespace lanewise
