#include "agents/sector_net/net_score.h"

#include <gtest/gtest.h>

namespace lanewise {
namespace {

/// Answers with the first three inputs.
struct Echo {
  NetOutputs Forward(const SectorInputs& s) const { return {s[0], s[1], s[2]}; }
};

LabelledScan Scan(double left, double forward, double right, Avoidance way, double weight) {
  return {{left, forward, right}, way, weight};
}

// Weights 3, 2 and 1: rounded and largest right; only the largest right; neither.
TEST(NetScore, WorkedByHand) {
  const std::vector<LabelledScan> samples{Scan(0.9, 0.2, 0.0, Avoidance::kLeft, 3.0),
                                          Scan(0.3, 0.4, 0.1, Avoidance::kForward, 2.0),
                                          Scan(0.8, 0.1, 0.7, Avoidance::kRight, 1.0)};
  const NetScore score = ScoreNet(Echo{}, samples);
  EXPECT_EQ(score.samples, 6.0);
  EXPECT_EQ(score.rounded, 3.0);
  EXPECT_EQ(score.largest, 5.0);
  EXPECT_EQ(score.taken, (NetOutputs{3.0, 2.0, 1.0}));
  EXPECT_EQ(score.found, (NetOutputs{3.0, 2.0, 0.0}));
  EXPECT_NEAR(score.largest_error, 0.8, 1e-15);
  EXPECT_EQ(score.worst, 2u);
  // 3 (0.01 + 0.04) + 2 (0.09 + 0.36 + 0.01) + (0.64 + 0.01 + 0.09), over 3 x 6.
  EXPECT_NEAR(score.mean_squared_error, (0.15 + 0.92 + 0.74) / 18.0, 1e-15);
}

TEST(NetScore, MostPossibleIsTheMajorityOfEachScan) {
  const std::vector<LabelledScan> samples{
      Scan(1, 0, 0, Avoidance::kLeft, 2.0), Scan(1, 0, 0, Avoidance::kRight, 5.0),
      Scan(0, 1, 0, Avoidance::kForward, 1.0), Scan(1, 0, 0, Avoidance::kLeft, 1.0)};
  EXPECT_EQ(MostPossible(samples), 6.0);
}

}  // namespace
}  // namespace lanewise
