#include "scenarios/verify.h"

#include <SQLiteCpp/SQLiteCpp.h>
#include <fmt/ranges.h>
#include <poll.h>
#include <signal.h>

#include <algorithm>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "agents/core/check.h"
#include "analysis/results_file.h"
#include "analysis/statistics.h"
#include "scenarios/input_file.h"
#include "scenarios/interrupt.h"
#include "scenarios/run_config.h"
#include "scenarios/scratch_folder.h"
#include "scenarios/state_trace.h"
#include "scenarios/study/run_copy.h"
#include "scenarios/study/worker.h"

namespace lanewise {
namespace {

namespace fs = std::filesystem;

/// A run as its file describes it: enough to repeat it.
struct RecordedRun {
  std::int64_t run_id{0};
  std::string name;  ///< For people.
  std::vector<std::string> arguments;
  nlohmann::json parameters, input_hashes;
  std::string config_text, state_hash;
  double begin{0.0}, step_length{0.1};  ///< [s]
};

std::vector<std::int64_t> FinishedRuns(ResultsFile* file) {
  std::vector<std::int64_t> ids;
  SQLite::Statement query(file->database(),
                          "SELECT run_id FROM run WHERE status = 'finished' ORDER BY run_id");
  while (query.executeStep()) ids.push_back(query.getColumn(0).getInt64());
  return ids;
}

RecordedRun Load(std::int64_t run_id, ResultsFile* file) {
  SQLite::Statement query(file->database(),
                          "SELECT 'policy=' || policy || ' scenario=' || scenario || ' seed=' || seed, "
                          "arguments_json, parameters_json, "
                          "input_hashes_json, COALESCE(config_text, ''), state_hash, begin_s, step_length_s "
                          "FROM run WHERE run_id = ?");
  query.bind(1, run_id);
  query.executeStep();
  RecordedRun run;
  run.run_id = run_id;
  run.name = query.getColumn(0).getString();
  run.arguments = nlohmann::json::parse(query.getColumn(1).getString()).get<std::vector<std::string>>();
  run.parameters = nlohmann::json::parse(query.getColumn(2).getString());
  run.input_hashes = nlohmann::json::parse(query.getColumn(3).getString());
  run.config_text = query.getColumn(4).getString();
  run.state_hash = query.getColumn(5).getString();
  run.begin = query.getColumn(6).getDouble();
  run.step_length = query.getColumn(7).getDouble();
  return run;
}

/// "line 3: '<a/>', now '<b/>'".
std::string FirstDifferentLine(const std::string& recorded, const std::string& now) {
  std::istringstream a(recorded), b(now);
  std::string line_a, line_b;
  for (int number = 1;; ++number) {
    const bool more_a = static_cast<bool>(std::getline(a, line_a)),
               more_b = static_cast<bool>(std::getline(b, line_b));
    if (!more_a) line_a.clear();
    if (!more_b) line_b.clear();
    if (line_a != line_b) return fmt::format("line {}: '{}', now '{}'", number, line_a, line_b);
    if (!more_a && !more_b) return "line ends";
  }
}

/// Why the run cannot be repeated here; empty if it can.
std::string Obstacle(const RecordedRun& run) {
  for (const auto& [file, hash] : run.input_hashes.items()) {
    const bool config = !run.config_text.empty() && file.ends_with(".sumocfg");
    if (!fs::exists(file))
      return fmt::format("its input file {} is missing{}", file,
                         config ? "; its text is kept in column config_text of table run" : "");
    const std::string now = HashFile(file);
    if (now != hash.get<std::string>())
      return fmt::format("its input file {} has changed: {} when it was recorded, now {}{}", file,
                         hash.get<std::string>(), now,
                         config ? "; " + FirstDifferentLine(run.config_text, ReadText(file)) : "");
  }
  std::vector<std::string> known;
  for (const ParamDescription& p : DescribeParams(RunParams{})) known.push_back(p.name);
  for (const auto& [name, value] : run.parameters.items()) {
    if (std::find(known.begin(), known.end(), name) == known.end())
      return fmt::format("this version has no parameter {}, which was {} there", name, value.dump());
  }
  return "";
}

/// Arguments of `lanewise run`; parameters go into a file.
std::vector<std::string> Arguments(const RecordedRun& run, const fs::path& parameter_file) {
  std::ofstream out(parameter_file);
  for (const auto& [name, value] : run.parameters.items()) out << name << " = " << value.dump() << "\n";
  std::vector<std::string> arguments{"--config", parameter_file.string()};
  arguments.insert(arguments.end(), run.arguments.begin(), run.arguments.end());
  return arguments;
}

/// Compares a recorded run (schema main) with its repetition (schema source).
class RunComparison {
 public:
  RunComparison(const RecordedRun& run, SQLite::Database* database)
      : run_(run),
        database_(*database),
        repeated_id_(database->execAndGet("SELECT run_id FROM source.run").getInt64()) {}

