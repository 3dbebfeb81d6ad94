#include "scenarios/contact_places.h"

#include <SQLiteCpp/SQLiteCpp.h>
#include <gtest/gtest.h>

#include "tests/support/crossing_net.h"
#include "tests/support/net_builder.h"
#include "tests/support/temporary_folder.h"

namespace lanewise {
namespace {

/// A results file with what the places are read from: lanes by their ids, vehicle 1 of 1.8 m and vehicle 2 of
/// 2.5 m, and contacts of theirs.
class ContactPlacesTest : public testing::Test {
 protected:
  ContactPlacesTest() {
    database_.exec(
        "CREATE TABLE lane (run_id, lane, lane_id); CREATE TABLE vehicle (run_id, vehicle_number, width_m);"
        "INSERT INTO vehicle VALUES (1, 1, 1.8), (1, 2, 2.5);"
        "CREATE TABLE collision (run_id, first_vehicle, second_vehicle, first_lane, second_lane, "
        "striking_agent, max_depth_m)");
  }
  void Add(const std::string& first_lane, const std::string& second_lane, double depth, bool agent = true) {
    SQLite::Statement insert(database_, "INSERT INTO collision VALUES (1, 1, 2, ?, ?, ?, ?)");
    insert.bind(1, NumberOf(first_lane));
    insert.bind(2, NumberOf(second_lane));
    insert.bind(3, agent ? 1 : 0);
    insert.bind(4, depth);
    insert.exec();
  }
  std::vector<ContactPlace> Find(const RoadNetwork& network) {
    return FindContactPlaces(folder_ / "results.sqlite", 1, network);
  }

 private:
  int NumberOf(const std::string& lane) {
    SQLite::Statement known(database_, "SELECT lane FROM lane WHERE lane_id = ?");
    known.bind(1, lane);
    if (known.executeStep()) return known.getColumn(0).getInt();
    SQLite::Statement insert(database_, "INSERT INTO lane SELECT 1, COUNT(*), ? FROM lane");
    insert.bind(1, lane);
    insert.exec();
    return NumberOf(lane);
  }

  TemporaryFolder folder_;
  SQLite::Database database_{(folder_ / "results.sqlite").string(),
                             SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE};
};

TEST_F(ContactPlacesTest, AreCountedByPairOfLanes) {
  Add("a_0", "b_0", 0.2);
  Add("b_0", "a_0", 0.5);
  Add("a_0", "a_0", 0.1);
  Add("b_0", "b_0", 0.1, false);  // No agent struck.
  const std::vector<ContactPlace> places = Find({});
  ASSERT_EQ(places.size(), 2u);
  EXPECT_EQ(places[0].first_lane, "a_0");
  EXPECT_EQ(places[0].second_lane, "b_0");
  EXPECT_EQ(places[0].contacts, 2);
  EXPECT_DOUBLE_EQ(places[0].max_depth, 0.5);
  EXPECT_DOUBLE_EQ(places[0].bodies_width, 2.15);
  EXPECT_FALSE(places[0].shapes_overlap());  // Neither lane is in the network.
}

// Bodies of 1.8 and 2.5 m on centre lines 2 m apart touch.
TEST_F(ContactPlacesTest, ShapesThatOverlapAreTold) {
  for (const double apart : {2.0, 3.2}) {
    NetBuilder net;
    net.AddEdge("a", 1, 100.0).AddEdge("b", 1, 100.0);
    net.network.lanes[0].shape = {{0.0, 0.0}, {100.0, 0.0}};
    net.network.lanes[1].shape = {{100.0, apart}, {0.0, apart}};
    Add("a_0", "b_0", 0.1);
    const std::vector<ContactPlace> places = Find(net.network);
    ASSERT_EQ(places.size(), 1u);
    EXPECT_NEAR(places[0].lane_distance, apart, 1e-9);
    EXPECT_EQ(places[0].shapes_overlap(), apart < 2.15);
  }
}

// Where ways cross somebody has to yield; and who is on the lane before or behind is followed.
TEST_F(ContactPlacesTest, WhereSomebodyHasToYieldShapesAreNoExcuse) {
  Add(":J_0_0", ":J_3_0", 0.1);
  Add(":J_0_0", "n_0", 0.2);
  Add(":J_0_0", "s_out_0", 0.3);
  const std::vector<ContactPlace> places = Find(PriorityCrossing());
  EXPECT_EQ(places.size(), 3u);
  for (const ContactPlace& place : places) {
    EXPECT_LT(place.lane_distance, 0.1) << place.second_lane;
    EXPECT_TRUE(place.right_of_way) << place.second_lane;
  }
}

}  // namespace
}  // namespace lanewise
