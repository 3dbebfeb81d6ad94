#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "agents/core/types.h"
#include "agents/network/road_network.h"
#include "analysis/traffic_frame.h"

namespace lanewise {

/// Where a box is at one moment.
struct BoxPose {
  Point2 center;       ///< [m] world.
  Point2 u{1.0, 0.0};  ///< Unit vector of the heading.
};

/// Where road users get to if they follow their lanes at constant speed: along the center lines of their way,
/// both bumpers on them, and beside them as far and as askew as they are now; one that moves sideways goes on
/// doing so. Straight where the way is not known.
class LaneMotion {
 public:
  explicit LaneMotion(const RoadNetwork& network);

  /// Does following its lanes for `seconds` take row i elsewhere than keeping its velocity and heading? That
  /// is, if these bend, or if it is not in line with them.
  /// `now` is the row's present pose.
  bool Turns(const TrafficFrame& frame, std::size_t i, const BoxPose& now, double seconds) const;

  /// Poses of the box of row i now and every `period` [s], as many as `poses` holds. A way that ends is
  /// extended straight.
  void Follow(const TrafficFrame& frame, std::size_t i, const BoxPose& now, double period,
              std::span<BoxPose> poses) const;

 private:
  struct LinePoint {
    double s;       // [m] SUMO's position on the lane.
    double x, y;    // [m]
    double turned;  // [rad] sum of all bends up to here, this one included.
  };
  struct Way;

  std::span<const LinePoint> Line(LaneIndex lane) const {
    return {points_.data() + start_[lane], points_.data() + start_[lane + 1]};
  }
  double TurnedAt(LaneIndex lane, double s) const;
  /// Sine of the angle [0, 1] at which two lanes meet; 1 beyond a right angle.
  double TurnedBetween(LaneIndex from, LaneIndex to) const;
  Way WayOf(const TrafficFrame& frame, std::size_t i, double ahead) const;

  const RoadNetwork& network_;
  std::vector<std::uint32_t> start_;  // By lane, then the end: where its line begins in points_.
  std::vector<Point2> first_direction_, last_direction_;  // Unit vectors, by lane; 0 without a line.
  std::vector<LinePoint> points_;  // None, or two and more, a lane; never two at the same s.
};

}  // namespace lanewise