  /// What of Lanewise, SUMO and the compiler is not as it was; empty if nothing.
  std::string OtherVersions() const {
    std::vector<std::string> others;
    for (const char* column : {"lanewise_version", "git_commit", "sumo_version", "compiler"}) {
      const std::string recorded = Column("main", run_.run_id, column),
                        now = Column("source", repeated_id_, column);
      if (recorded != now) others.push_back(fmt::format("{} was {}, is {}", column, recorded, now));
    }
    return fmt::format("{}", fmt::join(others, "; "));
  }

  std::int64_t Steps() const { return Count("main", run_.run_id); }

  /// What differs, in words; empty if the repetition is the recorded run.
  std::string Difference() const {
    if (const auto step = FirstDifferentStep()) return DescribeStep(*step);
    if (const std::int64_t steps = Steps(); steps > 0) {
      const std::string last = fmt::format("{:016x}", Step("main", run_.run_id, steps - 1).rolling);
      if (last != run_.state_hash)
        return fmt::format("its own record contradicts itself: state hash {}, but {} after the last step",
                           run_.state_hash, last);
    }
    return DifferentRows();
  }

 private:
  std::string Column(const char* schema, std::int64_t run_id, const char* column) const {
    return database_
        .execAndGet(fmt::format("SELECT {} FROM {}.run WHERE run_id = {}", column, schema, run_id))
        .getString();
  }

  std::int64_t Count(const char* schema, std::int64_t run_id) const {
    return database_
        .execAndGet(fmt::format("SELECT COUNT(*) FROM {}.step_hash WHERE run_id = {}", schema, run_id))
        .getInt64();
  }

  StepHashRow Step(const char* schema, std::int64_t run_id, std::int64_t step) const {
    SQLite::Statement query(
        database_,
        fmt::format("SELECT rolling_hash, vehicle_sum, weighted_sum FROM {}.step_hash WHERE run_id "
                    "= {} AND step = {}",
                    schema, run_id, step));
    StepHashRow row;
    row.step = step;
    if (!query.executeStep()) return row;
    row.rolling = static_cast<std::uint64_t>(query.getColumn(0).getInt64());
    row.vehicle_sum = static_cast<std::uint64_t>(query.getColumn(1).getInt64());
    row.weighted_sum = static_cast<std::uint64_t>(query.getColumn(2).getInt64());
    return row;
  }

  std::optional<std::int64_t> FirstDifferentStep() const {
    SQLite::Statement query(
        database_,
        fmt::format("SELECT a.step FROM main.step_hash AS a JOIN source.step_hash AS b ON b.run_id = "
                    "{} AND b.step = a.step WHERE a.run_id = {} AND a.rolling_hash <> b.rolling_hash "
                    "ORDER BY a.step LIMIT 1",
                    repeated_id_, run_.run_id));
    if (query.executeStep()) return query.getColumn(0).getInt64();
    const std::int64_t recorded = Steps(), repeated = Count("source", repeated_id_);
    if (recorded != repeated) return std::min(recorded, repeated);
    return std::nullopt;
  }

  std::string DescribeStep(std::int64_t step) const {
    // State k is that at the end of SUMO's step k.
    const double time = run_.begin + static_cast<double>(step + 1) * run_.step_length;
    const std::string where = fmt::format("differs from step {} ({:.2f} s) on", step, time);
    const std::int64_t recorded = Steps(), repeated = Count("source", repeated_id_);
    if (step >= std::min(recorded, repeated))
      return fmt::format("{}: it had {} steps, now {}", where, recorded, repeated);
    const auto numbers = static_cast<std::int32_t>(
        database_
            .execAndGet(
                fmt::format("SELECT 1 + MAX((SELECT COALESCE(MAX(vehicle_number), 0) FROM main.vehicle WHERE "
                            "run_id = {}), (SELECT COALESCE(MAX(vehicle_number), 0) FROM source.vehicle))",
                            run_.run_id))
            .getInt());
    const std::int32_t number =
        FindDifferingVehicle(Step("main", run_.run_id, step), Step("source", repeated_id_, step), numbers);
    if (number != kNone) return fmt::format("{}, first in vehicle {}", where, VehicleName(number));
    const std::string names = SampledVehicles(time);
    return fmt::format("{}, in several vehicles at once{}", where, names.empty() ? "" : ": " + names);
  }

