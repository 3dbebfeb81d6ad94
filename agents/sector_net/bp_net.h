#pragma once

#include <Eigen/Core>

#include "agents/sector_net/activation.h"
#include "agents/sector_net/sector_io.h"

namespace lanewise {

/// The network of [A]: 8 inputs, 16 hidden units (tansig), 3 outputs (logsig), trained by error
/// back-propagation. Plain data; the inference is const, noexcept and without heap.
struct BpNet {
  static constexpr int kHidden = 16;
  static constexpr int kHiddenWeights = 0, kHiddenBiases = kHiddenWeights + kHidden * kNetInputs,
                       kOutputWeights = kHiddenBiases + kHidden,
                       kOutputBiases = kOutputWeights + kNetOutputs * kHidden,
                       kParameters = kOutputBiases + kNetOutputs;

  using Parameters = Eigen::Matrix<double, kParameters, 1>;
  using Hidden = Eigen::Array<double, kHidden, 1>;
  using Outputs = Eigen::Array<double, kNetOutputs, 1>;
  using Inputs = Eigen::Array<double, kNetInputs, 1>;

  /// Every weight and bias, so that optimizers see one vector: hidden weights (16 x 8, by columns), hidden
  /// biases, output weights (3 x 16, by rows), output biases.
  Parameters parameters{Parameters::Zero()};
  InputScale scale;

  auto hidden_weights() const {
    return Eigen::Map<const Eigen::Matrix<double, kHidden, kNetInputs>>(parameters.data() + kHiddenWeights);
  }
  auto hidden_biases() const { return Eigen::Map<const Hidden>(parameters.data() + kHiddenBiases); }
  auto output_weights() const {
    return Eigen::Map<const Eigen::Matrix<double, kNetOutputs, kHidden, Eigen::RowMajor>>(parameters.data() +
                                                                                          kOutputWeights);
  }
  auto output_biases() const { return Eigen::Map<const Outputs>(parameters.data() + kOutputBiases); }

  /// What the layers put out; back-propagation needs them.
  struct Layers {
    Inputs inputs;  ///< Scaled to [-1, 1].
    Hidden hidden;
    Outputs outputs;
  };

  /// Eqs. (1)-(2): each unit's weighted sum through its activation, layer by layer.
  void Forward(const SectorInputs& sectors, Layers* layers) const noexcept {
    layers->inputs = (Eigen::Map<const Inputs>(sectors.data()) - scale.min) * scale.gain - 1.0;
    const Hidden sum = hidden_weights().lazyProduct(layers->inputs.matrix()).array() + hidden_biases();
    layers->hidden = Tansig(sum);
    // Four wide, so that it fills vector registers.
    Eigen::Array4d output = Eigen::Array4d::Zero();
    for (int k = 0; k < kNetOutputs; ++k) {
      output[k] = output_biases()[k] + (output_weights().row(k).transpose().array() * layers->hidden).sum();
    }
    output = Logsig(output).eval();
    layers->outputs = output.head<kNetOutputs>();
  }

  NetOutputs Forward(const SectorInputs& sectors) const noexcept {
    Layers layers;
    Forward(sectors, &layers);
    return {layers.outputs[0], layers.outputs[1], layers.outputs[2]};
  }

  /// Eqs. (4)-(7): adds to `gradient` the derivatives by every parameter of a function of the outputs whose
  /// derivatives by them are `by_output`. For the error E = 1/2 sum (Y - d)^2 that is Y - d, Eq. (3)-(4), and
  /// the output weights' are (Y - d) Y (1 - Y) Y_i, Eq. (5).
  void BackPropagate(const Layers& layers, const Outputs& by_output, Parameters* gradient) const noexcept {
    const Outputs output_delta = by_output * layers.outputs * (1.0 - layers.outputs);
    const Hidden hidden_delta = (output_weights().transpose() * output_delta.matrix()).array() *
                                (1.0 - layers.hidden * layers.hidden);  // tansig' = 1 - tansig^2.
    double* g = gradient->data();
    Eigen::Map<Eigen::Matrix<double, kHidden, kNetInputs>>(g + kHiddenWeights).noalias() +=
        hidden_delta.matrix() * layers.inputs.matrix().transpose();
    Eigen::Map<Hidden>(g + kHiddenBiases) += hidden_delta;
    Eigen::Map<Eigen::Matrix<double, kNetOutputs, kHidden, Eigen::RowMajor>>(g + kOutputWeights).noalias() +=
        output_delta.matrix() * layers.hidden.matrix().transpose();
    Eigen::Map<Outputs>(g + kOutputBiases) += output_delta;
  }
};

}  // namespace lanewise
