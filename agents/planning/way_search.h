#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "agents/core/geometry.h"
#include "agents/vehicle/vehicle_params.h"

namespace lanewise {

/// A way through what stands on an open road: the front bumper's course, point by point along the road. Road
/// frame: x is s [m], y is d [m, left], heading relative to the road.
struct Way {
  static constexpr double kSpacing = 0.5;  ///< [m] of s between points.
  static constexpr int kMaxPoints = 161;

  double begin_s{0.0};
  int count{0};  ///< 0: none.
  /// Reaches the end it was asked for. Otherwise it ends where nothing led on.
  bool complete{false};
  std::array<float, kMaxPoints> d;        ///< [m]
  std::array<float, kMaxPoints> heading;  ///< [rad] of the body.
  std::array<float, kMaxPoints> slip;     ///< [rad]
  std::array<float, kMaxPoints> gap;  ///< [m] between outline and the nearest thing, at least this; capped.

  double end_s() const { return begin_s + (count - 1) * kSpacing; }
  /// Linear between points; outside the way its first or last point.
  double At(const std::array<float, kMaxPoints>& values, double s) const;
};

struct WayTask {
  Pose2 start;                   ///< Front bumper: s, d, heading error.
  double slip{0.0};              ///< [rad] present.
  double end_s{0.0};             ///< [m] where the way may end.
  double right{0.0}, left{0.0};  ///< [m] borders of the road, as d.
  double target_d{0.0};          ///< [m] where one drives if nothing is in the way.
  double max_course{0.8};        ///< [rad] greatest angle between course and road.
  double margin{0.25};           ///< [m] least gap.
  double comfort{0.6};           ///< [m] gap below which a way costs more.
  /// As far as `side_until`, only ways between these positions; a policy's choice of a side.
  double side_until{-1e9}, side_min{-1e9}, side_max{1e9};
  const VehicleParams* vehicle{nullptr};
  std::span<const Footprint> things;  ///< Road frame.
};

/// Hybrid A* (Dolgov et al. 2008) over (s, d, heading, slip): from metre to metre of road the slip angle
/// changes by one step at most, the bicycle model moves the outline, and a motion is admissible if the
/// outline keeps its margin. Deterministic. Memory is kept between searches.
class WaySearch {
 public:
  /// @return whether the way is complete. The way is the deepest one found otherwise.
  bool Search(const WayTask& task, Way* way);
  int expanded() const { return expanded_; }  ///< Nodes of the last search.

 private:
  struct Node {
    float d, heading, cost;
    std::int32_t parent;
    std::int16_t layer;
    std::int8_t slip;
  };
  struct Open {
    float priority;
    std::int32_t node;
  };
  struct Thing {
    Footprint box;
    double x, y, reach;
  };

  double Gap(const WayTask& task, double s, double d, double heading) const;
  void Push(const Node& node, int layers);
  std::size_t Cell(const WayTask& task, const Node& node) const;

  std::vector<Node> nodes_;
  std::vector<Open> open_;
  std::vector<std::uint32_t> closed_;  // By cell: number of the search that closed it.
  std::vector<Thing> things_;
  std::uint32_t search_{0};
  int expanded_{0};
};

}  // namespace lanewise