  std::string VehicleName(std::int32_t number) const {
    SQLite::Statement query(
        database_,
        fmt::format("SELECT vehicle_id FROM main.vehicle WHERE run_id = {0} AND vehicle_number = {1} "
                    "UNION ALL SELECT vehicle_id FROM source.vehicle WHERE vehicle_number = {1}",
                    run_.run_id, number));
    return query.executeStep() ? fmt::format("'{}'", query.getColumn(0).getString())
                               : fmt::format("number {}", number);
  }

  /// Vehicles whose samples differ at the first sampled moment from a time on at which any do.
  std::string SampledVehicles(double time) const {
    const auto rows = [](const char* schema, std::int64_t run_id) {
      return fmt::format(
          "SELECT time_s, vehicle_number, x_m, y_m, heading_rad, speed_mps FROM {}.trajectory WHERE run_id "
          "= {} AND time_s > ?1 - 0.001",
          schema, run_id);
    };
    const std::string a = rows("main", run_.run_id), b = rows("source", repeated_id_);
    SQLite::Statement query(
        database_,
        fmt::format("WITH d AS (SELECT * FROM ({0} EXCEPT {1}) UNION SELECT * FROM ({1} EXCEPT {0})) SELECT "
                    "DISTINCT vehicle_number, time_s FROM d WHERE time_s = (SELECT MIN(time_s) FROM d) ORDER "
                    "BY vehicle_number",
                    a, b));
    query.bind(1, time);
    std::vector<std::string> names;
    double at = 0.0;
    for (; query.executeStep(); at = query.getColumn(1).getDouble())
      names.push_back(VehicleName(query.getColumn(0).getInt()));
    if (names.empty()) return "";
    const std::size_t all = names.size();
    if (all > 5) names.resize(5);
    return fmt::format("{}{} by the samples at {:.2f} s", fmt::join(names, ", "),
                       all > 5 ? fmt::format(" and {} more", all - 5) : "", at);
  }

  /// The same motion, measured differently.
  std::string DifferentRows() const {
    for (const std::string& table : TablesOfRuns(&database_)) {
      if (table == "run") continue;
      std::vector<std::string> columns;
      SQLite::Statement query(database_, "SELECT name FROM pragma_table_info(?)");
      query.bind(1, table);
      while (query.executeStep()) {
        const std::string name = query.getColumn(0).getString();
        if (name != "run_id" && name != "collision_id" && name != "wall_time_s") columns.push_back(name);
      }
      const auto rows = [&](const char* schema, std::int64_t run_id) {
        return fmt::format("SELECT {} FROM {}.{} WHERE run_id = {}", fmt::join(columns, ", "), schema, table,
                           run_id);
      };
      const std::string a = rows("main", run_.run_id), b = rows("source", repeated_id_);
      const std::int64_t different =
          database_
              .execAndGet(fmt::format(
                  "SELECT (SELECT COUNT(*) FROM ({0} EXCEPT {1})) + (SELECT COUNT(*) FROM ({1} EXCEPT {0}))",
                  a, b))
              .getInt64();
      if (different > 0)
        return fmt::format("moves the same in every step, but {} rows of table {} are not those recorded",
                           different, table);
    }
    return "";
  }

