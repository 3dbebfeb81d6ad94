#pragma once

#include <Eigen/Core>
#include <bit>
#include <cstdint>

namespace lanewise {

/// e^x as numerator / denominator, both positive, so that what is made of it needs one division only. Without
/// a branch or a call: loops over it fill vector registers.
struct ExpFraction {
  double numerator, denominator;
};

/// e^x = 2^k e^r with |r| <= ln 2 / 2 and e^r = (q + r p) / (q - r p), p and q polynomials of r^2: the Pade
/// approximation of exp in Moshier's Cephes library (1989). @param x in [-kMaxExponent, kMaxExponent].
inline constexpr double kMaxExponent = 700.0;  // 2^k stays finite, and so do sums with it.
inline ExpFraction ExpAsFraction(double x) {
  // Adding 1.5 * 2^52 rounds to an integer, in the low bits of the sum.
  constexpr double kRound = 0x1.8p52, kLog2E = 1.4426950408889634;
  const double shifted = x * kLog2E + kRound, k = shifted - kRound;
  const double two_to_k = std::bit_cast<double>((std::bit_cast<std::uint64_t>(shifted) << 52) +
                                                std::bit_cast<std::uint64_t>(1.0));
  // ln 2 in two parts: k times the first is exact.
  const double r = (x - k * 6.93145751953125e-1) - k * 1.42860682030941723212e-6;
  const double r2 = r * r;
  const double odd =
      r * ((1.26177193074810590878e-4 * r2 + 3.02994407707441961300e-2) * r2 + 9.99999999999999999910e-1);
  const double even =
      ((3.00198505138664455042e-6 * r2 + 2.52448340349684104192e-3) * r2 + 2.27265548208155028766e-1) * r2 +
      2.0;
  return {two_to_k * (even + odd), even - odd};
}

/// tansig(n) = 2 / (1 + exp(-2 n)) - 1, which is tanh(n); in [-1, 1]. Element by element.
template <class Derived>
typename Derived::PlainObject Tansig(const Eigen::ArrayBase<Derived>& sums) {
  typename Derived::PlainObject results = (2.0 * sums.derived()).min(kMaxExponent).max(-kMaxExponent);
  double* const result = results.data();
  for (Eigen::Index k = 0; k < results.size(); ++k) {
    const ExpFraction e = ExpAsFraction(result[k]);
    result[k] = (e.numerator - e.denominator) / (e.numerator + e.denominator);
  }
  return results;
}

/// logsig(n) = 1 / (1 + exp(-n)); in [0, 1].
template <class Derived>
typename Derived::PlainObject Logsig(const Eigen::ArrayBase<Derived>& sums) {
  typename Derived::PlainObject results = sums.derived().min(kMaxExponent).max(-kMaxExponent);
  double* const result = results.data();
  for (Eigen::Index k = 0; k < results.size(); ++k) {
    const ExpFraction e = ExpAsFraction(result[k]);
    result[k] = e.numerator / (e.numerator + e.denominator);
  }
  return results;
}

}  // namespace lanewise
