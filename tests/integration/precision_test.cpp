// --until-ci: when intervals are narrow enough, and how many seeds more are worth trying.

#include "scenarios/study/precision.h"

#include <gtest/gtest.h>

#include <cmath>

#include "agents/core/check.h"

namespace lanewise {
namespace {

constexpr std::size_t kMetric = 0;

/// One policy against a baseline of mean 40, its interval 3 +- half_width.
Comparison OnePolicy(double half_width, std::size_t pairs) {
  MetricComparison metric;
  metric.metric = kMetric;
  metric.baseline_mean = 40.0;
  metric.difference = {pairs, 3.0, 1.0, IntervalKind::kBca, {3.0 - half_width, 3.0 + half_width}};
  PolicyComparison policy;
  policy.policy = "dwa";
  policy.pairs = pairs;
  policy.metrics = {metric};
  ScenarioComparison scenario;
  scenario.scenario = "town";
  scenario.baseline = "sumo";
  scenario.policies = {policy};
  Comparison comparison;
  comparison.scenarios = {scenario};
  return comparison;
}

TEST(Precision, IsReachedAtTheShareOfTheBaselinesMean) {
  const PrecisionGoal goal{0.05, kMetric};  // +- 2.
  EXPECT_TRUE(JudgePrecision(OnePolicy(1.999, 10), goal).reached);
  EXPECT_FALSE(JudgePrecision(OnePolicy(2.001, 10), goal).reached);
  EXPECT_TRUE(JudgePrecision(OnePolicy(0.0, 10), goal).reached);
}

TEST(Precision, SeedsGrowWithTheSquareOfTheWidthAndAtMostDouble) {
  const PrecisionGoal goal{0.05, kMetric};
  // Width ~ 1 / sqrt(n): from +- 2.4 to +- 2 takes 1.44 times the pairs.
  EXPECT_EQ(JudgePrecision(OnePolicy(2.4, 100), goal).more_seeds, 44);
  EXPECT_EQ(JudgePrecision(OnePolicy(20.0, 100), goal).more_seeds, 100);
}

TEST(Precision, FewPairsAreNeverEnough) {
  const Precision precision = JudgePrecision(OnePolicy(0.0, 4), {0.05, kMetric});
  EXPECT_FALSE(precision.reached);
  EXPECT_EQ(precision.more_seeds, 2);
  EXPECT_NE(precision.widest.find("4 pairs"), std::string::npos) << precision.widest;
}

TEST(Precision, TheWidestOfAllScenariosAndPoliciesCounts) {
  Comparison comparison = OnePolicy(1.0, 10);
  comparison.scenarios.push_back(OnePolicy(2.2, 10).scenarios[0]);
  comparison.scenarios[1].scenario = "merge";
  const Precision precision = JudgePrecision(comparison, {0.05, kMetric});
  EXPECT_FALSE(precision.reached);
  EXPECT_EQ(precision.more_seeds, 3);  // 10 (1.1^2 - 1) = 2.1.
  EXPECT_NE(precision.widest.find("merge, dwa against sumo"), std::string::npos) << precision.widest;
}

TEST(Precision, ABaselineOfZeroHasNoShare) {
  Comparison comparison = OnePolicy(0.1, 10);
  comparison.scenarios[0].policies[0].metrics[0].baseline_mean = 0.0;
  EXPECT_FALSE(JudgePrecision(comparison, {0.05, kMetric}).reached);
}

TEST(Precision, NothingToCompareIsAnError) {
  EXPECT_THROW(JudgePrecision(Comparison{}, {0.05, kMetric}), ConfigError);
}

TEST(PrecisionGoal, NamesAShareAndAMetric) {
  const PrecisionGoal goal = ParsePrecisionGoal("0.05:mean_time_loss");
  EXPECT_DOUBLE_EQ(goal.half_width, 0.05);
  EXPECT_STREQ(AllMetrics()[goal.metric].name, "time_loss_s");
  EXPECT_STREQ(AllMetrics()[ParsePrecisionGoal("1:co2").metric].name, "co2_g_per_km");
  for (const char* text : {"", "0.05", "0.05:", "x:time_loss_s", "0:time_loss_s", "-1:time_loss_s",
                           "0.05:loss", "0.05 :time_loss_s", "nan:time_loss_s"})
    EXPECT_THROW(ParsePrecisionGoal(text), ConfigError) << text;
}

}  // namespace
}  // namespace lanewise
