#include "scenarios/arena.h"

#include <gtest/gtest.h>
#include <omp.h>

#include "agents/sector_net/weight_file.h"

namespace lanewise {
namespace {

ArenaConfig Config(std::vector<FieldKind> kinds, std::vector<Policy> policies, std::int64_t count) {
  ArenaConfig config;
  config.kinds = std::move(kinds);
  config.policies = std::move(policies);
  config.count = count;
  config.quiet = true;
  config.bp = TableOf(DefaultBpNet());
  config.bls = TableOf(DefaultBlsNet());
  return config;
}

Footprint Wall(double x, double from, double to) {
  return {{x, to, 1.5707963267948966}, to - from, 0.3};
}

VehicleParams Car() {
  VehicleParams vehicle;
  vehicle.length = 4.7;
  vehicle.width = 1.84;
  AxlesAndActuators("passenger", &vehicle);
  return vehicle;
}

TEST(ArenaField, IsAFunctionOfKindSeedAndNumber) {
  const ArenaRoad road;
  for (int k = 0; k < kFieldKinds; ++k) {
    const auto kind = static_cast<FieldKind>(k);
    const ArenaField a = MakeField(kind, 1, 5, road), b = MakeField(kind, 1, 5, road),
                     c = MakeField(kind, 2, 5, road);
    ASSERT_EQ(a.things.size(), b.things.size());
    ASSERT_GT(a.things.size() + a.persons.size(), 0u);
    for (std::size_t i = 0; i < a.things.size(); ++i) EXPECT_EQ(a.things[i].front.x, b.things[i].front.x);
    bool same = a.things.size() == c.things.size();
    for (std::size_t i = 0; same && i < a.things.size(); ++i) {
      same = a.things[i].front.x == c.things[i].front.x && a.things[i].front.y == c.things[i].front.y &&
             a.things[i].length == c.things[i].length;
    }
    EXPECT_FALSE(same && !a.things.empty()) << kFieldKindNames[k];
    for (const Footprint& box : a.things) EXPECT_GT(box.front.x, 35.0);  // Room to start.
  }
}

// A wall across the road with a gap of g: the car of 1.84 m passes with 0.3 m of clearance if g > 2.44 m,
// straight ahead (the gap is in the middle).
TEST(Passability, OfAGapIsWidthAndClearance) {
  const ArenaRoad road;
  for (const auto& [gap, passable] : {std::pair{2.50, true}, std::pair{2.42, false}}) {
    ArenaField field;
    field.things = {Wall(100.0, -6.0, -0.5 * gap), Wall(100.0, 0.5 * gap, 6.0)};
    EXPECT_EQ(IsPassable(field, road, Car(), 0.3), passable) << gap;
  }
}

// Two walls from opposite sides whose ends overlap by 2 m: passable far apart, not one car's length apart.
TEST(Passability, OfAChicaneNeedsItsLength) {
  const ArenaRoad road;
  const auto chicane = [&](double distance) {
    ArenaField field;
    field.things = {Wall(100.0, -6.0, 1.0), Wall(100.0 + distance, -1.0, 6.0)};
    return IsPassable(field, road, Car(), 0.3);
  };
  EXPECT_TRUE(chicane(25.0));
  EXPECT_FALSE(chicane(4.0));
  ArenaField closed;
  closed.things = {Wall(100.0, -6.0, 6.0)};
  EXPECT_FALSE(IsPassable(closed, road, Car(), 0.0));
}

// What the planner drives without contact must be passable for the judge with no clearance, who knows nothing
// of the planner: two independent answers.
TEST(Passability, AgreesWithDrives) {
  const Arena arena;
  const ArenaConfig config = Config({FieldKind::kBoxes}, {Policy::kDwa}, 1);
  for (std::int64_t n = 100; n < 110; ++n) {
    const ArenaField field = MakeField(FieldKind::kBoxes, 1, n, arena.road());
    if (arena.Drive(field, Policy::kDwa, config, n).end == DriveEnd::kReached) {
      EXPECT_TRUE(IsPassable(field, arena.road(), arena.vehicle(), 0.0)) << n;
    }
  }
}

class PassableFields : public testing::TestWithParam<FieldKind> {};

// In every field with a passable gap the planner reaches the end without contact, with a network's advice or
// not.
TEST_P(PassableFields, AreDrivenByTheWindowWithoutContact) {
  const Arena arena;
  const ArenaConfig config = Config({GetParam()}, {Policy::kDwa, Policy::kBpDwa}, 12);
  const ArenaResults results = RunArena(arena, config);
  for (std::size_t p = 0; p < 2; ++p) {
    const ArenaTally tally = Tally(results.passable[0], results.drives[0][p]);
    EXPECT_EQ(tally.fields, 12);
    EXPECT_GT(tally.passable, 8);
    EXPECT_EQ(tally.reached_passable, tally.passable)
        << kPolicyNames[static_cast<std::size_t>(config.policies[p])];
    EXPECT_EQ(tally.contacts, 0);
  }
}

INSTANTIATE_TEST_SUITE_P(Kinds, PassableFields,
                         testing::Values(FieldKind::kWalls, FieldKind::kBoxes, FieldKind::kFurniture,
                                         FieldKind::kCorridor, FieldKind::kParkedCars,
                                         FieldKind::kPedestrian),
                         [](const auto& info) {
                           return std::string(kFieldKindNames[static_cast<std::size_t>(info.param)]);
                         });

// The papers' own drives: with the network alone, through every field of walls and every corridor.
TEST(Arena, TheNetworkAloneDrivesWallsAndCorridors) {
  const Arena arena;
  const ArenaConfig config = Config({FieldKind::kWalls, FieldKind::kCorridor}, {Policy::kBp}, 12);
  const ArenaResults results = RunArena(arena, config);
  for (std::size_t k = 0; k < 2; ++k) {
    const ArenaTally tally = Tally(results.passable[k], results.drives[k][0]);
    EXPECT_EQ(tally.passable, 12);
    EXPECT_EQ(tally.reached_passable, 12) << kFieldKindNames[static_cast<std::size_t>(config.kinds[k])];
    EXPECT_EQ(tally.contacts, 0);
  }
}

// A wall that leaves 3.5 m on one side: the network finds the side. One that always says left is held back by
// the guard where the right one is open.
TEST(Arena, TheNetworkChoosesTheSide) {
  const Arena arena;
  ArenaConfig config = Config({}, {}, 1);
  ArenaField left, right;
  left.things = {Wall(120.0, -6.0, -3.0), Wall(120.0, -3.0, 0.0), Wall(120.0, 0.0, 2.5)};
  right.things = {Wall(120.0, 3.0, 6.0), Wall(120.0, 0.0, 3.0), Wall(120.0, -2.5, 0.0)};
  EXPECT_EQ(arena.Drive(left, Policy::kBp, config, 0).end, DriveEnd::kReached);
  EXPECT_EQ(arena.Drive(right, Policy::kBp, config, 0).end, DriveEnd::kReached);
  config.bp.fill(Avoidance::kLeft);
  EXPECT_EQ(arena.Drive(right, Policy::kBp, config, 0).end, DriveEnd::kStopped);
}

// A closed road: everybody stops, nobody strikes the wall.
TEST(Arena, NobodyStrikesAClosedRoad) {
  const Arena arena;
  ArenaField field;
  for (double y = -6.0; y < 6.0; y += 3.0) field.things.push_back(Wall(120.0, y, y + 3.0));
  const ArenaConfig config = Config({}, {}, 1);
  for (const Policy policy : {Policy::kDwa, Policy::kBpDwa, Policy::kBp, Policy::kBls, Policy::kApf}) {
    const DriveResult drive = arena.Drive(field, policy, config, 0);
    EXPECT_EQ(drive.end, DriveEnd::kStopped) << kPolicyNames[static_cast<std::size_t>(policy)];
    EXPECT_GT(drive.at_s, 90.0);
  }
}

TEST(Arena, TheNumberOfThreadsDoesNotMatter) {
  const Arena arena;
  ArenaConfig config =
      Config({FieldKind::kFurniture, FieldKind::kPedestrian}, {Policy::kBpDwa, Policy::kBp}, 6);
  const auto run = [&](int threads) {
    omp_set_num_threads(threads);
    return RunArena(arena, config);
  };
  const ArenaResults one = run(1), three = run(3);
  for (std::size_t k = 0; k < 2; ++k) {
    EXPECT_EQ(one.passable[k], three.passable[k]);
    for (std::size_t p = 0; p < 2; ++p) {
      for (std::size_t n = 0; n < 6; ++n) {
        EXPECT_EQ(one.drives[k][p][n].time, three.drives[k][p][n].time);
        EXPECT_EQ(one.drives[k][p][n].clearance, three.drives[k][p][n].clearance);
        EXPECT_EQ(one.drives[k][p][n].at_s, three.drives[k][p][n].at_s);
      }
    }
  }
}

}  // namespace
}  // namespace lanewise
