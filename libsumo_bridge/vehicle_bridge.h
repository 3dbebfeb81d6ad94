#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <unordered_map>
#include <vector>

#include "agents/agent_params.h"
#include "agents/network/lane_curve.h"
#include "agents/network/road_network.h"
#include "agents/traffic.h"
#include "libsumo_bridge/coupling_audit.h"

namespace lanewise {

/// Which of the vehicles without a policy of their own get the run's policy; SUMO drives the others. Drawn by
/// vehicle id, so a higher rate contains the vehicles of a lower one, whatever the policy.
struct Penetration {
  double rate{1.0};  ///< Share of vehicles, 0 to 1.
  std::int64_t seed{0};
};
bool IsEquipped(const Penetration& penetration, std::string_view vehicle_id);

/// A vehicle as SUMO knows it; what the results call it.
struct VehicleRecord {
  std::string id, type, vehicle_class;
  double depart{0.0};        ///< [s]
  double depart_delay{0.0};  ///< [s] waited for insertion, to a step.
};

/// What SUMO says of one vehicle in one step beyond its motion.
struct EmissionRates {
  double co2{0.0}, nox{0.0}, pmx{0.0}, fuel{0.0};  ///< [mg/s]
  double electricity{0.0};                         ///< [Wh/s]
};

/// A person that entered the simulation in the last step.
struct NewPerson {
  std::size_t row;  ///< Of Traffic.
  VehicleRecord record;
};

/// Vehicles that left the simulation in the last step.
struct Departure {
  std::int32_t number;
  bool arrived;  ///< False: removed in another way.
};

/// The road-frame coupling: SUMO carries the arc length, the agent owns the motion. Each step the bridge
/// reads who is there and what SUMO realised, audits it against what was commanded, and writes the
/// next commands. One thread only.
class VehicleBridge {
 public:
  /// @param passive_step [s] SUMO's default action step where it is passive: whom it drives none the less, if
  /// only at planned stops, acts in every step. 0: it is not passive.
  VehicleBridge(const RoadNetwork& network, const std::vector<LaneCurve>& curves, const AgentParams& params,
                Policy default_policy, Rules rules, Penetration penetration = {}, double passive_step = 0.0);

  /// After a SUMO step: takes in new vehicles, drops those that left, reads the rest into traffic->now.
  void Read(double time, double dt, Traffic* traffic);
  /// Before a SUMO step: hands the agents' commands over.
  void Write(double dt, Traffic* traffic, const Commands& commands);

  /// Gives a vehicle a route, from the edge it is on. @return false if SUMO refused.
  bool SetRoute(std::size_t row, std::span<const EdgeIndex> route, Traffic* traffic);
  /// Parks a vehicle where it stands for `duration` [s]. @return false if there is no room, or SUMO refused.
  bool Hold(std::size_t row, double duration, Traffic* traffic);
  /// Ends a Hold. @return false if the vehicle is not parked.
  bool Release(std::size_t row);

  /// By row: at the junction ahead of this vehicle the rules say who goes first; with Rules::kSumo SUMO's
  /// checks are on in the coming step.
  const std::vector<std::uint8_t>& guarded() const { return guarded_; }
  const VehicleRecord& record(std::size_t row) const { return records_[row]; }
  std::span<const std::int32_t> new_vehicles() const {
    return new_vehicles_;
  }  ///< Rows that entered in the last Read.
  std::span<const NewPerson> new_persons() const { return new_persons_; }     ///< Likewise.
  std::span<const Departure> gone() const { return gone_; }                   ///< That left in the last Read.
  const std::vector<EmissionRates>& emissions() const { return emissions_; }  ///< By row.
  const CouplingAudit& audit() const { return audit_; }
  std::int64_t teleports() const { return teleports_; }
  std::int64_t emergency_stops() const { return emergency_stops_; }
  /// Halts of an agent within 10 m of the end of a lane that does not lead along its route.
  std::int64_t lane_end_halts() const { return lane_end_halts_; }
  /// Times an agent left its route where its lane led, for want of a lane change, and [m] this took in all.
  std::int64_t detours() const { return detours_; }
  double detour_length() const { return detour_length_; }
  /// Vehicles whose departure is due but which found no room yet.
  std::size_t pending() const { return pending_since_.size(); }

 private:
  static constexpr double kFar = 1e9;  // [m]

