#include "agents/coordination/arrival_plan.h"

#include <ceres/ceres.h>

#include <algorithm>
#include <cmath>

namespace lanewise {
namespace {

constexpr double kSlowest = 0.5;       // [m/s] cruising.
constexpr double kComfort = 0.05;      // [s^2/m] weight of a change of speed against a delay.
constexpr double kOrderWeight = 20.0;  // Of what a separation lacks.
constexpr double kInTime = 0.02;       // [s]
constexpr int kHalvings = 30;

/// Cruising speeds [m/s] for passing the line at `crossing`.
struct Cruises {
  double crossing, low, high;
};

/// With `crossing` [m/s] within reach: v0 to the cruising speed and from that to the crossing speed takes
/// (u^2 - v0^2) / (2 a) + (u^2 - w^2) / (2 b) of the distance above both speeds, the other way round below.
Cruises CruisesFor(const Arrival& arrival, double crossing) {
  const double a = kProfileAccel, b = kProfileDecel, s = arrival.distance, v0 = arrival.speed;
  const double fastest = std::sqrt(v0 * v0 + 2.0 * a * s);
  const double slowest = std::sqrt(std::max(0.0, v0 * v0 - 2.0 * b * s));
  const double w = std::clamp(crossing, slowest, std::max(slowest, fastest));
  const double high = std::sqrt((2.0 * a * b * s + b * v0 * v0 + a * w * w) / (a + b));
  const double low = std::sqrt(std::max(0.0, (a * v0 * v0 + b * w * w - 2.0 * a * b * s) / (a + b)));
  Cruises cruises{w, std::max(low, kSlowest), std::min(high, std::max(arrival.limit, kSlowest))};
  cruises.high = std::max(cruises.high, cruises.low);
  return cruises;
}

/// [s] to the line.
template <class T>
T TimeCruising(const Arrival& arrival, double crossing, const T& u) {
  const auto change = [](const T& from, const T& to, T* distance) {
    const double rate = from < to ? kProfileAccel : -kProfileDecel;
    *distance = (to * to - from * from) / (2.0 * rate);
    return (to - from) / rate;
  };
  T first, last;
  const T time = change(T(arrival.speed), u, &first) + change(u, T(crossing), &last);
  return time + (arrival.distance - first - last) / u;
}

/// What a cruising speed costs.
struct Cost {
  Arrival arrival;
  double crossing, earliest;

  template <class T>
  bool operator()(const T* u, T* residual) const {
    residual[0] = TimeCruising(arrival, crossing, u[0]) - earliest;
    residual[1] = kComfort * (u[0] - std::min(arrival.speed, arrival.limit));
    return true;
  }
};

/// What is lacking to a separation.
struct After {
  Arrival first, second;
  double first_crossing, second_crossing, time;

  template <class T>
  bool operator()(const T* u, const T* v, T* residual) const {
    const T lack =
        TimeCruising(first, first_crossing, u[0]) + time - TimeCruising(second, second_crossing, v[0]);
    residual[0] = lack > 0.0 ? kOrderWeight * lack : T(0.0);
    return true;
  }
};

void KeepSeparations(std::span<const Separation> separations, std::vector<double>* times) {
  std::vector<Separation> ordered(separations.begin(), separations.end());
  std::stable_sort(ordered.begin(), ordered.end(),
                   [](const Separation& a, const Separation& b) { return a.second < b.second; });
  for (const Separation& s : ordered) {
    double& second = (*times)[static_cast<std::size_t>(s.second)];
    second = std::max(second, (*times)[static_cast<std::size_t>(s.first)] + s.time);
  }
}

}  // namespace

double LineSpeed(const Arrival& arrival) {
  return CruisesFor(arrival, arrival.crossing).crossing;
}

double EarliestArrival(const Arrival& arrival) {
  const Cruises cruises = CruisesFor(arrival, arrival.crossing);
  return TimeCruising(arrival, cruises.crossing, cruises.high);
}

double CruiseToArrive(const Arrival& arrival, double time) {
  Cruises cruises = CruisesFor(arrival, arrival.crossing);
  const auto in_time = [&](double crossing, double u) {
    return TimeCruising(arrival, crossing, u) >= time - kInTime;
  };
  if (in_time(cruises.crossing, cruises.high)) return arrival.limit;
  if (!in_time(cruises.crossing, cruises.low)) {
    double low = 0.0, high = cruises.crossing;
    for (int k = 0; k < kHalvings; ++k) {
      const double w = 0.5 * (low + high);
      const Cruises slower = CruisesFor(arrival, w);
      (in_time(slower.crossing, slower.low) ? low : high) = w;
    }
    return std::min(CruisesFor(arrival, low).low, arrival.distance / time);
  }
  double low = cruises.low, high = cruises.high;
  for (int k = 0; k < kHalvings; ++k) {
    const double u = 0.5 * (low + high);
    (in_time(cruises.crossing, u) ? low : high) = u;
  }
  return low;
}

std::vector<double> FirstTimes(std::span<const Arrival> arrivals, std::span<const Separation> separations) {
  std::vector<double> times;
  for (const Arrival& arrival : arrivals)
    times.push_back(std::max(EarliestArrival(arrival), arrival.not_before));
  KeepSeparations(separations, &times);
  return times;
}

std::vector<double> PlanArrivals(std::span<const Arrival> arrivals, std::span<const Separation> separations) {
  const std::vector<double> first_times = FirstTimes(arrivals, separations);
  if (separations.empty()) return first_times;
  std::vector<double> speeds(arrivals.size());
  std::vector<Cruises> cruises;
  ceres::Problem problem;
  for (std::size_t i = 0; i < arrivals.size(); ++i) {
    const Arrival& a = arrivals[i];
    const Cruises& c = cruises.emplace_back(CruisesFor(a, a.crossing));
    const double high = std::clamp(CruiseToArrive(a, a.not_before), c.low, c.high);
    speeds[i] = std::clamp(CruiseToArrive(a, first_times[i]), c.low, high);
    problem.AddResidualBlock(new ceres::AutoDiffCostFunction<Cost, 2, 1>(
                                 new Cost{a, c.crossing, TimeCruising(a, c.crossing, c.high)}),
                             nullptr, &speeds[i]);
    problem.SetParameterLowerBound(&speeds[i], 0, c.low);
    problem.SetParameterUpperBound(&speeds[i], 0, high);
    if (high - c.low < 1e-6) problem.SetParameterBlockConstant(&speeds[i]);
  }
  for (const Separation& s : separations) {
    const auto i = static_cast<std::size_t>(s.first), j = static_cast<std::size_t>(s.second);
    problem.AddResidualBlock(new ceres::AutoDiffCostFunction<After, 1, 1, 1>(new After{
                                 arrivals[i], arrivals[j], cruises[i].crossing, cruises[j].crossing, s.time}),
                             nullptr, &speeds[i], &speeds[j]);
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
  options.max_num_iterations = 10;
  options.num_threads = 1;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);

  std::vector<double> times(arrivals.size());
  for (std::size_t i = 0; i < arrivals.size(); ++i) {
    times[i] = std::max(arrivals[i].not_before, TimeCruising(arrivals[i], cruises[i].crossing, speeds[i]));
  }
  KeepSeparations(separations, &times);
  return times;
}

}  // namespace lanewise
