#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "agents/coordination/coordination_params.h"
#include "agents/coordination/signal_timing.h"
#include "agents/network/road_network.h"
#include "agents/v2x/channel.h"

namespace lanewise {

/// The place at a signal a vehicle drives to.
struct StopLine {
  LaneIndex lane{kNone};
  std::int32_t signal{kNone};  ///< Index in RoadNetwork::signal_ids.
  std::int32_t link{kNone};    ///< Character in the signal's state.
  double distance{0.0};        ///< [m] from the vehicle's front.
};

/// Where the sender of a message is bound for, if that is a signal; also over an edge on which turning lanes
/// begin.
std::optional<StopLine> StopLineOf(const RoadNetwork& network, const Message& message);

/// When a vehicle the unit knows of will pass its stop line.
struct ExpectedPass {
  LaneIndex lane{kNone};  ///< That leads to the line.
  LaneIndex on{kNone};    ///< Where it is.
  float distance{0.0f};   ///< [m] to the stop line, when the message was sent.
  float time{0.0f};       ///< [s] after that.
  StationId vehicle{kNone};
};

/// What a roadside unit says of its signal: SPaT and MAP (SAE J2735, ETSI TS 103 301), and when whom it knows
/// on the approaches will pass.
struct SignalMessage {
  SignalTiming timing;
  std::vector<ExpectedPass> expected;  ///< By lane, the first at the stop line first.
};

/// Roadside units, one at every signal: they hear the vehicles around and tell them of the signal.
class Roadside {
 public:
  /// @param memory [s] for which a receiver keeps a message: v2x.memory.
  Roadside(const RoadNetwork& network, const CoordinationParams& params, double memory);

  const CoordinationParams& params() const { return params_; }
  void Install(Channel* channel);
  /// By signal; kNone where a signal has no stop line.
  std::span<const StationId> units() const { return units_; }
  /// Posts each unit's message for the coming Exchange. `timings` by signal.
  void Broadcast(double dt, std::span<const SignalTiming> timings, Channel* channel);
  const SignalMessage& MessageIn(const Received& received) const {
    return messages_[received.message->payload % messages_.size()];
  }

 private:
  struct Known {
    StopLine line;
    LaneIndex on;
    StationId vehicle;
    double speed;  // [m/s]
  };

  void Foresee(std::int32_t signal, const Channel& channel, SignalMessage* message);

  const RoadNetwork& network_;
  CoordinationParams params_;
  double memory_;  // [s]
  std::vector<StationId> units_;
  std::vector<SignalMessage> messages_;  // A ring: as many steps as messages are remembered, signals within.
  std::uint64_t posted_{0};
  std::vector<Known> known_;  // Scratch.
};

}  // namespace lanewise
