#include "analysis/results_file.h"

#include <SQLiteCpp/SQLiteCpp.h>
#include <gtest/gtest.h>
#include <sched.h>
#include <signal.h>
#include <sys/mount.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <fstream>
#include <thread>

#include "agents/core/check.h"

namespace lanewise {
namespace {

namespace fs = std::filesystem;
using Mode = ResultsFile::Mode;

class ResultsFileTest : public testing::Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "lanewise_results_XXXXXX").string();
    ASSERT_NE(::mkdtemp(name.data()), nullptr);
    folder_ = name;
    path_ = folder_ / "results.sqlite";
  }
  void TearDown() override { fs::remove_all(folder_); }

  fs::path folder_, path_;
};

RunInfo Info(const std::string& policy) {
  RunInfo info;
  info.scenario = "grid";
  info.config_file = "grid.sumocfg";
  info.policy = policy;
  info.rules = "agent";
  info.seed = 42;
  return info;
}

std::vector<TrajectoryRow> Samples(std::size_t count) {
  std::vector<TrajectoryRow> rows(count);
  for (std::size_t i = 0; i < count; ++i) {
    rows[i].time = 0.1 * static_cast<double>(i / 100);
    rows[i].vehicle_number = static_cast<std::int32_t>(i % 100);
    rows[i].x = 1.25 * static_cast<double>(i);
    rows[i].lane = i % 2 == 0 ? static_cast<LaneIndex>(i % 7) : kNone;
  }
  return rows;
}

/// The single value of a query, as text; "NULL" for NULL.
std::string Value(const fs::path& path, const std::string& sql) {
  SQLite::Database database(path.string(), SQLite::OPEN_READWRITE);  // Read-write: may have to recover a log.
  SQLite::Statement query(database, sql);
  EXPECT_TRUE(query.executeStep()) << sql;
  return query.getColumn(0).isNull() ? "NULL" : query.getColumn(0).getString();
}

std::string RefusalOf(const fs::path& path, Mode mode) {
  try {
    ResultsFile::Open(path, mode);
  } catch (const ConfigError& e) {
    return e.what();
  }
  return "";
}

#define EXPECT_CONTAINS(text, part) EXPECT_NE(std::string(text).find(part), std::string::npos) << text

/// A run in which vehicle 0 arrives after striking vehicle 1, which is still under way.
void WriteSmallRun(const fs::path& path, const std::string& policy) {
  RunWriter writer(ResultsFile::Open(path, Mode::kAppend), Info(policy));
  writer.Add<VehicleRow>({{0, "a", "car", "passenger", policy, 0.0, 0.0, 5.0, 1.8},
                          {1, "b's", "car", "passenger", "sumo", 1.0, 0.5, 5.0, 1.8}});
  writer.Add<LaneRow>({{3, "e0_0"}});
  TripRow arrived;
  arrived.vehicle_number = 0;
  arrived.end = TripEnd::kArrived;
  arrived.arrival = 100.0;
  arrived.duration = 100.0;
  arrived.route_length = 1500.0;
  arrived.time_loss = 20.0;
  arrived.co2 = 300'000.0;
  TripRow running;
  running.vehicle_number = 1;
  running.depart = 1.0;
  running.duration = 999.0;
  running.route_length = 500.0;
  running.co2 = 100'000.0;
  writer.Add<TripRow>({arrived, running});
  Contact contact;
  contact.first = 0;
  contact.second = 1;
  contact.striking = 0;
  contact.first_agent = true;
  Contact standing;
  standing.first = 0;
  standing.second = 1;
  standing.in_junction = true;
  writer.Add<Contact>({contact, standing});
  Encounter near_miss;
  near_miss.first = 0;
  near_miss.second = 1;
  near_miss.min_ttc = 1.2;
  near_miss.near_miss = true;
  Encounter mild = near_miss;
  mild.min_ttc = 2.2;
  mild.near_miss = false;
  mild.number = 1;
  writer.Add<Encounter>({near_miss, mild});
  writer.Add<RuleEventRow>({{12.5, 0, RuleEventKind::kRedLight, 3},
                            {20.0, 0, RuleEventKind::kForcedEntry, 3},
                            {310.0, 1, RuleEventKind::kStandstill, kNone}});
  writer.Add<StepSummaryRow>({{.time = 1.0, .running = 0}});
  writer.Add(Samples(1000));
  RunOutcome outcome;
  outcome.inserted = 2;
  outcome.arrived = 1;
  outcome.state_hash = 0xABCDEF;
  outcome.audit = {{"speed", 3, std::nullopt, 0.25}, {"detours", 4, std::nullopt, std::nullopt}};
  outcome.policy_shares = {{policy, 1, 10, 10}, {"sumo", 1, 10, 0}};
  writer.Finish(outcome);
}

