#include "agents/sensing/lane_occupancy.h"

#include <gtest/gtest.h>

#include <vector>

#include "tests/support/no_alloc.h"
#include "tests/support/scene.h"
#include "tests/support/small_nets.h"

namespace lanewise {
namespace {

class LaneOccupancyTest : public testing::Test {
 protected:
  std::vector<AgentIndex> On(const char* lane) {
    scene_.Look();
    LaneOccupancy occupancy(network_);
    occupancy.Build(scene_.traffic());
    std::vector<AgentIndex> rows;
    double last = -1e9;
    for (const Occupant& occupant : occupancy.On(network_.FindLane(lane))) {
      EXPECT_GE(occupant.s, last);
      last = occupant.s;
      rows.push_back(occupant.row);
    }
    return rows;
  }

  RoadNetwork network_ = ChainNet(/*edges=*/2, /*lanes=*/3, /*length=*/200.0);
  Scene scene_{network_};
};

using Rows = std::vector<AgentIndex>;

TEST_F(LaneOccupancyTest, SortedByPosition) {
  scene_.Add({"e0"}, 1, 120.0, 5.0);
  scene_.Add({"e0"}, 1, 20.0, 5.0);
  scene_.Add({"e0"}, 1, 70.0, 5.0);
  scene_.Add({"e0", "e1"}, 0, 70.0, 5.0);
  EXPECT_EQ(On("e0_1"), (Rows{1, 2, 0}));
  EXPECT_EQ(On("e0_0"), (Rows{3}));
  EXPECT_EQ(On("e0_2"), Rows{});
  EXPECT_EQ(On("e1_1"), Rows{});
}

// Half the room beside a 1.8 m car in a 3.2 m lane: 0.7 m. Beyond it the body reaches over the border.
TEST_F(LaneOccupancyTest, AStraddlerStandsInBothLanes) {
  const std::size_t inside = scene_.Add({"e0"}, 1, 50.0, 5.0);
  const std::size_t left = scene_.Add({"e0"}, 1, 80.0, 5.0);
  const std::size_t right = scene_.Add({"e0"}, 1, 110.0, 5.0);
  scene_.traffic().now.d[inside] = 0.69;
  scene_.traffic().now.d[left] = 0.71;
  scene_.traffic().now.d[right] = -0.71;
  EXPECT_EQ(On("e0_1"), (Rows{0, 1, 2}));
  EXPECT_EQ(On("e0_2"), (Rows{1}));
  EXPECT_EQ(On("e0_0"), (Rows{2}));
}

// A 5 m car turned by 0.2 rad: its rear is 5 sin(0.2) = 0.99 m right of its front.
TEST_F(LaneOccupancyTest, TheRearCountsToo) {
  const std::size_t row = scene_.Add({"e0"}, 1, 50.0, 5.0);
  scene_.traffic().now.heading_error[row] = 0.2;
  EXPECT_EQ(On("e0_0"), (Rows{0}));
  EXPECT_EQ(On("e0_2"), Rows{});
}

// In the junction with its front, 2 m deep, a 5 m car still has its tail on the lane before; 6 m deep no
// more.
TEST_F(LaneOccupancyTest, ATailStillStandsOnTheLaneBeforeTheJunction) {
  const LaneIndex before = network_.FindLane("e0_1");
  const LaneIndex inside = network_.connections[network_.lanes[before].outgoing.front()].via;
  const std::size_t row = scene_.Add({"e0", "e1"}, 1, 0.0, 5.0);
  scene_.traffic().now.lane[row] = inside;
  scene_.traffic().now.s[row] = 2.0;
  EXPECT_EQ(On("e0_1"), (Rows{0}));
  LaneOccupancy occupancy(network_);
  occupancy.Build(scene_.traffic());
  EXPECT_DOUBLE_EQ(occupancy.On(before).front().s, network_.lanes[before].length + 2.0);
  EXPECT_EQ(occupancy.On(inside).size(), 1u);
  scene_.traffic().now.s[row] = 6.0;
  EXPECT_EQ(On("e0_1"), Rows{});
}

// As many vehicles as before, but all of them in two lanes: warm-up has made room for that.
TEST_F(LaneOccupancyTest, MoreStraddlersDoNotAllocate) {
  for (int k = 0; k < 10; ++k) scene_.Add({"e0"}, 1, 10.0 + 15.0 * k, 5.0);
  scene_.Look();
  LaneOccupancy occupancy(network_);
  occupancy.Build(scene_.traffic());
  for (double& d : scene_.traffic().now.d) d = 0.8;
  const AllocationCounter allocations;
  occupancy.Build(scene_.traffic());
  EXPECT_EQ(allocations.count(), 0);
  EXPECT_EQ(occupancy.On(network_.FindLane("e0_2")).size(), 10u);
}

TEST_F(LaneOccupancyTest, OutermostLanesHaveNoNeighborAndOffTheRoadCountsNowhere) {
  const std::size_t edge = scene_.Add({"e0"}, 2, 50.0, 5.0);
  scene_.traffic().now.d[edge] = 1.5;
  EXPECT_EQ(On("e0_2"), (Rows{0}));
  scene_.traffic().driven[edge] = 0;
  scene_.traffic().now.lane[edge] = kNone;  // Teleporting.
  EXPECT_EQ(On("e0_2"), Rows{});
}

}  // namespace
}  // namespace lanewise
