#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <unordered_map>
#include <utility>
#include <vector>

#include "agents/agent_pipeline.h"
#include "agents/coordination/dispatcher.h"
#include "agents/coordination/roadside.h"
#include "agents/coordination/signal_adaptation.h"
#include "analysis/coordination_event.h"
#include "libsumo_bridge/signal_bridge.h"
#include "libsumo_bridge/vehicle_bridge.h"

namespace lanewise {

class JunctionSlots;

/// What is coordinated over the roadside units; each on its own.
struct CoordinationSwitches {
  bool green_advice{false}, signals{false}, dispatch{false}, slots{false};
  std::vector<std::string> slot_junctions;  // With coordinators; empty: all that can have one.
  bool any() const { return green_advice || signals || dispatch || slots; }
};

/// --coordinate: names separated by commas, or `none`; `slots` may name junctions: slots:A:B. @throws
/// ConfigError naming what is allowed.
CoordinationSwitches ParseCoordination(std::string_view list);
std::string CoordinationText(const CoordinationSwitches& switches);

/// Have all signals with fixed times, which may adapt, programs that keep the safety times? Asks the started
/// SUMO.
/// @throws ConfigError naming signal, phase and link.
void CheckSignals(const RoadNetwork& network, const SignalParams& params, double time);

/// The roadside of a run: units at the signals, speed advice, adapting signals and the dispatcher, between
/// the bridges to SUMO and the agents.
class Coordination {
 public:
  /// @throws ConfigError naming a junction that cannot have a coordinator.
  Coordination(const RoadNetwork& network, const CoordinationParams& params,
               const CoordinationSwitches& switches, std::uint64_t seed, AgentPipeline* pipeline);
  ~Coordination();

  /// After what SUMO did has been read, before the agents decide.
  void Step(double time, double dt, Traffic* traffic, VehicleBridge* bridge);
  /// After the agents have decided: who got advice, and what became of it.
  void Observe(double time, const Traffic& traffic);

  const CoordinationCounts& counts() const { return counts_; }
  std::vector<CoordinationEvent> TakeEvents() { return std::exchange(events_, {}); }

 private:
  /// A vehicle under way to a signal with advice.
  struct Advised {
    std::int32_t signal{kNone};
    double least{0.0};  // [m/s] advised.
    bool stopped{false};
  };

  void InstallSlots(const SlotParams& params, AgentPipeline* pipeline);
  void AdaptSignals(double time);
  void Dispatch(double time, Traffic* traffic, VehicleBridge* bridge);
  void Note(double time, CoordinationKind kind, std::int32_t vehicle, std::int32_t signal, double value);

  const RoadNetwork& network_;
  CoordinationSwitches switches_;
  const AgentPipeline& pipeline_;
  Channel* channel_;
  SignalBridge signals_;
  Roadside roadside_;
  SignalAdaptation adaptation_;
  Dispatcher dispatcher_;
  std::unique_ptr<JunctionSlots> slots_;               // Null: no coordinators of junctions.
  std::vector<std::uint8_t> may_hold_;                 // By row.
  std::unordered_map<std::int32_t, Advised> advised_;  // By vehicle number.
  std::vector<CoordinationEvent> events_;
  CoordinationCounts counts_;
};

}  // namespace lanewise
