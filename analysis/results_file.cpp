#include "analysis/results_file.h"

#include <SQLiteCpp/SQLiteCpp.h>
#include <fcntl.h>
#include <sqlite3.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <ctime>
#include <fstream>
#include <functional>
#include <span>
#include <string_view>
#include <thread>
#include <utility>

#include "agents/core/check.h"
#include "analysis/results_schema.h"  // Generated from results_schema.sql.
#include "analysis/results_views.h"   // Generated from results_views.sql.

namespace lanewise {
namespace {

namespace fs = std::filesystem;

constexpr int kBusyTimeoutMs = 30'000;  // Another process's commit takes a fraction of a second.

/// SQLite's busy handler: waits up to kBusyTimeoutMs, and says so when it takes long. 0: given up.
int WaitForLock(void* database, int tries) {
  constexpr int kPauseMs = 50, kSayAfterMs = 2000;
  const int waited = kPauseMs * tries;
  if (waited >= kBusyTimeoutMs) return 0;
  if (waited == kSayAfterMs)
    fmt::print(stderr, "lanewise: results file {}: another process has it locked; waiting up to {} s\n",
               sqlite3_db_filename(static_cast<sqlite3*>(database), "main"), kBusyTimeoutMs / 1000);
  std::this_thread::sleep_for(std::chrono::milliseconds(kPauseMs));
  return 1;
}

[[noreturn]] void Refuse(const fs::path& path, const std::string& found) {
  throw ConfigError(fmt::format("results file {}: {}", path.string(), found));
}

std::string Explain(const SQLite::Exception& e) {
  switch (e.getErrorCode()) {
    case SQLITE_FULL:
      return "the disk is full, or the file's size limit is reached; free some space or choose another disk";
    case SQLITE_READONLY:
      return "it is read-only; make it writable or choose another file";
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
      return fmt::format("another process kept it locked for {} s; let that end or choose another file",
                         kBusyTimeoutMs / 1000);
    case SQLITE_NOTADB:
    case SQLITE_CORRUPT:
      return fmt::format("it is damaged ({})", e.what());
    case SQLITE_CANTOPEN:
      return fmt::format("it cannot be opened ({}); its folder must exist and be writable", e.what());
    default:
      return fmt::format("SQLite says: {}", e.what());
  }
}

/// Runs `work`, turning what SQLite throws into an error for the user.
template <class Work>
auto Guarded(const fs::path& path, Work&& work) {
  try {
    return work();
  } catch (const SQLite::Exception& e) {
    Refuse(path, Explain(e));
  }
}

bool IsWritable(const fs::path& path) {
  return ::faccessat(AT_FDCWD, path.c_str(), W_OK, AT_EACCESS) == 0;
}

std::uint32_t BigEndian(const std::array<char, 100>& header, std::size_t at) {
  std::uint32_t value = 0;
  for (std::size_t k = 0; k < 4; ++k) value = value << 8 | static_cast<unsigned char>(header[at + k]);
  return value;
}

/// [s] of processor time of the calling thread so far.
double ThreadTime() {
  timespec time{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

/// Looks at a file's first bytes only (the SQLite file format's header): a file that is not ours stays
/// untouched.
void CheckHeader(const fs::path& path) {
  std::array<char, 100> header{};
  std::ifstream stream(path, std::ios::binary);
  if (!stream) Refuse(path, "it cannot be read; make it readable or choose another file");
  stream.read(header.data(), header.size());
  if (stream.gcount() < static_cast<std::streamsize>(header.size()) ||
      std::string_view(header.data(), 16) != std::string_view("SQLite format 3\0", 16)) {
    Refuse(path, "it is not an SQLite file; a Lanewise results file, or a name not in use, is allowed");
  }
  const std::uint32_t application_id = BigEndian(header, 68);
  if (application_id != kResultsApplicationId) {
    Refuse(path,
           fmt::format("it is an SQLite file, but not Lanewise's (application_id {:#010x}, not {:#010x}); "
                       "a Lanewise results file, or a name not in use, is allowed",
                       application_id, kResultsApplicationId));
  }
  const std::uint32_t version = BigEndian(header, 60);
  if (version != kSchemaVersion) {
    Refuse(path, fmt::format("it has schema version {}; this Lanewise reads and writes version {}{}", version,
                             kSchemaVersion, version > kSchemaVersion ? ", so a newer one wrote it" : ""));
  }
}

void CheckCanAppend(const fs::path& path, bool exists) {
  const fs::path folder = path.has_parent_path() ? path.parent_path() : fs::path(".");
  std::error_code error;
  if (!fs::is_directory(folder, error)) {
    Refuse(path, fmt::format("the folder {} does not exist; create it or choose another", folder.string()));
  }
  if (exists && !IsWritable(path)) Refuse(path, "it is read-only; make it writable or choose another file");
  // SQLite keeps its log beside the file.
  if (!IsWritable(folder)) {
    Refuse(path,
           fmt::format("the folder {} is read-only; make it writable or choose another", folder.string()));
  }
}

void CheckOpen(const fs::path& path, ResultsFile::Mode mode) {
  std::error_code error;
  const bool exists = fs::exists(path, error);
  if (fs::is_directory(path, error)) Refuse(path, "it is a folder; name a file");
  if (mode == ResultsFile::Mode::kRead && !exists) Refuse(path, "there is no such file");
  if (mode == ResultsFile::Mode::kAppend) CheckCanAppend(path, exists);
  // An empty file holds nothing to lose (mktemp makes one); for reading it is no results file.
  const bool empty = !exists || fs::file_size(path, error) == 0;
  if (!empty || mode == ResultsFile::Mode::kRead) CheckHeader(path);
}

void CreateSchemaIfEmpty(SQLite::Database* database) {
  // Only a file without pages takes it. A quarter as many pages to log, add up and write as with SQLite's
  // 4096.
  database->exec("PRAGMA page_size = 16384");
  // Under the write lock: another process may be creating the same file.
  SQLite::Transaction transaction(*database, SQLite::TransactionBehavior::IMMEDIATE);
  if (database->execAndGet("SELECT COUNT(*) FROM sqlite_master").getInt() == 0)
    database->exec(std::string(kResultsSchema) + kResultsViews);
  transaction.commit();
}

/// Binds the values of a row one after the other, behind the first `bound`.
class Binder {
 public:
  explicit Binder(SQLite::Statement* statement, int bound = 0) : statement_(statement), index_(bound) {}

  template <class... Values>
  void operator()(const Values&... values) {
    (Bind(values), ...);
  }

 private:
  void Bind(double value) { statement_->bind(++index_, value); }
  void Bind(std::int32_t value) { statement_->bind(++index_, value); }
  void Bind(std::int64_t value) { statement_->bind(++index_, value); }
  void Bind(bool value) { statement_->bind(++index_, static_cast<std::int32_t>(value)); }
  void Bind(const char* value) { statement_->bind(++index_, value); }
  void Bind(const std::string& value) { statement_->bind(++index_, value); }
  void Bind(std::nullopt_t) { statement_->bind(++index_); }
  template <class Value>
  void Bind(const std::optional<Value>& value) {
    value ? Bind(*value) : Bind(std::nullopt);
  }

  SQLite::Statement* statement_;
  int index_;
};

/// A number of which kNone stands for nothing.
std::optional<std::int32_t> OrNull(std::int32_t number) {
  return number == kNone ? std::nullopt : std::optional(number);
}

std::optional<std::string> OrNull(const std::string& text) {
  return text.empty() ? std::nullopt : std::optional(text);
}

// What goes into which table. Values in the order of the table's columns, run_id first.

const char* TableOf(const VehicleRow&) {
  return "vehicle";
}
void BindRow(const VehicleRow& r, std::int64_t run_id, Binder bind) {
  bind(run_id, r.number, r.id, r.type, r.vclass, r.policy, r.depart, r.depart_delay, r.length, r.width);
}

const char* TableOf(const LaneRow&) {
  return "lane";
}
void BindRow(const LaneRow& r, std::int64_t run_id, Binder bind) {
  bind(run_id, r.lane, r.id);
}

const char* TableOf(const TripRow&) {
  return "trip";
}
void BindRow(const TripRow& r, std::int64_t run_id, Binder bind) {
  bind(run_id, r.vehicle_number, ToString(r.end), r.depart, r.arrival, r.duration, r.depart_delay,
       r.route_length, r.waiting_time, r.waiting_count, r.stop_time, r.time_loss, r.max_accel, r.max_decel,
       r.max_jerk, r.rms_jerk, r.max_lateral_accel, r.hard_braking_count, r.co2, r.nox, r.pmx, r.fuel,
       r.electricity, r.steps, r.agent_steps, r.min_ttc, r.max_drac, r.ttc_exposed, r.ttc_integrated,
       r.speed_variance);
}

const char* TableOf(const TrajectoryRow&) {
  return "trajectory";
}
void BindRow(const TrajectoryRow& r, std::int64_t run_id, Binder bind) {
  bind(run_id, r.time, r.vehicle_number, r.x, r.y, r.heading, r.speed, r.accel);
  if (r.lane == kNone) {
    bind(std::nullopt, std::nullopt, std::nullopt);
  } else {
    bind(r.lane, r.lane_pos, r.lateral_offset);
  }
}

const char* TableOf(const Contact&) {
  return "collision";
}
void BindRow(const Contact& r, std::int64_t run_id, Binder bind) {
  const std::int32_t struck = r.striking == kNone ? kNone : r.striking == r.first ? r.second : r.first;
  bind(std::nullopt, run_id, r.first, r.second, OrNull(r.striking), OrNull(struck), r.first_agent,
       r.second_agent, r.striking_agent(), r.begin, r.end, r.x, r.y, OrNull(r.first_lane),
       OrNull(r.second_lane), r.in_junction, r.first_speed, r.second_speed, r.closing_speed, r.max_depth);
}

/// A value, or nothing where it is undefined.
std::optional<double> OrNull(double value, double undefined) {
  return value == undefined ? std::nullopt : std::optional(value);
}

const char* TableOf(const Encounter&) {
  return "encounter";
}
void BindRow(const Encounter& r, std::int64_t run_id, Binder bind) {
  constexpr double kUndefined = Encounter::kUndefined;
  const auto time_of = [](const std::optional<double>& value, double time) {
    return value ? std::optional(time) : std::nullopt;
  };
  const auto ttc = OrNull(r.min_ttc, kUndefined), mttc = OrNull(r.min_mttc, kUndefined),
             pet = OrNull(r.pet, kUndefined), distance = OrNull(r.min_distance, kUndefined);
  const auto drac = OrNull(r.max_drac, 0.0), closing = OrNull(r.max_closing_speed, 0.0);
  bind(run_id, r.number, r.first, r.second, r.ego_is_first ? r.first : r.second,
       r.ego_is_first ? r.second : r.first,
       std::string(kEncounterTypeNames[static_cast<std::size_t>(r.type)]), SumoTypeCode(r.type, r.contact),
       static_cast<std::int32_t>(r.severity), r.first_agent, r.second_agent, r.begin, r.end, r.critical, r.x,
       r.y, OrNull(r.first_lane), OrNull(r.second_lane), r.in_junction, r.first_speed, r.second_speed);
  bind(ttc, time_of(ttc, r.min_ttc_time), drac, time_of(drac, r.max_drac_time), mttc,
       time_of(mttc, r.min_mttc_time), pet, time_of(pet, r.pet_time), distance,
       time_of(distance, r.min_distance_time), closing, time_of(closing, r.max_closing_speed_time));
  if (r.contact) {
    bind(r.first_delta_v, r.second_delta_v);
  } else {
    bind(std::nullopt, std::nullopt);
  }
  bind(r.contact, r.near_miss);
}

const char* TableOf(const EncounterSample&) {
  return "encounter_sample";
}
void BindRow(const EncounterSample& r, std::int64_t run_id, Binder bind) {
  bind(run_id, r.encounter, r.time, r.first.x, r.first.y, r.first.heading, r.first.speed, r.first.accel,
       r.second.x, r.second.y, r.second.heading, r.second.speed, r.second.accel,
       OrNull(r.ttc, Encounter::kUndefined), OrNull(r.drac, 0.0), r.type_code);
}

const char* TableOf(const EdgeRow&) {
  return "edge";
}
void BindRow(const EdgeRow& r, std::int64_t run_id, Binder bind) {
  bind(run_id, r.edge, r.id, r.lanes, r.length, r.in_junction);
}

const char* TableOf(const EdgeIntervalRow&) {
  return "edge_interval";
}
void BindRow(const EdgeIntervalRow& r, std::int64_t run_id, Binder bind) {
  bind(run_id, r.begin, r.end, r.edge, r.vehicle_time, r.vehicle_distance, 3600.0 * r.flow, 1e3 * r.density,
       r.speed, r.speed_variance, r.waiting_time, r.time_loss, r.entered, r.co2, r.nox, r.pmx, r.fuel,
       r.electricity);
}

const char* TableOf(const HistogramRow&) {
  return "histogram";
}
void BindRow(const HistogramRow& r, std::int64_t run_id, Binder bind) {
  bind(run_id, r.policy, r.measure, r.bin, r.lower, r.upper, r.vehicle_time);
}

const char* TableOf(const CoordinationEvent&) {
  return "coordination_event";
}
void BindRow(const CoordinationEvent& r, std::int64_t run_id, Binder bind) {
  bind(run_id, r.time, std::string(kCoordinationKindNames[static_cast<std::size_t>(r.kind)]),
       OrNull(r.vehicle), OrNull(r.signal), r.value);
}

const char* TableOf(const RuleEventRow&) {
  return "rule_event";
}
void BindRow(const RuleEventRow& r, std::int64_t run_id, Binder bind) {
  bind(run_id, r.time, std::string(kRuleEventNames[static_cast<std::size_t>(r.kind)]), r.vehicle_number,
       OrNull(r.lane));
}

const char* TableOf(const StepSummaryRow&) {
  return "step_summary";
}
void BindRow(const StepSummaryRow& r, std::int64_t run_id, Binder bind) {
  bind(run_id, r.time, r.running, r.halting, r.waiting_to_insert, r.arrived, r.agent_driven, r.mean_speed,
       r.wall_time);
}

const char* TableOf(const StepHashRow&) {
  return "step_hash";
}
void BindRow(const StepHashRow& r, std::int64_t run_id, Binder bind) {
  bind(run_id, r.step, static_cast<std::int64_t>(r.rolling), static_cast<std::int64_t>(r.vehicle_sum),
       static_cast<std::int64_t>(r.weighted_sum));
}

const char* TableOf(const V2xIntervalRow&) {
  return "v2x_interval";
}
void BindRow(const V2xIntervalRow& r, std::int64_t run_id, Binder bind) {
  bind(run_id, r.begin, r.end, r.station_time, r.sent, r.delivered, r.dropped, r.faded, r.collided,
       r.pair_time, r.mean_age, r.mean_busy, r.max_busy, r.cruise_time, r.platoon_joins, r.platoon_leaves);
}

const char* TableOf(const V2xAgeRow&) {
  return "v2x_age";
}
void BindRow(const V2xAgeRow& r, std::int64_t run_id, Binder bind) {
  bind(run_id, r.age, r.pair_time);
}

const char* TableOf(const AuditRow&) {
  return "audit";
}
void BindRow(const AuditRow& r, std::int64_t run_id, Binder bind) {
  bind(run_id, r.cause, r.count, r.max_position_error, r.max_speed_error);
}

const char* TableOf(const PolicyShareRow&) {
  return "policy_share";
}
void BindRow(const PolicyShareRow& r, std::int64_t run_id, Binder bind) {
  bind(run_id, r.policy, r.vehicles, r.vehicle_steps, r.agent_steps);
}

int ColumnsOf(SQLite::Database* database, const char* table) {
  return database->execAndGet(fmt::format("SELECT COUNT(*) FROM pragma_table_info('{}')", table)).getInt();
}

/// "INSERT INTO table VALUES (?, ...), ..." for that many rows of all columns.
std::string InsertSql(const char* table, int columns, std::size_t rows) {
  std::string row = "(?";
  for (int k = 1; k < columns; ++k) row += ",?";
  row += ')';
  std::string sql = fmt::format("INSERT INTO {} VALUES {}", table, row);
  for (std::size_t k = 1; k < rows; ++k) sql += "," + row;
  return sql;
}

/// Many rows a statement: starting and ending one takes longer than a row.
template <class Row>
void InsertRows(const std::vector<Row>& all_rows, std::int64_t run_id, SQLite::Database* database) {
  if (all_rows.empty()) return;
  constexpr std::size_t kRowsPerInsert = 50;
  std::span<const Row> rows(all_rows);
  const char* table = TableOf(rows.front());
  const int columns = ColumnsOf(database, table);
  while (!rows.empty()) {
    const std::size_t count = std::min(rows.size(), kRowsPerInsert);
    SQLite::Statement insert(*database, InsertSql(table, columns, count));
    for (; rows.size() >= count; rows = rows.subspan(count)) {
      for (std::size_t k = 0; k < count; ++k)
        BindRow(rows[k], run_id, Binder(&insert, static_cast<int>(k) * columns));
      insert.exec();
      insert.reset();
    }
  }
}

void LimitFileSize(std::int64_t max_bytes, SQLite::Database* database) {
  if (max_bytes <= 0) return;
  const std::int64_t page_bytes = database->execAndGet("PRAGMA page_size").getInt64();
  const std::int64_t pages = std::max<std::int64_t>(1, max_bytes / page_bytes);  // 0 would be no limit.
  SQLite::Statement(*database, fmt::format("PRAGMA max_page_count = {}", pages)).executeStep();
}

std::int64_t InsertRun(const RunInfo& info, SQLite::Database* database) {
  SQLite::Statement insert(
      *database,
      "INSERT INTO run (started_at, status, scenario, config_file, policy, penetration_rate, rules, v2x, "
      "coordination, "
      "safety, "
      "seed, begin_s, end_s, step_length_s, threads, sumo_options, arguments_json, parameters_json, "
      "input_hashes_json, config_text, lanewise_version, git_commit, sumo_version, compiler, machine) VALUES "
      "(strftime('%Y-%m-%dT%H:%M:%SZ', 'now'), 'running', "
      "?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)");
  Binder bind(&insert);
  bind(info.scenario, info.config_file, info.policy, info.penetration, info.rules, info.v2x,
       info.coordination, info.safety, info.seed, info.begin, info.end, info.step_length, info.threads,
       info.sumo_options, info.arguments_json, info.parameters_json, info.input_hashes_json,
       OrNull(info.config_text), info.lanewise_version, info.git_commit, info.sumo_version, info.compiler,
       info.machine);
  insert.exec();
  return database->getLastInsertRowid();
}

template <class Value>
std::optional<Value> Optional(const SQLite::Column& column) {
  if (column.isNull()) return std::nullopt;
  if constexpr (std::is_same_v<Value, double>) {
    return column.getDouble();
  } else if constexpr (std::is_same_v<Value, std::string>) {
    return column.getString();
  } else {
    return column.getInt64();
  }
}

std::string Cell(const std::optional<double>& value, int digits) {
  return value ? fmt::format("{:.{}f}", *value, digits) : "-";
}

std::string Cell(std::int64_t value) {
  return fmt::format("{}", value);
}

std::string Cell(const std::optional<std::int64_t>& value) {
  return value ? Cell(*value) : "-";
}

/// Lines of cells as text, columns aligned: the first to the left, the others to the right.
std::string FormatTable(const std::vector<std::vector<std::string>>& lines) {
  std::vector<std::size_t> width;
  for (const auto& line : lines) {
    width.resize(std::max(width.size(), line.size()));
    for (std::size_t k = 0; k < line.size(); ++k) width[k] = std::max(width[k], line[k].size());
  }
  std::string text;
  for (const auto& line : lines) {
    text += fmt::format("{:<{}}", line[0], width[0]);
    for (std::size_t k = 1; k < line.size(); ++k) text += fmt::format("  {:>{}}", line[k], width[k]);
    text += '\n';
  }
  return text;
}

}  // namespace

void GuardResults(const fs::path& path, const std::function<void()>& work) {
  Guarded(path, work);
}

void ResultsFile::CheckAppend(const fs::path& path) {
  CheckOpen(path, Mode::kAppend);
}

ResultsFile ResultsFile::Open(const fs::path& path, Mode mode) {
  CheckOpen(path, mode);
  return Guarded(path, [&] {
    const int access =
        mode == Mode::kRead ? SQLite::OPEN_READONLY : SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE;
    // One thread at a time uses the connection (RunWriter hands it over): SQLite's locks cost a quarter of
    // the time.
    const int flags = access | SQLite::OPEN_NOMUTEX;
    auto database = std::make_unique<SQLite::Database>(path.string(), flags);
    sqlite3_busy_handler(database->getHandle(), WaitForLock, database->getHandle());
    if (mode == Mode::kAppend) {
      CreateSchemaIfEmpty(database.get());
      database->exec("PRAGMA journal_mode = WAL");
      database->exec("PRAGMA synchronous = NORMAL");
    }
    return ResultsFile(path, std::move(database));
  });
}

ResultsFile::ResultsFile(fs::path path, std::unique_ptr<SQLite::Database> database)
    : path_(std::move(path)), database_(std::move(database)) {}

ResultsFile::ResultsFile(ResultsFile&&) noexcept = default;
ResultsFile& ResultsFile::operator=(ResultsFile&&) noexcept = default;

ResultsFile::~ResultsFile() {
  // Back from WAL: a file at rest is one file and can be read from read-only media. Fails, harmlessly, while
  // others have it open.
  if (database_ && ::sqlite3_db_readonly(database_->getHandle(), "main") == 0) {
    database_->setBusyTimeout(0);
    database_->tryExec("PRAGMA journal_mode = DELETE");
  }
}

const char* ToString(RunStatus status) {
  switch (status) {
    case RunStatus::kRunning:
      return "running";
    case RunStatus::kFinished:
      return "finished";
    case RunStatus::kInterrupted:
      return "interrupted";
    case RunStatus::kFailed:
      return "failed";
  }
  return "";
}

RunWriter::RunWriter(ResultsFile file, const RunInfo& info, WriterParams params)
    : file_(std::move(file)), params_(params) {
  LANEWISE_CHECK(params_.rows_per_commit > 0 && params_.max_queued_rows >= params_.rows_per_commit);
  Guarded(file_.path(), [&] {
    LimitFileSize(params_.max_file_bytes, &file_.database());
    run_id_ = InsertRun(info, &file_.database());
  });
  thread_ = std::thread([this] { WriteLoop(); });
}

RunWriter::~RunWriter() {
  if (finished_) return;
  StopThread();
  if (!error_) TryEndRun(unfinished_status_, unfinished_message_);
}

void RunWriter::EndAs(RunStatus status, std::string message) {
  unfinished_status_ = status;
  unfinished_message_ = std::move(message);
}

template <class Row>
void RunWriter::Add(const std::vector<Row>& rows) {
  if (rows.empty()) return;
  std::unique_lock lock(mutex_);
  LANEWISE_CHECK(!stop_);
  space_.wait(lock, [this] { return pending_rows_ < params_.max_queued_rows || error_; });
  if (error_) std::rethrow_exception(error_);
  auto& queue = std::get<std::vector<Row>>(pending_);
  queue.insert(queue.end(), rows.begin(), rows.end());
  pending_rows_ += rows.size();
  if (pending_rows_ >= params_.rows_per_commit) work_.notify_one();
}

template void RunWriter::Add(const std::vector<VehicleRow>&);
template void RunWriter::Add(const std::vector<LaneRow>&);
template void RunWriter::Add(const std::vector<TripRow>&);
template void RunWriter::Add(const std::vector<TrajectoryRow>&);
template void RunWriter::Add(const std::vector<Contact>&);
template void RunWriter::Add(const std::vector<Encounter>&);
template void RunWriter::Add(const std::vector<EdgeRow>&);
template void RunWriter::Add(const std::vector<EncounterSample>&);
template void RunWriter::Add(const std::vector<StepSummaryRow>&);
template void RunWriter::Add(const std::vector<StepHashRow>&);
template void RunWriter::Add(const std::vector<EdgeIntervalRow>&);
template void RunWriter::Add(const std::vector<HistogramRow>&);
template void RunWriter::Add(const std::vector<V2xIntervalRow>&);
template void RunWriter::Add(const std::vector<V2xAgeRow>&);
template void RunWriter::Add(const std::vector<CoordinationEvent>&);
template void RunWriter::Add(const std::vector<RuleEventRow>&);

void RunWriter::WriteLoop() {
  const std::chrono::duration<double> interval(params_.commit_interval);
  Rows batch;  // Swapped with the queue: both keep their memory, nothing is allocated in the long run.
  std::unique_lock lock(mutex_);
  while (!stop_ || pending_rows_ > 0) {
    work_.wait_for(lock, interval, [this] { return stop_ || pending_rows_ >= params_.rows_per_commit; });
    if (pending_rows_ == 0) continue;
    std::swap(batch, pending_);
    pending_rows_ = 0;
    lock.unlock();
    space_.notify_all();
    std::exception_ptr error;
    try {
      Guarded(file_.path(), [&] { Write(batch); });
    } catch (const std::exception& e) {
      error = std::current_exception();
      TryEndRun(RunStatus::kFailed, e.what());
    }
    std::apply([](auto&... rows) { (rows.clear(), ...); }, batch);
    lock.lock();
    writing_time_ = ThreadTime();
    if (error) {
      error_ = error;
      space_.notify_all();
      return;
    }
  }
}

/// One transaction, open only while it writes: other processes get at the file in between.
void RunWriter::Write(const Rows& rows) {
  SQLite::Transaction transaction(file_.database(), SQLite::TransactionBehavior::IMMEDIATE);
  std::apply([this](const auto&... table) { (InsertRows(table, run_id_, &file_.database()), ...); }, rows);
  transaction.commit();
  trajectory_rows_ += static_cast<std::int64_t>(std::get<std::vector<TrajectoryRow>>(rows).size());
}

void RunWriter::StopThread() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  work_.notify_one();
  if (thread_.joinable()) thread_.join();
}

void RunWriter::Finish(const RunOutcome& outcome) {
  LANEWISE_CHECK(!finished_);
  StopThread();
  finished_ = true;
  if (error_) std::rethrow_exception(error_);
  try {
    Guarded(file_.path(), [&] { WriteOutcome(outcome); });
  } catch (const ConfigError& e) {
    TryEndRun(RunStatus::kFailed, e.what());
    throw;
  }
}

void RunWriter::WriteOutcome(const RunOutcome& outcome) {
  std::string message = outcome.message;
  const auto index_start = std::chrono::steady_clock::now();
  const std::string index_error = IndexTrajectory();
  index_time_ = std::chrono::duration<double>(std::chrono::steady_clock::now() - index_start).count();
  if (!index_error.empty()) message += (message.empty() ? "" : "; ") + index_error;

  SQLite::Database& database = file_.database();
  SQLite::Transaction transaction(database, SQLite::TransactionBehavior::IMMEDIATE);
  InsertRows(outcome.audit, run_id_, &database);
  InsertRows(outcome.policy_shares, run_id_, &database);
  SQLite::Statement update(
      database,
      "UPDATE run SET finished_at = strftime('%Y-%m-%dT%H:%M:%SZ', 'now'), status = ?, message = ?, "
      "wall_time_s = ?, sumo_time_s = ?, simulated_time_s = ?, steps = ?, vehicle_steps = ?, agent_steps = "
      "?, "
      "inserted = ?, arrived = ?, teleported = ?, vaporized = ?, still_running = ?, not_inserted = ?, "
      "trajectory_rows = ?, state_hash = ? WHERE run_id = ?");
  Binder bind(&update);
  bind(ToString(outcome.status), OrNull(message), outcome.wall_time, outcome.sumo_time,
       outcome.simulated_time, outcome.steps, outcome.vehicle_steps, outcome.agent_steps, outcome.inserted,
       outcome.arrived, outcome.teleported, outcome.vaporized, outcome.still_running, outcome.not_inserted,
       trajectory_rows_, fmt::format("{:016x}", outcome.state_hash), run_id_);
  update.exec();
  transaction.commit();
}

void IndexTrajectoryOfRun(std::int64_t run_id, SQLite::Database* database) {
  constexpr int kMaxIndexes = 64;
  const int indexes = database
                          ->execAndGet(
                              "SELECT COUNT(*) FROM sqlite_master WHERE type = 'index' AND name LIKE "
                              "'trajectory_of_run_%'")
                          .getInt();
  if (indexes >= kMaxIndexes) return;
  database->exec(
      fmt::format("CREATE INDEX IF NOT EXISTS trajectory_of_run_{0} ON trajectory (vehicle_number, time_s) "
                  "WHERE run_id = {0}",
                  run_id));
}

/// A partial index for this run: filled once, in bulk, and neither kept up while another run is appended nor
/// built anew for all. Only an accelerator, so a failure (it takes space) is no failure of the run: returns
/// what it was.
std::string RunWriter::IndexTrajectory() {
  if (trajectory_rows_ == 0) return "";
  try {
    IndexTrajectoryOfRun(run_id_, &file_.database());
    return "";
  } catch (const SQLite::Exception& e) {
    return fmt::format("trajectory index not built: {}", Explain(e));
  }
}

void RunWriter::TryEndRun(RunStatus status, const std::string& message) noexcept {
  try {
    SQLite::Statement update(
        file_.database(),
        "UPDATE run SET finished_at = strftime('%Y-%m-%dT%H:%M:%SZ', 'now'), status = ?, "
        "message = ?, trajectory_rows = ? WHERE run_id = ?");
    Binder bind(&update);
    bind(ToString(status), message, trajectory_rows_, run_id_);
    update.exec();
  } catch (const std::exception& e) {
    // The caller reports the first error; this one only leaves the run's status at 'running'.
    fmt::print(stderr, "lanewise: results file {}: could not mark run {} as {}: {}\n", file_.path().string(),
               run_id_, ToString(status), e.what());
  }
}

std::vector<RunSummary> LoadRunSummaries(const fs::path& path) {
  ResultsFile file = ResultsFile::Open(path, ResultsFile::Mode::kRead);
  return Guarded(path, [&] {
    SQLite::Statement query(
        file.database(),
        "SELECT run_id, scenario, policy, rules, v2x, coordination, seed, status, started_at, inserted, "
        "trajectory_rows, "
        "state_hash, "
        "arrived, mean_duration_s, mean_time_loss_s, distance_km, co2_kg, co2_g_per_km, hard_braking_count, "
        "collisions, agent_striking_outside_junctions, collisions_in_junctions, near_misses, min_ttc_s, "
        "red_lights_run, standstills, "
        "(SELECT count FROM audit WHERE audit.run_id = v_run_summary.run_id AND cause = 'detours') "
        "FROM v_run_summary");
    std::vector<RunSummary> runs;
    while (query.executeStep()) {
      int k = 0;
      const auto next = [&] { return query.getColumn(k++); };
      RunSummary& run = runs.emplace_back();
      run.run_id = next().getInt64();
      run.scenario = next().getString();
      run.policy = next().getString();
      run.rules = next().getString();
      run.v2x = next().getString();
      run.coordination = next().getString();
      run.seed = next().getInt64();
      run.status = next().getString();
      run.started_at = next().getString();
      run.inserted = Optional<std::int64_t>(next());
      run.trajectory_rows = Optional<std::int64_t>(next());
      run.state_hash = Optional<std::string>(next());
      run.arrived = next().getInt64();
      run.mean_duration = Optional<double>(next());
      run.mean_time_loss = Optional<double>(next());
      run.distance_km = next().getDouble();
      run.co2_kg = next().getDouble();
      run.co2_g_per_km = Optional<double>(next());
      run.hard_braking_count = next().getInt64();
      run.collisions = Optional<std::int64_t>(next());
      run.agent_striking_outside_junctions = Optional<std::int64_t>(next());
      run.collisions_in_junctions = Optional<std::int64_t>(next());
      run.near_misses = Optional<std::int64_t>(next());
      run.min_ttc = Optional<double>(next());
      run.red_lights_run = next().getInt64();
      run.standstills = next().getInt64();
      run.detours = Optional<std::int64_t>(next());
    }
    return runs;
  });
}

std::string FormatInfo(const fs::path& path, std::span<const RunSummary> runs) {
  std::vector<std::vector<std::string>> lines = {{"run", "started (UTC)", "status", "scenario", "policy",
                                                  "rules", "v2x", "coordination", "seed", "inserted",
                                                  "arrived", "collisions", "near misses", "red lights run",
                                                  "standstills", "detours", "trajectory rows", "state hash"}};
  for (const RunSummary& run : runs) {
    lines.push_back({Cell(run.run_id), run.started_at, run.status, run.scenario, run.policy, run.rules,
                     run.v2x, run.coordination, Cell(run.seed), Cell(run.inserted), Cell(run.arrived),
                     Cell(run.collisions), Cell(run.near_misses), Cell(run.red_lights_run),
                     Cell(run.standstills), Cell(run.detours), Cell(run.trajectory_rows),
                     run.state_hash.value_or("-")});
  }
  return fmt::format("{}: Lanewise results, schema {}, {} run{}\n{}", path.string(), kSchemaVersion,
                     runs.size(), runs.size() == 1 ? "" : "s", FormatTable(lines));
}

std::string FormatComparison(std::span<const RunSummary> runs) {
  std::vector<std::vector<std::string>> lines;
  const auto add = [&](const char* name, const std::function<std::string(const RunSummary&)>& cell) {
    lines.push_back({name});
    for (const RunSummary& run : runs) lines.back().push_back(cell(run));
  };
  add("policy", [](const RunSummary& run) { return run.policy; });
  add("run", [](const RunSummary& run) { return Cell(run.run_id); });
  if (std::any_of(runs.begin(), runs.end(), [](const RunSummary& run) { return run.status != "finished"; })) {
    add("status", [](const RunSummary& run) { return run.status; });
  }
  add("inserted", [](const RunSummary& run) { return Cell(run.inserted); });
  add("arrived", [](const RunSummary& run) { return Cell(run.arrived); });
  add("mean trip [s]", [](const RunSummary& run) { return Cell(run.mean_duration, 1); });
  add("mean time loss [s]", [](const RunSummary& run) { return Cell(run.mean_time_loss, 1); });
  add("detours", [](const RunSummary& run) { return Cell(run.detours); });
  add("collisions", [](const RunSummary& run) { return Cell(run.collisions); });
  add("  agent striking, outside junctions",
      [](const RunSummary& run) { return Cell(run.agent_striking_outside_junctions); });
  add("  in junctions", [](const RunSummary& run) { return Cell(run.collisions_in_junctions); });
  add("near misses", [](const RunSummary& run) { return Cell(run.near_misses); });
  add("hard braking", [](const RunSummary& run) { return Cell(run.hard_braking_count); });
  add("CO2 [kg]", [](const RunSummary& run) { return Cell(run.co2_kg, 1); });
  add("CO2 [g/km]", [](const RunSummary& run) { return Cell(run.co2_g_per_km, 1); });
  return FormatTable(lines);
}

}  // namespace lanewise
