#pragma once

#include <stdexcept>
#include <string>
#include <vector>

namespace lanewise {

/// SUMO refused or failed; the message carries SUMO's own words.
class SumoError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Owner of SUMO's process-wide simulation: one per process at a time, all calls from one thread.
class SumoSession {
 public:
  /// Starts SUMO with command-line options (without the program's name). @throws SumoError.
  explicit SumoSession(const std::vector<std::string>& options);
  ~SumoSession();
  SumoSession(const SumoSession&) = delete;
  SumoSession& operator=(const SumoSession&) = delete;

  /// Advances the simulation by one step. @throws SumoError.
  void Step();
  double time() const;         ///< [s]
  double step_length() const;  ///< [s]
  /// Vehicles and persons still running or waiting to depart.
  int ExpectedNumber() const;

  static std::string Version();
  /// Where SUMO's data is: $SUMO_HOME, else the place found when Lanewise was built. Sets $SUMO_HOME, without
  /// which SUMO refuses some files.
  static std::string EnsureHome();
};

}  // namespace lanewise
