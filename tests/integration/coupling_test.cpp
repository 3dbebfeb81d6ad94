#include <fmt/core.h>
#include <gtest/gtest.h>

#include <pugixml.hpp>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>
#include <string>

#include "tests/support/sumo_run.h"

namespace lanewise {
namespace {

TEST(Coupling, TheTownUnderDwaIsDrivenByItsAgentsExactly) {
  const RunReport report = RunResolved(ShippedRun("town", Policy::kDwa, 120.0));
  EXPECT_EQ(report.outcome.status, RunStatus::kFinished);
  EXPECT_EQ(MidBlock(report).different, 0);
  EXPECT_LT(MidBlock(report).max_position_error, CouplingAudit::kTolerance);
  EXPECT_GT(MidBlock(report).steps, 10000);
  EXPECT_EQ(report.outcome.teleported, 0);
  EXPECT_GT(report.outcome.inserted, 50);
  EXPECT_NEAR(report.outcome.simulated_time, 120.0, 0.11);
  // Each and every vehicle has an agent; it is off only around planned stops (the buses).
  ASSERT_EQ(report.outcome.policy_shares.size(), 1u);
  EXPECT_EQ(report.outcome.policy_shares[0].policy, "dwa");
  EXPECT_EQ(report.outcome.policy_shares[0].vehicles, report.outcome.inserted);
  EXPECT_GT(static_cast<double>(report.outcome.agent_steps),
            0.97 * static_cast<double>(report.outcome.vehicle_steps));
}

TEST(Coupling, EveryShippedNetworkRunsCleanly) {
  for (const std::string& name : ShippedScenarios()) {
    const RunReport report = RunResolved(ShippedRun(name, Policy::kDwa, 60.0));
    EXPECT_EQ(MidBlock(report).different, 0) << name;
    EXPECT_EQ(report.outcome.teleported, 0) << name;
    EXPECT_GT(report.outcome.inserted, 0) << name;
  }
}

TEST(Coupling, ANativeRunHasNoAgentAtAll) {
  const RunReport report = RunResolved(ShippedRun("town", Policy::kSumo, 60.0));
  EXPECT_EQ(report.outcome.agent_steps, 0);
  EXPECT_GT(report.outcome.vehicle_steps, 0);
  for (const AuditCount& count : report.audit.by_cause) EXPECT_EQ(count.steps, 0);
}

struct SumoTrip {
  double duration, time_loss, depart, route_length, depart_delay;
};

// Our trip figures of a native run against SUMO's own tripinfo output of the same run.
TEST(Coupling, NativeTripFiguresAgreeWithSumosTripinfo) {
  const TemporaryFolder folder;
  const auto results = folder / "native.sqlite", tripinfo = folder / "trips.xml";
  RunConfig config = ShippedRun("town", Policy::kSumo, 400.0);
  config.results = results;
  config.sumo_options = {"--tripinfo-output", tripinfo.string()};
  const RunReport report = RunResolved(config);

  std::map<std::string, SumoTrip> sumo;
  pugi::xml_document document;
  ASSERT_TRUE(document.load_file(tripinfo.c_str()));
  double sumo_loss = 0.0;
  for (const pugi::xml_node trip : document.child("tripinfos").children("tripinfo")) {
    sumo[trip.attribute("id").as_string()] = {
        trip.attribute("duration").as_double(), trip.attribute("timeLoss").as_double(),
        trip.attribute("depart").as_double(), trip.attribute("routeLength").as_double(),
        trip.attribute("departDelay").as_double()};
    sumo_loss += trip.attribute("timeLoss").as_double();
  }
  EXPECT_GT(sumo.size(), 100u);
  EXPECT_EQ(static_cast<std::size_t>(report.outcome.arrived), sumo.size());

  SQLite::Database database(results.string(), SQLite::OPEN_READONLY);
  SQLite::Statement query(database,
                          "SELECT vehicle_id, duration_s, time_loss_s, trip.depart_s, route_length_m, "
                          "trip.depart_delay_s FROM trip JOIN "
                          "vehicle USING (run_id, vehicle_number) WHERE trip_end = 'arrived'");
  double our_loss = 0.0;
  std::size_t compared = 0;
  while (query.executeStep()) {
    const auto it = sumo.find(query.getColumn(0).getString());
    ASSERT_NE(it, sumo.end()) << query.getColumn(0).getString();
    ++compared;
    EXPECT_NEAR(query.getColumn(1).getDouble(), it->second.duration, 0.1 + 1e-6) << it->first;
    EXPECT_NEAR(query.getColumn(3).getDouble(), it->second.depart, 0.1 + 1e-6) << it->first;
    // Within what is driven in the last, unseen step, and 1 %.
    EXPECT_NEAR(query.getColumn(4).getDouble(), it->second.route_length, 3.0 + 0.01 * it->second.route_length)
        << it->first;
    EXPECT_NEAR(query.getColumn(5).getDouble(), it->second.depart_delay, 0.1 + 1e-6) << it->first;
    our_loss += query.getColumn(2).getDouble();
  }
  EXPECT_EQ(compared, sumo.size());
  const double mean_sumo = sumo_loss / static_cast<double>(sumo.size());
  EXPECT_NEAR(our_loss / static_cast<double>(compared), mean_sumo, 0.01 * mean_sumo);
}

/// The priority crossing with lanes a quarter longer for SUMO than their shapes are, as bends are in many
/// nets.
class StretchedLanes : public testing::Test {
 protected:
  /// @return the samples of vehicle "a", every step, under SUMO's rules.
  SQLite::Database Drive(double stretch, const std::string& vehicles) {
    pugi::xml_document net;
    EXPECT_TRUE(net.load_file(ShippedFile("priority_crossing", ".net.xml").c_str()));
    for (const pugi::xml_node edge : net.child("net").children("edge")) {
      for (const pugi::xml_node lane : edge.children("lane"))
        lane.attribute("length").set_value(stretch * lane.attribute("length").as_double());
    }
    const auto net_file = folder_ / "stretched.net.xml", results = folder_ / "stretched.sqlite";
    EXPECT_TRUE(net.save_file(net_file.c_str()));
    const auto routes = folder_.Write("stretched.rou.xml", "<routes>" + vehicles + "</routes>");
    RunConfig config = OwnDemand("priority_crossing", routes, Policy::kDwa, 60.0);
    config.net_file = net_file;
    config.sample_period = 0.0;
    config.results = results;
    RunResolved(config);
    return {results.string(), SQLite::OPEN_READONLY};
  }

