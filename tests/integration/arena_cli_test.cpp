// `lanewise arena` as a user runs it.

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/support/child_process.h"

namespace lanewise {
namespace {

TEST(ArenaCommand, ReportsAndWritesADriveARow) {
  const TemporaryFolder folder;
  const std::string csv = (folder / "drives.csv").string(), trace = (folder / "trace.csv").string();
  ChildProcess child({"arena", "--kind", "corridor,parked_cars", "--policy", "dwa,bp", "--count", "3",
                      "--csv", csv, "--trace", trace});
  EXPECT_EQ(child.Wait(), 0) << child.Errors();
  for (const char* word : {"corridor", "parked_cars", "dwa", "bp", "contacts", "passable"})
    EXPECT_NE(child.Output().find(word), std::string::npos) << word;
  const std::string rows = ReadFile(csv);
  EXPECT_EQ(std::count(rows.begin(), rows.end(), '\n'), 1 + 2 * 2 * 3);
  const std::string steps = ReadFile(trace);
  EXPECT_GT(std::count(steps.begin(), steps.end(), '\n'), 2 * 2 * 3 * 100);
}

TEST(ArenaCommand, RefusesWhatItDoesNotKnow) {
  const auto refused = [](const std::vector<std::string>& arguments, const std::vector<std::string>& parts) {
    ChildProcess child(arguments);
    EXPECT_EQ(child.Wait(), 2) << child.Output();
    for (const std::string& part : parts)
      EXPECT_NE(child.Errors().find(part), std::string::npos) << part << " is not in: " << child.Errors();
  };
  refused({"arena", "--kind", "maze"}, {"--kind", "maze", "corridor"});
  refused({"arena", "--policy", "orca"}, {"--policy", "orca", "bp_dwa"});
  refused({"arena", "--policy", "sumo"}, {"--policy", "sumo"});
  refused({"arena", "--count", "0"}, {"--count", "0", "allowed"});
  refused({"arena", "--count", "500", "--trace", "t.csv"}, {"--trace", "100"});
  refused({"arena", "--bp-weights", "none.json"}, {"none.json"});
  refused({"arena", "--csv", "/nowhere/x.csv", "--count", "1", "--kind", "walls", "--policy", "dwa"},
          {"--csv"});
}

}  // namespace
}  // namespace lanewise
