// rules = agent: SUMO's checks are off everywhere, and the agents answer for signals and right of way.

#include <gtest/gtest.h>

#include "tests/support/sumo_run.h"

namespace lanewise {
namespace {

std::int64_t Count(const RunReport& report, RuleEventKind kind) {
  return report.rule_events[static_cast<std::size_t>(kind)];
}

RunConfig ByAgents(const std::string& scenario, double end) {
  RunConfig config = ShippedRun(scenario, Policy::kDwa, end);
  config.rules = Rules::kAgent;
  return config;
}

class OwnRules : public testing::TestWithParam<const char*> {};

TEST_P(OwnRules, AllArriveWithoutAContactAndNotSlowerThanNatively) {
  const TemporaryFolder folder;
  RunConfig config = ByAgents(GetParam(), 1200.0);
  config.results = folder / "agent.sqlite";
  const RunReport report = RunResolved(config);
  config.policy = Policy::kSumo;
  config.results = folder / "native.sqlite";
  const RunReport native = RunResolved(config);
  EXPECT_EQ(report.outcome.arrived, native.outcome.arrived);
  EXPECT_GT(report.outcome.arrived, 100);
  EXPECT_EQ(report.outcome.teleported, 0);
  EXPECT_EQ(MidBlock(report).different, 0);
  EXPECT_EQ(Count(report, RuleEventKind::kRedLight), 0);
  EXPECT_EQ(Count(report, RuleEventKind::kStandstill), 0);
  EXPECT_EQ(Query(folder / "agent.sqlite", "SELECT COUNT(*) FROM collision"), 0.0);
  const char* loss = "SELECT AVG(time_loss_s) FROM trip WHERE trip_end = 'arrived'";
  EXPECT_LT(Query(folder / "agent.sqlite", loss), 1.1 * Query(folder / "native.sqlite", loss));
  // No check of SUMO's guards a junction.
  EXPECT_EQ(report.audit.by_cause[static_cast<std::size_t>(AuditCause::kJunctionGuard)].steps, 0);
}

INSTANTIATE_TEST_SUITE_P(Networks, OwnRules, testing::Values("priority_crossing", "roundabout"));

// Where a turn passes the kerb at which persons wait, the lanes' own shapes leave no room for a car's body.
TEST(OwnRules, NobodyRunsARedLightInTheTownAndCarsDoNotTouch) {
  const TemporaryFolder folder;
  RunConfig config = ByAgents("town", 200.0);
  config.results = folder / "town.sqlite";
  const RunReport report = RunResolved(config);
  EXPECT_EQ(Count(report, RuleEventKind::kRedLight), 0);
  EXPECT_EQ(Count(report, RuleEventKind::kStandstill), 0);
  EXPECT_EQ(MidBlock(report).different, 0);
  EXPECT_GT(report.outcome.arrived, 50);
  EXPECT_EQ(Query(*config.results,
                  "SELECT COUNT(*) FROM collision JOIN vehicle AS a ON a.vehicle_number = first_vehicle JOIN "
                  "vehicle AS b ON b.vehicle_number = second_vehicle WHERE a.vclass <> 'pedestrian' AND "
                  "b.vclass <> 'pedestrian'"),
            0.0);
}

// Of two that come to a red light one does not care: a native vehicle told so.
TEST(OwnRules, WhoRunsARedLightIsInTheResults) {
  const TemporaryFolder folder;
  const auto routes = folder.Write("red.rou.xml", R"(<routes>
      <vType id="reckless" jmDriveAfterRedTime="1000"><param key="lanewise.policy" value="sumo"/></vType>
      <vType id="careful"/>
      <vehicle id="a" type="reckless" depart="0" departSpeed="max"><route edges="N1_J1 J1_S1"/></vehicle>
      <vehicle id="b" type="careful" depart="0" departSpeed="max"><route edges="S1_J1 J1_N1"/></vehicle>
      </routes>)");
  RunConfig config = OwnDemand("arterial", routes, Policy::kDwa, 150.0);
  config.rules = Rules::kAgent;
  config.results = folder / "red.sqlite";
  const RunReport report = RunResolved(config);
  EXPECT_EQ(report.outcome.arrived, 2);
  EXPECT_EQ(Count(report, RuleEventKind::kRedLight), 1);
  EXPECT_EQ(
      Query(*config.results,
            "SELECT COUNT(*) FROM rule_event JOIN vehicle USING (run_id, vehicle_number) JOIN lane USING "
            "(run_id, lane) WHERE kind = 'red_light' AND vehicle_id = 'a' AND lane_id = 'N1_J1_0'"),
      1.0);
  EXPECT_EQ(Query(*config.results, "SELECT red_lights_run FROM v_run_metrics"), 1.0);
  EXPECT_EQ(Query(*config.results, "SELECT red_lights_run FROM v_run_summary"), 1.0);
  EXPECT_EQ(Query(*config.results, "SELECT COUNT(*) FROM rule_event"), 1.0);
}

TEST(OwnRules, SumoIsPassiveOnlyWhereAgentsDriveEverything) {
  const RunConfig passive = ByAgents("priority_crossing", 10.0);
  EXPECT_DOUBLE_EQ(PassiveActionStep(passive), 1.0);
  RunConfig other = passive;
  other.penetration = 0.9;
  EXPECT_EQ(PassiveActionStep(other), 0.0);
  other = passive;
  other.policy = Policy::kSumo;
  EXPECT_EQ(PassiveActionStep(other), 0.0);
  other = passive;
  other.rules = Rules::kSumo;
  EXPECT_EQ(PassiveActionStep(other), 0.0);
  other = passive;
  other.sumo_options = {"--default.action-step-length", "0.1"};
  EXPECT_EQ(PassiveActionStep(other), 0.0);
}

// Of what stands in a junction agents see the body, native vehicles do not; and agents come to yield lines
// more slowly.
TEST(SumosRules, BlockersAndGapsAreLeftToAgentsWhereTheyDriveEverything) {
  const std::pair<const char*, const char*> options[] = {{"--ignore-junction-blocker", "10"},
                                                         {"--time-to-impatience", "60"}};
  for (const auto& [option, value] : options) {
    const auto has = [&option = option](const RunConfig& config, const char* wanted) {
      const std::vector<std::string> line = SumoCommandLine(config);
      const auto found = std::find(line.begin(), line.end(), option);
      return found != line.end() && *(found + 1) == wanted &&
             std::find(found + 1, line.end(), *found) == line.end();
    };
    RunConfig config = ByAgents("roundabout", 10.0);
    EXPECT_FALSE(has(config, value)) << option;
    config.rules = Rules::kSumo;
    EXPECT_TRUE(has(config, value)) << option;
    RunConfig other = config;
    other.penetration = 0.9;
    EXPECT_FALSE(has(other, value)) << option;
    other = config;
    other.policy = Policy::kSumo;
    EXPECT_FALSE(has(other, value)) << option;
    other = config;
    other.sumo_options = {option, "90"};
    EXPECT_TRUE(has(other, "90")) << option;
  }
}

TEST(OwnRules, AnActionStepOfTheUsersLeavesCommandsExact) {
  for (const Rules rules : {Rules::kSumo, Rules::kAgent}) {
    RunConfig config = ByAgents("roundabout", 60.0);
    config.rules = rules;
    config.sumo_options = {"--default.action-step-length", "0.5"};
    const RunReport report = RunResolved(config);
    EXPECT_GT(MidBlock(report).steps, 1000);
    EXPECT_EQ(MidBlock(report).different, 0);
  }
}

// Half of the vehicles are SUMO's: each kind gives the other its right of way.
TEST(OwnRules, AgentsAndNativeVehiclesRespectEachOther) {
  const TemporaryFolder folder;
  RunConfig config = ByAgents("priority_crossing", 1200.0);
  config.penetration = 0.5;
  config.results = folder / "mixed.sqlite";
  const RunReport report = RunResolved(config);
  EXPECT_EQ(report.outcome.arrived, report.outcome.inserted);
  EXPECT_GT(report.outcome.arrived, 100);
  EXPECT_EQ(report.outcome.policy_shares.size(), 2u);
  EXPECT_EQ(Query(*config.results, "SELECT COUNT(*) FROM collision"), 0.0);
  EXPECT_EQ(Count(report, RuleEventKind::kStandstill), 0);
}

}  // namespace
}  // namespace lanewise
