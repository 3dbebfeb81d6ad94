// The promise: same binary, same seed, any number of threads: the same run, bit for bit.

#include <gtest/gtest.h>

#include "tests/support/sumo_run.h"

namespace lanewise {
namespace {

std::uint64_t HashOf(RunConfig config, int threads) {
  config.threads = threads;
  const RunReport report = RunResolved(config);
  EXPECT_GT(report.outcome.vehicle_steps, 1000);
  return report.outcome.state_hash;
}

void ExpectSameForAnyThreads(const RunConfig& config) {
  const std::uint64_t one = HashOf(config, 1);
  EXPECT_EQ(HashOf(config, 2), one);
  EXPECT_EQ(HashOf(config, 4), one);
  EXPECT_EQ(HashOf(config, 1), one) << "repeat";
  RunConfig other = config;
  other.seed = config.seed + 1;
  EXPECT_NE(HashOf(other, 2), one) << "another seed is another run";
}

TEST(Determinism, Town) {
  ExpectSameForAnyThreads(ShippedRun("town", Policy::kDwa, 60.0));
}

TEST(Determinism, TownUnderTheAgentsOwnRules) {
  RunConfig config = ShippedRun("town", Policy::kDwa, 60.0);
  config.rules = Rules::kAgent;
  ExpectSameForAnyThreads(config);
}

TEST(Determinism, BolognaAcosta) {
  const auto file = BolognaScenario("acosta");
  if (file.empty()) GTEST_SKIP() << "no Bologna scenarios in " << kBolognaFolder;
  const TemporaryFolder folder;
  ExpectSameForAnyThreads(BolognaRun(file, folder.path(), 60.0));
}

// Storing results must not change the run.
TEST(Determinism, RecordingDoesNotMatter) {
  const TemporaryFolder folder;
  RunConfig config = ShippedRun("town", Policy::kDwa, 30.0);
  const std::uint64_t without = HashOf(config, 2);
  config.results = folder / "town.sqlite";
  config.sample_period = 0.0;
  EXPECT_EQ(HashOf(config, 2), without);
}

}  // namespace
}  // namespace lanewise
