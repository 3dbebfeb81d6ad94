// `lanewise calibrate` as a user runs it.

#include <gtest/gtest.h>

#include "tests/support/child_process.h"

namespace lanewise {
namespace {

namespace fs = std::filesystem;

#define EXPECT_CONTAINS(text, part) EXPECT_NE(std::string(text).find(part), std::string::npos) << text

TEST(CalibratePidCli, WalksThroughAndWritesWhatRunReads) {
  const TemporaryFolder folder;
  const fs::path gains = folder / "gains.toml", curves = folder / "curves.csv";
  const std::vector<std::string> words{"calibrate", "pid",          "--period", "0.05",
                                       "-o",        gains.string(), "--csv",    curves.string()};
  ChildProcess child(words);
  EXPECT_EQ(child.Wait(), 0) << child.Errors();
  for (const char* name : {"P  ", "PD  ", "PID  ", "PID, fitted"}) EXPECT_CONTAINS(child.Output(), name);
  EXPECT_CONTAINS(ReadFile(curves), "time_s,wanted_mps,p_speed_mps");
  EXPECT_CONTAINS(ReadFile(gains), "speed_kp");

  ChildProcess run({"run", "--scenario", "merge", "--end", "2", "-q", "--config", gains.string()});
  EXPECT_EQ(run.Wait(), 0) << run.Errors();

  const std::string kept = ReadFile(gains);
  ChildProcess again(words);
  EXPECT_EQ(again.Wait(), 2);
  EXPECT_CONTAINS(again.Errors(), "it exists; --force replaces it");
  EXPECT_EQ(ReadFile(gains), kept);
}

TEST(CalibratePidCli, DrawsThePlot) {
  if (std::system("command -v gnuplot >/dev/null") != 0) GTEST_SKIP() << "no gnuplot";
  const TemporaryFolder folder;
  const fs::path plot = folder / "pid.svg";
  ChildProcess child({"calibrate", "pid", "--period", "0.05", "--plot", plot.string()});
  EXPECT_EQ(child.Wait(), 0) << child.Errors();
  EXPECT_CONTAINS(ReadFile(plot), "speed [km/h]");
  EXPECT_CONTAINS(ReadFile(plot), "</svg>");
}

TEST(CalibratePidCli, OptionsOutOfRangeAreRefused) {
  const std::vector<std::pair<std::vector<std::string>, std::string>> cases{
      {{"--lag", "0"}, "--lag: 0; allowed: 0.01 to 60"},
      {{"--lag", "nan"}, "--lag: nan"},
      {{"--to-kmh", "60"}, "it must differ from --from-kmh"},
      {{"--overshoot", "1"}, "--overshoot: 1; allowed: 0 to 0.9"},
      {{"--settling-time", "100"}, "--settling-time: 100; allowed: 0.1 to 60"},
      {{"--kp", "-1"}, "--kp: -1; allowed: 0 to 50"},
      {{"--plot", "/tmp/pid.jpg"}, "plots are written as .svg, .png or .pdf"},
      {{"-o", "/nowhere/gains.toml"}, "its folder does not exist"}};
  for (const auto& [words, message] : cases) {
    std::vector<std::string> arguments{"calibrate", "pid"};
    arguments.insert(arguments.end(), words.begin(), words.end());
    ChildProcess child(arguments);
    EXPECT_EQ(child.Wait(), 2) << words[0];
    EXPECT_CONTAINS(child.Errors(), message);
  }
}

}  // namespace
}  // namespace lanewise