TEST_F(ResultsFileTest, StoresARunAndSumsItUp) {
  WriteSmallRun(path_, "dwa");
  const std::vector<RunSummary> runs = LoadRunSummaries(path_);
  ASSERT_EQ(runs.size(), 1u);
  const RunSummary& run = runs[0];
  EXPECT_EQ(run.run_id, 1);
  EXPECT_EQ(run.status, "finished");
  EXPECT_EQ(run.policy, "dwa");
  EXPECT_EQ(run.seed, 42);
  EXPECT_EQ(run.inserted, 2);
  EXPECT_EQ(run.arrived, 1);
  EXPECT_EQ(run.mean_duration, 100.0);  // Of the arrived one only.
  EXPECT_EQ(run.mean_time_loss, 20.0);
  EXPECT_NEAR(run.co2_kg, 0.4, 1e-12);
  EXPECT_NEAR(*run.co2_g_per_km, 200.0, 1e-9);  // 400 g over 2 km, both.
  EXPECT_EQ(run.collisions, 2);
  EXPECT_EQ(run.agent_striking_outside_junctions, 1);
  EXPECT_EQ(run.collisions_in_junctions, 1);
  EXPECT_EQ(run.near_misses, 1);
  EXPECT_EQ(run.min_ttc, 1.2);
  EXPECT_EQ(run.red_lights_run, 1);
  EXPECT_EQ(run.standstills, 1);
  EXPECT_EQ(run.trajectory_rows, 1000);
  EXPECT_EQ(run.state_hash, "0000000000abcdef");
  EXPECT_EQ(Value(path_, "SELECT vehicle_id FROM vehicle WHERE vehicle_number = 1"), "b's");
  EXPECT_EQ(Value(path_, "SELECT lane_id FROM lane WHERE lane = 3"), "e0_0");
  EXPECT_EQ(Value(path_, "SELECT max_speed_error_mps FROM audit WHERE cause = 'speed'"), "0.25");
  EXPECT_EQ(Value(path_, "SELECT COUNT(*) FROM policy_share"), "2");
  EXPECT_EQ(
      Value(
          path_,
          "SELECT vehicle_number || ' ' || lane FROM rule_event WHERE kind = 'red_light' AND time_s = 12.5"),
      "0 3");
  EXPECT_EQ(Value(path_, "SELECT x_m FROM trajectory WHERE vehicle_number = 3 AND time_s = 0.0"), "3.75");
}

TEST_F(ResultsFileTest, StoresTheUndefinedAsNull) {
  WriteSmallRun(path_, "dwa");
  EXPECT_EQ(Value(path_, "SELECT end_s FROM run"), "NULL");
  EXPECT_EQ(Value(path_, "SELECT message FROM run"), "NULL");
  EXPECT_EQ(Value(path_, "SELECT arrival_s FROM trip WHERE vehicle_number = 1"), "NULL");
  EXPECT_EQ(Value(path_, "SELECT min_ttc_s FROM trip WHERE vehicle_number = 0"), "NULL");
  EXPECT_EQ(Value(path_, "SELECT striking_vehicle FROM collision WHERE collision_id = 2"), "NULL");
  EXPECT_EQ(Value(path_, "SELECT struck_vehicle FROM collision WHERE collision_id = 1"), "1");
  EXPECT_EQ(Value(path_, "SELECT first_lane FROM collision WHERE collision_id = 1"), "NULL");
  EXPECT_EQ(Value(path_, "SELECT mean_speed_mps FROM step_summary"), "NULL");
  EXPECT_EQ(Value(path_, "SELECT lane FROM rule_event WHERE kind = 'standstill'"), "NULL");
  EXPECT_EQ(Value(path_, "SELECT max_position_error_m FROM audit WHERE cause = 'speed'"), "NULL");
  EXPECT_EQ(Value(path_, "SELECT COUNT(*) FROM trajectory WHERE lane IS NULL AND lane_pos_m IS NULL"), "500");
}

