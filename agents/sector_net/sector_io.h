#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

namespace lanewise {

/// Inputs and outputs of the networks of [A]: one input per sector of the front 180 deg, number 0 at the
/// left; one output per way to go.
inline constexpr int kNetInputs = 8;
inline constexpr int kNetOutputs = 3;

/// 1 = free, 0 = obstacle (Eq. 8 of [A]); values between are allowed, e.g. a share of free beams.
using SectorInputs = std::array<double, kNetInputs>;
/// About 1 for the way to go, about 0 for the others; in the order of Avoidance.
using NetOutputs = std::array<double, kNetOutputs>;

/// The way to go; [A] codes them left [1 0 0], forward [0 1 0], right [0 0 1].
enum class Avoidance : std::uint8_t { kLeft, kForward, kRight };

/// @param code bit i is sector i: 1 free, 0 obstacle.
inline SectorInputs InputsOfCode(std::uint8_t code) {
  SectorInputs inputs;
  for (int i = 0; i < kNetInputs; ++i) inputs[i] = code >> i & 1;
  return inputs;
}

inline NetOutputs TargetOf(Avoidance way) {
  NetOutputs target{};
  target[static_cast<std::size_t>(way)] = 1.0;
  return target;
}

/// The largest output wins; of equal ones the first.
inline Avoidance WayOf(const NetOutputs& outputs) {
  return static_cast<Avoidance>(std::max_element(outputs.begin(), outputs.end()) - outputs.begin());
}

/// Inputs are scaled to [-1, 1] before they enter a network, as MATLAB's mapminmax does.
struct InputScale {
  double min{0.0};
  double max{1.0};                 ///< > min.
  double gain{2.0 / (max - min)};  ///< Follows from the other two: a division less in every inference.
};

}  // namespace lanewise
