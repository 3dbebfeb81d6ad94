#include "agents/planning/way_search.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/no_alloc.h"

namespace lanewise {
namespace {

Footprint Box(double x, double y, double heading, double length, double width) {
  return {
      {x + 0.5 * length * std::cos(heading), y + 0.5 * length * std::sin(heading), heading}, length, width};
}

struct Road {
  Road() {
    AxlesAndActuators("passenger", &vehicle);
    task.start = {10.0, 0.0, 0.0};
    task.end_s = 70.0;
    task.left = 6.0;
    task.right = -6.0;
    task.vehicle = &vehicle;
  }
  bool Search() {
    task.things = things;
    return search.Search(task, &way);
  }
  /// Least distance of the outline to the things, along the whole way.
  double Clearance() const {
    double least = 1e9;
    for (int k = 0; k < way.count; ++k) {
      const Footprint body{
          {way.begin_s + k * Way::kSpacing, way.d[k], way.heading[k]}, vehicle.length, vehicle.width};
      for (const Footprint& thing : things) least = std::min(least, Distance(body, thing));
    }
    return least;
  }
  VehicleParams vehicle;
  WayTask task;
  std::vector<Footprint> things;
  WaySearch search;
  Way way;
};

TEST(WaySearch, AnEmptyRoadIsDrivenStraight) {
  Road road;
  ASSERT_TRUE(road.Search());
  EXPECT_NEAR(road.way.end_s(), 70.0, 1e-9);
  for (int k = 0; k < road.way.count; ++k) EXPECT_EQ(road.way.d[k], 0.0f);
}

// A box in the middle: the way keeps its margin, and the bicycle model holds from point to point.
TEST(WaySearch, GoesAroundABox) {
  Road road;
  road.things = {Box(40.0, 0.0, 0.4, 2.0, 2.0)};
  ASSERT_TRUE(road.Search());
  EXPECT_GE(road.Clearance(), road.task.margin);
  for (int k = 0; k + 1 < road.way.count; ++k) {
    const double course = road.way.heading[k] + road.way.slip[k];
    const double turn =
        Way::kSpacing / std::cos(course) * std::sin(road.way.slip[k]) / road.vehicle.rear_axle_to_front;
    EXPECT_NEAR(road.way.heading[k + 1] - road.way.heading[k], turn, 1e-5) << k;
    EXPECT_NEAR(road.way.d[k + 1] - road.way.d[k], Way::kSpacing * std::tan(course + 0.5 * turn), 1e-5) << k;
  }
}

// The side a policy has chosen binds the way.
TEST(WaySearch, KeepsToTheChosenSide) {
  for (const double side : {1.0, -1.0}) {
    Road road;
    road.things = {Box(40.0, 0.2, 0.0, 2.0, 1.0)};
    road.task.side_until = 45.0;
    (side > 0.0 ? road.task.side_min : road.task.side_max) = -0.3 * side;
    ASSERT_TRUE(road.Search());
    EXPECT_GT(side * (road.way.At(road.way.d, 40.0) - 0.2), 0.5 + 0.9);
  }
}

// Two walls that overlap need an S; a third one closes the road.
TEST(WaySearch, ThreadsAChicaneAndStopsBeforeAWall) {
  Road road;
  road.things = {Box(30.0, -2.0, 1.5707963, 8.0, 0.3), Box(48.0, 2.0, 1.5707963, 8.0, 0.3)};
  ASSERT_TRUE(road.Search());
  EXPECT_GE(road.Clearance(), road.task.margin);
  EXPECT_GT(road.way.At(road.way.d, 30.0), 2.0);
  EXPECT_LT(road.way.At(road.way.d, 48.0), -2.0);
  road.things.push_back(Box(60.0, 0.0, 1.5707963, 12.0, 0.3));
  EXPECT_FALSE(road.Search());
  EXPECT_GT(road.way.end_s(), 50.0);
  EXPECT_LT(road.way.end_s(), 60.0 - road.task.margin);
}

TEST(WaySearch, AllocatesOnlyOnce) {
  Road road;
  road.things = {Box(30.0, -2.0, 1.5707963, 8.0, 0.3), Box(48.0, 2.0, 1.5707963, 8.0, 0.3)};
  road.Search();
  const AllocationCounter counter;
  road.Search();
  EXPECT_EQ(counter.count(), 0);
  EXPECT_GT(road.search.expanded(), 60);
}

}  // namespace
}  // namespace lanewise
