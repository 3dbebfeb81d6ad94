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

/// What a policy that knows sectors only does on an open road: straight on where the strip ahead is free,
/// else to the side chosen, slowly; nothing free: it brakes. It does not turn so tightly that its flanks
/// would sweep over what is beside it.
/// @param committed the side it is turning to, kept from step to step; kForward if none.
OpenRoadPlan DriveBySectors(const World& world, AgentIndex ego, const AgentParams& params, double free_speed,
                            const SectorScan& scan, Avoidance advice, const LidarScene& reflectors,
                            Avoidance* committed);

/// Artificial potential field (Khatib 1986) on an open road: drawn along the road, repelled by every
/// reflecting edge within apf.range: course along the sum of both, speed as DriveBySectors.
OpenRoadPlan DriveByPotential(const World& world, AgentIndex ego, const AgentParams& params,
                              double free_speed, double target_d, const SectorScan& scan,
                              const LidarScene& reflectors);

/// [m] lateral shift the potential field asks for within a lane.
double ShiftByPotential(const AgentParams& params, const VehicleParams& vehicle,
                        const LidarScene& reflectors);

}  // namespace lanewise
