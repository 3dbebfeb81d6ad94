#include "analysis/comparison.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "agents/core/check.h"

namespace lanewise {
namespace {

/// What two runs of a pair share.
struct PairKey {
  std::int64_t seed{0};
  std::string demand{};
  auto operator<=>(const PairKey&) const = default;
};

using RunsByKey = std::map<PairKey, const RunRecord*>;

std::string Name(const RunRecord& run) {
  return fmt::format("run {} ({}, seed {})", run.run_id, run.label, run.seed);
}

/// "1, 2, 3" or, if there are many, "1, 2, 3 and 17 more".
template <class Values>
std::string List(const Values& values) {
  constexpr std::size_t kShown = 8;
  std::vector<std::string> shown;
  for (const auto& value : values) {
    if (shown.size() == kShown) break;
    shown.push_back(fmt::format("{}", value));
  }
  const std::string text = fmt::format("{}", fmt::join(shown, ", "));
  return values.size() > kShown ? fmt::format("{} and {} more", text, values.size() - kShown) : text;
}

std::string Count(std::size_t count, const char* noun) {
  return fmt::format("{} {}{}", count, noun, count == 1 ? "" : "s");
}

/// Why a run is no basis for a comparison; empty if it is one.
std::string ReasonToLeaveOut(const RunRecord& run, const CompareParams& params) {
  if (run.status == "running") return "is still being written, or its process was killed";
  if (run.status == "failed") return "failed" + (run.message.empty() ? "" : ": " + run.message);
  if (run.status == "interrupted" && !params.include_interrupted)
    return "was interrupted (--include interrupted takes it in)";
  if (run.over_budget > 0 && !params.include_over_budget)
    return fmt::format(
        "is over the audit's budget: {} mid-block commands not carried out (--include over-budget)",
        run.over_budget);
  return "";
}

using RunsByLabel = std::map<std::string, RunsByKey, LabelOrder>;

/// Runs that may be averaged, by label and pair key; says in the notes what is left out and what to beware
/// of.
RunsByLabel SelectRuns(const std::vector<const RunRecord*>& runs, const CompareParams& params,
                       ScenarioComparison* out) {
  RunsByLabel selected;
  for (const RunRecord* run : runs) {
    if (const std::string reason = ReasonToLeaveOut(*run, params); !reason.empty()) {
      out->notes.push_back(fmt::format("left out: {} {}", Name(*run), reason));
      out->partial = true;
      continue;
    }
    if (run->status == "interrupted")
      out->notes.push_back(fmt::format("included though interrupted: {}", Name(*run)));
    if (run->over_budget > 0)
      out->notes.push_back(fmt::format("included though over the audit's budget: {}", Name(*run)));
    const PairKey key{run->seed, params.ignore_demand ? "" : run->demand};
    const RunRecord*& place = selected[run->label][key];
    if (place != nullptr) {
      const bool same = !run->state_hash.empty() && place->state_hash == run->state_hash;
      out->notes.push_back(fmt::format("{} repeats {}{}: the later one counts", Name(*run), Name(*place),
                                       same ? " with the same result" : " with another result"));
      out->partial = out->partial || !same;
    }
    place = run;
  }
  return selected;
}

PolicySummary Summarize(const std::string& label, const RunsByKey& runs,
                        const std::vector<std::size_t>& metrics, const StatisticsParams& statistics) {
  PolicySummary summary;
  summary.policy = label;
  summary.runs = runs.size();
  summary.min_agent_share = 1.0;
  for (const auto& [key, run] : runs) {
    summary.min_agent_share = std::min(summary.min_agent_share, run->agent_share);
    summary.max_agent_share = std::max(summary.max_agent_share, run->agent_share);
    summary.inserted += run->inserted;
    summary.still_running += run->still_running;
    summary.not_inserted += run->not_inserted;
    summary.teleported += run->teleported;
  }
  for (const std::size_t metric : metrics) {
    std::vector<double> values;
    for (const auto& [key, run] : runs) {
      if (run->metrics[metric]) values.push_back(*run->metrics[metric]);
    }
    summary.metrics.push_back(EstimateMean(values, statistics));
  }
  return summary;
}

/// The values of one metric, pair by pair.
struct PairedValues {
  std::vector<double> baseline{}, differences{};
  std::vector<std::int64_t> undefined{};  ///< Seeds.
};

PairedValues ValuesOf(const RunsByKey& baseline, const RunsByKey& policy, std::size_t metric) {
  PairedValues values;
  for (const auto& [key, run] : policy) {
    const auto partner = baseline.find(key);
    if (partner == baseline.end()) continue;
    const auto& a = partner->second->metrics[metric];
    const auto& b = run->metrics[metric];
    if (a && b) {
      values.baseline.push_back(*a);
      values.differences.push_back(*b - *a);
    } else {
      values.undefined.push_back(key.seed);
    }
  }
  return values;
}

MetricComparison CompareMetric(std::size_t metric, std::span<const double> baseline,
                               std::span<const double> differences, const StatisticsParams& statistics) {
  MetricComparison result;
  result.metric = metric;
  for (const double value : baseline) result.baseline_mean += value / static_cast<double>(baseline.size());
  result.difference = EstimateMean(differences, statistics);
  result.policy_mean = result.baseline_mean + result.difference.mean;
  result.p = TestZeroMean(differences, statistics);
  result.effect_size = PairedEffectSize(result.difference);
  return result;
}

/// After Holm: what is settled, and what it would take to settle the rest.
void Judge(std::size_t family, const CompareParams& params, MetricComparison* m) {
  const double alpha = params.statistics.alpha;
  const double relevant = params.smallest_effect * std::abs(m->baseline_mean);
  const MeanEstimate& d = m->difference;
  if (d.count < 2) {
    m->verdict = Verdict::kNothing;
  } else if (d.kind == IntervalKind::kConstant && d.mean == 0.0) {
    m->verdict = Verdict::kIdentical;
  } else if (m->p_holm <= alpha) {
    m->verdict = d.mean < 0.0 ? Verdict::kLower : Verdict::kHigher;
  } else if (d.kind != IntervalKind::kConstant && -relevant < d.interval.low && d.interval.high < relevant) {
    m->verdict = Verdict::kIrrelevant;
  } else {
    m->verdict = Verdict::kOpen;
    // To tell the difference seen, or the smallest relevant one if that is larger, from zero at Holm's first
    // and strictest step. The permutation test needs enough pairs to get there at all.
    const double level = alpha / static_cast<double>(family);
    std::size_t least = d.count + 1;
    while (SmallestPossibleP(least) > level) ++least;
    const double target = std::max(std::abs(d.mean), relevant);
    if (d.deviation == 0.0) {
      m->seeds_needed = least;
    } else if (const auto pairs =
                   target > 0.0 ? PairsForPower(target / d.deviation, level, params.power) : std::nullopt) {
      m->seeds_needed = std::max(*pairs, least);
    }
  }
}

void AdjustAndJudge(const CompareParams& params, std::vector<PolicyComparison>* policies,
                    std::size_t* family) {
  std::vector<MetricComparison*> tests;
  std::vector<double> p_values;
  for (PolicyComparison& policy : *policies) {
    for (MetricComparison& metric : policy.metrics) {
      if (metric.difference.count < 2) continue;
      tests.push_back(&metric);
      p_values.push_back(metric.p.p);
    }
  }
  *family = tests.size();
  const std::vector<double> adjusted = HolmAdjust(p_values);
  for (std::size_t i = 0; i < tests.size(); ++i) {
    tests[i]->p_holm = adjusted[i];
    Judge(tests.size(), params, tests[i]);
  }
}

/// Why runs found no partner: the same seed with other inputs is the case users do not expect.
void NoteUnpaired(const RunsByKey& baseline, const std::string& baseline_name, const RunsByKey& policy,
                  const std::string& name, ScenarioComparison* out) {
  const auto unpaired = [](const RunsByKey& from, const RunsByKey& in) {
    std::vector<std::int64_t> seeds;
    for (const auto& [key, run] : from) {
      if (in.find(key) == in.end()) seeds.push_back(key.seed);
    }
    return seeds;
  };
  const std::vector<std::int64_t> left = unpaired(policy, baseline), right = unpaired(baseline, policy);
  if (!left.empty())
    out->notes.push_back(fmt::format("unpaired: {} of {} without a partner in {}: {} {}",
                                     Count(left.size(), "run"), name, baseline_name,
                                     left.size() == 1 ? "seed" : "seeds", List(left)));
  if (!right.empty())
    out->notes.push_back(fmt::format("unpaired: {} of {} without a partner in {}: {} {}",
                                     Count(right.size(), "run"), baseline_name, name,
                                     right.size() == 1 ? "seed" : "seeds", List(right)));
  out->partial = out->partial || !left.empty() || !right.empty();
  std::set<std::int64_t> common;
  for (const std::int64_t seed : left) {
    if (std::find(right.begin(), right.end(), seed) != right.end()) common.insert(seed);
  }
  if (common.empty()) return;
  const auto with_seed = [&](const RunsByKey& runs) {
    for (const auto& [key, run] : runs) {
      if (key.seed == *common.begin()) return run;
    }
    return static_cast<const RunRecord*>(nullptr);
  };
  const RunRecord *a = with_seed(policy), *b = with_seed(baseline);
  out->notes.push_back(fmt::format(
      "{} of {} and {} with equal seeds differ in their demand ({}); --ignore-demand pairs them by seed "
      "alone",
      Count(common.size(), "run"), name, baseline_name,
      a->options == b->options ? "other input files"
                               : fmt::format("SUMO's options: '{}' and '{}'", a->options, b->options)));
}

void NoteDrivers(const RunsByLabel& selected, ScenarioComparison* out) {
  for (const auto& [label, runs] : selected) {
    std::set<std::string> versions;
    std::size_t unfinished = 0, waiting = 0, teleporting = 0;
    std::int64_t still_running = 0, not_inserted = 0, teleported = 0;
    for (const auto& [key, run] : runs) {
      versions.insert(run->lanewise_version + " " + run->git_commit + ", SUMO " + run->sumo_version);
      unfinished += run->still_running > 0;
      waiting += run->not_inserted > 0;
      teleporting += run->teleported > 0;
      still_running += run->still_running;
      not_inserted += run->not_inserted;
      teleported += run->teleported;
    }
    if (unfinished > 0)
      out->notes.push_back(fmt::format(
          "{}: {} vehicles still under way at the end of {}; means over arrived vehicles leave them out",
          label, still_running, Count(unfinished, "run")));
    if (waiting > 0)
      out->notes.push_back(
          fmt::format("{}: {} vehicles never inserted in {}; no measure counts their waiting", label,
                      not_inserted, Count(waiting, "run")));
    if (teleporting > 0)
      out->notes.push_back(
          fmt::format("{}: {} teleports in {}", label, teleported, Count(teleporting, "run")));
    if (versions.size() > 1)
      out->notes.push_back(
          fmt::format("{}: runs of {} versions ({})", label, versions.size(), List(versions)));
  }
}

ScenarioComparison CompareScenario(const std::string& scenario, const std::vector<const RunRecord*>& runs,
                                   const std::vector<std::size_t>& metrics, const CompareParams& params) {
  ScenarioComparison out;
  out.scenario = scenario;
  out.metrics = metrics;
  const RunsByLabel selected = SelectRuns(runs, params, &out);
  if (selected.empty()) {
    out.notes.push_back("no run is left to compare");
    return out;
  }
  if (!params.baseline.empty()) {
    if (selected.count(params.baseline) == 0) {
      out.notes.push_back(
          fmt::format("no finished run of the baseline {} in this scenario", params.baseline));
      out.partial = true;
    } else {
      out.baseline = params.baseline;
    }
  } else {
    for (const auto& [label, group] : selected) {
      const bool native = group.begin()->second->agent_share == 0.0;
      if (out.baseline.empty() || (native && label.find("sumo") != std::string::npos)) out.baseline = label;
      if (label == "sumo") break;
    }
  }
  NoteDrivers(selected, &out);
  if (!out.baseline.empty())
    out.summaries.push_back(Summarize(out.baseline, selected.at(out.baseline), metrics, params.statistics));
  for (const auto& [label, group] : selected) {
    if (label != out.baseline) out.summaries.push_back(Summarize(label, group, metrics, params.statistics));
  }
  if (selected.size() == 1) {
    out.notes.push_back(
        fmt::format("only one policy, {}: nothing to compare it with", selected.begin()->first));
    out.partial = true;
  }
  if (out.baseline.empty()) return out;

  const RunsByKey& baseline = selected.at(out.baseline);
  for (const auto& [label, group] : selected) {
    if (label == out.baseline) continue;
    NoteUnpaired(baseline, out.baseline, group, label, &out);
    PolicyComparison comparison;
    comparison.policy = label;
    for (const auto& [key, run] : group) comparison.pairs += baseline.count(key);
    if (comparison.pairs == 0) {
      out.partial = true;
      continue;
    }
    for (const std::size_t metric : metrics) {
      const PairedValues values = ValuesOf(baseline, group, metric);
      if (!values.undefined.empty()) {
        out.notes.push_back(
            fmt::format("{}: {} undefined (NULL or not a number) in {} with {}: {} {}; left out there", label,
                        AllMetrics()[metric].name, Count(values.undefined.size(), "pair"), out.baseline,
                        values.undefined.size() == 1 ? "seed" : "seeds", List(values.undefined)));
        out.partial = true;
      }
      if (!values.differences.empty())
        comparison.metrics.push_back(
            CompareMetric(metric, values.baseline, values.differences, params.statistics));
    }
    out.policies.push_back(std::move(comparison));
  }
  AdjustAndJudge(params, &out.policies, &out.family);
  for (const PolicyComparison& policy : out.policies) {
    if (policy.pairs == 1) {
      out.notes.push_back(
          fmt::format("{}: one pair only; one difference says nothing of its own spread, so there is "
                      "neither interval nor test",
                      policy.policy));
      out.partial = true;
    } else if (out.family > 0 &&
               SmallestPossibleP(policy.pairs) * static_cast<double>(out.family) > params.statistics.alpha) {
      std::size_t needed = policy.pairs;
      while (SmallestPossibleP(needed) * static_cast<double>(out.family) > params.statistics.alpha) ++needed;
      out.notes.push_back(
          fmt::format("{}: {} pairs cannot give a p below {:.2g}; with {} comparisons in the family at least "
                      "{} seeds are "
                      "needed for a significant result (fewer metrics: fewer seeds)",
                      policy.policy, policy.pairs, SmallestPossibleP(policy.pairs), out.family, needed));
    }
  }
  return out;
}

std::vector<std::size_t> ChosenMetrics(const CompareParams& params) {
  if (!params.metrics.empty()) return params.metrics;
  std::vector<std::size_t> chosen;
  for (std::size_t i = 0; i < AllMetrics().size(); ++i) {
    if (AllMetrics()[i].headline) chosen.push_back(i);
  }
  return chosen;
}

std::map<std::string, std::vector<const RunRecord*>> ByScenario(std::span<const RunRecord> runs) {
  std::map<std::string, std::vector<const RunRecord*>> groups;
  for (const RunRecord& run : runs) groups[run.scenario].push_back(&run);
  return groups;
}

void CheckBaseline(std::span<const RunRecord> runs, const std::string& baseline, const char* option) {
  std::set<std::string, LabelOrder> labels;
  for (const RunRecord& run : runs) labels.insert(run.label);
  if (!baseline.empty() && labels.count(baseline) == 0)
    throw ConfigError(
        fmt::format("{}: no run of '{}'; there are: {}", option, baseline, fmt::join(labels, ", ")));
}

/// Values of the chosen metrics of the draws' population, one row a run or pair.
using Population = std::vector<std::vector<std::optional<double>>>;

AaResult Resample(const Population& population, bool differences, std::size_t pairs, std::size_t repetitions,
                  const std::vector<std::size_t>& metrics, const CompareParams& params) {
  constexpr std::uint64_t kDrawStream = 3;
  AaResult result;
  result.runs = population.size();
  result.pairs = pairs;
  result.repetitions = repetitions;
  std::vector<double> truth(metrics.size(), 0.0);
  std::vector<char> defined(metrics.size(), 1);
  for (std::size_t m = 0; m < metrics.size(); ++m) {
    for (const auto& row : population) {
      if (!row[m]) defined[m] = 0;
      if (differences && row[m]) truth[m] += *row[m] / static_cast<double>(population.size());
    }
    result.coverage.push_back({metrics[m], 0, 0});
  }
  for (std::size_t repetition = 0; repetition < repetitions; ++repetition) {
    const auto draw = [&](std::size_t k) {
      const std::uint64_t bits =
          CounterRandom(params.statistics.seed, kDrawStream, repetition * 2 * pairs + k);
      return static_cast<std::size_t>((bits >> 32) * population.size() >> 32);
    };
    std::vector<double> p_values;
    StatisticsParams statistics = params.statistics;
    statistics.seed += repetition + 1;
    for (std::size_t m = 0; m < metrics.size(); ++m) {
      if (!defined[m]) continue;
      std::vector<double> values;
      for (std::size_t k = 0; k < pairs; ++k) {
        const double a = *population[draw(2 * k)][m];
        values.push_back(differences ? a : *population[draw(2 * k + 1)][m] - a);
      }
      const MeanEstimate estimate = EstimateMean(values, statistics);
      // A constant sample has no interval to judge: it claims nothing.
      if (estimate.kind != IntervalKind::kConstant) {
        ++result.coverage[m].intervals;
        const double slack = 1e-9 * (std::abs(truth[m]) + estimate.deviation);
        result.coverage[m].covered +=
            estimate.interval.low <= truth[m] + slack && truth[m] - slack <= estimate.interval.high;
      }
      p_values.push_back(TestZeroMean(values, statistics).p);
    }
    if (differences) continue;
    result.comparisons += p_values.size();
    std::size_t alarms = 0;
    for (const double p : HolmAdjust(p_values)) alarms += p <= params.statistics.alpha;
    result.significant += alarms;
    result.families_with_alarm += alarms > 0;
  }
  return result;
}

}  // namespace

bool Comparison::partial() const {
  return std::any_of(scenarios.begin(), scenarios.end(), [](const auto& s) { return s.partial; });
}

bool Comparison::any_pair() const {
  return std::any_of(scenarios.begin(), scenarios.end(), [](const auto& s) { return !s.policies.empty(); });
}

Comparison Compare(std::span<const RunRecord> runs, const CompareParams& params) {
  if (runs.empty())
    throw ConfigError("there is no run to compare; record some with: lanewise run --results FILE");
  CheckBaseline(runs, params.baseline, "--baseline");
  Comparison comparison;
  comparison.params = params;
  comparison.runs = runs.size();
  for (const auto& [scenario, group] : ByScenario(runs))
    comparison.scenarios.push_back(CompareScenario(scenario, group, ChosenMetrics(params), params));
  return comparison;
}

std::vector<AaResult> RunAaTest(std::span<const RunRecord> runs, const std::string& label,
                                const std::string& against, std::size_t pairs, std::size_t repetitions,
                                const CompareParams& params) {
  CheckBaseline(runs, label, "--aa");
  CheckBaseline(runs, against, "--against");
  const std::vector<std::size_t> metrics = ChosenMetrics(params);
  std::vector<AaResult> results;
  for (const auto& [scenario, group] : ByScenario(runs)) {
    ScenarioComparison ignored;
    const RunsByLabel selected = SelectRuns(group, params, &ignored);
    const auto chosen = selected.find(label), other = selected.find(against);
    if (chosen == selected.end() || (!against.empty() && other == selected.end())) continue;
    Population population;
    for (const auto& [key, run] : chosen->second) {
      const RunRecord* partner = nullptr;
      if (!against.empty()) {
        const auto found = other->second.find(key);
        if (found == other->second.end()) continue;
        partner = found->second;
      }
      std::vector<std::optional<double>>& row = population.emplace_back();
      for (const std::size_t metric : metrics) {
        std::optional<double> value = run->metrics[metric];
        if (partner != nullptr && value) {
          value = partner->metrics[metric] ? std::optional(*value - *partner->metrics[metric]) : std::nullopt;
        }
        row.push_back(value);
      }
    }
    if (population.size() < 6)
      throw ConfigError(fmt::format("--aa: scenario {} has {} to draw from; at least 6 are needed", scenario,
                                    Count(population.size(), against.empty() ? "run" : "pair")));
    AaResult result = Resample(population, !against.empty(), pairs, repetitions, metrics, params);
    result.scenario = scenario;
    result.policy = label;
    results.push_back(std::move(result));
  }
  return results;
}

}  // namespace lanewise
