#pragma once

#include <cmath>
#include <string>
#include <vector>

#include "agents/planning/tactics.h"
#include "tests/support/fleet.h"

namespace lanewise {

/// A frozen moment: vehicles put on a network, and the World the agents would see.
class Scene {
 public:
  explicit Scene(const RoadNetwork& network)
      : network_(network), curves_(FitLaneCurves(network, {})), fleet_(network), occupancy_(network) {}

  std::size_t Add(const std::vector<std::string>& route, int lane, double s, double speed) {
    return fleet_.Add(route, lane, s, speed);
  }
  Traffic& traffic() { return fleet_.traffic; }

  /// The world as of now; valid until the next call or change.
  World Look() {
    fleet_.pipeline().UpdatePoses(&fleet_.traffic);
    const std::size_t n = traffic().size();
    center_x_.resize(n);
    center_y_.resize(n);
    for (std::size_t i = 0; i < n; ++i) {
      const double half = 0.5 * traffic().params[i].length;
      center_x_[i] = traffic().now.x[i] - half * std::cos(traffic().now.heading[i]);
      center_y_[i] = traffic().now.y[i] - half * std::sin(traffic().now.heading[i]);
    }
    grid_.Build(center_x_, center_y_);
    occupancy_.Build(traffic());
    return {&network_, &curves_, &traffic(), &occupancy_, &grid_, center_x_, center_y_};
  }

  Tactics Decide(AgentIndex ego, const AgentParams& params = {}, bool in_circle = false) {
    const World world = Look();
    const WayAhead way = LookAhead(world, ego, 100.0);
    return DecideTactics(world, params, ego, way, FindLeader(world, ego, way), in_circle);
  }

 private:
  const RoadNetwork& network_;
  std::vector<LaneCurve> curves_;
  Fleet fleet_;
  LaneOccupancy occupancy_;
  SpatialGrid grid_{20.0};
  std::vector<double> center_x_, center_y_;
};

}  // namespace lanewise
