#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "analysis/run_metrics.h"
#include "analysis/statistics.h"

namespace lanewise {

struct CompareParams {
  std::string baseline{};              ///< Label; empty: sumo if it is there, else the first.
  std::vector<std::size_t> metrics{};  ///< Of AllMetrics; empty: the headline ones.
  StatisticsParams statistics{};
  double smallest_effect{
      0.05};                  ///< Share of the baseline's mean below which a difference is of no relevance.
  double power{0.8};          ///< Of the number of seeds that would settle an open question.
  bool ignore_demand{false};  ///< Pair by scenario and seed alone.
  bool include_interrupted{false};
  bool include_over_budget{false};
};

enum class Verdict : std::uint8_t {
  kNothing,     ///< Fewer than two pairs.
  kIdentical,   ///< Every difference is zero.
  kLower,       ///< Significant after Holm.
  kHigher,      ///< Likewise.
  kIrrelevant,  ///< The whole interval is closer to zero than the smallest effect of relevance.
  kOpen,        ///< Neither: more seeds are needed.
};

struct MetricComparison {
  std::size_t metric{0};
  double baseline_mean{0.0};  ///< Over the pairs; so below.
  double policy_mean{0.0};
  MeanEstimate difference{};  ///< Policy minus baseline, pair by pair.
  PValue p{};
  double p_holm{1.0};
  std::optional<double> effect_size{};  ///< Hedges' g of the differences.
  Verdict verdict{Verdict::kNothing};
  std::optional<std::size_t>
      seeds_needed{};  ///< If open: pairs for the power asked for; nothing: above a million.
};

struct PolicyComparison {
  std::string policy{};  ///< Label.
  std::size_t pairs{0};
  std::vector<MetricComparison> metrics{};  ///< Only those with at least one pair of values.
};

/// What is known of one policy alone: its runs without a partner count too.
struct PolicySummary {
  std::string policy{};  ///< Label.
  std::size_t runs{0};
  double min_agent_share{0.0}, max_agent_share{0.0};
  std::int64_t inserted{0}, still_running{0}, not_inserted{0}, teleported{0};
  std::vector<MeanEstimate> metrics{};  ///< One a metric chosen; count 0: undefined in every run.
};

/// The comparisons of one scenario: one table, one family of hypotheses.
struct ScenarioComparison {
  std::string scenario{};
  std::string baseline{};
  std::size_t family{0};  ///< Number of p values Holm's method adjusted.
  std::vector<std::size_t> metrics{};
  std::vector<PolicySummary> summaries{};  ///< The baseline first.
  std::vector<PolicyComparison> policies{};
  std::vector<std::string> notes{};  ///< What was left out or has to be known, a sentence each.
  bool partial{false};               ///< Something that was recorded or asked for is not in the tables.
};

struct Comparison {
  std::vector<ScenarioComparison> scenarios{};
  CompareParams params{};
  std::size_t runs{0};  ///< In the files.
  bool partial() const;
  bool any_pair() const;
};

/// Pairs the runs of each scenario by (seed, demand) and compares every label with the baseline.
/// @throws ConfigError if there are no runs, or the baseline is unknown.
Comparison Compare(std::span<const RunRecord> runs, const CompareParams& params);

/// What an A/A test found: two samples of one policy's runs under two names.
struct AaResult {
  std::string scenario{}, policy{};
  std::size_t runs{0}, pairs{0}, repetitions{0};
  std::size_t comparisons{0};
  std::size_t significant{0};          ///< After Holm; each one is a false alarm.
  std::size_t families_with_alarm{0};  ///< Repetitions with at least one.
  struct Coverage {
    std::size_t metric{0};
    std::size_t intervals{0}, covered{0};
  };
  std::vector<Coverage> coverage{};  ///< By metric; how often the interval held the true difference.
};

/// Draws `pairs` runs for each of two names from the recorded runs of a label (with replacement, so that the
/// true difference is zero), compares them, and counts false alarms and intervals that hold the truth. With
/// `against`, instead draws from the recorded pairs of the two labels: the truth is then the recorded mean
/// difference, which tests the intervals on the skewed differences of a real comparison; false alarms are not
/// counted then.
/// @throws ConfigError if there are fewer than six runs or pairs.
std::vector<AaResult> RunAaTest(std::span<const RunRecord> runs, const std::string& label,
                                const std::string& against, std::size_t pairs, std::size_t repetitions,
                                const CompareParams& params);

}  // namespace lanewise
