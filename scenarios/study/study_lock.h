#pragma once

#include <filesystem>
#include <string>

namespace lanewise {

/// "host:process" of this one.
std::string ThisProcess();

/// The right to change a study's file, held by one process at a time: a lock beside the file, which the
/// system drops when the process ends, however that happens.
class StudyLock {
 public:
  /// @throws ConfigError if another process holds it, or the folder cannot be written.
  explicit StudyLock(const std::filesystem::path& study_file);
  ~StudyLock();
  StudyLock(const StudyLock&) = delete;
  StudyLock& operator=(const StudyLock&) = delete;

 private:
  std::filesystem::path file_;
  int fd_{-1};
};

}  // namespace lanewise
