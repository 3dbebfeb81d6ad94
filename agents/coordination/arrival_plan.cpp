#include "agents/coordination/arrival_plan.h"

#include <ceres/ceres.h>

#include <algorithm>
#include <cmath>

namespace lanewise {
namespace {

constexpr double kSlowest = 0.5;       // [m/s]
constexpr double kComfort = 0.02;      // [s^2/m] weight of a change of speed against a delay.
constexpr double kOrderWeight = 20.0;  // Of what a separation lacks.

/// [s] longer than at the limit.
template <class T>
T Delay(double distance, double limit, double crossing, const T& u) {
  const double free = distance / limit;
  if (u >= crossing) return distance / u - free;
  return (distance - (crossing * crossing - u * u) / (2.0 * kCrossingAccel)) / u +
         (crossing - u) / kCrossingAccel - free;
}

template <class T>
T Delay(const Arrival& a, const T& u) {
  return Delay(a.distance, a.limit, a.crossing, u);
}

/// [m/s] below which there is no room left to speed up to `crossing`.
double LeastSpeed(double distance, double crossing) {
  return std::min(0.99 * crossing,
                  std::sqrt(std::max(kSlowest * kSlowest, crossing * crossing - 2.0 * kCrossingAccel * distance)));
}

struct Comfort {
  Arrival arrival;

  template <class T>
  bool operator()(const T* u, T* residual) const {
    residual[0] = Delay(arrival, u[0]);
    residual[1] = kComfort * (u[0] - std::min(arrival.speed, arrival.limit));
    return true;
  }
};

/// What is lacking to a separation.
struct After {
  Arrival first, second;
  double time;

  template <class T>
  bool operator()(const T* u, const T* v, T* residual) const {
    const T lack = first.earliest + Delay(first, u[0]) + time - second.earliest - Delay(second, v[0]);
    residual[0] = lack > 0.0 ? kOrderWeight * lack : T(0.0);
    return true;
  }
};

}  // namespace

std::vector<double> PlanArrivals(std::span<const Arrival> arrivals, std::span<const Separation> separations) {
  std::vector<double> speeds(arrivals.size());
  ceres::Problem problem;
  for (std::size_t i = 0; i < arrivals.size(); ++i) {
    const Arrival& a = arrivals[i];
    speeds[i] = a.limit;
    problem.AddResidualBlock(new ceres::AutoDiffCostFunction<Comfort, 2, 1>(new Comfort{a}), nullptr, &speeds[i]);
    problem.SetParameterLowerBound(&speeds[i], 0, LeastSpeed(a.distance, a.crossing));
    problem.SetParameterUpperBound(&speeds[i], 0, a.limit);
  }
  for (const Separation& s : separations) {
    const auto i = static_cast<std::size_t>(s.first), j = static_cast<std::size_t>(s.second);
    problem.AddResidualBlock(
        new ceres::AutoDiffCostFunction<After, 1, 1, 1>(new After{arrivals[i], arrivals[j], s.time}), nullptr,
        &speeds[i], &speeds[j]);
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
  options.max_num_iterations = 10;
  options.num_threads = 1;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  if (!separations.empty()) ceres::Solve(options, &problem, &summary);

  std::vector<double> times(arrivals.size());
  for (std::size_t i = 0; i < arrivals.size(); ++i)
    times[i] = arrivals[i].earliest + std::max(0.0, Delay(arrivals[i], speeds[i]));
  std::vector<Separation> ordered(separations.begin(), separations.end());
  std::stable_sort(ordered.begin(), ordered.end(),
                   [](const Separation& a, const Separation& b) { return a.first < b.first; });
  for (const Separation& s : ordered) {
    double& second = times[static_cast<std::size_t>(s.second)];
    second = std::max(second, times[static_cast<std::size_t>(s.first)] + s.time);
  }
  return times;
}

double SpeedToPass(double distance, double time, double limit, double crossing) {
  const double delay = time - distance / limit;
  if (delay <= 0.0) return limit;
  double low = LeastSpeed(distance, crossing), high = limit;
  if (Delay(distance, limit, crossing, low) < delay) return std::min(low, distance / time);  // No run-up is left.
  for (int k = 0; k < 30; ++k) {
    const double u = 0.5 * (low + high);
    (Delay(distance, limit, crossing, u) > delay ? low : high) = u;
  }
  return high;
}

}  // namespace lanewise
