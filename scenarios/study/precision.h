#pragma once

#include <cstdint>
#include <string>

#include "analysis/comparison.h"

namespace lanewise {

/// How narrow the intervals of paired differences are to be (`--until-ci`).
struct PrecisionGoal {
  double half_width{0.05};  ///< Share of the baseline's mean.
  std::size_t metric{0};    ///< Of AllMetrics.
};

/// "0.05:time_loss_s". @throws ConfigError.
PrecisionGoal ParsePrecisionGoal(const std::string& text);

struct Precision {
  bool reached{false};
  std::int64_t more_seeds{1};  ///< If not: how many are worth adding before the next look; at least 1.
  std::string widest;          ///< The interval that is furthest from the goal, in words.
};

/// Judges every comparison with a baseline, in every scenario. An interval's width falls with the root of the
/// number of pairs; at most as many seeds are added as there are, because few pairs estimate it badly.
/// @throws ConfigError if nothing is compared with anything.
Precision JudgePrecision(const Comparison& comparison, const PrecisionGoal& goal);

}  // namespace lanewise
