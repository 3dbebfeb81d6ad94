#pragma once

#include <span>
#include <string>
#include <vector>

#include "agents/coordination/signal_timing.h"
#include "agents/network/road_network.h"

namespace lanewise {

/// The signals of the network: what they show and will show, and how long their phases last.
class SignalBridge {
 public:
  explicit SignalBridge(const RoadNetwork& network);

  /// After a SUMO step: where each signal is in its program. `time` [s].
  void Read(double time);
  /// By index of RoadNetwork::signal_ids: with the durations in force, and with the program's own.
  std::span<const SignalTiming> timings() const { return timings_; }
  std::span<const SignalTiming> programs() const { return programs_; }
  /// Durations [s] of the phases of the cycle that has just begun; the next one is the program's again.
  void SetCycle(std::int32_t signal, std::span<const double> durations);

 private:
  void ReadProgram(std::size_t signal, const std::string& name);
  void EndPhase(std::size_t signal);

  const RoadNetwork& network_;
  std::vector<std::string> program_names_;        // By signal.
  std::vector<SignalTiming> programs_, timings_;  // Likewise.
};

}  // namespace lanewise
