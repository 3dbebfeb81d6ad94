#pragma once

#include <condition_variable>
#include <cstdint>
#include <exception>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <thread>
#include <tuple>
#include <vector>

#include "agents/core/types.h"
#include "analysis/comfort_histogram.h"
#include "analysis/coordination_event.h"
#include "analysis/edge_recorder.h"
#include "analysis/encounter.h"
#include "analysis/rule_event.h"
#include "analysis/safety_monitor.h"
#include "analysis/trip_recorder.h"
#include "analysis/v2x_log.h"

namespace SQLite {
class Database;
}

namespace lanewise {

inline constexpr std::uint32_t kResultsApplicationId = 0x4C414E45;  ///< 'LANE', as in results_schema.sql.
inline constexpr std::uint32_t kSchemaVersion = 6;                  ///< user_version, likewise.

/// An open results file. Everything that fails throws ConfigError naming the file, what was found and what is
/// allowed.
class ResultsFile {
 public:
  /// kAppend creates the file, or opens a Lanewise file to add to it; nothing is ever replaced.
  enum class Mode : std::uint8_t { kRead, kAppend };

  static ResultsFile Open(const std::filesystem::path& path, Mode mode);
  /// Refuses what Open(path, kAppend) would refuse, as far as can be told without creating or writing
  /// anything.
  static void CheckAppend(const std::filesystem::path& path);

  ResultsFile(ResultsFile&&) noexcept;
  ResultsFile& operator=(ResultsFile&&) noexcept;
  ~ResultsFile();

  const std::filesystem::path& path() const { return path_; }
  SQLite::Database& database() { return *database_; }

 private:
  ResultsFile(std::filesystem::path path, std::unique_ptr<SQLite::Database> database);

