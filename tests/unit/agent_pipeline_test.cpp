#include "agents/agent_pipeline.h"

#include <gtest/gtest.h>
#include <omp.h>

#include <cmath>
#include <numbers>
#include <tuple>

#include "agents/core/geometry.h"
#include "agents/core/state_hash.h"
#include "agents/vehicle/kinematic_bicycle.h"
#include "tests/support/fleet.h"
#include "tests/support/no_alloc.h"
#include "tests/support/small_nets.h"

namespace lanewise {
namespace {

constexpr double kDt = 0.1;  // [s]

Footprint Box(const Fleet& fleet, std::size_t i) {
  const Motion& now = fleet.traffic.now;
  const VehicleParams& p = fleet.traffic.params[i];
  return {{now.x[i], now.y[i], now.heading[i]}, p.length, p.width};
}

/// Puts a scripted (not agent-driven) vehicle where the test wants it.
void Place(Fleet* fleet, std::size_t row, double s, double speed) {
  Traffic& traffic = fleet->traffic;
  traffic.now.s[row] = s;
  traffic.now.speed[row] = speed;
  traffic.driven[row] = 1;
  fleet->pipeline().UpdatePoses(&traffic);
  traffic.driven[row] = 0;
}

/// A fleet on `lanes` lanes, 30 m apart in each, with changing speeds, so that leaders are met and lanes are
/// changed.
std::unique_ptr<Fleet> DenseFleet(const RoadNetwork& network, int vehicles, int lanes) {
  auto fleet = std::make_unique<Fleet>(network);
  for (int k = 0; k < vehicles; ++k) {
    const int lane = k % lanes;
    VehicleParams params;
    params.max_speed = 8.0 + (k * 7) % 11;
    const double s = 20.0 + 25.0 * (k / lanes) + 3.0 * lane;
    const std::size_t row = fleet->Add({"e0", "e1"}, lane, s, 4.0 + (k * 5) % 7, params,
                                       k % 4 == 3 ? Policy::kIdm : Policy::kDwa);
    fleet->traffic.speed_limit[row] = params.max_speed;
  }
  return fleet;
}

std::uint64_t HashOf(const Fleet& fleet) {
  StateHash hash;
  const Motion& now = fleet.traffic.now;
  for (std::size_t i = 0; i < fleet.traffic.vehicle_count; ++i) {
    hash.Add(static_cast<std::uint64_t>(now.lane[i]));
    for (const double value : {now.s[i], now.d[i], now.heading_error[i], now.speed[i], now.accel[i],
                               now.steering_angle[i], now.x[i], now.y[i]}) {
      hash.Add(value);
    }
  }
  return hash.value();
}

TEST(AgentPipeline, RowsAreSmall) {
  EXPECT_LE(AgentStateBytes(), 2048u);
  EXPECT_GE(AgentStateBytes(), 2 * 12 * sizeof(double));  // Two motions of at least twelve doubles.
}

/// Two straight edges of 100 m that meet at an angle of 0.24 rad in an internal lane of 1 m, whose shape is
/// twice as long as SUMO counts.
RoadNetwork KinkNet() {
  return LoadNetText(R"(<net version="1.9">
    <edge id=":J_0" function="internal">
      <lane id=":J_0_0" index="0" speed="13.89" length="0.5" shape="100,0 100.5,0.05 101,0.1"/></edge>
    <edge id="a" from="A" to="J">
      <lane id="a_0" index="0" speed="13.89" length="100" shape="0,0 100,0"/></edge>
    <edge id="b" from="J" to="B">
      <lane id="b_0" index="0" speed="13.89" length="100" shape="101,0.1 198.13,23.87"/></edge>
    <junction id="A" type="dead_end" incLanes="" intLanes=""/>
    <junction id="B" type="dead_end" incLanes="b_0" intLanes=""/>
    <junction id="J" type="priority" incLanes="a_0" intLanes=":J_0_0">
      <request index="0" response="0" foes="0" cont="0"/></junction>
    <connection from="a" to="b" fromLane="0" toLane="0" via=":J_0_0" dir="s" state="M"/>
    <connection from=":J_0" to="b" fromLane="0" toLane="0" dir="s" state="M"/>
  </net>)");
}

// It may be on the short lane or step over it: neither may throw it forward, aside or round.
TEST(AgentPipeline, AShortLaneThatBendsIsPassedSmoothly) {
  const RoadNetwork network = KinkNet();
  for (double start = 70.0; start < 71.4; start += 0.2) {
    Fleet fleet(network);
    fleet.Add({"a", "b"}, 0, start, 13.0);
    for (int k = 0; k < 50; ++k) {
      const Motion before = fleet.traffic.now;
      fleet.Step(kDt);
      const Motion& now = fleet.traffic.now;
      ASSERT_LE(std::hypot(now.x[0] - before.x[0], now.y[0] - before.y[0]), 14.5 * kDt) << start;
      ASSERT_LE(std::abs(WrapAngle(now.heading[0] - before.heading[0])), 0.15) << start;
      ASSERT_LE(std::abs(now.d[0]), 0.6) << start;
    }
    EXPECT_EQ(fleet.traffic.now.lane[0], network.FindLane("b_0"));
  }
}

// Whatever the path does between two steps, on a lane whose shape is longer than its length too.
TEST(AgentPipeline, ABodyTurnsAsItIsSteered) {
  const RoadNetwork network = KinkNet();
  for (const double speed : {1.0, 4.0, 13.0}) {
    Fleet fleet(network);
    fleet.Add({"a", "b"}, 0, 95.0, speed);
    const VehicleParams& vehicle = fleet.traffic.params[0];
    for (int k = 0; k < 40; ++k) {
      const double heading = fleet.traffic.now.heading[0];
      fleet.Step(kDt);
      const Motion& now = fleet.traffic.now;
      const double slip = SlipAngle(now.steering_angle[0], vehicle.wheelbase, vehicle.rear_axle_to_front);
      ASSERT_NEAR(WrapAngle(now.heading[0] - heading),
                  now.speed[0] * kDt / vehicle.rear_axle_to_front * std::sin(slip), 1e-9)
          << "from " << speed << " m/s, step " << k;
    }
    EXPECT_EQ(fleet.traffic.now.lane[0], network.FindLane("b_0"));
  }
}

TEST(AgentPipeline, AFreeVehicleReachesTheLimitOnItsPath) {
  const RoadNetwork network = ChainNet(1, 1, 1000.0);
  Fleet fleet(network);
  fleet.Add({"e0"}, 0, 10.0, 0.0);
  for (int k = 0; k < 300; ++k) {
    fleet.Step(kDt);
    ASSERT_LE(fleet.traffic.now.speed[0], 13.89 + 0.1);
  }
  EXPECT_NEAR(fleet.traffic.now.speed[0], 13.89, 0.2);
  EXPECT_NEAR(fleet.traffic.now.d[0], 0.0, 0.05);
}

using Policies = testing::TestWithParam<std::tuple<Policy, double>>;

class BrakingLeader : public Policies {};

// Follower at its own time gap behind a leader that suddenly brakes with the service deceleration both have.
TEST_P(BrakingLeader, IsNeverTouched) {
  const auto [policy, speed] = GetParam();
  const RoadNetwork network = ChainNet(1, 1, 1000.0, 30.0);
  Fleet fleet(network);
  const VehicleParams params;
  const double gap = params.min_gap + params.time_gap * speed;
  double leader_s = 100.0 + gap + params.length, leader_speed = speed;
  fleet.Add({"e0"}, 0, 100.0, speed, params, policy);
  const std::size_t leader = fleet.Add({"e0"}, 0, leader_s, speed, params);
  fleet.traffic.speed_limit[0] = speed;
  Place(&fleet, leader, leader_s, leader_speed);
  for (int k = 0; k < 300; ++k) {
    const double t = k * kDt;
    if (t >= 2.0) leader_speed = std::max(0.0, leader_speed - params.max_decel * kDt);
    leader_s += leader_speed * kDt;
    fleet.Step(kDt);
    Place(&fleet, leader, leader_s, leader_speed);
    ASSERT_GT(Distance(Box(fleet, 0), Box(fleet, leader)), 0.1) << "at " << t << " s";
  }
  EXPECT_LT(fleet.traffic.now.speed[0], 0.1);
  EXPECT_LT(Distance(Box(fleet, 0), Box(fleet, leader)), params.min_gap + 3.0);  // It did close up.
}

INSTANTIATE_TEST_SUITE_P(Speeds, BrakingLeader,
                         testing::Combine(testing::Values(Policy::kDwa, Policy::kIdm),
                                          testing::Values(5.0, 10.0, 15.0, 25.0)));

class Platoon : public testing::TestWithParam<Policy> {};

// Ten cars queue at standstill gaps and start off together. They never touch, keep their order, and flow:
// within 40 s (13.89 m/s at 2.6 m/s^2 takes 5.3 s, and each driver starts about 1 to 1.5 s after the one
// ahead) all drive.
TEST_P(Platoon, OfTenStartsFromStandstill) {
  const RoadNetwork network = ChainNet(1, 1, 2000.0);
  Fleet fleet(network);
  const VehicleParams params;
  for (int k = 0; k < 10; ++k) {
    fleet.Add({"e0"}, 0, 200.0 - k * (params.length + params.min_gap), 0.0, params, GetParam());
  }
  for (int step = 0; step < 400; ++step) {
    fleet.Step(kDt);
    for (std::size_t k = 1; k < 10; ++k) {
      const double gap = fleet.traffic.now.s[k - 1] - params.length - fleet.traffic.now.s[k];
      ASSERT_GT(gap, 0.5 * params.min_gap) << "vehicle " << k << " at " << step * kDt << " s";
    }
  }
  for (std::size_t k = 0; k < 10; ++k) EXPECT_GT(fleet.traffic.now.speed[k], 11.0) << k;
}

INSTANTIATE_TEST_SUITE_P(Policies, Platoon, testing::Values(Policy::kDwa, Policy::kIdm));

// A car on the lane that does not lead along its route must be on the other one before the fork, and go on to
// "b".
TEST(AgentPipeline, DrivesTheNeededLaneChange) {
  const RoadNetwork network = ForkNet();
  Fleet fleet(network);
  fleet.Add({"a", "b"}, 0, 150.0, 12.0);
  for (int k = 0; k < 400 && network.lanes[fleet.traffic.now.lane[0]].id != "b_0"; ++k) {
    fleet.Step(kDt);
    ASSERT_LE(std::abs(fleet.traffic.now.heading_error[0]), 0.3);
  }
  EXPECT_EQ(network.lanes[fleet.traffic.now.lane[0]].id, "b_0");
}

// A vehicle belongs to its new lane from the step in which it accepts the gap; its body comes over later.
TEST(AgentPipeline, JoinsTheNewLaneBeforeItsBodyDoes) {
  const RoadNetwork network = ForkNet();
  Fleet fleet(network);
  fleet.Add({"a", "b"}, 0, 150.0, 12.0);
  fleet.Step(kDt);
  EXPECT_EQ(network.lanes[fleet.traffic.now.lane[0]].id, "a_1");
  EXPECT_LT(fleet.traffic.now.d[0], -0.9 * kLaneWidth);
  for (int k = 0; k < 60; ++k) fleet.Step(kDt);
  EXPECT_NEAR(fleet.traffic.now.d[0], 0.0, 0.3);
}

// Held up beside its path, a vehicle must not store the error: it would run off its lane when it starts.
TEST(AgentPipeline, StandingDoesNotWindUpTheSteering) {
  const RoadNetwork network = ChainNet(1, 1, 1000.0);
  Fleet fleet(network);
  fleet.Add({"e0"}, 0, 100.0, 0.0);
  fleet.Add({"e0"}, 0, 106.5, 0.0);
  fleet.traffic.now.d[0] = 0.5;
  fleet.traffic.driven[1] = 0;  // Stands.
  for (int k = 0; k < 600; ++k) fleet.Step(kDt);
  EXPECT_LT(std::abs(fleet.traffic.now.steering_pid[0].integral), 0.1);
}

// A broken-down car (hazard lights) blocks the right lane: everyone passes by, nobody touches it.
TEST(AgentPipeline, PassesABrokenDownCar) {
  const RoadNetwork network = ChainNet(1, 2, 800.0);
  Fleet fleet(network);
  const std::size_t broken = fleet.Add({"e0"}, 0, 300.0, 0.0);
  fleet.traffic.driven[broken] = 0;
  fleet.traffic.hazard[broken] = 1;
  for (int k = 0; k < 4; ++k) fleet.Add({"e0"}, 0, 150.0 - 30.0 * k, 10.0);
  for (int step = 0; step < 600; ++step) {
    fleet.Step(kDt);
    for (std::size_t i = 0; i < 5; ++i) {
      for (std::size_t j = 0; j < i; ++j) {
        ASSERT_GT(Distance(Box(fleet, i), Box(fleet, j)), 0.0)
            << i << " and " << j << " at " << step * kDt << " s";
      }
    }
  }
  for (std::size_t i = 1; i < 5; ++i) EXPECT_GT(fleet.traffic.now.s[i], 320.0) << i;
}

// Its flank a centimetre from the corner of one that stands, it would turn into it; it turns away and drives
// on.
TEST(AgentPipeline, WhoIsWedgedBesideACornerTurnsAwayFromIt) {
  const RoadNetwork network = ChainNet(1, 2, 300.0);
  Fleet fleet(network);
  const VehicleParams car;
  const std::size_t other = fleet.Add({"e0"}, 1, 100.0, 0.0);
  const double x = 97.0, y = -0.5, heading = -0.25;           // The ego's front: it wants to the left.
  const double along = -3.0, aside = 0.5 * car.width + 0.01;  // The corner, seen by the ego.
  const double corner_x = x + along * std::cos(heading) - aside * std::sin(heading);
  const double corner_y = y + along * std::sin(heading) + aside * std::cos(heading);
  fleet.traffic.now.d[other] = corner_y + 0.5 * car.width - kLaneWidth;
  Place(&fleet, other, corner_x + car.length, 0.0);
  const std::size_t ego = fleet.Add({"e0"}, 0, x, 0.0);
  fleet.traffic.now.d[ego] = y;
  fleet.traffic.now.heading_error[ego] = heading;
  fleet.pipeline().UpdatePoses(&fleet.traffic);
  for (int k = 0; k < 200; ++k) {
    fleet.Step(kDt);
    EXPECT_LT(PenetrationDepth(Box(fleet, ego), Box(fleet, other)), 0.0);
  }
  EXPECT_GT(fleet.traffic.now.s[ego], x + 10.0);
}

// It has swung out past a corner with a decimetre to spare and would steer back into it: it goes straight on
// until it is past.
TEST(AgentPipeline, WhoPassesACornerCloselyDoesNotSteerBackIntoIt) {
  const RoadNetwork network = ChainNet(1, 2, 300.0);
  Fleet fleet(network);
  const VehicleParams car;
  const std::size_t other = fleet.Add({"e0"}, 0, 100.0, 0.0);
  fleet.traffic.now.d[other] = 0.57;
  Place(&fleet, other, 100.0, 0.0);
  const std::size_t ego = fleet.Add({"e0"}, 1, 100.0 - car.length - 0.1, 5.5);
  fleet.traffic.now.d[ego] = -0.72;
  fleet.traffic.now.heading_error[ego] = 0.21;
  fleet.traffic.now.steering_angle[ego] = -0.06;
  fleet.pipeline().UpdatePoses(&fleet.traffic);
  for (int k = 0; k < 100; ++k) {
    fleet.Step(kDt);
    ASSERT_LT(PenetrationDepth(Box(fleet, ego), Box(fleet, other)), 0.0) << k;
  }
  EXPECT_GT(fleet.traffic.now.s[ego], 120.0);
}

class NoAllocation : public testing::TestWithParam<int> {};

// 200 agents, lanes are changed all the time, so the occupancy lists grow and shrink.
TEST_P(NoAllocation, InAStepAfterWarmUp) {
  omp_set_num_threads(GetParam());
  const RoadNetwork network = ChainNet(2, 3, 2000.0);
  const auto fleet = DenseFleet(network, 200, 3);
  for (int k = 0; k < 50; ++k) fleet->Step(kDt);
  const std::uint64_t before = HashOf(*fleet);
  const AllocationCounter counter;
  for (int k = 0; k < 200; ++k) fleet->Step(kDt);
  EXPECT_EQ(counter.count(), 0);
  EXPECT_NE(HashOf(*fleet), before);
}

INSTANTIATE_TEST_SUITE_P(Threads, NoAllocation, testing::Values(1, 2));

TEST(NoAllocationGuard, SeesAnAllocation) {
  const AllocationCounter counter;
  std::vector<double> values(1000);
  EXPECT_EQ(counter.count(), 1);
  values.resize(2000);
  EXPECT_EQ(counter.count(), 2);
}

// Worst case for the occupancy lists: no vehicle reaches over its lane's border in the first step, all do in
// the next.
TEST(NoAllocation, WhenEverybodyStraddlesAtOnce) {
  const RoadNetwork network = ChainNet(1, 3, 1000.0);
  Fleet fleet(network);
  for (int k = 0; k < 30; ++k) fleet.Add({"e0"}, 1, 20.0 + 30.0 * k, 5.0);
  for (int k = 0; k < 3; ++k) fleet.Step(kDt);
  for (std::size_t i = 0; i < 30; ++i) fleet.traffic.now.d[i] = 0.9;
  fleet.pipeline().UpdatePoses(&fleet.traffic);
  const AllocationCounter counter;
  fleet.Step(kDt);
  EXPECT_EQ(counter.count(), 0);
}

// Along the centre of a bend of 8 m the body cuts it by half a metre, over the feet of who stands at the
// kerb.
TEST(AgentPipeline, SwingsWidePastAPersonAtTheInnerKerb) {
  constexpr double kRadius = 8.0, kPersonRadius = kRadius - 1.45;
  const RoadNetwork network = BendNet(kRadius, 0.5 * std::numbers::pi);
  Fleet fleet(network);
  const std::size_t car = fleet.Add({"bend"}, 0, 0.5, 3.0);
  const double angle = 0.3 * std::numbers::pi;
  fleet.AddPerson(kPersonRadius * std::sin(angle), kRadius - kPersonRadius * std::cos(angle));
  double nearest = 1e9;
  int steps = 0;
  for (; steps < 100 && fleet.traffic.now.s[car] < 12.0; ++steps) {
    fleet.Step(kDt);
    nearest = std::min(nearest, -PenetrationDepth(Box(fleet, car), Box(fleet, 1)));
  }
  EXPECT_GT(nearest, 0.0);
  EXPECT_LT(steps, 100);
}

TEST(AgentPipeline, TheNumberOfThreadsDoesNotMatter) {
  const RoadNetwork network = ChainNet(2, 3, 3000.0);
  const auto run = [&](int threads) {
    omp_set_num_threads(threads);
    const auto fleet = DenseFleet(network, 300, 3);
    for (int k = 0; k < 100; ++k) fleet->Step(kDt);
    return HashOf(*fleet);
  };
  const std::uint64_t one = run(1);
  EXPECT_EQ(run(1), one);
  EXPECT_EQ(run(2), one);
  EXPECT_EQ(run(4), one);
}

}  // namespace
}  // namespace lanewise
