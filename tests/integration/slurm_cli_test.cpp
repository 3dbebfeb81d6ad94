// `lanewise study --slurm` against a real Slurm.

#include <gtest/gtest.h>

#include "tests/support/same_results.h"
#include "tests/support/slurm_cluster.h"
#include "tests/support/study_files.h"

namespace lanewise {
namespace {

namespace fs = std::filesystem;

class Slurm : public StudyFiles {
 protected:
  std::vector<std::string> Words(const fs::path& study, const fs::path& results,
                                 const std::vector<std::string>& more) const {
    std::vector<std::string> words{"study", study.string(), "--slurm", "--results", results.string()};
    words.insert(words.end(), more.begin(), more.end());
    return words;
  }
};

TEST_F(Slurm, AnArrayOfShardsMergesIntoTheUndividedStudyAndResumes) {
  const SlurmCluster cluster;
  if (!cluster.problem().empty()) GTEST_SKIP() << cluster.problem();
  const auto study = WriteStudy("['sumo', 'dwa']", 3), whole = folder_ / "whole.sqlite",
             all = folder_ / "all results.sqlite";
  const auto words = Words(study, all, {"--tasks", "3", "--sbatch", "--time=5 --comment='a test'"});
  ChildProcess undivided(Command(study, whole));
  ASSERT_EQ(undivided.Wait(), 0) << undivided.Errors();

  // Once with a run that aborts in the third task, once without: only what is missing is done.
  ::setenv("LANEWISE_TEST_FAULT", "abort 3 3", 1);
  ChildProcess first(words);
  ASSERT_EQ(first.Wait(), 0) << first.Errors();
  ::unsetenv("LANEWISE_TEST_FAULT");
  EXPECT_NE(first.Output().find("Slurm job 1: 6 runs in 3 tasks"), std::string::npos) << first.Output();
  ASSERT_TRUE(cluster.WaitForJobs(40)) << cluster.Run({"squeue"});
  const auto shard = [&](int task) { return folder_ / fmt::format("all results-{}-of-3.sqlite", task); };
  const auto log = [&](int task) { return ReadFile(folder_ / fmt::format("all results-{}-of-3.log", task)); };
  EXPECT_EQ(Value(shard(1), "SELECT GROUP_CONCAT(run_id) FROM (SELECT * FROM run ORDER BY run_id)"), "1,4")
      << log(1);
  EXPECT_EQ(
      Value(shard(2), "SELECT GROUP_CONCAT(run_id || status) FROM (SELECT * FROM study_run ORDER BY run_id)"),
      "2finished,5failed")
      << log(2);
  const std::string started = Value(shard(1), "SELECT MAX(started_at) FROM run");

  ChildProcess second(Words(study, all, {"--tasks", "3", "--retry-failed"}));
  ASSERT_EQ(second.Wait(), 0) << second.Errors();
  ASSERT_TRUE(cluster.WaitForJobs(40));
  EXPECT_EQ(Value(shard(1), "SELECT MAX(started_at) FROM run"), started) << log(1);
  ChildProcess merge({"merge", shard(1).string(), shard(2).string(), shard(3).string(), "-o", all.string()});
  ASSERT_EQ(merge.Wait(), 0) << merge.Errors() << log(1) << log(2) << log(3);
  EXPECT_EQ(DifferenceOfResults(whole, all, {"merged_run"}), "");

  ChildProcess refused(Words(study, all, {"--sbatch", "--partition=nowhere"}));
  EXPECT_EQ(refused.Wait(), 1);
  EXPECT_NE(refused.Errors().find("sbatch refused the job"), std::string::npos) << refused.Errors();
  EXPECT_NE(refused.Errors().find("nowhere"), std::string::npos) << refused.Errors();
}

TEST_F(Slurm, ADryRunPrintsTheScriptAndSubmitsNothing) {
  const auto study = WriteStudy("['sumo', 'dwa']", 3), all = folder_ / "all.sqlite";
  ChildProcess child(
      Words(study, all, {"--dry-run", "--probe", "0", "--threads", "2", "--sbatch", "--mem=2G"}));
  ASSERT_EQ(child.Wait(), 0) << child.Errors();
  const std::string text = child.Output();
  for (const std::string part :
       {"#SBATCH --array=1-6\n", "#SBATCH --cpus-per-task=2\n", "#SBATCH --mem=2G\n", " '--threads' '2'",
        "--shard \"$SLURM_ARRAY_TASK_ID/6\"", "all-$SLURM_ARRAY_TASK_ID-of-6.sqlite\"\n"})
    EXPECT_NE(text.find(part), std::string::npos) << part << text;
  EXPECT_FALSE(fs::exists(folder_ / "all.slurm.sh"));
}

TEST_F(Slurm, WhatItCannotDoIsRefused) {
  const auto study = WriteStudy("'dwa'", 1);
  const std::pair<std::vector<std::string>, const char*> cases[] = {
      {Words(study, folder_ / "50%.sqlite", {}), "without quotes, backslashes and %"},
      {Words(study, folder_ / "a.sqlite", {"--shard", "1/2"}), "--slurm and --shard exclude each other"},
      {Words(study, folder_ / "a.sqlite", {"--until-ci", "0.1:time_loss_s"}), "a shard cannot tell"},
      {Words(study, folder_ / "none" / "a.sqlite", {}), "cannot be written"}};
  for (const auto& [words, why] : cases) {
    ChildProcess child(words);
    EXPECT_EQ(child.Wait(), 2) << why;
    EXPECT_NE(child.Errors().find(why), std::string::npos) << child.Errors();
  }
}

}  // namespace
}  // namespace lanewise