TEST_F(ResultsFileTest, AppendsRunsAndReplacesNone) {
  WriteSmallRun(path_, "dwa");
  WriteSmallRun(path_, "idm");
  const std::vector<RunSummary> runs = LoadRunSummaries(path_);
  ASSERT_EQ(runs.size(), 2u);
  EXPECT_EQ(runs[0].policy, "dwa");
  EXPECT_EQ(runs[1].policy, "idm");
  EXPECT_EQ(runs[1].run_id, 2);
  EXPECT_EQ(runs[0].collisions, 2);
  EXPECT_EQ(Value(path_, "SELECT COUNT(*) FROM trajectory"), "2000");
}

TEST_F(ResultsFileTest, IndexesTheTrajectoryOfEachRun) {
  WriteSmallRun(path_, "dwa");
  WriteSmallRun(path_, "idm");
  SQLite::Database database(path_.string());
  SQLite::Statement plan(
      database, "EXPLAIN QUERY PLAN SELECT x_m FROM trajectory WHERE run_id = 2 AND vehicle_number = ?");
  ASSERT_TRUE(plan.executeStep());
  EXPECT_CONTAINS(plan.getColumn("detail").getString(), "trajectory_of_run_2");
}

TEST_F(ResultsFileTest, AFinishedFileIsOneFile) {
  WriteSmallRun(path_, "dwa");
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_), fs::directory_iterator()), 1);
}

TEST_F(ResultsFileTest, FormatsInfoAndComparison) {
  WriteSmallRun(path_, "dwa");
  { RunWriter(ResultsFile::Open(path_, Mode::kAppend), Info("sumo")); }
  const std::vector<RunSummary> runs = LoadRunSummaries(path_);
  const std::string info = FormatInfo(path_, runs);
  EXPECT_CONTAINS(info, "results.sqlite: Lanewise results, schema 6, 2 runs");
  EXPECT_CONTAINS(info, "0000000000abcdef");
  EXPECT_EQ(FormatComparison(runs),
            "policy                                    dwa    sumo\n"
            "run                                         1       2\n"
            "status                               finished  failed\n"
            "inserted                                    2       -\n"
            "arrived                                     1       0\n"
            "mean trip [s]                           100.0       -\n"
            "mean time loss [s]                       20.0       -\n"
            "detours                                     4       -\n"
            "collisions                                  2       0\n"
            "  agent striking, outside junctions         1       0\n"
            "  in junctions                              1       0\n"
            "near misses                                 1       0\n"
            "hard braking                                0       0\n"
            "CO2 [kg]                                  0.4     0.0\n"
            "CO2 [g/km]                              200.0       -\n");
}

TEST_F(ResultsFileTest, WithoutFinishTheRunEndsAsTold) {
  {
    RunWriter writer(ResultsFile::Open(path_, Mode::kAppend), Info("dwa"));
    writer.Add(Samples(10));
    writer.EndAs(RunStatus::kInterrupted, "stopped by the user");
  }
  { RunWriter writer(ResultsFile::Open(path_, Mode::kAppend), Info("dwa")); }
  EXPECT_EQ(Value(path_, "SELECT status FROM run WHERE run_id = 1"), "interrupted");
  EXPECT_EQ(Value(path_, "SELECT message FROM run WHERE run_id = 1"), "stopped by the user");
  EXPECT_EQ(Value(path_, "SELECT trajectory_rows FROM run WHERE run_id = 1"), "10");
  EXPECT_EQ(Value(path_, "SELECT status FROM run WHERE run_id = 2"), "failed");
}