  TemporaryFolder folder_;
};

// SUMO's checks hold its command back by a little: that must not cost what it has gained since the last step.
TEST_F(StretchedLanes, WhoIsHeldBackALittleStillGainsSpeed) {
  SQLite::Database database = Drive(1.25, R"(<vType id="car" accel="2.6" sigma="0"/>
      <vehicle id="a" type="car" depart="0" departPos="-1" departSpeed="0"><route edges="south_in north_out"/></vehicle>)");
  // 6 m/s at 2.6 m/s^2, the first of it on a lane of 1.25 times the length, and the lag of the drive.
  const double time =
      database.execAndGet("SELECT MIN(time_s) FROM trajectory WHERE speed_mps >= 6.0").getDouble();
  EXPECT_GT(time, 2.0);
  EXPECT_LT(time, 4.0);
}

// And where SUMO brakes less hard than it is told to, the agent knows how fast it still is.
TEST_F(StretchedLanes, TheSpeedIsThatOfTheMotion) {
  SQLite::Database database = Drive(2.0, R"(<vType id="car" decel="2.0" sigma="0"/>
      <vehicle id="b" type="car" depart="0" departPos="-20" departSpeed="0"><route edges="south_in north_out"/>
        <stop lane="south_in_0" endPos="-10" duration="100"/></vehicle>
      <vehicle id="a" type="car" depart="1" departPos="-200" departSpeed="max"><route edges="south_in north_out"/></vehicle>)");
  SQLite::Statement rows(database,
                         "SELECT time_s, x_m, y_m, speed_mps FROM trajectory JOIN vehicle USING (run_id, "
                         "vehicle_number) WHERE vehicle_id = 'a' ORDER BY time_s");
  double last_x = 0.0, last_y = 0.0, slowest = 1e9;
  for (int k = 0; rows.executeStep(); ++k) {
    const double x = rows.getColumn(1).getDouble(), y = rows.getColumn(2).getDouble();
    const double speed = rows.getColumn(3).getDouble();
    if (k > 0) {
      EXPECT_NEAR(std::hypot(x - last_x, y - last_y) / 0.1, speed, 0.3)
          << rows.getColumn(0).getDouble() << " s";
    }
    last_x = x;
    last_y = y;
    slowest = std::min(slowest, speed);
  }
  EXPECT_LT(slowest, 5.0);  // It had to brake.
}

TEST(Results, RowsAreConsistent) {
  const TemporaryFolder folder;
  const auto file = folder / "town.sqlite";
  RunConfig config = ShippedRun("town", Policy::kDwa, 100.0);
  config.results = file;
  const RunReport report = RunResolved(config);
  const RunOutcome& o = report.outcome;

  const auto runs = [&] {
    SQLite::Database database(file.string(), SQLite::OPEN_READONLY);
    EXPECT_EQ(database.execAndGet("PRAGMA integrity_check").getString(), "ok");
    EXPECT_EQ(database.execAndGet("SELECT state_hash FROM run").getString(),
              fmt::format("{:016x}", o.state_hash));
    EXPECT_EQ(database.execAndGet("SELECT status FROM run").getString(), "finished");
    return LoadRunSummaries(file);
  }();
  ASSERT_EQ(runs.size(), 1u);
  EXPECT_EQ(runs[0].run_id, report.run_id);
  EXPECT_EQ(Query(file, "SELECT inserted FROM run"), static_cast<double>(o.inserted));
  EXPECT_EQ(Query(file, "SELECT COUNT(*) FROM vehicle WHERE vclass <> 'pedestrian'"),
            static_cast<double>(o.inserted));
  EXPECT_GT(Query(file, "SELECT COUNT(*) FROM vehicle WHERE vclass = 'pedestrian' AND policy = 'sumo'"), 0.0);
  EXPECT_EQ(Query(file,
                  "SELECT COUNT(*) FROM trip JOIN vehicle USING (run_id, vehicle_number) WHERE vclass <> "
                  "'pedestrian'"),
            static_cast<double>(o.inserted));
  EXPECT_EQ(Query(file, "SELECT COUNT(*) FROM trip WHERE trip_end = 'arrived'"),
            static_cast<double>(o.arrived));
  EXPECT_EQ(Query(file, "SELECT COUNT(*) FROM trip WHERE trip_end = 'running'"),
            static_cast<double>(o.still_running));
  EXPECT_EQ(o.inserted, o.arrived + o.still_running + o.vaporized);
  // A trip counts the steps driven, the run the states seen: one more a vehicle, the one it was inserted in.
  EXPECT_EQ(Query(file, "SELECT SUM(steps) FROM trip"), static_cast<double>(o.vehicle_steps - o.inserted));
  EXPECT_EQ(Query(file, "SELECT SUM(vehicle_steps) FROM policy_share"), static_cast<double>(o.vehicle_steps));
  EXPECT_EQ(Query(file, "SELECT SUM(agent_steps) FROM policy_share"), static_cast<double>(o.agent_steps));
  EXPECT_EQ(Query(file, "SELECT COUNT(*) FROM trajectory"), Query(file, "SELECT trajectory_rows FROM run"));
  EXPECT_EQ(Query(file, "SELECT COUNT(*) FROM step_summary"), 100.0);  // One a second.
  EXPECT_EQ(Query(file, "SELECT MAX(arrived) FROM step_summary") <= static_cast<double>(o.arrived), true);
  // Every sample lies within its vehicle's trip and on a lane that is listed.
  EXPECT_EQ(Query(file,
                  "SELECT COUNT(*) FROM trajectory t JOIN trip USING (run_id, vehicle_number) "
                  "WHERE t.time_s < depart_s - 0.11 OR t.time_s > COALESCE(arrival_s, 1e9) + 0.11"),
            0.0);
  EXPECT_EQ(Query(file,
                  "SELECT COUNT(*) FROM trajectory t LEFT JOIN lane USING (run_id, lane) WHERE t.lane IS NOT "
                  "NULL AND lane_id IS NULL"),
            0.0);
  EXPECT_EQ(Query(file, "SELECT COUNT(*) FROM trajectory WHERE speed_mps < 0"), 0.0);
}

// The schema says of table vehicle: every vehicle and pedestrian that entered.
TEST(Results, EveryNumberInTheTrajectoriesHasItsMeaning) {
  const TemporaryFolder folder;
  const auto file = folder / "town.sqlite";
  RunConfig config = ShippedRun("town", Policy::kDwa, 40.0);
  config.results = file;
  RunResolved(config);
  EXPECT_EQ(Query(file,
                  "SELECT COUNT(DISTINCT t.vehicle_number) FROM trajectory t LEFT JOIN vehicle v USING "
                  "(run_id, vehicle_number) "
                  "WHERE v.vehicle_id IS NULL"),
            0.0);
}

// A passenger is neither an obstacle nor struck by the car it sits in.
TEST(Results, APassengerIsNoRoadUser) {
  const TemporaryFolder folder;
  const auto routes = folder.Write("ride.rou.xml", R"(<routes><vType id="car" vClass="passenger"/>
    <trip id="taxi" type="car" depart="triggered" from="A3_B3" to="D3_E3"/>
    <person id="rider" depart="5"><ride from="A3_B3" to="D3_E3" lines="taxi"/></person></routes>)");
  RunConfig config = OwnDemand("town", routes, Policy::kDwa, 120.0);
  config.results = folder / "ride.sqlite";
  EXPECT_EQ(RunResolved(config).outcome.arrived, 1);
  EXPECT_EQ(Query(*config.results, "SELECT COUNT(*) FROM vehicle"), 1.0);
  EXPECT_EQ(Query(*config.results, "SELECT COUNT(*) FROM collision"), 0.0);
}

// A vehicle type of each policy in one distribution: 0.5 idm, 0.3 dwa, 0.2 native of 100 vehicles.
// The gaps in the main road's stream take as many from the side road as natively: SUMO, which tells who may
// go, must not take agents for faster than the road allows.
TEST(Coupling, WhoHasToYieldUsesTheGapsBetweenAgents) {
  const TemporaryFolder folder;
  const auto routes = folder.Write("own.rou.xml", R"(<routes>
      <vType id="car" vClass="passenger"/>
      <route id="main" edges="west_in east_out"/><route id="side" edges="south_in east_out"/>
      <flow id="m" type="car" route="main" begin="0" end="400" probability="0.12" departSpeed="max"/>
      <flow id="s" type="car" route="side" begin="0" end="400" vehsPerHour="1200" departSpeed="max"/>
    </routes>)");
  const auto through = [&](Policy policy) {
    RunConfig config = OwnDemand("priority_crossing", routes, policy, 400.0);
    config.results = folder.path() / "through.sqlite";
    const RunReport report = RunResolved(config);
    return Query(*config.results, fmt::format("SELECT COUNT(*) FROM trip JOIN vehicle USING (run_id, "
                                              "vehicle_number) WHERE arrival_s IS NOT NULL AND vehicle_id "
                                              "LIKE 's.%' AND run_id = {}",
                                              report.run_id));
  };
  const double native = through(Policy::kSumo);
  EXPECT_GT(native, 30.0);
  EXPECT_GT(through(Policy::kDwa), 0.85 * native);
}

TEST(Coupling, AVTypeDistributionMixesPolicies) {
  const TemporaryFolder folder;
  const auto routes = folder.Write("mix.rou.xml", R"(<routes>
    <vTypeDistribution id="mix">
      <vType id="with_idm" probability="0.5"><param key="lanewise.policy" value="idm"/></vType>
      <vType id="with_dwa" probability="0.3"><param key="lanewise.policy" value="dwa"/></vType>
      <vType id="with_sumo" probability="0.2"><param key="lanewise.policy" value="sumo"/></vType>
    </vTypeDistribution>
    <flow id="f" type="mix" begin="0" period="2.5" number="100" departSpeed="max" departLane="best">
      <route edges="west_A3 A3_B3 B3_C3 B3_C3_turn C3_D3 D3_E3 E3_east"/></flow></routes>)");
  RunConfig config = OwnDemand("town", routes, Policy::kDwa, 300.0);
  config.results = folder / "mix.sqlite";
  const RunReport report = RunResolved(config);
  ASSERT_EQ(report.outcome.inserted, 100);
  std::map<std::string, PolicyShareRow> shares;
  for (const PolicyShareRow& share : report.outcome.policy_shares) shares[share.policy] = share;
  // Four standard deviations of a binomial draw: 4 sqrt(100 p (1 - p)) = 20, 18, 16.
  EXPECT_NEAR(static_cast<double>(shares["idm"].vehicles), 50.0, 20.0);
  EXPECT_NEAR(static_cast<double>(shares["dwa"].vehicles), 30.0, 18.0);
  EXPECT_NEAR(static_cast<double>(shares["sumo"].vehicles), 20.0, 16.0);
  EXPECT_EQ(shares["sumo"].agent_steps, 0);
  EXPECT_EQ(shares["idm"].agent_steps, shares["idm"].vehicle_steps);
  EXPECT_EQ(shares["dwa"].agent_steps, shares["dwa"].vehicle_steps);
  for (const char* policy : {"idm", "dwa", "sumo"}) {
    EXPECT_EQ(Query(*config.results,
                    fmt::format("SELECT COUNT(*) FROM vehicle WHERE policy = '{0}' AND type LIKE 'with_{0}%'",
                                policy)),
              static_cast<double>(shares[policy].vehicles));
  }
}

// Two buses of the town under dwa: SUMO's stop output says when they stood.
TEST(Coupling, PlannedBusStopsAreServed) {
  const TemporaryFolder folder;
  const auto stops = folder / "stops.xml", results = folder / "bus.sqlite";
  RunConfig config = ShippedRun("town", Policy::kDwa, 300.0);
  config.results = results;
  config.sumo_options = {"--stop-output", stops.string()};
  RunResolved(config);
  pugi::xml_document document;
  ASSERT_TRUE(document.load_file(stops.c_str()));
  std::map<std::string, std::string> served;
  for (const pugi::xml_node stop : document.child("stops").children("stopinfo")) {
    const std::string id = stop.attribute("id").as_string();
    served[id] += stop.attribute("busStop").as_string() + std::string(" ");
    // Duration 20 s from the stop's beginning, plus at most a step on either side and the start delay.
    EXPECT_GE(stop.attribute("ended").as_double() - stop.attribute("started").as_double(), 20.0 - 0.11) << id;
    EXPECT_LE(stop.attribute("ended").as_double() - stop.attribute("started").as_double(), 23.0) << id;
  }
  EXPECT_EQ(served["bus_west0"], "west_a west_b ");
  EXPECT_NEAR(Query(results,
                    "SELECT stop_time_s FROM trip JOIN vehicle USING (run_id, vehicle_number) WHERE "
                    "vehicle_id = 'bus_west0'"),
              40.0, 3.0);
  // Back at the wheel after it: most of its steps outside the stops are the agent's.
  EXPECT_GT(Query(results,
                  "SELECT 1.0 * agent_steps / (steps - stop_time_s / 0.1) FROM trip JOIN vehicle USING "
                  "(run_id, vehicle_number) "
                  "WHERE vehicle_id = 'bus_west0'"),
            0.6);
}

// On A3_B3 all drivers get another destination: the agents follow the new way, and all arrive there.
TEST(Coupling, ReroutedVehiclesArrive) {
  const TemporaryFolder folder;
  const auto routes = folder.Write("detour.rou.xml", R"(<routes>
    <flow id="f" begin="0" period="8" number="10" departSpeed="max" departLane="best">
      <route edges="west_A3 A3_B3 B3_C3 B3_C3_turn C3_D3 D3_E3 E3_east"/></flow></routes>)");
  const auto rerouter = folder.Write("other.add.xml", R"(<additional>
    <rerouter id="other" edges="A3_B3"><interval begin="0" end="10000"><destProbReroute id="C5_north" probability="1"/></interval></rerouter>
    </additional>)");
  const auto driven_routes = folder / "driven.xml";
  RunConfig config = OwnDemand("town", routes, Policy::kDwa, 900.0);
  config.additional_files = rerouter.string();
  config.sumo_options = {"--vehroute-output", driven_routes.string()};
  const RunReport report = RunResolved(config);
  EXPECT_EQ(report.outcome.inserted, 10);
  EXPECT_EQ(report.outcome.arrived, 10);
  EXPECT_EQ(MidBlock(report).different, 0);
  EXPECT_EQ(report.outcome.teleported, 0);
  EXPECT_EQ(report.lane_end_halts, 0);
  pugi::xml_document document;
  ASSERT_TRUE(document.load_file(driven_routes.c_str()));
  int rerouted = 0;
  for (const pugi::xml_node vehicle : document.child("routes").children("vehicle")) {
    pugi::xml_node last = vehicle.child("route");
    for (const pugi::xml_node route : vehicle.child("routeDistribution").children("route")) last = route;
    rerouted += std::string(last.attribute("edges").as_string()).ends_with("C5_north");
  }
  EXPECT_EQ(rerouted, 10);
}

// It stands 9 m before the end of the lane for "straight" and must turn left, but beside it stands a lorry.
// So it drives on and comes back to its route round the blocks, unless that takes too long.
TEST(Coupling, WhoMissesItsLaneMakesADetour) {
  const TemporaryFolder folder;
  const auto routes = folder.Write("missed.rou.xml", R"(<routes>
    <vType id="agent"><param key="lanewise.policy" value="dwa"/></vType><vType id="lorry" length="20"/>
    <vehicle id="beside" type="lorry" depart="0" departLane="1" departPos="130">
      <route edges="A3_B3 B3_C3 B3_C3_turn C3_D3"/></vehicle>
    <vehicle id="v" type="agent" depart="0" departLane="0" departPos="122">
      <route edges="A3_B3 B3_B4 B4_B5"/></vehicle></routes>)");
  RunConfig config = OwnDemand("town", routes, Policy::kSumo, 400.0);
  config.params.lane_change.max_detour = 300.0;
  const RunReport report = RunResolved(config);
  EXPECT_EQ(report.outcome.arrived, 2);
  EXPECT_EQ(report.detours, 1);
  EXPECT_GT(report.detour_length, 100.0);
  EXPECT_EQ(report.lane_end_halts, 0);
  EXPECT_EQ(MidBlock(report).different, 0);
  config.params.lane_change.max_detour = 5.0;
  const RunReport waits = RunResolved(config);
  EXPECT_EQ(waits.outcome.arrived, 2);
  EXPECT_EQ(waits.detours, 0);
}

// Lanes of one edge may begin at different places: a change goes to the place abeam, without a jump.
TEST(Coupling, AChangeBetweenShiftedLanesIsNoJump) {
  const TemporaryFolder folder;
  const auto net = folder.Write("skew.net.xml", R"(<net version="1.9">
    <edge id=":B_0" function="internal">
      <lane id=":B_0_0" index="0" speed="13.89" length="8" shape="400,0 408,0"/>
      <lane id=":B_0_1" index="1" speed="13.89" length="8" shape="400,3.2 408,3.2"/></edge>
    <edge id="a" from="A" to="B">
      <lane id="a_0" index="0" speed="13.89" length="400" shape="0,0 400,0"/>
      <lane id="a_1" index="1" speed="13.89" length="400" shape="-20,3.2 400,3.2"/></edge>
    <edge id="b" from="B" to="C">
      <lane id="b_0" index="0" speed="13.89" length="300" shape="408,0 708,0"/>
      <lane id="b_1" index="1" speed="13.89" length="300" shape="408,3.2 708,3.2"/></edge>
    <junction id="A" type="dead_end" x="0" y="0" incLanes="" intLanes="" shape="0,-2 0,5"/>
    <junction id="B" type="priority" x="404" y="0" incLanes="a_0 a_1" intLanes=":B_0_0 :B_0_1" shape="400,-2 400,5 408,5 408,-2">
      <request index="0" response="00" foes="00" cont="0"/><request index="1" response="00" foes="00" cont="0"/></junction>
    <junction id="C" type="dead_end" x="708" y="0" incLanes="b_0 b_1" intLanes="" shape="708,-2 708,5"/>
    <connection from="a" to="b" fromLane="0" toLane="0" via=":B_0_0" dir="s" state="M"/>
    <connection from="a" to="b" fromLane="1" toLane="1" via=":B_0_1" dir="s" state="M"/>
    <connection from=":B_0" to="b" fromLane="0" toLane="0" dir="s" state="M"/>
    <connection from=":B_0" to="b" fromLane="1" toLane="1" dir="s" state="M"/></net>)");
  const auto routes = folder.Write("skew.rou.xml", R"(<routes>
    <vType id="slow" maxSpeed="3"/>
    <route id="r" edges="a b"/>
    <flow id="s" type="slow" route="r" begin="0" period="20" number="5" departLane="0" departSpeed="max"/>
    <flow id="f" route="r" begin="5" period="4" number="20" departLane="0" departSpeed="max"/></routes>)");
  RunConfig config = OwnDemand("town", routes, Policy::kDwa, 200.0);
  config.net_file = net;
  config.results = folder / "skew.sqlite";
  config.sample_period = 0.0;
  const RunReport report = RunResolved(config);
  EXPECT_EQ(report.outcome.inserted, 25);
  EXPECT_EQ(report.outcome.teleported, 0);
  EXPECT_EQ(MidBlock(report).different, 0);
  EXPECT_GT(Query(*config.results,
                  "SELECT COUNT(DISTINCT vehicle_number) FROM trajectory JOIN lane USING (run_id, lane) "
                  "WHERE lane_id = 'a_1'"),
            10.0);
  // From step to step nobody is farther on than its speed explains.
  EXPECT_LT(
      Query(*config.results,
            "SELECT MAX(ABS(x_m - before - 0.1 * speed_mps)) FROM (SELECT x_m, speed_mps, LAG(x_m) OVER "
            "(PARTITION BY vehicle_number ORDER BY time_s) AS before FROM trajectory)"),
      0.15);
}

// A bus that has served its stop must cross two lanes to turn left; beside it stands one that SUMO drives and
// that wants to that very stop. Each is in the other's way: the one in front drives on.
TEST(Coupling, TwoBusesAtOneStopChangePlaces) {
  const TemporaryFolder folder;
  const auto nodes = folder.Write("stop.nod.xml", R"(<nodes><node id="a" x="0" y="0"/>
    <node id="b" x="300" y="0"/><node id="c" x="500" y="0"/><node id="d" x="300" y="200"/></nodes>)");
  const auto edges = folder.Write("stop.edg.xml", R"(<edges><edge id="ab" from="a" to="b" numLanes="3"/>
    <edge id="bc" from="b" to="c" numLanes="2"/><edge id="bd" from="b" to="d"/></edges>)");
  const auto links = folder.Write("stop.con.xml", R"(<connections>
    <connection from="ab" to="bc" fromLane="0" toLane="0"/>
    <connection from="ab" to="bc" fromLane="1" toLane="1"/>
    <connection from="ab" to="bd" fromLane="2" toLane="0"/></connections>)");
  const auto net = folder / "stop.net.xml";
  const std::string build = fmt::format("'{}' -n '{}' -e '{}' -x '{}' -o '{}' >/dev/null 2>&1", kNetconvert,
                                        nodes.string(), edges.string(), links.string(), net.string());
  ASSERT_EQ(std::system(build.c_str()), 0);
  const auto routes = folder.Write("stop.rou.xml", R"(<routes>
    <vType id="bus" vClass="bus" length="12"/>
    <vehicle id="first" type="bus" depart="0" departLane="0" departPos="262">
      <route edges="ab bd"/><stop lane="ab_0" startPos="230" endPos="264" duration="5"/></vehicle>
    <vehicle id="second" type="bus" depart="1" departLane="1" departPos="263">
      <route edges="ab bc"/><stop lane="ab_0" startPos="230" endPos="264" duration="5"/></vehicle></routes>)");
  RunConfig config = OwnDemand("town", routes, Policy::kDwa, 100.0);
  config.net_file = net;
  const RunReport report = RunResolved(config);
  EXPECT_EQ(report.outcome.arrived, 2);
  EXPECT_EQ(report.lane_end_halts, 0);
}

class Breakdown : public testing::TestWithParam<int> {};

// 100 cars have to pass five broken-down ones, which never arrive.
TEST_P(Breakdown, EveryPassingCarArrivesAndNoAgentStrikes) {
  const TemporaryFolder folder;
  RunConfig config = ShippedRun("breakdown", Policy::kDwa, 900.0);
  config.seed = GetParam();
  config.results = folder / "breakdown.sqlite";
  const RunReport report = RunResolved(config);
  EXPECT_EQ(report.outcome.not_inserted, 0);
  EXPECT_GT(report.outcome.inserted, 150);
  EXPECT_EQ(report.outcome.still_running, 5);
  EXPECT_EQ(Query(*config.results,
                  "SELECT COUNT(*) FROM trip JOIN vehicle USING (run_id, vehicle_number) "
                  "WHERE trip_end <> 'arrived' AND type <> 'broken_down'"),
            0.0);
  EXPECT_EQ(Query(*config.results, "SELECT COUNT(*) FROM collision WHERE striking_agent"), 0.0);
  EXPECT_EQ(MidBlock(report).different, 0);
}

INSTANTIATE_TEST_SUITE_P(Seeds, Breakdown, testing::Values(1, 2, 3));

TEST(Bologna, AcostaUnderDwaIsDrivenExactly) {
  const auto file = BolognaScenario("acosta");
  if (file.empty()) GTEST_SKIP() << "no Bologna scenarios in " << kBolognaFolder;
  const TemporaryFolder folder;
  const RunReport report = RunResolved(BolognaRun(file, folder.path(), 200.0));
  EXPECT_EQ(MidBlock(report).different, 0);
  EXPECT_EQ(report.outcome.teleported, 0);
  EXPECT_GT(report.outcome.inserted, 200);
  EXPECT_TRUE(std::filesystem::exists(
      folder / "tripinfos.xml"));  // Where the caller said, not in the scenario's folder.
}

}  // namespace
}  // namespace lanewise
