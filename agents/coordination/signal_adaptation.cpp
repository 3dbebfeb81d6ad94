#include "agents/coordination/signal_adaptation.h"

#include <algorithm>
#include <cmath>

#include "agents/coordination/signal_plan.h"

namespace lanewise {
namespace {

/// [m] before the line from which an approaching vehicle counts: nearer few change lanes any more.
constexpr double kCountFrom = 120.0;
/// [m/s] below which a vehicle stands in the queue.
constexpr double kQueueSpeed = 1.5;
/// [s] after which a vehicle not heard of is forgotten.
constexpr double kForget = 60.0;
/// Share of the predicted delay a change must save: what saves less is noise of the arrivals.
constexpr double kWorthChanging = 0.03;

double Sum(std::span<const double> values) {
  double sum = 0.0;
  for (const double value : values) sum += value;
  return sum;
}

/// Share of the saturation flow that leaves a lane in a phase.
double Service(const SignalPhase& phase, std::span<const std::int32_t> links) {
  double service = 0.0;
  for (const std::int32_t link : links) {
    const char state = phase.state[static_cast<std::size_t>(link)];
    service = std::max(service, state == 'G' ? 1.0 : state == 'g' ? 0.5 : 0.0);
  }
  return service;
}

}  // namespace

double PredictDelay(const AdviceParams& flow, std::span<const SignalPhase> phases,
                    std::span<const double> first, std::span<const double> then,
                    std::span<const LaneDemand> lanes, double begin, double horizon) {
  double delay = 0.0;
  for (const LaneDemand& lane : lanes) {
    double queue = lane.queue, green_for = 0.0;
    std::size_t phase = 0;
    std::span<const double> cycle = first;
    double phase_end = cycle[0];
    for (int second = 0; second < static_cast<int>(horizon); ++second) {
      while (second + 0.5 >= phase_end) {
        if (++phase == phases.size()) {
          phase = 0;
          cycle = then;
        }
        phase_end += cycle[phase];
      }
      const auto bin = static_cast<std::size_t>(begin + second) % lane.arrivals.size();
      queue += lane.arrivals[bin];
      const double service = Service(phases[phase], lane.links);
      if (service > 0.0) {
        if (green_for >= flow.start_delay) queue = std::max(0.0, queue - service / flow.headway);
        green_for += 1.0;
      } else {
        green_for = 0.0;
      }
      delay += queue;
    }
  }
  return delay;
}

SignalPlan ChoosePlan(const CoordinationParams& params, std::span<const SignalPhase> phases,
                      std::span<const double> minimum, std::span<const double> base,
                      std::span<const LaneDemand> lanes, double begin) {
  double cycle = 0.0;
  for (const SignalPhase& phase : phases) cycle += phase.duration;
  const double horizon = 2.0 * cycle;
  std::vector<std::size_t> greens;
  for (std::size_t p = 0; p < phases.size(); ++p) {
    if (minimum[p] < phases[p].duration) greens.push_back(p);
  }
  SignalPlan best{{base.begin(), base.end()}, {base.begin(), base.end()}, 0.0};
  const double present = PredictDelay(params.advice, phases, base, base, lanes, begin, horizon);
  double least = (1.0 - kWorthChanging) * present;
  const auto consider = [&](const std::vector<double>& split, double offset) {
    std::vector<double> next = split;
    if (offset != 0.0) {
      // The longest green takes the change.
      const std::size_t longest = *std::max_element(
          greens.begin(), greens.end(), [&](std::size_t a, std::size_t b) { return split[a] < split[b]; });
      next[longest] += offset;
      if (next[longest] < minimum[longest]) return;
    }
    const double delay = PredictDelay(params.advice, phases, next, split, lanes, begin, horizon);
    if (delay < least) {
      least = delay;
      best = {std::move(next), split, offset};
    }
  };
  const double step = params.signals.max_change;
  const double offset = std::min(step, params.signals.max_cycle_change);
  const auto consider_split = [&](const std::vector<double>& split) {
    for (const double shift : {0.0, -offset, offset}) consider(split, shift);
  };
  if (greens.empty() || step <= 0.0) return best;
  const std::vector<double> unchanged(base.begin(), base.end());
  consider_split(unchanged);
  for (const std::size_t from : greens) {
    for (const std::size_t to : greens) {
      std::vector<double> split = unchanged;
      split[from] -= step;
      split[to] += step;
      if (from != to && split[from] >= minimum[from]) consider_split(split);
    }
  }
  return best;
}

SignalAdaptation::SignalAdaptation(const RoadNetwork& network, const CoordinationParams& params)
    : network_(network), params_(params), signals_(network.signal_ids.size()) {}

void SignalAdaptation::ReadProgram(std::int32_t index, const SignalTiming& program) {
  CheckSignalProgram(network_, params_.signals, index, program.phases);
  Signal& signal = signals_[static_cast<std::size_t>(index)];
  signal = {};
  signal.known = true;
  for (const SignalPhase& phase : program.phases) signal.base.push_back(phase.duration);
  signal.cycle = Sum(signal.base);
  signal.minimum = MinimumDurations(network_, params_.signals, index, program.phases);
  for (const Connection& connection : network_.connections) {
    const EdgeIndex to = network_.lanes[connection.to].edge;
    if (connection.signal != index || network_.edges[to].function == EdgeFunction::kCrossing) continue;
    auto lane = std::find_if(signal.lanes.begin(), signal.lanes.end(),
                             [&](const LaneDemand& demand) { return demand.lane == connection.from; });
    if (lane == signal.lanes.end()) {
      signal.lanes.push_back({connection.from, {}, std::vector<double>(std::lround(signal.cycle)), 0.0});
      lane = signal.lanes.end() - 1;
    }
    lane->links.push_back(connection.link_index);
  }
  for (const LaneDemand& lane : signal.lanes) signal.counted.emplace_back(lane.arrivals.size());
}

void SignalAdaptation::Listen(double time, std::int32_t index, const Roadside& roadside,
                              const Channel& channel) {
  Signal& signal = signals_[static_cast<std::size_t>(index)];
  for (LaneDemand& lane : signal.lanes) lane.queue = 0.0;
  channel.ForEachKnown(roadside.units()[static_cast<std::size_t>(index)], [&](const Received& received) {
    const Message& message = *received.message;
    const auto line = StopLineOf(network_, message);
    if (!line || line->signal != index || line->distance > kCountFrom) return;
    for (std::size_t k = 0; k < signal.lanes.size(); ++k) {
      if (signal.lanes[k].lane != line->lane) continue;
      signal.heard = true;
      if (message.speed < kQueueSpeed) signal.lanes[k].queue += 1.0;
      const auto [entry, fresh] = signal.seen.try_emplace(message.sender, time);
      entry->second = time;
      if (!fresh) return;
      const double arrives =
          time - received.age + line->distance / std::max(1.0, network_.lanes[line->lane].speed_limit);
      std::vector<double>& counted = signal.counted[k];
      counted[static_cast<std::size_t>(arrives) % counted.size()] += 1.0;
    }
  });
  std::erase_if(signal.seen, [&](const auto& entry) { return entry.second < time - kForget; });
}

const std::vector<SignalAdaptation::Change>& SignalAdaptation::Step(double time,
                                                                    std::span<const SignalTiming> programs,
                                                                    std::span<const SignalTiming> timings,
                                                                    const Roadside& roadside,
                                                                    const Channel& channel) {
  changes_.clear();
  for (std::size_t s = 0; s < signals_.size(); ++s) {
    Signal& signal = signals_[s];
    const auto index = static_cast<std::int32_t>(s);
    if (!timings[s].fixed || roadside.units()[s] == kNone) continue;
    if (!signal.known || signal.base.size() != programs[s].phases.size()) ReadProgram(index, programs[s]);
    Listen(time, index, roadside, channel);
    const bool begins = timings[s].phase == 0 && signal.last_phase > 0;
    signal.last_phase = timings[s].phase;
    if (!begins || !signal.heard) continue;
    signal.heard = false;
    const double weight = params_.signals.smoothing;
    for (std::size_t k = 0; k < signal.lanes.size(); ++k) {
      for (std::size_t bin = 0; bin < signal.counted[k].size(); ++bin) {
        double& expected = signal.lanes[k].arrivals[bin];
        expected += weight * (signal.counted[k][bin] - expected);
        signal.counted[k][bin] = 0.0;
      }
    }
    const SignalPlan plan = ChoosePlan(params_, programs[s].phases, signal.minimum, signal.base, signal.lanes,
                                       std::fmod(time, signal.cycle));
    signal.base = plan.base;
    Change change{index, plan.next, 0.0, plan.offset_change};
    for (std::size_t p = 0; p < plan.base.size(); ++p)
      change.split_change += 0.5 * std::abs(plan.base[p] - programs[s].phases[p].duration);
    if (change.split_change == 0.0 && change.offset_change == 0.0) continue;
    CheckPlan(network_, params_.signals, index, programs[s].phases, signal.minimum, change.durations);
    changes_.push_back(std::move(change));
  }
  return changes_;
}

}  // namespace lanewise
