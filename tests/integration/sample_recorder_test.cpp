// Samples recorded from a run: who is where across the road, and a run with everything together.

#include "scenarios/sample_recorder.h"

#include <gtest/gtest.h>

#include "agents/core/check.h"
#include "agents/sector_net/samples.h"
#include "scenarios/run.h"
#include "tests/support/small_nets.h"
#include "tests/support/temporary_folder.h"

namespace lanewise {
namespace {

// Three lanes of 3.2 m. An agent joins the lane to its left at once, its body comes over later: d jumps, the
// place across the road does not. SUMO's own vehicles jump by a lane.
TEST(LateralTrack, ChangesOfLanesAreMovementsOfTheBody) {
  const RoadNetwork network = ChainNet(2, 3, 100.0);
  const LaneIndex first = network.edges[network.FindEdge("e0")].first_lane;
  LateralTrack agent;
  agent.Follow(network, first, 0.0, 1.0);
  const double begin = agent.lateral();
  agent.Follow(network, first, 0.1, 1.0);
  agent.Follow(network, first + 1, 0.2 - network.lanes[first].width, 1.0);
  EXPECT_NEAR(agent.lateral() - begin, 0.2, 1e-12);
  agent.Follow(network, first + 1, 0.0, 1.0);
  EXPECT_NEAR(agent.lateral() - begin, 3.2, 1e-12);
  EXPECT_EQ(agent.distance(), 4.0);
  // On to the next edge: the way goes on.
  agent.Follow(network, network.edges[network.FindEdge("e1")].first_lane + 1, 0.0, 1.0);
  EXPECT_NEAR(agent.lateral() - begin, 3.2, 1e-12);

  LateralTrack native;
  native.Follow(network, first + 2, 0.0, 1.0);
  const double there = native.lateral();
  native.Follow(network, first, 0.0, 1.0);
  EXPECT_NEAR(native.lateral() - there, -6.4, 1e-12);
  EXPECT_EQ(WayTaken(native.lateral() - there, 0.4), Avoidance::kRight);
}

TEST(LateralTrack, APartEndsWhereTheVehicleIsLost) {
  const RoadNetwork network = ChainNet(1, 1, 100.0);
  LateralTrack track;
  track.Follow(network, 0, 0.5, 1.0);
  const int part = track.part();
  track.Lose();
  EXPECT_FALSE(track.on_road());
  track.Follow(network, 0, 0.0, 1.0);
  EXPECT_NE(track.part(), part);
}

TEST(LateralTrack, WaysAreTakenFromTheShiftOn) {
  EXPECT_EQ(WayTaken(0.4, 0.4), Avoidance::kLeft);
  EXPECT_EQ(WayTaken(0.39, 0.4), Avoidance::kForward);
  EXPECT_EQ(WayTaken(-0.39, 0.4), Avoidance::kForward);
  EXPECT_EQ(WayTaken(-0.4, 0.4), Avoidance::kRight);
}

RunConfig Street(const std::filesystem::path& samples, int threads) {
  RunConfig config;
  config.config_file = FindShippedScenario("breakdown");
  config.end = 60.0;
  config.threads = threads;
  config.quiet = true;
  config.samples_file = samples;
  Resolve(&config);
  return config;
}

// On the street with broken-down cars, vehicles pass these on the left; the same samples for every number of
// threads, and the run is the same as without recording.
TEST(SampleRecorder, RecordsTheWaysOfARun) {
  const TemporaryFolder folder;
  const RunReport report = lanewise::Run(Street(folder / "one.csv", 1));
  const auto samples = LoadSamples(folder / "one.csv");
  EXPECT_EQ(static_cast<std::int64_t>(samples.size()), report.samples);
  ASSERT_GT(samples.size(), 50u);
  std::array<int, kNetOutputs> ways{};
  for (const LabelledScan& sample : samples) ++ways[static_cast<std::size_t>(sample.way)];
  EXPECT_GT(ways[0], 0);
  EXPECT_GT(ways[1], 0);
  const std::string text = ReadFile(folder / "one.csv");
  EXPECT_NE(text.find("policy dwa, seed 23423"), std::string::npos);
  EXPECT_THROW(Street(folder / "one.csv", 1), ConfigError);  // It exists now.
  EXPECT_EQ(ReadFile(folder / "one.csv"), text);
}

TEST(SampleRecorder, DoesNotDependOnThreadsNorChangeTheRun) {
  const TemporaryFolder folder;
  RunConfig plain = Street(folder / "none.csv", 2);
  plain.samples_file.reset();
  const std::uint64_t hash = lanewise::Run(plain).outcome.state_hash;
  EXPECT_EQ(lanewise::Run(Street(folder / "two.csv", 2)).outcome.state_hash, hash);
  lanewise::Run(Street(folder / "one.csv", 1));
  EXPECT_EQ(ReadFile(folder / "one.csv"), ReadFile(folder / "two.csv"));
}

}  // namespace
}  // namespace lanewise
