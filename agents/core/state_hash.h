#pragma once

#include <bit>
#include <cstdint>

namespace lanewise {

/// Rolling 64-bit signature of a run's state. Order matters: feed rows in index order, from one thread.
class StateHash {
 public:
  void Add(std::uint64_t word) {
    state_ ^= word + 0x9e3779b97f4a7c15ULL + (state_ << 6) + (state_ >> 2);
    state_ = (state_ ^ (state_ >> 30)) * 0xbf58476d1ce4e5b9ULL;
    state_ = (state_ ^ (state_ >> 27)) * 0x94d049bb133111ebULL;
    state_ ^= state_ >> 31;
  }
  /// Every bit counts: two runs agree only if they agree bit for bit.
  void Add(double value) { Add(std::bit_cast<std::uint64_t>(value)); }
  std::uint64_t value() const { return state_; }

 private:
  std::uint64_t state_{0x6c616e6577697365ULL};  // "lanewise"
};

}  // namespace lanewise
