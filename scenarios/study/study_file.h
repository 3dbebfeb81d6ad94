#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "analysis/results_file.h"
#include "scenarios/study/study_lock.h"
#include "scenarios/study/study_plan.h"

namespace lanewise {

/// Part i of n of a study's runs, for schedulers: every n-th run.
struct Shard {
  std::int64_t index{1};  ///< 1 to count.
  std::int64_t count{1};
};

struct StudyCounts {
  std::int64_t pending{0}, claimed{0}, finished{0}, failed{0};
  std::int64_t total() const { return pending + claimed + finished + failed; }
};

struct ClaimedRun {
  std::int64_t run_id{0};
  std::int64_t attempts{0};  ///< With this one.
  RunSettings settings;
};

struct FailedRun {
  std::int64_t run_id{0};
  RunSettings settings;
  std::string message;
};

/// A study's one file: a results file that also knows which runs the study wants and how far each one is.
/// Every change is a transaction, so a process killed at any moment leaves a valid file. One runner at a time
/// has it open: a lock, which the system drops when the process ends, keeps others out.
class StudyFile {
 public:
  /// @throws ConfigError: no study file, the file of another study, or in use by another runner.
  StudyFile(const std::filesystem::path& file, const StudyPlan& plan);

  const std::filesystem::path& path() const { return path_; }
  /// Seeds added to the plan's by earlier rounds.
  std::int64_t extra_seeds() const;
  void SetExtraSeeds(std::int64_t extra_seeds);

  /// Adds the runs of the plan that are not there yet. @return how many were new.
  std::int64_t AddRuns(const StudyPlan& plan, std::int64_t extra_seeds, const Shard& shard);
  /// Runs whose runner is gone are pending again. @return how many.
  std::int64_t ReleaseStale();
  /// Failed runs are pending again. @return how many.
  std::int64_t RetryFailed();

  /// The next run, marked as claimed; nothing if none is pending.
  std::optional<ClaimedRun> Claim();
  /// In one transaction: the worker's rows become the study's, and the run is finished.
  void Finish(std::int64_t run_id, const std::filesystem::path& worker_file, double wall_time);
  void Fail(std::int64_t run_id, const std::string& message, const std::string& log);
  /// Pending again. @param counts whether the attempt is remembered.
  void Release(std::int64_t run_id, bool counts);

  StudyCounts Counts() const;
  std::vector<FailedRun> Failed() const;

 private:
  std::filesystem::path path_;
  StudyLock lock_;
  mutable ResultsFile file_;
};

/// What a run took.
struct RunCost {
  double wall_time{0.0};  ///< [s]
  double bytes{0.0};      ///< Of its results.
};

/// Visits the finished runs of a study file, which is only read; there are none if there is no file yet.
void ForEachFinished(const std::filesystem::path& file,
                     const std::function<void(const std::string& key, const RunSettings& settings,
                                              const RunCost& cost)>& visit);

}  // namespace lanewise
