#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>

namespace lanewise {

/// One line that tells how far a run is: simulated time, vehicles, real-time factor, time left. Rewritten
/// in place on a terminal, now and then a new line elsewhere.
class Progress {
 public:
  /// @param fd open file that is told every quarter of a second: "time end running arrived expected\n", end
  /// -1 if it is unknown; -1: none.
  Progress(std::string label, std::optional<double> end, bool quiet, int fd = -1);
  ~Progress();
  /// @param expected vehicles running or waiting; arrived so far.
  void Update(double time, std::int64_t running, std::int64_t arrived, std::int64_t expected);

 private:
  using Clock = std::chrono::steady_clock;
  std::string label_;
  std::optional<double> end_;
  bool quiet_, terminal_, shown_{false};
  int fd_;
  Clock::time_point started_, last_shown_, last_told_;
};

}  // namespace lanewise
