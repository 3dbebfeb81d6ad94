#include "analysis/safety_monitor.h"

#include <gtest/gtest.h>
#include <omp.h>

#include <cmath>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "tests/support/small_nets.h"

namespace lanewise {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kStep = 0.1;

/// A road user on a straight line at constant speed; 5 m x 2 m unless told otherwise.
struct Mover {
  double x{0.0}, y{0.0};  // Front bumper at time 0.
  double heading{0.0};
  double speed{0.0};
  bool agent{false};
  double vx_extra{0.0}, vy_extra{0.0};  // [m/s] sliding, besides the motion along the heading.
  bool planned_stop{false}, pedestrian{false}, in_junction{false};
  double length{5.0}, width{2.0};
};

TrafficFrame FrameOf(const std::vector<Mover>& movers, std::int64_t step) {
  TrafficFrame frame;
  frame.Resize(movers.size());
  frame.step = step;
  frame.time = static_cast<double>(step) * kStep;
  for (std::size_t i = 0; i < movers.size(); ++i) {
    const Mover& m = movers[i];
    frame.vehicle_number[i] = static_cast<std::int32_t>(i);
    frame.vx[i] = m.speed * std::cos(m.heading) + m.vx_extra;
    frame.vy[i] = m.speed * std::sin(m.heading) + m.vy_extra;
    frame.x[i] = m.x + frame.vx[i] * frame.time;
    frame.y[i] = m.y + frame.vy[i] * frame.time;
    frame.heading[i] = m.heading;
    frame.speed[i] = m.speed;
    frame.length[i] = m.length;
    frame.width[i] = m.width;
    frame.lane[i] = static_cast<LaneIndex>(10 + i);
    frame.agent_driven[i] = m.agent;
    frame.planned_stop[i] = m.planned_stop;
    frame.pedestrian[i] = m.pedestrian;
    frame.in_junction[i] = m.in_junction;
  }
  return frame;
}

struct Events {
  std::vector<Contact> contacts;
  std::vector<Encounter> encounters;
};

Events Watch(const std::vector<Mover>& movers, int steps) {
  SafetyMonitor monitor;
  for (int k = 0; k < steps; ++k) monitor.Observe(FrameOf(movers, k));
  monitor.Finish();
  return {monitor.TakeFinishedContacts(), monitor.TakeFinishedEncounters()};
}

std::int32_t StrikingOf(const std::vector<Mover>& movers) {
  const Events events = Watch(movers, 60);
  EXPECT_EQ(events.contacts.size(), 1u);
  return events.contacts.empty() ? -2 : events.contacts[0].striking;
}

TEST(SafetyMonitor, EncounterOfFollowingHasItsClosedFormTtc) {
  // Gap 25 m at first, closing at 10 m/s; seen until 1.4 s: TTC from 2.5 down to 1.1 s.
  const Events events = Watch({{.x = 0.0, .speed = 20.0}, {.x = 30.0, .speed = 10.0, .agent = true}}, 15);
  EXPECT_TRUE(events.contacts.empty());
  ASSERT_EQ(events.encounters.size(), 1u);
  const Encounter& e = events.encounters[0];
  EXPECT_EQ(e.first, 0);
  EXPECT_EQ(e.second, 1);
  EXPECT_FALSE(e.first_agent);
  EXPECT_TRUE(e.second_agent);
  EXPECT_NEAR(e.min_ttc, 1.1, 1e-9);
  EXPECT_NEAR(e.min_ttc_time, 1.4, 1e-9);
  EXPECT_NEAR(e.begin, 0.0, 1e-9);
  EXPECT_NEAR(e.end, 1.4, 1e-9);
  EXPECT_NEAR(e.x, 0.5 * (28.0 + 44.0), 1e-9);
  EXPECT_EQ(e.first_lane, 10);
  EXPECT_EQ(e.second_lane, 11);
  EXPECT_TRUE(e.near_miss);
  EXPECT_FALSE(e.contact);
}

TEST(SafetyMonitor, EncounterAboveTheNearMissThresholdIsNone) {
  const Events events = Watch({{.x = 0.0, .speed = 20.0}, {.x = 30.0, .speed = 10.0}}, 10);  // Down to 1.6 s.
  ASSERT_EQ(events.encounters.size(), 1u);
  EXPECT_NEAR(events.encounters[0].min_ttc, 1.6, 1e-9);
  EXPECT_FALSE(events.encounters[0].near_miss);
}

TEST(SafetyMonitor, SeesNothingInSafeTraffic) {
  const Events events = Watch({{.x = 0.0, .speed = 15.0},
                               {.x = 30.0, .speed = 15.0},                            // Same speed.
                               {.x = 40.0, .y = 3.2, .heading = kPi, .speed = 15.0},  // Opposite lane.
                               {.x = 2.0, .y = -3.2, .speed = 10.0}},                 // Being passed.
                              60);
  EXPECT_TRUE(events.contacts.empty());
  EXPECT_TRUE(events.encounters.empty());
}

TEST(SafetyMonitor, ReportsTheSmallestTtcOfEachRow) {
  SafetyMonitor monitor;
  monitor.Observe(FrameOf({{.x = 0.0, .speed = 20.0}, {.x = 25.0, .speed = 10.0}, {.x = 500.0}}, 0));
  ASSERT_EQ(monitor.row_ttc().size(), 3u);
  EXPECT_NEAR(monitor.row_ttc()[0], 2.0, 1e-9);
  EXPECT_NEAR(monitor.row_ttc()[1], 2.0, 1e-9);
  EXPECT_TRUE(std::isinf(monitor.row_ttc()[2]));
}

TEST(SafetyMonitor, FindsFastPairsFarApart) {
  // Closing at 100 m/s over 250 m: 2.45 s. Neither is within the other's car-length neighborhood.
  SafetyMonitor monitor;
  monitor.Observe(FrameOf({{.x = 0.0, .speed = 50.0}, {.x = 245.0, .heading = kPi, .speed = 50.0}}, 0));
  EXPECT_NEAR(monitor.row_ttc()[0], 2.45, 1e-9);
}

TEST(SafetyMonitor, ContactOfARearEndIsCountedOnceAndTheFollowerStrikes) {
  const Events events =
      Watch({{.x = 10.0, .speed = 5.0}, {.x = 0.0, .speed = 15.0, .agent = true, .in_junction = true}}, 40);
  ASSERT_EQ(events.contacts.size(), 1u);
  const Contact& c = events.contacts[0];
  EXPECT_EQ(c.striking, 1);
  EXPECT_TRUE(c.striking_agent());
  EXPECT_TRUE(c.in_junction);
  EXPECT_NEAR(c.begin, 0.6, 1e-9);  // Touching at 0.5 s exactly; overlap in the next step.
  EXPECT_NEAR(c.end, 1.4, 1e-9);    // Through it at 1.5 s.
  EXPECT_NEAR(c.closing_speed, 10.0, 1e-9);
  EXPECT_NEAR(c.x, 7.5, 0.06);  // The bumpers meet at 7.5 m.
  EXPECT_NEAR(c.y, 0.0, 1e-9);
  EXPECT_NEAR(c.max_depth, 2.0, 1e-9);  // Drawn apart sideways it takes a car's width.
  ASSERT_EQ(events.encounters.size(), 1u);
  EXPECT_TRUE(events.encounters[0].contact);
  EXPECT_FALSE(events.encounters[0].near_miss);
  EXPECT_EQ(events.encounters[0].min_ttc, 0.0);
}

/// Two cars nose to tail, in contact at the given steps.
std::vector<Contact> TouchingAt(const std::vector<int>& steps, int end) {
  SafetyMonitor monitor;
  for (int k = 0; k < end; ++k) {
    const bool touch = std::find(steps.begin(), steps.end(), k) != steps.end();
    TrafficFrame frame = FrameOf({{.x = 0.0}, {.x = touch ? 4.9 : 6.0}}, k);
    frame.speed[0] = frame.vx[0] = 1.0;
    monitor.Observe(frame);
  }
  monitor.Finish();
  EXPECT_EQ(static_cast<std::size_t>(monitor.contact_count()),
            1u + (steps.back() - steps.front() > 20 ? 1u : 0u));
  return monitor.TakeFinishedContacts();
}

TEST(SafetyMonitor, TouchingAgainWithinTwoSecondsIsTheSameContact) {
  const std::vector<Contact> contacts = TouchingAt({5, 24}, 60);
  ASSERT_EQ(contacts.size(), 1u);
  EXPECT_NEAR(contacts[0].begin, 0.5, 1e-9);
  EXPECT_NEAR(contacts[0].end, 2.4, 1e-9);
}

TEST(SafetyMonitor, TouchingAgainLaterIsAnother) {
  EXPECT_EQ(TouchingAt({5, 27}, 60).size(), 2u);
}

TEST(SafetyMonitor, HandsOverWhatEndedAndForgetsIt) {
  SafetyMonitor monitor;
  const std::vector<Mover> movers{{.x = 10.0, .speed = 5.0}, {.x = 0.0, .speed = 15.0}};
  for (int k = 0; k < 65; ++k) monitor.Observe(FrameOf(movers, k));
  EXPECT_EQ(monitor.TakeFinishedContacts().size(), 1u);    // Apart for 2 s at 3.4 s; no Finish needed.
  EXPECT_EQ(monitor.TakeFinishedEncounters().size(), 1u);  // Nor can a PET become known any more, of 2 s.
  monitor.Finish();
  EXPECT_TRUE(monitor.TakeFinishedContacts().empty());
  EXPECT_TRUE(monitor.TakeFinishedEncounters().empty());
}

TEST(SafetyMonitor, SkipsPedestrianPairsAndPairsAtPlannedStops) {
  const Events events = Watch({{.x = 0.0, .speed = 1.0, .pedestrian = true, .length = 0.3, .width = 0.5},
                               {.x = 1.0, .pedestrian = true, .length = 0.3, .width = 0.5},
                               {.x = 50.0, .planned_stop = true},
                               {.x = 53.0, .planned_stop = true}},
                              40);
  EXPECT_TRUE(events.contacts.empty());
  EXPECT_TRUE(events.encounters.empty());
}

TEST(SafetyMonitor, AQueueStandingBumperToBumperIsNoConflict) {
  const Events events = Watch({{.x = 0.0}, {.x = 5.0}, {.x = 10.0}}, 20);
  EXPECT_TRUE(events.contacts.empty());
  EXPECT_TRUE(events.encounters.empty());
}

/// Puts a mover on a lane of a network, its position there as told; the path as far as it is given.
void PutOnLane(const RoadNetwork& network, std::size_t row, const std::vector<std::string>& path,
               double lane_pos, TrafficFrame* frame) {
  for (std::size_t k = 0; k < path.size(); ++k) frame->path[row].lane[k] = network.FindLane(path[k]);
  frame->lane[row] = frame->path[row].lane[0];
  frame->lane_pos[row] = lane_pos;
}

std::vector<Encounter> WatchFrames(const RoadNetwork& network, const std::vector<TrafficFrame>& frames) {
  SafetyMonitor monitor({}, &network);
  for (const TrafficFrame& frame : frames) monitor.Observe(frame);
  monitor.Finish();
  return monitor.TakeFinishedEncounters();
}

TEST(SafetyMonitor, EncounterHasAllItsMeasuresByHand) {
  // 12 m/s towards a standing one 18 m ahead, braking with 3 m/s^2: TTC 1.5, DRAC 144 / 36 = 4, MTTC 2 (12 *
  // 2 - 1.5 * 4 = 18).
  TrafficFrame frame = FrameOf({{.x = 0.0, .speed = 12.0}, {.x = 23.0}}, 0);
  frame.accel[0] = -3.0;
  SafetyMonitor monitor;
  monitor.Observe(frame);
  EXPECT_NEAR(monitor.row_drac()[1], 4.0, 1e-9);
  monitor.Finish();
  const std::vector<Encounter> encounters = monitor.TakeFinishedEncounters();
  ASSERT_EQ(encounters.size(), 1u);
  const Encounter& e = encounters[0];
  EXPECT_EQ(e.type, EncounterType::kFollowing);
  EXPECT_TRUE(e.ego_is_first);
  EXPECT_NEAR(e.min_ttc, 1.5, 1e-9);
  EXPECT_NEAR(e.max_drac, 4.0, 1e-9);
  EXPECT_NEAR(e.min_mttc, 2.0, 1e-9);
  EXPECT_NEAR(e.max_closing_speed, 12.0, 1e-9);
  EXPECT_NEAR(e.min_distance, 18.0, 1e-9);
  EXPECT_EQ(e.severity, Severity::kConflict);  // 1.5 s is not below 1.5 s.
  EXPECT_EQ(e.pet, Encounter::kUndefined);
}

TEST(SafetyMonitor, CrossingHasTtcAndDrac) {
  // As in conflict_geometry_test: east is in the shared square from 1.91 to 2.59 s, north (1) from 2 to 2.75
  // s.
  SafetyMonitor monitor;
  monitor.Observe(FrameOf({{.x = -20.0, .speed = 10.0},
                           {.y = -17.0, .heading = kPi / 2.0, .speed = 8.0, .length = 4.0, .width = 1.8}},
                          0));
  monitor.Finish();
  const std::vector<Encounter> encounters = monitor.TakeFinishedEncounters();
  ASSERT_EQ(encounters.size(), 1u);
  EXPECT_EQ(encounters[0].type, EncounterType::kCrossing);
  EXPECT_FALSE(encounters[0].ego_is_first);  // North comes second.
  EXPECT_NEAR(encounters[0].min_ttc, 2.0, 1e-9);
  EXPECT_NEAR(encounters[0].max_drac, 16.0 * 0.59 / (2.59 * 2.59), 1e-9);
  EXPECT_NEAR(encounters[0].max_closing_speed, std::sqrt(164.0), 1e-9);
}

TEST(SafetyMonitor, PetOfACrossingIsEntryMinusExit) {
  // North's front 33 m before the middle: it enters at 4 s, east has left at 2.59 s. Never on collision
  // course.
  const Events events = Watch({{.x = -20.0, .speed = 10.0},
                               {.y = -33.0, .heading = kPi / 2.0, .speed = 8.0, .length = 4.0, .width = 1.8}},
                              60);
  ASSERT_EQ(events.encounters.size(), 1u);
  const Encounter& e = events.encounters[0];
  EXPECT_NEAR(e.pet, 1.41, 1e-9);
  EXPECT_NEAR(e.pet_time, 4.0, 1e-9);
  EXPECT_NEAR(e.begin, 2.59, 1e-9);
  EXPECT_NEAR(e.end, 4.0, 1e-9);
  EXPECT_NEAR(e.critical, 4.0, 1e-9);
  EXPECT_EQ(e.min_ttc, Encounter::kUndefined);
  EXPECT_EQ(e.type, EncounterType::kCrossing);
  EXPECT_FALSE(e.ego_is_first);
  EXPECT_FALSE(e.near_miss);
}

/// East as above; north, on collision course until `slows` [s], then at 3 m/s: it enters at 4 s, if at 0.8 s.
std::vector<Encounter> WatchOneWhoGivesWay(double slows) {
  SafetyMonitor monitor;
  for (int k = 0; k < 80; ++k) {
    TrafficFrame frame =
        FrameOf({{.x = -20.0, .speed = 10.0},
                 {.y = -17.0, .heading = kPi / 2.0, .speed = 8.0, .length = 4.0, .width = 1.8}},
                k);
    if (frame.time > slows + 1e-9) {
      frame.y[1] = -17.0 + 8.0 * slows + 3.0 * (frame.time - slows);
      frame.speed[1] = frame.vy[1] = 3.0;
    }
    monitor.Observe(frame);
  }
  monitor.Finish();
  return monitor.TakeFinishedEncounters();
}

TEST(SafetyMonitor, APetWithinTwoSecondsOfTheEndBelongsToTheEncounter) {
  // TTC 2 - 0.8 s when it slows; east leaves 1.79 s later.
  const std::vector<Encounter> one = WatchOneWhoGivesWay(0.8);
  ASSERT_EQ(one.size(), 1u);
  EXPECT_NEAR(one[0].begin, 0.0, 1e-9);
  EXPECT_NEAR(one[0].end, 4.0, 1e-9);
  EXPECT_NEAR(one[0].min_ttc, 1.2, 1e-9);
  EXPECT_NEAR(one[0].critical, 0.8, 1e-9);
  EXPECT_NEAR(one[0].pet, 4.0 - 2.59, 1e-9);
  // East leaves 2.09 s after: another encounter. Its way takes it (17 - 1 - 4) / 3 s from 0.5 s on.
  const std::vector<Encounter> two = WatchOneWhoGivesWay(0.5);
  ASSERT_EQ(two.size(), 2u);
  EXPECT_NEAR(two[0].min_ttc, 1.5, 1e-9);
  EXPECT_NEAR(two[0].end, 0.5, 1e-9);
  EXPECT_EQ(two[0].pet, Encounter::kUndefined);
  EXPECT_NEAR(two[1].pet, 4.5 - 2.59, 1e-9);
  EXPECT_EQ(two[1].min_ttc, Encounter::kUndefined);
}

TEST(SafetyMonitor, PetKnowsPedestriansAndThresholds) {
  // A walker, 0.3 m deep and 0.5 m wide, leaves the car's strip (|y| <= 1) northward: its back at y = 1 at t
  // = (1 + 0.3 + 2) / 1.5 = 2.2 s. The car's front reaches the walker's strip, x = -0.25, at (x + 0.25) / 10
  // before 0.
  const auto pet = [](double car_x) {
    const Events events = Watch(
        {{.y = -2.0, .heading = kPi / 2.0, .speed = 1.5, .pedestrian = true, .length = 0.3, .width = 0.5},
         {.x = car_x, .speed = 10.0}},
        80);
    return events.encounters.empty() ? -1.0 : events.encounters[0].pet;
  };
  EXPECT_NEAR(pet(-32.25), 3.2 - 2.2, 1e-9);
  EXPECT_NEAR(pet(-40.25), 4.0 - 2.2, 1e-9);
  EXPECT_EQ(pet(-43.25), -1.0);  // 2.1 s: above the threshold.
}

TEST(SafetyMonitor, FollowersOnABendAreMeasuredAlongIt) {
  // On an arc of radius 40 m, 12 m/s behind 6 m/s: front to front 20 m along the lane, so 15 m of gap and 2.5
  // s. In straight lines the follower would pass the leader by.
  const RoadNetwork network = BendNet(40.0, 1.5);
  const auto at = [](double s, double speed) {
    const double a = s / 40.0;
    return Mover{.x = 40.0 * std::sin(a), .y = 40.0 * (1.0 - std::cos(a)), .heading = a, .speed = speed};
  };
  TrafficFrame frame = FrameOf({at(10.0, 12.0), at(30.0, 6.0)}, 0);
  PutOnLane(network, 0, {"bend_0"}, 10.0, &frame);
  PutOnLane(network, 1, {"bend_0"}, 30.0, &frame);
  const std::vector<Encounter> encounters = WatchFrames(network, {frame});
  ASSERT_EQ(encounters.size(), 1u);
  EXPECT_EQ(encounters[0].type, EncounterType::kFollowing);
  EXPECT_NEAR(encounters[0].min_ttc, 2.5, 1e-9);
  EXPECT_NEAR(encounters[0].max_drac, 36.0 / 30.0, 1e-9);
  EXPECT_TRUE(encounters[0].ego_is_first);
}

TEST(SafetyMonitor, FollowersAreFoundAcrossJunctions) {
  // Fronts at 95 m of e0 and 12 m of e1, 8 m of junction between: 25 m apart, gap 20 m, closing at 8 m/s.
  const RoadNetwork network = ChainNet(2, 1, 100.0);
  TrafficFrame frame = FrameOf({{.x = 95.0, .speed = 10.0}, {.x = 120.0, .speed = 2.0}}, 0);
  PutOnLane(network, 0, {"e0_0", ":J1_0_0", "e1_0"}, 95.0, &frame);
  PutOnLane(network, 1, {"e1_0"}, 12.0, &frame);
  const std::vector<Encounter> encounters = WatchFrames(network, {frame});
  ASSERT_EQ(encounters.size(), 1u);
  EXPECT_NEAR(encounters[0].min_ttc, 2.5, 1e-9);
}

TEST(SafetyMonitor, OncomingOnesOnABendFollowTheirLanesPastEachOther) {
  // 30 m apart on arcs of 30 and 33.2 m: straight on, the outer one would run into the inner one's way.
  const RoadNetwork network = BendNet(30.0, 1.5, /*two_way=*/true);
  const auto at = [](double radius, double a, double turn) {
    return Mover{
        .x = radius * std::sin(a), .y = 30.0 - radius * std::cos(a), .heading = a + turn, .speed = 10.0};
  };
  const TrafficFrame straight = FrameOf({at(30.0, 0.4, 0.0), at(30.0 + kLaneWidth, 1.3, kPi)}, 0);
  TrafficFrame frame = straight;
  PutOnLane(network, 0, {"bend_0"}, 30.0 * 0.4, &frame);
  PutOnLane(network, 1, {"back_0"}, (30.0 + kLaneWidth) * 0.2, &frame);
  EXPECT_EQ(WatchFrames(network, {straight}).size(), 1u);  // Lanes unknown.
  EXPECT_TRUE(WatchFrames(network, {frame}).empty());
}

TEST(SafetyMonitor, TurningAcrossAnOncomingOneIsACrossing) {
  // Along an arc of 10 m radius at 5 m/s, through the way of one who comes straight at it on the next lane:
  // at present they would pass each other by. Expected: both moved on in small steps.
  constexpr double kRadius = 10.0, kSpeed = 5.0, kOncomingSpeed = 10.0, kOncomingX = 26.0;
  const RoadNetwork network = BendNet(kRadius, 1.5);
  const auto on_arc = [&](double s) {  // Both bumpers on the arc, as SUMO draws it.
    const auto point = [&](double at) {
      const double a = at / kRadius;
      return a < 0.0 ? Point2{at, 0.0} : Point2{kRadius * std::sin(a), kRadius * (1.0 - std::cos(a))};
    };
    const Point2 front = point(s), rear = point(s - 5.0);
    return Footprint{{front.x, front.y, std::atan2(front.y - rear.y, front.x - rear.x)}, 5.0, 2.0};
  };
  double expected = 0.0;
  while (PenetrationDepth(on_arc(5.0 + kSpeed * expected),
                          {{kOncomingX - kOncomingSpeed * expected, kLaneWidth, kPi}, 5.0, 2.0}) <= 0.0)
    expected += 1e-4;

  const Footprint turning = on_arc(5.0);
  TrafficFrame frame = FrameOf(
      {{.x = turning.front.x, .y = turning.front.y, .heading = turning.front.heading, .speed = kSpeed},
       {.x = kOncomingX, .y = kLaneWidth, .heading = kPi, .speed = kOncomingSpeed}},
      0);
  PutOnLane(network, 0, {"bend_0"}, 5.0, &frame);
  const std::vector<Encounter> encounters = WatchFrames(network, {frame});
  ASSERT_EQ(encounters.size(), 1u);
  EXPECT_NEAR(encounters[0].min_ttc, expected, 0.03);
  EXPECT_GT(encounters[0].min_ttc, 0.5);
  EXPECT_EQ(encounters[0].type, EncounterType::kCrossing);
  EXPECT_GT(encounters[0].max_drac, 0.0);
}

TEST(SafetyMonitor, WhoKeepsItsLaneBesideAnotherIsNoConflictUntilItLeavesIt) {
  // Headings 0.1 rad towards each other, as on a bend: in straight lines they would touch.
  const RoadNetwork network = ChainNet(1, 2, 500.0);
  const auto run = [&](double lateral_speed, double lateral_offset) {
    TrafficFrame frame = FrameOf({{.x = 100.0, .heading = 0.1, .speed = 10.0},
                                  {.x = 102.0, .y = kLaneWidth, .heading = -0.1, .speed = 10.0}},
                                 0);
    frame.y[0] = lateral_offset;
    PutOnLane(network, 0, {"e0_0"}, 100.0, &frame);
    PutOnLane(network, 1, {"e0_1"}, 102.0, &frame);
    frame.lateral_speed[0] = lateral_speed;
    frame.lateral_offset[0] = lateral_offset;
    return WatchFrames(network, {frame});
  };
  EXPECT_TRUE(run(0.0, 0.0).empty());
  const std::vector<Encounter> swerving = run(1.0, 0.0);
  ASSERT_EQ(swerving.size(), 1u);
  EXPECT_EQ(swerving[0].type, EncounterType::kSideSwipe);
  const std::vector<Encounter> across = run(0.3, 0.8);  // 0.8 + 1 m reach beyond 1.6 m.
  ASSERT_EQ(across.size(), 1u);
  EXPECT_EQ(across[0].type, EncounterType::kStraddling);
}

TEST(SafetyMonitor, DeltaVFollowsTheMasses) {
  SafetyMonitor monitor;
  for (int k = 0; k < 40; ++k) {
    TrafficFrame frame = FrameOf({{.x = 10.0, .speed = 5.0}, {.x = 0.0, .speed = 15.0}}, k);
    frame.mass = {1500.0, 500.0};
    monitor.Observe(frame);
  }
  monitor.Finish();
  const std::vector<Encounter> encounters = monitor.TakeFinishedEncounters();
  ASSERT_EQ(encounters.size(), 1u);
  EXPECT_EQ(encounters[0].severity, Severity::kContact);
  EXPECT_EQ(encounters[0].min_distance, 0.0);
  EXPECT_NEAR(encounters[0].first_delta_v, 2.5, 1e-9);  // 10 m/s * 500 / 2000.
  EXPECT_NEAR(encounters[0].second_delta_v, 7.5, 1e-9);
}

TEST(SafetyMonitor, KeepsBothTrajectoriesAroundTheCriticalMoment) {
  // Closing until 3 s, then the leader drives off: the smallest TTC is at 3 s.
  SafetyMonitor monitor;
  for (int k = 0; k < 100; ++k) {
    const bool closing = k <= 30;
    TrafficFrame frame = FrameOf({{.x = 0.0, .speed = 14.0}, {.x = 45.0, .speed = 4.0}}, std::min(k, 30));
    frame.time = 0.1 * k;
    frame.speed[1] = frame.vx[1] = closing ? 4.0 : 20.0;
    monitor.Observe(frame);
  }
  monitor.Finish();
  const std::vector<Encounter> encounters = monitor.TakeFinishedEncounters();
  ASSERT_EQ(encounters.size(), 1u);
  EXPECT_NEAR(encounters[0].min_ttc_time, 3.0, 1e-9);
  const std::vector<EncounterSample> samples = monitor.TakeFinishedSamples();
  std::size_t measured = 0;
  for (const EncounterSample& s : samples) {
    if (s.ttc == Encounter::kUndefined) continue;
    ++measured;
    EXPECT_LE(s.time, 3.0 + 1e-9);                                   // Later the leader is the faster one.
    EXPECT_NEAR(s.ttc - encounters[0].min_ttc, 3.0 - s.time, 1e-9);  // It falls by a second a second.
    EXPECT_NEAR(s.drac, 10.0 / (2.0 * s.ttc), 1e-9);                 // dv^2 / (2 gap), gap = ttc dv.
    EXPECT_EQ(s.type_code, SumoTypeCode(encounters[0].type, false));
  }
  EXPECT_GE(measured, 3u);
  EXPECT_EQ(samples.back().type_code, kSumoNoConflict);
  ASSERT_EQ(samples.size(), 7u);  // From 1 s to 4 s, every half second.
  for (std::size_t k = 0; k < samples.size(); ++k) {
    EXPECT_EQ(samples[k].encounter, 0);
    EXPECT_NEAR(samples[k].time, 1.0 + 0.5 * static_cast<double>(k), 1e-9);
  }
  EXPECT_NEAR(samples[0].first.x, 14.0, 1e-9);
  EXPECT_NEAR(samples[0].second.x, 49.0, 1e-9);
  EXPECT_EQ(samples[0].second.speed, 4.0);
}

TEST(SafetyMonitor, WatchesNoMoreThanAsked) {
  for (const SafetyLevel level : {SafetyLevel::kOff, SafetyLevel::kContacts}) {
    SafetyMonitor monitor({}, nullptr, level);
    for (int k = 0; k < 40; ++k)
      monitor.Observe(FrameOf({{.x = 10.0, .speed = 5.0}, {.x = 0.0, .speed = 15.0}}, k));
    monitor.Finish();
    EXPECT_EQ(monitor.TakeFinishedContacts().size(), level == SafetyLevel::kContacts ? 1u : 0u);
    EXPECT_TRUE(monitor.TakeFinishedEncounters().empty());
    EXPECT_TRUE(monitor.row_ttc().empty());
  }
}

TEST(Striking, StandingVehiclesNeverStrike) {
  EXPECT_EQ(StrikingOf({{.x = 20.0}, {.x = 0.0, .speed = 10.0}}), 1);
  // Backed into, from its front: still the one that moves.
  EXPECT_EQ(StrikingOf({{.x = 0.0}, {.x = 15.0, .vx_extra = -3.0}}), 1);
  EXPECT_EQ(StrikingOf({{.x = 0.0}, {.x = 4.0}}), kNone);
}

TEST(Striking, RunningIntoACrossingFlankStrikes) {
  // Vehicle 0 meets the rear half of the flank of vehicle 1, which crosses from right to left.
  EXPECT_EQ(
      StrikingOf({{.x = 0.0, .speed = 10.0}, {.x = 11.0, .y = -6.0, .heading = kPi / 2.0, .speed = 10.0}}),
      0);
  EXPECT_EQ(StrikingOf({{.x = 11.0, .y = -6.0, .heading = kPi / 2.0, .speed = 10.0, .agent = true},
                        {.x = 0.0, .speed = 10.0}}),
            1);
}

TEST(Striking, IfBothCouldHaveBrakedItIsTheAgent) {
  EXPECT_EQ(StrikingOf({{.x = 0.0, .speed = 12.0}, {.x = 20.0, .heading = kPi, .speed = 3.0, .agent = true}}),
            1);
  EXPECT_EQ(StrikingOf({{.x = 0.0, .speed = 3.0, .agent = true}, {.x = 20.0, .heading = kPi, .speed = 12.0}}),
            0);
  // Crossing, both fronts in it: 1 is hit on its front fender.
  EXPECT_EQ(StrikingOf({{.x = 0.0, .speed = 10.0},
                        {.x = 11.0, .y = -9.5, .heading = kPi / 2.0, .speed = 10.0, .agent = true}}),
            1);
}

TEST(Striking, BetweenTwoAgentsItIsTheMoreFrontalOne) {
  EXPECT_EQ(StrikingOf({{.x = 0.0, .speed = 3.0, .agent = true},
                        {.x = 20.0, .heading = kPi, .speed = 12.0, .agent = true}}),
            1);
  EXPECT_EQ(StrikingOf({{.x = 0.0, .speed = 10.0, .agent = true},
                        {.x = 11.0, .y = -9.5, .heading = kPi / 2.0, .speed = 10.0, .agent = true}}),
            0);
}

TEST(Striking, InASideSwipeItIsTheOneThatMovesOver) {
  EXPECT_EQ(StrikingOf({{.x = 0.0, .speed = 10.0, .agent = true},
                        {.x = 0.5, .y = 3.2, .speed = 10.0, .vy_extra = -1.0}}),
            1);
  EXPECT_EQ(StrikingOf({{.x = 0.0, .speed = 10.0, .vy_extra = 1.0}, {.x = 0.5, .y = 3.2, .speed = 10.0}}), 0);
}

TEST(Striking, CuttingInFasterStrikesWithItsFlank) {
  // 1 has passed and moves over: its rear flank clips the front corner of 0, which could do nothing.
  EXPECT_EQ(StrikingOf({{.x = 0.0, .speed = 10.0, .agent = true},
                        {.x = 2.0, .y = 3.2, .speed = 11.0, .vy_extra = -1.5}}),
            1);
}

TEST(Striking, AVehicleHitsAPedestrianAheadOfIt) {
  EXPECT_EQ(StrikingOf({{.x = 10.0,
                         .y = -1.5,
                         .heading = kPi / 2.0,
                         .speed = 1.4,
                         .pedestrian = true,
                         .length = 0.3,
                         .width = 0.5},
                        {.x = 0.0, .speed = 10.0, .agent = true}}),
            1);
}

std::vector<Mover> Crowd(std::size_t count) {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> place(-400.0, 400.0), angle(-kPi, kPi), speed(0.0, 20.0);
  std::vector<Mover> movers;
  for (std::size_t i = 0; i < count; ++i) {
    movers.push_back({.x = place(random),
                      .y = place(random),
                      .heading = angle(random),
                      .speed = speed(random),
                      .agent = i % 2 == 0});
  }
  return movers;
}

TEST(SafetyMonitor, FindsThePairsThatBruteForceFinds) {
  const std::vector<Mover> movers = Crowd(400);
  SafetyMonitor monitor;
  for (int k = 0; k < 20; ++k) {
    const TrafficFrame frame = FrameOf(movers, k);
    monitor.Observe(frame);
    for (std::size_t i = 0; i < frame.size(); ++i) {
      double least = std::numeric_limits<double>::infinity();
      const auto box = [&](std::size_t r) {
        return Footprint{{frame.x[r], frame.y[r], frame.heading[r]}, frame.length[r], frame.width[r]};
      };
      for (std::size_t j = 0; j < frame.size(); ++j) {
        if (i == j) continue;
        const auto [a, b] = std::minmax(i, j);
        const auto ttc = TimeToContact(BoxOf(box(a), {frame.vx[a], frame.vy[a]}),
                                       BoxOf(box(b), {frame.vx[b], frame.vy[b]}), 3.0);
        if (ttc && *ttc < 3.0) least = std::min(least, *ttc);
      }
      EXPECT_EQ(monitor.row_ttc()[i], least) << "row " << i << " step " << k;
    }
  }
}

/// The same traffic with its rows in reverse order.
TrafficFrame Reversed(TrafficFrame frame) {
  const auto reverse = [](auto&... columns) { (std::reverse(columns.begin(), columns.end()), ...); };
  reverse(frame.vehicle_number, frame.x, frame.y, frame.heading, frame.speed, frame.vx, frame.vy,
          frame.length, frame.width, frame.lane, frame.agent_driven, frame.planned_stop, frame.pedestrian,
          frame.in_junction);
  return frame;
}

TEST(SafetyMonitor, DoesNotDependOnThreadsNorRowOrder) {
  const std::vector<Mover> movers = Crowd(2500);
  const auto run = [&](int threads, bool reversed) {
    const int before = omp_get_max_threads();
    omp_set_num_threads(threads);
    SafetyMonitor monitor;
    for (int k = 0; k < 80; ++k) {
      monitor.Observe(reversed ? Reversed(FrameOf(movers, k)) : FrameOf(movers, k));
    }
    monitor.Finish();
    omp_set_num_threads(before);
    std::vector<double> values;  // Everything that could differ, in order.
    for (const Contact& c : monitor.TakeFinishedContacts()) {
      values.insert(values.end(), {double(c.first), double(c.second), double(c.striking), c.begin, c.end, c.x,
                                   c.y, c.closing_speed, c.max_depth});
    }
    for (const Encounter& e : monitor.TakeFinishedEncounters()) {
      values.insert(values.end(), {double(e.first),
                                   double(e.second),
                                   e.begin,
                                   e.end,
                                   e.min_ttc,
                                   e.min_ttc_time,
                                   e.x,
                                   e.y,
                                   double(e.near_miss),
                                   double(e.number),
                                   e.max_drac,
                                   e.max_drac_time,
                                   e.min_mttc,
                                   e.pet,
                                   e.pet_time,
                                   e.min_distance,
                                   e.min_distance_time,
                                   e.max_closing_speed,
                                   e.first_delta_v,
                                   e.critical,
                                   double(e.type),
                                   double(e.ego_is_first),
                                   double(e.severity)});
    }
    for (const EncounterSample& s : monitor.TakeFinishedSamples()) {
      values.insert(values.end(), {double(s.encounter), s.time, s.first.x, s.second.y, s.first.speed});
    }
    return values;
  };
  const std::vector<double> reference = run(1, false);
  EXPECT_GT(reference.size(), 1000u);
  for (const int threads : {2, 3, 8}) EXPECT_EQ(run(threads, false), reference) << threads << " threads";
  EXPECT_EQ(run(2, true), reference);
}

}  // namespace
}  // namespace lanewise
