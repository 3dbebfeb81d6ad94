#include "scenarios/study/study_lock.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <fstream>

#include "agents/core/check.h"

namespace lanewise {
namespace {

namespace fs = std::filesystem;

bool IsSameFile(int fd, const fs::path& file) {
  struct stat open {
  }, named{};
  return ::fstat(fd, &open) == 0 && ::stat(file.c_str(), &named) == 0 && open.st_ino == named.st_ino;
}

}  // namespace

std::string ThisProcess() {
  char host[256] = "";
  ::gethostname(host, sizeof host - 1);
  return fmt::format("{}:{}", host, ::getpid());
}

StudyLock::StudyLock(const fs::path& study_file) : file_(study_file.string() + ".lock") {
  while (true) {
    fd_ = ::open(file_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666);
    if (fd_ < 0)
      throw ConfigError(
          fmt::format("study file {}: its lock {} cannot be made; its folder must exist and be writable",
                      study_file.string(), file_.string()));
    if (::flock(fd_, LOCK_EX | LOCK_NB) != 0) {
      std::string holder;
      std::getline(std::ifstream(file_), holder);
      ::close(fd_);
      throw ConfigError(
          fmt::format("study file {}: another runner ({}) works on it; let it end, or choose another "
                      "file",
                      study_file.string(), holder));
    }
    if (IsSameFile(fd_, file_)) break;
    ::close(fd_);  // A runner that ended just now has removed it.
  }
  const std::string self = ThisProcess() + "\n";
  if (::ftruncate(fd_, 0) != 0 || ::write(fd_, self.data(), self.size()) < 0) {
    // Only a message to others; the lock holds all the same.
  }
}

StudyLock::~StudyLock() {
  std::error_code ignored;
  fs::remove(file_, ignored);
  ::close(fd_);
}

}  // namespace lanewise
