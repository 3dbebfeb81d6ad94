// Study files: what runs they ask for, and what is said of those that ask wrongly.

#include "scenarios/study/study_plan.h"

#include <gtest/gtest.h>

#include <set>

#include "libsumo_bridge/vehicle_bridge.h"
#include "tests/support/temporary_folder.h"

namespace lanewise {
namespace {

RunInterface SomeOptions() {
  RunInterface run;
  for (const char* name :
       {"scenario", "configuration-file", "policy", "penetration", "seed", "end", "results", "set"})
    run.options.push_back({name, false});
  run.options.push_back({"fast", true});
  run.parse = [](const std::vector<std::string>&, const std::vector<std::string>&) { return RunConfig{}; };
  return run;
}

class StudyPlanFile : public testing::Test {
 protected:
  StudyPlan Load(const std::string& text) const {
    return StudyPlan::Load(folder_.Write("s.toml", text), SomeOptions());
  }
  std::vector<PlannedRun> Runs(const std::string& text, std::int64_t extra_seeds = 0) const {
    std::vector<PlannedRun> runs;
    Load(text).ForEach(extra_seeds, [&](const PlannedRun& run) { runs.push_back(run); });
    return runs;
  }
  std::string Error(const std::string& text) const {
    try {
      Load(text);
    } catch (const ConfigError& error) {
      return error.what();
    }
    return "";
  }

