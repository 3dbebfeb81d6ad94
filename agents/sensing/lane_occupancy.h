#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "agents/network/road_network.h"
#include "agents/traffic.h"

namespace lanewise {

/// One vehicle on one lane.
struct Occupant {
  double s;        ///< [m] front bumper on this lane.
  AgentIndex row;  ///< Row of Traffic.
};

/// Who is on which lane, sorted by position; rebuilt each step. A vehicle whose body reaches over the lane's
/// border, or whose tail is still before the junction, stands in that lane's list too: followers see it.
class LaneOccupancy {
 public:
  explicit LaneOccupancy(const RoadNetwork& network);
  void Build(const Traffic& traffic);
  /// Ascending in s.
  std::span<const Occupant> On(LaneIndex lane) const {
    return {items_.data() + start_[lane], items_.data() + start_[lane + 1]};
  }

 private:
  const RoadNetwork& network_;
  std::vector<std::uint32_t> start_;  // By lane, plus one.
  std::vector<std::uint32_t> fill_;   // Scratch, by lane.
  std::vector<Occupant> items_;
};

}  // namespace lanewise
