#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "agents/network/road_network.h"

namespace lanewise {

/// May a vehicle of this class drive on the lane?
inline bool MayUse(const Lane& lane, VehicleClassMask vehicle_class) {
  // An "ignoring" vehicle may drive even where every class is forbidden.
  return vehicle_class == kAllVehicleClasses || (lane.allowed & vehicle_class) != 0;
}

/// [m] Edges as short as the pieces of a roundabout between two of its entries leave no room to change lanes:
/// who stands there for want of a gap closes the ring behind it.
inline constexpr double kRoomToChange = 15.0;

/// What a route asks of one lane of one of its edges.
struct LaneAdvice {
  std::int32_t changes{
      0};  ///< Lane changes to the best lane of this edge: > 0 to the left, < 0 to the right.
  double free_distance{0.0};  ///< [m] from the start of this edge that can be driven along the route without
                              ///< a lane change, starting on this lane.
  LaneIndex next{kNone};      ///< Lane of the next route edge this lane leads to; kNone if none.
  std::int32_t connection{kNone};  ///< The connection there, index in RoadNetwork::connections.
  bool allowed{false};             ///< The vehicle class may use the lane.
  double change_distance{0.0};     ///< [m] from the start of this edge within which the changes can be made.
  bool can_wait{false};            ///< The changes can wait until behind a link that has to yield.
};

/// Lane planning along one route for one vehicle class: backward over its edges, which lanes lead on,
/// how far, and how many changes each needs. The choice among several next lanes follows SUMO's
/// best-lanes rule, so that agent and SUMO take the same link.
class RoutePlan {
 public:
  RoutePlan(const RoadNetwork& network, std::vector<EdgeIndex> route, VehicleClassMask vehicle_class);

  std::span<const EdgeIndex> route() const { return route_; }
  /// Advice for lane number `lane` (0 = rightmost) of route edge `position`.
  const LaneAdvice& At(std::size_t position, std::int32_t lane) const {
    return advice_[offset_[position] + static_cast<std::size_t>(lane)];
  }
  /// [m] of route from the start of edge `position` to the route's end.
  double RemainingLength(std::size_t position) const { return remaining_[position]; }

 private:
  std::vector<EdgeIndex> route_;
  std::vector<std::size_t> offset_;
  std::vector<double> remaining_;
  std::vector<LaneAdvice> advice_;
};

}  // namespace lanewise
