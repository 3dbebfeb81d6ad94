#include "agents/sector_net/bls_net.h"

#include <gtest/gtest.h>

#include <cmath>
#include <span>

#include "agents/core/check.h"
#include "agents/sector_net/bls_training.h"
#include "agents/sector_net/bp_training.h"
#include "agents/sector_net/net_score.h"
#include "tests/support/no_alloc.h"

namespace lanewise {
namespace {

double LargestDifference(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
  return (a - b).cwiseAbs().maxCoeff();
}

// z = 2 x_0 + 1, h = tansig(0.5 z - 1), y_1 = 0.25 + 3 z - 2 h, with x_0 = 2 * 0.75 - 1 = 0.5: z = 2, h = 0.
TEST(BlsNet, ForwardWorkedByHand) {
  BlsNet net;
  net.feature_weights = Eigen::MatrixXd::Zero(1, 8);
  net.feature_weights(0, 0) = 2.0;
  net.feature_biases = Eigen::VectorXd::Constant(1, 1.0);
  net.enhancement_weights = Eigen::MatrixXd::Constant(1, 1, 0.5);
  net.enhancement_biases = Eigen::VectorXd::Constant(1, -0.5);
  net.output_weights = Eigen::MatrixXd::Zero(3, 3);
  net.output_weights.col(1) << 0.25, 3.0, -2.0;
  const NetOutputs y = net.Forward({0.75, 0, 0, 0, 0, 0, 0, 0});
  EXPECT_EQ(y[0], 0.0);
  EXPECT_NEAR(y[1], 0.25 + 3.0 * 2.0 - 2.0 * std::tanh(0.5 * 2.0 - 0.5), 1e-14);
}

TEST(BlsNet, InferenceTakesNoHeap) {
  const BlsNet net = BlsTrainer(GeneratedSamples(), {}, 1).net();
  double sum = 0.0;
  const AllocationCounter allocations;
  for (unsigned code = 0; code < 256; ++code)
    sum += net.Forward(InputsOfCode(static_cast<std::uint8_t>(code)))[0];
  EXPECT_EQ(allocations.count(), 0);
  EXPECT_NE(sum, 0.0);
}

TEST(BlsTraining, EqualsALeastSquaresSolutionByQr) {
  const BlsTrainer trainer(GeneratedSamples(), {}, 2);
  EXPECT_LE(
      LargestDifference(trainer.net().output_weights,
                        RetrainedOutputWeights(trainer.net(), trainer.samples(), trainer.options().ridge)),
      1e-8);
}

// Grown in any order, by nodes and by samples, it has the weights of one trained at once.
TEST(BlsTraining, IncrementalEqualsRetrained) {
  const auto all = GeneratedSamples();
  const std::span<const LabelledScan> samples(all);
  const BlsOptions whole{.enhancements = 60};
  const BlsTrainer retrained(samples, whole, 3);
  BlsTrainer grown(samples.first(100), {.enhancements = 20}, 3);
  grown.AddEnhancements(25);
  grown.AddSamples(samples.subspan(100, 60));
  grown.AddEnhancements(15);
  grown.AddSamples(samples.subspan(160));
  EXPECT_TRUE(grown.net().enhancement_weights == retrained.net().enhancement_weights);
  EXPECT_LE(LargestDifference(grown.net().output_weights, retrained.net().output_weights), 1e-8);
  EXPECT_LE(LargestDifference(grown.net().output_weights,
                              RetrainedOutputWeights(grown.net(), samples, whole.ridge)),
            1e-8);
}

TEST(BlsTraining, EqualSamplesCountByTheirNumber) {
  auto samples = GeneratedSamples();
  samples.resize(50);
  auto twice = samples;
  twice.insert(twice.end(), samples.begin(), samples.end());
  for (LabelledScan& sample : samples) sample.weight = 2.0;
  EXPECT_LE(LargestDifference(BlsTrainer(samples, {}, 1).net().output_weights,
                              BlsTrainer(twice, {}, 1).net().output_weights),
            1e-9);
}

// Half of the feature nodes change their sign in the mirror, the others are the same.
TEST(BlsTraining, FeatureNodesCompareTheSidesOrSeeBothAlike) {
  const BlsNet net = BlsTrainer(GeneratedSamples(), {}, 5).net();
  const Eigen::MatrixXd mirrored = net.feature_weights.rowwise().reverse();
  int comparing = 0, local = 0;
  for (int node = 0; node < net.features(); ++node) {
    const auto weights = net.feature_weights.row(node), mirror = mirrored.row(node);
    EXPECT_NEAR(weights.norm(), 1.0, 1e-12);
    if (weights == -mirror) ++comparing;
    if (weights == mirror) {
      ++local;
      EXPECT_EQ((weights.array() != 0.0).count(), 2);
    }
  }
  EXPECT_EQ(comparing, net.features() / 2);
  EXPECT_EQ(local, net.features() / 2);
}

// On the experiment of [A], held-out samples of ten splits that no option was chosen by.
TEST(BlsTraining, IsNoLessAccurateThanBackPropagation) {
  double bp_right = 0.0, bls_right = 0.0;
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    const SampleSplit split = SplitSamples(GeneratedSamples(), 130, 100, seed);
    BpNet bp = RandomBpNet(seed);
    TrainByGradientDescent(split.training, {}, seed, {}, &bp);
    bp_right += ScoreNet(bp, split.test).rounded;
    bls_right += ScoreNet(BlsTrainer(split.training, {}, seed).net(), split.test).rounded;
  }
  EXPECT_GE(bls_right, bp_right);
  EXPECT_GE(bls_right, 990.0);
}

// Linear maps of eight inputs have rank eight: exact.
TEST(BlsTraining, SimplifyingTheFeatureNodesLosesNothing) {
  const BlsTrainer trainer(GeneratedSamples(), {}, 4);
  const BlsNet simple = Simplify(trainer.net(), trainer.samples(), trainer.options().ridge, 0.0);
  EXPECT_EQ(simple.features(), 8);
  EXPECT_EQ(simple.enhancements(), trainer.net().enhancements());
  for (const LabelledScan& sample : trainer.samples()) {
    const NetOutputs a = trainer.net().Forward(sample.sectors), b = simple.Forward(sample.sectors);
    for (int k = 0; k < kNetOutputs; ++k) EXPECT_NEAR(a[k], b[k], 1e-8);
  }
}

TEST(BlsTraining, SimplifyingDropsNodesThatOthersSpan) {
  const BlsTrainer trainer(GeneratedSamples(), {.enhancements = 100}, 4);
  const BlsNet simple = Simplify(trainer.net(), trainer.samples(), trainer.options().ridge, 0.05);
  EXPECT_LT(simple.enhancements(), 80);
  EXPECT_GT(simple.enhancements(), 10);
}

TEST(BlsTraining, OptionsOutOfRangeAreRefused) {
  const auto samples = GeneratedSamples();
  EXPECT_THROW(BlsTrainer(samples, {.ridge = 0.0}, 1), ConfigError);
  EXPECT_THROW(BlsTrainer(samples, {.enhancements = -1}, 1), ConfigError);
  EXPECT_THROW(BlsTrainer(samples, {.feature_groups = 1}, 1), ConfigError);
  EXPECT_THROW(BlsTrainer(samples, {.local_share = 0.0}, 1), ConfigError);
  BlsTrainer trainer(samples, {}, 1);
  EXPECT_THROW(trainer.AddEnhancements(BlsNet::kMaxNodes), ConfigError);
}

}  // namespace
}  // namespace lanewise
