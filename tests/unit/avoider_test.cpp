#include "agents/avoider.h"

#include <gtest/gtest.h>

#include "agents/sector_net/weight_file.h"
#include "tests/support/fleet.h"
#include "tests/support/small_nets.h"

namespace lanewise {
namespace {

// A network is asked once for each code; the table is what it says.
TEST(AvoidanceTable, IsTheNetworks) {
  const AvoidanceTable table = TableOf(DefaultBpNet());
  for (unsigned code = 0; code < 256; ++code)
    EXPECT_EQ(table[code], WayOf(DefaultBpNet().Forward(InputsOfCode(static_cast<std::uint8_t>(code)))))
        << code;
  EXPECT_EQ(table[0xff], Avoidance::kForward);
}

TEST(AvoidanceTable, AheadIsTheTwoFrontSectors) {
  EXPECT_TRUE(AheadIsFree(0b00011000));
  EXPECT_FALSE(AheadIsFree(0b11110111));
  EXPECT_FALSE(AheadIsFree(0b11101111));
}

// Sure of a side is who would take the other one in a mirror: not of a tie, of straight on, or of a habit.
TEST(AvoidanceTable, ASureChoiceIsMirrored) {
  const AvoidanceTable bp = TableOf(DefaultBpNet());
  EXPECT_TRUE(IsSure(bp, 0b00000111));
  EXPECT_TRUE(IsSure(bp, 0b11100000));
  EXPECT_FALSE(IsSure(bp, 0b11100111));
  EXPECT_FALSE(IsSure(bp, 0b11111111));
  AvoidanceTable habit;
  habit.fill(Avoidance::kLeft);
  for (unsigned code = 0; code < 256; ++code) EXPECT_FALSE(IsSure(habit, static_cast<std::uint8_t>(code)));
}

class EveryPolicy : public testing::TestWithParam<Policy> {};

// On a lane every policy follows a leader that brakes to a standstill, and starts again with it.
TEST_P(EveryPolicy, FollowsAndStopsBehindALeader) {
  const RoadNetwork network = ChainNet(1, 1, 1000.0);
  Fleet fleet(network);
  fleet.Add({"e0"}, 0, 100.0, 10.0, {}, GetParam());
  const std::size_t leader = fleet.Add({"e0"}, 0, 125.0, 10.0);
  fleet.traffic.speed_limit[leader] = 8.0;
  for (int k = 0; k < 200; ++k) {
    if (k == 60) fleet.traffic.speed_limit[leader] = 0.0;
    if (k == 150) fleet.traffic.speed_limit[leader] = 8.0;
    fleet.Step(0.1);
    ASSERT_GT(fleet.traffic.now.s[leader] - 5.0 - fleet.traffic.now.s[0], 0.5) << k;
  }
  EXPECT_GT(fleet.traffic.now.s[0], 150.0);
}

INSTANTIATE_TEST_SUITE_P(Policies, EveryPolicy,
                         testing::Values(Policy::kBp, Policy::kBls, Policy::kBpDwa, Policy::kApf),
                         [](const auto& info) {
                           return std::string(kPolicyNames[static_cast<std::size_t>(info.param)]);
                         });

// No lane of an ordinary road is open: the way search is never asked there.
TEST(Avoider, OrdinaryLanesAreNotOpenRoads) {
  const RoadNetwork network = ChainNet(1, 2, 100.0);
  EXPECT_FALSE(IsOpenRoad(network, 0, {}));
  OpenRoadParams wide;
  wide.min_width = kLaneWidth;
  EXPECT_TRUE(IsOpenRoad(network, 0, wide));
}

}  // namespace
}  // namespace lanewise
