#include "agents/v2x/reception.h"

#include <cmath>

#include "agents/v2x/radio.h"

namespace lanewise {
namespace {

constexpr double kDraws = 0x1.0p32;
constexpr std::uint64_t kLastDraw = 0xffffffffULL;
constexpr double kTimeTolerance = 1e-9;  // Of a step.

/// The first draw that an event of probability `p` does not happen with.
std::uint64_t FirstBeyond(double p) {
  return static_cast<std::uint64_t>(std::ceil(p * kDraws));
}

}  // namespace

Reception::Reception(const V2xParams& params, bool loaded)
    : params_(params),
      loaded_(loaded),
      loads_(loaded ? kLoads : 1),
      bin_scale_(params.range > 0.0 ? static_cast<double>(kDistances) / (params.range * params.range) : 0.0),
      not_dropped_(FirstBeyond(1.0 - params.loss)) {
  // A draw more each way, so that rounding decides nothing.
  const auto low = [](double p) {
    const std::uint64_t first = std::min(FirstBeyond(p), kLastDraw);
    return static_cast<std::uint32_t>(first > 0 ? first - 1 : 0);
  };
  const auto high = [](double p) {
    return static_cast<std::uint32_t>(std::min(FirstBeyond(p) + 1, kLastDraw));
  };
  const double range2 = params.range * params.range;
  bounds_.reserve(loads_ * kDistances);
  for (std::size_t row = 0; row < loads_; ++row) {
    const double light = loaded ? static_cast<double>(row) / kLoads : 0.0;
    const double heavy = loaded ? static_cast<double>(row + 1) / kLoads : 0.0;
    for (std::size_t bin = 0; bin < kDistances; ++bin) {
      const Odds best = OddsAt(light, range2 * static_cast<double>(bin) / kDistances);
      const Odds worst = OddsAt(heavy, range2 * static_cast<double>(bin + 1) / kDistances);
      bounds_.push_back(
          {low(worst.delivered), high(best.delivered), low(worst.not_faded), high(best.not_faded)});
    }
  }
}

Reception::Odds Reception::OddsAt(double load, double distance2) const {
  Odds odds;
  odds.not_faded =
      (1.0 - params_.loss) * FadingReception(distance2 / (params_.fading_range * params_.fading_range));
  odds.delivered = odds.not_faded;
  if (loaded_)
    odds.delivered *= CollisionFree(load, HiddenShare(std::sqrt(distance2), params_.carrier_sense_range));
  return odds;
}

Fate Reception::ExactFateOf(double load, double distance2, std::uint32_t draw) const {
  const Odds odds = OddsAt(load, distance2);
  if (draw >= not_dropped_) return Fate::kDropped;
  if (draw >= FirstBeyond(odds.not_faded)) return Fate::kFaded;
  if (draw >= FirstBeyond(odds.delivered)) return Fate::kCollided;
  return Fate::kDelivered;
}

std::int32_t Reception::ExactLatency(double dt, std::uint32_t draw) const {
  const double v = (static_cast<double>(draw) + 0.5) / kDraws;
  const double latency = std::min(
      params_.latency_max, params_.latency_min - (params_.latency_mean - params_.latency_min) * std::log(v));
  return static_cast<std::int32_t>(std::ceil(latency / dt - kTimeTolerance));
}

void Reception::SetStep(double dt) {
  if (dt == dt_) return;
  dt_ = dt;
  late_.clear();
  const std::int32_t longest = ExactLatency(dt, 0);
  for (std::int32_t steps = 0; steps < longest; ++steps) {
    // The latency falls as the draw grows: bisection for the first draw that is there after `steps`.
    std::uint64_t late = 0, on_time = kLastDraw + 1;
    while (on_time - late > 1) {
      const std::uint64_t middle = (late + on_time) / 2;
      (ExactLatency(dt, static_cast<std::uint32_t>(middle)) > steps ? late : on_time) = middle;
    }
    late_.push_back(on_time);
  }
  next_step_first_ = late_.size() > 1 ? late_[1] : 0;
  next_step_count_ = late_.empty() ? 0 : late_[0] - next_step_first_;
}

}  // namespace lanewise
