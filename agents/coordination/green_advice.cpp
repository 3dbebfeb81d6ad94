#include "agents/coordination/green_advice.h"

#include <algorithm>
#include <cmath>

namespace lanewise {
namespace {

/// [s] earlier than free driving would reach the line is no reason to advise.
constexpr double kWorthAdvising = 0.5;
/// [m] before the stop line at which advice comes too late.
constexpr double kLastAdvice = 5.0;

const Connection* ConnectionBetween(const RoadNetwork& network, LaneIndex from, LaneIndex next) {
  for (const std::int32_t index : network.lanes[from].outgoing) {
    const Connection& connection = network.connections[index];
    if (connection.via == next || (connection.via == kNone && connection.to == next)) return &connection;
  }
  return nullptr;
}

/// The next signal on the way, within `range` [m].
std::optional<StopLine> LineAhead(const World& world, AgentIndex ego, double range) {
  const WayAhead way = LookAhead(world, ego, range);
  for (int k = 0; k + 1 < way.count; ++k) {
    const Lane& lane = world.network->lanes[way.lanes[k].lane];
    if (lane.internal) continue;
    const Connection* connection =
        ConnectionBetween(*world.network, way.lanes[k].lane, way.lanes[k + 1].lane);
    if (connection == nullptr || connection->signal == kNone) continue;
    // `start` counts along the paths, as the ego drives.
    return StopLine{way.lanes[k].lane, connection->signal, connection->link_index, way.lanes[k + 1].start};
  }
  return std::nullopt;
}

}  // namespace

std::optional<double> PassingTime(const AdviceParams& params, const SignalTiming& timing, std::int32_t link,
                                  double reach, double ahead) {
  double time = ahead < 0.0 ? reach : std::max(reach, ahead + params.headway);
  while (const auto green = NextGreen(timing, link, std::max(0.0, time + params.green_margin))) {
    if (green->begin > 0.0) time = std::max(time, green->begin + params.start_delay);
    if (time + params.green_margin < green->end) return time;
    time = green->end - std::min(0.0, params.green_margin);  // Not in this one.
  }
  return std::nullopt;
}

double TimeToReach(double distance, double speed, double limit, double accel) {
  if (speed >= limit) return distance / std::max(speed, 0.1);
  const double while_accelerating = (limit * limit - speed * speed) / (2.0 * accel);
  if (while_accelerating >= distance)
    return (std::sqrt(speed * speed + 2.0 * accel * distance) - speed) / accel;
  return (limit - speed) / accel + (distance - while_accelerating) / limit;
}

double SpeedToArrive(double distance, double speed, double time, double decel) {
  if (speed * time <= distance) return distance / std::max(time, 1e-6);
  // v^2 + 2 v (b t - v0) + v0^2 - 2 b s = 0, the root between 0 and v0.
  const double half = decel * time - speed;
  const double root = half * half - (speed * speed - 2.0 * decel * distance);
  if (root < 0.0) return 0.0;
  return std::max(0.0, std::sqrt(root) - half);
}

Advice AdviseSpeed(const World& world, const Roadside& roadside, const DrivingParams& driving,
                   AgentIndex ego) {
  const AdviceParams& params = roadside.params().advice;
  const auto line = LineAhead(world, ego, params.range);
  if (!line || roadside.units()[static_cast<std::size_t>(line->signal)] == kNone) return {};
  const Traffic& traffic = *world.traffic;
  const auto received =
      world.channel->LastFrom(traffic.number[ego], roadside.units()[static_cast<std::size_t>(line->signal)]);
  if (!received) return {};
  const Advice free{line->signal};
  const SignalMessage& message = roadside.MessageIn(*received);
  const double age = received->age, speed = traffic.now.speed[ego];
  // Who was nearer to the line when the message was sent passes first.
  const double distance_then = line->distance + speed * age;
  double ahead = -1.0;
  for (const ExpectedPass& other : message.expected) {
    if (other.lane == line->lane && other.vehicle != traffic.number[ego] && other.distance < distance_then)
      ahead = std::max(ahead, static_cast<double>(other.time));
  }
  if (line->distance < kLastAdvice) return free;
  const double limit = traffic.speed_limit[ego];
  const double reach = TimeToReach(line->distance, speed, limit, kExpectedAccel);
  const auto pass = PassingTime(params, message.timing, line->link, reach + age, ahead);
  if (!pass || *pass - age < reach + kWorthAdvising) return free;
  // Who passes in the present green is held up by those ahead, not by the signal.
  const auto green = NextGreen(message.timing, line->link, age);
  if (green && green->begin <= age && *pass + params.green_margin < green->end) return free;
  const double wanted = SpeedToArrive(line->distance, speed, *pass - age, params.decel);
  const double advised = std::clamp(wanted, std::min(params.min_speed, limit), limit);
  return {line->signal, advised, std::max(advised, speed - params.decel * driving.response_time)};
}

}  // namespace lanewise
