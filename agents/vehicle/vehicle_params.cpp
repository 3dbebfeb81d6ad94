#include "agents/vehicle/vehicle_params.h"

#include <array>

namespace lanewise {
namespace {

// Shares of the length: typical cars have the wheelbase at 0.58 and the rear overhang at 0.22 of it
// (4.8 m: 2.8 m and 1.05 m); city buses 0.49 and 0.28; rigid trucks 0.55 and 0.30.
struct ClassShape {
  std::string_view name;
  double wheelbase_share;
  double rear_overhang_share;
  double max_steering_angle;
  double accel_lag;
};
constexpr ClassShape kCar{"passenger", 0.58, 0.22, 0.70, 0.15};
constexpr std::array<ClassShape, 8> kShapes{{kCar,
                                             {"bus", 0.49, 0.28, 0.80, 0.30},
                                             {"coach", 0.49, 0.28, 0.80, 0.30},
                                             {"truck", 0.55, 0.30, 0.75, 0.30},
                                             {"trailer", 0.45, 0.25, 0.80, 0.35},
                                             {"delivery", 0.58, 0.24, 0.72, 0.20},
                                             {"bicycle", 0.65, 0.18, 0.90, 0.10},
                                             {"motorcycle", 0.65, 0.18, 0.70, 0.10}}};

}  // namespace

void AxlesAndActuators(std::string_view vehicle_class, VehicleParams* params) {
  ClassShape shape = kCar;
  for (const ClassShape& candidate : kShapes) {
    if (candidate.name == vehicle_class) shape = candidate;
  }
  params->wheelbase = shape.wheelbase_share * params->length;
  params->rear_axle_to_front = (1.0 - shape.rear_overhang_share) * params->length;
  params->max_steering_angle = shape.max_steering_angle;
  params->accel_lag = shape.accel_lag;
}

}  // namespace lanewise
