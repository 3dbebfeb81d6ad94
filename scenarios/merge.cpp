#include "scenarios/merge.h"

#include <SQLiteCpp/SQLiteCpp.h>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <vector>

#include "agents/core/check.h"
#include "analysis/results_file.h"
#include "scenarios/study/run_copy.h"
#include "scenarios/study/study_lock.h"

namespace lanewise {
namespace {

namespace fs = std::filesystem;

/// A run of an input, or of the output as it is.
struct MergedRun {
  std::int64_t source_run_id{0};
  std::string key;       ///< Equal: the same run is meant.
  std::string name;      ///< For people.
  std::string status;    ///< As in table study_run.
  std::string identity;  ///< Of what determines its results; empty unless it has finished.
  std::string state_hash;
};

struct Source {
  fs::path file;
  std::string study, study_text;  ///< Empty: single runs.
  std::vector<MergedRun> runs;
  std::int64_t left_out{0};  ///< Single runs that have not finished.
};

/// Where a run of the output comes from.
struct Place {
  const Source* source{nullptr};
  const MergedRun* run{nullptr};
  std::int64_t run_id{0};  ///< In the output.
};

/// Wherever a run's inputs lie, their content counts.
std::string Identity(const std::string& arguments_json, const std::string& input_hashes_json,
                     const std::string& parameters_json, const std::string& versions) {
  static const std::set<std::string> kFileOptions = {"--configuration-file", "--net-file", "--route-files",
                                                     "--additional-files"};
  std::string text = parameters_json + versions;
  const nlohmann::json arguments = nlohmann::json::parse(arguments_json);
  for (std::size_t i = 0; i < arguments.size(); ++i) {
    if (kFileOptions.count(arguments[i]) != 0) {
      ++i;
    } else {
      text += arguments[i].get<std::string>() + "\n";
    }
  }
  std::multiset<std::string> hashes;
  const nlohmann::json inputs = nlohmann::json::parse(input_hashes_json);
  for (const auto& [file, hash] : inputs.items()) hashes.insert(hash);
  for (const std::string& hash : hashes) text += hash + "\n";
  return fmt::format("{:016x}", XXH3_64bits(text.data(), text.size()));
}

Source Load(const fs::path& path) {
  Source source{path, "", "", {}, 0};
  ResultsFile file = ResultsFile::Open(path, ResultsFile::Mode::kRead);
  GuardResults(path, [&] {
    SQLite::Database& database = file.database();
    SQLite::Statement study(database, "SELECT name, study_text FROM study");
    if (study.executeStep()) {
      source.study = study.getColumn(0).getString();
      source.study_text = study.getColumn(1).getString();
    }
    const std::string columns =
        "run.arguments_json, run.input_hashes_json, run.parameters_json, run.lanewise_version || ' ' || "
        "run.git_commit || ' ' || run.sumo_version || ' ' || run.compiler, run.state_hash, ";
    SQLite::Statement runs(
        database,
        source.study.empty()
            ? "SELECT " + columns +
                  "run.run_id, 'finished', '', 'policy=' || policy || ' scenario=' || scenario || ' "
                  "seed=' || seed FROM run WHERE status = 'finished' ORDER BY run_id"
            : "SELECT " + columns +
                  "r.run_id, r.status, r.run_key, r.settings_json FROM study_run AS r LEFT JOIN run ON "
                  "run.run_id = r.run_id ORDER BY r.run_id");
    while (runs.executeStep()) {
      MergedRun& run = source.runs.emplace_back();
      run.source_run_id = runs.getColumn(5).getInt64();
      run.status = runs.getColumn(6).getString();
      run.key = runs.getColumn(7).getString();
      run.name = runs.getColumn(8).getString();
      if (run.status == "claimed") run.status = "pending";
      if (run.status == "finished") {
        run.identity = Identity(runs.getColumn(0), runs.getColumn(1), runs.getColumn(2), runs.getColumn(3));
        run.state_hash = runs.getColumn(4).getString();
      }
      if (source.study.empty()) run.key = run.identity;
    }
    if (source.study.empty())
      source.left_out = database.execAndGet("SELECT COUNT(*) FROM run WHERE status <> 'finished'").getInt64();
  });
  return source;
}

/// What two records of the same run differ in.
std::string Disagreement(const Place& a, const Source& source, const MergedRun& b) {
  ResultsFile file = ResultsFile::Open(source.file, ResultsFile::Mode::kRead);
  SQLite::Database& database = file.database();
  const AttachedFile other(a.source->file, &database);
  for (const char* column : {"state_hash", "lanewise_version", "git_commit", "sumo_version", "compiler",
                             "parameters_json", "input_hashes_json", "arguments_json"}) {
    const auto value = [&](const char* schema, std::int64_t run_id) {
      return database
          .execAndGet(fmt::format("SELECT {} FROM {}.run WHERE run_id = {}", column, schema, run_id))
          .getString();
    };
    const std::string of_a = value("source", a.run->source_run_id), of_b = value("main", b.source_run_id);
    if (of_a != of_b)
      return of_a.size() + of_b.size() > 200 ? fmt::format("their {} differ", column)
                                             : fmt::format("{} is {} and {}", column, of_a, of_b);
  }
  return "their provenance differs";
}

/// What the output will hold. Nothing is written before all of it is known to fit together.
class Plan {
 public:
  explicit Plan(const std::vector<Source>& sources) {
    for (const Source& source : sources) {
      CheckStudy(sources.front(), source);
      for (const MergedRun& run : source.runs) Add(source, run);
    }
  }