TEST_F(ResultsFileTest, TwoRunsMayBeWrittenAtOnce) {
  RunWriter a(ResultsFile::Open(path_, Mode::kAppend), Info("dwa"), {.commit_interval = 0.01});
  RunWriter b(ResultsFile::Open(path_, Mode::kAppend), Info("sumo"), {.commit_interval = 0.01});
  for (int k = 0; k < 20; ++k) {
    a.Add(Samples(500));
    b.Add(Samples(500));
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  a.Finish({});
  b.Finish({});
  EXPECT_EQ(Value(path_, "SELECT COUNT(*) FROM trajectory"), "20000");
}

TEST_F(ResultsFileTest, AFullQueueWaitsAndLosesNothing) {
  RunWriter writer(ResultsFile::Open(path_, Mode::kAppend), Info("dwa"),
                   {.rows_per_commit = 100, .max_queued_rows = 200});
  for (int k = 0; k < 300; ++k) writer.Add(Samples(150));
  writer.Finish({});
  EXPECT_EQ(Value(path_, "SELECT COUNT(*) FROM trajectory"), "45000");
}

TEST_F(ResultsFileTest, RefusesAFileThatIsNotSqlite) {
  std::ofstream(path_) << "time,vehicle,x\n0.0,a,1.0\n" << std::string(200, ' ');
  for (const Mode mode : {Mode::kAppend, Mode::kRead}) {
    const std::string message = RefusalOf(path_, mode);
    EXPECT_CONTAINS(message, path_.string());
    EXPECT_CONTAINS(message,
                    "it is not an SQLite file; a Lanewise results file, or a name not in use, is allowed");
  }
  EXPECT_GT(fs::file_size(path_), 200u);  // Untouched.
}

TEST_F(ResultsFileTest, RefusesAnotherProgramsDatabase) {
  SQLite::Database(path_.string(), SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE)
      .exec("CREATE TABLE cake (a)");
  const std::string message = RefusalOf(path_, Mode::kAppend);
  EXPECT_CONTAINS(message,
                  "it is an SQLite file, but not Lanewise's (application_id 0x00000000, not 0x4c414e45)");
}

TEST_F(ResultsFileTest, RefusesANewerSchema) {
  WriteSmallRun(path_, "dwa");
  SQLite::Database(path_.string(), SQLite::OPEN_READWRITE).exec("PRAGMA user_version = 7");
  EXPECT_CONTAINS(
      RefusalOf(path_, Mode::kRead),
      "it has schema version 7; this Lanewise reads and writes version 6, so a newer one wrote it");
}

TEST_F(ResultsFileTest, RefusesFoldersAndWhatIsMissing) {
  EXPECT_CONTAINS(RefusalOf(folder_, Mode::kAppend), "it is a folder; name a file");
  EXPECT_CONTAINS(RefusalOf(path_, Mode::kRead), "there is no such file");
  EXPECT_CONTAINS(RefusalOf(folder_ / "no" / "r.sqlite", Mode::kAppend),
                  "the folder " + (folder_ / "no").string() + " does not exist; create it or choose another");
}

TEST_F(ResultsFileTest, CheckingCreatesNothing) {
  ResultsFile::CheckAppend(path_);
  EXPECT_FALSE(fs::exists(path_));
  EXPECT_THROW(ResultsFile::CheckAppend(folder_), ConfigError);
  EXPECT_THROW(ResultsFile::CheckAppend(folder_ / "no" / "r.sqlite"), ConfigError);
}

TEST_F(ResultsFileTest, RefusesADamagedFile) {
  WriteSmallRun(path_, "dwa");
  fs::resize_file(path_, 4096);  // The header survives.
  std::string message = RefusalOf(path_, Mode::kAppend);
  if (message.empty()) {
    try {
      LoadRunSummaries(path_);
    } catch (const ConfigError& e) {
      message = e.what();
    }
  }
  EXPECT_CONTAINS(message, "it is damaged");
}

/// Root may write anything: be nobody for a while.
class AsNobody {
 public:
  AsNobody() {
    if (::geteuid() == 0 && ::seteuid(65534) != 0) std::abort();
  }
  ~AsNobody() {
    if (::getuid() == 0 && ::seteuid(0) != 0) std::abort();
  }
};

TEST_F(ResultsFileTest, RefusesReadOnlyFilesAndFoldersButReadsThem) {
  WriteSmallRun(path_, "dwa");
  ::chmod(path_.c_str(), 0444);
  ::chmod(folder_.c_str(), 0777);
  {
    const AsNobody nobody;
    EXPECT_CONTAINS(RefusalOf(path_, Mode::kAppend),
                    "it is read-only; make it writable or choose another file");
  }
  ::chmod(folder_.c_str(), 0555);
  {
    const AsNobody nobody;
    EXPECT_CONTAINS(RefusalOf(folder_ / "new.sqlite", Mode::kAppend),
                    "the folder " + folder_.string() + " is read-only; make it writable or choose another");
    EXPECT_EQ(LoadRunSummaries(path_).size(), 1u);
  }
  ::chmod(folder_.c_str(), 0755);
}

/// Writes until it fails; the message of the failure.
std::string WriteUntilFull(const fs::path& path, WriterParams params) {
  try {
    RunWriter writer(ResultsFile::Open(path, Mode::kAppend), Info("dwa"), params);
    for (int k = 0; k < 2000; ++k) writer.Add(Samples(1000));
    writer.Finish({});
  } catch (const ConfigError& e) {
    return e.what();
  }
  return "";
}

TEST_F(ResultsFileTest, ASizeLimitFailsTheRunWithAMessage) {
  const std::string message =
      WriteUntilFull(path_, {.rows_per_commit = 2000, .max_queued_rows = 4000, .max_file_bytes = 2'000'000});
  EXPECT_CONTAINS(message, path_.string());
  EXPECT_CONTAINS(message, "the disk is full, or the file's size limit is reached");
  EXPECT_EQ(Value(path_, "PRAGMA integrity_check"), "ok");
  EXPECT_EQ(Value(path_, "SELECT status FROM run"), "failed");
  EXPECT_EQ(Value(path_, "SELECT message FROM run"), message);
  EXPECT_GT(std::stol(Value(path_, "SELECT COUNT(*) FROM trajectory")), 0);
}

TEST_F(ResultsFileTest, AFullDiskFailsTheRunWithAMessage) {
  // A disk of 4 MB that only the child sees.
  const pid_t child = ::fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    if (::unshare(CLONE_NEWNS) != 0 || ::mount("none", "/", nullptr, MS_REC | MS_PRIVATE, nullptr) != 0 ||
        ::mount("tmpfs", folder_.c_str(), "tmpfs", 0, "size=4m") != 0) {
      ::_exit(77);
    }
    const std::string message = WriteUntilFull(path_, {.rows_per_commit = 2000, .max_queued_rows = 4000});
    const bool ok = message.find("the disk is full") != std::string::npos &&
                    Value(path_, "PRAGMA integrity_check") == "ok" &&
                    Value(path_, "SELECT status FROM run") == "failed" &&
                    std::stol(Value(path_, "SELECT COUNT(*) FROM trajectory")) > 0;
    if (!ok) fmt::print(stderr, "message: {}\nstatus: {}\n", message, Value(path_, "SELECT status FROM run"));
    ::_exit(ok ? 0 : 1);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  ASSERT_TRUE(WIFEXITED(status));
  if (WEXITSTATUS(status) == 77) GTEST_SKIP() << "mounting is not permitted here";
  EXPECT_EQ(WEXITSTATUS(status), 0);
}

TEST_F(ResultsFileTest, AKilledRunLeavesAValidFile) {
  const pid_t child = ::fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    RunWriter writer(ResultsFile::Open(path_, Mode::kAppend), Info("dwa"),
                     {.rows_per_commit = 500, .max_queued_rows = 1000, .commit_interval = 0.01});
    while (true) writer.Add(Samples(100));
  }
  std::this_thread::sleep_for(std::chrono::milliseconds(700));
  ASSERT_EQ(::kill(child, SIGKILL), 0);
  ASSERT_EQ(::waitpid(child, nullptr, 0), child);
  EXPECT_EQ(Value(path_, "PRAGMA integrity_check"), "ok");
  EXPECT_EQ(Value(path_, "SELECT status FROM run"), "running");
  EXPECT_GT(std::stol(Value(path_, "SELECT COUNT(*) FROM trajectory")), 0);
  WriteSmallRun(path_, "idm");  // And it takes further runs.
  EXPECT_EQ(LoadRunSummaries(path_).size(), 2u);
}

}  // namespace
}  // namespace lanewise
