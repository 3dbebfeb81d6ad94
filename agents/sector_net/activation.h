#pragma once

#include <Eigen/Core>

namespace lanewise {

/// tansig(n) = 2 / (1 + exp(-2 n)) - 1, which is tanh(n); in (-1, 1). Element by element, in vector
/// registers. The argument is bounded so that exp stays finite; tansig is +-1 to rounding there.
template <class Derived>
auto Tansig(const Eigen::ArrayBase<Derived>& n) {
  return 2.0 / (1.0 + (-2.0 * n.max(-300.0).min(300.0)).exp()) - 1.0;
}

/// logsig(n) = 1 / (1 + exp(-n)); in (0, 1).
template <class Derived>
auto Logsig(const Eigen::ArrayBase<Derived>& n) {
  return 1.0 / (1.0 + (-n.max(-600.0).min(600.0)).exp());
}

}  // namespace lanewise
