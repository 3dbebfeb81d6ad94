#include "analysis/comfort_histogram.h"

#include <algorithm>
#include <cmath>

#include "agents/core/check.h"

namespace lanewise {

void ComfortHistogram::Depart(std::int32_t vehicle_number, std::string_view policy) {
  LANEWISE_CHECK(vehicle_number >= 0);
  const auto number = static_cast<std::size_t>(vehicle_number);
  if (number >= drivers_.size()) drivers_.resize(number + 1);
  const auto known = std::find(policies_.begin(), policies_.end(), policy);
  if (known == policies_.end()) {
    policies_.emplace_back(policy);
    for (const Measure& measure : kMeasures) {
      counts_.emplace_back(static_cast<std::size_t>(measure.bins + 2));
    }
    drivers_[number].policy = static_cast<std::int32_t>(policies_.size() - 1);
  } else {
    drivers_[number].policy = static_cast<std::int32_t>(known - policies_.begin());
  }
}

void ComfortHistogram::Observe(const TrafficFrame& frame) {
  for (std::size_t i = 0; i < frame.size(); ++i) {
    const auto number = static_cast<std::size_t>(frame.vehicle_number[i]);
    if (number >= drivers_.size() || drivers_[number].policy == kNone) continue;
    Driver& driver = drivers_[number];
    if (!driver.driven) {
      driver.driven = true;
      continue;
    }
    if (frame.planned_stop[i]) {
      driver.has_accel = false;
      continue;
    }
    const auto count = [&](std::size_t k, double value) {
      const Measure& measure = kMeasures[k];
      const double place = std::floor((value - measure.lower) / measure.width);
      const double bin = std::clamp(place, -1.0, static_cast<double>(measure.bins)) + 1.0;
      ++counts_[static_cast<std::size_t>(driver.policy) * kMeasureCount + k][static_cast<std::size_t>(bin)];
    };
    const double accel = frame.accel[i];
    if (driver.has_accel) count(0, (accel - driver.last_accel) / step_length_);
    count(1, frame.lateral_accel[i]);
    count(2, accel);
    driver.last_accel = accel;
    driver.has_accel = true;
  }
}

std::vector<HistogramRow> ComfortHistogram::Rows() const {
  std::vector<HistogramRow> rows;
  for (std::size_t p = 0; p < policies_.size(); ++p) {
    for (std::size_t k = 0; k < kMeasureCount; ++k) {
      const Measure& measure = kMeasures[k];
      const std::vector<std::int64_t>& counts = counts_[p * kMeasureCount + k];
      for (std::int32_t bin = 0; bin < measure.bins + 2; ++bin) {
        const std::int64_t steps = counts[static_cast<std::size_t>(bin)];
        if (steps == 0) continue;
        HistogramRow& row = rows.emplace_back();
        row.policy = policies_[p];
        row.measure = measure.name;
        row.bin = bin;
        if (bin > 0) row.lower = measure.lower + (bin - 1) * measure.width;
        if (bin <= measure.bins) row.upper = measure.lower + bin * measure.width;
        row.vehicle_time = static_cast<double>(steps) * step_length_;
      }
    }
  }
  return rows;
}

}  // namespace lanewise
