#pragma once

#include <SQLiteCpp/SQLiteCpp.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <vector>

#include "tests/support/child_process.h"
#include "tests/support/temporary_folder.h"

namespace lanewise {

/// Tests of studies: a folder with a study file, and commands on it.
class StudyFiles : public testing::Test {
 protected:
  std::filesystem::path WriteStudy(const std::string& policies, int seeds, int end = 10) const {
    return folder_.Write(
        "study.toml",
        fmt::format("question = 'Does it work?'\n[run]\nscenario = 'priority_crossing'\nend = {}\n"
                    "sample-period = 5\n[grid]\npolicy = {}\nseed = {{ from = 1, count = {} }}\n",
                    end, policies, seeds));
  }
  std::vector<std::string> Command(const std::filesystem::path& study, const std::filesystem::path& results,
                                   const std::vector<std::string>& more = {}) const {
    std::vector<std::string> words{"study", study.string(), "--results", results.string(), "--jobs", "2",
                                   "-q"};
    words.insert(words.end(), more.begin(), more.end());
    return words;
  }
  static std::string Value(const std::filesystem::path& file, const std::string& sql) {
    SQLite::Database database(file.string(), SQLite::OPEN_READONLY, 5000);
    return database.execAndGet(sql).getString();
  }
  static void Change(const std::filesystem::path& file, const std::string& sql) {
    SQLite::Database database(file.string(), SQLite::OPEN_READWRITE, 5000);
    database.exec(sql);
  }

  TemporaryFolder folder_;
};

}  // namespace lanewise
