#pragma once

#include <cmath>
#include <vector>

#include "tests/support/fleet.h"

namespace lanewise {

/// The world a fleet's agents see, as the fleet stands now; it refers to the network and the fleet.
struct FleetWorld {
  FleetWorld(const RoadNetwork& network, const Fleet& fleet)
      : curves(FitLaneCurves(network, {})), occupancy(network) {
    const Traffic& traffic = fleet.traffic;
    for (std::size_t i = 0; i < traffic.size(); ++i) {
      const double half = 0.5 * traffic.params[i].length;
      x.push_back(traffic.now.x[i] - half * std::cos(traffic.now.heading[i]));
      y.push_back(traffic.now.y[i] - half * std::sin(traffic.now.heading[i]));
    }
    grid.Build(x, y);
    occupancy.Build(traffic);
    world = {&network, &curves, &traffic, &occupancy, &grid, x, y};
  }
  FleetWorld(const FleetWorld&) = delete;  // `world` refers to the members.
  FleetWorld& operator=(const FleetWorld&) = delete;

  std::vector<LaneCurve> curves;
  LaneOccupancy occupancy;
  SpatialGrid grid{20.0};
  std::vector<double> x, y;
  World world;
};

}  // namespace lanewise
