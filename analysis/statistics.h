#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace lanewise {

/// A two-sided interval; which kind it is, IntervalKind says.
struct Interval {
  double low{0.0};
  double high{0.0};
};

enum class IntervalKind : std::uint8_t {
  kNone,      ///< Fewer than two values.
  kConstant,  ///< All values are equal: there is no spread to estimate anything from.
  kStudent,   ///< Student's t; two to five values, too few to resample.
  kBca,       ///< Bootstrap, bias-corrected and accelerated, expanded for small samples.
};

const char* ToString(IntervalKind kind);

enum class SignificanceTest : std::uint8_t { kPermutation, kWilcoxon };

const char* ToString(SignificanceTest test);

struct StatisticsParams {
  double alpha{0.05};     ///< Two-sided level; intervals cover 1 - alpha. In (0, 0.5].
  int resamples{9999};    ///< Of the bootstrap; at least 99.
  std::uint64_t seed{1};  ///< The same values and seed give the same interval, on every machine.
  SignificanceTest test{SignificanceTest::kPermutation};
};

/// What can be said of the mean of `values` (differences of pairs).
struct MeanEstimate {
  std::size_t count{0};
  double mean{0.0};
  double deviation{0.0};  ///< Sample standard deviation; 0 for fewer than two values.
  IntervalKind kind{IntervalKind::kNone};
  Interval interval{};
};

/// A p value, and how it was come by.
struct PValue {
  double p{1.0};
  bool exact{true};  ///< Every sign pattern counted, not sampled or approximated.
};

/// Mean and interval. BCa: Efron, J. Am. Stat. Assoc. 82 (1987); its tail levels are widened to
/// Phi(-sqrt(n / (n-1)) t_{n-1}) ("expanded": Hesterberg, The American Statistician 69, 2015), because the
/// plain bootstrap takes the spread for known and covers too little with 20 pairs. @pre all values are
/// finite.
MeanEstimate EstimateMean(std::span<const double> values, const StatisticsParams& params);

/// Two-sided p of the hypothesis that the differences are symmetric about zero. The permutation test flips
/// the signs of the differences and looks at their sum: exactly for at most 20 differences that are not zero,
/// else by 99,999 seeded draws (Phipson and Smyth 2010: (hits + 1) / (draws + 1)). Wilcoxon's signed-rank
/// test ranks their magnitudes (zeros dropped, ties share their mean rank): exactly for at most 60, else by
/// the normal approximation with ties and continuity corrected. @pre all values are finite.
PValue TestZeroMean(std::span<const double> differences, const StatisticsParams& params);

/// The smallest two-sided p that `count` pairs can give at all: 2^(1 - count).
double SmallestPossibleP(std::size_t count);

/// Holm's adjusted p values (Scandinavian Journal of Statistics 6, 1979), in the order given; at most 1.
std::vector<double> HolmAdjust(std::span<const double> p_values);

/// Hedges' g of paired differences: mean / deviation, corrected for its small-sample bias by
/// Gamma(m/2) / (sqrt(m/2) Gamma((m-1)/2)), m = count - 1. Nothing for fewer than two values or no spread.
std::optional<double> PairedEffectSize(const MeanEstimate& differences);

/// Power of the two-sided paired t test with `count` pairs whose true mean is `effect` deviations.
double PairedTestPower(std::size_t count, double effect, double alpha);

/// The smallest number of pairs whose t test finds a mean of `effect` deviations with this power, or nothing
/// if it is above a million. @pre effect > 0.
std::optional<std::size_t> PairsForPower(double effect, double alpha, double power);

/// Random bits as a function of (seed, stream, counter) only: SplitMix64's finaliser (Steele, Lea and Flood,
/// OOPSLA 2014), twice.
std::uint64_t CounterRandom(std::uint64_t seed, std::uint64_t stream, std::uint64_t counter);

}  // namespace lanewise
