#include "analysis/idm_calibration.h"

#include <ceres/ceres.h>

#include <Eigen/Dense>
#include <algorithm>
#include <boost/math/distributions/students_t.hpp>
#include <cmath>
#include <map>
#include <set>

#include "agents/core/check.h"
#include "agents/planning/car_following.h"

namespace lanewise {
namespace {

using Matrix = Eigen::Matrix<double, kIdmParams, kIdmParams>;
using Vector = Eigen::Matrix<double, kIdmParams, 1>;

constexpr double kLongestStep = 0.2;  // [s]

/// Simulated minus recorded gaps of an episode, from its second row on.
class GapErrors {
 public:
  explicit GapErrors(const FollowingEpisode& episode) : episode_(episode), gap_(episode.time.size()) {}

  bool operator()(double const* const* parameters, double* residuals) const {
    IdmValues values;
    std::copy_n(parameters[0], kIdmParams, values.begin());
    SimulateIdmGaps(episode_, values, gap_);
    for (std::size_t k = 1; k < gap_.size(); ++k) residuals[k - 1] = gap_[k] - episode_.gap[k];
    return true;
  }

 private:
  const FollowingEpisode& episode_;
  mutable std::vector<double> gap_;  // Ceres runs on one thread.
};

class Report final : public ceres::IterationCallback {
 public:
  Report(const IdmFitOptions& options, double rows) : options_(options), rows_(rows) {}
  ceres::CallbackReturnType operator()(const ceres::IterationSummary& summary) override {
    if (options_.progress) options_.progress(summary.iteration, std::sqrt(2.0 * summary.cost / rows_));
    return ceres::SOLVER_CONTINUE;
  }

 private:
  const IdmFitOptions& options_;
  double rows_;
};

struct Solution {
  IdmValues values{};
  double cost{1e300};
  int iterations{0};
  bool converged{false};
};

class GapProblem {
 public:
  GapProblem(std::span<const FollowingEpisode* const> episodes, const IdmFitOptions& options)
      : options_(options) {
    for (const FollowingEpisode* episode : episodes) {
      auto* cost =
          new ceres::DynamicNumericDiffCostFunction<GapErrors, ceres::CENTRAL>(new GapErrors(*episode));
      cost->AddParameterBlock(kIdmParams);
      cost->SetNumResiduals(static_cast<int>(episode->time.size()) - 1);
      problem_.AddResidualBlock(cost, nullptr, values_.data());
    }
    std::vector<int> constant;
    for (int k = 0; k < kIdmParams; ++k) {
      if (options.fixed[k]) constant.push_back(k);
      problem_.SetParameterLowerBound(values_.data(), k, std::min(kIdmParamInfo[k].min, options.start[k]));
      problem_.SetParameterUpperBound(values_.data(), k, std::max(kIdmParamInfo[k].max, options.start[k]));
    }
    if (constant.size() == kIdmParams) {
      problem_.SetParameterBlockConstant(values_.data());
    } else if (!constant.empty()) {
      problem_.SetManifold(values_.data(), new ceres::SubsetManifold(kIdmParams, constant));
    }
  }

  Solution Solve(IdmValues start) {
    for (int k = 0; k < kIdmParams; ++k) {
      if (options_.fixed[k]) start[k] = options_.start[k];
    }
    values_ = start;
    ceres::Solver::Options solver;
    solver.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
    solver.max_num_iterations = options_.max_iterations;
    solver.function_tolerance = 1e-9;
    solver.logging_type = ceres::SILENT;
    solver.num_threads = 1;
    Report report(options_, static_cast<double>(problem_.NumResiduals()));
    solver.callbacks.push_back(&report);
    ceres::Solver::Summary summary;
    ceres::Solve(solver, &problem_, &summary);
    return {values_, summary.final_cost, static_cast<int>(summary.iterations.size()),
            summary.termination_type == ceres::CONVERGENCE};
  }