  const std::map<std::string, Place>& places() const { return places_; }
  std::int64_t repeated() const { return repeated_; }

 private:
  static void CheckStudy(const Source& first, const Source& source) {
    const auto held = [](const Source& s) {
      return s.study.empty() ? std::string("single runs, no study") : fmt::format("the study '{}'", s.study);
    };
    if (first.study != source.study)
      throw ConfigError(
          fmt::format("merge: {} holds {}, {} {}; only files of one study, or of single runs, "
                      "are merged (compare takes several files)",
                      first.file.string(), held(first), source.file.string(), held(source)));
  }

  void Add(const Source& source, const MergedRun& run) {
    const auto [found, is_new] = places_.try_emplace(run.key, Place{&source, &run, 0});
    Place& place = found->second;
    if (is_new) {
      place.run_id = taken_.count(run.source_run_id) == 0 ? run.source_run_id : *taken_.rbegin() + 1;
      taken_.insert(place.run_id);
      return;
    }
    const auto rank = [](const MergedRun& r) {
      return r.status == "finished" ? 2 : r.status == "failed" ? 1 : 0;
    };
    if (run.status == "finished" && place.run->status == "finished") {
      ++repeated_;
      if (run.identity != place.run->identity || run.state_hash != place.run->state_hash)
        throw ConfigError(fmt::format(
            "merge: run {} of {} and run {} of {} are the same run ({}) with different results: {}; nothing "
            "was written",
            place.run->source_run_id, place.source->file.string(), run.source_run_id, source.file.string(),
            run.name, Disagreement(place, source, run)));
    }
    if (rank(run) > rank(*place.run)) {
      place.source = &source;
      place.run = &run;
    }
  }

