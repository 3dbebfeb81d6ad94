#include "agents/sector_net/bp_training.h"

#include <ceres/ceres.h>

#include <chrono>
#include <cmath>
#include <numeric>

#include "agents/core/random.h"

namespace lanewise {
namespace {

using Clock = std::chrono::steady_clock;

double Seconds(Clock::time_point since) {
  return std::chrono::duration<double>(Clock::now() - since).count();
}

BpNet::Outputs Target(const LabelledScan& sample) {
  const NetOutputs target = TargetOf(sample.way);
  return {target[0], target[1], target[2]};
}

double TotalWeight(std::span<const LabelledScan> samples) {
  double total = 0.0;
  for (const LabelledScan& sample : samples) total += sample.weight;
  return total;
}

/// Mean squared error and the gradient of the mean of E.
double Evaluate(const BpNet& net, std::span<const LabelledScan> samples, BpNet::Parameters* gradient) {
  gradient->setZero();
  double sum = 0.0;
  const double total = TotalWeight(samples);
  BpNet::Layers layers;
  for (const LabelledScan& sample : samples) {
    net.Forward(sample.sectors, &layers);
    const BpNet::Outputs error = layers.outputs - Target(sample);
    sum += sample.weight * error.square().sum();
    net.BackPropagate(layers, sample.weight / total * error, gradient);
  }
  return sum / (kNetOutputs * total);
}

void StepAfterEachSample(std::span<const LabelledScan> samples, double learning_rate, std::uint64_t seed,
                         int epoch, std::vector<std::uint32_t>* order, BpNet* net) {
  const RandomStream random(seed, 0, RandomPurpose::kTrainingOrder, static_cast<std::uint64_t>(epoch));
  for (std::size_t i = order->size() - 1; i > 0; --i) {
    const double draw = static_cast<double>(i + 1) * random.Uniform(i);
    std::swap((*order)[i], (*order)[static_cast<std::size_t>(draw)]);
  }
  const double mean_weight = TotalWeight(samples) / static_cast<double>(samples.size());
  BpNet::Layers layers;
  for (const std::uint32_t i : *order) {
    net->Forward(samples[i].sectors, &layers);
    BpNet::Parameters gradient = BpNet::Parameters::Zero();
    net->BackPropagate(layers, layers.outputs - Target(samples[i]), &gradient);
    net->parameters -= learning_rate * samples[i].weight / mean_weight * gradient;
  }
}

/// Every output's error of every sample as residuals, scaled so that Ceres' cost 1/2 sum r^2 is half the mean
/// squared error.
class OutputErrors final : public ceres::CostFunction {
 public:
  OutputErrors(std::span<const LabelledScan> samples, InputScale scale) : samples_(samples) {
    net_.scale = scale;
    total_ = TotalWeight(samples);
    set_num_residuals(static_cast<int>(samples.size()) * kNetOutputs);
    mutable_parameter_block_sizes()->push_back(BpNet::kParameters);
  }

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    BpNet net = net_;
    net.parameters = Eigen::Map<const BpNet::Parameters>(parameters[0]);
    BpNet::Layers layers;
    for (std::size_t i = 0; i < samples_.size(); ++i) {
      net.Forward(samples_[i].sectors, &layers);
      const double root = std::sqrt(samples_[i].weight / (total_ * kNetOutputs));
      Eigen::Map<BpNet::Outputs>(residuals + kNetOutputs * i) = root * (layers.outputs - Target(samples_[i]));
      if (jacobians == nullptr || jacobians[0] == nullptr) continue;
      for (int k = 0; k < kNetOutputs; ++k) {
        BpNet::Outputs by_output = BpNet::Outputs::Zero();
        by_output[k] = root;
        BpNet::Parameters row = BpNet::Parameters::Zero();
        net.BackPropagate(layers, by_output, &row);
        Eigen::Map<BpNet::Parameters>(jacobians[0] + (kNetOutputs * i + static_cast<std::size_t>(k)) *
                                                         BpNet::kParameters) = row;
      }
    }
    return true;
  }

 private:
  std::span<const LabelledScan> samples_;
  BpNet net_;
  double total_;
};

class StopAtGoal final : public ceres::IterationCallback {
 public:
  StopAtGoal(double goal, const TrainingProgress& progress, BpTraining* training)
      : goal_(goal), progress_(progress), training_(training) {}

