#include "agents/coordination/roadside.h"

#include <algorithm>
#include <tuple>

#include "agents/coordination/green_advice.h"

namespace lanewise {
namespace {

/// [B] on the air: a SPaT of some phases, and a line of the list of vehicles.
constexpr double kSignalBytes = 200.0;
constexpr double kVehicleBytes = 12.0;

}  // namespace

std::optional<StopLine> StopLineOf(const RoadNetwork& network, const Message& message) {
  if (message.next_link == kNone) return std::nullopt;
  const Connection& connection = network.connections[message.next_link];
  if (connection.signal != kNone)
    return StopLine{connection.from, connection.signal, connection.link_index, message.link_distance};
  // An edge that ends where its turning lanes begin.
  const Lane& lane = network.lanes[connection.to];
  if (lane.outgoing.empty()) return std::nullopt;
  const Connection& next = network.connections[lane.outgoing.front()];
  if (next.signal == kNone) return std::nullopt;
  const double between = connection.via == kNone ? 0.0 : network.lanes[connection.via].length;
  return StopLine{connection.to, next.signal, next.link_index, message.link_distance + between + lane.length};
}

Roadside::Roadside(const RoadNetwork& network, const CoordinationParams& params, double memory)
    : network_(network), params_(params), memory_(memory), units_(network.signal_ids.size(), kNone) {}

void Roadside::Install(Channel* channel) {
  struct Sum {
    double x{0.0}, y{0.0};
    int count{0};
  };
  std::vector<Sum> sums(units_.size());
  for (const Connection& connection : network_.connections) {
    if (connection.signal == kNone || network_.lanes[connection.from].shape.empty()) continue;
    const Point2& end = network_.lanes[connection.from].shape.back();
    Sum& sum = sums[static_cast<std::size_t>(connection.signal)];
    sum.x += end.x;
    sum.y += end.y;
    ++sum.count;
  }
  for (std::size_t signal = 0; signal < units_.size(); ++signal) {
    const Sum& sum = sums[signal];
    if (sum.count == 0) continue;
    units_[signal] =
        channel->AddRoadsideUnit(sum.x / sum.count, sum.y / sum.count, network_.signal_ids[signal]);
  }
}

void Roadside::Foresee(std::int32_t signal, const Channel& channel, SignalMessage* message) {
  known_.clear();
  channel.ForEachKnown(units_[signal], [&](const Received& received) {
    const auto line = StopLineOf(network_, *received.message);
    if (!line || line->signal != signal || line->distance > params_.advice.range) return;
    known_.push_back({*line, received.message->lane, received.message->sender, received.message->speed});
    double& distance = known_.back().line.distance;
    distance = std::max(0.0, distance - received.message->speed * received.age);
  });
  std::sort(known_.begin(), known_.end(), [](const Known& a, const Known& b) {
    return std::tuple(a.line.lane, a.line.distance, a.vehicle) <
           std::tuple(b.line.lane, b.line.distance, b.vehicle);
  });
  LaneIndex lane = kNone;
  double ahead = -1.0;
  for (const Known& known : known_) {
    if (known.line.lane != lane) {
      lane = known.line.lane;
      ahead = -1.0;
    }
    const double reach =
        TimeToReach(known.line.distance, known.speed, network_.lanes[lane].speed_limit, kExpectedAccel);
    const auto pass = PassingTime(params_.advice, message->timing, known.line.link, reach, ahead);
    if (!pass) continue;
    ahead = *pass;
    message->expected.push_back(
        {lane, known.on, static_cast<float>(known.line.distance), static_cast<float>(ahead), known.vehicle});
  }
}

void Roadside::Broadcast(double dt, std::span<const SignalTiming> timings, Channel* channel) {
  const auto steps = static_cast<std::size_t>(memory_ / dt) + 2;
  messages_.resize(steps * units_.size());
  for (std::size_t signal = 0; signal < units_.size(); ++signal) {
    if (units_[signal] == kNone) continue;
    SignalMessage& message = messages_[posted_ % messages_.size()];
    message.timing = timings[signal];
    message.expected.clear();
    Foresee(static_cast<std::int32_t>(signal), *channel, &message);
    channel->Post(units_[signal], posted_++,
                  kSignalBytes + kVehicleBytes * static_cast<double>(message.expected.size()));
  }
}

}  // namespace lanewise
