// `lanewise study` as a user runs it: everything once, nothing lost.

#include <gtest/gtest.h>

#include <chrono>
#include <thread>

#include "tests/support/same_results.h"
#include "tests/support/study_files.h"

namespace lanewise {
namespace {

namespace fs = std::filesystem;

using Study = StudyFiles;

TEST_F(Study, RunsEverythingOnceInTheOrderOfThePlan) {
  const auto study = WriteStudy("['sumo', 'dwa']", 2), results = folder_ / "a.sqlite";
  ChildProcess first(Command(study, results));
  ASSERT_EQ(first.Wait(), 0) << first.Errors();
  EXPECT_NE(first.Output().find("4 of 4 runs finished"), std::string::npos) << first.Output();
  EXPECT_EQ(
      Value(results, "SELECT GROUP_CONCAT(policy || seed, ' ') FROM (SELECT * FROM run ORDER BY run_id)"),
      "sumo1 dwa1 sumo2 dwa2");
  const std::string started = Value(results, "SELECT MAX(started_at) || MAX(rowid) FROM run");
  ChildProcess again(Command(study, results));
  ASSERT_EQ(again.Wait(), 0) << again.Errors();
  EXPECT_EQ(Value(results, "SELECT MAX(started_at) || MAX(rowid) FROM run"), started);
  EXPECT_FALSE(fs::exists(results.string() + ".work"));
  EXPECT_FALSE(fs::exists(results.string() + ".lock"));
}

TEST_F(Study, AnInterruptedOneSaysHowToGoOn) {
  const auto study = WriteStudy("'dwa'", 20, 120), results = folder_ / "a.sqlite";
  ChildProcess child(Command(study, results));
  for (int k = 0; k < 200 && !fs::exists(results.string() + ".work/run-1.sqlite"); ++k)
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  child.Signal(SIGINT);
  EXPECT_EQ(child.Wait(), 130) << child.Errors();
  EXPECT_NE(child.Output().find("the same command goes on"), std::string::npos);
  EXPECT_EQ(
      Value(results, "SELECT COUNT(*) FROM study_run WHERE status IN ('claimed', 'failed') OR attempts > 1"),
      "0");
}

struct Fault {
  const char* environment;
  const char* message;
};
class FaultyStudy : public Study, public testing::WithParamInterface<Fault> {};

TEST_P(FaultyStudy, FailsInOneRunAndGoesOnWithTheOthers) {
  // Long enough to fill more than the pages of an empty file.
  const auto study = WriteStudy("'dwa'", 3, 120), results = folder_ / "a.sqlite";
  ChildProcess child(Command(study, results, {"--hang-after", "2", "--retries", "1"}),
                     {std::string("LANEWISE_TEST_FAULT=") + GetParam().environment});
  EXPECT_EQ(child.Wait(), 1) << child.Errors();
  EXPECT_EQ(Value(results, "SELECT GROUP_CONCAT(seed, ' ') FROM run WHERE status = 'finished'"), "1 3");
  EXPECT_EQ(Value(results, "SELECT status FROM study_run WHERE run_id = 2"), "failed");
  EXPECT_NE(Value(results, "SELECT message FROM study_run WHERE run_id = 2").find(GetParam().message),
            std::string::npos)
      << Value(results, "SELECT message FROM study_run WHERE run_id = 2");
  EXPECT_NE(child.Output().find(GetParam().message), std::string::npos);
  // Without the fault it is made up for.
  ChildProcess again(Command(study, results, {"--retry-failed"}));
  EXPECT_EQ(again.Wait(), 0) << again.Errors();
  EXPECT_EQ(Value(results, "SELECT COUNT(*) FROM run WHERE status = 'finished'"), "3");
}

INSTANTIATE_TEST_SUITE_P(Faults, FaultyStudy,
                         testing::Values(Fault{"abort 2 3", "signal 6 (Aborted) after"},
                                         Fault{"hang 2 3", "hung: no progress for 2 s after"},
                                         Fault{"full 2 4096", "the disk is full"}));

TEST_F(Study, AnotherStudysFileOrOneInUseIsRefused) {
  const auto study = WriteStudy("'dwa'", 30, 300), results = folder_ / "a.sqlite";
  ChildProcess child(Command(study, results));
  for (int k = 0; k < 200 && !fs::exists(results.string() + ".work/run-1.sqlite"); ++k)
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  ChildProcess second(Command(study, results));
  EXPECT_EQ(second.Wait(), 2);
  EXPECT_NE(second.Errors().find("another runner"), std::string::npos) << second.Errors();
  child.Signal(SIGINT);
  child.Wait();
  const auto other = folder_.Write("other.toml", "[grid]\nscenario = 'arena'\n");
  ChildProcess third(Command(other, results));
  EXPECT_EQ(third.Wait(), 2);
  EXPECT_NE(third.Errors().find("it holds the study 'study', not 'other'"), std::string::npos)
      << third.Errors();
}

TEST_F(Study, ADryRunPrintsTheRunsAndWritesNothing) {
  const auto study = WriteStudy("['sumo', 'dwa']", 2), results = folder_ / "a.sqlite";
  ChildProcess child(Command(study, results, {"--dry-run"}));
  EXPECT_EQ(child.Wait(), 0) << child.Errors();
  EXPECT_NE(child.Output().find("policy=dwa sample-period=5 scenario=priority_crossing seed=2"),
            std::string::npos)
      << child.Output();
  EXPECT_NE(child.Output().find("4 runs"), std::string::npos);
  EXPECT_FALSE(fs::exists(results));
}

TEST_F(Study, ShippedOnesAreValidAndOpenWithTheirQuestion) {
  int studies = 0;
  for (const auto& entry : fs::directory_iterator(kStudiesFolder)) {
    if (entry.path().extension() != ".toml") continue;
    ++studies;
    ChildProcess child(Command(entry.path(), folder_ / "a.sqlite", {"--dry-run", "--probe", "0"}));
    EXPECT_EQ(child.Wait(), 0) << entry.path() << child.Errors();
    EXPECT_NE(child.Output().find("question: "), std::string::npos) << entry.path();
  }
  EXPECT_GE(studies, 4);
}

TEST_F(Study, ADryRunMeasuresARunOfEachKindAndKnowsThoseThatHaveFinished) {
  const auto study = WriteStudy("['sumo', 'dwa']", 3), results = folder_ / "a.sqlite";
  ChildProcess measured(Command(study, results, {"--dry-run", "--probe", "1"}));
  ASSERT_EQ(measured.Wait(), 0) << measured.Errors();
  EXPECT_NE(measured.Output().find("of a run of each kind"), std::string::npos) << measured.Output();
  EXPECT_NE(measured.Output().find("MB on disk"), std::string::npos);
  EXPECT_FALSE(fs::exists(results));
  ChildProcess shard(Command(study, results, {"--shard", "1/3"}));
  ASSERT_EQ(shard.Wait(), 0) << shard.Errors();
  ChildProcess known(Command(study, results, {"--dry-run"}));
  ASSERT_EQ(known.Wait(), 0) << known.Errors();
  EXPECT_NE(known.Output().find("6 runs, 4 left"), std::string::npos) << known.Output();
  EXPECT_NE(known.Output().find("by 2 finished runs"), std::string::npos) << known.Output();
  EXPECT_NE(known.Output().find("seed=1  (finished)"), std::string::npos);
}

TEST_F(Study, SeedsAreAddedUntilTheIntervalIsNarrowEnough) {
  const auto study = WriteStudy("['sumo', 'idm']", 2, 60), results = folder_ / "a.sqlite";
  const auto command = [&](const char* goal, const char* most) {
    return Command(study, results, {"--until-ci", goal, "--max-seeds", most});
  };
  // First out of reach: it ends at the maximum, and says so.
  ChildProcess capped(command("0.000001:mean_time_loss", "7"));
  EXPECT_EQ(capped.Wait(), 1) << capped.Errors();
  EXPECT_NE(capped.Output().find("not reached with the 7 seeds"), std::string::npos) << capped.Output();
  EXPECT_EQ(Value(results, "SELECT COUNT(*) FROM run WHERE status = 'finished'"), "14");
  EXPECT_EQ(Value(results, "SELECT GROUP_CONCAT(DISTINCT seed) FROM run"), "1,2,3,4,5,6,7");
  // The same file then goes on from there to a goal that can be reached, and stays there.
  ChildProcess reached(command("0.5:mean_time_loss", "60"));
  EXPECT_EQ(reached.Wait(), 0) << reached.Output() << reached.Errors();
  EXPECT_NE(reached.Output().find(": narrow enough"), std::string::npos) << reached.Output();
  const std::string runs = Value(results, "SELECT COUNT(*) FROM run");
  ChildProcess again(command("0.5:mean_time_loss", "60"));
  EXPECT_EQ(again.Wait(), 0) << again.Errors();
  EXPECT_EQ(Value(results, "SELECT COUNT(*) FROM run"), runs);
  ChildProcess wrong(command("0.5:time_lost", "60"));
  EXPECT_EQ(wrong.Wait(), 2);
  EXPECT_NE(wrong.Errors().find("unknown metric 'time_lost'"), std::string::npos) << wrong.Errors();
}

TEST_F(Study, AddingSeedsGoesOnAfterAKill) {
  const auto study = WriteStudy("['sumo', 'idm']", 2), calm = folder_ / "calm.sqlite",
             torn = folder_ / "torn.sqlite";
  const std::vector<std::string> more = {"--until-ci", "0.000001:mean_time_loss", "--max-seeds", "8"};
  ChildProcess undisturbed(Command(study, calm, more));
  EXPECT_EQ(undisturbed.Wait(), 1) << undisturbed.Errors();
  for (const int milliseconds : {300, 600, 900}) {
    ChildProcess child(Command(study, torn, more));
    std::this_thread::sleep_for(std::chrono::milliseconds(milliseconds));
    child.Signal(SIGKILL);
    child.Wait();
  }
  ChildProcess resumed(Command(study, torn, more));
  EXPECT_EQ(resumed.Wait(), 1) << resumed.Errors();
  EXPECT_EQ(DifferenceOfResults(calm, torn), "");
}

TEST_F(Study, DemandIsFrozenBySeedAndHigherPenetrationContainsTheLower) {
  const auto results = folder_ / "a.sqlite";
  const auto study = folder_.Write("study.toml",
                                   "[run]\nscenario = 'breakdown'\nend = 60\nsafety = 'off'\n"
                                   "[grid]\npenetration = [0.0, 0.4, 0.8]\nseed = [1, 2]\n");
  ChildProcess child(Command(study, results));
  ASSERT_EQ(child.Wait(), 0) << child.Errors();
  // Whoever entered in two runs of a seed is the same kind of vehicle in both, though others drive it.
  EXPECT_EQ(Value(results,
                  "SELECT COUNT(*) FROM run AS p, run AS q JOIN vehicle AS a ON a.run_id = p.run_id JOIN "
                  "vehicle AS b ON b.run_id = q.run_id AND b.vehicle_id = a.vehicle_id WHERE p.seed = q.seed "
                  "AND (a.type <> b.type OR a.length_m <> b.length_m)"),
            "0");
  // Of each seed, those equipped at 0.4 that also entered at 0.8 are equipped there.
  const std::string pairs =
      "FROM run AS p, run AS q JOIN vehicle AS a ON a.run_id = p.run_id JOIN vehicle AS b ON b.run_id = "
      "q.run_id AND b.vehicle_id = a.vehicle_id WHERE p.seed = q.seed AND p.penetration_rate = 0.4 AND "
      "q.penetration_rate = 0.8 AND a.policy = 'dwa'";
  EXPECT_NE(Value(results, "SELECT COUNT(*) " + pairs), "0");
  EXPECT_EQ(Value(results, "SELECT COUNT(*) " + pairs + " AND b.policy <> 'dwa'"), "0");
}

}  // namespace
}  // namespace lanewise
