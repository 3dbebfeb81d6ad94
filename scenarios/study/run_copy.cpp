#include "scenarios/study/run_copy.h"

#include <SQLiteCpp/SQLiteCpp.h>
#include <fmt/ranges.h>

#include <string>
#include <vector>

namespace lanewise {
namespace {

constexpr std::int64_t kIdsPerRun = 10'000'000;  // More collisions than a run can have.

/// Tables that hold rows of runs, but for those that say where runs come from.
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

}  // namespace

AttachedFile::AttachedFile(const std::filesystem::path& file, SQLite::Database* database)
    : database_(database) {
  SQLite::Statement attach(*database_, "ATTACH DATABASE ? AS source");
  attach.bind(1, file.string());
  attach.exec();
}

AttachedFile::~AttachedFile() {
  database_->tryExec("DETACH DATABASE source");
}

void CopyRun(std::int64_t source_run_id, std::int64_t run_id, SQLite::Database* database) {
  for (const std::string& table : TablesOfRuns(database)) {
    std::vector<std::string> names, values;
    SQLite::Statement columns(*database, "SELECT name FROM pragma_table_info(?)");
    columns.bind(1, table);
    while (columns.executeStep()) {
      names.push_back(columns.getColumn(0).getString());
      values.push_back(names.back());
      if (names.back() == "run_id") values.back() = "?1";
      if (names.back() == "collision_id")
        values.back() = fmt::format("?1 * {} + ROW_NUMBER() OVER (ORDER BY collision_id)", kIdsPerRun);
    }
    SQLite::Statement insert(
        *database, fmt::format("INSERT INTO main.{0} ({1}) SELECT {2} FROM source.{0} WHERE run_id = ?2",
                               table, fmt::join(names, ", "), fmt::join(values, ", ")));
    insert.bind(1, run_id);
    insert.bind(2, source_run_id);
    insert.exec();
  }
}

}  // namespace lanewise
