// `lanewise verify`: recorded runs again, and where they first differ.

#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "tests/support/study_files.h"

namespace lanewise {
namespace {

namespace fs = std::filesystem;

class Verify : public StudyFiles {
 protected:
  /// A scenario of its own, so that its files may be changed.
  void SetUp() override {
    for (const char* name : {"priority_crossing.net.xml", "priority_crossing.rou.xml"})
      fs::copy_file(fs::path(kNetworksFolder) / "priority_crossing" / name, folder_ / name);
    config_ =
        folder_.Write("own.sumocfg",
                      "<configuration>\n<input>\n<net-file value=\"priority_crossing.net.xml\"/>\n"
                      "<route-files value=\"priority_crossing.rou.xml\"/>\n</input>\n</configuration>\n");
    results_ = folder_ / "a.sqlite";
  }
  void Record(const std::vector<std::string>& more = {}, const std::vector<std::string>& sumo = {}) const {
    std::vector<std::string> words{"run", "-c", config_.string(), "--end",
                                   "30",  "-q", "--results",      results_.string()};
    words.insert(words.end(), more.begin(), more.end());
    if (!sumo.empty()) words.emplace_back("--");
    words.insert(words.end(), sumo.begin(), sumo.end());
    ChildProcess child(words);
    ASSERT_EQ(child.Wait(), 0) << child.Errors();
  }
  /// @return exit code and output.
  std::pair<int, std::string> Check(const std::vector<std::string>& more = {}) const {
    std::vector<std::string> words{"verify", results_.string()};
    words.insert(words.end(), more.begin(), more.end());
    ChildProcess child(words);
    const int code = child.Wait();
    return {code, child.Output() + child.Errors()};
  }
  static bool Contains(const std::string& text, const std::string& part) {
    return text.find(part) != std::string::npos;
  }

