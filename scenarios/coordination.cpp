#include "scenarios/coordination.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

#include "agents/coordination/junction_slots.h"
#include "agents/coordination/signal_plan.h"
#include "agents/core/check.h"

namespace lanewise {
namespace {

/// [m/s] below which a vehicle has stopped; SUMO's.
constexpr double kStopped = 0.1;
/// Who is so slow [m/s] so soon [s] after its departure began standing.
constexpr double kDepotSpeed = 1.0;
constexpr double kDepotTime = 2.0;

struct Switch {
  const char* name;
  bool CoordinationSwitches::*member;
};
constexpr Switch kSwitches[] = {{"green-advice", &CoordinationSwitches::green_advice},
                                {"signals", &CoordinationSwitches::signals},
                                {"dispatch", &CoordinationSwitches::dispatch},
                                {"slots", &CoordinationSwitches::slots}};

}  // namespace

CoordinationSwitches ParseCoordination(std::string_view list) {
  CoordinationSwitches switches;
  if (list == "none") return switches;
  for (std::size_t from = 0; from <= list.size();) {
    const std::size_t comma = std::min(list.find(',', from), list.size());
    std::string_view name = list.substr(from, comma - from);
    if (name.starts_with("slots:")) {
      for (std::size_t at = name.find(':'); at != std::string_view::npos;) {
        const std::size_t next = name.find(':', at + 1);
        switches.slot_junctions.emplace_back(name.substr(at + 1, next - at - 1));
        at = next;
      }
      name = "slots";
    }
    const auto* found = std::find_if(std::begin(kSwitches), std::end(kSwitches),
                                     [&](const Switch& s) { return name == s.name; });
    if (found == std::end(kSwitches)) {
      throw ConfigError(fmt::format(
          "--coordinate: unknown value '{}'; allowed: none, or green-advice, signals, dispatch, slots, "
          "slots:JUNCTION:..., separated by commas",
          name));
    }
    switches.*found->member = true;
    from = comma + 1;
  }
  return switches;
}

std::string CoordinationText(const CoordinationSwitches& switches) {
  std::vector<std::string> names;
  for (const Switch& s : kSwitches) {
    if (switches.*s.member) names.emplace_back(s.name);
  }
  for (const std::string& junction : switches.slot_junctions)
    names.back() += ":" + junction;  // Slots are last.
  return names.empty() ? "none" : fmt::format("{}", fmt::join(names, ","));
}

void CheckSignals(const RoadNetwork& network, const SignalParams& params, double time) {
  SignalBridge signals(network);
  signals.Read(time);
  for (std::size_t s = 0; s < network.signal_ids.size(); ++s) {
    if (signals.programs()[s].fixed)
      CheckSignalProgram(network, params, static_cast<std::int32_t>(s), signals.programs()[s].phases);
  }
}

Coordination::Coordination(const RoadNetwork& network, const CoordinationParams& params,
                           const CoordinationSwitches& switches, std::uint64_t seed, AgentPipeline* pipeline)
    : network_(network),
      switches_(switches),
      pipeline_(*pipeline),
      channel_(&pipeline->channel()),
      signals_(network),
      roadside_(network, params, pipeline->params().v2x.memory),
      adaptation_(network, params),
      dispatcher_(network, params, seed) {
  if (!switches_.any() || !channel_->open()) return;
  roadside_.Install(channel_);
  if (switches_.green_advice) pipeline->AdviseBy(&roadside_);
  if (switches_.slots) InstallSlots(params.slots, pipeline);
}

Coordination::~Coordination() = default;

void Coordination::InstallSlots(const SlotParams& params, AgentPipeline* pipeline) {
  if (pipeline->rules() == nullptr)
    throw ConfigError("--coordinate slots: the agents must answer for the rules: --rules agent");
  const JunctionMap& map = pipeline->rules()->map();
  std::vector<std::int32_t> junctions;
  for (std::int32_t j = 0; j < std::ssize(network_.junctions); ++j) {
    if (switches_.slot_junctions.empty() && JunctionSlots::CanCoordinate(network_, map, j))
      junctions.push_back(j);
  }
  for (const std::string& id : switches_.slot_junctions) {
    const auto found = std::find_if(network_.junctions.begin(), network_.junctions.end(),
                                    [&](const Junction& junction) { return junction.id == id; });
    const auto j = static_cast<std::int32_t>(found - network_.junctions.begin());
    if (found == network_.junctions.end())
      throw ConfigError(fmt::format("--coordinate slots: no junction '{}' in the network", id));
    if (!JunctionSlots::CanCoordinate(network_, map, j))
      throw ConfigError(fmt::format(
          "--coordinate slots: junction '{}' ({}) has signals, or no ways that conflict; allowed: "
          "junctions without signals where ways conflict",
          id, found->type));
    junctions.push_back(j);
  }
  slots_ = std::make_unique<JunctionSlots>(network_, map, params, pipeline->params().v2x.memory);
  slots_->Install(junctions, channel_);
  pipeline->CoordinateBy(slots_.get());
}

void Coordination::Step(double time, double dt, Traffic* traffic, VehicleBridge* bridge) {
  if (!switches_.any() || !channel_->open()) return;
  signals_.Read(time);
  if (switches_.signals) AdaptSignals(time);
  if (switches_.dispatch) Dispatch(time, traffic, bridge);
  roadside_.Broadcast(dt, signals_.timings(), channel_);
  if (slots_) slots_->Broadcast(dt, channel_);
}

void Coordination::AdaptSignals(double time) {
  for (const SignalAdaptation::Change& change :
       adaptation_.Step(time, signals_.programs(), signals_.timings(), roadside_, *channel_)) {
    signals_.SetCycle(change.signal, change.durations);
    if (change.split_change > 0.0)
      Note(time, CoordinationKind::kSignalPlan, kNone, change.signal, change.split_change);
    if (change.offset_change != 0.0)
      Note(time, CoordinationKind::kSignalOffset, kNone, change.signal, change.offset_change);
  }
}

void Coordination::Dispatch(double time, Traffic* traffic, VehicleBridge* bridge) {
  may_hold_.assign(traffic->vehicle_count, 0);
  for (std::size_t row = 0; row < traffic->vehicle_count; ++row) {
    const LaneIndex lane = traffic->now.lane[row];
    may_hold_[row] = traffic->driven[row] != 0 && time - bridge->record(row).depart < kDepotTime &&
                     traffic->now.speed[row] < kDepotSpeed && lane != kNone && !network_.lanes[lane].internal;
  }
  dispatcher_.Step(time, *traffic, may_hold_, roadside_, *channel_);
  for (const Dispatcher::Reroute& advice : dispatcher_.reroutes()) {
    if (bridge->SetRoute(advice.row, advice.route, traffic))
      Note(time, CoordinationKind::kReroute, traffic->number[advice.row], kNone, advice.gain);
  }
  for (const std::size_t row : dispatcher_.holds()) {
    if (bridge->Hold(row, dispatcher_.max_hold(), traffic))
      Note(time, CoordinationKind::kHold, traffic->number[row], kNone, 0.0);
  }
  for (const std::int32_t number : dispatcher_.releases()) {
    const auto end = traffic->number.begin() + static_cast<std::ptrdiff_t>(traffic->vehicle_count);
    const auto found = std::find(traffic->number.begin(), end, number);
    if (found != end && bridge->Release(static_cast<std::size_t>(found - traffic->number.begin())))
      Note(time, CoordinationKind::kRelease, number, kNone, 0.0);
  }
}

void Coordination::Observe(double time, const Traffic& traffic) {
  if (!switches_.green_advice || !channel_->open()) return;
  for (std::size_t row = 0; row < traffic.vehicle_count; ++row) {
    const std::int32_t number = traffic.number[row];
    const auto [signal, speed, cap] = pipeline_.advice()[row];
    auto found = advised_.find(number);
    if (found != advised_.end() && found->second.signal != signal) {
      Note(time, found->second.stopped ? CoordinationKind::kAdviceMissed : CoordinationKind::kAdviceFollowed,
           number, found->second.signal, found->second.least);
      advised_.erase(found);
      found = advised_.end();
    }
    if (found == advised_.end() && signal != kNone && speed > 0.0)
      found = advised_.emplace(number, Advised{signal, speed, false}).first;
    if (found == advised_.end()) continue;
    if (speed > 0.0) found->second.least = std::min(found->second.least, speed);
    found->second.stopped |= traffic.now.speed[row] < kStopped;
  }
}

void Coordination::Note(double time, CoordinationKind kind, std::int32_t vehicle, std::int32_t signal,
                        double value) {
  events_.push_back({time, kind, vehicle,
                     signal == kNone ? "" : network_.signal_ids[static_cast<std::size_t>(signal)], value});
  ++counts_[static_cast<std::size_t>(kind)];
}

}  // namespace lanewise