  const RecordedRun& run_;
  SQLite::Database& database_;
  std::int64_t repeated_id_;
};

struct VerifyOptions {
  std::string file;
  std::vector<std::int64_t> runs;
  std::size_t sample{3};
  std::uint64_t seed{1};
  int threads{1};
};

/// The runs to repeat: those named, or some drawn without replacement.
std::vector<std::int64_t> Choose(std::vector<std::int64_t> finished, const VerifyOptions& o) {
  for (const std::int64_t run : o.runs) {
    if (std::find(finished.begin(), finished.end(), run) == finished.end())
      throw ConfigError(fmt::format("--run: {} holds no finished run {}", o.file, run));
  }
  if (!o.runs.empty()) return o.runs;
  const std::size_t count = o.sample == 0 ? finished.size() : std::min(o.sample, finished.size());
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint64_t left = finished.size() - i;
    std::swap(finished[i], finished[i + CounterRandom(o.seed, 0, i) % left]);
  }
  finished.resize(count);
  std::sort(finished.begin(), finished.end());
  return finished;
}

/// Waits for a worker, or for a signal. @return its exit code.
int Await(Worker* worker) {
  while (!Interrupted()) {
    pollfd fd{worker->pipe(), POLLIN, 0};
    ::poll(&fd, 1, 250);
    if (!worker->Read()) return worker->Wait();
  }
  worker->Kill(SIGKILL);
  return worker->Wait();
}

enum class Verdict : std::uint8_t { kSame, kDifferent, kNotRepeated };

Verdict Verify(const RecordedRun& run, const VerifyOptions& o, ResultsFile* file) {
  const auto say = [&](const std::string& what) {
    fmt::print("run {} ({}): {}\n", run.run_id, run.name, what);
    std::fflush(stdout);
  };
  if (const std::string obstacle = Obstacle(run); !obstacle.empty()) {
    say("not repeated: " + obstacle);
    return Verdict::kNotRepeated;
  }
  const ScratchFolder folder;
  const WorkerFiles files(folder.path(), fmt::format("run-{}", run.run_id));
  files.Prepare();
  Worker worker(WorkerArguments(files, o.threads, Arguments(run, folder.path() / "parameters.toml")),
                files.log);
  const int code = Await(&worker);
  if (Interrupted()) return Verdict::kNotRepeated;
  if (code != 0) {
    say(fmt::format("not repeated: {}",
                    EndOfWorker(code, files.log, fmt::format("at {:.1f} s", worker.time()))));
    return Verdict::kNotRepeated;
  }
  const AttachedFile attached(files.results, &file->database());
  const RunComparison comparison(run, &file->database());
  const std::string difference = comparison.Difference(), versions = comparison.OtherVersions();
  say((difference.empty()
           ? fmt::format("identical in {} steps, state hash {}", comparison.Steps(), run.state_hash)
           : difference) +
      (versions.empty() ? "" : "; " + versions));
  return difference.empty() ? Verdict::kSame : Verdict::kDifferent;
}

int RunVerify(const VerifyOptions& o) {
  ResultsFile file = ResultsFile::Open(o.file, ResultsFile::Mode::kRead);
  int code = 1;
  GuardResults(o.file, [&] {
    const std::vector<std::int64_t> finished = FinishedRuns(&file);
    if (finished.empty()) throw ConfigError(fmt::format("results file {}: it holds no finished run", o.file));
    const InterruptGuard guard;
    int same = 0, different = 0, all = 0;
    for (const std::int64_t run_id : Choose(finished, o)) {
      const Verdict verdict = Verify(Load(run_id, &file), o, &file);
      if (Interrupted()) break;
      ++all;
      same += verdict == Verdict::kSame;
      different += verdict == Verdict::kDifferent;
    }
    fmt::print("{}: {} of {} runs repeated identically, {} differ, {} could not be repeated\n", o.file, same,
               all, different, all - same - different);
    code = Interrupted() ? 130 : same == all ? 0 : 1;
  });
  return code;
}

}  // namespace

void AddVerifyCommand(CLI::App* app, std::function<int()>* chosen) {
  const auto o = std::make_shared<VerifyOptions>();
  CLI::App* verify =
      app->add_subcommand("verify", "Recorded runs again, from their provenance: is every step the same?");
  verify->add_option("RESULTS", o->file, "results file (SQLite); it stays as it is")->required();
  verify->add_option("--sample", o->sample, "how many runs, drawn at random; 0: all")->capture_default_str();
  verify->add_option("--seed", o->seed, "of the draw")->capture_default_str();
  verify->add_option("--run", o->runs, "these runs instead; comma-separated or repeated")->delimiter(',');
  verify->add_option("--threads", o->threads, "of each run; results do not depend on it")
      ->capture_default_str()
      ->check(CLI::Range(1, 1024));
  verify->footer(
      "Example: lanewise verify my.sqlite --sample 3\n"
      "Input files must be those recorded, by their hashes. On a difference the first step and vehicle that "
      "differ "
      "are named,\n"
      "and what of the versions is not as it was. Exit code 1: a run differs or could not be repeated.");
  verify->callback([o, chosen] { *chosen = [o] { return RunVerify(*o); }; });
}

}  // namespace lanewise
