// `lanewise compare` as a user runs it: on recorded runs, and on files that hold too little.

#include <SQLiteCpp/SQLiteCpp.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cstdlib>
#include <thread>

#include "analysis/results_file.h"
#include "tests/support/child_process.h"

namespace lanewise {
namespace {

namespace fs = std::filesystem;

#define EXPECT_CONTAINS(text, part) EXPECT_NE(std::string(text).find(part), std::string::npos) << text

/// Adds a run of two arrived trips with this mean time loss.
void AddRun(const fs::path& path, const std::string& policy, std::int64_t seed, double time_loss,
            RunStatus status = RunStatus::kFinished) {
  RunInfo info;
  info.scenario = "street";
  info.policy = policy;
  info.rules = "sumo";
  info.seed = seed;
  RunWriter writer(ResultsFile::Open(path, ResultsFile::Mode::kAppend), info);
  writer.Add<VehicleRow>({{0, "a", "car", "passenger", policy, 0.0, 0.0, 5.0, 1.8},
                          {1, "b", "car", "passenger", policy, 1.0, 0.0, 5.0, 1.8}});
  TripRow trip;
  trip.end = TripEnd::kArrived;
  trip.duration = 100.0;
  trip.route_length = 1000.0;
  trip.time_loss = time_loss - 1.0;
  trip.steps = 1000;
  TripRow second = trip;
  second.vehicle_number = 1;
  second.time_loss = time_loss + 1.0;
  writer.Add<TripRow>({trip, second});
  RunOutcome outcome;
  outcome.status = status;
  outcome.inserted = outcome.arrived = 2;
  outcome.state_hash = static_cast<std::uint64_t>(seed) + (policy == "sumo" ? 0 : 100);
  outcome.policy_shares = {{policy, 2, 2000, policy == "sumo" ? 0 : 2000}};
  writer.Finish(outcome);
}

class CompareCli : public testing::Test {
 protected:
  void AddSeeds(int count) const {
    for (int seed = 1; seed <= count; ++seed) {
      AddRun(path_, "sumo", seed, 20.0 + seed);
      AddRun(path_, "dwa", seed, 22.0 + 1.25 * seed);
    }
  }
  TemporaryFolder folder_;
  const fs::path path_ = folder_ / "results.sqlite";
};

TEST_F(CompareCli, ComparesRecordedRuns) {
  AddSeeds(8);
  ChildProcess child({"compare", path_.string(), "--metric", "time_loss_s,co2_g_per_km", "--format", "csv"});
  EXPECT_EQ(child.Wait(), 0) << child.Errors();
  // Means 24.5 and 27.625; differences 2.25 to 4 in steps of 0.25. All of one sign: p = 2 / 2^8; CO2 is
  // equal: p = 1.
  EXPECT_CONTAINS(child.Output(), "street,sumo,dwa,time_loss_s,8,24.5,27.625,3.125,");
  EXPECT_CONTAINS(child.Output(), ",0.0078125,1,0.015625,");
  EXPECT_CONTAINS(child.Output(), "street,sumo,dwa,co2_g_per_km,8,0,0,0,");
  EXPECT_CONTAINS(child.Output(), "identical");
}

TEST_F(CompareCli, TakesSeveralFilesAndLeavesThemUntouched) {
  AddSeeds(3);
  const fs::path other = folder_ / "other.sqlite";
  for (int seed = 1; seed <= 3; ++seed) AddRun(other, "idm", seed, 30.0);
  fs::permissions(path_, fs::perms::owner_read);
  const std::string before = ReadFile(path_);
  ChildProcess child({"compare", path_.string(), other.string()});
  EXPECT_EQ(child.Wait(), 0) << child.Errors();
  EXPECT_CONTAINS(child.Output(), "idm");
  EXPECT_EQ(ReadFile(path_), before);
}

TEST_F(CompareCli, FileWithoutRunsIsRefused) {
  ResultsFile::Open(path_, ResultsFile::Mode::kAppend);
  ChildProcess child({"compare", path_.string()});
  EXPECT_EQ(child.Wait(), 2);
  EXPECT_CONTAINS(child.Errors(), "it holds no runs");
  EXPECT_CONTAINS(child.Errors(), path_.string());
}

TEST_F(CompareCli, OnePolicyGivesItsMeansMarkedPartial) {
  AddRun(path_, "dwa", 1, 20.0);
  AddRun(path_, "dwa", 2, 22.0);
  ChildProcess child({"compare", path_.string()});
  EXPECT_EQ(child.Wait(), 1);
  EXPECT_CONTAINS(child.Output(), "PARTIAL");
  EXPECT_CONTAINS(child.Output(), "only one policy, dwa");
  EXPECT_CONTAINS(child.Output(), "21");
  EXPECT_CONTAINS(child.Errors(), "no two runs could be paired");
}

TEST_F(CompareCli, UnpairedSeedsAndInterruptedRunsAreNamed) {
  AddSeeds(2);
  AddRun(path_, "dwa", 7, 20.0);
  AddRun(path_, "sumo", 9, 20.0, RunStatus::kInterrupted);
  ChildProcess child({"compare", path_.string()});
  EXPECT_EQ(child.Wait(), 0);
  EXPECT_CONTAINS(child.Output(), "PARTIAL");
  EXPECT_CONTAINS(child.Output(), "seed 7");
  EXPECT_CONTAINS(child.Output(), "seed 9) was interrupted");
}

TEST_F(CompareCli, NotANumberLeavesItsPairOut) {
  AddSeeds(3);
  SQLite::Database(path_.string(), SQLite::OPEN_READWRITE)
      .exec("UPDATE trip SET time_loss_s = 9e999 WHERE run_id = 1");
  ChildProcess child({"compare", path_.string(), "--metric", "time_loss_s"});
  EXPECT_EQ(child.Wait(), 0);
  EXPECT_CONTAINS(child.Output(), "time_loss_s undefined (NULL or not a number) in 1 pair with sumo: seed 1");
}

TEST_F(CompareCli, ReadsAFileWhileARunIsWrittenIntoIt) {
  AddSeeds(2);
  RunInfo info;
  info.scenario = "street";
  info.policy = "dwa";
  info.seed = 3;
  const RunWriter writer(ResultsFile::Open(path_, ResultsFile::Mode::kAppend), info);
  ChildProcess child({"compare", path_.string()});
  EXPECT_EQ(child.Wait(), 0) << child.Errors();
  EXPECT_CONTAINS(child.Output(), "is still being written, or its process was killed");
}

TEST_F(CompareCli, WaitsForALockedFileAndSaysSo) {
  AddSeeds(2);
  SQLite::Database other(path_.string(), SQLite::OPEN_READWRITE);
  other.exec("BEGIN EXCLUSIVE");
  ChildProcess child({"compare", path_.string()});
  const std::string waiting = "another process has it locked; waiting";
  while (child.Running() && child.Errors().find(waiting) == std::string::npos)
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  other.exec("ROLLBACK");
  EXPECT_EQ(child.Wait(), 0) << child.Errors();
  EXPECT_CONTAINS(child.Errors(), waiting);
  EXPECT_CONTAINS(child.Errors(), path_.string());
}

TEST_F(CompareCli, LatexIsATableThatCompiles) {
  AddSeeds(8);
  ChildProcess child({"compare", path_.string(), "--format", "latex"});
  ASSERT_EQ(child.Wait(), 0) << child.Errors();
  const std::string table = child.Output();
  for (const char* part : {"\\begin{table}", "\\toprule", "\\midrule", "\\bottomrule", "\\end{tabular}"})
    EXPECT_CONTAINS(table, part);
  if (std::system("pdflatex --version >/dev/null 2>&1") != 0)
    GTEST_SKIP() << "no pdflatex (Debian's texlive-latex-recommended)";
  folder_.Write("paper.tex", "\\documentclass{article}\n\\usepackage{booktabs}\n\\begin{document}\n" + table +
                                 "\\end{document}\n");
  const std::string command = "cd " + folder_.path().string() +
                              " && pdflatex -halt-on-error -interaction=nonstopmode paper.tex >log 2>&1";
  EXPECT_EQ(std::system(command.c_str()), 0) << ReadFile(folder_ / "log");
  EXPECT_TRUE(ReadFile(folder_ / "paper.pdf").starts_with("%PDF"));
}

TEST_F(CompareCli, AaTestRunsOnTheUsersData) {
  for (int seed = 1; seed <= 8; ++seed) AddRun(path_, "dwa", seed, 20.0 + seed * seed % 7);
  ChildProcess child({"compare", path_.string(), "--aa", "dwa", "--repetitions", "20"});
  EXPECT_EQ(child.Wait(), 0) << child.Errors();
  EXPECT_CONTAINS(child.Output(), "20 repetitions of 20 pairs drawn from 8 recorded runs");
  EXPECT_CONTAINS(child.Output(), "called significant after Holm");
}

TEST_F(CompareCli, BadOptionsAreRefused) {
  AddSeeds(2);
  const std::vector<std::pair<std::vector<std::string>, std::string>> cases = {
      {{"--metric", "speed"}, "unknown metric 'speed'; allowed: all, time_loss_s"},
      {{"--baseline", "nobody"}, "no run of 'nobody'; there are: dwa, sumo"},
      {{"--format", "xls"}, "allowed: text, md, csv, json, latex"},
      {{"--alpha", "2"}, "--alpha: 2"},
      {{"--test", "t"}, "allowed: permutation, wilcoxon"},
      {{"--include", "all"}, "allowed: interrupted, over-budget"},
      {{path_.string()}, "named twice"}};
  for (const auto& [options, part] : cases) {
    std::vector<std::string> arguments{"compare", path_.string()};
    arguments.insert(arguments.end(), options.begin(), options.end());
    ChildProcess child(arguments);
    EXPECT_EQ(child.Wait(), 2) << part;
    EXPECT_CONTAINS(child.Errors(), part);
  }
}

}  // namespace
}  // namespace lanewise
