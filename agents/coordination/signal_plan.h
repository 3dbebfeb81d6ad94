#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "agents/coordination/coordination_params.h"
#include "agents/coordination/signal_timing.h"
#include "agents/network/road_network.h"

namespace lanewise {

/// [s] of yellow that a speed limit [m/s] asks for: 3 s up to 50 km/h, 4 s up to 60, else 5 (RiLSA
/// 2015, 2.4).
double MinimumYellow(double speed_limit);

/// Safety times of a signal program: every green lasts at least signals.min_green and ends in yellow of at
/// least MinimumYellow; nobody has protected green against a protected green or yellow of a foe; pedestrians
/// can cross within their green and what follows until a foe's green.
/// @throws ConfigError naming signal, phase and link.
void CheckSignalProgram(const RoadNetwork& network, const SignalParams& params, std::int32_t signal,
                        std::span<const SignalPhase> phases);

/// The greens of `plan` [s, by phase] may differ from those of a program, by signals.max_cycle_change in sum;
/// all else, yellow and red, must not, and no green may be shorter than `minimum` [s, by phase].
/// @throws ConfigError naming signal and phase.
void CheckPlan(const RoadNetwork& network, const SignalParams& params, std::int32_t signal,
               std::span<const SignalPhase> phases, std::span<const double> minimum,
               std::span<const double> plan);

/// [s] by phase, the shortest it may be: signals.min_green where it ends a green of vehicles only; its own
/// time where it does not, or where pedestrians have green.
std::vector<double> MinimumDurations(const RoadNetwork& network, const SignalParams& params,
                                     std::int32_t signal, std::span<const SignalPhase> phases);

}  // namespace lanewise
