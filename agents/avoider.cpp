#include "agents/avoider.h"

#include <omp.h>

#include <algorithm>
#include <cmath>

#include "agents/sector_net/weight_file.h"

namespace lanewise {
namespace {

bool ScansSectors(Policy policy) {
  return policy == Policy::kBp || policy == Policy::kBls || policy == Policy::kBpDwa ||
         policy == Policy::kApf;
}

/// [m] a chosen side moves a course aimed at within a lane.
constexpr double kLaneShift = 1.0;
/// [m] beside the wanted position that still count as straight on.
constexpr double kStraightOn = 0.3;

}  // namespace

Avoider::Avoider(const RoadNetwork& network, const AgentParams& params)
    : params_(params), lidar_(params.lidar) {
  for (LaneIndex lane = 0; lane < static_cast<LaneIndex>(network.lanes.size()); ++lane)
    has_open_roads_ = has_open_roads_ || IsOpenRoad(network, lane, params.open_road);
  for (int t = 0; t < omp_get_max_threads(); ++t) scratch_.push_back(std::make_unique<Scratch>());
  static const AvoidanceTable bp = TableOf(DefaultBpNet()), bls = TableOf(DefaultBlsNet());
  SetTables(bp, bls);
}

Avoider::~Avoider() = default;

void Avoider::SetTables(const AvoidanceTable& bp, const AvoidanceTable& bls) {
  bp_ = bp;
  bls_ = bls;
}

void Avoider::BeginStep(const Traffic& traffic) {
  ++step_;
  if (has_open_roads_ && memory_.size() < traffic.vehicle_count) memory_.resize(traffic.vehicle_count);
}

bool Avoider::Applies(const World& world, AgentIndex ego) const {
  const Policy policy = world.traffic->policy[ego];
  return ScansSectors(policy) ||
         (policy == Policy::kDwa && has_open_roads_ &&
          IsOpenRoad(*world.network, world.traffic->now.lane[ego], params_.open_road));
}

Avoider::Result Avoider::Drive(const World& world, AgentIndex ego, const Leader& leader, PlanContext context,
                               int thread, PlanScratch* scratch) {
  const Traffic& traffic = *world.traffic;
  const Policy policy = traffic.policy[ego];
  Scratch& own = *scratch_[static_cast<std::size_t>(thread)];
  const bool open = has_open_roads_ && leader.row == kNone &&
                    IsOpenRoad(*world.network, traffic.now.lane[ego], params_.open_road);
  Result result;
  const bool by_sight = policy == Policy::kBp || policy == Policy::kBls || policy == Policy::kApf;
  if (open && by_sight && DriveBySight(world, ego, context, *scratch, &own, &result)) return result;
  std::uint8_t code = 0xff;
  Avoidance advice = Avoidance::kForward;
  if (ScansSectors(policy)) {
    const ScanErrors errors(params_.lidar, seed_, traffic.number[ego], step_);
    code = ScanSectors(world, ego, scratch->way, scratch->view, params_, lidar_,
                       leader.row == kNone ? 0.0 : leader.speed, errors, &own.reflectors);
    if (code != 0) advice = (policy == Policy::kBls ? bls_ : bp_)[code];
  }
  if (open && !by_sight && DriveOpenRoad(world, ego, context, advice, &own, &result)) return result;
  result.plan = ScansSectors(policy) ? DriveInLane(world, ego, context, code, advice, own, scratch)
                                     : PlanDwa(params_, context, scratch);
  return result;
}

WayMemory& Avoider::Remember(const World& world, AgentIndex ego) {
  WayMemory& memory = memory_[static_cast<std::size_t>(ego)];
  const std::int32_t number = world.traffic->number[ego];
  if (memory.vehicle != number) {  // Another vehicle's row before.
    memory.vehicle = number;
    memory.advice = Avoidance::kForward;
    memory.way.count = 0;
  }
  return memory;
}

void Avoider::Steer(const OpenRoadPlan& plan, const PlanContext& context, Result* result) {
  result->plan = {plan.accel, context.d, PlanStatus::kOk};
  result->steers = true;
  result->course = plan.course;
  result->emergency = plan.emergency;
}

bool Avoider::DriveBySight(const World& world, AgentIndex ego, const PlanContext& context,
                           const PlanScratch& plan_scratch, Scratch* scratch, Result* result) {
  SenseOpenRoad(world, ego, params_.open_road.sight, &scratch->open);
  if (scratch->open.vehicles) return false;
  const Traffic& traffic = *world.traffic;
  const ScanErrors errors(params_.lidar, seed_, traffic.number[ego], step_);
  // By whole beams, so that the turned scan has the lidar's own beams.
  const double turn = lidar_.spacing() * std::round(traffic.now.heading_error[ego] / lidar_.spacing());
  LidarScene& scene = scratch->reflectors;
  CollectReflectors(world, ego, plan_scratch.way, plan_scratch.view, params_.lidar.max_range, turn, &scene);
  const RoadScan scan{lidar_, errors, scene, turn};
  const Policy policy = traffic.policy[ego];
  Steer(policy == Policy::kApf
            ? DriveByPotential(world, ego, params_, context.free_speed, context.target_d, scan)
            : DriveBySectors(world, ego, params_, context.free_speed, context.target_d, scan,
                             policy == Policy::kBls ? bls_ : bp_, &Remember(world, ego).advice),
        context, result);
  return true;
}

bool Avoider::DriveOpenRoad(const World& world, AgentIndex ego, const PlanContext& context, Avoidance advice,
                            Scratch* scratch, Result* result) {
  SenseOpenRoad(world, ego, params_.open_road.sight, &scratch->open);
  const OpenRoadView& view = scratch->open;
  if (view.vehicles || (view.standing.empty() && view.moving.empty())) return false;
  Steer(PlanOpenRoad(world, ego, params_, context.free_speed, context.target_d, advice, view,
                     &scratch->search, &Remember(world, ego)),
        context, result);
  return true;
}

Plan Avoider::DriveInLane(const World& world, AgentIndex ego, PlanContext c, std::uint8_t code,
                          Avoidance advice, const Scratch& scratch, PlanScratch* plan_scratch) const {
  const Policy policy = world.traffic->policy[ego];
  // A leader that drives off frees the way: waiting until the zone is empty would thin out every queue.
  const bool makes_room = c.leader_row != kNone && c.leader_speed > c.speed;
  const bool nothing_free = code == 0, stops = nothing_free && !makes_room;
  const auto within = [&](double d) { return std::clamp(d, c.corridor_min, c.corridor_max); };
  if (policy == Policy::kBpDwa) {
    // The network picks the part of the corridor, the window searches there.
    const double from = std::min(c.d, c.target_d), to = std::max(c.d, c.target_d);
    if (nothing_free) {
      c.corridor_min = c.corridor_max = c.target_d;
    } else if (advice == Avoidance::kLeft) {
      c.corridor_min = within(from);
    } else if (advice == Avoidance::kRight) {
      c.corridor_max = within(to);
    } else {
      c.corridor_min = within(from - kStraightOn);
      c.corridor_max = within(to + kStraightOn);
    }
    Plan plan = PlanDwa(params_, c, plan_scratch);
    if (stops && plan.status == PlanStatus::kOk) plan.accel = std::min(plan.accel, 0.0);
    return plan;
  }
  if (!AheadIsFree(code) && !nothing_free) {
    if (policy == Policy::kApf) {
      c.target_d = within(c.d + ShiftByPotential(params_, *c.vehicle, scratch.reflectors));
    } else if (advice != Avoidance::kForward) {
      c.target_d = within(c.d + (advice == Avoidance::kLeft ? kLaneShift : -kLaneShift));
    }
  }
  Plan plan = PlanIdm(params_, c, plan_scratch);
  if (stops) plan.accel = std::min(plan.accel, 0.0);
  return plan;
}

}  // namespace lanewise
