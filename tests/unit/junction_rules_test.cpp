#include "agents/rules/junction_rules.h"

#include <gtest/gtest.h>

#include "agents/core/geometry.h"
#include "tests/support/crossing_net.h"
#include "tests/support/fleet.h"
#include "tests/support/fleet_world.h"

namespace lanewise {
namespace {

constexpr double kStep = 0.1;  // [s]

struct Crossing {
  explicit Crossing(RoadNetwork net, const AgentParams& params = {})
      : network(std::move(net)), fleet(network, params, Rules::kAgent) {}

  /// A vehicle `distance` [m] before its stop line.
  std::size_t From(const std::string& road, double distance, double speed) {
    const std::string to = road == "n" ? "s_out" : road == "s" ? "n_out" : road == "e" ? "w_out" : "e_out";
    return fleet.Add({road, to}, 0, kArm - distance, speed);
  }
  bool Entered(std::size_t row) const { return fleet.traffic.route_position[row] > 0 || InJunction(row); }
  bool InJunction(std::size_t row) const { return network.lanes[fleet.traffic.now.lane[row]].internal; }
  bool Passed(std::size_t row) const { return fleet.traffic.route_position[row] > 0; }
  const RuleState& Told(std::size_t row) const { return fleet.traffic.now.rule[row]; }
  void Show(const std::string& states) { fleet.traffic.signal_states = {states}; }
  /// Steps on while `row`, which nobody drives, waits for the vehicle with this number, or for none.
  void StepWhileItWaitsFor(std::size_t row, std::int32_t number, int steps) {
    for (int k = 0; k < steps; ++k) {
      fleet.traffic.now.rule[row] = {};
      fleet.traffic.now.rule[row].waits_for = number;
      fleet.Step(kStep);
    }
  }
  /// [m] by which the boxes of two vehicles overlap; negative if they do not.
  double Overlap() const {
    const Traffic& t = fleet.traffic;
    double worst = -1e9;
    for (std::size_t a = 0; a < t.vehicle_count; ++a) {
      for (std::size_t b = a + 1; b < t.vehicle_count; ++b) {
        const auto box = [&](std::size_t i) {
          return Footprint{{t.now.x[i], t.now.y[i], t.now.heading[i]}, t.params[i].length, t.params[i].width};
        };
        worst = std::max(worst, PenetrationDepth(box(a), box(b)));
      }
    }
    return worst;
  }

