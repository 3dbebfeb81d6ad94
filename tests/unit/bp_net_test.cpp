#include "agents/sector_net/bp_net.h"

#include <gtest/gtest.h>

#include <cmath>

#include "agents/sector_net/bp_training.h"
#include "tests/support/no_alloc.h"

namespace lanewise {
namespace {

std::vector<LabelledScan> TrainingSamples(std::uint64_t seed) {
  return SplitSamples(GeneratedSamples(), 130, 100, seed).training;
}

TEST(Activation, EqualsTheirClosedForms) {
  std::vector<double> sums = {-1e300, -800.0, 0.0, 1e-9, 800.0, 1e300};
  for (int k = -4000; k <= 4000; ++k) sums.push_back(0.0101 * k);
  for (const double n : sums) {
    Eigen::Array4d x = Eigen::Array4d::Constant(n);
    const Eigen::Array4d tansig = Tansig(x), logsig = Logsig(x);
    EXPECT_NEAR(tansig[2], std::tanh(n), 4e-16) << n;
    EXPECT_NEAR(logsig[2], 0.5 * (1.0 + std::tanh(0.5 * n)), 4e-16) << n;
  }
}

// Hidden unit 0 sees 2 x_0 - x_7 + 0.5 with x scaled to [-1, 1], output 1 sees 3 h_0 - 1; all else is 0.
TEST(BpNet, ForwardWorkedByHand) {
  BpNet net;
  net.parameters[BpNet::kHiddenWeights + 0] = 2.0;
  net.parameters[BpNet::kHiddenWeights + 7 * BpNet::kHidden] = -1.0;
  net.parameters[BpNet::kHiddenBiases] = 0.5;
  net.parameters[BpNet::kOutputWeights + BpNet::kHidden] = 3.0;
  net.parameters[BpNet::kOutputBiases + 1] = -1.0;
  SectorInputs sectors{};
  sectors[0] = 1.0;   // x_0 = 1.
  sectors[7] = 0.25;  // x_7 = -0.5: the sum is 2 + 0.5 + 0.5 = 3.
  const NetOutputs y = net.Forward(sectors);
  EXPECT_NEAR(y[0], 0.5, 1e-15);
  EXPECT_NEAR(y[1], 1.0 / (1.0 + std::exp(1.0 - 3.0 * std::tanh(3.0))), 1e-15);
  EXPECT_NEAR(y[2], 0.5, 1e-15);
}

// Every one of the 195 derivatives against the central difference, with samples of different weights.
TEST(BpNet, GradientEqualsDifferences) {
  std::vector<LabelledScan> samples = TrainingSamples(5);
  samples.resize(20);
  samples[3].weight = 4.0;
  samples[7].sectors[2] = 0.4;
  BpNet net = RandomBpNet(3);
  const BpNet::Parameters gradient = ErrorGradient(net, samples);
  ASSERT_GT(gradient.cwiseAbs().maxCoeff(), 1e-3);
  const double step = 1e-5;
  for (int i = 0; i < BpNet::kParameters; ++i) {
    const double at = net.parameters[i];
    net.parameters[i] = at + step;
    const double above = MeanSquaredError(net, samples);
    net.parameters[i] = at - step;
    const double below = MeanSquaredError(net, samples);
    net.parameters[i] = at;
    // The mean of E = 1/2 sum of three squared errors is 3/2 of the mean squared error.
    EXPECT_NEAR(gradient[i], 1.5 * (above - below) / (2.0 * step), 1e-10) << "parameter " << i;
  }
}

// One output weight by hand, Eq. (5): (Y - d) Y (1 - Y) Y_i.
TEST(BpNet, OutputWeightDerivativeIsThePapers) {
  const LabelledScan sample{InputsOfCode(0x5a), Avoidance::kRight};
  const BpNet net = RandomBpNet(9);
  BpNet::Layers layers;
  net.Forward(sample.sectors, &layers);
  const double y = layers.outputs[2];
  const int weight = BpNet::kOutputWeights + 2 * BpNet::kHidden + 4;  // From hidden unit 4 to output 2.
  EXPECT_NEAR(ErrorGradient(net, {&sample, 1})[weight], (y - 1.0) * y * (1.0 - y) * layers.hidden[4], 1e-16);
}

TEST(BpNet, InferenceTakesNoHeap) {
  const BpNet net = RandomBpNet(1);
  NetOutputs sum{};
  const AllocationCounter allocations;
  for (unsigned code = 0; code < 256; ++code)
    sum[0] += net.Forward(InputsOfCode(static_cast<std::uint8_t>(code)))[0];
  EXPECT_EQ(allocations.count(), 0);
  EXPECT_GT(sum[0], 0.0);
}

int Correct(const BpNet& net, std::span<const LabelledScan> samples) {
  int correct = 0;
  for (const LabelledScan& sample : samples) {
    const NetOutputs y = net.Forward(sample.sectors), d = TargetOf(sample.way);
    correct += std::round(y[0]) == d[0] && std::round(y[1]) == d[1] && std::round(y[2]) == d[2] ? 1 : 0;
  }
  return correct;
}

// [A]: error 0.001 within 50,000 epochs; of 100 held-out samples rounding gives the target in at least 99.
TEST(BpTraining, GradientDescentReachesThePapersGoal) {
  const SampleSplit split = SplitSamples(GeneratedSamples(), 130, 100, 1);
  ASSERT_EQ(CountSeen(split), 0u);
  BpNet net = RandomBpNet(1);
  BpTrainingOptions options;
  const BpTraining training = TrainByGradientDescent(split.training, options, 1, nullptr, &net);
  EXPECT_TRUE(training.reached);
  EXPECT_LE(MeanSquaredError(net, split.training), 0.001);
  EXPECT_GE(Correct(net, split.test), 99);
}

TEST(BpTraining, LevenbergMarquardtNeedsAHundredthOfTheEpochs) {
  const auto samples = TrainingSamples(1);
  BpTrainingOptions options;
  BpNet descended = RandomBpNet(1), marquardt = descended;
  const BpTraining slow = TrainByGradientDescent(samples, options, 1, nullptr, &descended);
  const BpTraining fast = TrainByLevenbergMarquardt(samples, options, nullptr, &marquardt);
  EXPECT_TRUE(slow.reached);
  EXPECT_TRUE(fast.reached);
  EXPECT_LE(MeanSquaredError(marquardt, samples), 0.001);
  EXPECT_NEAR(fast.error.back(), MeanSquaredError(marquardt, samples), 1e-12);
  EXPECT_LE(100 * fast.epochs(), slow.epochs());
}

TEST(BpTraining, SampleBySampleReachesTheGoalToo) {
  const auto samples = TrainingSamples(2);
  BpTrainingOptions options;
  options.sample_by_sample = true;
  BpNet net = RandomBpNet(2);
  const BpTraining training = TrainByGradientDescent(samples, options, 2, nullptr, &net);
  EXPECT_TRUE(training.reached);
  EXPECT_LT(training.epochs(), 1000);
}

// Two samples of one scan that went two ways: no network does better than half and half.
TEST(BpTraining, WeightsOfSamplesAreFrequencies) {
  std::vector<LabelledScan> samples{{InputsOfCode(0xff), Avoidance::kLeft, 3.0},
                                    {InputsOfCode(0xff), Avoidance::kRight, 1.0}};
  BpTrainingOptions options;
  options.max_epochs = 20000;
  options.goal = 0.0;
  BpNet net = RandomBpNet(2);
  EXPECT_FALSE(TrainByGradientDescent(samples, options, 2, nullptr, &net).reached);
  const NetOutputs y = net.Forward(samples[0].sectors);
  EXPECT_NEAR(y[0], 0.75, 1e-3);
  EXPECT_NEAR(y[2], 0.25, 1e-3);
}

}  // namespace
}  // namespace lanewise
