#include "agents/sector_net/bls_training.h"

#include <fmt/core.h>

#include <Eigen/Dense>
#include <cmath>

#include "agents/core/check.h"
#include "agents/core/random.h"

namespace lanewise {
namespace {

constexpr double kNoCutOff = 10.0;
constexpr int kSide = kNetInputs / 2;

/// Of the sectors of one side, from the middle outwards.
using SideVector = Eigen::Matrix<double, kSide, 1>;
using SideMatrix = Eigen::Matrix<double, kSide, kSide>;

/// L with L L^T the correlation exp(-(i - j)^2 / (2 reach^2)) between the weights of sectors i and j.
SideMatrix SmoothingFactor(double reach) {
  SideMatrix correlation = SideMatrix::Identity();
  for (int i = 0; reach > 0.0 && i < kSide; ++i) {
    for (int j = 0; j < kSide; ++j) correlation(i, j) = std::exp(-0.5 * (i - j) * (i - j) / (reach * reach));
  }
  correlation.diagonal().array() += 1e-6;  // Positive definite in spite of rounding.
  return correlation.llt().matrixL();
}

/// L L^T becomes L L^T + x x^T (Golub, Van Loan sec. 6.5.4).
void RankOneUpdate(Eigen::VectorXd x, Eigen::MatrixXd* factor) {
  const Eigen::Index size = factor->rows();
  for (Eigen::Index k = 0; k < size; ++k) {
    const double diagonal = (*factor)(k, k), root = std::hypot(diagonal, x[k]);
    const double c = root / diagonal, s = x[k] / diagonal;
    (*factor)(k, k) = root;
    const Eigen::Index below = size - k - 1;
    auto column = factor->col(k).tail(below);
    column = (column + s * x.tail(below)) / c;
    x.tail(below) = c * x.tail(below) - s * column;
  }
}

void CheckOption(const char* name, double value, double min, double max) {
  if (!(value >= min && value <= max))
    throw ConfigError(fmt::format("{} is {}; allowed: {} to {}", name, value, min, max));
}

Eigen::MatrixXd Ridge(Eigen::Index size, double ridge) {
  return ridge * Eigen::MatrixXd::Identity(size, size);
}

}  // namespace

Eigen::MatrixXd DesignMatrix(const BlsNet& net, std::span<const LabelledScan> samples) {
  Eigen::MatrixXd a(static_cast<Eigen::Index>(samples.size()), net.nodes());
  BlsNet::Nodes feature, enhancement;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    net.Expand(samples[i].sectors, &feature, &enhancement);
    auto row = a.row(static_cast<Eigen::Index>(i));
    row[0] = 1.0;
    row.segment(1, net.features()) = feature.matrix().transpose();
    row.tail(net.enhancements()) = enhancement.matrix().transpose();
    row *= std::sqrt(samples[i].weight);
  }
  return a;
}

Eigen::MatrixXd TargetMatrix(std::span<const LabelledScan> samples) {
  Eigen::MatrixXd y(static_cast<Eigen::Index>(samples.size()), kNetOutputs);
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const NetOutputs target = TargetOf(samples[i].way);
    y.row(static_cast<Eigen::Index>(i)) =
        std::sqrt(samples[i].weight) * Eigen::Map<const Eigen::RowVector3d>(target.data());
  }
  return y;
}

