#include "scenarios/study/study_file.h"

#include <SQLiteCpp/SQLiteCpp.h>

#include "scenarios/study/run_copy.h"

namespace lanewise {

namespace fs = std::filesystem;

StudyFile::StudyFile(const fs::path& file, const StudyPlan& plan)
    : path_(file), lock_(file), file_(ResultsFile::Open(file, ResultsFile::Mode::kAppend)) {
  GuardResults(path_, [&] {
    SQLite::Database& database = file_.database();
    SQLite::Transaction transaction(database, SQLite::TransactionBehavior::IMMEDIATE);
    SQLite::Statement other(database, "SELECT name FROM study WHERE name <> ?");
    other.bind(1, plan.name());
    if (other.executeStep())
      throw ConfigError(
          fmt::format("study file {}: it holds the study '{}', not '{}'; choose another file with "
                      "--results, or give the study that name",
                      path_.string(), other.getColumn(0).getString(), plan.name()));
    if (database.execAndGet("SELECT (SELECT COUNT(*) FROM study) = 0 AND EXISTS (SELECT 1 FROM run)")
            .getInt() != 0)
      throw ConfigError(
          fmt::format("study file {}: it is a results file of single runs, of no study; choose "
                      "another file with --results",
                      path_.string()));
    SQLite::Statement insert(
        database,
        "INSERT INTO study (name, question, study_text) VALUES (?1, ?2, ?3) ON CONFLICT (name) "
        "DO UPDATE SET question = ?2, study_text = ?3");
    insert.bind(1, plan.name());
    insert.bind(2, plan.question());
    insert.bind(3, plan.text());
    insert.exec();
    transaction.commit();
  });
}

std::int64_t StudyFile::extra_seeds() const {
  std::int64_t extra = 0;
  GuardResults(path_,
               [&] { extra = file_.database().execAndGet("SELECT extra_seeds FROM study").getInt64(); });
  return extra;
}

void StudyFile::SetExtraSeeds(std::int64_t extra_seeds) {
  GuardResults(path_, [&] {
    SQLite::Statement update(file_.database(), "UPDATE study SET extra_seeds = ?");
    update.bind(1, extra_seeds);
    update.exec();
  });
}

std::int64_t StudyFile::AddRuns(const StudyPlan& plan, std::int64_t extra_seeds, const Shard& shard) {
  std::int64_t added = 0;
  GuardResults(path_, [&] {
    SQLite::Database& database = file_.database();
    SQLite::Transaction transaction(database, SQLite::TransactionBehavior::IMMEDIATE);
    // The run's number is its place in the plan; behind all others if a changed study file gives that to
    // another.
    SQLite::Statement insert(database,
                             "INSERT INTO study_run (run_id, run_key, settings_json, status) SELECT CASE "
                             "WHEN EXISTS (SELECT 1 FROM "
                             "study_run WHERE run_id = ?1) THEN (SELECT MAX(run_id) + 1 FROM study_run) ELSE "
                             "?1 END, ?2, ?3, 'pending' "
                             "WHERE NOT EXISTS (SELECT 1 FROM study_run WHERE run_key = ?2)");
    plan.ForEach(extra_seeds, [&](const PlannedRun& run) {
      if ((run.number - 1) % shard.count != shard.index - 1) return;
      insert.bind(1, run.number);
      insert.bind(2, run.key);
      insert.bind(3, ToJson(run.settings));
      added += insert.exec();
      insert.reset();
    });
    transaction.commit();
  });
  return added;
}

std::int64_t StudyFile::ReleaseStale() {
  std::int64_t released = 0;
  GuardResults(path_, [&] {
    released = file_.database().exec(
        "UPDATE study_run SET status = 'pending', claimed_by = NULL, attempts = attempts - 1 WHERE status = "
        "'claimed'");
  });
  return released;
}

std::int64_t StudyFile::RetryFailed() {
  std::int64_t released = 0;
  GuardResults(path_, [&] {
    released = file_.database().exec(
        "UPDATE study_run SET status = 'pending', attempts = 0, message = NULL, log = NULL WHERE status = "
        "'failed'");
  });
  return released;
}

std::optional<ClaimedRun> StudyFile::Claim() {
  std::optional<ClaimedRun> claimed;
  GuardResults(path_, [&] {
    SQLite::Statement claim(
        file_.database(),
        "UPDATE study_run SET status = 'claimed', claimed_by = ?, attempts = attempts + 1 WHERE run_id = "
        "(SELECT "
        "run_id FROM study_run WHERE status = 'pending' ORDER BY run_id LIMIT 1) RETURNING run_id, attempts, "
        "settings_json");
    claim.bind(1, ThisProcess());
    while (claim.executeStep())  // To its end: only then it is committed.
      claimed = ClaimedRun{claim.getColumn(0).getInt64(), claim.getColumn(1).getInt64(),
                           SettingsFromJson(claim.getColumn(2).getString())};
  });
  return claimed;
}

void StudyFile::Finish(std::int64_t run_id, const fs::path& worker_file, double wall_time) {
  GuardResults(path_, [&] {
    SQLite::Database& database = file_.database();
    const AttachedFile attached(worker_file, &database);
    SQLite::Transaction transaction(database, SQLite::TransactionBehavior::IMMEDIATE);
    const CopiedRun copied{
        database.execAndGet("SELECT run_id FROM source.run WHERE status = 'finished'").getInt64(), run_id};
    CopyRuns({&copied, 1}, &database);
    SQLite::Statement update(
        database,
        "UPDATE study_run SET status = 'finished', claimed_by = NULL, message = NULL, log = NULL, "
        "wall_time_s = ?2, bytes = ?3 WHERE run_id = ?1");
    update.bind(1, run_id);
    update.bind(2, wall_time);
    update.bind(3, static_cast<std::int64_t>(fs::file_size(worker_file)));
    update.exec();
    transaction.commit();
  });
}

void StudyFile::Fail(std::int64_t run_id, const std::string& message, const std::string& log) {
  GuardResults(path_, [&] {
    SQLite::Statement update(
        file_.database(),
        "UPDATE study_run SET status = 'failed', claimed_by = NULL, message = ?2, log = ?3 WHERE "
        "run_id = ?1");
    update.bind(1, run_id);
    update.bind(2, message);
    update.bind(3, log);
    update.exec();
  });
}

void StudyFile::Release(std::int64_t run_id, bool counts) {
  GuardResults(path_, [&] {
    SQLite::Statement update(
        file_.database(),
        "UPDATE study_run SET status = 'pending', claimed_by = NULL, attempts = attempts - ?2 "
        "WHERE run_id = ?1");
    update.bind(1, run_id);
    update.bind(2, counts ? 0 : 1);
    update.exec();
  });
}

StudyCounts StudyFile::Counts() const {
  StudyCounts counts;
  GuardResults(path_, [&] {
    SQLite::Statement query(file_.database(), "SELECT status, COUNT(*) FROM study_run GROUP BY status");
    while (query.executeStep()) {
      const std::string status = query.getColumn(0).getString();
      (status == "pending"    ? counts.pending
       : status == "claimed"  ? counts.claimed
       : status == "finished" ? counts.finished
                              : counts.failed) = query.getColumn(1).getInt64();
    }
  });
  return counts;
}

std::vector<FailedRun> StudyFile::Failed() const {
  std::vector<FailedRun> failed;
  GuardResults(path_, [&] {
    SQLite::Statement query(file_.database(),
                            "SELECT run_id, settings_json, COALESCE(message, '') FROM study_run WHERE status "
                            "= 'failed' ORDER BY run_id");
    while (query.executeStep())
      failed.push_back({query.getColumn(0).getInt64(), SettingsFromJson(query.getColumn(1).getString()),
                        query.getColumn(2).getString()});
  });
  return failed;
}

void ForEachFinished(const fs::path& file,
                     const std::function<void(const std::string& key, const RunSettings& settings,
                                              const RunCost& cost)>& visit) {
  if (!fs::exists(file) || fs::file_size(file) == 0) return;
  ResultsFile results = ResultsFile::Open(file, ResultsFile::Mode::kRead);
  GuardResults(file, [&] {
    SQLite::Statement query(results.database(),
                            "SELECT run_key, settings_json, wall_time_s, bytes FROM study_run WHERE status = "
                            "'finished'");
    while (query.executeStep())
      visit(query.getColumn(0).getString(), SettingsFromJson(query.getColumn(1).getString()),
            {query.getColumn(2).getDouble(), query.getColumn(3).getDouble()});
  });
}

}  // namespace lanewise
