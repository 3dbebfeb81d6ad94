#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <unordered_map>
#include <vector>

#include "agents/coordination/coordination_params.h"
#include "agents/network/road_network.h"
#include "agents/rules/junction_map.h"
#include "agents/v2x/channel.h"

namespace lanewise {

/// A vehicle's turn at a junction.
struct Slot {
  StationId vehicle{kNone};
  std::int32_t connection{kNone};  ///< With which its way through the junction begins.
  float time{0.0f};                ///< [s] after the message was sent: its front is at the stop line.
};

/// The slots of a junction as a vehicle has heard of them.
struct HeardSlots {
  std::span<const Slot> slots;  ///< In the order of turns.
  double age{0.0};              ///< [s]

  /// A vehicle's place in the order, or kNone.
  std::int32_t TurnOf(StationId vehicle, std::int32_t connection) const;
};

/// Roadside coordinators of junctions without signals: each hears the vehicles that come, gives them turns
/// (in an order with little delay in sum), plans their arrivals together (PlanArrivals) such
/// that no two conflict, and tells them. Nobody is bound: who has heard its slot drives towards it, and takes
/// a turn before one with the right of way only where that one's present motion leaves the gap.
class JunctionSlots {
 public:
  /// @param memory [s] for which a receiver keeps a message: v2x.memory.
  JunctionSlots(const RoadNetwork& network, const JunctionMap& map, const SlotParams& params, double memory);

  /// Coordinators at these junctions, indices in RoadNetwork::junctions.
  void Install(std::span<const std::int32_t> junctions, Channel* channel);
  /// Posts each coordinator's message for the coming Exchange; plans anew every slots.interval.
  void Broadcast(double dt, Channel* channel);

  /// What `vehicle` has heard from the junction behind `connection`, if that was lately.
  std::optional<HeardSlots> Heard(const Channel& channel, StationId vehicle, std::int32_t connection) const;
  /// Speed [m/s] with which a vehicle `distance` [m] before its stop line approaches its slot; nothing
  /// without one.
  std::optional<double> ApproachSpeed(const Channel& channel, StationId vehicle, std::int32_t connection,
                                      double distance) const;
  const SlotParams& params() const { return params_; }

  /// May a coordinator stand there: a junction without signals, at which ways conflict?
  static bool CanCoordinate(const RoadNetwork& network, const JunctionMap& map, std::int32_t junction);

 private:
  struct Unit {
    StationId station{kNone};
    std::vector<Slot> slots;      // Of the last plan, times from then on.
    std::int32_t planned_at{-1};  // Step.
  };
  struct Request {
    StationId vehicle;
    std::int32_t connection, link;
    double distance, speed, length, earliest;
    std::int32_t before;  // Turn in the last plan; kNone: none.
  };

  void Plan(const Channel& channel, Unit* unit);
  std::optional<double> TimeBetween(const Request& first, const Request& second) const;
  double Limit(std::int32_t connection) const;  // [m/s] before the junction,
  double CrossingSpeed(std::int32_t connection) const;  // and through it.
  double SumOfDelays(const std::vector<Request>& order) const;
  void PutInOrder(std::vector<Request>* requests) const;

  const RoadNetwork& network_;
  const JunctionMap& map_;
  SlotParams params_;
  double memory_;  // [s]
  std::vector<std::int32_t> unit_of_junction_;
  std::vector<Unit> units_;
  std::vector<std::vector<Slot>> messages_;  // A ring: as many steps as messages are remembered, units within.
  std::uint64_t posted_{0};
  std::int32_t step_{0};
};

}  // namespace lanewise
