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

/// Platoons behind cars that stop on the way, all followers drivers of SUMO's own IDM.
std::string Platoons() {
  std::string text =
      "<routes>\n"
      "<vType id=\"slow\" maxSpeed=\"9\" length=\"5\" sigma=\"0\" lcSpeedGain=\"0\" lcKeepRight=\"0\"/>\n"
      "<vType id=\"idm\" carFollowModel=\"IDM\" maxSpeed=\"13\" tau=\"1.5\" minGap=\"2.5\" accel=\"1.4\" "
      "decel=\"2\" length=\"4\" speedFactor=\"1\" speedDev=\"0\" lcSpeedGain=\"0\" lcKeepRight=\"0\" "
      "lcStrategic=\"0\" lcCooperative=\"0\"/>\n<route id=\"r\" edges=\"oncoming\"/>\n";
  for (int platoon = 0; platoon < 3; ++platoon) {
    text += fmt::format(
        "<vehicle id=\"lead{0}\" type=\"slow\" route=\"r\" depart=\"{1}\" departLane=\"0\">"
        "<stop lane=\"oncoming_0\" endPos=\"{2}\" duration=\"5\"/>"
        "<stop lane=\"oncoming_0\" endPos=\"{3}\" duration=\"8\"/></vehicle>\n",
        platoon, 90 * platoon, 350 + 60 * platoon, 750 + 80 * platoon);
    for (int i = 0; i < 4; ++i)
      text +=
          fmt::format("<vehicle id=\"f{0}_{1}\" type=\"idm\" route=\"r\" depart=\"{2}\" departLane=\"0\"/>\n",
                      platoon, i, 90 * platoon + 5 * (i + 1));
  }
  return text + "</routes>\n";
}

// SUMO's IDM is an implementation of its own: what its vehicles were given comes back from what they did.
// tau and minGap to 5 %, the accelerations and the wanted speed to 10 %.
TEST(CalibrateIdmCli, FindsTheParametersOfSumosOwnIdm) {
  const TemporaryFolder folder;
  const fs::path net = fs::path(kNetworksFolder) / "breakdown" / "breakdown.net.xml";
  const fs::path routes = folder.Write("idm.rou.xml", Platoons()), fcd = folder / "fcd.xml.gz";
  ChildProcess run({"run", "-n", net.string(), "-r", routes.string(), "--policy", "sumo", "--end", "420",
                    "-q", "--", "--fcd-output", fcd.string(), "--fcd-output.max-leader-distance", "100"});
  ASSERT_EQ(run.Wait(), 0) << run.Errors();

  const fs::path parameters = folder / "idm.csv", residuals = folder / "gaps.csv";
  ChildProcess fit({"calibrate", "idm", fcd.string(), "--by", "type", "-o", parameters.string(),
                    "--residuals", residuals.string()});
  EXPECT_EQ(fit.Wait(), 0) << fit.Errors();
  EXPECT_CONTAINS(fit.Output(), "leaders as the file names them");
  EXPECT_CONTAINS(fit.Output(), "carFollowModel=\"IDM\"");
  EXPECT_CONTAINS(ReadFile(residuals), "group,vehicle,leader,held_out,time_s,gap_m,simulated_gap_m\nidm,f0_");
  const std::string row = ReadFile(parameters);
  const auto value = [&](int column) {
    std::size_t at = row.find("\nidm,") + 1;
    for (int k = 0; k < column; ++k) at = row.find(',', at) + 1;
    return std::stod(row.substr(at));
  };
  EXPECT_LT(value(4), 0.5) << row;  // [m] root mean square of the gap.
  EXPECT_NEAR(value(7), 13.0, 1.3) << row;
  EXPECT_NEAR(value(10), 1.5, 0.075) << row;
  EXPECT_NEAR(value(13), 2.5, 0.125) << row;
  EXPECT_NEAR(value(16), 1.4, 0.14) << row;
  EXPECT_NEAR(value(19), 2.0, 0.2) << row;
}

TEST(CalibrateIdmCli, BadInputIsRefusedAndNothingIsOverwritten) {
  const TemporaryFolder folder;
  const fs::path csv = folder.Write("fcd.csv", "time,id,speed,lane,pos\n0,a,1,e,2\n1,a,1,e,3\n");
  const fs::path kept = folder.Write("kept.csv", "kept"), net = folder.Write("net.xml", "<net/>");
  const std::vector<std::pair<std::vector<std::string>, std::string>> cases{
      {{csv.string()}, "no vehicle follows another one"},
      {{net.string()}, "net.xml: line 1: the document is <net>"},
      {{csv.string(), "-o", kept.string()}, "it exists; --force replaces it"},
      {{csv.string(), "--fix", "v0"}, "--fix: v0: needed: NAME=VALUE with one of v0, T, s0, a, b"},
      {{csv.string(), "--fix", "T=9"}, "--fix: T=9: allowed: 0.1 to 5 [s]"},
      {{csv.string(), "--by", "colour"}, "--by: unknown value 'colour'; allowed: all, type, vehicle"},
      {{csv.string(), "--hold-out", "1"}, "--hold-out: 1"},
      {{csv.string(), "--vtypes", net.string()}, "no vType with a length"},
      {{"/nowhere.xml"}, "/nowhere.xml: no such file"}};
  for (const auto& [words, message] : cases) {
    std::vector<std::string> arguments{"calibrate", "idm"};
    arguments.insert(arguments.end(), words.begin(), words.end());
    ChildProcess child(arguments);
    EXPECT_EQ(child.Wait(), 2) << message;
    EXPECT_CONTAINS(child.Errors(), message);
  }
  EXPECT_EQ(ReadFile(kept), "kept");
}

}  // namespace
}  // namespace lanewise
