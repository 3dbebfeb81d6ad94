#include "agents/sensing/lane_occupancy.h"

#include <algorithm>
#include <cmath>

namespace lanewise {
namespace {

/// [m] by which the path leaves its tangent at the front bumper until the rear bumper, to the left. Lanes
/// side by side bend gently; a greater curvature is a kink shorter than the body: bounded.
double BendAlongBody(double length, double curvature) {
  constexpr double kGentle = 0.05;  // [1/m]
  return 0.5 * length * length * std::clamp(curvature, -kGentle, kGentle);
}

}  // namespace

LaneOccupancy::LaneOccupancy(const RoadNetwork& network)
    : network_(network), start_(network.lanes.size() + 1), fill_(network.lanes.size() + 1) {}

void LaneOccupancy::Build(const Traffic& traffic) {
  const Motion& now = traffic.now;
  // Calls place(lane, s) for every lane the body of row i reaches into. In a junction the tail is still on
  // the lanes before, the front beyond their end: whoever comes to such a lane by a change of lanes must see
  // it.
  const auto for_each_lane = [&](std::size_t i, auto&& place) {
    const LaneIndex lane = now.lane[i];
    if (lane == kNone) return;
    place(lane, now.s[i]);
    const double length = traffic.params[i].length;
    const double rear_d =
        now.d[i] - length * std::sin(now.heading_error[i]) - BendAlongBody(length, now.curvature[i]);
    const double reach = 0.5 * (network_.lanes[lane].width - traffic.params[i].width);
    const auto place_neighbor = [&](int side) {
      const LaneIndex neighbor = network_.Neighbor(lane, side);
      if (neighbor != kNone) place(neighbor, now.s[i]);
    };
    if (std::max(now.d[i], rear_d) > reach) place_neighbor(+1);
    if (std::min(now.d[i], rear_d) < -reach) place_neighbor(-1);
    double s = now.s[i];
    for (LaneIndex here = lane; network_.lanes[here].internal && s < length;) {
      if (network_.lanes[here].incoming.empty()) break;
      here = network_.connections[network_.lanes[here].incoming.front()].from;
      s += network_.lanes[here].length;
      place(here, s);
    }
  };

  std::fill(start_.begin(), start_.end(), 0u);
  for (std::size_t i = 0; i < traffic.vehicle_count; ++i) {
    for_each_lane(i, [&](LaneIndex lane, double) { ++start_[lane + 1]; });
  }
  for (std::size_t lane = 1; lane < start_.size(); ++lane) start_[lane] += start_[lane - 1];
  // A body reaches into five lanes at most: no allocation when more straddle.
  items_.reserve(5 * traffic.vehicle_count);
  items_.resize(start_.back());
  std::copy(start_.begin(), start_.end(), fill_.begin());
  for (std::size_t i = 0; i < traffic.vehicle_count; ++i) {
    for_each_lane(i, [&](LaneIndex lane, double s) {
      items_[fill_[lane]++] = {s, static_cast<AgentIndex>(i)};
    });
  }
  for (std::size_t lane = 0; lane + 1 < start_.size(); ++lane) {
    if (start_[lane + 1] - start_[lane] < 2) continue;
    std::sort(items_.begin() + start_[lane], items_.begin() + start_[lane + 1],
              [](const Occupant& a, const Occupant& b) { return a.s != b.s ? a.s < b.s : a.row < b.row; });
  }
}

}  // namespace lanewise