BlsTrainer::BlsTrainer(std::span<const LabelledScan> samples, const BlsOptions& options, std::uint64_t seed)
    : samples_(MergeEqual({samples.begin(), samples.end()})), options_(options), seed_(seed) {
  CheckOption("feature groups", options.feature_groups, 2, BlsNet::kMaxNodes);
  CheckOption("feature nodes", double{1} * options.feature_groups * options.features_per_group, 1,
              BlsNet::kMaxNodes);
  CheckOption("enhancement nodes", options.enhancements, 0, BlsNet::kMaxNodes);
  CheckOption("ridge", options.ridge, 1e-12, 1e6);
  CheckOption("enhancement scale", options.enhancement_scale, 1e-6, 100.0);
  CheckOption("feature reach", options.feature_reach, 0.0, 100.0);
  CheckOption("local share", options.local_share, 1e-3, 100.0);
  DrawFeatures();
  DrawEnhancements(0, options.enhancements);
  const Eigen::MatrixXd a = DesignMatrix(net_, samples_);
  Eigen::MatrixXd normal = Ridge(a.cols(), options_.ridge);
  normal.selfadjointView<Eigen::Lower>().rankUpdate(a.transpose());
  factor_ = normal.llt().matrixL();
  right_ = a.transpose() * TargetMatrix(samples_);
  Solve();
}

void BlsTrainer::DrawFeatures() {
  const int nodes = options_.feature_groups * options_.features_per_group;
  net_.feature_weights.resize(nodes, kNetInputs);
  net_.feature_biases.setZero(nodes);  // The constant node makes up for them.
  const SideMatrix smooth = SmoothingFactor(options_.feature_reach);
  for (int node = 0; node < nodes; ++node) {
    const RandomStream random(seed_, static_cast<std::uint64_t>(node), RandomPurpose::kRandomNodes, 0);
    const bool compares = ComparesSides(node);
    SideVector side = SideVector::Unit(node % kSide);
    if (compares) {
      for (int i = 0; i < kSide; ++i) side[i] = random.Normal(static_cast<std::uint64_t>(i), kNoCutOff);
      side = (smooth * side).eval();
    }
    side /= std::sqrt(2.0) * side.norm();  // Inputs are +-1: the sum over both sides has variance 1.
    for (int i = 0; i < kSide; ++i) {
      net_.feature_weights(node, kSide - 1 - i) = side[i];
      net_.feature_weights(node, kSide + i) = compares ? -side[i] : side[i];
    }
  }
}

void BlsTrainer::DrawEnhancements(int first, int count) {
  const int features = net_.features();
  net_.enhancement_weights.conservativeResize(first + count, features);
  net_.enhancement_biases.conservativeResize(first + count);
  std::vector<int> comparing, local;
  for (int j = 0; j < features; ++j) (ComparesSides(j) ? comparing : local).push_back(j);
  const auto any_of = [](const std::vector<int>& nodes, double uniform) {
    return nodes[static_cast<std::size_t>(uniform * static_cast<double>(nodes.size()))];
  };
  for (int node = first; node < first + count; ++node) {
    const RandomStream random(seed_, static_cast<std::uint64_t>(node), RandomPurpose::kRandomNodes, 1);
    Eigen::RowVectorXd weights = Eigen::RowVectorXd::Zero(features);
    weights[any_of(comparing, random.Uniform(0))] = random.Normal(1, kNoCutOff);
    weights[any_of(local, random.Uniform(2))] = options_.local_share * random.Normal(3, kNoCutOff);
    // Inputs are +-1: the sum over them then has the standard deviation that is asked for.
    const double scale = options_.enhancement_scale / (weights * net_.feature_weights).norm();
    net_.enhancement_weights.row(node) = scale * weights;
    net_.enhancement_biases[node] = options_.enhancement_scale * random.Normal(4, kNoCutOff);
  }
}

