#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "agents/sector_net/bls_net.h"
#include "agents/sector_net/samples.h"

namespace lanewise {

/// Feature nodes are of two kinds, in turn by group. Comparing ones weigh the sectors of the left side
/// against those of the right one, all of them about alike; local ones see one pair of sectors, the same on
/// both sides. A vehicle is the same on both sides: which one to take depends on how they differ, and whether
/// to turn on what stands where. An enhancement node sees one feature node of either kind.
struct BlsOptions {
  int feature_groups{8};          ///< Groups of feature nodes; >= 2.
  int features_per_group{4};      ///< >= 1; groups x nodes at most BlsNet::kMaxNodes.
  int enhancements{80};           ///< >= 0, at most BlsNet::kMaxNodes.
  double ridge{0.2};              ///< [-] lambda of the ridge regression; > 0.
  double enhancement_scale{1.4};  ///< [-] standard deviation of the enhancement nodes' sums; > 0.
  /// [sectors] over which the weights of a comparing node are correlated on a side; 0 = independent.
  double feature_reach{20.0};
  /// [-] standard deviation of the local node's weight in an enhancement node, against the comparing one's.
  double local_share{0.7};
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
  /// nodes are linear maps of eight inputs, so more than eight of them span nothing new: only enhancement
  /// nodes are added.
  void AddEnhancements(int count);
  void AddSamples(std::span<const LabelledScan> samples);

  const BlsNet& net() const { return net_; }
  std::span<const LabelledScan> samples() const { return samples_; }
  const BlsOptions& options() const { return options_; }

 private:
  /// Else it is a local one.
  bool ComparesSides(int feature) const { return feature / options_.features_per_group % 2 == 0; }
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
