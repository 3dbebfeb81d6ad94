#include "agents/planning/brake_guard.h"

#include <algorithm>
#include <cmath>

#include "agents/core/geometry.h"
#include "agents/vehicle/kinematic_bicycle.h"

namespace lanewise {
namespace {

/// [m/s] up to which the ego is watched over its braking distance: the faster, the farther its arc is from
/// where it will go. Up to kPassing it is watched over the next kGlance [s].
constexpr double kManoeuvring = 6.0, kPassing = 9.0, kGlance = 0.3;
/// [m/s] from which others drive: the planner keeps away from them, the guard only from touching.
constexpr double kWalking = 2.0;
/// [m/s] below which one that makes room for the ego may stop doing so at once, as it may for the ego.
constexpr double kMayStop = 0.5;
/// [m] between the poses that are checked, and the room that must be left.
constexpr double kStride = 0.2, kRoom = 0.02;
/// [m] of it that is left when patience is at its end: the ego's way is not quite the arc.
constexpr double kLeastRoom = 0.001;
/// [m] the same under the agents' own rules, also beside one that drives, which steers too; and by how much
/// nearer still counts as not nearer.
constexpr double kLeastOwnRoom = 0.01, kRoomBesideDriver = 0.05, kNotNearer = 1e-4;
/// [m] before what it would touch the ego stops: nearer it could not turn away any more.
constexpr double kRoomToTurn = 1.0;
/// [s] of waiting after which the ego uses the last bit of room beside a vehicle, which may be waiting for
/// the ego.
constexpr float kPatience = 8.0f;
/// [m] beyond the ego's body and braking distance within which the middle of one that drives is looked at.
constexpr double kDrivesNear = 8.0;
/// [s] of waiting after which who creeps by may touch what is forgiven: nothing else would end a standstill.
constexpr float kLastPatience = 60.0f;
/// [m] around the ego's body, on top of the braking distance, out of which nothing is touched.
constexpr float kNear = 1.0f;

Footprint FootprintOf(const Traffic& traffic, AgentIndex row) {
  const Motion& now = traffic.now;
  return {{now.x[row], now.y[row], now.heading[row]}, traffic.params[row].length, traffic.params[row].width};
}

}  // namespace

bool MustBrakeNow(const World& world, AgentIndex ego, AgentIndex leader, const RoadView& view,
                  double steering_angle, double speed, double dt) {
  if (speed > kPassing) return false;
  const Traffic& traffic = *world.traffic;
  const Motion& now = traffic.now;
  const VehicleParams& vehicle = traffic.params[ego];
  const bool glances = speed > kManoeuvring;
  const double braking =
      glances ? speed * kGlance : speed * dt + speed * speed / (2.0 * vehicle.emergency_decel);
  const bool patient = now.waited[ego] <= kPatience && !glances;
  const double slip = SlipAngle(steering_angle, vehicle.wheelbase, vehicle.rear_axle_to_front);
  const Footprint own_body = FootprintOf(traffic, ego);
  // [rad] The lane's frame, in which the ego is moved, turns with the lane once a step: it drifts into a bend
  // by half a curvature times the step's way squared. A centimetre of room is used up by that within a body's
  // length.
  const double drift = world.rules == nullptr ? 0.0 : 0.5 * now.curvature[ego] * speed * dt;

  /// Would the ego touch it, or come nearer than `last_bit`? With `room` it stops a metre before, while it is
  /// patient.
  const auto touches = [&](AgentIndex row, bool room, double last_bit, double its_speed) {
    Footprint body = own_body, other = FootprintOf(traffic, row);
    const double depth_now = PenetrationDepth(body, other);
    if (depth_now > 0.0 && world.rules == nullptr) return false;  // Braking does not part them.
    const bool person = row >= static_cast<AgentIndex>(traffic.vehicle_count);
    const bool with_room = room && (person || patient);
    const double distance = braking + (with_room ? kRoomToTurn : 0.0);
    // Where less is left already, or nothing, it must not become less still.
    const double what_is_left = -depth_now - (world.rules == nullptr ? 0.0 : kNotNearer);
    const double least = !with_room || depth_now > -kRoom ? std::min(last_bit, what_is_left) : kRoom;
    const int strides = 1 + static_cast<int>(distance / kStride);
    const double stride = distance / strides, its_stride = its_speed * stride / std::max(speed, 0.1);
    const VehicleParams& its = traffic.params[row];
    const double its_slip =
        person ? 0.0 : SlipAngle(now.steering_angle[row], its.wheelbase, its.rear_axle_to_front);
    for (int k = 0; k < strides; ++k) {
      double unused_speed = stride, its_unused_speed = its_stride;  // One step of 1 s.
      StepBicycle(0.0, slip, vehicle.rear_axle_to_front, 1.0, &body.front, &unused_speed);
      body.front.x -= drift * stride * std::sin(body.front.heading);
      body.front.y += drift * stride * std::cos(body.front.heading);
      StepBicycle(0.0, its_slip, its.rear_axle_to_front, 1.0, &other.front, &its_unused_speed);
      if (PenetrationDepth(body, other) > -least) return true;
    }
    return false;
  };

  const float reach = static_cast<float>(braking + kRoomToTurn) + kNear;
  // A long body that stands at an angle to the path reaches far beside its front.
  const float swing = static_cast<float>(vehicle.length * std::abs(std::sin(now.heading_error[ego])));
  const float aside = static_cast<float>(0.5 * vehicle.width) + swing + kNear;
  const float d = static_cast<float>(now.d[ego]);
  const double least_room = world.rules == nullptr ? kLeastRoom : kLeastOwnRoom;
  const bool at_last = now.waited[ego] > kLastPatience || world.rules == nullptr;
  for (int m = 0; m < view.obstacle_count; ++m) {
    const Obstacle& o = view.obstacles[m];
    const bool near = o.s - o.half_length < reach &&
                      o.s + o.half_length > -static_cast<float>(vehicle.length) - kNear &&
                      std::abs(o.d - d) < o.half_width + aside;
    const bool forgiven = o.forgiven > 0.0f;
    if (!near || o.row == leader || now.speed[o.row] > kWalking || (forgiven && at_last)) continue;
    if (touches(o.row, !forgiven, least_room, now.speed[o.row])) return true;
    const bool may_stop = world.rules != nullptr && now.speed[o.row] > 0.0 && now.speed[o.row] < kMayStop;
    if (may_stop && touches(o.row, !forgiven, least_room, 0.0)) return true;
  }

  // Who drives is left to the rules, and may not even be in view: what they grant is not to be touched.
  if (world.rules == nullptr || glances) return false;
  const double c = std::cos(own_body.front.heading), s = std::sin(own_body.front.heading);
  const double radius = 0.5 * vehicle.length + braking + kDrivesNear;
  bool meets = false;
  world.grid->ForEachNear(world.center_x[ego], world.center_y[ego], radius, [&](AgentIndex row) {
    if (meets || row == ego || row == leader || row >= static_cast<AgentIndex>(traffic.vehicle_count) ||
        now.speed[row] <= kWalking) {
      return;
    }
    const double dx = world.center_x[row] - world.center_x[ego],
                 dy = world.center_y[row] - world.center_y[ego];
    if (dx * dx + dy * dy > radius * radius) return;
    // Who drives up from behind has to see to it itself.
    const bool same_way = c * std::cos(now.heading[row]) + s * std::sin(now.heading[row]) > 0.0;
    const double its_front = (now.x[row] - world.center_x[ego]) * c + (now.y[row] - world.center_y[ego]) * s;
    if (same_way && its_front < 0.0) return;
    meets = touches(row, false, kRoomBesideDriver, now.speed[row]);
  });
  return meets;
}

}  // namespace lanewise
