// `lanewise merge`: each run once, with where it came from, or nothing at all.

#include <gtest/gtest.h>

#include <chrono>
#include <thread>

#include "tests/support/same_results.h"
#include "tests/support/study_files.h"

namespace lanewise {
namespace {

namespace fs = std::filesystem;

class Merge : public StudyFiles {
 protected:
  /// Shard `index` of two of the study.
  fs::path Shard(const fs::path& study, int index) const {
    const fs::path file = folder_ / fmt::format("shard{}.sqlite", index);
    ChildProcess child(Command(study, file, {"--shard", fmt::format("{}/2", index)}));
    EXPECT_EQ(child.Wait(), 0) << child.Errors();
    return file;
  }
  static std::vector<std::string> Words(const std::vector<fs::path>& inputs, const fs::path& output) {
    std::vector<std::string> words{"merge"};
    for (const fs::path& input : inputs) words.push_back(input.string());
    words.insert(words.end(), {"-o", output.string()});
    return words;
  }
};

TEST_F(Merge, ShardsBecomeTheUndividedStudyAndAgainChangesNothing) {
  const auto study = WriteStudy("['sumo', 'dwa']", 3), whole = folder_ / "whole.sqlite",
             all = folder_ / "all.sqlite";
  ChildProcess undivided(Command(study, whole));
  ASSERT_EQ(undivided.Wait(), 0) << undivided.Errors();
  const fs::path a = Shard(study, 1), b = Shard(study, 2);
  EXPECT_EQ(Value(a, "SELECT GROUP_CONCAT(run_id) FROM run"), "1,3,5");

  ChildProcess merge(Words({a, b}, all));
  ASSERT_EQ(merge.Wait(), 0) << merge.Errors();
  EXPECT_NE(merge.Output().find("6 runs, 6 new from 2 files; 0 failed, 0 to do"), std::string::npos)
      << merge.Output();
  EXPECT_EQ(Value(all, "SELECT source_file || source_run_id FROM merged_run WHERE run_id = 4"),
            b.string() + "4");
  EXPECT_EQ(DifferenceOfResults(whole, all, {"merged_run"}), "");
  EXPECT_EQ(Value(all, "PRAGMA integrity_check"), "ok");

  const fs::path before = folder_ / "before.sqlite";
  fs::copy_file(all, before);
  for (const auto& inputs : {std::vector{a, b}, std::vector{b, a}, std::vector{b}}) {
    ChildProcess again(Words(inputs, all));
    ASSERT_EQ(again.Wait(), 0) << again.Errors();
    EXPECT_EQ(DifferenceOfResults(before, all), "");
  }
  // Merged files merge, and the first origin stays.
  const fs::path twice = folder_ / "twice.sqlite";
  ChildProcess second(Words({all}, twice));
  ASSERT_EQ(second.Wait(), 0) << second.Errors();
  EXPECT_EQ(DifferenceOfResults(before, twice), "");
  // A study that is complete stays so.
  ChildProcess complete(Command(study, all));
  EXPECT_EQ(complete.Wait(), 0) << complete.Errors();
  EXPECT_EQ(DifferenceOfResults(before, all), "");
}

TEST_F(Merge, WhatAShardLeftUndoneIsDoneOnTheMergedFile) {
  const auto study = WriteStudy("['sumo', 'dwa']", 2), all = folder_ / "all.sqlite";
  const fs::path a = Shard(study, 1), b = folder_ / "shard2.sqlite";
  ChildProcess faulty(Command(study, b, {"--shard", "2/2"}), {"LANEWISE_TEST_FAULT=abort 2 3"});
  EXPECT_EQ(faulty.Wait(), 1);
  Change(b, "UPDATE study_run SET status = 'claimed', claimed_by = 'gone:1' WHERE run_id = 4");
  ChildProcess merge(Words({a, b}, all));
  ASSERT_EQ(merge.Wait(), 0) << merge.Errors();
  EXPECT_NE(merge.Output().find("3 runs, 3 new from 2 files; 0 failed, 1 to do"), std::string::npos)
      << merge.Output();
  ChildProcess rest(Command(study, all));
  EXPECT_EQ(rest.Wait(), 0) << rest.Errors();
  EXPECT_EQ(Value(all, "SELECT COUNT(*) FROM run WHERE status = 'finished'"), "4");
  // The other way round: what another file has finished counts more than a failure.
  ChildProcess late(Words({all}, b));
  EXPECT_EQ(late.Wait(), 0) << late.Errors();
  EXPECT_EQ(Value(b, "SELECT GROUP_CONCAT(status) FROM study_run ORDER BY run_id"),
            "finished,finished,finished,finished");
}

TEST_F(Merge, ConflictsAreRefusedAndNothingIsWritten) {
  const auto study = WriteStudy("'sumo'", 2), all = folder_ / "all.sqlite", other = folder_ / "other.sqlite";
  const fs::path a = Shard(study, 1);
  const auto refused = [&](const std::vector<fs::path>& inputs, const std::string& why) {
    ChildProcess merge(Words(inputs, all));
    EXPECT_EQ(merge.Wait(), 2) << merge.Output();
    EXPECT_NE(merge.Errors().find(why), std::string::npos) << merge.Errors();
    EXPECT_FALSE(fs::exists(all));
    EXPECT_FALSE(fs::exists(all.string() + ".partial"));
  };
  const auto changed = [&](const std::string& sql) {
    fs::copy_file(a, other, fs::copy_options::overwrite_existing);
    Change(other, sql);
    return std::vector{a, other};
  };
  refused(changed("UPDATE run SET state_hash = 'f00'"), "the same run");
  refused(changed("UPDATE run SET state_hash = 'f00'"), "and f00");
  refused(changed("UPDATE run SET git_commit = 'abc'"), "git_commit is");
  refused(changed("UPDATE run SET input_hashes_json = '{\"x\": \"y\"}'"), "input_hashes_json differ");
  refused(changed("UPDATE study SET name = 'another'"), "holds the study 'study'");
  refused(changed("DELETE FROM study"), "single runs, no study");
  refused({a, folder_ / "none.sqlite"}, "there is no such file");
  refused({a, folder_.Write("x.sqlite", "no results")}, "not an SQLite file");
  ChildProcess self(Words({a}, a));
  EXPECT_EQ(self.Wait(), 2);
  EXPECT_NE(self.Errors().find("is also the output"), std::string::npos) << self.Errors();
}

TEST_F(Merge, SingleRunsAreTakenOnceAndRenumbered) {
  const auto a = folder_ / "a.sqlite", b = folder_ / "b.sqlite", all = folder_ / "all.sqlite";
  const auto run = [&](const fs::path& file, const char* seed) {
    ChildProcess child({"run", "--scenario", "priority_crossing", "--policy", "sumo", "--end", "10", "--seed",
                        seed, "-q", "--results", file.string()});
    EXPECT_EQ(child.Wait(), 0) << child.Errors();
  };
  run(a, "1");
  run(b, "2");
  run(b, "1");
  ChildProcess merge(Words({a, b}, all));
  ASSERT_EQ(merge.Wait(), 0) << merge.Errors();
  EXPECT_NE(merge.Output().find("1 were there already"), std::string::npos) << merge.Output();
  EXPECT_EQ(Value(all, "SELECT GROUP_CONCAT(run_id || ':' || seed) FROM run"), "1:1,2:2");
  EXPECT_EQ(Value(all, "SELECT COUNT(DISTINCT run_id) FROM trip"), "2");
}

TEST_F(Merge, AKilledOneLeavesNoOutputOrAWholeOne) {
  const auto study = WriteStudy("['sumo', 'dwa']", 2, 60), all = folder_ / "all.sqlite",
             calm = folder_ / "calm.sqlite";
  const fs::path a = Shard(study, 1), b = Shard(study, 2);
  ChildProcess undisturbed(Words({a, b}, calm));
  ASSERT_EQ(undisturbed.Wait(), 0);
  bool finished = false;
  for (int milliseconds = 2; !finished; milliseconds += 1 + milliseconds / 5) {
    ChildProcess merge(Words({a, b}, all));
    std::this_thread::sleep_for(std::chrono::milliseconds(milliseconds));
    finished = !merge.Running();
    merge.Signal(SIGKILL);
    merge.Wait();
    if (!fs::exists(all)) continue;
    EXPECT_EQ(Value(all, "PRAGMA integrity_check"), "ok");
    EXPECT_EQ(DifferenceOfResults(calm, all), "");
  }
  EXPECT_TRUE(fs::exists(all));
  EXPECT_FALSE(fs::exists(all.string() + ".partial"));
}

}  // namespace
}  // namespace lanewise
