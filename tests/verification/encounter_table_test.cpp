// Encounters worked out by hand, as the safety monitor reports them: TTC, DRAC and PET to 1e-9, whichever way
// the scene is turned.

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include "analysis/safety_monitor.h"

namespace lanewise {
namespace {

constexpr double kStep = 0.1;  // [s]
constexpr double kNorth = std::numbers::pi / 2.0, kWest = std::numbers::pi;
const double kRoot3 = std::sqrt(3.0);

/// Drives straight on at constant speed.
struct Mover {
  double x, y, heading, speed;  // Middle of the front bumper at time 0.
  double length, width;
  bool pedestrian{false};
};

struct Case {
  std::string name;
  Mover first, second;
  double end;  // [s] watched from 0 until then.
  EncounterType type;
  std::optional<double> ttc, drac, pet;  // Nothing: undefined.
};

// East and north share the square |x| <= 0.9, |y| <= 1 (north is 1.8 m wide, east 2 m). East is in it from
// (20 - 0.9) / 10 = 1.91 s to (20 + 0.9 + 5) / 10 = 2.59 s.
constexpr Mover kEast{-20.0, 0.0, 0.0, 10.0, 5.0, 2.0};
constexpr Mover kStanding{0.0, 0.0, 0.0, 0.0, 5.0, 2.0};

const Case kCases[] = {
    // Gap 25 m, closing at 10 m/s; after 1 s it is 15 m: 15 / 10, and 10^2 / (2 * 15).
    {"a slower leader",
     {0.0, 0.0, 0.0, 20.0, 5.0, 2.0},
     {30.0, 0.0, 0.0, 10.0, 5.0, 2.0},
     1.0,
     EncounterType::kFollowing,
     1.5,
     100.0 / 30.0,
     {}},
    // Gap 30 m, after 0.5 s 24 m: 24 / 12, and 12^2 / (2 * 24).
    {"a standing leader",
     {-35.0, 0.0, 0.0, 12.0, 5.0, 2.0},
     kStanding,
     0.5,
     EncounterType::kFollowing,
     2.0,
     3.0,
     {}},
    // Half a metre to the side is still in its way.
    {"a truck half aside",
     {-35.0, 0.5, 0.0, 12.0, 10.0, 2.5},
     kStanding,
     0.5,
     EncounterType::kFollowing,
     2.0,
     3.0,
     {}},
    // 50 m apart, closing at 25 m/s; after 0.4 s 40 m. Braking does not help against who comes on.
    {"head-on",
     {0.0, 0.0, 0.0, 10.0, 5.0, 2.0},
     {50.0, 0.0, kWest, 15.0, 5.0, 2.0},
     0.4,
     EncounterType::kOncoming,
     1.6,
     {},
     {}},
    // North's front, 17 m before the middle, is in the square from (17 - 1) / 8 = 2 s to (17 + 1 + 4) / 8 =
    // 2.75 s. Milder than east's waiting for 2.75 s is north's for 2.59 s: 2 (8 - 16 / 2.59) / 2.59.
    {"crossing on collision course",
     kEast,
     {0.0, -17.0, kNorth, 8.0, 4.0, 1.8},
     0.0,
     EncounterType::kCrossing,
     2.0,
     2.0 * (8.0 - 16.0 / 2.59) / 2.59,
     {}},
    // North enters at (33 - 1) / 8 = 4 s, 1.41 s after east has left.
    {"crossing behind",
     kEast,
     {0.0, -33.0, kNorth, 8.0, 4.0, 1.8},
     6.0,
     EncounterType::kCrossing,
     {},
     {},
     4.0 - 2.59},
    // North has left at (4 + 1 + 4) / 8 = 1.125 s, east enters at 1.91 s.
    {"crossing before",
     kEast,
     {0.0, -4.0, kNorth, 8.0, 4.0, 1.8},
     6.0,
     EncounterType::kCrossing,
     {},
     {},
     1.91 - 1.125},
    // The left corner of the front, 0.5 m ahead of it in y, has 6.5 m in y to go, 13 / sqrt(3) m along its
    // way
    // at 60 degrees, to the side of one that stands; it has to stand by then.
    {"into a flank at 60 degrees",
     kStanding,
     {-7.0, -8.0, std::numbers::pi / 3.0, 6.0, 5.0, 2.0},
     0.0,
     EncounterType::kCrossing,
     13.0 / kRoot3 / 6.0,
     36.0 * kRoot3 / 26.0,
     {}},
    // A cyclist, 0.6 m wide, is in |x| <= 0.3, |y| <= 1 from (17 - 1) / 5 = 3.2 s; east has left it at
    // (20 + 0.3 + 5) / 10 = 2.53 s.
    {"a cyclist behind a car",
     kEast,
     {0.0, -17.0, kNorth, 5.0, 1.6, 0.6},
     6.0,
     EncounterType::kCrossing,
     {},
     {},
     3.2 - 2.53},
    // A walker, 0.3 m deep and 0.5 m wide, has left the car's way at (1 + 0.3 + 2) / 1.5 = 2.2 s; the car
    // reaches the walker's strip at (32.25 - 0.25) / 10 = 3.2 s.
    {"a car behind a walker",
     {-32.25, 0.0, 0.0, 10.0, 5.0, 2.0},
     {0.0, -2.0, kNorth, 1.5, 0.3, 0.5, true},
     6.0,
     EncounterType::kCrossing,
     {},
     {},
     3.2 - 2.2},
    // One who stands in the car's way, 18 m ahead of its front: the walker's back is 0.3 m behind its front.
    {"a walker who stands",
     {0.0, 0.0, 0.0, 12.0, 5.0, 2.0},
     {18.3, 0.0, 0.0, 0.0, 0.3, 0.5, true},
     0.0,
     EncounterType::kFollowing,
     1.5,
     4.0,
     {}},
};

TrafficFrame FrameOf(const Case& c, double turned, std::int64_t step) {
  TrafficFrame frame;
  frame.Resize(2);
  frame.step = step;
  frame.time = kStep * static_cast<double>(step);
  const double cosine = std::cos(turned), sine = std::sin(turned);
  for (std::size_t i = 0; i < 2; ++i) {
    const Mover& m = i == 0 ? c.first : c.second;
    const double x = m.x + m.speed * std::cos(m.heading) * frame.time;
    const double y = m.y + m.speed * std::sin(m.heading) * frame.time;
    frame.vehicle_number[i] = static_cast<std::int32_t>(i);
    frame.x[i] = cosine * x - sine * y;
    frame.y[i] = sine * x + cosine * y;
    frame.heading[i] = WrapAngle(m.heading + turned);
    frame.speed[i] = m.speed;
    frame.vx[i] = m.speed * std::cos(m.heading + turned);
    frame.vy[i] = m.speed * std::sin(m.heading + turned);
    frame.length[i] = m.length;
    frame.width[i] = m.width;
    frame.pedestrian[i] = m.pedestrian;
  }
  return frame;
}

void ExpectMeasure(const std::optional<double>& expected, double measured, double undefined) {
  if (expected) {
    EXPECT_NEAR(measured, *expected, 1e-9);
  } else {
    EXPECT_EQ(measured, undefined);
  }
}

TEST(EncounterTable, HasTtcDracAndPetByHand) {
  for (const Case& c : kCases) {
    for (const double turned : {0.0, 0.7, -2.3}) {
      SCOPED_TRACE(c.name + ", turned by " + std::to_string(turned));
      SafetyMonitor monitor;
      for (std::int64_t step = 0; step <= std::llround(c.end / kStep); ++step)
        monitor.Observe(FrameOf(c, turned, step));
      monitor.Finish();
      const std::vector<Encounter> encounters = monitor.TakeFinishedEncounters();
      ASSERT_EQ(encounters.size(), 1u);
      const Encounter& e = encounters[0];
      EXPECT_EQ(e.type, c.type);
      EXPECT_FALSE(e.contact);
      ExpectMeasure(c.ttc, e.min_ttc, Encounter::kUndefined);
      ExpectMeasure(c.drac, e.max_drac, 0.0);
      ExpectMeasure(c.pet, e.pet, Encounter::kUndefined);
    }
  }
}

}  // namespace
}  // namespace lanewise