  ceres::CallbackReturnType operator()(const ceres::IterationSummary& summary) override {
    // A step that was tried and not taken leaves the weights, and the error, as they were.
    const bool taken = training_->error.empty() || summary.step_is_successful;
    const double error = taken ? 2.0 * summary.cost : training_->error.back();
    training_->error.push_back(error);
    training_->reached = error <= goal_;
    if (training_->reached) return ceres::SOLVER_TERMINATE_SUCCESSFULLY;
    return progress_ && !progress_(summary.iteration, error) ? ceres::SOLVER_TERMINATE_SUCCESSFULLY
                                                             : ceres::SOLVER_CONTINUE;
  }

 private:
  double goal_;
  const TrainingProgress& progress_;
  BpTraining* training_;
};

}  // namespace

BpNet RandomBpNet(std::uint64_t seed) {
  BpNet net;
  const RandomStream random(seed, 0, RandomPurpose::kInitialWeights, 0);
  for (int i = 0; i < BpNet::kParameters; ++i) {
    const double bound = 1.0 / std::sqrt(i < BpNet::kOutputWeights ? kNetInputs : BpNet::kHidden);
    net.parameters[i] = bound * (2.0 * random.Uniform(static_cast<std::uint64_t>(i)) - 1.0);
  }
  return net;
}

double MeanSquaredError(const BpNet& net, std::span<const LabelledScan> samples) {
  double sum = 0.0;
  BpNet::Layers layers;
  for (const LabelledScan& sample : samples) {
    net.Forward(sample.sectors, &layers);
    sum += sample.weight * (layers.outputs - Target(sample)).square().sum();
  }
  return sum / (kNetOutputs * TotalWeight(samples));
}

BpNet::Parameters ErrorGradient(const BpNet& net, std::span<const LabelledScan> samples) {
  BpNet::Parameters gradient;
  Evaluate(net, samples, &gradient);
  return gradient;
}

BpTraining TrainByGradientDescent(std::span<const LabelledScan> samples, const BpTrainingOptions& options,
                                  std::uint64_t seed, const TrainingProgress& progress, BpNet* net) {
  const auto started = Clock::now();
  BpTraining training;
  BpNet::Parameters gradient;
  training.error.push_back(Evaluate(*net, samples, &gradient));
  std::vector<std::uint32_t> order(samples.size());
  std::iota(order.begin(), order.end(), 0u);
  for (int epoch = 1; epoch <= options.max_epochs && training.error.back() > options.goal; ++epoch) {
    if (options.sample_by_sample) {
      StepAfterEachSample(samples, options.learning_rate, seed, epoch, &order, net);
      training.error.push_back(MeanSquaredError(*net, samples));
    } else {
      net->parameters -= options.learning_rate * gradient;
      training.error.push_back(Evaluate(*net, samples, &gradient));
    }
    if (progress && !progress(epoch, training.error.back())) break;
  }
  training.reached = training.error.back() <= options.goal;
  training.wall_time = Seconds(started);
  return training;
}

BpTraining TrainByLevenbergMarquardt(std::span<const LabelledScan> samples, const BpTrainingOptions& options,
                                     const TrainingProgress& progress, BpNet* net) {
  const auto started = Clock::now();
  BpTraining training;
  StopAtGoal stop(options.goal, progress, &training);
  ceres::Problem problem;
  problem.AddResidualBlock(new OutputErrors(samples, net->scale), nullptr, net->parameters.data());
  ceres::Solver::Options solver;
  solver.max_num_iterations = options.max_epochs;
  solver.linear_solver_type = ceres::DENSE_QR;
  solver.logging_type = ceres::SILENT;
  solver.callbacks.push_back(&stop);
  solver.update_state_every_iteration = true;
  solver.num_threads = 1;
  // The goal decides, not the size of a step.
  solver.function_tolerance = solver.gradient_tolerance = solver.parameter_tolerance = 1e-15;
  ceres::Solver::Summary summary;
  ceres::Solve(solver, &problem, &summary);
  training.wall_time = Seconds(started);
  return training;
}

}  // namespace lanewise