  RoadNetwork network;
  Fleet fleet;
};

TEST(TimeToCover, ClosedForms) {
  EXPECT_DOUBLE_EQ(TimeToCover(8.0, 0.0, 100.0, 1.0), 4.0);             // s = a t^2 / 2
  EXPECT_DOUBLE_EQ(TimeToCover(30.0, 10.0, 10.0, 1.0), 3.0);            // At its limit.
  EXPECT_DOUBLE_EQ(TimeToCover(8.0 + 20.0, 0.0, 4.0, 1.0), 4.0 + 5.0);  // 8 m of run-up, 20 m at 4 m/s.
  EXPECT_DOUBLE_EQ(TimeToCoverBraking(6.0, 4.0, 1.0), 2.0);             // 4 * 2 - 2
  EXPECT_GT(TimeToCoverBraking(8.1, 4.0, 1.0), 1e5);                    // Halts after 8 m.
}

TEST(JunctionMap, PlacesTheConflictWhereThePathsCross) {
  const RoadNetwork network = PriorityCrossing();
  const JunctionMap map(network, FitLaneCurves(network, {}));
  ASSERT_EQ(map.links().size(), 4u);
  const JunctionLink& from_north = map.links()[0];
  EXPECT_NEAR(from_north.length, 2.0 * kCrossingHalf, 1e-6);
  const auto areas = map.Areas(from_north);
  ASSERT_EQ(areas.size(), 2u);  // East and west; not who comes the other way.
  // From the north at x = -1.6 across y = 1.6 after 6.4 m and y = -1.6 after 9.6 m, 2.2 m on either side.
  EXPECT_NEAR(areas[0].begin, 6.4 - 2.2, 0.5);
  EXPECT_NEAR(areas[0].end, 6.4 + 2.2, 0.5);
  EXPECT_NEAR(areas[0].foe_begin, 9.6 - 2.2, 0.5);
  EXPECT_NEAR(areas[1].begin, 9.6 - 2.2, 0.5);
  EXPECT_NEAR(areas[1].foe_begin, 6.4 - 2.2, 0.5);
  for (const ConflictArea& area : areas) {
    EXPECT_TRUE(area.yields);
    EXPECT_FALSE(area.foe_yields);
    EXPECT_FALSE(area.merges);
  }
}

// 2.2 m on either side of where b's path crosses, 2 m behind the end of a's link of 12 m.
TEST(JunctionMap, AConflictMayReachBeyondTheLinksEnd) {
  const RoadNetwork network = CrossingBehindNet();
  const JunctionMap map(network, FitLaneCurves(network, {}));
  const auto areas = map.Areas(map.links()[1]);
  ASSERT_EQ(areas.size(), 1u);
  EXPECT_NEAR(areas[0].foe_begin, 14.0 - 2.2, 0.5);
  EXPECT_NEAR(areas[0].foe_end, 14.0 + 2.2, 0.5);
}

// Where cars pass each other and no rule tells who goes first, buses have a conflict.
TEST(JunctionMap, OpposingTurnsConflictForLongBodiesOnly) {
  const RoadNetwork network = OpposingTurnsNet();
  const JunctionMap map(network, FitLaneCurves(network, {}));
  ASSERT_EQ(map.links().size(), 2u);
  for (const JunctionLink& link : map.links()) {
    EXPECT_TRUE(link.turns);
    EXPECT_TRUE(SwingsWide(link, 12.0));
    EXPECT_FALSE(SwingsWide(link, 5.0));
    const auto areas = map.Areas(link);
    ASSERT_EQ(areas.size(), 1u);
    EXPECT_TRUE(areas[0].only_long);
    EXPECT_FALSE(areas[0].yields || areas[0].foe_yields || areas[0].merges);
  }
}

TEST(JunctionRules, TwoBusesDoNotTurnBeforeEachOther) {
  VehicleParams bus;
  bus.length = 12.0;
  bus.width = 2.5;
  for (const double lead : {0.0, 3.0, 20.0}) {
    Crossing crossing(OpposingTurnsNet());
    const std::size_t first = crossing.fleet.Add({"w", "n_out"}, 0, kArm - 40.0, 8.0, bus);
    const std::size_t second = crossing.fleet.Add({"e", "s_out"}, 0, kArm - 40.0 - lead, 8.0, bus);
    for (int k = 0; k < 400; ++k) {
      crossing.fleet.Step(kStep);
      ASSERT_LT(crossing.Overlap(), 0.0) << lead << " m, step " << k;
    }
    EXPECT_TRUE(crossing.Passed(first) && crossing.Passed(second)) << lead;
  }
}

// Both have waited for long and count on the other to brake: still only one goes.
TEST(JunctionRules, OfTwoImpatientBusesOneGoes) {
  VehicleParams bus;
  bus.length = 12.0;
  bus.width = 2.5;
  Crossing crossing(OpposingTurnsNet());
  const std::size_t first = crossing.fleet.Add({"w", "n_out"}, 0, kArm - 1.0, 0.0, bus);
  const std::size_t second = crossing.fleet.Add({"e", "s_out"}, 0, kArm - 1.2, 0.0, bus);
  crossing.fleet.traffic.now.waited = {30.0f, 30.0f};
  bool together = false;
  for (int k = 0; k < 300; ++k) {
    crossing.fleet.Step(kStep);
    ASSERT_LT(crossing.Overlap(), 0.0) << "step " << k;
    together = together || (crossing.InJunction(first) && crossing.InJunction(second));
  }
  EXPECT_FALSE(together);
  EXPECT_TRUE(crossing.Passed(first) && crossing.Passed(second));
}

TEST(JunctionRules, CarsTurnBeforeEachOther) {
  Crossing crossing(OpposingTurnsNet());
  const std::size_t first = crossing.fleet.Add({"w", "n_out"}, 0, kArm - 40.0, 8.0);
  const std::size_t second = crossing.fleet.Add({"e", "s_out"}, 0, kArm - 40.0, 8.0);
  bool together = false;
  for (int k = 0; k < 150; ++k) {
    crossing.fleet.Step(kStep);
    EXPECT_EQ(crossing.Told(first).reason, RuleReason::kGo);
    EXPECT_EQ(crossing.Told(second).reason, RuleReason::kGo);
    EXPECT_LT(crossing.Overlap(), 0.0);
    together = together || (crossing.InJunction(first) && crossing.InJunction(second));
  }
  EXPECT_TRUE(together);
}

// Whoever waits there starts only behind the tail of who has left the junction with its front already.
TEST(JunctionRules, ATailBehindTheJunctionIsWaitedFor) {
  VehicleParams lorry;
  lorry.length = 16.0;
  for (double distance = 5.0; distance < 60.0; distance += 5.0) {
    Crossing crossing(CrossingBehindNet());
    const std::size_t first = crossing.fleet.Add({"a", "a_out"}, 0, kArm - distance, 6.0, lorry);
    const std::size_t second = crossing.fleet.Add({"b", "b_out"}, 0, kArm - 1.0, 0.0);
    for (int k = 0; k < 250; ++k) {
      crossing.fleet.Step(kStep);
      ASSERT_LT(crossing.Overlap(), 0.0) << distance << " m, step " << k;
    }
    EXPECT_TRUE(crossing.Passed(first) && crossing.Passed(second));
  }
}

TEST(JunctionRules, WhoHasPriorityIsNotHeldUpAndTheOtherWaits) {
  Crossing crossing(PriorityCrossing());
  const std::size_t major = crossing.From("w", 60.0, 13.0), minor = crossing.From("s", 40.0, 10.0);
  Crossing alone(PriorityCrossing());
  const std::size_t reference = alone.From("w", 60.0, 13.0);
  bool minor_waited = false;
  for (int k = 0; k < 250 && !crossing.Passed(minor); ++k) {
    crossing.fleet.Step(kStep);
    alone.fleet.Step(kStep);
    if (!crossing.Passed(major)) {
      EXPECT_NEAR(crossing.fleet.traffic.now.speed[major], alone.fleet.traffic.now.speed[reference], 1e-9);
      EXPECT_FALSE(crossing.Entered(minor) && !crossing.InJunction(major)) << "at step " << k;
    }
    minor_waited = minor_waited || crossing.Told(minor).reason == RuleReason::kYield;
    EXPECT_LT(crossing.Overlap(), 0.0);
  }
  EXPECT_TRUE(minor_waited);
  EXPECT_TRUE(crossing.Passed(minor));
}

// A car that stands 0.5 m before its line has the farther lane behind it after 0.5 + 9.6 + 2.2 + 5 m of
// run-up at 2.6 m/s^2: 3.65 s. A gap time later, after 4.65 s, the other one, at 13.89 m/s, may reach the
// conflict area, which begins 4.2 m behind its line: it must be 60.4 m before the line. 3 m for how paths are
// sampled.
TEST(JunctionRules, GapAcceptedAndRejectedAsComputedByHand) {
  const double run_up = std::sqrt(2.0 * (0.5 + 9.6 + 2.2 + 5.0) / 2.6);
  const double least = (run_up + 1.0) * 13.89 - 4.2;
  EXPECT_NEAR(least, 60.4, 0.1);
  for (const double shift : {-4.0, +4.0}) {
    Crossing crossing(PriorityCrossing());
    const std::size_t minor = crossing.From("n", 0.5, 0.0);
    crossing.From("w", least + shift, 13.89);
    crossing.fleet.Step(kStep);
    EXPECT_EQ(crossing.Told(minor).reason, shift > 0.0 ? RuleReason::kGo : RuleReason::kYield) << shift;
  }
}

TEST(JunctionRules, ABlockedFoeDoesNotBlock) {
  Crossing crossing(CrossingNet("rOOm", {"", "", "", "02"}, true));
  crossing.Show("rGGg");  // From the north stands at red; from the west must yield to it.
  crossing.From("n", 1.0, 0.0);
  const std::size_t west = crossing.From("w", 20.0, 8.0);
  for (int k = 0; k < 60; ++k) crossing.fleet.Step(kStep);
  EXPECT_TRUE(crossing.Entered(west));
}

// Its own signal shows green, that of who stands before it on the lane does not.
TEST(JunctionRules, WhoIsHeldBehindAnotherIsNotWaitedFor) {
  for (const bool held : {true, false}) {
    Crossing crossing(RightTurnNet());
    crossing.Show(held ? "Grg" : "GGg");
    crossing.fleet.Add({"w", "s_out"}, 0, kArm - 0.5, 0.0);
    crossing.fleet.Add({"w", "e_out"}, 0, kArm - 8.0, 0.0);
    const std::size_t ego = crossing.fleet.Add({"s", "n_out"}, 0, kArm - 4.0, 0.0);
    bool yields = false;
    for (int k = 0; k < 60; ++k) {
      crossing.fleet.Step(kStep);
      yields = yields || crossing.Told(ego).reason == RuleReason::kYield;
      ASSERT_LT(crossing.Overlap(), 0.0) << "step " << k;
    }
    EXPECT_EQ(yields, !held) << "held: " << held;
    EXPECT_TRUE(crossing.Entered(ego) || !held);
  }
}

// The first one waits at J2: whoever is behind it there cannot come, but before J1 and with its tail in J1.
TEST(JunctionRules, BehindOneThatWaitsIsWhoCannotPassItsNextLine) {
  const RoadNetwork network = ChainNet(/*edges=*/3, /*lanes=*/1, /*length=*/20.0);
  for (const bool at_second : {false, true}) {
    Fleet fleet(network, {}, Rules::kAgent);
    for (const double s : {19.0, 3.0}) {
      const std::size_t row = fleet.Add({"e0", "e1", "e2"}, 0, s, 0.0);
      if (!at_second) continue;
      fleet.traffic.now.lane[row] = network.FindLane("e1_0");
      fleet.traffic.route_position[row] = 1;
    }
    const FleetWorld seen(network, fleet);
    JunctionRules rules(network, seen.curves, {});
    const std::int32_t first_link = rules.map().LinkOfLane(network.FindLane(":J1_0_0"));
    fleet.traffic.now.rule[0].stop_link = rules.map().LinkOfLane(network.FindLane(":J2_0_0"));
    fleet.traffic.now.rule[0].reason = RuleReason::kYield;
    rules.Build(seen.world);
    ASSERT_EQ(rules.Of(1).size(), 2u);
    for (const Approach& approach : rules.Of(1))
      EXPECT_EQ(approach.behind, at_second && approach.link != first_link) << at_second << approach.link;
  }
}

// When it comes, there seems to be room behind the slow one; when both are at the junction, there is less.
TEST(JunctionRules, WhoMergesBehindASlowOneComesDownToItsSpeedInTime) {
  for (double slow_at = 12.0; slow_at <= 16.0; slow_at += 1.0) {
    Crossing merge(MergeNet());
    const std::size_t slow = merge.fleet.Add({"w", "out"}, 0, kArm - slow_at, 5.0);
    const std::size_t fast = merge.fleet.Add({"s", "out"}, 0, kArm - 45.0, 12.0);
    for (int k = 0; k < 200; ++k) {
      merge.fleet.Step(kStep);
      ASSERT_LT(merge.Overlap(), 0.0) << slow_at << " m, step " << k;
      ASSERT_GT(merge.fleet.traffic.now.accel[fast], -4.6) << slow_at << " m, step " << k;
    }
    EXPECT_TRUE(merge.Passed(slow) && merge.Passed(fast)) << slow_at;
  }
}

TEST(JunctionRules, RightBeforeLeft) {
  Crossing crossing(RightBeforeLeftCrossing());
  const std::size_t from_west = crossing.From("w", 30.0, 8.0), from_south = crossing.From("s", 30.0, 8.0);
  for (int k = 0; k < 200 && !crossing.Passed(from_south); ++k) {
    crossing.fleet.Step(kStep);
    EXPECT_FALSE(crossing.Entered(from_west) && !crossing.Entered(from_south));
  }
  EXPECT_TRUE(crossing.Passed(from_south));
}

TEST(JunctionRules, ACircleOfFourWhoWaitForEachOtherResolves) {
  Crossing crossing(RightBeforeLeftCrossing());
  std::vector<std::size_t> all;
  for (const char* road : {"n", "e", "s", "w"}) all.push_back(crossing.From(road, 20.0, 6.0));
  const auto done = [&] {
    return std::all_of(all.begin(), all.end(), [&](std::size_t row) { return crossing.Passed(row); });
  };
  int steps = 0;
  bool forced = false;
  for (; steps < 600 && !done(); ++steps) {
    crossing.fleet.Step(kStep);
    EXPECT_LT(crossing.Overlap(), 0.0);
    for (const std::size_t row : all) forced = forced || crossing.Told(row).forced > 0;
  }
  EXPECT_TRUE(done());
  EXPECT_TRUE(forced);
  EXPECT_LT(steps * kStep, 40.0);
}

// Who stands with its front over its stop line goes first, even against the right of way: it cannot wait
// elsewhere. But if it waits for the very one that waits for it, that one goes.
TEST(JunctionRules, ACircleIsOpenedPastWhoIsOverItsStopLine) {
  for (const bool circle : {false, true}) {
    Crossing crossing(PriorityCrossing());
    Traffic& traffic = crossing.fleet.traffic;
    const std::size_t ego = crossing.From("w", 3.0, 0.0), other = crossing.From("n", 1.0, 0.0);
    traffic.driven[other] = 0;
    traffic.now.lane[other] = crossing.network.FindLane(":J_0_0");
    traffic.now.s[other] = 1.0;
    crossing.StepWhileItWaitsFor(other, circle ? traffic.number[ego] : kNone, 100);
    EXPECT_EQ(crossing.Passed(ego), circle);
  }
}

// The same where both are over their stop lines, as two that turn left round each other.
TEST(JunctionRules, ACircleInsideTheJunctionIsOpenedAgainstTheRightOfWay) {
  for (const bool circle : {false, true}) {
    Crossing crossing(PriorityCrossing());
    Traffic& traffic = crossing.fleet.traffic;
    const std::size_t ego = crossing.From("n", 1.0, 0.0), other = crossing.From("w", 1.0, 0.0);
    traffic.driven[other] = 0;
    traffic.now.lane[ego] = crossing.network.FindLane(":J_0_0");
    traffic.now.lane[other] = crossing.network.FindLane(":J_3_0");
    traffic.now.s[ego] = traffic.now.s[other] = 1.0;
    crossing.StepWhileItWaitsFor(other, circle ? traffic.number[ego] : kNone, 100);
    EXPECT_EQ(crossing.Passed(ego), circle);
  }
}

// It stands with its front over its stop line; the other, which has to yield, comes 3 m before their ways
// cross, and could stop from 3 m/s, but not from 9.
TEST(JunctionRules, WhoCanStopLetsGoWhoCannot) {
  for (const double speed : {3.0, 9.0}) {
    Crossing crossing(PriorityCrossing());
    Traffic& traffic = crossing.fleet.traffic;
    const std::size_t ego = crossing.From("w", 1.0, 0.0), other = crossing.From("n", 1.0, speed);
    traffic.driven[other] = 0;
    traffic.now.lane[ego] = crossing.network.FindLane(":J_3_0");
    traffic.now.lane[other] = crossing.network.FindLane(":J_0_0");
    traffic.now.s[ego] = traffic.now.s[other] = 1.0;
    crossing.fleet.Step(kStep);
    EXPECT_EQ(traffic.now.rule[ego].reason == RuleReason::kYield, speed > 5.0) << speed;
  }
}

// Half-way over from the lane beside, it is not the leader by its lane.
TEST(JunctionRules, WhoseBodyIsInTheCourseIsWaitedFor) {
  const RoadNetwork network = ChainNet(1, 2, 100.0);
  Fleet fleet(network, {}, Rules::kAgent);
  const std::size_t ego = fleet.Add({"e0"}, 1, 50.0, 0.0), other = fleet.Add({"e0"}, 0, 56.0, 0.0);
  fleet.traffic.driven[other] = 0;
  fleet.traffic.now.d[other] = 1.6;
  fleet.traffic.now.y[other] += 1.6;
  fleet.Step(kStep);
  EXPECT_EQ(fleet.traffic.now.rule[ego].waits_for, fleet.traffic.number[other]);
}

TEST(JunctionRules, KeepsTheJunctionClear) {
  for (const double standing_at : {4.0, 20.0}) {  // [m] front of who stands behind the junction.
    Crossing crossing(PriorityCrossing());
    const std::size_t blocker = crossing.fleet.Add({"e_out"}, 0, standing_at, 0.0);
    crossing.fleet.traffic.driven[blocker] = 0;
    const std::size_t row = crossing.From("w", 60.0, 12.0);
    for (int k = 0; k < 200; ++k) crossing.fleet.Step(kStep);
    // Behind one whose rear is still in the junction there is no room.
    EXPECT_EQ(crossing.Entered(row), standing_at > 15.0);
    EXPECT_LT(crossing.fleet.traffic.now.speed[row], 0.1);
  }
}

// 10 m/s, 0.3 s of response and 4 m/s^2: 3 + 12.5 m.
TEST(JunctionRules, AtYellowStopsIfItCanComfortably) {
  for (const double distance : {15.4, 15.6}) {
    Crossing crossing(CrossingNet("OOOO", {"", "", "", ""}, true));
    crossing.Show("yyyy");
    const std::size_t row = crossing.From("w", distance, 10.0);
    crossing.fleet.Step(kStep);
    EXPECT_EQ(crossing.Told(row).reason, distance > 15.5 ? RuleReason::kSignal : RuleReason::kGo) << distance;
    for (int k = 0; k < 100; ++k) {
      if (k == 20) crossing.Show("rrrr");
      crossing.fleet.Step(kStep);
    }
    EXPECT_EQ(crossing.Entered(row), distance < 15.5) << distance;
  }
}

TEST(JunctionRules, StopsBeforeTheLineAtRedAndGoesAtGreen) {
  Crossing crossing(CrossingNet("OOOO", {"", "", "", ""}, true));
  crossing.Show("rrrr");
  const std::size_t row = crossing.From("e", 80.0, 13.0);
  double hardest = 0.0;
  for (int k = 0; k < 200; ++k) {
    crossing.fleet.Step(kStep);
    hardest = std::max(hardest, -crossing.fleet.traffic.now.accel[row]);
  }
  EXPECT_FALSE(crossing.Entered(row));
  EXPECT_NEAR(kArm - crossing.fleet.traffic.now.s[row], 1.0, 0.5);
  EXPECT_LT(hardest, 4.2);
  crossing.Show("rGrG");
  for (int k = 0; k < 50; ++k) crossing.fleet.Step(kStep);
  EXPECT_TRUE(crossing.Entered(row));
}

TEST(JunctionRules, HaltsAtAStopSignThoughNobodyComes) {
  Crossing crossing(CrossingNet("sMsM", {"13", "", "13", ""}));
  const std::size_t row = crossing.From("s", 40.0, 10.0);
  double slowest = 100.0;
  for (int k = 0; k < 200 && !crossing.Passed(row); ++k) {
    crossing.fleet.Step(kStep);
    if (!crossing.Entered(row)) slowest = std::min(slowest, crossing.fleet.traffic.now.speed[row]);
  }
  EXPECT_LT(slowest, 0.1);
  EXPECT_TRUE(crossing.Passed(row));
}

TEST(JunctionRules, AllWayStopGoesByOrderOfArrival) {
  Crossing crossing(CrossingNet("wwww", {"13", "02", "13", "02"}));
  const std::size_t third = crossing.From("n", 40.0, 8.0), first = crossing.From("e", 12.0, 5.0),
                    second = crossing.From("s", 25.0, 8.0);
  std::vector<std::size_t> order;
  for (int k = 0; k < 400 && order.size() < 3; ++k) {
    crossing.fleet.Step(kStep);
    for (const std::size_t row : {first, second, third}) {
      if (crossing.Entered(row) && std::find(order.begin(), order.end(), row) == order.end())
        order.push_back(row);
    }
    EXPECT_LT(crossing.Overlap(), 0.0);
  }
  EXPECT_EQ(order, (std::vector<std::size_t>{first, second, third}));
}

}  // namespace
}  // namespace lanewise
