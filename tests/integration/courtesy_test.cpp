// Who lets go whom at a junction, told to SUMO.

#include <gtest/gtest.h>

#include "agents/agent_pipeline.h"
#include "libsumo_bridge/sumo_session.h"
#include "libsumo_bridge/vehicle_bridge.h"
#include "tests/support/sumo_run.h"

namespace lanewise {
namespace {

// A car stops with its front over the line of a crossing, as if the other's body were in its course. SUMO
// holds the other for it, until it is told that this one is let go.
TEST(Courtesy, WhoIsLetGoGoes) {
  SumoSession::EnsureHome();
  const TemporaryFolder folder;
  const auto routes = folder.Write("two.rou.xml", R"(<routes>
    <vehicle id="major" depart="0" departPos="235"><route edges="west_in east_out"/></vehicle>
    <vehicle id="minor" depart="0" departPos="180"><route edges="south_in north_out"/></vehicle></routes>)");
  const auto net = ShippedFile("priority_crossing", ".net.xml");
  const RoadNetwork network = LoadRoadNetwork(net);
  const std::vector<LaneCurve> curves = FitLaneCurves(network, {});
  SumoSession session({"-n", net.string(), "-r", routes.string(), "--step-length", "0.1", "--no-step-log"});
  const AgentParams params;
  VehicleBridge bridge(network, curves, params, Policy::kDwa, Rules::kSumo);
  AgentPipeline pipeline(network, curves, params, Rules::kSumo);
  Traffic traffic;
  Commands commands;
  const double dt = session.step_length();
  const auto row_of = [&](const std::string& id) {
    return bridge.record(0).id == id ? std::size_t{0} : std::size_t{1};
  };
  const auto drive = [&](double until, bool lets_go) {
    while (session.time() < until) {
      session.Step();
      bridge.Read(session.time(), dt, &traffic);
      pipeline.UpdatePoses(&traffic);
      pipeline.Step(dt, bridge.guarded(), &traffic, &commands);
      if (traffic.vehicle_count == 2) {
        const std::size_t major = row_of("major"), minor = row_of("minor");
        const bool over_line = network.lanes[traffic.now.lane[major]].internal && traffic.now.s[major] > 1.0;
        const double speed = std::min(traffic.next.speed[major], over_line ? 0.0 : 1.0);
        traffic.next.speed[major] = commands.lane_speed[major] = speed;
        traffic.next.s[major] = traffic.now.s[major] + speed * dt;
        traffic.next.rule[major].waits_for = lets_go ? traffic.number[minor] : kNone;
      }
      bridge.Write(dt, &traffic, commands);
    }
    return network.edges[network.lanes[traffic.now.lane[row_of("minor")]].edge].id;
  };
  EXPECT_NE(drive(25.0, false), "north_out");
  EXPECT_LT(traffic.now.speed[row_of("minor")], 0.1);
  EXPECT_EQ(drive(33.0, true), "north_out");
  ASSERT_EQ(traffic.vehicle_count, 2u);
  EXPECT_LT(traffic.now.speed[row_of("major")], 0.1);
}

}  // namespace
}  // namespace lanewise
