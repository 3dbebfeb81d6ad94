// `lanewise bench` programs that are about traffic, not about time.

#include <SQLiteCpp/SQLiteCpp.h>
#include <gtest/gtest.h>

#include "tests/support/child_process.h"

namespace lanewise {
namespace {

TEST(BenchSlots, PrintsDelaysAndKeepsTheRuns) {
  const TemporaryFolder folder;
  const auto results = folder / "slots.sqlite";
  ChildProcess child({"bench", "slots", "--demand", "1500", "--seeds", "1", "--results", results.string()});
  EXPECT_EQ(child.Wait(), 0) << child.Errors() << child.Output();
  EXPECT_NE(child.Output().find("    1500   all"), std::string::npos) << child.Output();
  EXPECT_NE(child.Output().find("ok: no contact, and at most 0.5 x"), std::string::npos) << child.Output();
  // By priority, each approach alone, and with slots: the same vehicles.
  const SQLite::Database database(results.string(), SQLite::OPEN_READONLY);
  std::vector<std::pair<std::string, int>> runs;
  SQLite::Statement query(database, "SELECT coordination, arrived FROM run ORDER BY run_id");
  while (query.executeStep()) runs.emplace_back(query.getColumn(0).getString(), query.getColumn(1).getInt());
  ASSERT_EQ(runs.size(), 6u);
  EXPECT_EQ(runs[0].first, "none");
  EXPECT_EQ(runs[5].first, "slots");
  EXPECT_NEAR(runs[1].second + runs[2].second + runs[3].second + runs[4].second, runs[0].second, 2);
}

}  // namespace
}  // namespace lanewise
