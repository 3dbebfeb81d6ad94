#pragma once

#include <cstdint>
#include <vector>

#include "agents/core/state_hash.h"
#include "agents/traffic.h"
#include "analysis/results_file.h"

namespace lanewise {

/// Signs the motion of every vehicle, step by step. Besides the rolling hash of all it keeps two sums over
/// the vehicles' own hashes, from which two runs that differ in one vehicle tell which one it was: the
/// difference of the weighted sums is the difference of the plain ones times the vehicle's number plus one.
class StateTrace {
 public:
  void Add(std::int64_t step, const Traffic& traffic);

  std::uint64_t hash() const { return rolling_.value(); }  ///< Of all steps so far.
  /// Rows since the last Clear.
  const std::vector<StepHashRow>& rows() const { return rows_; }
  void Clear() { rows_.clear(); }

 private:
  StateHash rolling_;
  std::vector<StepHashRow> rows_;
};

/// The number of the only vehicle in whose state two runs differ after a step, if it is the only one.
/// @param numbers vehicles of either run.
std::int32_t FindDifferingVehicle(const StepHashRow& a, const StepHashRow& b, std::int32_t numbers);

}  // namespace lanewise
