#include "scenarios/study/precision.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "agents/core/check.h"

namespace lanewise {
namespace {

constexpr std::size_t kMinPairs = 6;  // From here on intervals are bootstrapped; fewer are narrow by chance.

}  // namespace

PrecisionGoal ParsePrecisionGoal(const std::string& text) {
  const std::size_t colon = text.find(':');
  PrecisionGoal goal;
  char* end = nullptr;
  goal.half_width = std::strtod(text.c_str(), &end);
  if (colon == std::string::npos || end != text.c_str() + colon ||
      !(goal.half_width > 0.0 && goal.half_width <= 10.0))
    throw ConfigError(
        fmt::format("--until-ci: '{}'; allowed: SHARE:METRIC, e.g. 0.05:time_loss_s, SHARE (of the "
                    "baseline's mean) above 0 and up to 10",
                    text));
  goal.metric = FindMetric(text.substr(colon + 1), "--until-ci");
  return goal;
}

Precision JudgePrecision(const Comparison& comparison, const PrecisionGoal& goal) {
  Precision precision{.reached = true, .more_seeds = 1, .widest = ""};
  double worst = -1.0;  // Half-width by what it may be.
  std::size_t compared = 0;
  for (const ScenarioComparison& scenario : comparison.scenarios) {
    for (const PolicyComparison& policy : scenario.policies) {
      ++compared;
      const auto found = std::find_if(policy.metrics.begin(), policy.metrics.end(),
                                      [&](const MetricComparison& m) { return m.metric == goal.metric; });
      const std::size_t pairs = found == policy.metrics.end() ? 0 : found->difference.count;
      const std::string what =
          fmt::format("{}, {} against {}", scenario.scenario, policy.policy, scenario.baseline);
      if (pairs < kMinPairs) {
        precision.reached = false;
        precision.more_seeds = std::max(precision.more_seeds, static_cast<std::int64_t>(kMinPairs - pairs));
        worst = INFINITY;
        precision.widest = fmt::format("{}: {} pairs, at least {} are needed", what, pairs, kMinPairs);
        continue;
      }
      const Interval& interval = found->difference.interval;
      const double half_width = 0.5 * (interval.high - interval.low);
      const double allowed = goal.half_width * std::abs(found->baseline_mean);
      const double ratio = half_width == 0.0 ? 0.0 : half_width / allowed;
      if (half_width > allowed) {
        precision.reached = false;
        const double more = static_cast<double>(pairs) * std::min(1.0, ratio * ratio - 1.0);
        precision.more_seeds =
            std::max(precision.more_seeds, static_cast<std::int64_t>(std::ceil(more - 1e-9)));
      }
      if (ratio <= worst) continue;
      worst = ratio;
      precision.widest =
          fmt::format("{}: difference of {} {:.4g} +- {:.4g}, {:.2g} of the baseline's mean {:.4g}; {} pairs",
                      what, AllMetrics()[goal.metric].name, found->difference.mean, half_width,
                      half_width / std::abs(found->baseline_mean), found->baseline_mean, pairs);
    }
  }
  if (compared == 0)
    throw ConfigError(
        "--until-ci: no two runs can be paired, so there is no interval to narrow; the study needs at least "
        "two "
        "policies or settings with the same seeds");
  return precision;
}

}  // namespace lanewise
