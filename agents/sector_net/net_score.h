#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <span>

#include "agents/sector_net/samples.h"

namespace lanewise {

/// How well a network does on labelled scans; a sample counts by its weight.
struct NetScore {
  double samples{0.0};             ///< Sum of the weights.
  double rounded{0.0};             ///< Of these, every output rounds to its target ([A], Table 1).
  double largest{0.0};             ///< Of these, the largest output is that of the way taken.
  NetOutputs taken{}, found{};     ///< By way: samples of it, and of these those of `largest`.
  double mean_squared_error{0.0};  ///< [-] over samples and outputs.
  double largest_error{0.0};       ///< [-] largest |output - target|.
  std::size_t worst{0};            ///< Index of the sample with it.
};

/// Largest |output - target| of one sample.
inline double LargestError(const NetOutputs& outputs, Avoidance way) {
  const NetOutputs target = TargetOf(way);
  double error = 0.0;
  for (int k = 0; k < kNetOutputs; ++k) error = std::fmax(error, std::abs(outputs[k] - target[k]));
  return error;
}

/// @param net BpNet or BlsNet.
template <class Net>
NetScore ScoreNet(const Net& net, std::span<const LabelledScan> samples) {
  NetScore score;
  double squares = 0.0;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const LabelledScan& sample = samples[i];
    const NetOutputs y = net.Forward(sample.sectors), target = TargetOf(sample.way);
    bool rounds = true;
    for (int k = 0; k < kNetOutputs; ++k) {
      squares += sample.weight * (y[k] - target[k]) * (y[k] - target[k]);
      rounds = rounds && std::round(y[k]) == target[k];
    }
    score.samples += sample.weight;
    score.rounded += rounds ? sample.weight : 0.0;
    const auto way = static_cast<std::size_t>(sample.way);
    score.taken[way] += sample.weight;
    if (WayOf(y) == sample.way) {
      score.largest += sample.weight;
      score.found[way] += sample.weight;
    }
    const double error = LargestError(y, sample.way);
    if (error > score.largest_error) {
      score.largest_error = error;
      score.worst = i;
    }
  }
  if (score.samples > 0.0) score.mean_squared_error = squares / (kNetOutputs * score.samples);
  return score;
}

/// The most samples that any function of the scan can get right: drivers do not always go the same way from
/// equal scans.
inline double MostPossible(std::span<const LabelledScan> samples) {
  std::map<SectorInputs, NetOutputs> ways;
  for (const LabelledScan& sample : samples)
    ways[sample.sectors][static_cast<std::size_t>(sample.way)] += sample.weight;
  double most = 0.0;
  for (const auto& [scan, count] : ways) most += *std::max_element(count.begin(), count.end());
  return most;
}

}  // namespace lanewise