  std::filesystem::path path_;
  std::unique_ptr<SQLite::Database> database_;
};

/// Runs `work` on a results file; what SQLite throws there becomes a ConfigError that names the file and the
/// way out.
void GuardResults(const std::filesystem::path& path, const std::function<void()>& work);

enum class RunStatus : std::uint8_t { kRunning, kFinished, kInterrupted, kFailed };

const char* ToString(RunStatus status);

/// What is known of a run before its first step.
struct RunInfo {
  std::string scenario{};
  std::string config_file{};
  std::string policy{};
  double penetration{1.0};           ///< Share of vehicles given the policy, as asked for.
  std::string coordination{"none"};  ///< What the roadside units coordinate, as asked for.
  std::string rules{};
  std::string v2x{"off"};      ///< How much of a radio channel there is.
  std::string safety{"full"};  ///< What is watched: off, contacts, full.
  std::int64_t seed{0};
  double begin{0.0};            ///< [s]
  std::optional<double> end{};  ///< [s] nothing: until all have arrived.
  double step_length{0.1};      ///< [s]
  std::int32_t threads{1};
  std::string sumo_options{};
  std::string arguments_json{"[]"};  ///< Of `lanewise run`: they repeat the run.
  std::string parameters_json{"{}"};
  std::string input_hashes_json{"{}"};
  std::string config_text{};  ///< The .sumocfg; empty without one.
  std::string lanewise_version{};
  std::string git_commit{};
  std::string sumo_version{};
  std::string compiler{};
  std::string machine{};
};

/// Commands that SUMO did not carry out as given, of one cause.
struct AuditRow {
  std::string cause{};
  std::int64_t count{0};
  std::optional<double> max_position_error{};  ///< [m]
  std::optional<double> max_speed_error{};     ///< [m/s]
};

struct PolicyShareRow {
  std::string policy{};
  std::int64_t vehicles{0};
  std::int64_t vehicle_steps{0};
  std::int64_t agent_steps{0};
};

/// What is known at the end of a run.
struct RunOutcome {
  RunStatus status{RunStatus::kFinished};
  std::string message{};
  double wall_time{0.0};       ///< [s]
  double sumo_time{0.0};       ///< [s] wall time within SUMO.
  double simulated_time{0.0};  ///< [s]
  std::int64_t steps{0};
  std::int64_t vehicle_steps{0};
  std::int64_t agent_steps{0};
  std::int64_t inserted{0};
  std::int64_t arrived{0};
  std::int64_t teleported{0};
  std::int64_t vaporized{0};
  std::int64_t still_running{0};
  std::int64_t not_inserted{0};
  std::uint64_t state_hash{0};
  std::vector<AuditRow> audit{};
  std::vector<PolicyShareRow> policy_shares{};
};

struct LaneRow {
  LaneIndex lane{kNone};
  std::string id{};  ///< SUMO's id.
};

struct TrajectoryRow {
  double time{0.0};  ///< [s]
  std::int32_t vehicle_number{kNone};
  LaneIndex lane{kNone};       ///< kNone: lane, lane_pos and lateral_offset become NULL.
  double x{0.0}, y{0.0};       ///< [m] middle of the front bumper.
  double heading{0.0};         ///< [rad]
  double speed{0.0};           ///< [m/s]
  double accel{0.0};           ///< [m/s^2]
  double lane_pos{0.0};        ///< [m]
  double lateral_offset{0.0};  ///< [m]
};

struct StepSummaryRow {
  double time{0.0};  ///< [s]
  std::int64_t running{0};
  std::int64_t halting{0};
  std::int64_t waiting_to_insert{0};
  std::int64_t arrived{0};  ///< Since the begin.
  std::int64_t agent_driven{0};
  std::optional<double> mean_speed{};  ///< [m/s]
  double wall_time{0.0};               ///< [s] since the begin.
};

/// Signatures of the state after a step; see table step_hash.
struct StepHashRow {
  std::int64_t step{0};
  std::uint64_t rolling{0}, vehicle_sum{0}, weighted_sum{0};
};

/// Gives a finished run its trajectory index, unless the file holds many runs: each further index is checked
/// for every row appended. @throws SQLite::Exception.
void IndexTrajectoryOfRun(std::int64_t run_id, SQLite::Database* database);

struct WriterParams {
  std::size_t rows_per_commit{50'000};
  std::size_t max_queued_rows{200'000};  ///< Add waits above it; memory is bounded by twice this.
  double commit_interval{1.0};           ///< [s] wall time; what a killed run loses at most.
  std::int64_t max_file_bytes{0};        ///< The file's size limit; 0 = the disk's.
};

/// Writes one run into a results file, from a thread of its own. What fails there is thrown as ConfigError by
/// the next Add or Finish. A process killed at any time leaves a valid file with status 'running'.
class RunWriter {
 public:
  /// Writes the run's row, with status 'running', before it returns.
  RunWriter(ResultsFile file, const RunInfo& info, WriterParams params = {});

  /// Without Finish: writes what is queued and ends the run as EndAs said.
  ~RunWriter();
  RunWriter(const RunWriter&) = delete;
  RunWriter& operator=(const RunWriter&) = delete;

  std::int64_t run_id() const { return run_id_; }
  /// [s] after Finish: processor time of the writing thread, and wall time for the trajectories' index.
  double writing_time() const { return writing_time_; }
  double index_time() const { return index_time_; }

  /// Queues rows: VehicleRow, LaneRow, EdgeRow, TripRow, TrajectoryRow, Contact, Encounter, EncounterSample,
  /// StepSummaryRow, StepHashRow, EdgeIntervalRow, HistogramRow, V2xIntervalRow, V2xAgeRow,
  /// CoordinationEvent or RuleEventRow. Waits while the queue is full.
  template <class Row>
  void Add(const std::vector<Row>& rows);

  /// Writes what is queued, the trajectory index and the outcome.
  void Finish(const RunOutcome& outcome);

  /// How the destructor ends the run if Finish is never called.
  void EndAs(RunStatus status, std::string message);

 private:
  using Rows =
      std::tuple<std::vector<VehicleRow>, std::vector<LaneRow>, std::vector<EdgeRow>, std::vector<TripRow>,
                 std::vector<TrajectoryRow>, std::vector<Contact>, std::vector<Encounter>,
                 std::vector<EncounterSample>, std::vector<StepSummaryRow>, std::vector<StepHashRow>,
                 std::vector<EdgeIntervalRow>, std::vector<HistogramRow>, std::vector<V2xIntervalRow>,
                 std::vector<V2xAgeRow>, std::vector<CoordinationEvent>, std::vector<RuleEventRow>>;

  void WriteLoop();
  void Write(const Rows& rows);
  void StopThread();
  void WriteOutcome(const RunOutcome& outcome);
  std::string IndexTrajectory();
  void TryEndRun(RunStatus status, const std::string& message) noexcept;

  ResultsFile file_;
  WriterParams params_;
  std::int64_t run_id_{0};
  std::int64_t trajectory_rows_{0};             // Committed.
  double writing_time_{0.0}, index_time_{0.0};  // [s]
  bool finished_{false};
  RunStatus unfinished_status_{RunStatus::kFailed};
  std::string unfinished_message_{"the run ended without a result"};

  std::mutex mutex_;  // Guards the five below.
  std::condition_variable work_, space_;
  Rows pending_;
  std::size_t pending_rows_{0};
  bool stop_{false};
  std::exception_ptr error_;
  std::thread thread_;
};

/// A row of the view v_run_summary: what runs are compared by.
struct RunSummary {
  std::int64_t run_id{0};
  std::string scenario{};
  std::string policy{};
  std::string coordination{};
  std::string rules{};
  std::string v2x{};
  std::int64_t seed{0};
  std::string status{};
  std::string started_at{};
  std::optional<std::int64_t> inserted{};  ///< Nothing until the run has ended; so below.
  std::optional<std::int64_t> trajectory_rows{};
  std::optional<std::string> state_hash{};
  std::int64_t arrived{0};
  std::optional<double> mean_duration{};   ///< [s] of arrived vehicles; nothing if none has; so below.
  std::optional<double> mean_time_loss{};  ///< [s]
  double distance_km{0.0};
  double co2_kg{0.0};
  std::optional<double> co2_g_per_km{};
  std::int64_t hard_braking_count{0};
  std::optional<std::int64_t> collisions{};  ///< Nothing: not watched; so below.
  std::optional<std::int64_t> agent_striking_outside_junctions{};
  std::optional<std::int64_t> collisions_in_junctions{};
  std::optional<std::int64_t> near_misses{};
  std::optional<double> min_ttc{};  ///< [s]
  std::int64_t red_lights_run{0}, standstills{0};
  std::optional<std::int64_t> detours{};  ///< Of agents, for want of a lane change; nothing: not counted.
};

/// Runs of a results file in order of their number.
std::vector<RunSummary> LoadRunSummaries(const std::filesystem::path& path);

/// What `lanewise info FILE` prints.
std::string FormatInfo(const std::filesystem::path& path, std::span<const RunSummary> runs);

/// The runs side by side, a column each.
std::string FormatComparison(std::span<const RunSummary> runs);

}  // namespace lanewise
