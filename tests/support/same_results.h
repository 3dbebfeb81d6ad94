#pragma once

#include <SQLiteCpp/SQLiteCpp.h>
#include <fmt/ranges.h>

#include <filesystem>
#include <set>
#include <string>
#include <vector>

namespace lanewise {

/// Compares all rows of two results files, but for what a clock, a place or a process wrote. @return the
/// first difference in words; empty if there is none.
/// @param ignored tables.
inline std::string DifferenceOfResults(const std::filesystem::path& a, const std::filesystem::path& b,
                                       const std::set<std::string>& ignored = {}) {
  static const std::set<std::string> kClocks = {"started_at", "finished_at", "wall_time_s", "sumo_time_s",
                                                "claimed_by", "attempts",    "bytes",       "sumo_options"};
  SQLite::Database database(a.string(), SQLite::OPEN_READWRITE, 5000);
  database.exec(fmt::format("ATTACH '{}' AS b", b.string()));
  std::vector<std::string> tables;
  SQLite::Statement names(database, "SELECT name FROM main.sqlite_master WHERE type = 'table'");
  while (names.executeStep()) tables.push_back(names.getColumn(0).getString());
  for (const std::string& table : tables) {
    if (ignored.count(table) != 0) continue;
    std::vector<std::string> columns;
    SQLite::Statement query(database, fmt::format("SELECT name FROM pragma_table_info('{}')", table));
    while (query.executeStep()) {
      if (kClocks.count(query.getColumn(0).getString()) == 0)
        columns.push_back(query.getColumn(0).getString());
    }
    const std::string list = fmt::format("{}", fmt::join(columns, ", "));
    for (const auto& [x, y] : {std::pair("main", "b"), std::pair("b", "main")}) {
      SQLite::Statement difference(
          database,
          fmt::format("SELECT COUNT(*) FROM (SELECT {0} FROM {1}.{3} EXCEPT SELECT {0} FROM {2}.{3})", list,
                      x, y, table));
      difference.executeStep();
      if (difference.getColumn(0).getInt() > 0)
        return fmt::format("table {}: {} rows of {} are not in {}", table, difference.getColumn(0).getInt(),
                           x, y);
    }
    const auto count = [&](const char* schema) {
      return database.execAndGet(fmt::format("SELECT COUNT(*) FROM {}.{}", schema, table)).getInt64();
    };
    if (count("main") != count("b"))
      return fmt::format("table {}: {} and {} rows", table, count("main"), count("b"));
  }
  return "";
}

}  // namespace lanewise
