// A run that is stopped from outside leaves a valid file that says so.

#include <SQLiteCpp/SQLiteCpp.h>
#include <gtest/gtest.h>

#include <chrono>
#include <thread>

#include "analysis/results_file.h"
#include "tests/support/child_process.h"

namespace lanewise {
namespace {

int Count(const std::filesystem::path& file, const std::string& table) {
  SQLite::Database database(file.string(), SQLite::OPEN_READONLY);
  database.setBusyTimeout(2000);
  return database.execAndGet("SELECT COUNT(*) FROM " + table).getInt();
}

std::string IntegrityOf(const std::filesystem::path& file) {
  SQLite::Database database(file.string(), SQLite::OPEN_READONLY);
  return database.execAndGet("PRAGMA integrity_check").getString();
}

/// Waits until the run has stored something.
bool WaitForRows(const std::filesystem::path& file, ChildProcess* child) {
  for (int k = 0; k < 600 && child->Running(); ++k) {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    try {
      if (std::filesystem::exists(file) && Count(file, "trajectory") > 0) return true;
    } catch (const SQLite::Exception&) {  // Not created yet.
    }
  }
  return false;
}

// The town at the smallest step and every step sampled: a run that lasts far longer than the test needs.
std::vector<std::string> LongRun(const std::filesystem::path& file) {
  return {"run",  "--scenario",      "town", "-q",        "--step-length",
          "0.01", "--sample-period", "0",    "--results", file.string()};
}

class Interrupted : public testing::TestWithParam<int> {};

TEST_P(Interrupted, KeepsWhatWasRecorded) {
  const TemporaryFolder folder;
  const auto file = folder / "run.sqlite";
  ChildProcess child(LongRun(file));
  ASSERT_TRUE(WaitForRows(file, &child)) << child.Errors();
  child.Signal(GetParam());
  EXPECT_EQ(child.Wait(), 130) << child.Errors();
  EXPECT_EQ(IntegrityOf(file), "ok");
  const auto runs = LoadRunSummaries(file);
  ASSERT_EQ(runs.size(), 1u);
  EXPECT_EQ(runs[0].status, "interrupted");
  EXPECT_TRUE(runs[0].state_hash.has_value());
  EXPECT_EQ(*runs[0].inserted, Count(file, "vehicle WHERE vclass <> 'pedestrian'"));
  EXPECT_EQ(*runs[0].inserted, Count(file, "trip"));  // Those under way too, as 'running'.
  EXPECT_EQ(*runs[0].trajectory_rows, Count(file, "trajectory"));
  EXPECT_GT(*runs[0].trajectory_rows, 0);
  SQLite::Database database(file.string(), SQLite::OPEN_READONLY);
  EXPECT_NE(database.execAndGet("SELECT message FROM run").getString().find("interrupted at"),
            std::string::npos);
}

INSTANTIATE_TEST_SUITE_P(Signals, Interrupted, testing::Values(SIGINT, SIGTERM));

TEST(Killed, LeavesAValidFileThatSaysRunning) {
  const TemporaryFolder folder;
  const auto file = folder / "run.sqlite";
  ChildProcess child(LongRun(file));
  ASSERT_TRUE(WaitForRows(file, &child)) << child.Errors();
  child.Signal(SIGKILL);
  EXPECT_EQ(child.Wait(), -SIGKILL);
  EXPECT_EQ(IntegrityOf(file), "ok");
  const auto runs = LoadRunSummaries(file);
  ASSERT_EQ(runs.size(), 1u);
  EXPECT_EQ(runs[0].status, "running");
  EXPECT_GT(Count(file, "trajectory"), 0);
  // And it still takes another run.
  ChildProcess next({"run", "--scenario", "arena", "-e", "2", "-q", "--results", file.string()});
  EXPECT_EQ(next.Wait(), 0) << next.Errors();
  EXPECT_EQ(LoadRunSummaries(file).size(), 2u);
}

}  // namespace
}  // namespace lanewise
