// The safety engine as a user meets it: levels, thresholds, agreement with SUMO, the same rows for every
// number of threads.

#include <SQLiteCpp/SQLiteCpp.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "tests/support/child_process.h"
#include "tests/support/temporary_folder.h"

namespace lanewise {
namespace {

std::string Drive(const TemporaryFolder& folder, const std::string& name, std::vector<std::string> more) {
  const std::string file = (folder / name).string();
  std::vector<std::string> arguments{"run", "--scenario", "town", "-e", "90", "-q", "--results", file};
  arguments.insert(arguments.end(), more.begin(), more.end());
  ChildProcess child(arguments);
  EXPECT_EQ(child.Wait(), 0) << child.Errors();
  return file;
}

/// Every value of a query, as one text.
std::string All(const std::string& file, const std::string& sql) {
  SQLite::Database database(file, SQLite::OPEN_READONLY);
  SQLite::Statement query(database, sql);
  std::string text;
  while (query.executeStep()) {
    for (int k = 0; k < query.getColumnCount(); ++k) {
      text += query.getColumn(k).isNull() ? "-" : query.getColumn(k).getString();
      text += k + 1 < query.getColumnCount() ? ' ' : '\n';
    }
  }
  return text;
}

TEST(Safety, TheSameRowsForEveryNumberOfThreads) {
  const TemporaryFolder folder;
  const std::string one = Drive(folder, "one.sqlite", {"--threads", "1"});
  const std::string four = Drive(folder, "four.sqlite", {"--threads", "4"});
  for (const std::string table :
       {"encounter", "encounter_sample", "collision", "edge_interval", "histogram", "trip"}) {
    const std::string rows = All(one, "SELECT * FROM " + table);
    EXPECT_EQ(rows, All(four, "SELECT * FROM " + table)) << table;
    EXPECT_TRUE(table == "collision" || !rows.empty()) << table;
  }
}

TEST(Safety, EncountersCrossAThresholdAndKeepTheirSamples) {
  const TemporaryFolder folder;
  const std::string file = Drive(folder, "town.sqlite", {"--policy", "sumo"});
  EXPECT_EQ(All(file,
                "SELECT COUNT(*) FROM encounter WHERE NOT (contact OR IFNULL(min_ttc_s, 9) < 3 OR "
                "IFNULL(max_drac_mps2, 0) > 3 OR IFNULL(pet_s, 9) < 2)"),
            "0\n");
  EXPECT_EQ(All(file, "SELECT COUNT(*) FROM encounter WHERE ego_vehicle = foe_vehicle OR end_s < begin_s"),
            "0\n");
  EXPECT_EQ(
      All(file,
          "SELECT COUNT(*) FROM encounter_sample JOIN encounter USING (run_id, encounter) WHERE time_s < "
          "critical_s - 2.01 OR time_s > critical_s + 1.01"),
      "0\n");
  // Distance and time of all edges together are those of all trips, but for the last parts of steps that
  // neither has.
  EXPECT_EQ(
      All(file,
          "SELECT ABS((SELECT SUM(vehicle_distance_m) FROM edge_interval) / (SELECT SUM(route_length_m) FROM "
          "trip) - 1) < 0.01"),
      "1\n");
  EXPECT_EQ(All(file,
                "SELECT ABS(distance_km * co2_g_per_km - (SELECT SUM(co2_mg) FROM trip) / 1000.0) < 1e-6, "
                "ABS(driving_time_h * encounters_per_h - (SELECT COUNT(*) FROM encounter)) < 1e-6 FROM "
                "v_run_metrics"),
            "1 1\n");
  // A sample's own measures are within the encounter's extremes, and it has a type just when it has one.
  EXPECT_EQ(
      All(file,
          "SELECT COUNT(*) FROM encounter_sample AS s JOIN encounter AS e USING (run_id, encounter) WHERE "
          "s.ttc_s < e.min_ttc_s - 1e-9 OR s.drac_mps2 > e.max_drac_mps2 + 1e-9 OR (s.ttc_s IS NOT NULL "
          "AND s.type_code = 0)"),
      "0\n");
  EXPECT_EQ(All(file, "SELECT COUNT(*) > 10 FROM encounter_sample WHERE ttc_s IS NOT NULL"), "1\n");
}

TEST(Safety, LevelsSayWhatWasNotWatched) {
  const TemporaryFolder folder;
  const std::string off = Drive(folder, "off.sqlite", {"--safety", "off"});
  EXPECT_EQ(All(off, "SELECT collisions, near_misses, encounters FROM v_run_summary"), "- - -\n");
  EXPECT_EQ(All(off, "SELECT COUNT(ttc_exposed_s) FROM trip"), "0\n");
  const std::string contacts = Drive(folder, "contacts.sqlite", {"--safety", "contacts"});
  const std::string full = Drive(folder, "full.sqlite", {});
  EXPECT_EQ(All(contacts, "SELECT near_misses FROM v_run_summary"), "-\n");
  EXPECT_EQ(All(contacts, "SELECT * FROM collision"), All(full, "SELECT * FROM collision"));
}

TEST(Safety, ThresholdsCanBeSet) {
  const TemporaryFolder folder;
  const std::string file = Drive(folder, "tight.sqlite",
                                 {"--set", "safety.ttc_encounter=1", "--set", "safety.drac_encounter=50",
                                  "--set", "safety.pet_encounter=0"});
  EXPECT_EQ(All(file,
                "SELECT COUNT(*) FROM encounter WHERE IFNULL(min_ttc_s, 9) >= 1 AND IFNULL(max_drac_mps2, 0) "
                "<= 50"),
            "0\n");
  EXPECT_EQ(All(file, "SELECT COUNT(pet_s) FROM encounter"), "0\n");
}

TEST(Safety, AgreesWithSumosDevice) {
  ChildProcess child({"bench", "ssm", "--scenario", "town", "-e", "150", "-q"});
  EXPECT_EQ(child.Wait(), 0) << child.Output() << child.Errors();
}

TEST(Safety, CostIsMeasured) {
  ChildProcess child(
      {"bench", "cost", "--scenario", "town", "--policy", "sumo", "-e", "10", "-q", "--repeat", "1"});
  EXPECT_NE(child.Wait(), 2) << child.Errors();  // On a busy machine targets may be missed.
  for (const char* line : {"engine on", "sampled every second", "trajectory rows into SQLite"})
    EXPECT_NE(child.Output().find(line), std::string::npos) << child.Output() << child.Errors();
}

TEST(Safety, BadValuesAreRefused) {
  ChildProcess level({"run", "--scenario", "town", "--safety", "all"});
  EXPECT_EQ(level.Wait(), 2);
  EXPECT_NE(level.Errors().find("off, contacts, full"), std::string::npos) << level.Errors();
  ChildProcess parameter({"run", "--scenario", "town", "--set", "safety.event_after=5"});
  EXPECT_EQ(parameter.Wait(), 2);
  EXPECT_NE(parameter.Errors().find("safety.separation_time"), std::string::npos) << parameter.Errors();
  ChildProcess interval({"run", "--scenario", "town", "--edge-interval", "-1"});
  EXPECT_EQ(interval.Wait(), 2);
  EXPECT_NE(interval.Errors().find("--edge-interval"), std::string::npos) << interval.Errors();
}

}  // namespace
}  // namespace lanewise