  fs::path config_, results_;
};

TEST_F(Verify, RunsAreRepeatedWithTheirOptionsAndParameters) {
  Record(
      {"--seed", "1", "--penetration", "0.5", "--set", "driving.response_time=0.4", "--sample-period", "0"});
  Record({"--seed", "2", "--policy", "idm", "--safety", "contacts", "--step-length", "0.2"});
  Record({"--seed", "3", "--policy", "sumo"},
         {"--scale", "0.5", "--tripinfo-output", (folder_ / "trips.xml").string()});
  fs::remove(folder_ / "trips.xml");
  const auto [code, text] = Check({"--sample", "0"});
  EXPECT_EQ(code, 0) << text;
  EXPECT_TRUE(Contains(text, "3 of 3 runs repeated identically")) << text;
  EXPECT_TRUE(Contains(text, "identical in 300 steps, state hash " +
                                 Value(results_, "SELECT state_hash FROM run WHERE run_id = 1")))
      << text;
  EXPECT_FALSE(fs::exists(folder_ / "trips.xml"));  // Outputs of the recorded run are not written again.
}

TEST_F(Verify, ASampleIsDrawnBySeedAndRunsCanBeNamed) {
  for (const char* seed : {"1", "2", "3", "4"}) Record({"--policy", "sumo", "--seed", seed});
  const auto first = Check({"--sample", "2"}), again = Check({"--sample", "2"}),
             named = Check({"--run", "4"});
  EXPECT_EQ(first.second, again.second);
  EXPECT_TRUE(Contains(first.second, "2 of 2 runs repeated identically")) << first.second;
  EXPECT_TRUE(Contains(named.second, "run 4 (policy=sumo scenario=")) << named.second;
  EXPECT_TRUE(Contains(named.second, "1 of 1 runs")) << named.second;
  EXPECT_EQ(Check({"--run", "5"}).first, 2);
}

TEST_F(Verify, TheFirstStepAndVehicleThatDifferAreNamed) {
  // Recorded with another parameter than its provenance says: from some step on some vehicle really moves
  // otherwise. Which one, the samples of every step tell independently.
  Record({"--seed", "1", "--sample-period", "0"});
  Record({"--seed", "1", "--sample-period", "0", "--set", "driving.response_time=0.5"});
  Change(results_, "UPDATE run SET parameters_json = (SELECT parameters_json FROM run WHERE run_id = 1)");
  SQLite::Database database(results_.string(), SQLite::OPEN_READONLY);
  SQLite::Statement first(
      database,
      "SELECT a.time_s, v.vehicle_id, COUNT(*) OVER (PARTITION BY a.time_s) FROM trajectory AS a "
      "JOIN trajectory AS b ON b.run_id = 2 AND b.time_s = a.time_s AND b.vehicle_number = "
      "a.vehicle_number JOIN vehicle AS v ON v.run_id = 1 AND v.vehicle_number = a.vehicle_number "
      "WHERE a.run_id = 1 AND (a.lane_pos_m <> b.lane_pos_m OR a.speed_mps <> b.speed_mps) ORDER "
      "BY a.time_s LIMIT 1");
  ASSERT_TRUE(first.executeStep());
  ASSERT_EQ(first.getColumn(2).getInt(), 1);  // Else the test shows less than it should.
  const double time = first.getColumn(0).getDouble();
  const auto [code, text] = Check({"--run", "2"});
  EXPECT_EQ(code, 1);
  EXPECT_TRUE(Contains(text, fmt::format("differs from step {} ({:.2f} s) on, first in vehicle '{}'",
                                         std::lround(time / 0.1) - 1, time, first.getColumn(1).getString())))
      << text << time << first.getColumn(1).getString();
}

TEST_F(Verify, WhatIsNotAsItWasIsSaid) {
  Record({"--seed", "1"});
  Change(results_, "UPDATE run SET git_commit = 'abc', sumo_version = 'SUMO 9'");
  auto [code, text] = Check();
  EXPECT_EQ(code, 0) << text;  // The same in spite of it.
  EXPECT_TRUE(Contains(text, "git_commit was abc, is ")) << text;
  EXPECT_TRUE(Contains(text, "sumo_version was SUMO 9, is ")) << text;

  const std::string routes = ReadFile(folder_ / "priority_crossing.rou.xml");
  folder_.Write("priority_crossing.rou.xml", routes + "<!-- other -->");
  std::tie(code, text) = Check();
  EXPECT_EQ(code, 1);
  EXPECT_TRUE(Contains(text, "not repeated: its input file " +
                                 (folder_ / "priority_crossing.rou.xml").string() + " has changed: xxh3:"))
      << text;
  fs::remove(folder_ / "priority_crossing.rou.xml");
  EXPECT_TRUE(Contains(Check().second, "is missing")) << text;
  folder_.Write("priority_crossing.rou.xml", routes);

  const std::string config = ReadFile(config_);
  folder_.Write("own.sumocfg", "<configuration>\n<input>\n<net-file value=\"other.net.xml\"/>\n");
  EXPECT_TRUE(Contains(Check().second,
                       "line 3: '<net-file value=\"priority_crossing.net.xml\"/>', now '<net-file "
                       "value=\"other.net.xml\"/>'"))
      << Check().second;
  folder_.Write("own.sumocfg", config);

  Change(results_, "UPDATE run SET parameters_json = '{\"dwa.gone\": 1.0}'");
  EXPECT_TRUE(Contains(Check().second, "this version has no parameter dwa.gone, which was 1.0 there"));
}

TEST_F(Verify, OtherMeasuresOfTheSameMotionAreADifferenceToo) {
  Record({"--seed", "1"});
  Change(results_, "UPDATE trip SET time_loss_s = time_loss_s + 1 WHERE vehicle_number = 0");
  const auto [code, text] = Check();
  EXPECT_EQ(code, 1);
  EXPECT_TRUE(Contains(text, "moves the same in every step, but 2 rows of table trip")) << text;
}

TEST_F(Verify, AFileWithNothingToVerifyIsRefused) {
  Record({"--seed", "1"});
  Change(results_, "UPDATE run SET status = 'interrupted'");
  const auto [code, text] = Check();
  EXPECT_EQ(code, 2);
  EXPECT_TRUE(Contains(text, "holds no finished run")) << text;
}

}  // namespace
}  // namespace lanewise