 private:
  IdmFitOptions options_;
  IdmValues values_{};
  ceres::Problem problem_;
};

/// Normal equations at a solution, and the gradients of the vehicles for the sandwich estimate.
struct Normal {
  Matrix a = Matrix::Zero(), b = Matrix::Zero();
};

Normal NormalEquations(std::span<const FollowingEpisode* const> episodes, const IdmValues& values) {
  Normal normal;
  std::map<std::string_view, Vector> gradients;
  for (const FollowingEpisode* episode : episodes) {
    ceres::DynamicNumericDiffCostFunction<GapErrors, ceres::CENTRAL> cost(new GapErrors(*episode));
    cost.AddParameterBlock(kIdmParams);
    const int rows = static_cast<int>(episode->time.size()) - 1;
    cost.SetNumResiduals(rows);
    Eigen::VectorXd residuals(rows);
    Eigen::Matrix<double, Eigen::Dynamic, kIdmParams, Eigen::RowMajor> jacobian(rows, kIdmParams);
    const double* parameters = values.data();
    double* jacobians = jacobian.data();
    cost.Evaluate(&parameters, residuals.data(), &jacobians);
    normal.a += jacobian.transpose() * jacobian;
    gradients.try_emplace(episode->vehicle, Vector::Zero()).first->second += jacobian.transpose() * residuals;
  }
  for (const auto& [vehicle, gradient] : gradients) normal.b += gradient * gradient.transpose();
  if (gradients.size() > 1)
    normal.b *= static_cast<double>(gradients.size()) / static_cast<double>(gradients.size() - 1);
  return normal;
}

/// Parameters that the data tell apart, one after the other left out until the rest is well conditioned.
void MarkUndetermined(const Matrix& a, IdmFit* fit) {
  constexpr double kLeastEigenvalue = 1e-9;  // Of the matrix scaled to a diagonal of 1.
  for (;;) {
    std::vector<int> free;
    for (int k = 0; k < kIdmParams; ++k) {
      if (fit->state[k] != IdmParamState::kFree) continue;
      if (a(k, k) > 0.0) {
        free.push_back(k);
      } else {
        fit->state[k] = IdmParamState::kUndetermined;  // Nothing depends on it.
      }
    }
    if (free.empty()) return;
    Eigen::MatrixXd scaled = a(free, free);
    const Eigen::VectorXd root = scaled.diagonal().cwiseSqrt().cwiseInverse();
    scaled = root.asDiagonal() * scaled * root.asDiagonal();
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(scaled);
    if (eigen.eigenvalues()[0] > kLeastEigenvalue) return;
    Eigen::Index worst = 0;
    eigen.eigenvectors().col(0).cwiseAbs().maxCoeff(&worst);
    fit->state[free[static_cast<std::size_t>(worst)]] = IdmParamState::kUndetermined;
  }
}

void SetConfidence(std::span<const FollowingEpisode* const> episodes, double cost, IdmFit* fit) {
  const Normal normal = NormalEquations(episodes, fit->values);
  MarkUndetermined(normal.a, fit);
  std::vector<int> free;
  for (int k = 0; k < kIdmParams; ++k) {
    fit->correlation[k][k] = 1.0;
    if (fit->state[k] == IdmParamState::kFree) free.push_back(k);
  }
  const auto count = static_cast<double>(free.size());
  if (free.empty() || static_cast<double>(fit->rows) <= count) return;
  const Eigen::MatrixXd inverse =
      Eigen::MatrixXd(normal.a(free, free))
          .llt()
          .solve(Eigen::MatrixXd::Identity(static_cast<Eigen::Index>(free.size()),
                                           static_cast<Eigen::Index>(free.size())));
  const Eigen::MatrixXd independent = 2.0 * cost / (static_cast<double>(fit->rows) - count) * inverse;
  const bool clustered = fit->vehicles > 1;
  const double quantile =
      clustered ? boost::math::quantile(boost::math::students_t(fit->vehicles - 1.0), 0.975) : 0.0;
  const Eigen::MatrixXd covariance =
      clustered ? Eigen::MatrixXd(inverse * normal.b(free, free) * inverse) : independent;
  for (std::size_t i = 0; i < free.size(); ++i) {
    fit->independent_error[free[i]] = std::sqrt(independent(i, i));
    if (clustered) {
      fit->error[free[i]] = std::sqrt(covariance(i, i));
      fit->half_width[free[i]] = quantile * fit->error[free[i]];
    }
    for (std::size_t j = 0; j < free.size(); ++j) {
      fit->correlation[free[i]][free[j]] =
          i == j ? 1.0 : covariance(i, j) / std::sqrt(covariance(i, i) * covariance(j, j));
    }
  }
}

}  // namespace

void SimulateIdmGaps(const FollowingEpisode& episode, const IdmValues& values, std::span<double> gap) {
  const auto [v0, time_gap, min_gap, accel, decel] = values;
  double g = episode.gap[0], v = episode.speed[0];
  gap[0] = g;
  for (std::size_t k = 1; k < episode.time.size(); ++k) {
    const double dt = episode.time[k] - episode.time[k - 1];
    const double way =
        episode.gap[k] - episode.gap[k - 1] + 0.5 * (episode.speed[k] + episode.speed[k - 1]) * dt;
    const double first = episode.leader_speed[k - 1], last = episode.leader_speed[k];
    const int steps = std::max(1, static_cast<int>(std::ceil(dt / kLongestStep - 1e-6)));
    const double h = dt / steps;
    // What the leader's speeds miss of its way is spread evenly.
    const double rest = way / dt - 0.5 * (first + last);
    for (int i = 0; i < steps; ++i) {
      const double leader = first + (last - first) * i / steps,
                   next_leader = first + (last - first) * (i + 1) / steps;
      // Heun: the mean of the accelerations before and after the step.
      const double ahead = (0.5 * (leader + next_leader) + rest) * h;
      const double before = IdmAccel(v, v0, g, leader, accel, decel, time_gap, min_gap);
      const double guess = std::fmax(0.0, v + before * h);
      const double after = IdmAccel(guess, v0, g + ahead - 0.5 * (v + guess) * h, next_leader, accel, decel,
                                    time_gap, min_gap);
      const double a = 0.5 * (before + after);
      const double next = v + a * h;
      // Who comes to a stop within the step stands for the rest of it.
      const double moved = next >= 0.0 ? 0.5 * (v + next) * h : -0.5 * v * v / a;
      v = std::fmax(0.0, next);
      g += ahead - moved;
    }
    gap[k] = g;
  }
}

double GapRmsError(std::span<const FollowingEpisode* const> episodes, const IdmValues& values) {
  double sum = 0.0, rows = 0.0;
  std::vector<double> gap;
  for (const FollowingEpisode* episode : episodes) {
    gap.resize(episode->time.size());
    SimulateIdmGaps(*episode, values, gap);
    for (std::size_t k = 1; k < gap.size(); ++k)
      sum += (gap[k] - episode->gap[k]) * (gap[k] - episode->gap[k]);
    rows += static_cast<double>(gap.size() - 1);
  }
  return rows > 0.0 ? std::sqrt(sum / rows) : 0.0;
}

IdmFit FitIdm(std::span<const FollowingEpisode* const> episodes, const IdmFitOptions& options) {
  if (episodes.empty()) throw ConfigError("no episodes to fit to");
  IdmFit fit;
  fit.episodes = episodes.size();
  std::set<std::string_view> vehicles;
  double fastest = 0.0;
  for (const FollowingEpisode* episode : episodes) {
    vehicles.insert(episode->vehicle);
    fit.rows += episode->time.size() - 1;
    fastest = std::max(fastest, *std::max_element(episode->speed.begin(), episode->speed.end()));
  }
  fit.vehicles = static_cast<int>(vehicles.size());
  fit.start_rms_error = GapRmsError(episodes, options.start);

  GapProblem problem(episodes, options);
  Solution best;
  const double fast = std::clamp(1.1 * fastest, 5.0, 60.0);
  for (const IdmValues& start :
       {options.start, IdmValues{fast, 1.0, 2.0, 2.0, 3.0}, IdmValues{fast, 2.0, 3.0, 0.8, 1.0}}) {
    const Solution solution = problem.Solve(start);
    fit.iterations += solution.iterations;
    if (solution.cost < best.cost) best = solution;
  }
  fit.values = best.values;
  fit.converged = best.converged;
  fit.rms_error = std::sqrt(2.0 * best.cost / static_cast<double>(fit.rows));
  for (int k = 0; k < kIdmParams; ++k) {
    const double reach = 1e-6 * (kIdmParamInfo[k].max - kIdmParamInfo[k].min);
    const bool at_bound =
        fit.values[k] <= kIdmParamInfo[k].min + reach || fit.values[k] >= kIdmParamInfo[k].max - reach;
    fit.state[k] = options.fixed[k] ? IdmParamState::kFixed
                   : at_bound       ? IdmParamState::kAtBound
                                    : IdmParamState::kFree;
  }
  std::vector<double> gap;
  double sum = 0.0;
  for (const FollowingEpisode* episode : episodes) {
    gap.resize(episode->time.size());
    SimulateIdmGaps(*episode, fit.values, gap);
    for (std::size_t k = 1; k < gap.size(); ++k) sum += gap[k] - episode->gap[k];
  }
  fit.mean_error = sum / static_cast<double>(fit.rows);
  SetConfidence(episodes, best.cost, &fit);
  return fit;
}

}  // namespace lanewise