  TemporaryFolder folder_;
};

TEST_F(StudyPlanFile, AGridHoldsEveryCombinationSeedsOutermost) {
  const auto runs = Runs("[run]\nscenario = 'town'\n[grid]\npolicy = ['idm', 'dwa']\nseed = [4, 7]\n");
  ASSERT_EQ(runs.size(), 4u);
  EXPECT_EQ(ToText(runs[0].settings), "policy=idm scenario=town seed=4");
  EXPECT_EQ(ToText(runs[1].settings), "policy=dwa scenario=town seed=4");
  EXPECT_EQ(ToText(runs[2].settings), "policy=idm scenario=town seed=7");
  EXPECT_EQ(runs[3].number, 4);
}

TEST_F(StudyPlanFile, ListsAndGridsAddUpAndEqualRunsAreRunOnce) {
  // The list repeats one run of the grid.
  const auto runs = Runs(
      "[grid]\nscenario = 'town'\nseed = [1, 2]\n[[runs]]\nscenario = 'town'\nseed = 2\n"
      "[[runs]]\nscenario = 'arena'\nseed = 2\n");
  EXPECT_EQ(runs.size(), 3u);
}

TEST_F(StudyPlanFile, NativeRunsHaveNoPenetration) {
  // sumo at 0, 0.5, 1 and dwa at 0 are one native run; dwa at 0.5 and 1 are two more.
  const auto runs =
      Runs("[grid]\nscenario = 'town'\npolicy = ['sumo', 'dwa']\npenetration = [0.0, 0.5, 1.0]\n");
  ASSERT_EQ(runs.size(), 3u);
  EXPECT_EQ(ToText(runs[0].settings), "policy=sumo scenario=town seed=23423");
}

TEST_F(StudyPlanFile, RangesCountExactly) {
  const auto runs = Runs("[grid]\nscenario = 'town'\npenetration = { from = 0.1, to = 1.0, step = 0.1 }\n");
  ASSERT_EQ(runs.size(), 10u);
  EXPECT_EQ(runs[2].settings[0].second, "0.3");  // Not 0.30000000000000004.
}

TEST_F(StudyPlanFile, FurtherSeedsFollowTheLargestAndLeaveTheOthersWhereTheyAre) {
  const std::string text = "[grid]\nscenario = 'town'\npolicy = ['idm', 'dwa']\nseed = [5, 3]\n";
  const auto before = Runs(text), after = Runs(text, 2);
  ASSERT_EQ(after.size(), 8u);
  for (std::size_t i = 0; i < before.size(); ++i) EXPECT_EQ(after[i].key, before[i].key);
  EXPECT_EQ(ToText(after[4].settings), "policy=idm scenario=town seed=6");
  EXPECT_EQ(ToText(after[7].settings), "policy=dwa scenario=town seed=7");
}

TEST_F(StudyPlanFile, ArgumentsAreThoseOfRunWithFilesBesideTheStudy) {
  const StudyPlan plan = Load(
      "[run]\nconfiguration-file = 'a/b.sumocfg'\nset.dwa.clearance_weight = 1.5\nsumo = '--scale 1.2'\nfast "
      "= true\n"
      "[grid]\nseed = 1\n");
  plan.ForEach(0, [&](const PlannedRun& run) {
    const std::vector<std::string> expected = {"--configuration-file",
                                               (folder_.path() / "a/b.sumocfg").string(),
                                               "--fast",
                                               "--seed",
                                               "1",
                                               "--set",
                                               "dwa.clearance_weight=1.5",
                                               "--",
                                               "--scale",
                                               "1.2"};
    EXPECT_EQ(plan.Arguments(run.settings), expected);
    EXPECT_EQ(SettingsFromJson(ToJson(run.settings)), run.settings);
  });
}

TEST_F(StudyPlanFile, WrongFilesAreRefusedWithLineAndNearestKey) {
  const std::pair<const char*, const char*> cases[] = {
      {"[grid]\npolcy = 'dwa'\n", "s.toml, line 2: unknown key 'polcy'; did you mean 'policy'?"},
      {"[gird]\nseed = 1\n", "unknown key 'gird'; did you mean 'grid'?"},
      {"policy = 'dwa'\n[grid]\nseed = 1\n", "belongs below [run] or [grid]"},
      {"[grid]\nset.'dwa.clearance_wieght' = 1\n", "did you mean 'dwa.clearance_weight'?"},
      {"[run]\nseed = [1, 2]\n[grid]\n", "line 2: 'seed' is a list"},
      {"[grid]\nseed = []\n", "'seed' is an empty list"},
      {"[grid]\nseed = [1, 1]\n", "'seed' holds a value twice"},
      {"[grid]\nseed = ['x']\n", "seed 'x' is no whole number"},
      {"[grid]\nseed = { from = 1, cuont = 3 }\n", "did you mean 'count'?"},
      {"[grid]\nresults = 'x.sqlite'\n", "'results' is set by the study's runner"},
      {"question = 3\n[grid]\n", "'question' is no text"},
      {"[grid\n", "line 1: broken TOML"},
      {"[run]\nseed = 1\n", "it asks for no runs"}};
  for (const auto& [text, expected] : cases)
    EXPECT_NE(Error(text).find(expected), std::string::npos) << text << "\n" << Error(text);
}

TEST(PenetrationRate, AHigherRateContainsTheVehiclesOfALowerOne) {
  std::size_t low = 0, high = 0;
  for (int i = 0; i < 10'000; ++i) {
    const std::string id = "flow." + std::to_string(i);
    const bool at_low = IsEquipped({0.2, 7}, id), at_high = IsEquipped({0.6, 7}, id);
    EXPECT_TRUE(!at_low || at_high) << id;
    EXPECT_FALSE(IsEquipped({0.0, 7}, id));
    EXPECT_TRUE(IsEquipped({1.0, 7}, id));
    low += at_low;
    high += at_high;
  }
  // Binomial: 2,000 and 6,000 with standard deviations of 40 and 49; five of them.
  EXPECT_NEAR(static_cast<double>(low), 2000, 200);
  EXPECT_NEAR(static_cast<double>(high), 6000, 245);
}

TEST(PenetrationRate, AnotherSeedDrawsOthers) {
  int same = 0;
  for (int i = 0; i < 1000; ++i)
    same += IsEquipped({0.5, 1}, std::to_string(i)) == IsEquipped({0.5, 2}, std::to_string(i));
  EXPECT_NEAR(same, 500, 80);  // Five standard deviations.
}

}  // namespace
}  // namespace lanewise
