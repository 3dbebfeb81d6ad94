#pragma once

#include <filesystem>

namespace lanewise {

/// A folder for a while, where the system keeps such: it goes away with the object.
class ScratchFolder {
 public:
  ScratchFolder();  ///< @throws ConfigError if none can be made.
  ~ScratchFolder();
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;

  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

}  // namespace lanewise
