#include "agents/planning/brake_guard.h"

#include <algorithm>
#include <cmath>

#include "agents/core/geometry.h"
#include "agents/vehicle/kinematic_bicycle.h"

namespace lanewise {
namespace {

/// [m/s] up to which the ego is watched: the faster, the farther its arc is from where it will go. And
/// others: whoever drives is the planner's business.
constexpr double kManoeuvring = 6.0, kWalking = 2.0;
/// [m] between the poses that are checked, and the room that must be left.
constexpr double kStride = 0.2, kRoom = 0.02;
/// [m] of it that is left when patience is at its end: the ego's way is not quite the arc.
constexpr double kLeastRoom = 0.001;
/// [m] before what it would touch the ego stops: nearer it could not turn away any more.
constexpr double kRoomToTurn = 1.0;
/// [s] of waiting after which the ego uses the last bit of room beside a vehicle, which may be waiting for
/// the ego.
constexpr float kPatience = 8.0f;
/// [m] around the ego's body, on top of the braking distance, out of which nothing is touched.
constexpr float kNear = 1.0f;

Footprint FootprintOf(const Traffic& traffic, AgentIndex row) {
  const Motion& now = traffic.now;
  return {{now.x[row], now.y[row], now.heading[row]}, traffic.params[row].length, traffic.params[row].width};
}

}  // namespace

bool MustBrakeNow(const World& world, AgentIndex ego, AgentIndex leader, const RoadView& view,
                  double steering_angle, double speed, double dt) {
  if (speed > kManoeuvring) return false;
  const Traffic& traffic = *world.traffic;
  const VehicleParams& vehicle = traffic.params[ego];
  const double braking = speed * dt + speed * speed / (2.0 * vehicle.emergency_decel);
  const bool patient = traffic.now.waited[ego] <= kPatience;
  const float reach = static_cast<float>(braking + kRoomToTurn) + kNear;
  const float aside = static_cast<float>(0.5 * vehicle.width) + kNear;
  const float d = static_cast<float>(traffic.now.d[ego]);
  const double slip = SlipAngle(steering_angle, vehicle.wheelbase, vehicle.rear_axle_to_front);
  for (int m = 0; m < view.obstacle_count; ++m) {
    const Obstacle& o = view.obstacles[m];
    if (o.forgiven > 0.0f || o.row == leader || o.s - o.half_length > reach ||
        o.s + o.half_length < -static_cast<float>(vehicle.length) - kNear ||
        std::abs(o.d - d) > o.half_width + aside || traffic.now.speed[o.row] > kWalking) {
      continue;
    }
    const bool person = o.row >= static_cast<AgentIndex>(traffic.vehicle_count);
    const bool with_room = person || patient;
    const double distance = braking + (with_room ? kRoomToTurn : 0.0);
    const double its_speed = traffic.now.speed[o.row], its_heading = traffic.now.heading[o.row];
    Footprint body = FootprintOf(traffic, ego), other = FootprintOf(traffic, o.row);
    const double depth_now = PenetrationDepth(body, other);
    if (depth_now > 0.0) continue;  // Braking does not part them.
    const double room = !with_room || depth_now > -kRoom ? std::min(kLeastRoom, -depth_now) : kRoom;
    const int strides = 1 + static_cast<int>(distance / kStride);
    const double stride = distance / strides, its_stride = its_speed * stride / std::max(speed, 0.1);
    for (int k = 0; k < strides; ++k) {
      double unused_speed = stride;  // One step of 1 s.
      StepBicycle(0.0, slip, vehicle.rear_axle_to_front, 1.0, &body.front, &unused_speed);
      other.front.x += its_stride * std::cos(its_heading);
      other.front.y += its_stride * std::sin(its_heading);
      if (PenetrationDepth(body, other) > -room) return true;
    }
  }
  return false;
}

}  // namespace lanewise
