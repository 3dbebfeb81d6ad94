#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

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

/// Copies every row of a run of the attached file, whatever tables there are, under another number. Ids that
/// count over all runs of a file (collision_id) follow from the run's number, so that they do not depend on
/// the order in which runs are copied. Call it within a transaction.
/// @throws SQLite::Exception.
void CopyRun(std::int64_t source_run_id, std::int64_t run_id, SQLite::Database* database);

}  // namespace lanewise
