// What a user may get wrong: exit code 2 (1 where SUMO refuses), one line on stderr that names the place,
// what was found and what is allowed, and nothing created or overwritten.

#include <SQLiteCpp/SQLiteCpp.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <map>

#include "analysis/results_file.h"
#include "tests/support/child_process.h"

namespace lanewise {
namespace {

namespace fs = std::filesystem;

const fs::path kArena = fs::path(kNetworksFolder) / "arena";

class BadInput : public testing::Test {
 protected:
  /// Every file of the test's folder and its content.
  std::map<std::string, std::string> Content() const {
    std::map<std::string, std::string> content;
    for (const auto& entry : fs::recursive_directory_iterator(folder_.path())) {
      content[entry.path().string()] = entry.is_regular_file() ? ReadFile(entry.path()) : "";
    }
    return content;
  }

  /// Runs it; the message must have every one of `parts`.
  void ExpectRefused(const std::vector<std::string>& arguments, const std::vector<std::string>& parts,
                     int exit_code = 2) {
    const auto before = Content();
    ChildProcess child(arguments);
    EXPECT_EQ(child.Wait(), exit_code) << child.Errors() << child.Output();
    const std::string message = child.Errors();
    for (const std::string& part : parts) {
      EXPECT_NE(message.find(part), std::string::npos) << "'" << part << "' is not in: " << message;
    }
    if (exit_code == 2) {
      EXPECT_TRUE(message.starts_with("lanewise: ")) << message;
      EXPECT_EQ(std::count(message.begin(), message.end(), '\n'), 1) << message;
    }
    const auto after = Content();
    for (const auto& [file, content] : after) EXPECT_EQ(before.count(file), 1u) << file << " was created";
    EXPECT_TRUE(before == after) << "files were changed";
  }

  /// A copy of the arena's net and demand with this .sumocfg.
  fs::path Config(const std::string& input_section) {
    fs::copy_file(kArena / "arena.net.xml", folder_ / "arena.net.xml", fs::copy_options::overwrite_existing);
    fs::copy_file(kArena / "arena.rou.xml", folder_ / "arena.rou.xml", fs::copy_options::overwrite_existing);
    return folder_.Write("my.sumocfg", "<configuration><input>" + input_section + "</input></configuration>");
  }
  std::string NewResults() const { return (folder_ / "new.sqlite").string(); }

