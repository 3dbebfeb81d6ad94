#include "analysis/trip_recorder.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace lanewise {
namespace {

constexpr double kStep = 0.5;  // [s] exact in binary: sums compare exactly enough.

/// One row of a frame: vehicle 0 at this speed and acceleration.
TrafficFrame FrameOf(double speed, double accel = 0.0) {
  TrafficFrame frame;
  frame.Resize(1);
  frame.speed[0] = speed;
  frame.accel[0] = accel;
  frame.allowed_speed[0] = 10.0;
  return frame;
}

VehicleRow Car(std::int32_t number, double depart = 0.0) {
  return {.number = number, .id = "car", .depart = depart, .depart_delay = 3.0};
}

TEST(TripRecorder, SumsTimesAndLengthByHand) {
  TripRecorder trips(kStep);
  trips.Depart(Car(0, 100.0));
  trips.Observe(FrameOf(7.0), {});  // Insertion: not driven yet.
  trips.Observe(FrameOf(10.0), {});
  trips.Observe(FrameOf(5.0), {});
  trips.Observe(FrameOf(0.0), {});
  trips.Observe(FrameOf(0.05), {});
  trips.Observe(FrameOf(20.0), {});  // Faster than allowed: no gain in time.
  trips.Observe(FrameOf(0.0), {});
  TrafficFrame stop = FrameOf(0.0);
  stop.planned_stop[0] = 1;
  trips.Observe(stop, {});
  trips.Observe(stop, {});
  const TripRow trip = trips.Finish(0, 104.5, TripEnd::kArrived);
  EXPECT_EQ(trip.depart, 100.0);
  EXPECT_EQ(trip.arrival, 104.5);
  EXPECT_EQ(trip.duration, 4.5);
  EXPECT_EQ(trip.depart_delay, 3.0);
  EXPECT_NEAR(trip.route_length, 0.5 * (10.0 + 5.0 + 0.05 + 20.0), 1e-12);
  EXPECT_NEAR(trip.waiting_time, 1.5, 1e-12);
  EXPECT_EQ(trip.waiting_count, 2);
  EXPECT_NEAR(trip.stop_time, 1.0, 1e-12);
  EXPECT_NEAR(trip.time_loss, 0.5 * (0.0 + 0.5 + 1.0 + 0.995 + 0.0 + 1.0), 1e-12);
  EXPECT_EQ(trip.steps, 8);
}

TEST(TripRecorder, MeasuresComfortByHand) {
  TripRecorder trips(kStep);
  trips.Depart(Car(0));
  trips.Observe(FrameOf(10.0, 99.0), {});  // SUMO's value at insertion means nothing.
  for (const double accel : {0.0, 2.0, -5.0, -6.0, -1.0, -5.0}) {
    TrafficFrame frame = FrameOf(10.0, accel);
    frame.lateral_accel[0] = -0.3 * accel;
    trips.Observe(frame, {});
  }
  const TripRow trip = trips.Finish(0, 3.5, TripEnd::kArrived);
  EXPECT_EQ(trip.max_accel, 2.0);
  EXPECT_EQ(trip.max_decel, 6.0);
  EXPECT_NEAR(*trip.max_lateral_accel, 1.8, 1e-12);
  EXPECT_NEAR(*trip.max_jerk, 14.0, 1e-12);
  // Jerks 4, -14, -2, 10, -8.
  EXPECT_NEAR(*trip.rms_jerk, std::sqrt((16.0 + 196.0 + 4.0 + 100.0 + 64.0) / 5.0), 1e-12);
  EXPECT_EQ(trip.hard_braking_count, 2);  // Two times, not three steps.
}

TEST(TripRecorder, SumsEmissionsAgentStepsAndTtc) {
  TripRecorder trips(kStep);
  trips.Depart(Car(0));
  TrafficFrame frame = FrameOf(10.0);
  frame.co2_rate[0] = 2000.0;
  frame.nox_rate[0] = 4.0;
  frame.pmx_rate[0] = 0.2;
  frame.fuel_rate[0] = 600.0;
  frame.electricity_rate[0] = 1.0;
  const double inf = std::numeric_limits<double>::infinity();
  trips.Observe(frame, std::array{inf});
  trips.Observe(frame, std::array{2.5});
  frame.agent_driven[0] = 1;
  trips.Observe(frame, std::array{1.5});
  trips.Observe(frame, std::array{inf});
  const TripRow trip = trips.Finish(0, 2.0, TripEnd::kVaporized);
  EXPECT_NEAR(trip.co2, 3000.0, 1e-9);
  EXPECT_NEAR(trip.nox, 6.0, 1e-12);
  EXPECT_NEAR(trip.pmx, 0.3, 1e-12);
  EXPECT_NEAR(trip.fuel, 900.0, 1e-9);
  EXPECT_NEAR(trip.electricity, 1.5, 1e-12);
  EXPECT_EQ(trip.steps, 3);
  EXPECT_EQ(trip.agent_steps, 2);
  EXPECT_EQ(trip.min_ttc, 1.5);
  EXPECT_FALSE(trip.arrival);  // It did not arrive.
}

TEST(TripRecorder, LeavesTheUndefinedUndefined) {
  TripRecorder trips(kStep);
  trips.Depart(Car(0));
  trips.Observe(FrameOf(10.0), {});
  const TripRow trip = trips.Finish(0, 0.5, TripEnd::kRunning);
  EXPECT_FALSE(trip.arrival);
  EXPECT_FALSE(trip.max_accel);
  EXPECT_FALSE(trip.rms_jerk);
  EXPECT_FALSE(trip.min_ttc);
}

TEST(TripRecorder, KeepsVehiclesApartAndReusesNothingOfAFinishedOne) {
  TripRecorder trips(kStep);
  trips.Depart(Car(0));
  trips.Depart(Car(1));
  TrafficFrame frame;
  frame.Resize(3);
  frame.vehicle_number = {1, 0, 7};  // Any order; 7 never departed.
  frame.speed = {20.0, 10.0, 5.0};
  trips.Observe(frame, {});
  trips.Observe(frame, {});
  EXPECT_NEAR(trips.Finish(0, 1.0, TripEnd::kArrived).route_length, 5.0, 1e-12);
  trips.Depart(Car(2));
  EXPECT_EQ(trips.UnderWay(), (std::vector<std::int32_t>{1, 2}));
  EXPECT_EQ(trips.Finish(2, 1.0, TripEnd::kRunning).route_length, 0.0);
  EXPECT_NEAR(trips.Finish(1, 1.0, TripEnd::kArrived).route_length, 10.0, 1e-12);
  EXPECT_TRUE(trips.UnderWay().empty());
}

}  // namespace
}  // namespace lanewise
