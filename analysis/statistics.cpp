#include "analysis/statistics.h"

#include <algorithm>
#include <boost/math/distributions/non_central_t.hpp>
#include <boost/math/distributions/normal.hpp>
#include <boost/math/distributions/students_t.hpp>
#include <boost/math/special_functions/gamma.hpp>
#include <cmath>
#include <numeric>

#include "agents/core/check.h"

namespace lanewise {
namespace {

constexpr std::size_t kMinResampled = 6;    // Below it a bootstrap of the mean has too few distinct samples.
constexpr std::size_t kMaxEnumerated = 20;  // 2^19 sign patterns.
constexpr std::size_t kMaxExactRanks = 60;  // The rank sum's distribution: 60 x 3661 additions.
constexpr std::size_t kSignDraws = 99'999;
constexpr std::uint64_t kBootstrapStream = 1, kSignStream = 2;

const boost::math::normal kNormal;

std::uint64_t Mix(std::uint64_t x) {
  x += 0x9E3779B97F4A7C15u;
  x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9u;
  x = (x ^ (x >> 27)) * 0x94D049BB133111EBu;
  return x ^ (x >> 31);
}

double Sum(std::span<const double> values) {
  return std::accumulate(values.begin(), values.end(), 0.0);
}

/// Means of resampled values, sorted.
std::vector<double> BootstrapMeans(std::span<const double> values, const StatisticsParams& params) {
  const std::size_t n = values.size();
  std::vector<double> means(static_cast<std::size_t>(params.resamples));
  for (std::size_t b = 0; b < means.size(); ++b) {
    const std::uint64_t key = Mix(Mix(params.seed) + kBootstrapStream) + b * ((n + 1) / 2);
    double sum = 0.0;
    for (std::size_t i = 0; i < n; i += 2) {
      const std::uint64_t bits = Mix(key + i / 2);  // Two indices of 32 bits each.
      sum += values[(bits >> 32) * n >> 32];
      if (i + 1 < n) sum += values[(bits & 0xFFFFFFFFu) * n >> 32];
    }
    means[b] = sum / static_cast<double>(n);
  }
  std::sort(means.begin(), means.end());
  return means;
}

/// The acceleration of BCa by the jackknife; for a mean it is the skewness / (6 sqrt(n)).
double Acceleration(std::span<const double> values, double mean) {
  double squares = 0.0, cubes = 0.0;
  for (const double value : values) {
    const double d = value - mean;
    squares += d * d;
    cubes += d * d * d;
  }
  return cubes / (6.0 * std::pow(squares, 1.5));
}

Interval ExpandedBca(std::span<const double> values, double mean, const StatisticsParams& params) {
  const auto n = static_cast<double>(values.size());
  const std::vector<double> means = BootstrapMeans(values, params);
  // Ties count half: with counts as values many resampled means equal the mean. They differ from it by
  // rounding.
  const double tolerance = 1e-12 * (std::abs(values.front()) + std::abs(mean));
  const auto below = std::lower_bound(means.begin(), means.end(), mean - tolerance) - means.begin();
  const auto not_above = std::upper_bound(means.begin(), means.end(), mean + tolerance) - means.begin();
  const double share =
      (0.5 * static_cast<double>(below + not_above) + 0.5) / (static_cast<double>(means.size()) + 1.0);
  const double bias = boost::math::quantile(kNormal, share);
  const double acceleration = Acceleration(values, mean);
  const double z = std::sqrt(n / (n - 1.0)) *
                   boost::math::quantile(boost::math::students_t(n - 1.0), 1.0 - 0.5 * params.alpha);
  const auto bound = [&](double side) {
    const double shifted = bias + side * z;
    const double stretch = 1.0 - acceleration * shifted;
    // The correction has a pole; beyond it all of the tail is meant.
    const double level = stretch > 0.0 ? boost::math::cdf(kNormal, bias + shifted / stretch)
                         : side > 0.0  ? 1.0
                                       : 0.0;
    const double rank = level * (static_cast<double>(means.size()) + 1.0) - 1.0;
    const double last = static_cast<double>(means.size() - 1);
    const double at = std::clamp(rank, 0.0, last);
    const auto lower = static_cast<std::size_t>(at);
    const std::size_t upper = std::min(lower + 1, means.size() - 1);
    return means[lower] + (at - static_cast<double>(lower)) * (means[upper] - means[lower]);
  };
  return {bound(-1.0), bound(1.0)};
}

/// How many of the 2^n sign patterns give a sum at least as far from zero as the observed one. Half of them,
/// the first sign fixed, are walked in Gray-code order: one sign flips at a time.
PValue EnumerateSigns(const std::vector<double>& values) {
  const std::size_t n = values.size();
  double scale = 0.0;
  for (const double value : values) scale += std::abs(value);
  const double observed = std::abs(Sum(values)) - 1e-9 * scale;
  std::vector<double> step(n);  // What flipping the sign adds; flips sign with each use.
  for (std::size_t i = 0; i < n; ++i) step[i] = -2.0 * values[i];
  double sum = Sum(values);
  const std::uint64_t patterns = std::uint64_t{1} << (n - 1);
  std::uint64_t hits = 0;
  for (std::uint64_t k = 1;; ++k) {
    if (std::abs(sum) >= observed) ++hits;
    if (k == patterns) break;
    const auto flipped = static_cast<std::size_t>(__builtin_ctzll(k)) + 1;
    sum += step[flipped];
    step[flipped] = -step[flipped];
  }
  return {static_cast<double>(hits) / static_cast<double>(patterns), true};
}

PValue DrawSigns(const std::vector<double>& values, std::uint64_t seed) {
  double scale = 0.0;
  for (const double value : values) scale += std::abs(value);
  const double observed = std::abs(Sum(values)) - 1e-9 * scale;
  const std::size_t words = (values.size() + 63) / 64;
  std::size_t hits = 0;
  for (std::size_t draw = 0; draw < kSignDraws; ++draw) {
    double sum = 0.0;
    for (std::size_t w = 0; w < words; ++w) {
      std::uint64_t bits = CounterRandom(seed, kSignStream, draw * words + w);
      for (std::size_t i = 64 * w; i < std::min(values.size(), 64 * (w + 1)); ++i, bits >>= 1)
        sum += (bits & 1) != 0 ? values[i] : -values[i];
    }
    if (std::abs(sum) >= observed) ++hits;
  }
  return {static_cast<double>(hits + 1) / static_cast<double>(kSignDraws + 1), false};
}

/// Twice the mean ranks of the magnitudes: whole numbers also with ties.
std::vector<std::size_t> DoubledRanks(const std::vector<double>& values) {
  const std::size_t n = values.size();
  std::vector<std::size_t> order(n), ranks(n);
  std::iota(order.begin(), order.end(), std::size_t{0});
  const auto magnitude = [&](std::size_t i) { return std::abs(values[i]); };
  std::sort(order.begin(), order.end(), [&](auto a, auto b) { return magnitude(a) < magnitude(b); });
  for (std::size_t from = 0; from < n;) {
    std::size_t to = from + 1;
    while (to < n && magnitude(order[to]) <= magnitude(order[from]) * (1.0 + 1e-12)) ++to;
    for (std::size_t k = from; k < to; ++k) ranks[order[k]] = from + 1 + to;
    from = to;
  }
  return ranks;
}

PValue SignedRanks(const std::vector<double>& values) {
  const std::vector<std::size_t> ranks = DoubledRanks(values);
  const std::size_t total = std::accumulate(ranks.begin(), ranks.end(), std::size_t{0});
  std::size_t positive = 0;
  for (std::size_t i = 0; i < values.size(); ++i) positive += values[i] > 0.0 ? ranks[i] : 0;
  const std::size_t tail = std::min(positive, total - positive);
  if (values.size() <= kMaxExactRanks) {
    std::vector<double> ways(total + 1, 0.0);  // Probability of each doubled rank sum.
    ways[0] = 1.0;
    std::size_t reach = 0;
    for (const std::size_t rank : ranks) {
      reach += rank;
      for (std::size_t sum = reach + 1; sum-- > 0;)
        ways[sum] = 0.5 * (ways[sum] + (sum >= rank ? ways[sum - rank] : 0.0));
    }
    const double below =
        std::accumulate(ways.begin(), ways.begin() + static_cast<std::ptrdiff_t>(tail) + 1, 0.0);
    return {std::min(1.0, 2.0 * below), true};
  }
  double variance = 0.0;  // Of the doubled rank sum; a quarter of the squared ranks' sum covers ties too.
  for (const std::size_t rank : ranks)
    variance += 0.25 * static_cast<double>(rank) * static_cast<double>(rank);
  const double distance = 0.5 * static_cast<double>(total) - static_cast<double>(tail);
  const double z =
      std::max(0.0, distance - 1.0) / std::sqrt(variance);  // Half a rank of continuity, doubled.
  return {std::min(1.0, 2.0 * boost::math::cdf(boost::math::complement(kNormal, z))), false};
}

}  // namespace

const char* ToString(IntervalKind kind) {
  switch (kind) {
    case IntervalKind::kNone:
      return "none";
    case IntervalKind::kConstant:
      return "constant";
    case IntervalKind::kStudent:
      return "student-t";
    case IntervalKind::kBca:
      return "bca-expanded";
  }
  return "";
}

const char* ToString(SignificanceTest test) {
  return test == SignificanceTest::kWilcoxon ? "wilcoxon" : "permutation";
}

std::uint64_t CounterRandom(std::uint64_t seed, std::uint64_t stream, std::uint64_t counter) {
  return Mix(Mix(Mix(seed) + stream) + counter);
}

MeanEstimate EstimateMean(std::span<const double> values, const StatisticsParams& params) {
  LANEWISE_CHECK(params.alpha > 0.0 && params.alpha <= 0.5 && params.resamples >= 99);
  MeanEstimate estimate;
  estimate.count = values.size();
  if (values.empty()) return estimate;
  const auto n = static_cast<double>(values.size());
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  estimate.mean = *low == *high ? *low : Sum(values) / n;
  if (values.size() < 2) return estimate;
  if (*low == *high) {
    estimate.kind = IntervalKind::kConstant;
    estimate.interval = {*low, *low};
    return estimate;
  }
  double squares = 0.0;
  for (const double value : values) squares += (value - estimate.mean) * (value - estimate.mean);
  estimate.deviation = std::sqrt(squares / (n - 1.0));
  if (values.size() < kMinResampled) {
    const double half = boost::math::quantile(boost::math::students_t(n - 1.0), 1.0 - 0.5 * params.alpha) *
                        estimate.deviation / std::sqrt(n);
    estimate.kind = IntervalKind::kStudent;
    estimate.interval = {estimate.mean - half, estimate.mean + half};
  } else {
    estimate.kind = IntervalKind::kBca;
    estimate.interval = ExpandedBca(values, estimate.mean, params);
  }
  return estimate;
}

PValue TestZeroMean(std::span<const double> differences, const StatisticsParams& params) {
  std::vector<double> values;  // Zeros change neither sum nor sign.
  for (const double value : differences) {
    if (value != 0.0) values.push_back(value);
  }
  if (values.empty()) return {1.0, true};
  if (params.test == SignificanceTest::kWilcoxon) return SignedRanks(values);
  return values.size() <= kMaxEnumerated ? EnumerateSigns(values) : DrawSigns(values, params.seed);
}

double SmallestPossibleP(std::size_t count) {
  return count == 0 ? 1.0 : std::ldexp(1.0, 1 - static_cast<int>(std::min<std::size_t>(count, 1000)));
}

std::vector<double> HolmAdjust(std::span<const double> p_values) {
  std::vector<std::size_t> order(p_values.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(), [&](auto a, auto b) { return p_values[a] < p_values[b]; });
  std::vector<double> adjusted(p_values.size());
  double largest = 0.0;
  for (std::size_t k = 0; k < order.size(); ++k) {
    largest = std::max(largest, std::min(1.0, static_cast<double>(order.size() - k) * p_values[order[k]]));
    adjusted[order[k]] = largest;
  }
  return adjusted;
}

std::optional<double> PairedEffectSize(const MeanEstimate& differences) {
  if (differences.count < 2 || differences.deviation == 0.0) return std::nullopt;
  const auto m = static_cast<double>(differences.count - 1);
  // One degree of freedom: Gamma(0) makes the correction vanish, so the plain ratio stands.
  const double correction =
      differences.count == 2
          ? 1.0
          : 1.0 / (std::sqrt(0.5 * m) * boost::math::tgamma_delta_ratio(0.5 * (m - 1.0), 0.5));
  return correction * differences.mean / differences.deviation;
}

double PairedTestPower(std::size_t count, double effect, double alpha) {
  if (count < 2) return 0.0;
  const auto n = static_cast<double>(count);
  const double critical = boost::math::quantile(boost::math::students_t(n - 1.0), 1.0 - 0.5 * alpha);
  const double shift = std::abs(effect) * std::sqrt(n);
  if (shift >
      30.0) {  // Far in the tail Boost's series gets slow; the normal approximation says 1 or 0 there.
    return boost::math::cdf(kNormal,
                            (shift - critical) / std::sqrt(1.0 + 0.5 * critical * critical / (n - 1.0)));
  }
  const boost::math::non_central_t distribution(n - 1.0, shift);
  return boost::math::cdf(boost::math::complement(distribution, critical)) +
         boost::math::cdf(distribution, -critical);
}

std::optional<std::size_t> PairsForPower(double effect, double alpha, double power) {
  LANEWISE_CHECK(effect > 0.0 && power > 0.0 && power < 1.0);
  // Starting point: Guenther, The American Statistician 35 (1981); then the exact power, pair by pair.
  const double tail = boost::math::quantile(kNormal, 1.0 - 0.5 * alpha);
  const double z = (tail + boost::math::quantile(kNormal, power)) / effect;
  const double guess = z * z + 0.5 * tail * tail;
  if (!(guess < 1e6)) return std::nullopt;
  auto count = std::max<std::size_t>(2, static_cast<std::size_t>(guess));
  if (count > 1000) return count;  // Guenther's number is exact to less than a pair there.
  while (PairedTestPower(count, effect, alpha) < power) ++count;
  while (count > 2 && PairedTestPower(count - 1, effect, alpha) >= power) --count;
  return count;
}

}  // namespace lanewise
