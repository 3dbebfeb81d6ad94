// `lanewise export` as a user runs it: SUMO's own numbers come back under SUMO's names, and SUMO's own
// plotting tools read them.

#include <SQLiteCpp/SQLiteCpp.h>
#include <gtest/gtest.h>
#include <zlib.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <iterator>
#include <map>
#include <pugixml.hpp>
#include <sstream>

#include "analysis/results_file.h"
#include "tests/support/child_process.h"

namespace lanewise {
namespace {

namespace fs = std::filesystem;

#define EXPECT_CONTAINS(text, part) EXPECT_NE(std::string(text).find(part), std::string::npos) << text

/// One native run of 60 s, recorded once for all tests of this process.
class ExportCli : public testing::Test {
 protected:
  void SetUp() override {
    ChildProcess run({"run", "--scenario", "town", "--policy", "sumo", "--end", "60", "-q", "--results",
                      Results(), "--", "--tripinfo-output", (folder_ / "sumo_trips.xml").string(),
                      "--tripinfo-output.write-unfinished", "true", "--fcd-output",
                      (folder_ / "sumo_fcd.xml").string(), "--precision", "6"});
    ASSERT_EQ(run.Wait(), 0) << run.Errors();
  }
  std::string Results() const { return (folder_ / "town.sqlite").string(); }
  std::string Path(const std::string& name) const { return (folder_ / name).string(); }
  void Export(std::vector<std::string> arguments, int exit_code = 0, const std::string& message = "") const {
    arguments.insert(arguments.begin(), {"export", Results()});
    ChildProcess child(arguments);
    EXPECT_EQ(child.Wait(), exit_code) << child.Errors();
    EXPECT_CONTAINS(child.Errors(), message);
  }
  TemporaryFolder folder_;
};

std::string Unzip(const fs::path& path) {
  gzFile file = gzopen(path.c_str(), "rb");
  std::string text(1 << 22, '\0');
  const int size = gzread(file, text.data(), static_cast<unsigned>(text.size()));
  gzclose(file);
  text.resize(static_cast<std::size_t>(std::max(size, 0)));
  return text;
}

TEST_F(ExportCli, TripsAreSumosTripinfo) {
  Export({"--trips", Path("trips.xml")});
  pugi::xml_document ours, sumos;
  ASSERT_TRUE(ours.load_file(Path("trips.xml").c_str()));
  ASSERT_TRUE(sumos.load_file(Path("sumo_trips.xml").c_str()));
  std::map<std::string, pugi::xml_node> by_id;
  for (const pugi::xml_node trip : sumos.child("tripinfos").children("tripinfo"))
    by_id[trip.attribute("id").value()] = trip;
  std::size_t arrived = 0;
  for (const pugi::xml_node trip : ours.child("tripinfos").children("tripinfo")) {
    const std::string id = trip.attribute("id").value();
    ASSERT_EQ(by_id.count(id), 1u) << id;
    const pugi::xml_node other = by_id[id];
    for (const char* name : {"depart", "departDelay", "arrival", "vType"}) {
      EXPECT_NE(std::string(trip.attribute(name).value()), "") << name;
      if (std::string(name) == "vType") {
        EXPECT_STREQ(trip.attribute(name).value(), other.attribute(name).value());
      } else {
        EXPECT_NEAR(trip.attribute(name).as_double(), other.attribute(name).as_double(), 1e-6)
            << id << ' ' << name;
      }
    }
    if (other.attribute("arrival").as_double() < 0) continue;
    ++arrived;
    EXPECT_NEAR(trip.attribute("duration").as_double(), other.attribute("duration").as_double(), 1e-6) << id;
    // SUMO removes an arriving vehicle within its last step: sums lack at most that step.
    EXPECT_NEAR(trip.attribute("routeLength").as_double(), other.attribute("routeLength").as_double(), 2.0)
        << id;
    EXPECT_NEAR(trip.attribute("timeLoss").as_double(), other.attribute("timeLoss").as_double(), 0.2) << id;
  }
  EXPECT_GT(arrived, 0u);
}

TEST_F(ExportCli, TrajectoriesAreSumosFcd) {
  Export({"--trajectories", Path("fcd.xml.gz")});
  const fs::path plain = folder_.Write("fcd.xml", Unzip(Path("fcd.xml.gz")));
  pugi::xml_document ours, sumos;
  ASSERT_TRUE(ours.load_file(plain.c_str()));
  ASSERT_TRUE(sumos.load_file(Path("sumo_fcd.xml").c_str()));
  std::map<std::pair<long, std::string>, pugi::xml_node> states;
  for (const pugi::xml_node step : sumos.child("fcd-export").children("timestep")) {
    for (const pugi::xml_node vehicle : step.children())
      states[{std::lround(step.attribute("time").as_double() * 10.0), vehicle.attribute("id").value()}] =
          vehicle;
  }
  std::size_t compared = 0;
  for (const pugi::xml_node step : ours.child("fcd-export").children("timestep")) {
    for (const pugi::xml_node vehicle : step.children()) {
      const long tenth = std::lround(step.attribute("time").as_double() * 10.0);
      const auto found = states.find({tenth, vehicle.attribute("id").value()});
      if (found == states.end()) continue;
      ++compared;
      const pugi::xml_node other = found->second;
      EXPECT_STREQ(vehicle.name(), other.name());
      for (const char* name : {"x", "y", "speed"})
        EXPECT_NEAR(vehicle.attribute(name).as_double(), other.attribute(name).as_double(), 1e-4) << name;
      const double turn = vehicle.attribute("angle").as_double() - other.attribute("angle").as_double();
      EXPECT_NEAR(std::remainder(turn, 360.0), 0.0, 1e-3);
      if (std::string(vehicle.name()) == "vehicle") {
        EXPECT_STREQ(vehicle.attribute("lane").value(), other.attribute("lane").value());
      }
    }
  }
  EXPECT_GT(compared, 500u);
}

std::vector<std::string> Words(const std::string& text) {
  std::istringstream stream(text);
  return {std::istream_iterator<std::string>(stream), {}};
}

TEST_F(ExportCli, EncountersAreAnSsmLogWithBothTrajectories) {
  Export({"--encounters", Path("ssm.xml")});
  pugi::xml_document ours, sumos;
  ASSERT_TRUE(ours.load_file(Path("ssm.xml").c_str()));
  ASSERT_TRUE(sumos.load_file(Path("sumo_fcd.xml").c_str()));
  std::map<std::pair<long, std::string>, pugi::xml_node> states;
  for (const pugi::xml_node step : sumos.child("fcd-export").children("timestep")) {
    for (const pugi::xml_node vehicle : step.children())
      states[{std::lround(step.attribute("time").as_double() * 10.0), vehicle.attribute("id").value()}] =
          vehicle;
  }
  std::size_t places = 0, measured = 0, undefined = 0;
  for (const pugi::xml_node conflict : ours.child("SSMLog").children("conflict")) {
    const auto span = [&](const char* name) {
      return Words(conflict.child(name).attribute("values").value());
    };
    const std::vector<std::string> times = span("timeSpan");
    ASSERT_FALSE(times.empty());
    for (const char* name : {"typeSpan", "egoPosition", "egoVelocity", "foePosition", "foeVelocity",
                             "conflictPoint", "TTCSpan", "DRACSpan"})
      EXPECT_EQ(span(name).size(), times.size()) << name;
    const std::pair<const char*, const char*> roles[] = {{"ego", "egoPosition"}, {"foe", "foePosition"}};
    for (std::size_t k = 0; k < times.size(); ++k) {
      for (const auto& [role, element] : roles) {
        const auto state =
            states.find({std::lround(std::stod(times[k]) * 10.0), conflict.attribute(role).value()});
        if (state == states.end()) continue;
        const std::string place = span(element)[k];
        // Two decimals of ours, six of SUMO's.
        EXPECT_NEAR(std::stod(place), state->second.attribute("x").as_double(), 0.0051)
            << role << ' ' << times[k];
        EXPECT_NEAR(std::stod(place.substr(place.find(',') + 1)), state->second.attribute("y").as_double(),
                    0.0051);
        ++places;
      }
      const std::string ttc = span("TTCSpan")[k];
      if (ttc == "NA") continue;
      ++measured;
      EXPECT_GE(std::stod(ttc) + 0.0051, conflict.child("minTTC").attribute("value").as_double());
      EXPECT_NE(span("typeSpan")[k], "0");
    }
    for (const char* name : {"minTTC", "maxDRAC", "PET"}) {
      for (const char* attribute : {"time", "position", "type", "value"})
        EXPECT_STRNE(conflict.child(name).attribute(attribute).value(), "") << name << ' ' << attribute;
    }
    undefined += std::string(conflict.child("PET").attribute("value").value()) == "NA";
  }
  EXPECT_GT(places, 50u);
  EXPECT_GT(measured, 10u);
  EXPECT_GT(undefined, 0u);
}

TEST_F(ExportCli, CsvNamesColumnsAsXml2csvDoes) {
  Export({"--trips", Path("trips.csv"), "--edges", Path("edges.csv.gz"), "--encounters",
          Path("encounters.csv")});
  EXPECT_TRUE(ReadFile(Path("trips.csv")).starts_with("tripinfo_id;tripinfo_depart;tripinfo_departDelay;"));
  EXPECT_TRUE(Unzip(Path("edges.csv.gz")).starts_with("interval_begin;interval_end;interval_id;edge_id;"));
  EXPECT_TRUE(ReadFile(Path("encounters.csv"))
                  .starts_with("conflict_begin;conflict_end;conflict_ego;conflict_foe;minTTC_"));
  const std::string text = ReadFile(Path("trips.csv"));
  const std::string head = text.substr(0, text.find('\n'));
  for (std::size_t at = 0; at < text.size(); at = text.find('\n', at) + 1) {
    const std::string line = text.substr(at, text.find('\n', at) - at);
    EXPECT_EQ(std::count(line.begin(), line.end(), ';'), std::count(head.begin(), head.end(), ';')) << line;
  }
}

TEST_F(ExportCli, SumosPlottingToolsReadIt) {
  const fs::path tools = fs::path(kSumoHome) / "tools";
  const std::string python = "MPLBACKEND=Agg MPLCONFIGDIR=" + folder_.path().string() + " /usr/bin/python3 ";
  if (!fs::exists(tools / "plot_trajectories.py")) GTEST_SKIP() << "no SUMO tools in " << tools;
  if (std::system((python + "-c 'import matplotlib' 2>/dev/null").c_str()) != 0)
    GTEST_SKIP() << "/usr/bin/python3 has no matplotlib (Debian's python3-matplotlib)";
  Export({"--trips", Path("trips.xml"), "--trajectories", Path("fcd.xml")});
  const std::string trajectories = python + (tools / "plot_trajectories.py").string() + " " +
                                   Path("fcd.xml") + " -t td -v -o " + Path("a.png") + " >" + Path("a.txt") +
                                   " 2>&1";
  EXPECT_EQ(std::system(trajectories.c_str()), 0) << ReadFile(Path("a.txt"));
  EXPECT_TRUE(ReadFile(Path("a.txt")).starts_with("Found ")) << ReadFile(Path("a.txt"));
  EXPECT_TRUE(ReadFile(Path("a.png")).starts_with("\x89PNG"));
  const std::string attributes = python + (tools / "visualization/plotXMLAttributes.py").string() +
                                 " -x depart -y timeLoss -i vType --scatterplot -v -o " + Path("b.png") +
                                 " " + Path("trips.xml") + " >" + Path("b.txt") + " 2>&1";
  EXPECT_EQ(std::system(attributes.c_str()), 0) << ReadFile(Path("b.txt"));
  EXPECT_TRUE(ReadFile(Path("b.txt")).starts_with("Found ")) << ReadFile(Path("b.txt"));
  EXPECT_TRUE(ReadFile(Path("b.png")).starts_with("\x89PNG"));
}

TEST_F(ExportCli, WhatIsNotANumberIsLeftEmpty) {
  SQLite::Database(Results(), SQLite::OPEN_READWRITE)
      .exec(
          "UPDATE trip SET time_loss_s = 9e999; UPDATE encounter SET min_ttc_s = 9e999, pet_s = -9e999;"
          "UPDATE encounter_sample SET ttc_s = 9e999");
  Export({"--trips", Path("trips.csv"), "--encounters", Path("ssm.xml")});
  for (const std::string name : {"trips.csv", "ssm.xml"}) {
    const std::string text = ReadFile(Path(name));
    EXPECT_GT(text.size(), 100u);
    for (const char* bad : {";inf", ";-inf", "\"inf", "\"-inf", "Inf", "nan"})
      EXPECT_EQ(text.find(bad), std::string::npos) << name;
  }
}

TEST_F(ExportCli, FilesWithoutRunsAreRefused) {
  const fs::path empty = folder_ / "empty.sqlite";
  ResultsFile::Open(empty, ResultsFile::Mode::kAppend);
  ChildProcess child({"export", empty.string(), "--trips", Path("none.csv")});
  EXPECT_EQ(child.Wait(), 2);
  EXPECT_CONTAINS(child.Errors(), "it holds no runs");
  EXPECT_FALSE(fs::exists(Path("none.csv")));
}

TEST_F(ExportCli, BadRequestsAreRefusedAndReplaceNothing) {
  const fs::path kept = folder_.Write("kept.csv", "mine");
  Export({"--trips", kept.string()}, 2, "it exists; --force replaces it");
  Export({"--trips", kept.string(), "--force", "--run", "7"}, 2, "there is no run '7'");
  EXPECT_EQ(ReadFile(kept), "mine");
  Export({"--trips", Path("trips.txt")}, 2, "allowed: .csv, .csv.gz, .xml, .xml.gz");
  Export({"--trips", Path("trips.xml"), "--run", "all"}, 2, "SUMO's XML holds one run");
  Export({"--trips", Path("nowhere/trips.csv")}, 2, "cannot be written");
  Export({}, 2, "nothing to write");
  Export({"--trips", kept.string(), "--force"});
  EXPECT_NE(ReadFile(kept), "mine");
  for (const auto& entry : fs::directory_iterator(folder_.path()))
    EXPECT_NE(entry.path().extension(), ".part") << entry.path();
}

}  // namespace
}  // namespace lanewise
