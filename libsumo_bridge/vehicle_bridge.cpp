#include "libsumo_bridge/vehicle_bridge.h"

#include <fmt/format.h>

#include <libsumo/libsumo.h>

#include <algorithm>
#include <cmath>
#include <unordered_set>

#include "agents/core/check.h"
#include "agents/core/random.h"
#include "agents/network/detour.h"
#include "agents/sensing/road_view.h"
#include "libsumo_bridge/sumo_frame.h"

namespace lanewise {
namespace {

using SumoVehicle = libsumo::Vehicle;

// Bits of Vehicle::setSpeedMode: every check on, and every check off (bit 5 switches the one inside junctions
// off).
constexpr int kAllChecks = 31;
constexpr int kNoChecks = 32;
// Vehicle::setLaneChangeMode: SUMO changes lanes by itself (its default), and never.
constexpr int kSumoLaneChanges = 1621;
constexpr int kNoLaneChanges = 0;

// Vehicle::setStop: beside the road; and the bit of getStopState that tells of it.
constexpr int kParkingStop = 1;
constexpr int kIsParking = 2;

constexpr double kParkingRoom = 1.0;    // [m]
constexpr double kDeadEndView = 30.0;   // [m]
constexpr double kLaneEndZone = 10.0;   // [m]
constexpr double kStandingSpeed = 0.1;  // [m/s]
constexpr double kStopMargin = 20.0;    // [m] beyond braking distance at which a planned stop is SUMO's.

/// Classes whose motion is not a road vehicle's: they stay with SUMO.
bool IsRoadVehicle(const std::string& vehicle_class) {
  for (const char* other :
       {"rail", "rail_urban", "rail_electric", "rail_fast", "tram", "ship", "pedestrian"}) {
    if (vehicle_class == other) return false;
  }
  return true;
}

VehicleParams ReadParams(const std::string& id, const std::string& vehicle_class) {
  VehicleParams params;
  params.length = SumoVehicle::getLength(id);
  params.width = SumoVehicle::getWidth(id);
  params.min_gap = SumoVehicle::getMinGap(id);
  params.max_accel = SumoVehicle::getAccel(id);
  params.max_decel = SumoVehicle::getDecel(id);
  params.emergency_decel = std::max(params.max_decel, SumoVehicle::getEmergencyDecel(id));
  params.time_gap = SumoVehicle::getTau(id);
  params.max_speed = SumoVehicle::getMaxSpeed(id);
  params.speed_factor = SumoVehicle::getSpeedFactor(id);
  AxlesAndActuators(vehicle_class, &params);
  return params;
}

bool HasConflicts(const RoadNetwork& network, const Connection& connection) {
  if (connection.signal != kNone) return true;
  if (connection.junction == kNone || connection.request == kNone) return false;
  const RightOfWay& request = network.junctions[connection.junction].requests[connection.request];
  const auto any = [](const std::vector<bool>& bits) {
    return std::find(bits.begin(), bits.end(), true) != bits.end();
  };
  return any(request.response) || any(request.foes);
}

}  // namespace

Policy ParsePolicy(std::string_view name, std::string_view origin) {
  for (std::size_t i = 0; i < std::size(kPolicyNames); ++i) {
    if (kPolicyNames[i] == name) return static_cast<Policy>(i);
  }
  throw ConfigError(
      fmt::format("{}: unknown policy '{}'; allowed: {}", origin, name, fmt::join(kPolicyNames, ", ")));
}

Rules ParseRules(std::string_view name, std::string_view origin) {
  for (std::size_t i = 0; i < std::size(kRulesNames); ++i) {
    if (kRulesNames[i] == name) return static_cast<Rules>(i);
  }
  throw ConfigError(
      fmt::format("{}: unknown value '{}'; allowed: {}", origin, name, fmt::join(kRulesNames, ", ")));
}

bool IsEquipped(const Penetration& penetration, std::string_view vehicle_id) {
  const RandomStream stream(static_cast<std::uint64_t>(penetration.seed), HashText(vehicle_id),
                            RandomPurpose::kPenetration, 0);
  return stream.Uniform(0) < penetration.rate;
}

VehicleBridge::VehicleBridge(const RoadNetwork& network, const std::vector<LaneCurve>& curves,
                             const AgentParams& params, Policy default_policy, Rules rules,
                             Penetration penetration, double passive_step)
    : network_(network),
      curves_(curves),
      params_(params),
      default_policy_(default_policy),
      penetration_(penetration),
      passive_step_(passive_step),
      rules_(rules),
      lane_guarded_(network.lanes.size()) {
  for (const Connection& connection : network.connections) {
    if (!HasConflicts(network, connection)) continue;
    if (!network.lanes[connection.from].internal) lane_guarded_[connection.from] = true;
    for (LaneIndex via = connection.via; via != kNone;) {
      lane_guarded_[via] = true;
      const Lane& lane = network.lanes[via];
      via = lane.outgoing.empty() ? kNone : network.connections[lane.outgoing.front()].via;
    }
  }
}

Policy VehicleBridge::PolicyOf(const std::string& id, const std::string& type,
                               const std::string& vehicle_class) {
  if (!IsRoadVehicle(vehicle_class)) return Policy::kSumo;
  const auto [it, fresh] = type_policy_.try_emplace(type);
  if (fresh) it->second = libsumo::VehicleType::getParameter(type, "lanewise.policy");
  const std::string own = SumoVehicle::getParameter(id, "lanewise.policy");
  if (!own.empty()) return ParsePolicy(own, fmt::format("vehicle '{}', param lanewise.policy", id));
  if (!it->second.empty())
    return ParsePolicy(it->second, fmt::format("vType '{}', param lanewise.policy", type));
  return IsEquipped(penetration_, id) ? default_policy_ : Policy::kSumo;
}

const RoutePlan* VehicleBridge::PlanFor(const std::vector<std::string>& edges,
                                        VehicleClassMask vehicle_class) {
  std::vector<EdgeIndex> route;
  for (const std::string& id : edges) {
    const EdgeIndex edge = network_.FindEdge(id);
    if (edge == kNone) return nullptr;
    route.push_back(edge);
  }
  if (route.empty()) return nullptr;
  std::unique_ptr<RoutePlan>& plan = plans_[{route, vehicle_class}];
  if (!plan) plan = std::make_unique<RoutePlan>(network_, route, vehicle_class);
  return plan.get();
}

void VehicleBridge::Read(double time, double dt, Traffic* traffic) {
  traffic->Resize(traffic->vehicle_count);  // Persons are listed anew below.
  std::swap(traffic->now, traffic->next);
  new_vehicles_.clear();
  gone_.clear();
  ++step_;
  teleports_ += libsumo::Simulation::getStartingTeleportNumber();
  emergency_stops_ += libsumo::Simulation::getEmergencyStoppingVehiclesNumber();

  for (const std::string& id : libsumo::Simulation::getArrivedIDList()) {
    const auto it = row_of_.find(id);
    if (it != row_of_.end()) RemoveVehicle(it->second, true, traffic);
  }
  const std::size_t known = traffic->vehicle_count;
  for (const std::string& id : libsumo::Simulation::getDepartedIDList()) AddVehicle(id, time, traffic);
  NotePending(time);
  for (std::size_t row = 0; row < traffic->vehicle_count;) {
    if (ReadVehicle(row, dt, traffic)) {
      ++row;
    } else {
      RemoveVehicle(row, false, traffic);  // Gone without arriving.
    }
  }
  for (std::size_t row = std::min(known, traffic->vehicle_count); row < traffic->vehicle_count; ++row) {
    new_vehicles_.push_back(static_cast<std::int32_t>(row));
  }
  guarded_.resize(traffic->vehicle_count);
  for (std::size_t row = 0; row < traffic->vehicle_count; ++row) {
    guarded_[row] = traffic->driven[row] && NeedsGuard(row, *traffic);
  }
  ReadPersons(time, traffic);
  ReadSignals(traffic);
}

void VehicleBridge::ReadSignals(Traffic* traffic) const {
  traffic->signal_states.resize(network_.signal_ids.size());
  for (std::size_t k = 0; k < network_.signal_ids.size(); ++k) {
    traffic->signal_states[k] = libsumo::TrafficLight::getRedYellowGreenState(network_.signal_ids[k]);
  }
}

void VehicleBridge::NotePending(double time) {
  const std::vector<std::string> ids = libsumo::Simulation::getPendingVehicles();
  for (const std::string& id : ids) pending_since_.try_emplace(id, time);
  if (pending_since_.size() == ids.size()) return;
  // Some were discarded instead of inserted.
  const std::unordered_set<std::string> pending(ids.begin(), ids.end());
  std::erase_if(pending_since_, [&](const auto& entry) { return !pending.contains(entry.first); });
}

void VehicleBridge::AddVehicle(const std::string& id, double time, Traffic* traffic) {
  const std::size_t row = traffic->vehicle_count++;
  traffic->Resize(traffic->vehicle_count);
  records_.resize(traffic->vehicle_count);
  coupled_.resize(traffic->vehicle_count);
  emissions_.resize(traffic->vehicle_count);
  row_of_[id] = row;
  Coupled& coupled = coupled_[row] = {};
  VehicleRecord& record = records_[row];
  const auto waited = pending_since_.extract(id);
  const double delay = waited.empty() ? 0.0 : time - waited.mapped();
  record = {id, SumoVehicle::getTypeID(id), SumoVehicle::getVehicleClass(id), time, delay};
  coupled.class_mask = VehicleClassBit(record.vehicle_class);

  traffic->number[row] = next_number_++;
  traffic->id_hash[row] = HashText(id);
  traffic->vehicle_class[row] = coupled.class_mask;
  traffic->params[row] = ReadParams(id, record.vehicle_class);
  traffic->policy[row] = PolicyOf(id, record.type, record.vehicle_class);
  traffic->driven[row] = 0;
  traffic->hazard[row] = 0;
  traffic->speed_limit[row] = SumoVehicle::getAllowedSpeed(id);
  traffic->stop_distance[row] = kFar;
  traffic->stop_lane[row] = kNone;
  Motion& now = traffic->now;
  now.lane[row] = kNone;
  now.speed[row] = 0.0;
  now.heading[row] = 0.0;
  now.since_change[row] = 0.0f;
  now.waited[row] = 0.0f;
  now.refused[row] = 0.0f;
  now.yielded_to[row] = kNone;
  now.rule[row] = {};
  Replan(row, traffic);
  for (const auto& stop : SumoVehicle::getStops(id))
    coupled.stops.push_back({network_.FindLane(stop.lane), stop.endPos});
  if (traffic->plan[row] == nullptr) traffic->policy[row] = Policy::kSumo;
  // The call gives the vehicle a type of its own; a type's own action step stays.
  if (passive_step_ > 0.0 && (traffic->policy[row] == Policy::kSumo || !coupled.stops.empty()) &&
      std::abs(SumoVehicle::getActionStepLength(id) - passive_step_) < 1e-3)
    SumoVehicle::setActionStepLength(id, libsumo::Simulation::getDeltaT());
  if (traffic->policy[row] == Policy::kSumo) return;
  SumoVehicle::setLaneChangeMode(id, kNoLaneChanges);
  SumoVehicle::setSpeedMode(id, kAllChecks);
  coupled.checks_on = true;
}

void VehicleBridge::RemoveVehicle(std::size_t row, bool arrived, Traffic* traffic) {
  gone_.push_back({traffic->number[row], arrived});
  row_of_.erase(records_[row].id);
  const std::size_t last = traffic->vehicle_count - 1;
  if (row != last) {
    records_[row] = std::move(records_[last]);
    coupled_[row] = std::move(coupled_[last]);
    emissions_[row] = emissions_[last];
    row_of_[records_[row].id] = row;
  }
  records_.pop_back();
  coupled_.pop_back();
  emissions_.pop_back();
  traffic->RemoveRow(row);
  traffic->vehicle_count = last;
}

bool VehicleBridge::ReadVehicle(std::size_t row, double dt, Traffic* traffic) {
  const std::string& id = records_[row].id;
  Motion& now = traffic->now;
  const LaneIndex last_lane = now.lane[row];
  try {
    const std::string lane_id = SumoVehicle::getLaneID(id);
    // Most vehicles are where they were: comparing one id is cheaper than looking it up.
    const LaneIndex expected = coupled_[row].commanded ? coupled_[row].expected_lane : last_lane;
    const LaneIndex lane =
        expected != kNone && network_.lanes[expected].id == lane_id ? expected : network_.FindLane(lane_id);
    const double speed = SumoVehicle::getSpeed(id);
    if (lane == kNone) {  // Parked beside the road, teleporting, or on no road of ours.
      now.lane[row] = kNone;
      now.speed[row] = std::max(0.0, speed);
      const bool parked = (SumoVehicle::getStopState(id) & kIsParking) != 0;
      traffic->hazard[row] = parked;
      if (parked) {
        const libsumo::TraCIPosition position = SumoVehicle::getPosition(id);
        now.x[row] = position.x;
        now.y[row] = position.y;
      } else if (traffic->policy[row] != Policy::kSumo) {
        audit_.Count(AuditCause::kTeleport, 0.0, 0.0);
      }
      traffic->driven[row] = 0;
      coupled_[row].commanded = false;
      return true;
    }
    const double s = SumoVehicle::getLanePosition(id);
    if (lane != last_lane) {
      ReadAllowedSpeed(row, traffic);
      if (traffic->plan[row] != nullptr) FollowRoute(row, lane, traffic);
    } else if ((step_ + traffic->number[row]) % 10 == 0 && traffic->plan[row] != nullptr &&
               SumoVehicle::getRouteID(id) != coupled_[row].route_id) {
      Replan(row, traffic);
    }
    if (coupled_[row].commanded) {
      ReadDriven(row, lane, s, speed, dt, traffic);
    } else {
      ReadNative(row, lane, s, speed, dt, traffic);
      if (coupled_[row].handed_back) audit_.Count(AuditCause::kHandedBack, 0.0, 0.0);
    }
    UpdateStops(row, traffic);
    traffic->driven[row] = traffic->policy[row] != Policy::kSumo && !coupled_[row].handed_back;
    emissions_[row] = {SumoVehicle::getCO2Emission(id), SumoVehicle::getNOxEmission(id),
                       SumoVehicle::getPMxEmission(id), SumoVehicle::getFuelConsumption(id),
                       SumoVehicle::getElectricityConsumption(id)};
  } catch (const libsumo::TraCIException&) {
    return false;  // It left the simulation.
  }
  return true;
}

void VehicleBridge::ReadAllowedSpeed(std::size_t row, Traffic* traffic) {
  const std::string& id = records_[row].id;
  const double max_speed = traffic->params[row].max_speed;
  const bool by_agent = traffic->policy[row] != Policy::kSumo;
  if (by_agent) SumoVehicle::setMaxSpeed(id, max_speed);
  const double allowed = traffic->speed_limit[row] = SumoVehicle::getAllowedSpeed(id);
  // SUMO expects a vehicle without checks to speed up to its maximum, whatever the road allows, and holds
  // back for it all who have to yield: the maximum tells SUMO what the agent will not exceed.
  if (by_agent && !coupled_[row].handed_back) SumoVehicle::setMaxSpeed(id, allowed);
}

void VehicleBridge::FollowRoute(std::size_t row, LaneIndex lane, Traffic* traffic) {
  if (network_.lanes[lane].internal) {
    // Edges shorter than a step are passed unseen: the edge left last is the one that ends at this junction.
    const auto route = traffic->plan[row]->route();
    const std::int32_t junction = network_.edges[network_.lanes[lane].edge].to_junction;
    std::size_t position = static_cast<std::size_t>(traffic->route_position[row]);
    while (position < route.size() && network_.edges[route[position]].to_junction != junction) ++position;
    if (position < route.size()) traffic->route_position[row] = static_cast<std::int32_t>(position);
    return;
  }
  if (SumoVehicle::getRouteID(records_[row].id) != coupled_[row].route_id) Replan(row, traffic);
  const auto route = traffic->plan[row]->route();
  std::int32_t& position = traffic->route_position[row];
  const EdgeIndex edge = network_.lanes[lane].edge;
  const auto is_at = [&](std::int32_t p) {
    return static_cast<std::size_t>(p) < route.size() && route[p] == edge;
  };
  if (is_at(position)) return;
  traffic->now.yielded_to[row] = kNone;  // A new edge: the right to be let in starts afresh.
  position = is_at(position + 1) ? position + 1 : SumoVehicle::getRouteIndex(records_[row].id);
}

void VehicleBridge::Replan(std::size_t row, Traffic* traffic) {
  const std::string& id = records_[row].id;
  traffic->plan[row] = PlanFor(SumoVehicle::getRoute(id), coupled_[row].class_mask);
  traffic->route_position[row] = std::max(0, SumoVehicle::getRouteIndex(id));
  coupled_[row].route_id = SumoVehicle::getRouteID(id);
  coupled_[row].route_changed = true;
  coupled_[row].no_detour = kNone;
}

void VehicleBridge::ReadNative(std::size_t row, LaneIndex lane, double s, double speed, double dt,
                               Traffic* traffic) {
  Motion& now = traffic->now;
  const std::string& id = records_[row].id;
  libsumo::TraCIPosition position = SumoVehicle::getPosition(id);
  const PathPoint point = curves_[lane].At(s);
  const Lane& its_lane = network_.lanes[lane];
  if (traffic->policy[row] != Policy::kSumo && !its_lane.shape.empty() && its_lane.length > 0.0) {
    // Where an agent's curve leaves SUMO's center line, it does not leap when SUMO drives it for a while.
    const Point2 middle = PointOn(its_lane.shape, s / its_lane.length);
    position.x += point.x - middle.x;
    position.y += point.y - middle.y;
  }
  const bool fresh = now.lane[row] == kNone;
  now.lane[row] = lane;
  now.s[row] = s;
  now.heading[row] = HeadingFromSumo(SumoVehicle::getAngle(id));
  now.heading_error[row] = WrapAngle(now.heading[row] - point.heading);
  now.x[row] = position.x;
  now.y[row] = position.y;
  now.d[row] =
      (position.y - point.y) * std::cos(point.heading) - (position.x - point.x) * std::sin(point.heading);
  now.accel[row] = fresh ? 0.0 : (speed - traffic->next.speed[row]) / dt;
  now.speed[row] = speed;
  now.speed_ref[row] = speed;
  now.planned_accel[row] = now.accel[row];
  now.planned_jerk[row] = 0.0;
  now.time_gap[row] = traffic->params[row].time_gap;
  now.follows[row] = kNone;
  now.steering_angle[row] = 0.0;
  now.curvature[row] = point.curvature;
  now.speed_pid[row] = now.steering_pid[row] = {};
  // What it asks of its neighbours follows from its route and its stop, as with an agent.
  const int changes = traffic->plan[row] == nullptr ? 0 : ChangesNeeded(row, *traffic);
  now.blinker[row] = static_cast<std::int8_t>(std::clamp(changes, -1, 1));
  now.urgent[row] = changes != 0;
}

int VehicleBridge::ChangesNeeded(std::size_t row, const Traffic& traffic) const {
  const Lane& lane = network_.lanes[traffic.now.lane[row]];
  if (traffic.stop_lane[row] != kNone && !lane.internal) return traffic.stop_lane[row] - lane.index;
  const RoutePlan& plan = *traffic.plan[row];
  const auto position = static_cast<std::size_t>(traffic.route_position[row]);
  return lane.internal || plan.route()[position] != lane.edge ? 0 : plan.At(position, lane.index).changes;
}

void VehicleBridge::ReadDriven(std::size_t row, LaneIndex lane, double s, double speed, double dt,
                               Traffic* traffic) {
  Motion& now = traffic->now;
  const Motion& before = traffic->next;  // Swapped: the state the command was given in.
  Coupled& coupled = coupled_[row];
  Audit(row, lane, s, speed, *traffic);
  coupled.route_changed = false;

  if (std::abs(speed - coupled.commanded_speed) > CouplingAudit::kTolerance) {
    // SUMO drove less far, and then the lateral motion did not get as far either; or farther, where it brakes
    // less hard.
    const bool moves = coupled.commanded_speed > kStandingSpeed;
    const double ratio = moves ? speed / coupled.commanded_speed : 0.0, share = std::min(ratio, 1.0);
    now.d[row] = before.d[row] + share * (now.d[row] - before.d[row]);
    now.heading_error[row] =
        before.heading_error[row] + share * (now.heading_error[row] - before.heading_error[row]);
    now.speed[row] = moves ? ratio * now.speed[row] : speed * curves_[lane].scale();
    if (speed > kStandingSpeed) now.accel[row] = (now.speed[row] - before.speed[row]) / dt;
    now.speed_ref[row] = now.speed[row];
    now.speed_pid[row] = {};
  }
  const LaneIndex left_lane = now.lane[row];
  if (coupled.change_commanded != 0 && lane == network_.Neighbor(left_lane, coupled.change_commanded)) {
    const PathPoint from = curves_[left_lane].At(s - coupled.change_shift);
    const PathPoint to = curves_[lane].At(s);
    const double x = from.x - now.d[row] * std::sin(from.heading),
                 y = from.y + now.d[row] * std::cos(from.heading);
    now.d[row] = (y - to.y) * std::cos(to.heading) - (x - to.x) * std::sin(to.heading);
    now.heading_error[row] = WrapAngle(now.heading_error[row] + from.heading - to.heading);
    now.blinker[row] = 0;
    now.urgent[row] = 0;
    now.since_change[row] = 0.0f;
    now.steering_pid[row] = {};
  }
  now.lane[row] = lane;
  now.s[row] = s;

  // Watch for agents that stand at the end of a lane that does not lead on.
  const bool halts = speed < kStandingSpeed && FindDeadEnd(row, *traffic).distance < kLaneEndZone;
  if (halts && !coupled.halted_at_lane_end) ++lane_end_halts_;
  coupled.halted_at_lane_end = halts;
}

VehicleBridge::DeadEnd VehicleBridge::FindDeadEnd(std::size_t row, const Traffic& traffic) const {
  LaneIndex lane = traffic.now.lane[row];
  if (lane == kNone || traffic.plan[row] == nullptr) return {};
  const RoutePlan& plan = *traffic.plan[row];
  std::size_t position = static_cast<std::size_t>(traffic.route_position[row]);
  double distance = -traffic.now.s[row];
  while (distance < kDeadEndView) {
    distance += network_.lanes[lane].length;
    const LaneIndex next = NextLane(network_, plan, position, lane);
    if (next == kNone) {
      const bool lost = plan.route()[position] != network_.lanes[lane].edge && !network_.lanes[lane].internal;
      if (lost || position + 1 >= plan.route().size()) return {};
      return {lane, position, distance};
    }
    if (!network_.lanes[next].internal) ++position;
    lane = next;
  }
  return {};
}

std::size_t VehicleBridge::NextStop(const Coupled& coupled, std::span<const EdgeIndex> route,
                                    std::size_t position) const {
  std::size_t at = route.size() - 1;
  for (const Stop& stop : coupled.stops) {
    const EdgeIndex edge = stop.lane == kNone ? kNone : network_.lanes[stop.lane].edge;
    const auto found =
        std::find(route.begin() + static_cast<std::ptrdiff_t>(position) + 1, route.end(), edge);
    if (found != route.end()) at = std::min(at, static_cast<std::size_t>(found - route.begin()));
  }
  return at;
}

void VehicleBridge::TakeDetour(std::size_t row, Traffic* traffic) {
  Coupled& coupled = coupled_[row];
  const DeadEnd dead_end = FindDeadEnd(row, *traffic);
  if (dead_end.lane == kNone || coupled.no_detour == dead_end.lane) return;
  const auto route = traffic->plan[row]->route();
  const std::optional<Detour> detour =
      FindDetour(network_, route, dead_end.position, NextStop(coupled, route, dead_end.position),
                 dead_end.lane, coupled.class_mask, params_.lane_change.max_detour);
  if (!detour) {
    coupled.no_detour = dead_end.lane;  // It waits for a gap.
    return;
  }
  std::vector<EdgeIndex> edges(route.begin() + traffic->route_position[row],
                               route.begin() + static_cast<std::ptrdiff_t>(dead_end.position));
  edges.insert(edges.end(), detour->route.begin(), detour->route.end());
  if (!SetRoute(row, edges, traffic)) {
    coupled.no_detour = dead_end.lane;
    return;
  }
  ++detours_;
  detour_length_ += detour->extra_length;
}

void VehicleBridge::Expect(std::size_t row, double speed, int change, double shift, double dt,
                           const Traffic& traffic) {
  Coupled& coupled = coupled_[row];
  coupled.commanded = true;
  coupled.commanded_speed = speed;
  coupled.change_commanded = static_cast<std::int8_t>(change);
  coupled.change_shift = shift;
  LaneIndex lane = traffic.now.lane[row];
  double s = traffic.now.s[row] + shift + speed * dt;
  std::size_t position = static_cast<std::size_t>(traffic.route_position[row]);
  const LaneIndex start = lane;
  while (s > network_.lanes[lane].length) {
    const LaneIndex next = NextLane(network_, *traffic.plan[row], position, lane);
    if (next == kNone) break;
    s -= network_.lanes[lane].length;
    if (!network_.lanes[next].internal) ++position;
    lane = next;
  }
  coupled.expected_lane = change != 0 && lane == start ? network_.Neighbor(lane, change) : lane;
  coupled.expected_s = s;
}

void VehicleBridge::Audit(std::size_t row, LaneIndex lane, double s, double speed, const Traffic& traffic) {
  const Coupled& coupled = coupled_[row];
  AuditCause cause = AuditCause::kMidBlock;
  double position_error = 0.0;
  if (coupled.checks_on) {
    cause = AuditCause::kJunctionGuard;
  } else if (lane != coupled.expected_lane) {
    cause = coupled.change_commanded != 0 && lane == traffic.now.lane[row] ? AuditCause::kLaneChangeMissed
            : coupled.route_changed                                        ? AuditCause::kRouteChange
                                                                           : AuditCause::kOtherLink;
  }
  if (lane == coupled.expected_lane) position_error = std::abs(s - coupled.expected_s);
  audit_.Count(cause, position_error, std::abs(speed - coupled.commanded_speed));
}

void VehicleBridge::UpdateStops(std::size_t row, Traffic* traffic) {
  Coupled& coupled = coupled_[row];
  traffic->stop_distance[row] = kFar;
  traffic->stop_lane[row] = kNone;
  traffic->hazard[row] = 0;
  if (coupled.stops.empty() && !coupled.handed_back) return;
  const std::string& id = records_[row].id;
  const bool native = !coupled.commanded;
  if (native) {
    const int state = SumoVehicle::getStopState(id);
    const bool stopped = (state & 1) != 0, parking = stopped && (state & kIsParking) != 0;
    traffic->hazard[row] = stopped;
    if (parking) traffic->now.lane[row] = kNone;  // Beside the road.
    if (!stopped) {
      coupled.stops.clear();
      for (const auto& stop : SumoVehicle::getStops(id))
        coupled.stops.push_back({network_.FindLane(stop.lane), stop.endPos});
    }
  }
  if (traffic->policy[row] == Policy::kSumo) return;
  if (!coupled.stops.empty() && traffic->plan[row] != nullptr) {
    const Stop& stop = coupled.stops.front();
    const auto route = traffic->plan[row]->route();
    const std::size_t here = static_cast<std::size_t>(traffic->route_position[row]);
    const EdgeIndex edge = stop.lane == kNone ? kNone : network_.lanes[stop.lane].edge;
    const auto found = std::find(route.begin() + static_cast<std::ptrdiff_t>(std::min(here, route.size())),
                                 route.end(), edge);
    if (edge == kNone) {
      traffic->stop_distance[row] = 0.0;  // At a place we do not know: SUMO's business.
    } else if (found != route.end()) {
      const std::size_t there = static_cast<std::size_t>(found - route.begin());
      const LaneIndex lane = traffic->now.lane[row];
      const bool internal = lane != kNone && network_.lanes[lane].internal;
      const double driven =
          internal ? network_.lanes[network_.edges[route[here]].first_lane].length : traffic->now.s[row];
      traffic->stop_distance[row] = traffic->plan[row]->RemainingLength(here) -
                                    traffic->plan[row]->RemainingLength(there) - driven + stop.end;
      if (there == here && !internal) traffic->stop_lane[row] = network_.lanes[stop.lane].index;
    }
  }
  const double speed = traffic->now.speed[row];
  const double braking = speed * speed / (2.0 * params_.driving.comfort_decel) + 2.0 * speed;
  // After a stop in a bay or on a bus lane SUMO brings the vehicle to a lane that leads on.
  const bool hand_back = traffic->hazard[row] != 0 || traffic->stop_distance[row] < braking + kStopMargin ||
                         (coupled.handed_back && FindDeadEnd(row, *traffic).distance < kDeadEndView);
  if (hand_back == coupled.handed_back) return;
  coupled.handed_back = hand_back;
  coupled.commanded = false;
  if (hand_back) SumoVehicle::setSpeed(id, -1.0);
  ReadAllowedSpeed(row, traffic);
  SumoVehicle::setLaneChangeMode(id, hand_back ? kSumoLaneChanges : kNoLaneChanges);
  SumoVehicle::setSpeedMode(id, kAllChecks);
  coupled.checks_on = true;
}

bool VehicleBridge::NeedsGuard(std::size_t row, const Traffic& traffic) const {
  LaneIndex lane = traffic.now.lane[row];
  if (network_.lanes[lane].internal && lane_guarded_[lane]) return true;
  const VehicleParams& vehicle = traffic.params[row];
  const double speed = traffic.now.speed[row];
  const double braking =
      speed * speed / (2.0 * vehicle.max_decel) + speed * vehicle.time_gap + params_.driving.guard_margin;
  std::size_t position = static_cast<std::size_t>(traffic.route_position[row]);
  double distance = -traffic.now.s[row];
  while (true) {
    distance += network_.lanes[lane].length;
    if (distance > braking) return false;
    const LaneIndex next = NextLane(network_, *traffic.plan[row], position, lane);
    if (next == kNone) return false;
    const Lane& following = network_.lanes[next];
    if (following.internal && lane_guarded_[next]) return true;
    if (!following.internal) {
      if (!network_.lanes[lane].internal && lane_guarded_[lane])
        return true;  // A junction without internal lanes.
      ++position;
    }
    lane = next;
  }
}

bool VehicleBridge::SetRoute(std::size_t row, std::span<const EdgeIndex> route, Traffic* traffic) {
  std::vector<std::string> edges;
  for (const EdgeIndex edge : route) edges.push_back(network_.edges[edge].id);
  try {
    SumoVehicle::setRoute(records_[row].id, edges);
  } catch (const libsumo::TraCIException&) {
    return false;
  }
  Replan(row, traffic);
  return true;
}

bool VehicleBridge::Hold(std::size_t row, double duration, Traffic* traffic) {
  const Lane& lane = network_.lanes[traffic->now.lane[row]];
  const double speed = traffic->now.speed[row];
  const double end =
      traffic->now.s[row] + speed * speed / (2.0 * traffic->params[row].max_decel) + kParkingRoom;
  if (end > lane.length) return false;
  try {
    SumoVehicle::setStop(records_[row].id, network_.edges[lane.edge].id, end, lane.index, duration,
                         kParkingStop);
  } catch (const libsumo::TraCIException&) {
    return false;
  }
  coupled_[row].stops.insert(coupled_[row].stops.begin(), {traffic->now.lane[row], end});
  UpdateStops(row, traffic);
  traffic->driven[row] = traffic->policy[row] != Policy::kSumo && !coupled_[row].handed_back;
  return true;
}

bool VehicleBridge::Release(std::size_t row) {
  const std::string& id = records_[row].id;
  if ((SumoVehicle::getStopState(id) & kIsParking) == 0) return false;
  SumoVehicle::resume(id);
  return true;
}

void VehicleBridge::SetChecks(std::size_t row, bool on) {
  if (coupled_[row].checks_on == on) return;
  SumoVehicle::setSpeedMode(records_[row].id, on ? kAllChecks : kNoChecks);
  coupled_[row].checks_on = on;
}

void VehicleBridge::Write(double dt, Traffic* traffic, const Commands& commands) {
  for (std::size_t row = 0; row < traffic->vehicle_count; ++row) {
    if (!traffic->driven[row]) {
      coupled_[row].commanded = false;
      // The rows of vehicles SUMO drives keep what they had: Read fills them from SUMO.
      traffic->next.lane[row] = traffic->now.lane[row];
      traffic->next.since_change[row] = traffic->now.since_change[row];
      traffic->next.yielded_to[row] = kNone;
      traffic->next.waited[row] = 0.0f;
      traffic->next.rule[row] = {};
      traffic->next.refused[row] = 0.0f;
      continue;
    }
    const std::string& id = records_[row].id;
    if (commands.leave_route[row]) TakeDetour(row, traffic);
    // With checks on SUMO does not brake harder than the type's decel: in an emergency the agent brakes
    // alone.
    SetChecks(row, rules_ == Rules::kSumo && guarded_[row] && !commands.emergency[row]);
    SumoVehicle::setSpeed(id, commands.lane_speed[row]);
    if (commands.passed_on_lane[row]) {
      // SUMO keeps a lane's vehicles in the order in which they came: put this one in front of whom it
      // passed.
      SumoVehicle::moveTo(id, network_.lanes[traffic->now.lane[row]].id, traffic->now.s[row]);
    }
    const int change = commands.change_lane[row];
    const double shift = commands.change_shift[row];
    const LaneIndex joined = change == 0 ? kNone : network_.Neighbor(traffic->now.lane[row], change);
    if (joined != kNone && shift != 0.0) {
      // changeLane keeps the position: where lanes begin at different places the vehicle would jump.
      SumoVehicle::moveTo(id, network_.lanes[joined].id, traffic->now.s[row] + shift);
    } else if (joined != kNone) {
      SumoVehicle::changeLane(id, network_.lanes[joined].index, 0.0);
    }
    Expect(row, commands.lane_speed[row], change, shift, dt, *traffic);
  }
}

void VehicleBridge::ReadPersons(double time, Traffic* traffic) {
  new_persons_.clear();
  std::vector<std::string> ids = libsumo::Person::getIDList();
  // Passengers are no road users of their own.
  std::erase_if(ids, [](const std::string& id) { return !libsumo::Person::getVehicle(id).empty(); });
  if (ids.empty()) return;
  traffic->Resize(traffic->vehicle_count + ids.size());
  Motion& now = traffic->now;
  for (std::size_t k = 0; k < ids.size(); ++k) {
    const std::size_t row = traffic->vehicle_count + k;
    const auto [it, fresh] = person_number_.try_emplace(ids[k], 0);
    if (fresh) {
      it->second = next_number_++;
      new_persons_.push_back({row, {ids[k], libsumo::Person::getTypeID(ids[k]), "pedestrian", time, 0.0}});
    }
    const libsumo::TraCIPosition position = libsumo::Person::getPosition(ids[k]);
    traffic->number[row] = it->second;
    traffic->params[row] = {};
    traffic->params[row].length = libsumo::Person::getLength(ids[k]);
    traffic->params[row].width = libsumo::Person::getWidth(ids[k]);
    traffic->plan[row] = nullptr;
    traffic->driven[row] = 0;
    traffic->hazard[row] = 0;
    now.lane[row] = kNone;
    now.x[row] = position.x;
    now.y[row] = position.y;
    now.heading[row] = HeadingFromSumo(libsumo::Person::getAngle(ids[k]));
    now.speed[row] = libsumo::Person::getSpeed(ids[k]);
    now.accel[row] = 0.0;
  }
}

}  // namespace lanewise