  struct Stop {
    LaneIndex lane;
    double end;  // [m]
  };
  /// What the bridge remembers of a vehicle besides its row in Traffic.
  struct Coupled {
    std::string route_id;
    std::vector<Stop> stops;  // Planned, next first.
    VehicleClassMask class_mask{0};
    bool handed_back{false};    // SUMO drives it: planned stop.
    bool commanded{false};      // The last Write commanded it.
    bool checks_on{false};      // Speed mode 31 is set.
    bool route_changed{false};  // Since the last command.
    bool halted_at_lane_end{false};
    LaneIndex no_detour{kNone};  // This lane's way is known not to lead back.
    std::int8_t change_commanded{0};
    double change_shift{0.0};        // [m] see Commands.
    LaneIndex expected_lane{kNone};  // Where the command should lead.
    double expected_s{0.0};          // [m]
    double commanded_speed{0.0};     // [m/s]
  };

  /// Notes since when vehicles wait for insertion: SUMO 1.15 does not tell it of those that were inserted.
  void NotePending(double time);
  void AddVehicle(const std::string& id, double time, Traffic* traffic);
  void RemoveVehicle(std::size_t row, bool arrived, Traffic* traffic);
  bool ReadVehicle(std::size_t row, double dt, Traffic* traffic);
  void ReadNative(std::size_t row, LaneIndex lane, double s, double speed, double dt, Traffic* traffic);
  void ReadDriven(std::size_t row, LaneIndex lane, double s, double speed, double dt, Traffic* traffic);
  void ReadPersons(double time, Traffic* traffic);
  void ReadSignals(Traffic* traffic) const;
  void ReadAllowedSpeed(std::size_t row, Traffic* traffic);
  void FollowRoute(std::size_t row, LaneIndex lane, Traffic* traffic);
  void Replan(std::size_t row, Traffic* traffic);
  void UpdateStops(std::size_t row, Traffic* traffic);
  void Audit(std::size_t row, LaneIndex lane, double s, double speed, const Traffic& traffic);
  void Expect(std::size_t row, double speed, int change, double shift, double dt, const Traffic& traffic);
  void SetChecks(std::size_t row, bool on);
  /// The first lane on the way that does not lead along the route, if one is near.
  struct DeadEnd {
    LaneIndex lane{kNone};
    std::size_t position{0};  // Of its edge in the route.
    double distance{kFar};    // [m] to its end.
  };
  DeadEnd FindDeadEnd(std::size_t row, const Traffic& traffic) const;
  /// The route edge behind `position` with the vehicle's next planned stop; the last one if it has none.
  std::size_t NextStop(const Coupled& coupled, std::span<const EdgeIndex> route, std::size_t position) const;
  /// Gives the vehicle a route that follows the dead end's lane and comes back, if there is one.
  void TakeDetour(std::size_t row, Traffic* traffic);
  /// Lane changes to the lane of the vehicle's stop on this edge, else to the best one for its route: > 0 to
  /// the left, < 0 to the right.
  int ChangesNeeded(std::size_t row, const Traffic& traffic) const;
  bool NeedsGuard(std::size_t row, const Traffic& traffic) const;
  const RoutePlan* PlanFor(const std::vector<std::string>& edges, VehicleClassMask vehicle_class);
  Policy PolicyOf(const std::string& id, const std::string& type, const std::string& vehicle_class);

  const RoadNetwork& network_;
  const std::vector<LaneCurve>& curves_;
  AgentParams params_;
  Policy default_policy_;
  Penetration penetration_;
  double passive_step_;  // [s]
  Rules rules_;
  std::vector<bool> lane_guarded_;  // By lane: a normal lane's way out, or an internal lane, has conflicts.
  std::int32_t next_number_{0};
  std::vector<VehicleRecord> records_;    // By row.
  std::vector<Coupled> coupled_;          // By row.
  std::vector<EmissionRates> emissions_;  // By row.
  std::vector<std::uint8_t> guarded_;     // By row.
  std::unordered_map<std::string, std::size_t> row_of_;
  std::vector<std::int32_t> new_vehicles_;
  std::vector<NewPerson> new_persons_;
  std::vector<Departure> gone_;
  std::map<std::pair<std::vector<EdgeIndex>, VehicleClassMask>, std::unique_ptr<RoutePlan>> plans_;
  std::unordered_map<std::string, std::string> type_policy_;
  std::unordered_map<std::string, std::int32_t> person_number_;
  std::unordered_map<std::string, double> pending_since_;  // [s] By vehicle id, until it is inserted.
  CouplingAudit audit_;
  std::int64_t teleports_{0}, emergency_stops_{0}, lane_end_halts_{0}, detours_{0};
  double detour_length_{0.0};  // [m]
  std::int64_t step_{0};
};

/// Parses a value of --rules. @throws ConfigError likewise.
Rules ParseRules(std::string_view name, std::string_view origin);

/// Parses a policy name. @throws ConfigError naming `origin` and the names allowed.
Policy ParsePolicy(std::string_view name, std::string_view origin);

}  // namespace lanewise
