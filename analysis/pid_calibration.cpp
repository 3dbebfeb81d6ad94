#include "analysis/pid_calibration.h"

#include <ceres/ceres.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <numbers>

namespace lanewise {
namespace {

std::size_t RowsOf(const SpeedStep& step) {
  return static_cast<std::size_t>(std::lround(step.duration / step.dt)) + 1;
}

double SlopeAt(const SpeedPlant& plant, double time) {
  return time >= plant.slope_begin - 1e-9 ? plant.disturbance : 0.0;
}

/// 1 until the settling time after the step or the slope's beginning, from there on the time since it in
/// settling times (after the ITAE criterion of Graham and Lathrop 1953): what stays late, an offset or a
/// swing, is worse than what belongs to the transient.
std::vector<double> TimeWeights(const WantedResponse& wanted, const SpeedPlant& plant,
                                const SpeedStep& step) {
  std::vector<double> weights(RowsOf(step));
  for (std::size_t k = 0; k < weights.size(); ++k) {
    const double time = static_cast<double>(k) * step.dt;
    const bool on_slope = plant.disturbance != 0.0 && time >= plant.slope_begin;
    weights[k] = std::max(1.0, (time - (on_slope ? plant.slope_begin : 0.0)) / wanted.settling_time);
  }
  return weights;
}

double MeanSquare(const std::vector<double>& a, const std::vector<double>& b) {
  double sum = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += (a[i] - b[i]) * (a[i] - b[i]);
  return sum / static_cast<double>(a.size());
}

/// Differences between a response and the wanted one, then the weighted commands, scaled so that the cost is
/// half the sum of both mean squares.
class ResponseError {
 public:
  ResponseError(const PidGains& gains, const SpeedPlant& plant, const SpeedStep& step,
                const std::vector<double>& wanted, const std::vector<double>& weights, double effort_weight,
                int* evaluations)
      : gains_(gains),
        plant_(plant),
        step_(step),
        wanted_(wanted),
        weights_(weights),
        effort_weight_(effort_weight),
        evaluations_(evaluations) {}

  bool operator()(double const* const* parameters, double* residuals) const {
    PidGains gains = gains_;
    gains.kp = parameters[0][0];
    gains.ki = parameters[0][1];
    gains.kd = parameters[0][2];
    ++*evaluations_;
    const SpeedResponse response = SimulateSpeedStep(gains, plant_, step_);
    const double scale = 1.0 / std::sqrt(static_cast<double>(wanted_.size()));
    for (std::size_t i = 0; i < wanted_.size(); ++i) {
      residuals[i] = scale * weights_[i] * (response.speed[i] - wanted_[i]);
      residuals[wanted_.size() + i] =
          scale * effort_weight_ * (response.command[i] + SlopeAt(plant_, response.time[i]));
      // Gains that make the loop explode: the search takes a shorter step.
      if (!std::isfinite(residuals[i]) || std::abs(residuals[i]) > 1e6) return false;
    }
    return true;
  }

