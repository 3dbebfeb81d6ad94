#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "agents/core/types.h"
#include "analysis/traffic_frame.h"

namespace lanewise {

/// One bin of a distribution over driving time.
struct HistogramRow {
  std::string policy{};
  std::string measure{};  ///< Column-like name with its unit, e.g. jerk_mps3.
  std::int32_t bin{0};
  std::optional<double> lower{};  ///< In the measure's unit; nothing: open.
  std::optional<double> upper{};
  double vehicle_time{0.0};  ///< [s]
};

/// Distributions of acceleration, jerk and lateral acceleration over the driving time of each policy's
/// vehicles. Planned stops and the step of insertion are left out; pedestrians too.
class ComfortHistogram {
 public:
  explicit ComfortHistogram(double step_length) : step_length_(step_length) {}

  /// The vehicle is of this policy from now on. Vehicles never named are left out.
  void Depart(std::int32_t vehicle_number, std::string_view policy);

  void Observe(const TrafficFrame& frame);

  /// Bins with time in them, by policy (in order of appearance), measure and value.
  std::vector<HistogramRow> Rows() const;

 private:
  struct Measure {
    const char* name;
    double lower, width;  // Of the first bounded bin.
    std::int32_t bins;    // Bounded ones; an open one on either side comes on top.
  };
  static constexpr Measure kMeasures[] = {
      {"jerk_mps3", -20.0, 0.5, 80}, {"lateral_accel_mps2", -8.0, 0.25, 64}, {"accel_mps2", -9.0, 0.25, 56}};
  static constexpr std::size_t kMeasureCount = std::size(kMeasures);

  struct Driver {
    std::int32_t policy{kNone};
    bool driven{false};  // Its step of insertion is over.
    bool has_accel{false};
    double last_accel{0.0};  // [m/s^2]
  };

  double step_length_;  // [s]
  std::vector<std::string> policies_;
  std::vector<Driver> drivers_;                    // By vehicle number.
  std::vector<std::vector<std::int64_t>> counts_;  // [policy * kMeasureCount + measure][bin]: steps.
};

}  // namespace lanewise
