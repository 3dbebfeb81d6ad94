#pragma once

#include <memory>
#include <vector>

#include "agents/planning/open_road.h"
#include "agents/planning/sector_drive.h"

namespace lanewise {

/// Driving by sector code and network, and on open roads: what an agent does besides following lanes.
/// One for all agents; an agent's memory is its own row.
class Avoider {
 public:
  Avoider(const RoadNetwork& network, const AgentParams& params);
  ~Avoider();

  /// What the networks of `bp` (and `bp_dwa`) and `bls` choose; at first the networks shipped with Lanewise.
  void SetTables(const AvoidanceTable& bp, const AvoidanceTable& bls);
  /// Seed of the lidar's errors.
  void SetSeed(std::uint64_t seed) { seed_ = seed; }

  /// Before the agents of a step.
  void BeginStep(const Traffic& traffic);

  /// Does this agent, in this step, drive by this class?
  bool Applies(const World& world, AgentIndex ego) const;

  struct Result {
    Plan plan;
    bool steers{false};  ///< `course` is to be steered, not plan.target_d.
    double course{0.0};  ///< [rad] relative to the road.
    bool emergency{false};
  };
  /// @param scratch holds the way and the road view of this agent. @param thread its OpenMP thread.
  Result Drive(const World& world, AgentIndex ego, const Leader& leader, PlanContext context, int thread,
               PlanScratch* scratch);

 private:
  struct Scratch {
    LidarScene reflectors;
    OpenRoadView open;
    WaySearch search;
  };

  WayMemory& Remember(const World& world, AgentIndex ego);
  static void Steer(const OpenRoadPlan& plan, const PlanContext& context, Result* result);
  /// Open roads by the lidar alone: bp, bls, apf. @return false where other vehicles are near.
  bool DriveBySight(const World& world, AgentIndex ego, const PlanContext& context,
                    const PlanScratch& plan_scratch, Scratch* scratch, Result* result);
  bool DriveOpenRoad(const World& world, AgentIndex ego, const PlanContext& context, Avoidance advice,
                     Scratch* scratch, Result* result);
  Plan DriveInLane(const World& world, AgentIndex ego, PlanContext context, std::uint8_t code,
                   Avoidance advice, const Scratch& scratch, PlanScratch* plan_scratch) const;

  AgentParams params_;
  Lidar lidar_;
  bool has_open_roads_{false};
  AvoidanceTable bp_, bls_;
  std::uint64_t seed_{0};
  std::int64_t step_{0};
  std::vector<std::unique_ptr<Scratch>> scratch_;  // By thread.
  std::vector<WayMemory> memory_;                  // By row; empty on networks without open roads.
};

}  // namespace lanewise