 private:
  PidGains gains_;
  SpeedPlant plant_;
  SpeedStep step_;
  const std::vector<double>&wanted_, &weights_;
  double effort_weight_;
  int* evaluations_;
};

}  // namespace

SpeedResponse SimulateSpeedStep(const PidGains& gains, const SpeedPlant& plant, const SpeedStep& step) {
  const std::size_t rows = RowsOf(step);
  SpeedResponse response;
  response.time.resize(rows);
  response.speed.resize(rows);
  response.command.resize(rows);
  // Commands wait for whole control periods.
  std::deque<double> waiting(static_cast<std::size_t>(std::lround(plant.delay / step.dt)), 0.0);
  const double keep = std::exp(-step.dt / plant.lag);
  double speed = step.from, accel = 0.0;
  PidState pid;
  for (std::size_t k = 0; k < rows; ++k) {
    const double command = StepPid(gains, step.to - speed, step.dt, &pid);
    response.time[k] = static_cast<double>(k) * step.dt;
    response.speed[k] = speed;
    response.command[k] = command;
    waiting.push_back(command);
    const double acting = waiting.front();
    waiting.pop_front();
    // a(t) = u + (a0 - u) exp(-t / lag), and its integral.
    speed +=
        (acting + SlopeAt(plant, response.time[k])) * step.dt + (accel - acting) * plant.lag * (1.0 - keep);
    accel = acting + (accel - acting) * keep;
  }
  return response;
}

std::vector<double> WantedSpeeds(const WantedResponse& wanted, const SpeedStep& step) {
  std::vector<double> speeds(RowsOf(step));
  const double log_overshoot = wanted.overshoot > 0.0 ? std::log(wanted.overshoot) : 0.0;
  const double zeta =
      wanted.overshoot > 0.0 ? -log_overshoot / std::hypot(std::numbers::pi, log_overshoot) : 1.0;
  const double root = std::sqrt(1.0 - zeta * zeta);
  const double frequency =
      zeta < 1.0 ? -std::log(0.02 * root) / (zeta * wanted.settling_time) : 5.8339 / wanted.settling_time;
  for (std::size_t k = 0; k < speeds.size(); ++k) {
    const double x = frequency * static_cast<double>(k) * step.dt;
    const double left = zeta < 1.0
                            ? std::exp(-zeta * x) * (std::cos(root * x) + zeta / root * std::sin(root * x))
                            : (1.0 + x) * std::exp(-x);
    speeds[k] = step.to + (step.from - step.to) * left;
  }
  return speeds;
}

ResponseScore ScoreResponse(const SpeedResponse& response, const SpeedPlant& plant, const SpeedStep& step) {
  ResponseScore score;
  const std::size_t rows = response.speed.size(), last = rows - std::max<std::size_t>(1, rows / 10);
  const double size = std::abs(step.to - step.from), sign = step.to < step.from ? -1.0 : 1.0;
  double sum = 0.0, low = response.speed.back(), high = low;
  for (std::size_t k = last; k < rows; ++k) {
    sum += response.speed[k];
    low = std::min(low, response.speed[k]);
    high = std::max(high, response.speed[k]);
  }
  score.offset = step.to - sum / static_cast<double>(rows - last);
  score.swing = high - low;
  int side = 0;
  for (std::size_t k = 0; k < rows; ++k) {
    score.largest_command = std::max(score.largest_command, std::abs(response.command[k]));
    if (SlopeAt(plant, response.time[k]) != 0.0) continue;
    const double beyond = response.speed[k] - step.to;
    score.overshoot = std::max(score.overshoot, sign * beyond);
    const bool is_last = k + 1 == rows || SlopeAt(plant, response.time[k + 1]) != 0.0;
    if (std::abs(beyond) > 0.02 * size) score.settling_time = is_last ? -1.0 : response.time[k + 1];
    if (std::abs(beyond) <= 0.01 * size) continue;
    const int now = beyond > 0.0 ? 1 : -1;
    if (side != 0 && now != side) ++score.crossings;
    side = now;
  }
  return score;
}

PidFit FitPid(const PidGains& gains, const SpeedPlant& plant, const SpeedStep& step,
              const WantedResponse& wanted, double max_gain) {
  const std::vector<double> speeds = WantedSpeeds(wanted, step);
  const std::vector<double> weights = TimeWeights(wanted, plant, step);
  PidFit best;
  best.gains = gains;
  best.start_rms_error = std::sqrt(MeanSquare(SimulateSpeedStep(gains, plant, step).speed, speeds));
  double lowest = 1e300;
  int evaluations = 0;
  const std::array<std::array<double, 3>, 5> starts{
      {{gains.kp, gains.ki, gains.kd}, {0.3, 0.05, 0.1}, {1.0, 0.2, 1.0}, {3.0, 0.5, 3.0}, {0.5, 0.1, 0.0}}};
  for (std::array<double, 3> values : starts) {
    for (double& value : values) value = std::clamp(value, 1e-3, max_gain);
    ceres::Problem problem;
    auto* cost = new ceres::DynamicNumericDiffCostFunction<ResponseError, ceres::CENTRAL>(
        new ResponseError(gains, plant, step, speeds, weights, wanted.effort_weight, &evaluations));
    cost->AddParameterBlock(3);
    cost->SetNumResiduals(static_cast<int>(2 * speeds.size()));
    problem.AddResidualBlock(cost, nullptr, values.data());
    for (int k = 0; k < 3; ++k) {
      problem.SetParameterLowerBound(values.data(), k, 0.0);
      problem.SetParameterUpperBound(values.data(), k, max_gain);
    }
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::DENSE_QR;
    options.max_num_iterations = 200;
    options.function_tolerance = 1e-10;
    options.logging_type = ceres::SILENT;
    options.num_threads = 1;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
    ++best.starts;
    if (!summary.IsSolutionUsable() || summary.final_cost >= lowest) continue;
    lowest = summary.final_cost;
    best.gains.kp = values[0];
    best.gains.ki = values[1];
    best.gains.kd = values[2];
    best.converged = summary.termination_type == ceres::CONVERGENCE;
  }
  best.evaluations = evaluations;
  best.rms_error = std::sqrt(MeanSquare(SimulateSpeedStep(best.gains, plant, step).speed, speeds));
  return best;
}

}  // namespace lanewise
