#pragma once

#include <map>
#include <optional>
#include <string>

#include "scenarios/study/study_file.h"
#include "scenarios/study/study_plan.h"

namespace lanewise {

/// What runs will take, by runs of the same kind: settings that hardly change it (seed, parameters) are left
/// out of account.
class CostEstimate {
 public:
  void Add(const RunSettings& settings, double wall_time, double bytes);
  bool Knows(const RunSettings& settings) const;
  bool empty() const { return all_.runs == 0; }
  /// Mean of its kind, or else of all. @pre not empty.
  RunCost Of(const RunSettings& settings) const;

 private:
  struct Mean {
    double wall_time{0.0}, bytes{0.0};
    std::int64_t runs{0};
  };
  std::map<std::string, Mean> kinds_;
  Mean all_;
};

/// Starts a run, stops it some time after its first step, and scales what it took to its end; leaves nothing
/// behind. Nothing if the run fails, or has no end to scale to.
/// @param seconds [s] wall time.
std::optional<RunCost> ProbeCost(const StudyPlan& plan, const RunSettings& settings, double seconds,
                                 int threads);

}  // namespace lanewise
