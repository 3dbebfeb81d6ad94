#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "agents/sector_net/bp_net.h"
#include "agents/sector_net/samples.h"

namespace lanewise {

/// How far a training is: epoch and mean squared error. @return false to stop it.
using TrainingProgress = std::function<bool(int epoch, double error)>;

struct BpTrainingOptions {
  double goal{0.001};            ///< [-] mean squared error to end at ([A]).
  int max_epochs{50'000};        ///< ([A]).
  double learning_rate{0.5};     ///< [-] gradient descent only; in (0, 10].
  bool sample_by_sample{false};  ///< Gradient descent only: a step after each sample instead of after all.
};

struct BpTraining {
  std::vector<double> error;  ///< Mean squared error at the beginning and after each epoch.
  bool reached{false};        ///< The goal.
  double wall_time{0.0};      ///< [s]

  int epochs() const { return static_cast<int>(error.size()) - 1; }
};

/// Weights and biases uniform in +-1 / sqrt(inputs of the unit), a function of the seed.
BpNet RandomBpNet(std::uint64_t seed);

/// Mean over samples and outputs of (Y - d)^2; samples count by their weight. Divided by two and multiplied
/// by the outputs it is the paper's E of Eq. (3), as a mean over the samples.
double MeanSquaredError(const BpNet& net, std::span<const LabelledScan> samples);

/// Derivatives of 1/2 sum w (Y - d)^2 / sum w by every parameter; for tests and the gradient descent.
BpNet::Parameters ErrorGradient(const BpNet& net, std::span<const LabelledScan> samples);

/// Gradient descent as in [A], Eqs. (3)-(7): each epoch is one step against the gradient of the mean error of
/// all samples (MATLAB's traingd), or, sample by sample, one step after each in an order that is drawn anew
/// each epoch; then a sample's weight scales its step, relative to the mean weight.
BpTraining TrainByGradientDescent(std::span<const LabelledScan> samples, const BpTrainingOptions& options,
                                  std::uint64_t seed, const TrainingProgress& progress, BpNet* net);

/// Levenberg-Marquardt (Hagan, Menhaj 1994) with Ceres on the same errors; the Jacobian is back-propagated.
/// An epoch is an iteration: one evaluation of all samples, accepted or not.
BpTraining TrainByLevenbergMarquardt(std::span<const LabelledScan> samples, const BpTrainingOptions& options,
                                     const TrainingProgress& progress, BpNet* net);

}  // namespace lanewise
