#include "agents/core/spatial_grid.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <random>
#include <vector>

namespace lanewise {
namespace {

struct Points {
  std::vector<double> x, y;
};

Points RandomPoints(std::size_t count, double extent, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> place(-extent, extent);
  Points points;
  for (std::size_t i = 0; i < count; ++i) {
    points.x.push_back(place(random));
    points.y.push_back(place(random));
  }
  return points;
}

std::vector<AgentIndex> Near(const SpatialGrid& grid, double x, double y, double radius) {
  std::vector<AgentIndex> visited;
  grid.ForEachNear(x, y, radius, [&](AgentIndex i) { visited.push_back(i); });
  return visited;
}

void ExpectCompleteAndOnce(const SpatialGrid& grid, const Points& points, double x, double y, double radius) {
  std::map<AgentIndex, int> visits;
  for (const AgentIndex i : Near(grid, x, y, radius)) ++visits[i];
  for (const auto& [i, count] : visits) EXPECT_EQ(count, 1) << "point " << i;
  for (std::size_t i = 0; i < points.x.size(); ++i) {
    if (std::hypot(points.x[i] - x, points.y[i] - y) <= radius) {
      EXPECT_EQ(visits.count(static_cast<AgentIndex>(i)), 1u) << "point " << i;
    }
  }
  // SlotsWithin: exactly those within the radius.
  const auto distance2 = [&](std::size_t i) {
    return (points.x[i] - x) * (points.x[i] - x) + (points.y[i] - y) * (points.y[i] - y);
  };
  std::vector<std::uint32_t> slots;
  std::vector<double> distances2;
  const std::size_t found = grid.SlotsWithin(
      x, y, radius, [&](std::uint32_t slot) { return distance2(grid.items()[slot]); }, &slots, &distances2);
  std::vector<AgentIndex> within, expected;
  for (std::size_t k = 0; k < found; ++k) {
    within.push_back(grid.items()[slots[k]]);
    EXPECT_EQ(distances2[k], distance2(within.back()));
  }
  for (std::size_t i = 0; i < points.x.size(); ++i) {
    if (distance2(i) <= radius * radius) expected.push_back(static_cast<AgentIndex>(i));
  }
  std::sort(within.begin(), within.end());
  EXPECT_EQ(within, expected);
}

TEST(SpatialGrid, FindsAllThatBruteForceFindsAndEachOnce) {
  SpatialGrid grid(20.0);
  for (const std::size_t count : {1u, 2u, 7u, 100u, 1500u}) {  // Few points: cells share buckets.
    const Points points = RandomPoints(count, 500.0, count);
    grid.Build(points.x, points.y);
    for (const double radius : {0.0, 5.0, 20.0, 90.0, 3000.0}) {
      for (std::size_t i = 0; i < std::min<std::size_t>(count, 50); ++i) {
        ExpectCompleteAndOnce(grid, points, points.x[i], points.y[i], radius);
      }
    }
  }
}

TEST(SpatialGrid, VisitsOnlyCellsWithinReach) {
  SpatialGrid grid(10.0);
  const Points points = RandomPoints(2000, 500.0, 3);
  grid.Build(points.x, points.y);
  for (const AgentIndex i : Near(grid, 0.0, 0.0, 25.0)) {
    EXPECT_LE(std::abs(points.x[static_cast<std::size_t>(i)]), 35.0);
    EXPECT_LE(std::abs(points.y[static_cast<std::size_t>(i)]), 35.0);
  }
}

TEST(SpatialGrid, KeepsIndexOrderWithinACell) {
  SpatialGrid grid(10.0);
  const std::vector<double> x{-3.0, -2.0, 5.0, -1.0, 6.0}, y{1.0, 2.0, 3.0, 4.0, 5.0};
  grid.Build(x, y);
  EXPECT_EQ(Near(grid, -2.0, 2.0, 0.5), (std::vector<AgentIndex>{0, 1, 3}));
  EXPECT_EQ(Near(grid, 5.0, 5.0, 0.5), (std::vector<AgentIndex>{2, 4}));
}

TEST(SpatialGrid, TakesEmptyAndWildInput) {
  SpatialGrid grid(10.0);
  EXPECT_TRUE(Near(grid, 0.0, 0.0, 5.0).empty());  // Never built.
  grid.Build({}, {});
  EXPECT_TRUE(Near(grid, 0.0, 0.0, 5.0).empty());
  const std::vector<double> x{1e300, -1e300, std::numeric_limits<double>::quiet_NaN(), 1.0},
      y{0.0, 0.0, 0.0, 1.0};
  grid.Build(x, y);
  EXPECT_EQ(Near(grid, 0.0, 0.0, 5.0), (std::vector<AgentIndex>{3}));
}

}  // namespace
}  // namespace lanewise
