#include "scenarios/compare.h"

#include <fmt/core.h>

#include <memory>

#include "agents/core/check.h"
#include "analysis/comparison.h"
#include "analysis/comparison_format.h"

namespace lanewise {
namespace {

struct CompareOptions {
  std::vector<std::string> files, metrics, include;
  std::string format{"text"}, test{"permutation"}, aa, against;
  CompareParams params;
  std::size_t repetitions{200}, pairs{20};
  bool by_file{false}, list{false};
};

void CheckRange(const char* option, double value, double min, double max) {
  if (!(value >= min && value <= max))
    throw ConfigError(fmt::format("{}: {}; allowed: {} to {}", option, value, min, max));
}

CompareParams Finish(const CompareOptions& o) {
  CompareParams params = o.params;
  CheckRange("--alpha", params.statistics.alpha, 1e-6, 0.5);
  CheckRange("--resamples", params.statistics.resamples, 99, 1'000'000);
  CheckRange("--smallest-effect", params.smallest_effect, 0.0, 1.0);
  CheckRange("--power", params.power, 0.5, 0.999);
  CheckRange("--repetitions", static_cast<double>(o.repetitions), 1, 100'000);
  CheckRange("--pairs", static_cast<double>(o.pairs), 2, 1000);
  if (o.test == "wilcoxon") {
    params.statistics.test = SignificanceTest::kWilcoxon;
  } else if (o.test != "permutation") {
    throw ConfigError(fmt::format("--test: unknown value '{}'; allowed: permutation, wilcoxon", o.test));
  }
  for (const std::string& name : o.metrics) {
    if (name == "all") {
      for (std::size_t i = 0; i < AllMetrics().size(); ++i) params.metrics.push_back(i);
    } else {
      params.metrics.push_back(FindMetric(name, "--metric"));
    }
  }
  std::sort(params.metrics.begin(), params.metrics.end());
  params.metrics.erase(std::unique(params.metrics.begin(), params.metrics.end()), params.metrics.end());
  for (const std::string& what : o.include) {
    if (what == "interrupted") {
      params.include_interrupted = true;
    } else if (what == "over-budget") {
      params.include_over_budget = true;
    } else {
      throw ConfigError(
          fmt::format("--include: unknown value '{}'; allowed: interrupted, over-budget", what));
    }
  }
  if (o.aa.empty() && !o.against.empty()) throw ConfigError("--against: needs --aa, which names the policy");
  return params;
}

int ListMetrics() {
  for (const MetricInfo& metric : AllMetrics()) {
    fmt::print("{:<30} {:<34} {}{}\n", metric.name, metric.label, metric.meaning,
               metric.headline ? " (compared by default)" : "");
  }
  return 0;
}

int RunCompare(const CompareOptions& o) {
  if (o.list) return ListMetrics();
  if (o.files.empty()) throw ConfigError("compare: RESULTS is missing; name at least one results file");
  const CompareParams params = Finish(o);
  const TableFormat format = ParseTableFormat(o.format, "--format");
  const std::vector<std::filesystem::path> files(o.files.begin(), o.files.end());
  const std::vector<RunRecord> runs = LoadRuns(files, o.by_file);
  if (runs.empty())
    throw ConfigError(
        fmt::format("results file {}: it holds no runs; record some with: lanewise run --results {} --policy "
                    "dwa, and --policy sumo",
                    o.files[0], o.files[0]));
  if (!o.aa.empty()) {
    fmt::print("{}", FormatAaResults(RunAaTest(runs, o.aa, o.against, o.pairs, o.repetitions, params),
                                     !o.against.empty()));
    return 0;
  }
  const Comparison comparison = Compare(runs, params);
  fmt::print("{}", FormatComparison(comparison, format));
  if (comparison.any_pair()) return 0;
  fmt::print(stderr, "lanewise: no two runs could be paired, so nothing was compared; the notes say why\n");
  return 1;
}

}  // namespace

void AddCompareCommand(CLI::App* app, std::function<int()>* chosen) {
  const auto o = std::make_shared<CompareOptions>();
  CLI::App* compare = app->add_subcommand(
      "compare",
      "Policies against a baseline, pair by pair: differences, intervals, tests, what is still open");
  compare->add_option("RESULTS", o->files, "results files (SQLite); their runs are taken together");
  compare->add_option("--baseline", o->params.baseline,
                      "policy the others are compared with; default: sumo if there is a run of it");
  compare
      ->add_option("--metric", o->metrics,
                   "only these (comma-separated or repeated), or all; see --list-metrics")
      ->delimiter(',');
  compare->add_flag("--list-metrics", o->list, "name the metrics and end");
  compare->add_option("--format", o->format, "text, md, csv, json or latex")->capture_default_str();
  compare
      ->add_option("--test", o->test,
                   "permutation (of signs; exact up to 20 pairs) or wilcoxon (signed ranks)")
      ->capture_default_str();
  compare->add_option("--alpha", o->params.statistics.alpha, "level of tests; intervals cover 1 - alpha")
      ->capture_default_str();
  compare
      ->add_option(
          "--smallest-effect", o->params.smallest_effect,
          "share of the baseline's mean that would matter: an interval within it settles 'no relevant "
          "difference'")
      ->capture_default_str();
  compare
      ->add_option("--power", o->params.power,
                   "with which the number of seeds for open questions is worked out")
      ->capture_default_str();
  compare->add_option("--include", o->include, "interrupted, over-budget: take such runs in; they stay named")
      ->delimiter(',');
  compare->add_flag(
      "--ignore-demand", o->params.ignore_demand,
      "pair by scenario and seed though input files or SUMO options differ (penetration studies)");
  compare->add_flag("--by-file", o->by_file,
                    "the same policy in two files is two policies (versions of Lanewise)");
  compare->add_option("--resamples", o->params.statistics.resamples, "of the bootstrap")
      ->capture_default_str();
  compare->add_option("--bootstrap-seed", o->params.statistics.seed, "same seed, same intervals")
      ->capture_default_str();
  compare->add_option(
      "--aa", o->aa,
      "A/A test instead: draw this policy's runs under two names, count false alarms and intervals "
      "that hold zero");
  compare->add_option(
      "--against", o->against,
      "with --aa: draw recorded pairs with this policy; do intervals hold the recorded difference?");
  compare->add_option("--repetitions", o->repetitions, "of the A/A test")->capture_default_str();
  compare->add_option("--pairs", o->pairs, "in each repetition of the A/A test")->capture_default_str();
  compare->footer(
      "Examples:\n"
      "  for s in 1 2 3 4 5 6 7 8 9 10; do for p in sumo dwa; do\n"
      "    lanewise run --scenario town --seed $s --policy $p --results town.sqlite; done; done\n"
      "  lanewise compare town.sqlite\n"
      "  lanewise compare town.sqlite --baseline idm --metric time_loss_s,co2_g_per_km --format latex\n"
      "  lanewise compare old.sqlite new.sqlite --by-file --baseline old:dwa\n"
      "  lanewise compare town.sqlite --aa dwa            (is the procedure itself honest on my data?)\n"
      "Exit code 1: nothing could be paired; what is known of each policy alone is printed.");
  compare->callback([o, chosen] { *chosen = [o] { return RunCompare(*o); }; });
}

}  // namespace lanewise
