#pragma once

#include <cmath>
#include <cstdint>
#include <numbers>
#include <string_view>

namespace lanewise {

/// What a random number is for: numbers of different purposes do not depend on each other.
enum class RandomPurpose : std::uint64_t {
  kLidarRange = 1,
  kLidarDropout = 2,
  kArenaField = 3,
  kTrainingSplit = 16,
  kInitialWeights = 17,
  kRandomNodes = 18,
  kTrainingOrder = 19,
  kPenetration = 32,
  kRadioShare = 33,
  kRadioDelivery = 34,
  kRadioPosition = 35,
  kDispatchShare = 36
};

/// SplitMix64's finaliser (Steele, Lea, Flood 2014): 64 well-mixed bits of a counter.
inline std::uint64_t MixBits(std::uint64_t z) {
  z += 0x9e3779b97f4a7c15ULL;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
  return z ^ (z >> 31);
}

/// 64 bits of a text (FNV-1a, mixed), for ids of SUMO's: the same in every build and on every machine.
inline std::uint64_t HashText(std::string_view text) {
  std::uint64_t hash = 0xcbf29ce484222325ULL;
  for (const char c : text) hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3ULL;
  return MixBits(hash);
}

/// Random numbers as a function of (seed, id, purpose, step) and a counter: the same for every number of
/// threads and whatever was drawn before.
class RandomStream {
 public:
  RandomStream(std::uint64_t seed, std::uint64_t id, RandomPurpose purpose, std::uint64_t step)
      : key_(MixBits(MixBits(MixBits(seed ^ static_cast<std::uint64_t>(purpose) << 56) + id) + step)) {}

  std::uint64_t Bits(std::uint64_t counter) const { return MixBits(key_ + counter); }
  /// In [0, 1).
  double Uniform(std::uint64_t counter) const { return static_cast<double>(Bits(counter) >> 11) * 0x1.0p-53; }
  /// Standard normal (Box, Muller 1958), cut off at +-limit.
  double Normal(std::uint64_t counter, double limit) const {
    const std::uint64_t bits = Bits(counter);
    const double u = (static_cast<double>(bits >> 32) + 1.0) * 0x1.0p-32;
    const double v = static_cast<double>(bits & 0xffffffffULL) * 0x1.0p-32;
    const double normal = std::sqrt(-2.0 * std::log(u)) * std::cos(2.0 * std::numbers::pi * v);
    return normal < -limit ? -limit : (normal > limit ? limit : normal);
  }

 private:
  std::uint64_t key_;
};

}  // namespace lanewise
