#pragma once

#include <Eigen/Core>

namespace lanewise {

/// tansig(n) = 2 / (1 + exp(-2 n)) - 1, which is tanh(n); in (-1, 1). Element by element, in vector
/// registers. Where exp overflows the quotient is 0, so tansig is -1 and logsig 0, as the limits are.
template <class Derived>
auto Tansig(const Eigen::ArrayBase<Derived>& sum) {
  return 2.0 / (1.0 + (-2.0 * sum.derived()).exp()) - 1.0;
}

/// logsig(n) = 1 / (1 + exp(-n)); in (0, 1).
template <class Derived>
auto Logsig(const Eigen::ArrayBase<Derived>& sum) {
  return 1.0 / (1.0 + (-sum.derived()).exp());
}

}  // namespace lanewise
