#include "scenarios/scratch_folder.h"

#include <stdlib.h>

#include <string>

#include "agents/core/check.h"

namespace lanewise {

namespace fs = std::filesystem;

ScratchFolder::ScratchFolder() {
  std::string name = (fs::temp_directory_path() / "lanewise-XXXXXX").string();
  if (::mkdtemp(name.data()) == nullptr)
    throw ConfigError(fmt::format("{}: no folder can be made there; set TMPDIR to a writable one",
                                  fs::temp_directory_path().string()));
  path_ = name;
}

ScratchFolder::~ScratchFolder() {
  std::error_code ignored;
  fs::remove_all(path_, ignored);
}

}  // namespace lanewise
