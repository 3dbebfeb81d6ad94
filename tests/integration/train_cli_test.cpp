// `lanewise train` as a user runs it.

#include <gtest/gtest.h>

#include "tests/support/child_process.h"

namespace lanewise {
namespace {

namespace fs = std::filesystem;

#define EXPECT_CONTAINS(text, part) EXPECT_NE(std::string(text).find(part), std::string::npos) << text

constexpr const char* kHeader =
    "sector_0_free,sector_1_free,sector_2_free,sector_3_free,sector_4_free,sector_5_free,sector_6_free,"
    "sector_7_free,left,forward,right\n";

/// Value behind the last `label` in a text.
double NumberAfter(const std::string& text, const std::string& label) {
  const auto at = text.rfind(label);
  return at == std::string::npos ? -1.0 : std::stod(text.substr(at + label.size()));
}

TEST(TrainCli, BpRepeatsThePapersExperiment) {
  const TemporaryFolder folder;
  const fs::path weights = folder / "bp.json", errors = folder / "error.csv";
  ChildProcess child({"train", "bp", "-o", weights.string(), "--error-csv", errors.string()});
  EXPECT_EQ(child.Wait(), 0) << child.Errors();
  const std::string out = child.Output();
  EXPECT_CONTAINS(out, "130 training and 100 test samples of 255 (generated), seed 1; 0 of the test");
  EXPECT_CONTAINS(out, "Table 1 of [A]");
  EXPECT_CONTAINS(out, "goal 0.001 reached");
  EXPECT_GE(NumberAfter(out, "rounding gives the target in "), 99.0);
  EXPECT_CONTAINS(ReadFile(weights), "\"checksum\"");
  EXPECT_EQ(ReadFile(errors).substr(0, 25), "epoch,mean_squared_error\n");

  // The same again is the same file; one that exists is kept.
  const fs::path again = folder / "again.json";
  EXPECT_EQ(ChildProcess({"train", "bp", "-o", again.string()}).Wait(), 0);
  EXPECT_EQ(ReadFile(again), ReadFile(weights));
  ChildProcess refused({"train", "bp", "-o", weights.string(), "--seed", "2"});
  EXPECT_EQ(refused.Wait(), 2);
  EXPECT_CONTAINS(refused.Errors(), "it exists; --force replaces it");
  EXPECT_EQ(ReadFile(again), ReadFile(weights));
}

TEST(TrainCli, LevenbergMarquardtNeedsFewEpochs) {
  ChildProcess child({"train", "bp", "--method", "lm", "--rows", "0"});
  EXPECT_EQ(child.Wait(), 0) << child.Errors();
  EXPECT_CONTAINS(child.Output(), "Levenberg-Marquardt: goal 0.001 reached");
  EXPECT_LE(NumberAfter(child.Output(), "reached after "), 40.0);
}

TEST(TrainCli, AMissedGoalIsExitCodeOneAndTheWeightsAreKept) {
  const TemporaryFolder folder;
  const fs::path weights = folder / "bp.json";
  ChildProcess child({"train", "bp", "--epochs", "5", "-o", weights.string()});
  EXPECT_EQ(child.Wait(), 1);
  EXPECT_CONTAINS(child.Output(), "goal 0.001 not reached after 5 epochs");
  EXPECT_TRUE(fs::exists(weights));
}

TEST(TrainCli, BlsGrowsAndIsComparedWithBp) {
  ChildProcess child({"train", "bls", "--grow", "2", "--against-bp", "--simplify", "0.001"});
  EXPECT_EQ(child.Wait(), 0) << child.Errors();
  EXPECT_CONTAINS(child.Output(), "Grown without training anew");
  EXPECT_LE(NumberAfter(child.Output(), "against a QR decomposition of all samples: "), 1e-8);
  EXPECT_CONTAINS(child.Output(), "simplified to");
  EXPECT_CONTAINS(child.Output(), "times as fast");
}

TEST(TrainCli, DrawsThePlot) {
  if (std::system("command -v gnuplot >/dev/null") != 0) GTEST_SKIP() << "no gnuplot";
  const TemporaryFolder folder;
  const fs::path plot = folder / "error.svg";
  ChildProcess child({"train", "bp", "--method", "lm", "--plot", plot.string()});
  EXPECT_EQ(child.Wait(), 0) << child.Errors();
  EXPECT_CONTAINS(ReadFile(plot), "mean squared error");
  EXPECT_CONTAINS(ReadFile(plot), "</svg>");
}

struct BadCase {
  const char* name;
  std::string samples;  // Content of the file.
  std::vector<std::string> more;
  const char* message;
};

class BadTraining : public testing::TestWithParam<BadCase> {};

TEST_P(BadTraining, IsRefusedWithLineAndReason) {
  const TemporaryFolder folder;
  const fs::path weights = folder.Write("bp.json", "kept");
  const fs::path samples = folder.Write("samples.csv", GetParam().samples);
  for (const char* kind : {"bp", "bls"}) {
    std::vector<std::string> words{"train",   kind, "--samples",     samples.string(),
                                   "--force", "-o", weights.string()};
    words.insert(words.end(), GetParam().more.begin(), GetParam().more.end());
    ChildProcess child(words);
    EXPECT_EQ(child.Wait(), 2) << child.Output();
    EXPECT_CONTAINS(child.Errors(), GetParam().message);
    EXPECT_CONTAINS(child.Errors(), "samples.csv");
    EXPECT_EQ(ReadFile(weights), "kept");
  }
}

const std::string kRows = std::string(kHeader) + "1,1,1,1,1,1,1,1,0,1,0\n";

INSTANTIATE_TEST_SUITE_P(
    Files, BadTraining,
    testing::Values(
        BadCase{"WrongColumn", "a,b\n1,2\n", {}, "line 1: unknown column 'a'"},
        BadCase{
            "MissingColumn", "sector_0_free,left\n1,1\n", {}, "line 1: column 'sector_1_free' is missing"},
        BadCase{
            "NoUnitVector", kRows + "1,1,1,0,1,1,1,1,1,1,0\n", {}, "line 3: left, forward, right is 1 1 0"},
        BadCase{"NotANumber", kRows + "nan,1,1,0,1,1,1,1,0,1,0\n", {}, "line 3: sector_0_free is 'nan'"},
        BadCase{"Short", kRows + "1,1\n", {}, "line 3: 2 values; the header names 11 columns"},
        BadCase{"Empty", kHeader, {}, "no samples"}, BadCase{"OnlyOne", kRows, {}, "none are left to test"},
        BadCase{"TooFew",
                kRows + kRows.substr(std::string(kHeader).size()),
                {"--training", "5", "--test", "3"},
                "2 samples; needed: 5 to train and 3 to test"}),
    [](const auto& info) { return info.param.name; });

TEST(TrainCli, OptionsOutOfRangeAreRefused) {
  const std::vector<std::pair<std::vector<std::string>, std::string>> cases{
      {{"bp", "--method", "adam"}, "--method: unknown value 'adam'; allowed: gd, lm"},
      {{"bp", "--rate", "-1"}, "--rate"},
      {{"bp", "--plot", "/tmp/error.jpg"}, "plots are written as .svg, .png or .pdf"},
      {{"bp", "-o", "/nowhere/bp.json"}, "its folder does not exist"},
      {{"bp", "--samples", "/nowhere.csv"}, "/nowhere.csv: no such file"},
      {{"bls", "--ridge", "0"}, "ridge is 0"},
      {{"bls", "--simplify", "2"}, "--simplify"}};
  for (const auto& [words, message] : cases) {
    std::vector<std::string> arguments{"train"};
    arguments.insert(arguments.end(), words.begin(), words.end());
    ChildProcess child(arguments);
    EXPECT_EQ(child.Wait(), 2) << words[1];
    EXPECT_CONTAINS(child.Errors(), message);
  }
}

}  // namespace
}  // namespace lanewise
