#include "libsumo_bridge/signal_bridge.h"

#include <libsumo/libsumo.h>

#include <algorithm>

namespace lanewise {
namespace {

using SumoSignal = libsumo::TrafficLight;

constexpr int kStaticProgram = 0;  // TraCILogic::type of programs with fixed times.

}  // namespace

SignalBridge::SignalBridge(const RoadNetwork& network)
    : network_(network),
      program_names_(network.signal_ids.size()),
      programs_(network.signal_ids.size()),
      timings_(network.signal_ids.size()) {}

void SignalBridge::ReadProgram(std::size_t signal, const std::string& name) {
  program_names_[signal] = name;
  SignalTiming& program = programs_[signal] = {};
  for (const libsumo::TraCILogic& logic : SumoSignal::getAllProgramLogics(network_.signal_ids[signal])) {
    if (logic.programID != name || logic.type != kStaticProgram) continue;
    // A program whose phases do not follow each other in order is not foreseen either.
    program.fixed = std::all_of(logic.phases.begin(), logic.phases.end(),
                                [](const auto& phase) { return phase->next.empty(); });
    for (const auto& phase : logic.phases) program.phases.push_back({phase->duration, phase->state});
  }
  timings_[signal] = program;
}

void SignalBridge::Read(double time) {
  for (std::size_t signal = 0; signal < timings_.size(); ++signal) {
    const std::string& id = network_.signal_ids[signal];
    const std::string name = SumoSignal::getProgram(id);
    if (name != program_names_[signal]) ReadProgram(signal, name);
    SignalTiming& timing = timings_[signal];
    if (!timing.fixed) continue;
    const std::int32_t before = timing.phase;
    timing.phase = SumoSignal::getPhase(id);
    timing.to_switch = SumoSignal::getNextSwitch(id) - time;
    if (timing.phase == before) continue;
    if (timing.phase == 0) {
      timing.phases = programs_[signal].phases;
    } else {
      EndPhase(signal);
    }
  }
}

void SignalBridge::EndPhase(std::size_t signal) {
  SignalTiming& timing = timings_[signal];
  const auto phase = static_cast<std::size_t>(timing.phase);
  const double change = timing.phases[phase].duration - programs_[signal].phases[phase].duration;
  if (change == 0.0) return;
  timing.to_switch += change;
  SumoSignal::setPhaseDuration(network_.signal_ids[signal], timing.to_switch);
}

void SignalBridge::SetCycle(std::int32_t signal, std::span<const double> durations) {
  SignalTiming& timing = timings_[static_cast<std::size_t>(signal)];
  for (std::size_t p = 0; p < timing.phases.size(); ++p) timing.phases[p].duration = durations[p];
  EndPhase(static_cast<std::size_t>(signal));
}

}  // namespace lanewise