void BlsTrainer::AddEnhancements(int count) {
  CheckOption("enhancement nodes", double{1} * net_.enhancements() + count, net_.enhancements(),
              BlsNet::kMaxNodes);
  const Eigen::Index old = net_.nodes();
  DrawEnhancements(net_.enhancements(), count);
  options_.enhancements += count;
  const Eigen::MatrixXd a = DesignMatrix(net_, samples_);
  const auto before = a.leftCols(old), added = a.rightCols(count);
  // [L 0; M N] with M = (L^-1 K12)^T and N N^T = K22 - M M^T.
  const Eigen::MatrixXd cross =
      factor_.triangularView<Eigen::Lower>().solve(before.transpose() * added).transpose();
  const Eigen::MatrixXd rest =
      added.transpose() * added + Ridge(count, options_.ridge) - cross * cross.transpose();
  factor_.conservativeResizeLike(Eigen::MatrixXd::Zero(old + count, old + count));
  factor_.bottomLeftCorner(count, old) = cross;
  factor_.bottomRightCorner(count, count) = rest.llt().matrixL();
  right_.conservativeResize(old + count, Eigen::NoChange);
  right_.bottomRows(count) = added.transpose() * TargetMatrix(samples_);
  Solve();
}

void BlsTrainer::AddSamples(std::span<const LabelledScan> samples) {
  const std::vector<LabelledScan> merged = MergeEqual({samples.begin(), samples.end()});
  const Eigen::MatrixXd a = DesignMatrix(net_, merged);
  for (Eigen::Index row = 0; row < a.rows(); ++row) RankOneUpdate(a.row(row).transpose(), &factor_);
  right_ += a.transpose() * TargetMatrix(merged);
  samples_.insert(samples_.end(), merged.begin(), merged.end());
  Solve();
}

void BlsTrainer::Solve() {
  const Eigen::MatrixXd half = factor_.triangularView<Eigen::Lower>().solve(right_);
  net_.output_weights = factor_.transpose().triangularView<Eigen::Upper>().solve(half);
}

Eigen::MatrixXd RetrainedOutputWeights(const BlsNet& net, std::span<const LabelledScan> samples,
                                       double ridge) {
  const Eigen::MatrixXd a = DesignMatrix(net, samples);
  Eigen::MatrixXd stacked(a.rows() + a.cols(), a.cols());
  stacked << a, Ridge(a.cols(), std::sqrt(ridge));
  Eigen::MatrixXd right = Eigen::MatrixXd::Zero(stacked.rows(), kNetOutputs);
  right.topRows(a.rows()) = TargetMatrix(samples);
  return stacked.householderQr().solve(right);
}

BlsNet Simplify(const BlsNet& net, std::span<const LabelledScan> samples, double ridge, double tolerance) {
  CheckOption("simplification tolerance", tolerance, 0.0, 1.0);
  BlsNet simple = net;
  const Eigen::MatrixXd a = DesignMatrix(net, samples);
  // Jacobi's way: by BDCSVD equal feature nodes come out with a singular value far from zero.
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(a.middleCols(1, net.features()), Eigen::ComputeThinV);
  const auto& singular = svd.singularValues();
  Eigen::Index rank = 1;
  // Rounding leaves values of about 1e-16 of the largest where there is no rank.
  while (rank < singular.size() && singular[rank] > std::fmax(tolerance, 1e-12) * singular[0]) ++rank;
  const Eigen::MatrixXd principal = svd.matrixV().leftCols(rank);
  simple.feature_weights = principal.transpose() * net.feature_weights;
  simple.feature_biases = principal.transpose() * net.feature_biases;
  const Eigen::MatrixXd folded = net.enhancement_weights * principal;

  const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(a.rightCols(net.enhancements()));
  const Eigen::Index most = std::min(a.rows(), Eigen::Index{net.enhancements()});
  Eigen::Index kept = 0;
  while (kept < most && std::abs(qr.matrixR()(kept, kept)) > tolerance * qr.maxPivot()) ++kept;
  simple.enhancement_weights.resize(kept, rank);
  simple.enhancement_biases.resize(kept);
  for (Eigen::Index k = 0; k < kept; ++k) {
    const Eigen::Index node = qr.colsPermutation().indices()[k];
    simple.enhancement_weights.row(k) = folded.row(node);
    simple.enhancement_biases[k] = net.enhancement_biases[node];
  }
  simple.output_weights = RetrainedOutputWeights(simple, samples, ridge);
  return simple;
}

}  // namespace lanewise
