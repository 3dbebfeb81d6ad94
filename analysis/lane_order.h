#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "agents/network/road_network.h"
#include "analysis/encounter.h"
#include "analysis/traffic_frame.h"

namespace lanewise {

/// One road user of a pair, as far as lanes tell how the two meet.
struct LaneUser {
  LaneIndex lane{kNone};    ///< Of the front bumper.
  LaneIndex behind{kNone};  ///< The lane before it.
  LaneIndex rear{kNone};    ///< Of the rear bumper: lane or behind.
  LanePath path;
  double heading{0.0};         ///< [rad]
  double lateral_offset{0.0};  ///< [m]
  double lateral_speed{0.0};   ///< [m/s] to the left.
  double width{0.0};           ///< [m]
};

LaneUser LaneUserAt(const TrafficFrame& frame, std::size_t row);

/// Does b follow a: is all of a on lanes that b is on, has just left or is going to drive on?
bool IsOnWayOf(const LaneUser& b, const LaneUser& a);

/// How the ways of two road users that are not following each other along their lanes meet, from their lanes
/// and their headings there.
EncounterType ClassifyMeeting(const RoadNetwork* network, const LaneUser& a, const LaneUser& b);

/// Who is ahead of whom along the lanes: all rows of a frame by lane and position.
class LaneOrder {
 public:
  explicit LaneOrder(const RoadNetwork& network) : network_(network) {}

  void Build(const TrafficFrame& frame);

  /// Gap [m] along the lanes from the front bumper of row i to the rear bumper of row j, if j is ahead on the
  /// way of i with all of its length and the two would touch: they overlap sideways. Nothing if not.
  std::optional<double> GapBetween(const TrafficFrame& frame, std::size_t i, std::size_t j) const;

  /// Calls visit(j, gap) for every j of GapBetween with a gap of at most `reach` [m].
  template <class Visitor>
  void ForEachAhead(const TrafficFrame& frame, std::size_t i, double reach, Visitor&& visit) const;

 private:
  /// Gap if row j is on lane number k of the way of row i, which begins `offset` [m] ahead of i's front
  /// bumper.
  std::optional<double> GapOnWay(const TrafficFrame& frame, std::size_t i, std::size_t j, std::size_t k,
                                 double offset) const;

  const RoadNetwork& network_;
  std::vector<std::uint32_t> start_;  // By lane, then the end: where its rows begin in rows_.
  std::vector<std::int32_t> rows_;    // By lane, ascending by position.
  double max_length_{0.0};            // [m] of all rows.
};

template <class Visitor>
void LaneOrder::ForEachAhead(const TrafficFrame& frame, std::size_t i, double reach, Visitor&& visit) const {
  const LanePath& path = frame.path[i];
  double offset = -frame.lane_pos[i];
  for (std::size_t k = 0; k < LanePath::kLanes && path.lane[k] != kNone; ++k) {
    if (offset > reach + max_length_) return;
    const LaneIndex lane = path.lane[k];
    // From the far end back: all that is behind row i on its own lane comes last.
    for (std::uint32_t n = start_[lane + 1]; n > start_[lane]; --n) {
      const auto j = static_cast<std::size_t>(rows_[n - 1]);
      if (k == 0 && frame.lane_pos[j] <= frame.lane_pos[i]) break;
      const std::optional<double> gap = GapOnWay(frame, i, j, k, offset);
      if (gap && *gap <= reach) visit(j, *gap);
    }
    offset += network_.lanes[lane].length;
  }
}

}  // namespace lanewise
