#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "agents/sector_net/bls_net.h"
#include "agents/sector_net/samples.h"

namespace lanewise {

struct BlsOptions {
  int feature_groups{6};          ///< Groups of feature nodes; >= 1.
  int features_per_group{4};      ///< >= 1; groups x nodes at most BlsNet::kMaxNodes.
  int enhancements{60};           ///< >= 0, at most BlsNet::kMaxNodes.
  double ridge{0.1};              ///< [-] lambda of the ridge regression; > 0.
  double enhancement_scale{0.4};  ///< [-] standard deviation of the enhancement nodes' sums; > 0.
  /// [sectors] over which the weights of the smooth feature nodes are correlated; 0 = independent. The first
  /// half of the groups weighs each sector by itself, the other half neighbours alike, as a side is seen by
  /// neighbours together; enhancement nodes are maps of the smooth half.
  double feature_reach{2.0};
};

/// Trains a broad learning system and lets it grow without training anew. The output weights C solve
///   (A^T W A + lambda I) C = A^T W Y
/// with a row [1; z; h] of A, a target row of Y and a weight in W for each sample. Kept is the Cholesky
/// factor L of the matrix on the left: more nodes border it, more samples are rank-one updates of it (Golub,
/// Van Loan: Matrix Computations, 4th ed., sec. 4.2 and 6.5.4). That is the ridge form of the incremental
/// pseudo-inverse of Chen and Liu, and stays exact: nothing is dropped or approximated.
class BlsTrainer {
 public:
  /// Draws the nodes as a function of the seed, and trains. @throws ConfigError for options out of range.
  BlsTrainer(std::span<const LabelledScan> samples, const BlsOptions& options, std::uint64_t seed);

  /// Further random enhancement nodes: the same as if `options.enhancements` had been larger. The feature
  /// nodes are linear maps of eight inputs, so more than nine of them span nothing new: only enhancement
  /// nodes are added.
  void AddEnhancements(int count);
  void AddSamples(std::span<const LabelledScan> samples);

  const BlsNet& net() const { return net_; }
  std::span<const LabelledScan> samples() const { return samples_; }
  const BlsOptions& options() const { return options_; }

 private:
  /// Features from here on are smooth.
  int FirstSmoothFeature() const { return options_.feature_groups / 2 * options_.features_per_group; }
  void DrawFeatures();
  void DrawEnhancements(int first, int count);
  void Solve();

  std::vector<LabelledScan> samples_;
  BlsOptions options_;
  std::uint64_t seed_;
  BlsNet net_;
  Eigen::MatrixXd factor_;  // L, lower.
  Eigen::MatrixXd right_;   // A^T W Y.
};

/// A of the samples: a row [1; z; h] each, times the root of its weight.
Eigen::MatrixXd DesignMatrix(const BlsNet& net, std::span<const LabelledScan> samples);
/// Y of the samples, times the root of their weights.
Eigen::MatrixXd TargetMatrix(std::span<const LabelledScan> samples);

/// Output weights from scratch and by another way, a QR decomposition of [A; sqrt(lambda) I]: for comparison.
Eigen::MatrixXd RetrainedOutputWeights(const BlsNet& net, std::span<const LabelledScan> samples,
                                       double ridge);

/// Low-rank simplification. The feature nodes are replaced by their principal ones on the samples (singular
/// values above `tolerance` of the largest), and the enhancement nodes' weights are folded onto those. Of the
/// enhancement nodes, those whose part that the others do not span falls below `tolerance` of the largest are
/// dropped (QR with column pivoting, Golub, Van Loan sec. 5.5.7). The output weights are then solved anew.
BlsNet Simplify(const BlsNet& net, std::span<const LabelledScan> samples, double ridge, double tolerance);

}  // namespace lanewise
