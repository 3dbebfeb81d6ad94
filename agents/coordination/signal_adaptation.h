#pragma once

#include <cstdint>
#include <span>
#include <unordered_map>
#include <vector>

#include "agents/coordination/coordination_params.h"
#include "agents/coordination/roadside.h"
#include "agents/coordination/signal_timing.h"
#include "agents/network/road_network.h"
#include "agents/v2x/channel.h"

namespace lanewise {

/// What a lane of a signal brings: vehicles by second of the cycle, and those that stand before its line.
struct LaneDemand {
  LaneIndex lane{kNone};
  std::vector<std::int32_t> links;  ///< Of the signal's state, that leave from this lane.
  std::vector<double> arrivals;     ///< Vehicles expected in each second of the cycle, time modulo the cycle.
  double queue{0.0};                ///< Vehicles standing now.
};

/// Delay [vehicle seconds] over `horizon` [s] if a cycle of `first` durations [s, by phase] begins at second
/// `begin` of the profiles, and cycles of `then` follow: a vertical queue at each line, emptied at the
/// saturation flow from a start-up delay after green begins, at half of it by links that have to yield (Hunt
/// et al. 1981: SCOOT; Robertson 1969: TRANSYT).
double PredictDelay(const AdviceParams& flow, std::span<const SignalPhase> phases,
                    std::span<const double> first, std::span<const double> then,
                    std::span<const LaneDemand> lanes, double begin, double horizon);

/// Durations [s, by phase] of a program's next cycle, and of those behind it.
struct SignalPlan {
  std::vector<double> next, base;
  double offset_change{0.0};  ///< [s] by which the next cycle is longer than the program's.
};

/// Of the present plan and its neighbours - a few seconds moved from one green to another, the cycle once
/// longer or shorter - the one with the least predicted delay. `minimum` by phase, as MinimumDurations.
SignalPlan ChoosePlan(const CoordinationParams& params, std::span<const SignalPhase> phases,
                      std::span<const double> minimum, std::span<const double> base,
                      std::span<const LaneDemand> lanes, double begin);

/// Signals that adapt green split and offset, once a cycle, to the positions vehicles share. Programs with
/// fixed times only: an actuated one already adapts by its own detectors.
class SignalAdaptation {
 public:
  struct Change {
    std::int32_t signal{kNone};
    std::vector<double> durations;  ///< [s] by phase, of the cycle that begins.
    double split_change{0.0};       ///< [s] moved between greens, against the program.
    double offset_change{0.0};      ///< [s] by which this cycle is longer than the program's.
  };

  SignalAdaptation(const RoadNetwork& network, const CoordinationParams& params);

  /// After an Exchange. `programs` are the signals' own times, `timings` what they do now, by signal.
  /// @throws ConfigError if the program of a signal violates safety times.
  const std::vector<Change>& Step(double time, std::span<const SignalTiming> programs,
                                  std::span<const SignalTiming> timings, const Roadside& roadside,
                                  const Channel& channel);

 private:
  struct Signal {
    bool known{false};  // Its program has been read.
    double cycle{0.0};  // [s]
    std::int32_t last_phase{kNone};
    std::vector<double> minimum, base;  // [s] by phase.
    std::vector<LaneDemand> lanes;
    std::vector<std::vector<double>> counted;    // By lane and second: arrivals in the present cycle.
    std::unordered_map<StationId, double> seen;  // [s] When an approaching vehicle was last heard of.
    bool heard{false};                           // Of anybody in the present cycle.
  };

  void ReadProgram(std::int32_t signal, const SignalTiming& program);
  void Listen(double time, std::int32_t signal, const Roadside& roadside, const Channel& channel);

  const RoadNetwork& network_;
  CoordinationParams params_;
  std::vector<Signal> signals_;
  std::vector<Change> changes_;
};

}  // namespace lanewise
