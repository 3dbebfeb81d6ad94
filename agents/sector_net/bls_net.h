#pragma once

#include <Eigen/Core>

#include "agents/sector_net/activation.h"
#include "agents/sector_net/sector_io.h"

namespace lanewise {

/// A trained broad learning system ([C]; Chen, Liu: Broad learning system, IEEE Trans. Neural Networks and
/// Learning Systems 29(1), 2018). With x the inputs scaled to [-1, 1]:
///   feature nodes      z = F x + f            random linear maps, in groups
///   enhancement nodes  h = tansig(E z + e)    random
///   outputs            y = C^T [1; z; h]      C by ridge regression
/// The outputs are not bounded; the largest one wins. Plain data; the inference is const and without heap.
struct BlsNet {
  /// Upper bound of either kind of node, so that the inference works on the stack.
  static constexpr int kMaxNodes = 1024;

  Eigen::MatrixXd feature_weights;      ///< F: feature nodes x 8.
  Eigen::VectorXd feature_biases;       ///< f.
  Eigen::MatrixXd enhancement_weights;  ///< E: enhancement nodes x feature nodes.
  Eigen::VectorXd enhancement_biases;   ///< e.
  Eigen::MatrixXd output_weights;       ///< C: (1 + feature nodes + enhancement nodes) x 3.
  InputScale scale;

  int features() const { return static_cast<int>(feature_biases.size()); }
  int enhancements() const { return static_cast<int>(enhancement_biases.size()); }
  int nodes() const { return 1 + features() + enhancements(); }

  using Nodes = Eigen::Array<double, Eigen::Dynamic, 1, 0, kMaxNodes, 1>;

  /// z and h of one scan.
  void Expand(const SectorInputs& sectors, Nodes* feature, Nodes* enhancement) const noexcept {
    *feature = feature_biases.array();
    for (int i = 0; i < kNetInputs; ++i) {
      *feature += feature_weights.col(i).array() * ((sectors[i] - scale.min) * scale.gain - 1.0);
    }
    *enhancement = enhancement_biases.array();
    for (int j = 0; j < features(); ++j) {
      *enhancement += enhancement_weights.col(j).array() * (*feature)[j];
    }
    *enhancement = Tansig(*enhancement);
  }

  NetOutputs Forward(const SectorInputs& sectors) const noexcept {
    Nodes feature, enhancement;
    Expand(sectors, &feature, &enhancement);
    NetOutputs outputs;
    for (int k = 0; k < kNetOutputs; ++k) {
      const auto column = output_weights.col(k).array();
      outputs[k] = column[0] + (column.segment(1, features()) * feature).sum() +
                   (column.tail(enhancements()) * enhancement).sum();
    }
    return outputs;
  }
};

}  // namespace lanewise
