#pragma once

#include <chrono>

namespace lanewise {

/// Adds the wall time of a call to `seconds`.
template <class F>
void Timed(double* seconds, F&& f) {
  const auto start = std::chrono::steady_clock::now();
  f();
  *seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

}  // namespace lanewise
