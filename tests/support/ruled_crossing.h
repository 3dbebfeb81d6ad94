#pragma once

#include <gtest/gtest.h>

#include "agents/rules/junction_rules.h"
#include "tests/support/scene.h"
#include "tests/support/small_nets.h"

namespace lanewise {

/// Road "a" along y = 0 from x = 0 to 100 m, crossed at x = 50 by "b", which begins at y = -50; and the
/// agents' rules there.
class RuledCrossing : public testing::Test {
 protected:
  /// Row 0's view [m] ahead; whatever crosses its way is left to the rules, SUMO's or the agents' own.
  /// @return the world it saw; valid until the next call or change.
  World Sense(bool agents_rule, double sight) {
    World world = scene_.Look();
    rules_.Build(world);
    if (agents_rule) world.rules = &rules_;
    SenseRoad(world, 0, LookAhead(world, 0, sight), 30.0, /*crossing_traffic=*/false, &view_);
    return world;
  }

  RoadNetwork network_ = PlainNet({{"a", "A", "B", 100, "0,0 100,0"}, {"b", "C", "D", 105, "50,-50 50,55"}});
  Scene scene_{network_};
  AgentParams params_;
  JunctionRules rules_{network_, FitLaneCurves(network_, {}), params_};
  RoadView view_;
};

}  // namespace lanewise
