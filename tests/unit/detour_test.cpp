#include "agents/network/detour.h"

#include <gtest/gtest.h>

#include "tests/support/net_builder.h"

namespace lanewise {
namespace {

const VehicleClassMask kCar = VehicleClassBit("passenger");

// A ring of four edges, two lanes wide: r0 -> r1 -> r2 -> r3 -> r0. The exit x leaves r1, from the right lane
// only, and leads to y. A long way round, d, leads from the left lane of r2 to y as well.
class DetourTest : public testing::Test {
 protected:
  DetourTest() {
    for (const char* id : {"r0", "r1", "r2", "r3"}) net_.AddEdge(id, 2, 30.0);
    net_.AddEdge("x", 1, 100.0).AddEdge("y", 1, 50.0).AddEdge("d", 1, 1000.0);
    for (int i = 0; i < 4; ++i) {
      const std::string from = "r" + std::to_string(i), to = "r" + std::to_string((i + 1) % 4);
      net_.Connect(from + "_0", to + "_0").Connect(from + "_1", to + "_1");
    }
    net_.Connect("r1_0", "x_0").Connect("x_0", "y_0").Connect("r2_1", "d_0").Connect("d_0", "y_0");
    for (Lane& lane : net_.network.lanes) lane.speed_limit = 10.0;
  }

  std::string Ids(const std::vector<EdgeIndex>& edges) const {
    std::string ids;
    for (const EdgeIndex edge : edges) ids += net_.network.edges[edge].id + " ";
    return ids;
  }

  NetBuilder net_;
  const std::vector<EdgeIndex> route_{0, 1, 4, 5};  // r0 r1 x y
  static constexpr std::size_t kLast = 3;
};

// On the inner lane of r1 the exit is missed: once more round the ring, 4 x 30 m.
TEST_F(DetourTest, OnceMoreRoundTheRing) {
  const LaneIndex inner = net_.network.FindLane("r1_1");
  const auto detour = FindDetour(net_.network, route_, 1, kLast, inner, kCar, 60.0);
  ASSERT_TRUE(detour);
  EXPECT_EQ(Ids(detour->route), "r1 r2 r3 r0 r1 x y ");
  EXPECT_DOUBLE_EQ(detour->extra_length, 120.0);
  EXPECT_DOUBLE_EQ(detour->extra_time, 12.0);
}

TEST_F(DetourTest, NoneThatTakesTooLong) {
  const LaneIndex inner = net_.network.FindLane("r1_1");
  EXPECT_TRUE(FindDetour(net_.network, route_, 1, kLast, inner, kCar, 12.0));
  EXPECT_FALSE(FindDetour(net_.network, route_, 1, kLast, inner, kCar, 11.9));
}

// Where the ring is closed to cars, the way leads along d to the last edge: 30 + 1000 m instead of 100 m.
TEST_F(DetourTest, ComesBackToALaterEdge) {
  net_.At("r3_0").allowed = net_.At("r3_1").allowed = VehicleClassBit("bus");
  const LaneIndex inner = net_.network.FindLane("r1_1");
  const auto detour = FindDetour(net_.network, route_, 1, kLast, inner, kCar, 600.0);
  ASSERT_TRUE(detour);
  EXPECT_EQ(Ids(detour->route), "r1 r2 d y ");
  EXPECT_DOUBLE_EQ(detour->extra_length, 930.0);
  EXPECT_EQ(Ids(FindDetour(net_.network, route_, 1, kLast, inner, kAllVehicleClasses, 600.0)->route),
            "r1 r2 r3 r0 r1 x y ");
}

// A planned stop on x is not driven around, however long the way by d is allowed to take.
TEST_F(DetourTest, ComesBackBeforeTheNextStop) {
  net_.At("r3_0").allowed = net_.At("r3_1").allowed = VehicleClassBit("bus");
  const LaneIndex inner = net_.network.FindLane("r1_1");
  EXPECT_FALSE(FindDetour(net_.network, route_, 1, 2, inner, kCar, 600.0));
  EXPECT_EQ(Ids(FindDetour(net_.network, route_, 1, 2, inner, kAllVehicleClasses, 600.0)->route),
            "r1 r2 r3 r0 r1 x y ");
}

TEST_F(DetourTest, NoneWhereTheLaneLeadsNowhere) {
  EXPECT_FALSE(FindDetour(net_.network, route_, 2, kLast, net_.network.FindLane("y_0"), kCar, 1e6));
  net_.At("r2_0").allowed = net_.At("r2_1").allowed = 0;
  EXPECT_FALSE(FindDetour(net_.network, route_, 1, kLast, net_.network.FindLane("r1_1"), kCar, 1e6));
}

}  // namespace
}  // namespace lanewise
