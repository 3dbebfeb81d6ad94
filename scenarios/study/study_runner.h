#pragma once

#include <cstdint>
#include <filesystem>

#include "scenarios/study/study_file.h"
#include "scenarios/study/study_plan.h"

namespace lanewise {

struct RunnerParams {
  int jobs{1};               ///< Worker processes at a time.
  int threads{1};            ///< Of each.
  double hang_after{600.0};  ///< [s] without a sign of progress; then the worker is killed.
  int retries{2};            ///< After a hang, or a kill from outside.
  bool quiet{false};
};

struct RunnerReport {
  bool interrupted{false};
  std::int64_t finished{0}, failed{0};  ///< By this runner.
  double wall_time{0.0};                ///< [s]
  double worker_time{0.0};              ///< [s] Sum over workers, start to end.
  double worker_cpu_time{0.0};          ///< [s] Likewise.
  double own_cpu_time{0.0};             ///< [s] Of this process meanwhile.

  void Add(const RunnerReport& next);  ///< Of a runner that went on.
};

/// Runs what is pending, each run in a process of its own, until nothing is left or a signal comes. A run
/// that fails keeps its message and its log, and the others go on.
/// @throws ConfigError if the study file can no longer be written.
RunnerReport RunPending(const StudyPlan& plan, const RunnerParams& params, StudyFile* study);

/// Folder of the workers' files, beside the study file; it is gone when nothing is under way.
std::filesystem::path WorkFolder(const std::filesystem::path& study_file);

}  // namespace lanewise
