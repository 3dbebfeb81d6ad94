#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

namespace SQLite {
class Database;
}

namespace lanewise {

/// A second results file, attached to a connection under the name `source` while this lives.
class AttachedFile {
 public:
  AttachedFile(const std::filesystem::path& file, SQLite::Database* database);
  ~AttachedFile();
  AttachedFile(const AttachedFile&) = delete;
  AttachedFile& operator=(const AttachedFile&) = delete;

 private:
  SQLite::Database* database_;
};

/// Tables of a results file that hold rows of runs, `run` first; not those that say where runs come from.
std::vector<std::string> TablesOfRuns(SQLite::Database* database);

/// A run of the attached file, and the number it gets.
struct CopiedRun {
  std::int64_t source_run_id{0};
  std::int64_t run_id{0};
};

/// Copies every row of runs of the attached file, whatever tables there are, under other numbers, and builds
/// their trajectories' indexes. Each table is read once, however many runs there are. Ids that count over all
/// runs of a file (collision_id) follow from the run's number, so that they do not depend on the order in
/// which runs are copied. Call it within a transaction.
/// @throws SQLite::Exception.
void CopyRuns(std::span<const CopiedRun> runs, SQLite::Database* database);

}  // namespace lanewise
