#pragma once

#include <array>

#include "agents/agent_params.h"
#include "agents/planning/open_road.h"
#include "agents/sector_net/sector_io.h"
#include "agents/sensing/sector_scan.h"

namespace lanewise {

/// Where a network goes for each of the 256 codes: it is asked once for each, when it is loaded. Code 0,
/// nothing free, is not asked.
using AvoidanceTable = std::array<Avoidance, 256>;

/// The table of a network (BpNet, BlsNet): a pure function of its weights.
template <class Net>
AvoidanceTable TableOf(const Net& net) {
  AvoidanceTable table{};
  for (unsigned code = 0; code < table.size(); ++code)
    table[code] = WayOf(net.Forward(InputsOfCode(static_cast<std::uint8_t>(code))));
  return table;
}

/// Is the strip ahead, the two front sectors, free?
inline bool AheadIsFree(std::uint8_t code) {
  constexpr unsigned kFront = 3u << (kSectors / 2 - 1);
  return (code & kFront) == kFront;
}

/// Does the network choose a side for this code, and for what it would see in a mirror the other one? If not,
/// its choice is a habit, or a mistake, and not what the scan says.
bool IsSure(const AvoidanceTable& table, std::uint8_t code);

/// A scan of an open road. Its sectors are about the direction of the road, not of the vehicle: a vehicle
/// that turns aside would else take its own turn for the road's. [A]'s robot has no road; it drives where it
/// looks.
struct RoadScan {
  const Lidar& lidar;
  const ScanErrors& errors;
  const LidarScene& reflectors;  ///< In the frame of the sensor, x along the road.
  double turn;                   ///< [rad] from that frame to the vehicle's heading.
};

/// What a policy that knows sectors only does on an open road. Straight on where the strip ahead is free.
/// Else it slows down, and asks the network for a side; [A]'s robot then turns on the spot until its front
/// is free, a vehicle steers into the direction in which its front would be free, the first one on that side.
/// Nothing free as far as the zone reaches: the zone is drawn in, and the speed with it. A guard keeps it
/// from moving where it could not stop before what its outline would touch.
/// @param committed the side it is turning to, kept from step to step; kForward if none.
OpenRoadPlan DriveBySectors(const World& world, AgentIndex ego, const AgentParams& params, double free_speed,
                            double target_d, const RoadScan& scan, const AvoidanceTable& table,
                            Avoidance* committed);

/// Artificial potential field (Khatib 1986) on an open road: drawn along the road, repelled by every
/// reflecting edge within apf.range: course along the sum of both, speed and guard as DriveBySectors.
OpenRoadPlan DriveByPotential(const World& world, AgentIndex ego, const AgentParams& params,
                              double free_speed, double target_d, const RoadScan& scan);

/// [m] lateral shift the potential field asks for within a lane.
double ShiftByPotential(const AgentParams& params, const VehicleParams& vehicle,
                        const LidarScene& reflectors);

}  // namespace lanewise
