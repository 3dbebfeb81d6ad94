#pragma once

#include "tests/support/fleet.h"
#include "tests/support/small_nets.h"

namespace lanewise {

/// `agents` vehicles on three lanes, 25 m apart on each, at speeds that differ: they follow, brake and change
/// lanes.
struct Crowd {
  explicit Crowd(int agents)
      : network(ChainNet(/*edges=*/2, /*lanes=*/3, /*length=*/25.0 * agents / 3 + 1500.0)), fleet(network) {
    for (int k = 0; k < agents; ++k) {
      VehicleParams params;
      params.max_speed = 8.0 + (k * 7) % 11;
      const std::size_t row =
          fleet.Add({"e0", "e1"}, k % 3, 20.0 + 25.0 * (k / 3) + 3.0 * (k % 3), 4.0 + (k * 5) % 7, params);
      fleet.traffic.speed_limit[row] = params.max_speed;
    }
    for (int k = 0; k < 50; ++k) fleet.Step(0.1);
  }

  RoadNetwork network;
  Fleet fleet;
};

}  // namespace lanewise
