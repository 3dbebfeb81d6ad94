#pragma once

#include <optional>
#include <span>
#include <vector>

#include "agents/network/road_network.h"

namespace lanewise {

/// A way for a vehicle that could not come to the lane its route needs: where its own lane leads, and back.
struct Detour {
  std::vector<EdgeIndex> route;  ///< From the present edge to the destination.
  double extra_length{0.0};      ///< [m] longer than the route that is given up.
  double extra_time{0.0};        ///< [s] likewise, at the speed limits.
};

/// The quickest way, at the speed limits, that leaves route edge `position` where `lane` leads, comes back to
/// a later edge of the route, `back_by` at the latest, and keeps what follows; none if there is none, or it
/// costs more than `max_extra_time` [s].
std::optional<Detour> FindDetour(const RoadNetwork& network, std::span<const EdgeIndex> route,
                                 std::size_t position, std::size_t back_by, LaneIndex lane,
                                 VehicleClassMask vehicle_class, double max_extra_time);

}  // namespace lanewise
