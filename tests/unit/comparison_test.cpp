#include "analysis/comparison.h"

#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "agents/core/check.h"
#include "analysis/comparison_format.h"
#include "tests/support/run_records.h"

namespace lanewise {
namespace {

CompareParams OneMetric() {
  CompareParams params;
  params.metrics = {FindMetric("time_loss_s", "test")};
  return params;
}

/// sumo against dwa, which is worse by 1, 2, ... seconds.
std::vector<RunRecord> Worse(int seeds) {
  std::vector<RunRecord> runs;
  for (int seed = 1; seed <= seeds; ++seed) {
    runs.push_back(MakeRun("dwa", seed, 10.0 * seed + seed));
    runs.push_back(MakeRun("sumo", seed, 10.0 * seed));
  }
  return runs;
}

std::string Notes(const Comparison& c) {
  std::string text;
  for (const ScenarioComparison& s : c.scenarios) {
    for (const std::string& note : s.notes) text += note + '\n';
  }
  return text;
}

#define EXPECT_CONTAINS(text, part) EXPECT_NE(std::string(text).find(part), std::string::npos) << text

TEST(Compare, PairsBySeedAndNotByOrder) {
  std::vector<RunRecord> runs = Worse(8);
  std::reverse(runs.begin(), runs.begin() + 9);
  const Comparison c = Compare(runs, OneMetric());
  ASSERT_EQ(c.scenarios.size(), 1u);
  const ScenarioComparison& s = c.scenarios[0];
  EXPECT_EQ(s.baseline, "sumo");
  ASSERT_EQ(s.policies.size(), 1u);
  const MetricComparison& m = s.policies[0].metrics.at(0);
  EXPECT_EQ(s.policies[0].pairs, 8u);
  EXPECT_DOUBLE_EQ(m.difference.mean, 4.5);
  EXPECT_DOUBLE_EQ(m.baseline_mean, 45.0);
  EXPECT_DOUBLE_EQ(m.policy_mean, 49.5);
  EXPECT_DOUBLE_EQ(m.p.p, 2.0 / 256.0);
  EXPECT_EQ(m.verdict, Verdict::kHigher);
  EXPECT_FALSE(c.partial());
}

TEST(Compare, HolmCountsEveryComparisonOfAScenario) {
  std::vector<RunRecord> runs = Worse(8);
  for (int seed = 1; seed <= 8; ++seed)
    runs.push_back(MakeRun("idm", seed, 10.0 * seed + (seed % 2 ? 5.0 : -4.0)));
  CompareParams params = OneMetric();
  params.metrics.push_back(FindMetric("co2_g_per_km", "test"));
  const Comparison c = Compare(runs, params);
  EXPECT_EQ(c.scenarios[0].family, 4u);
  EXPECT_DOUBLE_EQ(c.scenarios[0].policies[0].metrics[0].p_holm, 4.0 * 2.0 / 256.0);
}

TEST(Compare, LeavesOutAndNamesWhatIsNoFairRun) {
  std::vector<RunRecord> runs = Worse(8);
  runs[0].status = "interrupted";
  runs[2].over_budget = 3;
  runs[5].status = "running";
  const Comparison c = Compare(runs, OneMetric());
  EXPECT_EQ(c.scenarios[0].policies[0].pairs, 5u);
  EXPECT_TRUE(c.partial());
  EXPECT_CONTAINS(Notes(c), "(dwa, seed 1) was interrupted");
  EXPECT_CONTAINS(Notes(c), "(dwa, seed 2) is over the audit's budget: 3");
  EXPECT_CONTAINS(Notes(c), "(sumo, seed 3) is still being written, or its process was killed");
  CompareParams params = OneMetric();
  params.include_interrupted = params.include_over_budget = true;
  EXPECT_EQ(Compare(runs, params).scenarios[0].policies[0].pairs, 7u);
}

TEST(Compare, SaysWhyRunsHaveNoPartner) {
  std::vector<RunRecord> runs = Worse(7);
  for (RunRecord& run : runs) {
    if (run.label == "dwa") run.demand = "other files";
  }
  const Comparison c = Compare(runs, OneMetric());
  EXPECT_FALSE(c.any_pair());
  EXPECT_TRUE(c.partial());
  EXPECT_CONTAINS(Notes(c), "--ignore-demand");
  EXPECT_CONTAINS(FormatComparison(c, TableFormat::kText), "PARTIAL");
  CompareParams params = OneMetric();
  params.ignore_demand = true;
  EXPECT_EQ(Compare(runs, params).scenarios[0].policies[0].pairs, 7u);
}

TEST(Compare, UndefinedMetricsLeaveTheirPairOnly) {
  std::vector<RunRecord> runs = Worse(8);
  runs[4].metrics[OneMetric().metrics[0]].reset();
  const Comparison c = Compare(runs, OneMetric());
  EXPECT_EQ(c.scenarios[0].policies[0].metrics[0].difference.count, 7u);
  EXPECT_CONTAINS(Notes(c), "time_loss_s undefined (NULL or not a number) in 1 pair with sumo: seed 3");
  EXPECT_TRUE(c.partial());
}

TEST(Compare, OnePolicyAndOnePairArePartial) {
  std::vector<RunRecord> runs = Worse(1);
  const Comparison pair = Compare(runs, OneMetric());
  EXPECT_CONTAINS(Notes(pair), "one pair only");
  EXPECT_EQ(pair.scenarios[0].policies[0].metrics[0].verdict, Verdict::kNothing);
  runs.pop_back();
  const Comparison one = Compare(runs, OneMetric());
  EXPECT_FALSE(one.any_pair());
  EXPECT_CONTAINS(Notes(one), "only one policy, dwa");
  EXPECT_EQ(one.scenarios[0].summaries.size(), 1u);
}

TEST(Compare, NoRunsAndUnknownBaselineAreRefused) {
  EXPECT_THROW(Compare({}, {}), ConfigError);
  CompareParams params;
  params.baseline = "nobody";
  EXPECT_THROW(Compare(Worse(2), params), ConfigError);
}

TEST(Compare, FewSeedsAreToldThatNothingCanBeSignificant) {
  const Comparison c = Compare(Worse(5), OneMetric());
  // 2 / 32 is the smallest p of five pairs; six give 2 / 64.
  EXPECT_CONTAINS(Notes(c), "at least 6 seeds");
  EXPECT_EQ(c.scenarios[0].policies[0].metrics[0].verdict, Verdict::kOpen);
  EXPECT_GE(c.scenarios[0].policies[0].metrics[0].seeds_needed.value_or(0), 6u);
}

TEST(Compare, SmallDifferencesAreSettledAsIrrelevant) {
  std::vector<RunRecord> runs;
  for (int seed = 1; seed <= 20; ++seed) {
    runs.push_back(MakeRun("sumo", seed, 100.0));
    runs.push_back(MakeRun("dwa", seed, 100.0 + (seed % 2 == 0 ? 1.0 : -1.0)));
  }
  EXPECT_EQ(Compare(runs, OneMetric()).scenarios[0].policies[0].metrics[0].verdict, Verdict::kIrrelevant);
}

TEST(Compare, RepeatedRunsCountOnce) {
  std::vector<RunRecord> runs = Worse(6);
  runs.push_back(runs[0]);
  const Comparison c = Compare(runs, OneMetric());
  EXPECT_EQ(c.scenarios[0].policies[0].pairs, 6u);
  EXPECT_CONTAINS(Notes(c), "with the same result");
}

TEST(Compare, FormatsHoldTheSameNumbers) {
  std::vector<RunRecord> runs = Worse(8);
  for (RunRecord& run : runs) run.scenario = "a_b & c, \"d\" | e";
  const Comparison c = Compare(runs, OneMetric());
  const auto json = nlohmann::json::parse(FormatComparison(c, TableFormat::kJson));
  EXPECT_EQ(json["scenarios"][0]["comparisons"][0]["metrics"][0]["difference"]["mean"], 4.5);
  EXPECT_EQ(json["partial"], false);
  EXPECT_CONTAINS(FormatComparison(c, TableFormat::kCsv),
                  "\"a_b & c, \"\"d\"\" | e\",sumo,dwa,time_loss_s,8,45,49.5,4.5,");
  EXPECT_CONTAINS(FormatComparison(c, TableFormat::kLatex), "a\\_b \\& c");
  EXPECT_CONTAINS(FormatComparison(c, TableFormat::kMarkdown),
                  "| time loss [s] | 45.0 | 49.5 | +4.5 | +10.0 % |");
  EXPECT_CONTAINS(FormatComparison(c, TableFormat::kText), "WORSE");
}

TEST(LabelRuns, KeepsApartWhatMustNotBeAveraged) {
  std::vector<RunRecord> runs{MakeRun("dwa", 1, 0), MakeRun("dwa", 2, 0), MakeRun("sumo", 1, 0),
                              MakeRun("sumo", 2, 0)};
  runs[0].parameters_json = R"({"a":1.0,"b":2.0})";
  runs[1].parameters_json = R"({"a":1.5,"b":2.0})";
  runs[3].shares = {{"sumo", 0.71}, {"dwa", 0.29}};
  runs[3].demand = "mixed";
  LabelRuns(false, &runs);
  EXPECT_EQ(runs[0].label, "dwa [a=1.0]");
  EXPECT_EQ(runs[1].label, "dwa [a=1.5]");
  EXPECT_EQ(runs[2].label, "sumo");
  EXPECT_EQ(runs[3].label, "dwa 29 %, sumo 71 %");
  runs[0].file = "/x/old.sqlite";
  LabelRuns(true, &runs);
  EXPECT_EQ(runs[0].label, "old:dwa [a=1.0]");
}

TEST(LabelRuns, SeedsOfOneMixStayTogether) {
  // A vTypeDistribution draws by seed; a handful of trams is no second policy; a run that broke off tells
  // nothing.
  std::vector<RunRecord> runs{MakeRun("dwa", 1, 0), MakeRun("dwa", 2, 0), MakeRun("dwa", 3, 0),
                              MakeRun("dwa", 1, 0)};
  runs[0].shares = {{"dwa", 0.64}, {"idm", 0.35}, {"sumo", 0.01}};
  runs[1].shares = {{"dwa", 0.56}, {"idm", 0.43}, {"sumo", 0.01}};
  runs[2].shares = {};
  runs[3].shares = {{"dwa", 0.2}, {"idm", 0.8}};
  runs[3].demand = "other";
  LabelRuns(false, &runs);
  for (const std::size_t i : {0u, 1u, 2u}) EXPECT_EQ(runs[i].label, "dwa 60 %, idm 39 %");
  EXPECT_EQ(runs[3].label, "dwa 20 %, idm 80 %");
}

/// Runs with values of a skewed distribution, by seed.
std::vector<RunRecord> Recorded(const std::string& policy, double shift) {
  std::vector<RunRecord> runs;
  for (int seed = 1; seed <= 20; ++seed) {
    runs.push_back(MakeRun(policy, seed, 0.0));
    for (std::size_t m = 0; m < runs.back().metrics.size(); ++m) {
      const double u =
          static_cast<double>(CounterRandom(m, 5, static_cast<std::uint64_t>(seed)) >> 11) * 0x1p-53;
      runs.back().metrics[m] = shift - std::log1p(-u);
    }
  }
  return runs;
}

TEST(AaTest, FalseAlarmsAndCoverageAreWhatIsClaimed) {
  CompareParams params;
  params.statistics.resamples = 1999;
  const auto results = RunAaTest(Recorded("dwa", 1.0), "dwa", "", 20, 200, params);
  ASSERT_EQ(results.size(), 1u);
  const AaResult& r = results[0];
  EXPECT_EQ(r.repetitions, 200u);
  EXPECT_LE(static_cast<double>(r.significant), 0.05 * static_cast<double>(r.comparisons));
  std::size_t intervals = 0, covered = 0;
  for (const AaResult::Coverage& c : r.coverage) {
    intervals += c.intervals;
    covered += c.covered;
  }
  const double coverage = static_cast<double>(covered) / static_cast<double>(intervals);
  EXPECT_GE(coverage, 0.93);
  EXPECT_LE(coverage, 0.97);
}

TEST(AaTest, FindsABrokenProcedure) {
  // At the level of one half every other interval has to miss: the count is able to fail.
  CompareParams params;
  params.statistics.resamples = 999;
  params.statistics.alpha = 0.5;
  const AaResult r = RunAaTest(Recorded("dwa", 1.0), "dwa", "", 20, 100, params)[0];
  EXPECT_GT(r.families_with_alarm, 25u);
  EXPECT_LT(r.coverage[0].covered, 70u);
}

TEST(AaTest, TooFewRunsAreRefused) {
  EXPECT_THROW(RunAaTest(Worse(4), "dwa", "", 20, 10, {}), ConfigError);
  EXPECT_THROW(RunAaTest(Worse(8), "idm", "", 20, 10, {}), ConfigError);
}

TEST(Comparison, LabelsAreOrderedByPenetration) {
  std::vector<std::string> labels = {
      "sumo", "dwa", "dwa at 75 %", "dwa at 5 %", "dwa [x=1]", "dwa at 25 % [x=1]", "bp"};
  std::sort(labels.begin(), labels.end(), LabelOrder());
  EXPECT_EQ(labels, (std::vector<std::string>{"bp", "dwa at 5 %", "dwa at 25 % [x=1]", "dwa at 75 %", "dwa",
                                              "dwa [x=1]", "sumo"}));
}

}  // namespace
}  // namespace lanewise
