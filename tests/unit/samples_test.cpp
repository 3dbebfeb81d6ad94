#include "agents/sector_net/samples.h"

#include <gtest/gtest.h>

#include <set>

#include "agents/core/check.h"
#include "tests/support/temporary_folder.h"

namespace lanewise {
namespace {

const std::string kHeader =
    "sector_0_free,sector_1_free,sector_2_free,sector_3_free,sector_4_free,sector_5_free,sector_6_free,"
    "sector_7_free,left,forward,right\n";

void ExpectRefused(const std::string& text, const std::vector<std::string>& parts) {
  try {
    ParseSamples(text, "my.csv");
    FAIL() << "accepted: " << text;
  } catch (const ConfigError& error) {
    const std::string message = error.what();
    for (const std::string& part : parts)
      EXPECT_NE(message.find(part), std::string::npos) << part << " in " << message;
  }
}

TEST(Samples, WrittenOnesReadBack) {
  const TemporaryFolder folder;
  {
    SampleWriter writer(folder / "samples.csv");
    writer.Add(1.5, "car,7", InputsOfCode(0xa3), Avoidance::kRight);
    writer.Add(1.6, "bus", {0.25, 0, 0, 0, 0, 0, 0, 1}, Avoidance::kForward);
    EXPECT_EQ(writer.count(), 2);
  }
  const auto samples = LoadSamples(folder / "samples.csv");
  ASSERT_EQ(samples.size(), 2u);
  EXPECT_EQ(samples[0].sectors, InputsOfCode(0xa3));
  EXPECT_EQ(samples[0].way, Avoidance::kRight);
  EXPECT_EQ(samples[1].sectors[0], 0.25);
  EXPECT_EQ(samples[1].way, Avoidance::kForward);
}

TEST(Samples, ColumnsInAnyOrderWithComments) {
  const auto samples = ParseSamples(
      "# recorded\nright,forward,left,sector_7_free,sector_6_free,sector_5_free,sector_4_free,sector_3_free,"
      "sector_2_free,sector_1_free,sector_0_free\r\n\n0,0,1,1,0,0,0,0,0,0,0.5\r\n",
      "my.csv");
  ASSERT_EQ(samples.size(), 1u);
  EXPECT_EQ(samples[0].way, Avoidance::kLeft);
  EXPECT_EQ(samples[0].sectors[7], 1.0);
  EXPECT_EQ(samples[0].sectors[0], 0.5);
}

TEST(Samples, BadOnesAreRefusedWithLineAndReason) {
  ExpectRefused("", {"my.csv", "no samples"});
  ExpectRefused(kHeader, {"my.csv", "no samples"});
  ExpectRefused("sector_0_free,left\n", {"line 1", "'sector_1_free' is missing"});
  ExpectRefused("speed," + kHeader, {"line 1", "'speed'", "allowed: sector_0_free"});
  ExpectRefused("left," + kHeader, {"line 1", "'left' appears twice"});
  ExpectRefused("# c\n" + kHeader + "1,1,1,1,1,1,1,1,0,1,0\n1,1,1\n", {"line 4", "3 values", "11 columns"});
  ExpectRefused(kHeader + "1,1,1,nan,1,1,1,1,0,1,0\n", {"line 2", "sector_3_free", "'nan'", "0 to 1"});
  ExpectRefused(kHeader + "1,1,1,,1,1,1,1,0,1,0\n", {"line 2", "sector_3_free", "''"});
  ExpectRefused(kHeader + "1,1,1,2,1,1,1,1,0,1,0\n", {"line 2", "sector_3_free", "'2'"});
  ExpectRefused(kHeader + "1,1,1,1x,1,1,1,1,0,1,0\n", {"line 2", "'1x'"});
  ExpectRefused(kHeader + "1,1,1,1,1,1,1,1,0,1,1\n",
                {"line 2", "left, forward, right is 0 1 1", "unit vector"});
  ExpectRefused(kHeader + "1,1,1,1,1,1,1,1,0,0,0\n", {"line 2", "unit vector"});
  ExpectRefused(kHeader + "1,1,1,1,1,1,1,1,0,0.5,0.5\n", {"line 2", "unit vector"});
  EXPECT_THROW(LoadSamples("/no/such.csv"), ConfigError);
  EXPECT_THROW(SplitSamples(GeneratedSamples(), 200, 56, 1), ConfigError);  // There are 255.
}

// Bits are sectors from the left: 0x0f is the left half.
TEST(Samples, LabellingRule) {
  EXPECT_EQ(WayByRule(0xff), Avoidance::kForward);
  EXPECT_EQ(WayByRule(0x18), Avoidance::kForward);
  EXPECT_EQ(WayByRule(0x07), Avoidance::kLeft);
  EXPECT_EQ(WayByRule(0xe0), Avoidance::kRight);
  EXPECT_EQ(WayByRule(0xe7), Avoidance::kLeft);  // Three on either side.
  EXPECT_EQ(WayByRule(0x80), Avoidance::kRight);
  EXPECT_EQ(WayByRule(0x73), Avoidance::kRight);  // Two to the left, three to the right.
}

TEST(Samples, GeneratedOnesAreAllCodesButTheOneWithoutAWay) {
  const auto samples = GeneratedSamples();
  std::set<SectorInputs> codes;
  for (const LabelledScan& sample : samples) codes.insert(sample.sectors);
  EXPECT_EQ(samples.size(), 255u);
  EXPECT_EQ(codes.size(), 255u);
  EXPECT_FALSE(codes.contains(SectorInputs{}));
}

TEST(Samples, SplitsAreDisjointAndDrawnBySeed) {
  const SampleSplit one = SplitSamples(GeneratedSamples(), 130, 100, 1);
  const SampleSplit same = SplitSamples(GeneratedSamples(), 130, 100, 1);
  const SampleSplit other = SplitSamples(GeneratedSamples(), 130, 100, 2);
  EXPECT_EQ(one.training.size(), 130u);
  EXPECT_EQ(one.test.size(), 100u);
  EXPECT_EQ(CountSeen(one), 0u);
  int differing = 0;
  for (std::size_t i = 0; i < 130; ++i) {
    EXPECT_EQ(one.training[i].sectors, same.training[i].sectors);
    differing += one.training[i].sectors != other.training[i].sectors ? 1 : 0;
  }
  EXPECT_GT(differing, 100);
}

TEST(Samples, EqualOnesMerge) {
  const LabelledScan a{InputsOfCode(7), Avoidance::kLeft}, b{InputsOfCode(7), Avoidance::kRight};
  const auto merged = MergeEqual({a, b, a, a});
  ASSERT_EQ(merged.size(), 2u);
  EXPECT_EQ(merged[0].weight, 3.0);
  EXPECT_EQ(merged[1].weight, 1.0);
  EXPECT_EQ(CountSeen({{a}, {b, {InputsOfCode(8), Avoidance::kLeft}}}), 1u);
}

// Left 1, forward 3 + 5, right none: each of the two ways gets half of the 9.
TEST(Samples, BalancedWaysCountTheSame) {
  std::vector<LabelledScan> samples{{InputsOfCode(1), Avoidance::kLeft, 1.0},
                                    {InputsOfCode(2), Avoidance::kForward, 3.0},
                                    {InputsOfCode(3), Avoidance::kForward, 5.0}};
  BalanceWays(&samples);
  EXPECT_NEAR(samples[0].weight, 4.5, 1e-12);
  EXPECT_NEAR(samples[1].weight, 4.5 * 3.0 / 8.0, 1e-12);
  EXPECT_NEAR(samples[2].weight, 4.5 * 5.0 / 8.0, 1e-12);
}

}  // namespace
}  // namespace lanewise
