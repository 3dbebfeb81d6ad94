#include "agents/vehicle/vehicle_params.h"

#include <gtest/gtest.h>

namespace lanewise {
namespace {

TEST(VehicleParams, AxlesScaleWithTheLength) {
  VehicleParams car;
  car.length = 4.8;
  AxlesAndActuators("passenger", &car);
  EXPECT_NEAR(car.wheelbase, 2.8, 0.05);                  // A 4.8 m car: 2.8 m between its axles,
  EXPECT_NEAR(car.rear_axle_to_front, 4.8 - 1.05, 0.05);  // and 1.05 m behind them.
  VehicleParams longer = car;
  longer.length = 9.6;
  AxlesAndActuators("passenger", &longer);
  EXPECT_DOUBLE_EQ(longer.wheelbase, 2.0 * car.wheelbase);
  EXPECT_DOUBLE_EQ(longer.rear_axle_to_front, 2.0 * car.rear_axle_to_front);
}

TEST(VehicleParams, EveryClassIsGeometricallyPossible) {
  for (const char* name : {"passenger", "bus", "coach", "truck", "trailer", "delivery", "bicycle",
                           "motorcycle", "taxi", "no such class"}) {
    VehicleParams vehicle;
    AxlesAndActuators(name, &vehicle);
    EXPECT_GT(vehicle.wheelbase, 0.0) << name;
    EXPECT_LT(vehicle.wheelbase, vehicle.rear_axle_to_front) << name;  // The front axle is behind the bumper.
    EXPECT_LT(vehicle.rear_axle_to_front, vehicle.length) << name;
    EXPECT_GT(vehicle.max_steering_angle, 0.0) << name;
    EXPECT_GT(vehicle.accel_lag, 0.0) << name;
  }
}

TEST(VehicleParams, WhatSumoKnowsStays) {
  VehicleParams bus;
  bus.length = 12.0;
  bus.max_decel = 4.0;
  AxlesAndActuators("bus", &bus);
  EXPECT_EQ(bus.length, 12.0);
  EXPECT_EQ(bus.max_decel, 4.0);
  VehicleParams car;
  car.length = 12.0;
  AxlesAndActuators("passenger", &car);
  EXPECT_NE(bus.wheelbase, car.wheelbase);
}

}  // namespace
}  // namespace lanewise
