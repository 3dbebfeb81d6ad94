#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "agents/coordination/arrival_plan.h"
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
  /// [s] until the front of the one with that turn is at its stop line.
  double TimeOf(std::int32_t turn) const { return slots[static_cast<std::size_t>(turn)].time - age; }
};

/// Roadside coordinators of junctions without signals: each hears the vehicles that come and gives them
/// turns. A vehicle is put into the order where the delays are least in sum, and from some seconds before the
/// junction on it keeps its place among the others. For that order the arrivals are planned together
/// (PlanArrivals), such that no two conflict, and told. Who does not take its turn loses it: then the rules
/// of the road apply to it.
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
  /// Speed [m/s] with which a vehicle, `distance` [m] before its stop line, approaches it to be there in
  /// `time` [s]. @param wanted [m/s] it drives at if it is free.
  static double ApproachSpeed(const JunctionLink& link, double distance, double speed, double wanted,
                              double time);
  const SlotParams& params() const { return params_; }

  /// May a coordinator stand there: a junction without signals, at which ways conflict?
  static bool CanCoordinate(const RoadNetwork& network, const JunctionMap& map, std::int32_t junction);

 private:
  /// A vehicle the coordinator knows of.
  struct Turn {
    StationId vehicle{kNone};
    std::int32_t connection{kNone}, link{kNone};
    double length{0.0}, extra{0.0};  // [m] its length, and by how much it reaches beyond a car's sides.
    Arrival arrival;
    double time{0.0};     // [s] planned for its front at the stop line, from the last plan on.
    bool placed{false};   // It is in the order,
    bool fixed{false};    // and keeps its place there.
    bool passed{false};   // It is behind the line; time is when it was there, <= 0.
    double refused{0.0};  // [s] for which it has stood though nobody before it was in its way.
    bool lost{false};     // Has therefore no turn.
  };
  struct Unit {
    StationId station{kNone};
    std::int32_t junction{kNone};
    std::vector<Turn> turns;      // In their order.
    std::int32_t planned_at{-1};  // Step.
  };

  static Arrival ArrivalAt(const JunctionLink& link, double distance, double speed, double wanted);
  const JunctionLink& LinkOf(const Turn& turn) const {
    return map_.links()[static_cast<std::size_t>(turn.link)];
  }
  void Plan(const Channel& channel, double dt, Unit* unit) const;
  void Update(const Channel& channel, double dt, double elapsed, Unit* unit) const;
  void WithdrawRefused(double elapsed, std::vector<Turn>* turns) const;
  void PutInOrder(std::vector<Turn>* turns) const;
  std::optional<double> TimeBetween(const Turn& first, const Turn& second) const;

  const RoadNetwork& network_;
  const JunctionMap& map_;
  SlotParams params_;
  double memory_;  // [s]
  std::vector<std::int32_t> unit_of_junction_;
  std::vector<Unit> units_;
  std::vector<std::vector<Slot>>
      messages_;  // A ring: as many steps as messages are remembered, units within.
  std::uint64_t posted_{0};
  std::int32_t step_{0};
};

}  // namespace lanewise
