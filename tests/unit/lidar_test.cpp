#include "agents/sensing/lidar.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <random>

#include "tests/support/no_alloc.h"

namespace lanewise {
namespace {

constexpr double kDegree = std::numbers::pi / 180.0;

LidarParams Quiet(LidarParams params) {
  params.range_noise = params.dropout = 0.0;
  return params;
}

/// Distance along a ray at `angle` to a segment, by solving o + r u = a + t e: not as the product does it.
double RayToSegment(double angle, Point2 a, Point2 b) {
  const double ux = std::cos(angle), uy = std::sin(angle), ex = b.x - a.x, ey = b.y - a.y;
  const double det = ex * uy - ey * ux;
  if (std::abs(det) < 1e-14) return std::numeric_limits<double>::infinity();
  const double t = (uy * -a.x + ux * a.y) / det;
  const double r = (ex * a.y - ey * a.x) / det;
  return t >= 0.0 && t <= 1.0 && r > 0.0 ? r : std::numeric_limits<double>::infinity();
}

/// A random surrounding: cars, persons, walls near and far, some around the sensor, two road borders.
struct RandomScene {
  explicit RandomScene(unsigned seed) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> place(-20.0, 25.0), turn(-3.2, 3.2), one(0.0, 1.0);
    const int boxes = static_cast<int>(random() % 14);
    for (int k = 0; k < boxes; ++k) {
      const double heading = turn(random);
      const bool small = one(random) < 0.3;
      const double scale = one(random) < 0.3 ? 0.1 : 1.0;
      Add({{scale * place(random), scale * place(random)},
           {std::cos(heading), std::sin(heading)},
           small ? 0.2 : 0.5 + 4.0 * one(random),
           small ? 0.25 : 0.1 + one(random)});
    }
    const double left = 1.5 + 6.0 * one(random), right = -1.5 - 6.0 * one(random), bend = 0.2 * turn(random);
    Border({-10.0, left}, {12.0, left});
    Border({12.0, left}, {40.0, left + 6.0 * bend});
    Border({-10.0, right}, {40.0, right + 6.0 * bend});
  }
  void Add(const ReflectingBox& box) {
    scene.AddBox(box);
    const Point2 u = box.axis, w{-u.y, u.x};
    Point2 corner[4];
    const double sign[4][2] = {{1, 1}, {-1, 1}, {-1, -1}, {1, -1}};
    for (int k = 0; k < 4; ++k) {
      corner[k] = {box.center.x + sign[k][0] * box.half_length * u.x + sign[k][1] * box.half_width * w.x,
                   box.center.y + sign[k][0] * box.half_length * u.y + sign[k][1] * box.half_width * w.y};
    }
    for (int k = 0; k < 4; ++k) segments.push_back({corner[k], corner[(k + 1) % 4]});
  }
  void Border(Point2 a, Point2 b) {
    scene.AddEdge(a, b);
    segments.push_back({a, b});
  }
  LidarScene scene;
  std::vector<std::pair<Point2, Point2>> segments;
};

TEST(Lidar, PresetsAreThoseOfThePapers) {
  const Lidar song(SongLidar()), ring(RingLidar());
  EXPECT_EQ(song.beams(), 1081);
  EXPECT_NEAR(song.Angle(0), -135.0 * kDegree, 1e-12);
  EXPECT_NEAR(song.Angle(1) - song.Angle(0), 0.25 * kDegree, 1e-12);
  EXPECT_NEAR(song.Angle(540), 0.0, 1e-12);
  EXPECT_NEAR(song.Angle(1080), 135.0 * kDegree, 1e-12);
  EXPECT_EQ(song.params().max_range, 30.0);
  EXPECT_EQ(song.params().scan_period, 0.025);
  EXPECT_EQ(ring.beams(), 360);
  EXPECT_NEAR(ring.Angle(1) - ring.Angle(0), 1.0 * kDegree, 1e-12);
}

// A wall straight across at 5 m: range = 5 / cos(angle) as far as it reaches.
TEST(Lidar, RangesToAWallAcross) {
  const Lidar lidar(Quiet(SongLidar()));
  LidarScene scene;
  scene.AddBox({{5.5, 0.0}, {0.0, 1.0}, 3.0, 0.5});
  std::vector<double> ranges(1081);
  lidar.Cast(scene, {}, ranges);
  for (int k = 0; k < 1081; ++k) {
    const double angle = lidar.Angle(k);
    if (std::abs(angle) < std::atan2(3.0, 5.0)) {
      EXPECT_NEAR(ranges[k], 5.0 / std::cos(angle), 1e-9) << k;
    } else {
      EXPECT_EQ(ranges[k], std::numeric_limits<double>::infinity()) << k;
    }
  }
}

TEST(Lidar, CastsWhatATextbookRayMeets) {
  const Lidar lidar(Quiet(SongLidar()));
  std::vector<double> ranges(1081);
  int met = 0;
  for (unsigned seed = 0; seed < 20; ++seed) {
    const RandomScene random(seed);
    lidar.Cast(random.scene, {}, ranges);
    for (int k = 0; k < 1081; ++k) {
      double nearest = std::numeric_limits<double>::infinity();
      for (const auto& [a, b] : random.segments)
        nearest = std::min(nearest, RayToSegment(lidar.Angle(k), a, b));
      if (nearest > 30.0) {
        EXPECT_EQ(ranges[k], std::numeric_limits<double>::infinity());
      } else {
        ASSERT_NEAR(ranges[k], nearest, 1e-6) << "seed " << seed << ", beam " << k;
        ++met;
      }
    }
  }
  EXPECT_GT(met, 5000);
}

struct CountCase {
  LidarParams lidar;
  const char* name;
};

class SectorCount : public testing::TestWithParam<CountCase> {};

// The counts without a loop over beams equal those of casting every beam, also with range errors and
// drop-outs.
TEST_P(SectorCount, EqualsCastingEveryBeam) {
  const Lidar lidar(GetParam().lidar);
  std::vector<double> ranges(static_cast<std::size_t>(lidar.beams()));
  const AgentParams params;
  std::int64_t counted = 0;
  for (unsigned seed = 0; seed < 400; ++seed) {
    const RandomScene random(seed);
    AvoidanceZone zone = ZoneForSpeed(params, 1.8, 0.05 * (seed % 300), 0.0);
    if (seed % 5 == 1) zone = {2.0, 9.0, 3.0, 6.0};
    if (seed % 5 == 2) zone = {0.0, 60.0, 50.0, 40.0};
    if (seed % 5 == 3) zone = {0.4, 0.6, 0.6, 0.6};  // [A]
    if (seed % 5 == 4) zone = TurnZone(params, 1.8, 0.02 * (seed % 300));
    const ScanErrors errors(GetParam().lidar, 42, static_cast<std::int32_t>(seed), 7);
    lidar.Cast(random.scene, errors, ranges);
    const SectorCounts cast = lidar.Count(ranges, zone);
    ASSERT_EQ(lidar.CountExactly(random.scene, errors, zone), cast) << "seed " << seed;
    for (const int count : cast) counted += count;
    for (const int min_points : {0, 10, 40}) {
      ASSERT_EQ(lidar.Code(random.scene, errors, zone, min_points), SectorCode(cast, min_points))
          << "seed " << seed << ", more than " << min_points;
    }
  }
  EXPECT_GT(counted, 1000);
}

LidarParams With(LidarParams params, double noise, double dropout) {
  params.range_noise = noise;
  params.dropout = dropout;
  return params;
}

INSTANTIATE_TEST_SUITE_P(Presets, SectorCount,
                         testing::Values(CountCase{With(SongLidar(), 0, 0), "song"},
                                         CountCase{With(RingLidar(), 0, 0), "ring"},
                                         CountCase{With(SongLidar(), 0.01, 0), "song_noise"},
                                         CountCase{With(SongLidar(), 0.3, 0.1), "song_noise_and_dropout"},
                                         CountCase{With(RingLidar(), 0.05, 0.5), "ring_noise_and_dropout"}),
                         [](const auto& info) { return info.param.name; });

// Eq. 8 of [A]: more than t = 10 points block a sector.
TEST(SectorCode, ByEquation8) {
  EXPECT_EQ(SectorCode({0, 10, 11, 90, 0, 0, 0, 0}, 10), 0b11110011);
  EXPECT_EQ(SectorCode({}, 10), 0xff);
  EXPECT_EQ(SectorCode({11, 11, 11, 11, 11, 11, 11, 11}, 10), 0);
}

// A pole 4 m ahead at 30 deg to the left lies in the third sector from the left (45 to 22.5 deg).
TEST(SectorCode, SectorsRunFromLeftToRight) {
  const Lidar lidar(Quiet(SongLidar()));
  LidarScene scene;
  scene.AddBox({{4.0 * std::cos(30 * kDegree), 4.0 * std::sin(30 * kDegree)}, {1.0, 0.0}, 0.3, 0.3});
  const SectorCounts counts = lidar.CountExactly(scene, {}, {0.1, 5.0, 5.0, 5.0});
  EXPECT_GT(counts[2], 10);
  EXPECT_EQ(SectorCode(counts, 10), 0b11111011);
}

// What drives away at our speed needs no braking distance; the rest grows with speed: v = 10: 5 + 3.25
// + 12.5.
TEST(AvoidanceZone, GrowsWithReactionAndBraking) {
  AgentParams params;
  params.sector.standstill = 5.0;
  params.sector.side_clearance = 0.4;
  EXPECT_NEAR(ZoneForSpeed(params, 1.8, 0.0).far, 5.0, 1e-12);
  EXPECT_NEAR(ZoneForSpeed(params, 1.8, 10.0).far, 20.75, 1e-12);
  EXPECT_NEAR(ZoneForSpeed(params, 1.8, 10.0, 10.0).far, 8.25, 1e-12);
  EXPECT_NEAR(ZoneForSpeed(params, 1.8, 10.0).half_width, 1.3, 1e-12);
  EXPECT_EQ(ZoneForSpeed(params, 1.8, 30.0).far, 30.0);  // The lidar's range.
}

// Ahead it grows with speed as the other one does; beside, it is a strip. A thing 6 m to the side is not in
// it.
TEST(AvoidanceZone, ToTurnInIsAStrip) {
  AgentParams params;
  params.sector.turn_reach = 10.0;
  params.sector.turn_width = 5.0;
  EXPECT_NEAR(TurnZone(params, 1.8, 0.0).far, 10.0, 1e-12);
  EXPECT_NEAR(TurnZone(params, 1.8, 10.0).far, 10.0 + 3.25 + 12.5, 1e-12);
  const AvoidanceZone zone = TurnZone(params, 1.8, 0.0);
  EXPECT_EQ(DrawnIn(zone, 0.5).far, 5.0);
  EXPECT_EQ(DrawnIn(zone, 0.5).side, 5.0);
  const Lidar lidar(Quiet(SongLidar()));
  for (const auto& [beside, free] : {std::pair{6.0, true}, std::pair{4.5, false}}) {
    LidarScene scene;
    scene.AddEdge({2.0, beside}, {7.0, beside});
    EXPECT_EQ(SectorCode(lidar.CountExactly(scene, {}, zone), 10) == 0xff, free) << beside;
  }
}

// A function of (seed, vehicle, step), with the wanted deviation and share.
TEST(ScanErrors, AreReproducibleAndOfTheRightSize) {
  const LidarParams params = With(SongLidar(), 0.05, 0.25);
  const ScanErrors errors(params, 1, 2, 3), same(params, 1, 2, 3), other(params, 1, 2, 4);
  double sum = 0.0, squares = 0.0;
  int dropped = 0, equal = 0;
  const int n = 4096;
  for (int k = 0; k < n; ++k) {
    const double e = errors.RangeError(k);
    EXPECT_EQ(e, same.RangeError(k));
    EXPECT_EQ(errors.Dropped(k), same.Dropped(k));
    EXPECT_LE(std::abs(e), errors.max_range_error());
    equal += e == other.RangeError(k);
    sum += e;
    squares += e * e;
    dropped += errors.Dropped(k);
  }
  EXPECT_EQ(equal, 0);
  EXPECT_NEAR(sum / n, 0.0, 4 * 0.05 / std::sqrt(n));
  EXPECT_NEAR(std::sqrt(squares / n), 0.05, 0.003);
  EXPECT_NEAR(dropped, 0.25 * n, 4 * std::sqrt(n * 0.25 * 0.75));
}

TEST(LidarScene, IsReusedWithoutAllocation) {
  const Lidar lidar(SongLidar());
  LidarScene scene;
  const auto scan = [&](std::int64_t step) {
    scene.Clear();
    for (int k = 0; k < 12; ++k) scene.AddBox({{3.0 + 2.0 * k, (k % 5) - 2.0}, {1.0, 0.0}, 2.3, 0.9});
    return lidar.CountExactly(scene, ScanErrors(SongLidar(), 1, 1, step), {0.1, 20.0, 1.3, 8.0});
  };
  scan(0);
  const AllocationCounter counter;
  const SectorCounts counts = scan(1);
  EXPECT_EQ(counter.count(), 0);
  EXPECT_GT(counts[3], 0);
}

}  // namespace
}  // namespace lanewise
