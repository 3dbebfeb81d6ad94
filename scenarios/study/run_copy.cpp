#include "scenarios/study/run_copy.h"

#include <SQLiteCpp/SQLiteCpp.h>
#include <fmt/ranges.h>

#include "analysis/results_file.h"

namespace lanewise {
namespace {

constexpr std::int64_t kIdsPerRun = 10'000'000;  // More collisions than a run can have.

void CopyTable(const std::string& table, SQLite::Database* database) {
  std::vector<std::string> names, values;
  SQLite::Statement columns(*database, "SELECT name FROM pragma_table_info(?)");
  columns.bind(1, table);
  while (columns.executeStep()) {
    names.push_back(columns.getColumn(0).getString());
    values.push_back("s." + names.back());
    if (names.back() == "run_id") values.back() = "c.run_id";
    if (names.back() == "collision_id")
      values.back() = fmt::format(
          "c.run_id * {} + ROW_NUMBER() OVER (PARTITION BY s.run_id ORDER BY s.collision_id)", kIdsPerRun);
  }
  // CROSS JOIN: SQLite then reads the source in its own order.
  database->exec(
      fmt::format("INSERT INTO main.{0} ({1}) SELECT {2} FROM source.{0} AS s CROSS JOIN temp.copied_run AS "
                  "c ON c.source_run_id = s.run_id",
                  table, fmt::join(names, ", "), fmt::join(values, ", ")));
}

}  // namespace

std::vector<std::string> TablesOfRuns(SQLite::Database* database) {
  std::vector<std::string> tables{"run"};  // First: the others refer to it.
  SQLite::Statement query(
      *database,
      "SELECT t.name FROM main.sqlite_master AS t WHERE t.type = 'table' AND EXISTS (SELECT 1 FROM "
      "pragma_table_info(t.name) WHERE name = 'run_id') AND t.name NOT IN ('run', 'study_run', "
      "'merged_run') ORDER BY t.name");
  while (query.executeStep()) tables.push_back(query.getColumn(0).getString());
  return tables;
}

AttachedFile::AttachedFile(const std::filesystem::path& file, SQLite::Database* database)
    : database_(database) {
  SQLite::Statement attach(*database_, "ATTACH DATABASE ? AS source");
  attach.bind(1, file.string());
  attach.exec();
}

AttachedFile::~AttachedFile() {
  database_->tryExec("DETACH DATABASE source");
}

void CopyRuns(std::span<const CopiedRun> runs, SQLite::Database* database) {
  database->exec(
      "CREATE TEMP TABLE IF NOT EXISTS copied_run (source_run_id INTEGER PRIMARY KEY, run_id INTEGER NOT "
      "NULL);"
      "DELETE FROM temp.copied_run");
  SQLite::Statement insert(*database, "INSERT INTO temp.copied_run VALUES (?, ?)");
  for (const CopiedRun& run : runs) {
    insert.bind(1, run.source_run_id);
    insert.bind(2, run.run_id);
    insert.exec();
    insert.reset();
  }
  for (const std::string& table : TablesOfRuns(database)) CopyTable(table, database);
  for (const CopiedRun& run : runs) {
    SQLite::Statement sampled(*database, "SELECT trajectory_rows FROM main.run WHERE run_id = ?");
    sampled.bind(1, run.run_id);
    if (sampled.executeStep() && sampled.getColumn(0).getInt64() > 0)
      IndexTrajectoryOfRun(run.run_id, database);
  }
}

}  // namespace lanewise
