#pragma once

#include <memory>
#include <span>
#include <vector>

#include "agents/agent_params.h"
#include "agents/avoider.h"
#include "agents/coordination/green_advice.h"
#include "agents/coordination/roadside.h"
#include "agents/core/spatial_grid.h"
#include "agents/network/lane_curve.h"
#include "agents/network/road_network.h"
#include "agents/planning/dwa.h"
#include "agents/rules/junction_rules.h"
#include "agents/sensing/lane_occupancy.h"
#include "agents/traffic.h"
#include "agents/v2x/channel.h"

namespace lanewise {

/// The step of all agents: share, sense, decide, plan, control, integrate. Reads traffic->now, writes
/// traffic->next and the commands; row i is written by agent i only, so the result does not depend on the
/// number of threads. After warm-up a step does not allocate.
class AgentPipeline {
 public:
  AgentPipeline(const RoadNetwork& network, const std::vector<LaneCurve>& curves, const AgentParams& params,
                Rules rules = Rules::kSumo);
  ~AgentPipeline();

  /// World poses of agent-driven vehicles in traffic->now from their lane, s and d.
  void UpdatePoses(Traffic* traffic) const;
  /// One step of `dt` [s]. `guarded[i]`: at the junction ahead of agent i the rules say who goes first.
  void Step(double dt, const std::vector<std::uint8_t>& guarded, Traffic* traffic, Commands* commands);

  const AgentParams& params() const { return params_; }
  /// Networks and seed of the policies that see by lidar.
  Avoider& avoider() { return avoider_; }
  /// Messages between vehicles and with roadside units; closed until it is opened.
  Channel& channel() { return channel_; }
  /// Null while SUMO answers for the rules.
  const JunctionRules* rules() const { return rules_.get(); }
  /// Has the agents take green-light advice from these units from now on.
  void AdviseBy(const Roadside* roadside) { roadside_ = roadside; }
  /// Has the agents keep to the turns of these coordinators; they answer for the rules.
  void CoordinateBy(const JunctionSlots* slots) { rules_->CoordinateBy(slots); }
  /// By row: what the agents were advised in the last step.
  std::span<const Advice> advice() const { return advice_; }

 private:
  void StepAgent(const World& world, AgentIndex i, double dt, bool guarded, PlanScratch* scratch,
                 Traffic* traffic, Commands* commands);

  const RoadNetwork& network_;
  const std::vector<LaneCurve>& curves_;
  AgentParams params_;
  LaneOccupancy occupancy_;
  SpatialGrid grid_{20.0};
  Avoider avoider_;
  Channel channel_;
  std::unique_ptr<JunctionRules> rules_;  // Null: SUMO answers for them.
  const Roadside* roadside_{nullptr};     // Null: no advice.
  std::vector<Advice> advice_;            // By row.
  std::vector<double> center_x_, center_y_;
  std::vector<std::unique_ptr<PlanScratch>> scratch_;  // By thread.
};

}  // namespace lanewise