  std::map<std::string, Place> places_;  // By key.
  std::set<std::int64_t> taken_;         // Numbers in the output.
  std::int64_t repeated_{0};
};

void CopyStudyRuns(std::span<const CopiedRun> runs, SQLite::Database* database) {
  SQLite::Statement copy(
      *database,
      "INSERT OR REPLACE INTO main.study_run (run_id, run_key, settings_json, status, attempts, message, "
      "log, wall_time_s, bytes) SELECT ?2, run_key, settings_json, CASE status WHEN 'claimed' THEN 'pending' "
      "ELSE status END, attempts, message, log, wall_time_s, bytes FROM source.study_run WHERE run_id = ?1");
  for (const CopiedRun& run : runs) {
    copy.bind(1, run.source_run_id);
    copy.bind(2, run.run_id);
    copy.exec();
    copy.reset();
  }
}

/// A run that was merged before keeps the origin it has.
void NoteOrigins(const fs::path& file, std::span<const CopiedRun> runs, SQLite::Database* database) {
  SQLite::Statement note(*database,
                         "INSERT INTO main.merged_run SELECT ?1, COALESCE(m.source_file, ?2), "
                         "COALESCE(m.source_run_id, ?3) FROM (SELECT 1) LEFT JOIN source.merged_run AS m "
                         "ON m.run_id = ?3");
  for (const CopiedRun& run : runs) {
    note.bind(1, run.run_id);
    note.bind(2, fs::absolute(file).lexically_normal().string());
    note.bind(3, run.source_run_id);
    note.exec();
    note.reset();
  }
}

/// Takes over what a source contributes.
void Copy(const Source& source, const Plan& plan, SQLite::Database* database) {
  std::vector<CopiedRun> all, finished;
  for (const auto& [key, place] : plan.places()) {
    if (place.source != &source) continue;
    all.push_back({place.run->source_run_id, place.run_id});
    if (place.run->status == "finished") finished.push_back(all.back());
  }
  const auto by_number = [](const CopiedRun& a, const CopiedRun& b) { return a.run_id < b.run_id; };
  std::sort(all.begin(), all.end(), by_number);
  std::sort(finished.begin(), finished.end(), by_number);
  const AttachedFile attached(source.file, database);
  SQLite::Transaction transaction(*database, SQLite::TransactionBehavior::IMMEDIATE);
  if (!source.study.empty()) {
    database->exec(
        "INSERT INTO main.study SELECT * FROM source.study WHERE true ON CONFLICT (name) DO UPDATE SET "
        "extra_seeds = MAX(extra_seeds, excluded.extra_seeds)");
    CopyStudyRuns(all, database);
  }
  CopyRuns(finished, database);
  NoteOrigins(source.file, finished, database);
  transaction.commit();
}

struct MergeOptions {
  std::vector<std::string> files;
  std::string output;
};

void CheckFiles(const MergeOptions& o) {
  std::error_code error;
  for (const std::string& file : o.files) {
    if (fs::equivalent(file, o.output, error))
      throw ConfigError(fmt::format(
          "merge: {} is also the output; leave it out of the inputs: what it holds is kept", file));
  }
}

std::int64_t Count(ResultsFile* file, const char* condition) {
  return file->database()
      .execAndGet(fmt::format("SELECT COUNT(*) FROM study_run WHERE {}", condition))
      .getInt64();
}

void PrintEnd(const std::vector<Source>& sources, const Plan& plan, std::size_t inputs, ResultsFile* file) {
  const std::int64_t runs = file->database().execAndGet("SELECT COUNT(*) FROM run").getInt64();
  const std::int64_t added =
      std::count_if(plan.places().begin(), plan.places().end(), [&](const auto& place) {
        return place.second.source >= &sources[sources.size() - inputs] &&
               !place.second.run->identity.empty();
      });
  fmt::print("{}: {} runs, {} new from {} files", file->path().string(), runs, added, inputs);
  if (plan.repeated() > 0) fmt::print(", {} were there already with the same result", plan.repeated());
  if (!sources.front().study.empty())
    fmt::print("; {} failed, {} to do", Count(file, "status = 'failed'"), Count(file, "status = 'pending'"));
  fmt::print("\n");
  for (const Source& source : sources) {
    if (source.left_out > 0)
      fmt::print("{}: {} runs that have not finished are left out\n", source.file.string(), source.left_out);
    if (source.study_text != sources.front().study_text)
      fmt::print("note: the study file of {} differs from that of {}\n", source.file.string(),
                 sources.front().file.string());
  }
}

int Merge(const MergeOptions& o) {
  CheckFiles(o);
  const fs::path output = o.output;
  const StudyLock lock(output);
  const bool exists = fs::exists(output) && fs::file_size(output) > 0;
  if (exists) ResultsFile::CheckAppend(output);
  std::vector<Source> sources;
  if (exists) sources.push_back(Load(output));
  for (const std::string& file : o.files) sources.push_back(Load(file));
  const Plan plan(sources);

  // A new file appears under its name once it is complete.
  const fs::path written = exists ? output : fs::path(output.string() + ".partial");
  if (!exists) fs::remove(written);
  try {
    ResultsFile file = ResultsFile::Open(written, ResultsFile::Mode::kAppend);
    GuardResults(written, [&] {
      for (std::size_t i = exists ? 1 : 0; i < sources.size(); ++i) Copy(sources[i], plan, &file.database());
    });
  } catch (const ConfigError&) {
    std::error_code ignored;
    if (!exists) fs::remove(written, ignored);
    throw;
  }
  if (!exists) fs::rename(written, output);
  ResultsFile file = ResultsFile::Open(output, ResultsFile::Mode::kRead);
  PrintEnd(sources, plan, o.files.size(), &file);
  return 0;
}

}  // namespace

void AddMergeCommand(CLI::App* app, std::function<int()>* chosen) {
  const auto o = std::make_shared<MergeOptions>();
  CLI::App* merge = app->add_subcommand("merge", "Results files, the shards of a study above all, as one");
  merge->add_option("RESULTS", o->files, "results files (SQLite); they stay as they are")->required();
  merge->add_option("-o,--output", o->output, "file that gains their runs; created if it does not exist")
      ->required();
  merge->footer(
      "Example: lanewise merge my-*-of-4.sqlite -o my.sqlite && lanewise compare my.sqlite\n"
      "Each run is taken once, with its provenance; table merged_run says where it came from. The same "
      "command "
      "again changes\n"
      "nothing. If two files hold the same run with different results, nothing is written. A new output "
      "appears "
      "under its\n"
      "name once it is complete. What the shards of a study have not finished, `lanewise study --results "
      "OUTPUT` can.");
  merge->callback([o, chosen] { *chosen = [o] { return Merge(*o); }; });
}

}  // namespace lanewise
