// Messages and cooperative cruise in coupled runs.

#include <gtest/gtest.h>

#include "tests/support/sumo_run.h"

namespace lanewise {
namespace {

constexpr double kEnd = 60.0;  // [s]

RunConfig Town(V2xLevel level, int cruise) {
  RunConfig config = ShippedRun("town", Policy::kDwa, kEnd);
  config.v2x = level;
  config.params.v2x.cruise = cruise;
  return config;
}

TEST(V2x, DeafIsAsWithoutRadio) {
  const RunReport off = RunResolved(Town(V2xLevel::kOff, 1));
  RunConfig config = Town(V2xLevel::kLossy, 1);
  config.params.v2x.loss = 1.0;
  const RunReport lost = RunResolved(config);
  EXPECT_GT(lost.v2x.sent, 0);
  EXPECT_EQ(lost.v2x.fates[static_cast<std::size_t>(Fate::kDelivered)], 0);
  EXPECT_EQ(lost.outcome.state_hash, off.outcome.state_hash) << "loss 100 %";
  config = Town(V2xLevel::kRange, 1);
  config.params.v2x.range = 0.0;
  const RunReport alone = RunResolved(config);
  EXPECT_EQ(alone.outcome.state_hash, off.outcome.state_hash) << "range 0";
  config = Town(V2xLevel::kLoaded, 1);
  config.params.v2x.share = 0.0;
  const RunReport none = RunResolved(config);
  EXPECT_EQ(none.v2x.sent, 0);
  EXPECT_EQ(none.outcome.state_hash, off.outcome.state_hash) << "nobody carries a radio";
}

TEST(V2x, ListeningAloneChangesNoMotion) {
  const RunReport off = RunResolved(Town(V2xLevel::kOff, 0));
  const RunReport on = RunResolved(Town(V2xLevel::kLoaded, 0));
  EXPECT_GT(on.v2x.fates[static_cast<std::size_t>(Fate::kDelivered)], 0);
  EXPECT_EQ(on.outcome.state_hash, off.outcome.state_hash);
}

TEST(V2x, CruisingIsTheSameForAnyThreads) {
  RunConfig config = Town(V2xLevel::kLoaded, 1);
  const RunReport one = RunResolved(config);
  config.threads = 4;
  const RunReport four = RunResolved(config);
  EXPECT_EQ(four.outcome.state_hash, one.outcome.state_hash);
  EXPECT_EQ(four.v2x.fates, one.v2x.fates);
  EXPECT_EQ(four.v2x.age_steps, one.v2x.age_steps);
  EXPECT_GT(one.v2x.platoon_joins, 0);
  EXPECT_GT(one.v2x.platoon_leaves, 0);
  EXPECT_GT(one.v2x.cruise_steps, 0);
  const RunReport off = RunResolved(Town(V2xLevel::kOff, 1));
  EXPECT_NE(one.outcome.state_hash, off.outcome.state_hash);
}

TEST(V2x, ResultsTellWhatWentOverTheRadio) {
  const TemporaryFolder folder;
  RunConfig config = Town(V2xLevel::kLoaded, 1);
  config.end = 90.0;  // One interval and a half.
  config.results = folder / "town.sqlite";
  const RunReport report = RunResolved(config);
  const auto sum = [&](const std::string& column) {
    return Query(*config.results, "SELECT SUM(" + column + ") FROM v2x_interval");
  };
  const auto fate = [&](Fate f) {
    return static_cast<double>(report.v2x.fates[static_cast<std::size_t>(f)]);
  };
  EXPECT_EQ(Query(*config.results, "SELECT COUNT(*) FROM v2x_interval"), 2);
  EXPECT_EQ(sum("sent"), static_cast<double>(report.v2x.sent));
  EXPECT_EQ(sum("delivered"), fate(Fate::kDelivered));
  EXPECT_EQ(sum("faded"), fate(Fate::kFaded));
  EXPECT_EQ(sum("collided"), fate(Fate::kCollided));
  EXPECT_NEAR(sum("cruise_time_s"), 0.1 * static_cast<double>(report.v2x.cruise_steps), 1e-6);
  // The distribution of the ages has the mean of the intervals.
  const double pair_time = Query(*config.results, "SELECT SUM(pair_time_s) FROM v2x_age");
  EXPECT_NEAR(pair_time, sum("pair_time_s"), 1e-6 * pair_time);
  EXPECT_NEAR(Query(*config.results, "SELECT SUM(age_s * pair_time_s) FROM v2x_age"),
              sum("pair_time_s * mean_age_s"), 1e-6 * pair_time);
  EXPECT_GT(sum("mean_busy_ratio"), 0.0);
  EXPECT_EQ(Query(*config.results, "SELECT v2x = 'loaded' FROM run"), 1);
  EXPECT_NEAR(Query(*config.results, "SELECT v2x_delivered_share FROM v_run_metrics"),
              fate(Fate::kDelivered) / (fate(Fate::kDelivered) + fate(Fate::kFaded) + fate(Fate::kCollided)),
              1e-12);
}

}  // namespace
}  // namespace lanewise
