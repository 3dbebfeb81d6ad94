#include "agents/sector_net/weight_file.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "agents/core/check.h"
#include "agents/sector_net/bls_training.h"
#include "agents/sector_net/bp_training.h"
#include "tests/support/temporary_folder.h"

namespace lanewise {
namespace {

const TrainingRecord kRecord{"gradient descent", "my.csv", 130, 100, 7, 4321, 9.99e-4, 98, "0.1.0"};

class WeightFiles : public testing::Test {
 protected:
  template <class Load>
  void ExpectRefused(const std::string& text, Load load, const std::vector<std::string>& parts) {
    const auto file = folder_.Write("bad.json", text);
    try {
      load(file);
      FAIL() << "accepted";
    } catch (const ConfigError& error) {
      const std::string message = error.what();
      EXPECT_NE(message.find(file.string()), std::string::npos) << message;
      for (const std::string& part : parts)
        EXPECT_NE(message.find(part), std::string::npos) << "'" << part << "' is not in: " << message;
    }
  }
  static std::string Replaced(std::string text, const std::string& what, const std::string& by) {
    const auto at = text.find(what);
    EXPECT_NE(at, std::string::npos) << what;
    return text.replace(at, what.size(), by);
  }

  TemporaryFolder folder_;
};

constexpr auto kLoadBp = [](const std::filesystem::path& file) { LoadBpNet(file); };
constexpr auto kLoadBls = [](const std::filesystem::path& file) { LoadBlsNet(file); };

TEST_F(WeightFiles, BpReadsBackBitForBitWithItsProvenance) {
  BpNet net = RandomBpNet(4);
  net.scale = {-1.0, 3.0};
  SaveWeights(folder_ / "bp.json", net, kRecord);
  TrainingRecord record;
  const BpNet read = LoadBpNet(folder_ / "bp.json", &record);
  EXPECT_TRUE(read.parameters == net.parameters);
  EXPECT_EQ(read.scale.max, 3.0);
  EXPECT_EQ(record.method, "gradient descent");
  EXPECT_EQ(record.samples, "my.csv");
  EXPECT_EQ(record.seed, 7u);
  EXPECT_EQ(record.epochs, 4321);
  EXPECT_EQ(record.training_error, 9.99e-4);
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder_.path()), {}),
            1);  // No partial file is left.
}

TEST_F(WeightFiles, BlsReadsBackBitForBit) {
  const BlsNet net = BlsTrainer(GeneratedSamples(), {.enhancements = 11}, 3).net();
  SaveWeights(folder_ / "bls.json", net, kRecord);
  const BlsNet read = LoadBlsNet(folder_ / "bls.json");
  EXPECT_EQ(read.enhancements(), 11);
  EXPECT_TRUE(read.enhancement_weights == net.enhancement_weights);
  EXPECT_EQ(read.Forward(InputsOfCode(0x5c)), net.Forward(InputsOfCode(0x5c)));
}

TEST_F(WeightFiles, DamagedOrWrongOnesAreRefusedWithTheReason) {
  SaveWeights(folder_ / "bp.json", RandomBpNet(4), kRecord);
  const std::string good = ReadFile(folder_ / "bp.json");
  ExpectRefused(good, kLoadBls, {"kind is \"bp\"", "allowed: \"bls\""});
  ExpectRefused(Replaced(good, "4321", "4322"), kLoadBp, {"damaged", "checksum"});
  ExpectRefused(good.substr(0, good.size() / 2), kLoadBp, {"broken JSON", "line"});
  ExpectRefused(Replaced(good, "\"checksum\"", "\"sum\""), kLoadBp, {"damaged"});
  ExpectRefused("{}", kLoadBp, {"no weight file"});
  ExpectRefused("[1, 2]", kLoadBp, {"no weight file"});
  ExpectRefused("{\"format\": 3}", kLoadBp, {"no weight file"});
  ExpectRefused(Replaced(good, "\"version\": 1", "\"version\": 9"), kLoadBp, {"version is 9", "allowed: 1"});
  EXPECT_THROW(LoadBpNet("/no/such.json"), ConfigError);
  EXPECT_THROW(LoadBpNet(folder_.path()), ConfigError);
  EXPECT_THROW(SaveWeights("/proc/bp.json", RandomBpNet(4), kRecord), ConfigError);
}

// The content is consistent with its checksum, yet no network: written by a program that is wrong.
TEST_F(WeightFiles, NumbersThatAreNoneAreRefused) {
  BpNet net = RandomBpNet(4);
  net.parameters[BpNet::kHiddenBiases + 2] = std::nan("");
  SaveWeights(folder_ / "nan.json", net, kRecord);
  ExpectRefused(ReadFile(folder_ / "nan.json"), kLoadBp, {"weights.hidden_biases", "null"});
  BlsNet bls = BlsTrainer(GeneratedSamples(), {.enhancements = 4}, 3).net();
  bls.output_weights.conservativeResize(5, Eigen::NoChange);
  SaveWeights(folder_ / "shape.json", bls, kRecord);
  ExpectRefused(ReadFile(folder_ / "shape.json"), kLoadBls, {"weights.output_weights has 15 numbers", "111"});
}

TEST(DefaultWeights, FollowTheLabellingRule) {
  int bp = 0, bls = 0;
  for (const LabelledScan& sample : GeneratedSamples()) {
    bp += WayOf(DefaultBpNet().Forward(sample.sectors)) == sample.way ? 1 : 0;
    bls += WayOf(DefaultBlsNet().Forward(sample.sectors)) == sample.way ? 1 : 0;
  }
  EXPECT_GE(bp, 253);
  EXPECT_GE(bls, 253);
}

}  // namespace
}  // namespace lanewise
