// What the roadside units coordinate, on SUMO's signals and routes.

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <pugixml.hpp>

#include "agents/core/check.h"
#include "tests/support/sumo_run.h"

namespace lanewise {
namespace {

RunConfig Coordinated(const std::string& scenario, const std::string& what, double end) {
  RunConfig config = ShippedRun(scenario, Policy::kDwa, end);
  config.v2x = V2xLevel::kRange;
  config.coordinate = ParseCoordination(what);
  return config;
}

std::int64_t Count(const RunReport& report, CoordinationKind kind) {
  return report.coordination[static_cast<std::size_t>(kind)];
}

TEST(Coordination, WithoutMessagesNothingIsDifferent) {
  for (const std::string scenario : {"arterial", "town"}) {
    const RunReport off = RunResolved(ShippedRun(scenario, Policy::kDwa, 100.0));
    RunConfig deaf = Coordinated(scenario, "green-advice,signals,dispatch", 100.0);
    deaf.params.v2x.range = 0.0;
    deaf.coordination.dispatch.crowded_speed = 1.0;
    deaf.coordination.dispatch.crowded_density = 0.0;
    const RunReport out_of_range = RunResolved(deaf);
    EXPECT_EQ(out_of_range.outcome.state_hash, off.outcome.state_hash) << scenario;
    deaf.params.v2x.range = 300.0;
    deaf.params.v2x.loss = 1.0;
    deaf.v2x = V2xLevel::kLossy;
    const RunReport lost = RunResolved(deaf);
    EXPECT_EQ(lost.outcome.state_hash, off.outcome.state_hash) << scenario;
    for (const std::int64_t count : lost.coordination) EXPECT_EQ(count, 0);
  }
}

TEST(Coordination, GreenAdviceSavesStops) {
  const TemporaryFolder folder;
  RunConfig config = Coordinated("arterial", "none", 300.0);
  config.results = folder / "wave.sqlite";
  RunResolved(config);
  config.coordinate = ParseCoordination("green-advice");
  const RunReport advised = RunResolved(config);
  EXPECT_EQ(MidBlock(advised).different, 0);
  EXPECT_GT(Count(advised, CoordinationKind::kAdviceFollowed), 30);
  const std::string stops = "SELECT SUM(waiting_count) FROM trip WHERE run_id = ";
  EXPECT_LT(Query(*config.results, stops + "2"), 0.8 * Query(*config.results, stops + "1"));
  EXPECT_EQ(Query(*config.results, "SELECT COUNT(*) FROM coordination_event WHERE kind = 'advice_followed'"),
            static_cast<double>(Count(advised, CoordinationKind::kAdviceFollowed)));
  EXPECT_EQ(Query(*config.results, "SELECT coordination = 'green-advice' FROM run WHERE run_id = 2"), 1.0);
}

TEST(Coordination, IsTheSameForAnyThreads) {
  RunConfig config = Coordinated("arterial", "green-advice,signals,dispatch", 150.0);
  config.v2x = V2xLevel::kLossy;
  const std::uint64_t one = RunResolved(config).outcome.state_hash;
  config.threads = 3;
  EXPECT_EQ(RunResolved(config).outcome.state_hash, one);
}

// The signals' states as SUMO itself wrote them down.
TEST(Coordination, AdaptedSignalsKeepTheirSafetyTimes) {
  const TemporaryFolder folder;
  const auto states = folder / "states.xml";
  std::string events = "<additional>";
  for (int k = 1; k <= 6; ++k)
    events +=
        fmt::format("<timedEvent type=\"SaveTLSStates\" source=\"J{}\" dest=\"{}\"/>", k, states.string());
  const auto additional = folder.Write("states.add.xml", events + "</additional>");
  RunConfig config = OwnDemand("arterial", ShippedFile("arterial", ".rou.xml"), Policy::kDwa, 500.0);
  config.additional_files = additional.string();
  config.v2x = V2xLevel::kRange;
  config.coordinate = ParseCoordination("signals");
  const RunReport report = RunResolved(config);
  EXPECT_GT(Count(report, CoordinationKind::kSignalPlan) + Count(report, CoordinationKind::kSignalOffset), 5);
  EXPECT_EQ(MidBlock(report).different, 0);

  pugi::xml_document document;
  ASSERT_TRUE(document.load_file(states.c_str()));
  struct Run {
    std::string state;
    double begin;
  };
  std::map<std::string, std::vector<Run>> runs;  // By signal: each state once, with its begin.
  for (const pugi::xml_node state : document.child("tlsStates").children("tlsState")) {
    std::vector<Run>& of = runs[state.attribute("id").as_string()];
    const std::string text = state.attribute("state").as_string();
    if (of.empty() || of.back().state != text) of.push_back({text, state.attribute("time").as_double()});
  }
  ASSERT_EQ(runs.size(), 6u);
  int changed = 0;
  for (const auto& [signal, of] : runs) {
    for (std::size_t k = 1; k + 1 < of.size(); ++k) {
      const double lasted = of[k + 1].begin - of[k].begin;
      const bool yellow = of[k].state.find('y') != std::string::npos;
      const bool green = of[k].state.find('G') != std::string::npos;
      if (green && !yellow) {
        EXPECT_GE(lasted, 5.0 - 1e-6) << signal << " at " << of[k].begin;
        changed +=
            std::abs(lasted - std::round(lasted)) < 1e-6 && lasted != 41.0 && lasted != 9.0 && lasted != 25.0;
      } else {
        EXPECT_NEAR(lasted, yellow ? 3.0 : 2.0, 1e-6) << signal << " at " << of[k].begin;
      }
    }
  }
  EXPECT_GT(changed, 5);
}

TEST(Coordination, AnUnsafeProgramIsRefusedByName) {
  const TemporaryFolder folder;
  const auto additional = folder.Write("unsafe.add.xml", R"(<additional>
      <tlLogic id="J3" type="static" programID="hasty" offset="0">
        <phase duration="40" state="rrrGGGrrrrGGGr"/><phase duration="1" state="rrryyyrrrryyyr"/>
        <phase duration="20" state="GGgrrrrGGgrrrr"/><phase duration="3" state="yyyrrrryyyrrrr"/>
      </tlLogic></additional>)");
  RunConfig config = OwnDemand("arterial", ShippedFile("arterial", ".rou.xml"), Policy::kDwa, 100.0);
  config.additional_files = additional.string();
  config.v2x = V2xLevel::kRange;
  config.coordinate = ParseCoordination("signals");
  try {
    RunResolved(config);
    FAIL() << "accepted";
  } catch (const ConfigError& error) {
    const std::string text = error.what();
    EXPECT_NE(text.find("signal 'J3', phase 1"), std::string::npos) << text;
    EXPECT_NE(text.find("yellow for 1 s"), std::string::npos) << text;
  }
}

// Everything counts as crowded: who may be held is, and is let go in time; who has another way takes it.
TEST(Coordination, TheDispatcherHoldsAndReroutes) {
  const TemporaryFolder folder;
  RunConfig config = Coordinated("town", "dispatch", 400.0);
  config.results = folder / "town.sqlite";
  config.coordination.dispatch.crowded_speed = 0.9;
  config.coordination.dispatch.relieved_speed = 0.95;
  config.coordination.dispatch.crowded_density = 0.0;
  config.coordination.dispatch.share = 1.0;
  config.coordination.dispatch.max_hold = 40.0;
  config.coordination.dispatch.min_gain = 0.02;
  const RunReport report = RunResolved(config);
  EXPECT_EQ(MidBlock(report).different, 0);
  EXPECT_GT(Count(report, CoordinationKind::kHold), 5);
  EXPECT_GT(Count(report, CoordinationKind::kReroute), 5);
  EXPECT_GT(report.outcome.arrived, 50);
  // Held once at most, and arrived though held.
  EXPECT_EQ(Query(*config.results,
                  "SELECT COUNT(*) FROM (SELECT 1 FROM coordination_event WHERE kind = 'hold' GROUP BY "
                  "vehicle_number "
                  "HAVING COUNT(*) > 1)"),
            0.0);
  EXPECT_GT(
      Query(
          *config.results,
          "SELECT COUNT(*) FROM trip WHERE trip_end = 'arrived' AND stop_time_s > 5 AND stop_time_s < 60 AND "
          "vehicle_number IN (SELECT vehicle_number FROM coordination_event WHERE kind = 'hold')"),
      0.0);
}

RunConfig WithSlots(const std::string& what, double scale) {
  RunConfig config = Coordinated("priority_crossing", what, 300.0);
  config.rules = Rules::kAgent;
  config.sumo_options = {"--scale", fmt::format("{}", scale)};
  return config;
}

// Half as much again as its demand: the minor road waits for gaps that slots make.
TEST(Coordination, SlotsSaveDelayAtTheCrossing) {
  const TemporaryFolder folder;
  RunConfig config = WithSlots("none", 1.5);
  config.results = folder / "slots.sqlite";
  RunResolved(config);
  config.coordinate = ParseCoordination("slots");
  EXPECT_EQ(MidBlock(RunResolved(config)).different, 0);
  const std::string trips = " FROM trip WHERE trip_end = 'arrived' AND run_id = ";
  EXPECT_LT(Query(*config.results, "SELECT AVG(time_loss_s)" + trips + "2"),
            0.7 * Query(*config.results, "SELECT AVG(time_loss_s)" + trips + "1"));
  EXPECT_GE(Query(*config.results, "SELECT COUNT(*)" + trips + "2"),
            Query(*config.results, "SELECT COUNT(*)" + trips + "1"));
  EXPECT_EQ(Query(*config.results, "SELECT COUNT(*) FROM collision WHERE run_id = 2"), 0.0);
}

TEST(Coordination, SlotsThatNobodyHearsChangeNothing) {
  RunConfig off = WithSlots("none", 1.0);
  off.v2x = V2xLevel::kOff;
  RunConfig deaf = WithSlots("slots", 1.0);
  deaf.v2x = V2xLevel::kLossy;
  deaf.params.v2x.loss = 1.0;
  RunConfig out_of_range = WithSlots("slots", 1.0);
  out_of_range.params.v2x.range = 0.0;
  const std::uint64_t without = RunResolved(off).outcome.state_hash;
  EXPECT_EQ(RunResolved(deaf).outcome.state_hash, without);
  EXPECT_EQ(RunResolved(out_of_range).outcome.state_hash, without);
}

// Half of the vehicles have no radio, and half of the messages are lost.
TEST(Coordination, SlotsHalfHeardBringNoContacts) {
  const TemporaryFolder folder;
  RunConfig config = WithSlots("slots", 1.3);
  config.v2x = V2xLevel::kLossy;
  config.params.v2x.share = 0.5;
  config.params.v2x.loss = 0.5;
  config.results = folder / "half.sqlite";
  RunResolved(config);
  EXPECT_EQ(Query(*config.results, "SELECT COUNT(*) FROM collision"), 0.0);
  EXPECT_GT(Query(*config.results, "SELECT COUNT(*) FROM trip WHERE trip_end = 'arrived'"), 60.0);
}

TEST(Coordination, SlotsAreTheSameForAnyThreads) {
  RunConfig config = WithSlots("slots", 2.0);
  config.end = 120.0;
  std::vector<std::uint64_t> hashes;
  for (const int threads : {1, 2, 4}) {
    config.threads = threads;
    hashes.push_back(RunResolved(config).outcome.state_hash);
  }
  EXPECT_EQ(hashes[1], hashes[0]);
  EXPECT_EQ(hashes[2], hashes[0]);
}

TEST(Coordination, JunctionsOfSlotsAreChecked) {
  const auto message = [](RunConfig config) {
    try {
      RunResolved(std::move(config));
    } catch (const ConfigError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_NE(message(WithSlots("slots:nowhere", 1.0)).find("no junction 'nowhere'"), std::string::npos);
  RunConfig signals = Coordinated("arterial", "slots:J3", 10.0);
  signals.rules = Rules::kAgent;
  EXPECT_NE(message(signals).find("junction 'J3' (traffic_light) has signals"), std::string::npos);
  signals.rules = Rules::kSumo;
  EXPECT_NE(message(signals).find("--rules agent"), std::string::npos);
}

TEST(Coordination, NamesAreChecked) {
  EXPECT_EQ(CoordinationText(ParseCoordination("none")), "none");
  EXPECT_EQ(CoordinationText(ParseCoordination("dispatch,green-advice")), "green-advice,dispatch");
  EXPECT_THROW(ParseCoordination("green-advise"), ConfigError);
  EXPECT_THROW(ParseCoordination("signals,"), ConfigError);
  EXPECT_THROW(ParseCoordination(""), ConfigError);
}

}  // namespace
}  // namespace lanewise
