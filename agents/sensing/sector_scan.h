#pragma once

#include <cstdint>

#include "agents/sensing/lidar.h"
#include "agents/sensing/road_view.h"

namespace lanewise {

/// What the lidar at the middle of the ego's front bumper may see within `range` [m]: vehicles, persons,
/// things that stand on the road, and the borders of the road the way follows. A border is that of all lanes
/// of the edge; junctions have none.
/// @param view of the path: its nodes, and what they are relative to. @param turn [rad] from the frame of the
/// scene to the ego's heading.
void CollectReflectors(const World& world, AgentIndex ego, const WayAhead& way, const RoadView& view,
                       double range, double turn, LidarScene* scene);

/// Senses, scans and codes (Eq. 8 of [A]). @param leader_speed [m/s] of the vehicle ahead in the ego's lane;
/// 0 if there is none. @param scene working memory. @return bit i: sector i is free; 0 is the leftmost.
std::uint8_t ScanSectors(const World& world, AgentIndex ego, const WayAhead& way, const RoadView& view,
                         const AgentParams& params, const Lidar& lidar, double leader_speed,
                         const ScanErrors& errors, LidarScene* scene);

}  // namespace lanewise