  TemporaryFolder folder_;
};

TEST_F(BadInput, MissingSumocfg) {
  const std::string file = (folder_ / "nowhere.sumocfg").string();
  ExpectRefused({"run", "-c", file, "--results", NewResults()}, {file, "no such file"});
}

TEST_F(BadInput, FolderAsSumocfg) {
  ExpectRefused({"run", "-c", folder_.path().string(), "--results", NewResults()},
                {folder_.path().string(), "folder"});
}

TEST_F(BadInput, BrokenXml) {
  const fs::path file = folder_.Write("broken.sumocfg", "<configuration><input>");
  ExpectRefused({"run", "-c", file.string(), "--results", NewResults()},
                {file.string(), "broken XML", "byte"});
}

TEST_F(BadInput, NoSumoConfiguration) {
  const fs::path file = folder_.Write("other.sumocfg", "<html><body/></html>");
  ExpectRefused({"run", "-c", file.string(), "--results", NewResults()},
                {file.string(), "<html>", "<configuration>"});
}

TEST_F(BadInput, MissingNetFileOption) {
  const fs::path file = Config("<route-files value=\"arena.rou.xml\"/>");
  ExpectRefused({"run", "-c", file.string(), "--results", NewResults()}, {file.string(), "net-file"});
}

TEST_F(BadInput, NamedFilesThatDoNotExist) {
  const fs::path routes =
      Config("<net-file value=\"arena.net.xml\"/><route-files value=\"arena.rou.xml,more.rou.xml\"/>");
  ExpectRefused({"run", "-c", routes.string(), "--results", NewResults()},
                {routes.string(), (folder_ / "more.rou.xml").string(), "does not exist"});
  const fs::path net = Config("<net-file value=\"none.net.xml\"/><route-files value=\"arena.rou.xml\"/>");
  ExpectRefused({"run", "-c", net.string()}, {"none.net.xml", "does not exist"});
  ExpectRefused({"run", "-n", (folder_ / "arena.net.xml").string(), "-r", "gone.rou.xml"},
                {"gone.rou.xml", "no such file"});
}

TEST_F(BadInput, BrokenEndInSumocfg) {
  fs::path file = Config("");
  file = folder_.Write("my.sumocfg",
                       "<configuration><input><net-file value=\"arena.net.xml\"/></input>"
                       "<time><end value=\"soon\"/></time></configuration>");
  ExpectRefused({"run", "-c", file.string()}, {file.string(), "end", "'soon'", "hh:mm:ss"});
}

TEST_F(BadInput, BrokenNetwork) {
  Config("<net-file value=\"arena.net.xml\"/><route-files value=\"arena.rou.xml\"/>");
  folder_.Write("arena.net.xml", "<net><edge id=\"e\"");
  ExpectRefused({"run", "-c", (folder_ / "my.sumocfg").string(), "--results", NewResults()},
                {(folder_ / "arena.net.xml").string()});
}

TEST_F(BadInput, NetWithoutRoutes) {
  ExpectRefused({"run", "-n", (kArena / "arena.net.xml").string()}, {"--net-file", "--route-files"});
}

TEST_F(BadInput, NothingToRun) {
  ExpectRefused({"run"}, {"-c", "--scenario", "-n"});
}

TEST_F(BadInput, UnknownPolicyAndRules) {
  ExpectRefused({"run", "--scenario", "arena", "--policy", "orca", "--results", NewResults()},
                {"--policy", "'orca'", "sumo, idm, dwa"});
  ExpectRefused({"run", "--scenario", "arena", "--rules", "none"}, {"--rules", "'none'", "sumo"});
}

TEST_F(BadInput, UnknownParameter) {
  ExpectRefused({"run", "--scenario", "arena", "--set", "dwa.horizont=3", "--results", NewResults()},
                {"--set", "'dwa.horizont'", "did you mean 'dwa.horizon'?", "lanewise params"});
}

TEST_F(BadInput, ParameterOutOfRange) {
  ExpectRefused({"run", "--scenario", "arena", "--set", "dwa.horizon=99", "--results", NewResults()},
                {"--set", "dwa.horizon", "99 s", "1 to 6 s"});
}

TEST_F(BadInput, ImpossibleRadio) {
  const auto refuse = [&](const std::string& assignment, const std::vector<std::string>& parts) {
    ExpectRefused(
        {"run", "--scenario", "arena", "--v2x", "lossy", "--set", assignment, "--results", NewResults()},
        parts);
  };
  refuse("v2x.range=-1", {"'v2x.range'", "-1 m", "0 to 2000 m"});
  refuse("v2x.loss=1.5", {"'v2x.loss'", "1.5", "0 to 1"});
  refuse("v2x.latency_min=0.5", {"'v2x.latency_min'", "0.5 s", "v2x.latency_mean"});
  refuse("v2x.latency_max=5", {"'v2x.latency_max'", "5 s", "v2x.memory"});
  refuse("v2x.range=1000", {"'v2x.range'", "1000 m", "v2x.carrier_sense_range, 450 m"});
  refuse("v2x.cruise_reaction=1", {"'v2x.cruise_reaction'", "1 s", "v2x.cruise_gap, 0.6 s"});
  ExpectRefused({"run", "--scenario", "arena", "--v2x", "perfect"},
                {"--v2x", "'perfect'", "off, ideal, range, lossy, loaded"});
  ExpectRefused({"bench", "platoon", "--frequencies", "0.3"}, {"--frequencies", "0.3 Hz", "whole number"});
  ExpectRefused({"bench", "slots", "--demand", "5"}, {"--demand", "5 veh/h", "60 to 3600"});
}

TEST_F(BadInput, SetWithoutEqualsOrNumber) {
  ExpectRefused({"run", "--scenario", "arena", "--set", "dwa.horizon"},
                {"--set", "'dwa.horizon'", "name=value"});
  ExpectRefused({"run", "--scenario", "arena", "--set", "dwa.horizon=far"}, {"--set", "'far'", "number"});
  ExpectRefused({"run", "--scenario", "arena", "--set", "dwa.horizon="}, {"--set", "number"});
}

TEST_F(BadInput, TomlFiles) {
  const std::string broken = folder_.Write("broken.toml", "[dwa]\nhorizon = = 3\n").string();
  ExpectRefused({"run", "--scenario", "arena", "--config", broken}, {broken, "line 2", "broken TOML"});
  const std::string unknown = folder_.Write("unknown.toml", "[dwa]\nhorizont = 3\n").string();
  ExpectRefused({"run", "--scenario", "arena", "--config", unknown},
                {unknown, "line 2", "'dwa.horizont'", "did you mean 'dwa.horizon'?"});
  const std::string range = folder_.Write("range.toml", "dwa.horizon = 99\n").string();
  ExpectRefused({"run", "--scenario", "arena", "--config", range}, {range, "line 1", "99 s", "1 to 6 s"});
  const std::string text = folder_.Write("text.toml", "dwa.horizon = \"far\"\n").string();
  ExpectRefused({"run", "--scenario", "arena", "--config", text}, {text, "line 1", "dwa.horizon", "number"});
  ExpectRefused({"run", "--scenario", "arena", "--config", "/no/such.toml"},
                {"/no/such.toml", "no such file"});
}

TEST_F(BadInput, ResultsFileThatIsNoSqliteFile) {
  const std::string file = folder_.Write("notes.sqlite", std::string(500, 'x')).string();
  ExpectRefused({"run", "--scenario", "arena", "--results", file}, {file, "not an SQLite file"});
  ExpectRefused({"info", file}, {file, "not an SQLite file"});
}

TEST_F(BadInput, ResultsFileOfAnotherProgram) {
  const std::string file = (folder_ / "other.sqlite").string();
  {
    SQLite::Database database(file, SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE);
    database.exec("CREATE TABLE birds (name TEXT)");
  }
  ExpectRefused({"run", "--scenario", "arena", "--results", file}, {file, "not Lanewise's"});
  ExpectRefused({"info", file}, {file, "not Lanewise's"});
}

TEST_F(BadInput, ResultsFileOfANewerSchema) {
  const std::string file = (folder_ / "newer.sqlite").string();
  {
    ResultsFile results = ResultsFile::Open(file, ResultsFile::Mode::kAppend);
    results.database().exec("PRAGMA user_version = 99");
    results.database().exec("PRAGMA wal_checkpoint(TRUNCATE)");
  }
  ExpectRefused({"run", "--scenario", "arena", "--results", file}, {file, "schema version 99", "newer"});
  ExpectRefused({"info", file}, {file, "schema version 99"});
}

TEST_F(BadInput, ResultsInPlacesThatTakeNone) {
  ExpectRefused({"run", "--scenario", "arena", "--results", folder_.path().string()},
                {folder_.path().string()});
  ExpectRefused({"run", "--scenario", "arena", "--results", "/proc/lanewise.sqlite"},
                {"/proc/lanewise.sqlite"});
  const std::string nowhere = (folder_ / "no" / "such.sqlite").string();
  ExpectRefused({"run", "--scenario", "arena", "--results", nowhere}, {nowhere, "does not exist"});
}

TEST_F(BadInput, SumoOutputFolderThatDoesNotExist) {
  ExpectRefused({"run", "--scenario", "arena", "--sumo-outputs", "/no/such"}, {"--sumo-outputs", "/no/such"});
}

TEST_F(BadInput, InfoOnAFileThatDoesNotExist) {
  const std::string file = (folder_ / "none.sqlite").string();
  ExpectRefused({"info", file}, {file});
}

TEST_F(BadInput, NegativeEnd) {
  ExpectRefused({"run", "--scenario", "arena", "--end", "-5", "--results", NewResults()},
                {"--end", "-5 s", "0.1 to 1000000000 s"});
}

TEST_F(BadInput, NumbersOutOfRange) {
  ExpectRefused({"run", "--scenario", "arena", "--step-length", "5"},
                {"--step-length", "5 s", "0.01 to 1 s"});
  ExpectRefused({"run", "--scenario", "arena", "--threads", "-1"}, {"--threads", "-1", "0 to 1024"});
  ExpectRefused({"run", "--scenario", "arena", "--seed", "-3"}, {"--seed", "-3"});
  ExpectRefused({"run", "--scenario", "arena", "--sample-period", "-1"}, {"--sample-period", "-1"});
}

TEST_F(BadInput, UnknownScenario) {
  ExpectRefused({"run", "--scenario", "atlantis", "--results", NewResults()},
                {"--scenario", "'atlantis'", "town", "arena"});
}

TEST_F(BadInput, ScenarioAndConfigurationExclude) {
  ExpectRefused({"run", "--scenario", "arena", "-c", (kArena / "arena.sumocfg").string()},
                {"--scenario", "-c"});
}

TEST_F(BadInput, OptionsOnTheCommandLineItself) {
  ChildProcess unknown({"run", "--scenario", "arena", "--polcy", "dwa"});
  EXPECT_EQ(unknown.Wait(), 2);
  EXPECT_NE(unknown.Errors().find("--polcy"), std::string::npos);
  ChildProcess text({"run", "--scenario", "arena", "--end", "soon"});
  EXPECT_EQ(text.Wait(), 2);
  EXPECT_NE(text.Errors().find("end"), std::string::npos);
  ChildProcess nothing({});
  EXPECT_EQ(nothing.Wait(), 2);
}

TEST_F(BadInput, SumoOptionsWithoutARun) {
  ExpectRefused({"params", "--", "--scale", "2"}, {"--", "runs only"});
}

// SUMO's own refusals: exit code 1, its words on stderr.
TEST_F(BadInput, UnknownSumoOption) {
  ExpectRefused({"run", "--scenario", "arena", "--results", NewResults(), "--", "--no-such-option", "1"},
                {"no-such-option"}, /*exit_code=*/1);
}

TEST_F(BadInput, RouteThatSumoRefuses) {
  const fs::path file = Config("<net-file value=\"arena.net.xml\"/><route-files value=\"bad.rou.xml\"/>");
  folder_.Write("bad.rou.xml",
                "<routes><vehicle id=\"v\" depart=\"0\"><route edges=\"no_such_edge\"/></vehicle></routes>");
  ExpectRefused({"run", "-c", file.string(), "--results", NewResults()}, {"no_such_edge"}, /*exit_code=*/1);
}

// The policy of a type is only met when its first vehicle departs: still bad input, and the run says why it
// ended.
TEST_F(BadInput, UnknownPolicyOfAVehicleType) {
  const fs::path file = Config("<net-file value=\"arena.net.xml\"/><route-files value=\"typed.rou.xml\"/>");
  std::string routes = ReadFile(folder_ / "arena.rou.xml");
  const std::size_t type = routes.find("<vType ");
  ASSERT_NE(type, std::string::npos);
  // The first type of the file gets a parameter; it is written <vType .../>.
  const std::size_t close = routes.find("/>", type);
  ASSERT_LT(close, routes.find('>', type));
  routes.replace(close, 2, "><param key=\"lanewise.policy\" value=\"orca\"/></vType>");
  folder_.Write("typed.rou.xml", routes);
  ChildProcess child({"run", "-c", file.string(), "-q", "--results", NewResults()});
  EXPECT_EQ(child.Wait(), 2);
  for (const char* part : {"lanewise.policy", "'orca'", "sumo, idm, dwa"}) {
    EXPECT_NE(child.Errors().find(part), std::string::npos) << child.Errors();
  }
  const auto runs = LoadRunSummaries(NewResults());
  ASSERT_EQ(runs.size(), 1u);
  EXPECT_EQ(runs[0].status, "failed");
}

TEST(GoodInput, AnExistingResultsFileGainsASecondRun) {
  const TemporaryFolder folder;
  const std::string file = (folder / "two.sqlite").string();
  for (const char* policy : {"dwa", "idm"}) {
    ChildProcess child(
        {"run", "--scenario", "arena", "-e", "5", "-q", "--policy", policy, "--results", file});
    ASSERT_EQ(child.Wait(), 0) << child.Errors();
  }
  const auto runs = LoadRunSummaries(file);
  ASSERT_EQ(runs.size(), 2u);
  EXPECT_EQ(runs[0].policy, "dwa");
  EXPECT_EQ(runs[1].policy, "idm");
  EXPECT_EQ(runs[0].status, "finished");
  EXPECT_NE(runs[0].run_id, runs[1].run_id);
  ChildProcess info({"info", file});
  EXPECT_EQ(info.Wait(), 0);
  EXPECT_NE(info.Output().find("idm"), std::string::npos);
}

TEST(GoodInput, ParamsListsThemAll) {
  ChildProcess text({"params"});
  EXPECT_EQ(text.Wait(), 0);
  EXPECT_NE(text.Output().find("dwa.horizon"), std::string::npos);
  ChildProcess markdown({"params", "--markdown"});
  EXPECT_EQ(markdown.Wait(), 0);
  EXPECT_NE(markdown.Output().find("| `control.speed_kp` |"), std::string::npos);
}

TEST(GoodInput, Doctor) {
  ChildProcess doctor({"doctor"});
  EXPECT_EQ(doctor.Wait(), 0) << doctor.Output() << doctor.Errors();
}

}  // namespace
}  // namespace lanewise
