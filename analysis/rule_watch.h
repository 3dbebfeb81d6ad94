#pragma once

#include <cstdint>
#include <vector>

#include "agents/core/types.h"
#include "agents/network/road_network.h"
#include "agents/traffic.h"
#include "analysis/rule_event.h"

namespace lanewise {

/// Watches all vehicles, whoever drives them, from their motion and what the signals show; it knows nothing
/// of what an agent decided. Only forced entries are the agents' own word.
class RuleWatch {
 public:
  RuleWatch(const RoadNetwork& network, double step_length) : network_(network), dt_(step_length) {}

  void Observe(double time, const Traffic& traffic);
  std::int64_t count(RuleEventKind kind) const { return counts_[static_cast<std::size_t>(kind)]; }
  /// Events since the last call.
  std::vector<RuleEventRow> TakeEvents();

 private:
  struct Watched {
    LaneIndex lane{kNone};
    std::int32_t connection{kNone};  // With a signal, at the end of the lane.
    bool could_stop{false};          // Before its line, when it last turned from green or since.
    bool forced{false};
    double stood{0.0};  // [s]
  };

  void Note(RuleEventKind kind, double time, std::int32_t number, LaneIndex lane);
  char Shows(const Traffic& traffic, std::int32_t connection) const;
  void WatchSignal(double time, const Traffic& traffic, std::size_t row, Watched* watched);
  void WatchStandstill(double time, const Traffic& traffic, std::size_t row, Watched* watched);

  const RoadNetwork& network_;
  double dt_;
  std::vector<Watched> watched_;  // By vehicle number.
  std::vector<RuleEventRow> events_;
  RuleEventCounts counts_{};
};

}  // namespace lanewise
