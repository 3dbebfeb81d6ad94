#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "scenarios/run_config.h"

namespace lanewise {

/// What studies know of `lanewise run`: they have no list of its options of their own, so a new option can be
/// studied at once.
struct RunInterface {
  struct Option {
    std::string name;  ///< Long, without dashes.
    bool flag{false};
  };
  std::vector<Option> options;
  /// Arguments and what stands behind `--`, as a checked configuration. @throws ConfigError.
  std::function<RunConfig(std::vector<std::string>, const std::vector<std::string>&)> parse;
};

/// The settings of one run, name to value: options of `lanewise run` without dashes, parameters as
/// "set.NAME", SUMO's own options as "sumo". Sorted by name.
using RunSettings = std::vector<std::pair<std::string, std::string>>;

/// One run of a study.
struct PlannedRun {
  std::int64_t number{0};  ///< From 1, in the order of the plan.
  std::string key;         ///< 16 hex digits: the same settings, the same key.
  RunSettings settings;
};

/// A study file (TOML): what is asked and which runs answer it.
///
///   question = "..."
///   [run]        # for every run, any option of `lanewise run`
///   [grid]       # any option with a value, or a list of values: every combination is run
///   [[runs]]     # instead or besides: a list; each entry may hold lists too
///
/// Runs are ordered by seed first, so that what is compared is complete early.
class StudyPlan {
 public:
  /// @throws ConfigError naming file, line, key, and the nearest key there is.
  static StudyPlan Load(const std::filesystem::path& file, const RunInterface& run);

  const std::filesystem::path& file() const { return file_; }
  const std::string& name() const { return name_; }
  const std::string& question() const { return question_; }
  const std::string& text() const { return text_; }  ///< Of the file.
  std::int64_t seeds() const;                        ///< Of the longest list of seeds.

  /// Every run once; duplicates are left out. Nothing is kept, so a plan may have any number of runs.
  /// @param extra_seeds further seeds for every list of seeds: those that follow its largest.
  void ForEach(std::int64_t extra_seeds, const std::function<void(const PlannedRun&)>& visit) const;

  /// Checks the configuration of every run (its seeds differ in nothing else). @throws ConfigError.
  void Check(const RunInterface& run) const;

  /// Arguments of `lanewise run` for these settings, files relative to the study file; SUMO's options behind
  /// `--`.
  std::vector<std::string> Arguments(const RunSettings& settings) const;

 private:
  struct Axis {
    std::string name;
    std::vector<std::string> values;
  };
  struct Block {
    std::vector<Axis> axes;  // All but the seeds.
    std::vector<std::int64_t> seeds;
    std::int64_t line{0};  // In the file, for messages.
  };
  class Reader;

  std::filesystem::path file_;
  std::string name_, question_, text_;
  std::vector<Block> blocks_;
  std::vector<std::string> flags_;
};

/// One line: "policy=dwa seed=3 ...".
std::string ToText(const RunSettings& settings);
std::string ToJson(const RunSettings& settings);
RunSettings SettingsFromJson(const std::string& json);

/// ", did you mean 'x'?" or nothing, if no name is near.
std::string DidYouMean(const std::string& name, const std::vector<std::string>& names);

}  // namespace lanewise
