#pragma once

#include <cstdint>

namespace lanewise {

/// What can go wrong in a run, on demand: for tests of what studies do about it. The environment variable
/// LANEWISE_TEST_FAULT="KIND SEED VALUE" lets the runs with this seed
///   abort   call abort() at VALUE s of simulated time, as SUMO does when an assertion fails
///   hang    make no more progress from VALUE s on
///   full    have a disk of VALUE bytes.
class TestFault {
 public:
  explicit TestFault(std::int64_t seed);
  /// @param time [s] simulated.
  void Step(double time) const;
  std::int64_t max_file_bytes() const;  ///< 0: no limit.

 private:
  enum class Kind : std::uint8_t { kNone, kAbort, kHang, kFull };
  Kind kind_{Kind::kNone};
  double value_{0.0};
};

}  // namespace lanewise
