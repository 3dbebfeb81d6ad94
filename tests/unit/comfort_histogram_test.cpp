#include "analysis/comfort_histogram.h"

#include <gtest/gtest.h>

#include <map>

namespace lanewise {
namespace {

TrafficFrame FrameOf(double accel, double lateral, bool stop = false) {
  TrafficFrame frame;
  frame.Resize(2);
  frame.vehicle_number = {3, 7};  // 7 is a pedestrian: it never departs.
  frame.accel[0] = accel;
  frame.lateral_accel[0] = lateral;
  frame.planned_stop[0] = stop;
  return frame;
}

TEST(ComfortHistogram, CountsDrivingTimeByBin) {
  ComfortHistogram histogram(0.5);
  histogram.Depart(3, "dwa");
  histogram.Observe(FrameOf(99.0, 0.0));  // Insertion: means nothing.
  histogram.Observe(FrameOf(1.0, 0.1));
  histogram.Observe(FrameOf(2.1, -100.0));     // Jerk 2.2.
  histogram.Observe(FrameOf(0.0, 0.0, true));  // At a planned stop.
  histogram.Observe(FrameOf(-30.0, 0.0));      // No jerk: what was before is unknown.
  histogram.Observe(FrameOf(-29.9, 0.0));      // Jerk 0.2.
  std::map<std::pair<std::string, std::optional<double>>, HistogramRow> rows;
  for (const HistogramRow& row : histogram.Rows()) {
    EXPECT_EQ(row.policy, "dwa");
    rows[{row.measure, row.lower}] = row;
  }
  ASSERT_EQ(rows.size(), 7u);
  EXPECT_EQ((rows[{"jerk_mps3", 2.0}].vehicle_time), 0.5);
  EXPECT_EQ((rows[{"jerk_mps3", 2.0}].upper), 2.5);
  EXPECT_EQ((rows[{"jerk_mps3", 0.0}].vehicle_time), 0.5);
  EXPECT_EQ((rows[{"accel_mps2", 1.0}].vehicle_time), 0.5);
  EXPECT_EQ((rows[{"accel_mps2", 2.0}].vehicle_time), 0.5);
  EXPECT_EQ((rows[{"accel_mps2", std::nullopt}].vehicle_time), 1.0);  // Below the last bound.
  EXPECT_EQ((rows[{"accel_mps2", std::nullopt}].upper), -9.0);
  EXPECT_EQ((rows[{"lateral_accel_mps2", 0.0}].vehicle_time), 1.5);
  EXPECT_EQ((rows[{"lateral_accel_mps2", std::nullopt}].vehicle_time), 0.5);
}

TEST(ComfortHistogram, KeepsPoliciesApart) {
  ComfortHistogram histogram(0.5);
  histogram.Depart(3, "dwa");
  histogram.Depart(7, "sumo");
  for (int k = 0; k < 3; ++k) histogram.Observe(FrameOf(1.0, 0.0));
  double dwa = 0.0, sumo = 0.0;
  for (const HistogramRow& row : histogram.Rows()) {
    if (row.measure == "accel_mps2") (row.policy == "dwa" ? dwa : sumo) += row.vehicle_time;
  }
  EXPECT_EQ(dwa, 1.0);
  EXPECT_EQ(sumo, 1.0);
}

}  // namespace
}  // namespace lanewise
