#include "agents/network/road_network.h"

#include <gtest/gtest.h>
#include <zlib.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <string>

#include "agents/core/check.h"
#include "tests/support/places.h"
#include "tests/support/temporary_folder.h"

namespace lanewise {
namespace {

const std::filesystem::path kAcosta =
    std::filesystem::path(kBolognaFolder) / "acosta/acosta_buslanes.net.xml";

/// One folder a process: ctest runs the cases of this file side by side.
std::filesystem::path TemporaryFile(const std::string& name) {
  static const TemporaryFolder folder;
  return folder / name;
}

std::filesystem::path WriteFile(const std::string& name, const std::string& content) {
  const auto path = TemporaryFile(name);
  std::ofstream(path) << content;
  return path;
}

RoadNetwork LoadText(const std::string& content) {
  return LoadRoadNetwork(WriteFile("net.net.xml", content));
}

/// The message of the ConfigError that loading throws.
std::string LoadError(const std::filesystem::path& path) {
  try {
    LoadRoadNetwork(path);
  } catch (const ConfigError& error) {
    return error.what();
  }
  return "no error";
}

std::string LoadErrorOf(const std::string& content) {
  return LoadError(WriteFile("broken.net.xml", content));
}

// A main road W -> E, a side road S that turns left onto it, and a crossing of the side road:
//
//   W ----------- C ----------- E        links of C, in the order of incLanes "w_0 s_1 :C_w0_0":
//                 |                        0  w_0 -> e_0    major
//                 | s_1                    1  s_1 -> e_0    minor, yields to 0 and 2
//                 S                        2  the crossing
const std::string kNet = R"(<?xml version="1.0"?>
<net version="1.9">
  <edge id=":C_0" function="internal"><lane id=":C_0_0" index="0" speed="10" length="8" shape="-4,0 4,0"/></edge>
  <edge id=":C_1" function="internal"><lane id=":C_1_0" index="0" speed="6" length="7" shape="0,-5 1,-2 4,0"/></edge>
  <edge id=":C_c0" function="crossing"><lane id=":C_c0_0" index="0" allow="pedestrian" speed="1" length="7"/></edge>
  <edge id=":C_w0" function="walkingarea"><lane id=":C_w0_0" index="0" allow="pedestrian" speed="1" length="3"/></edge>
  <edge id="w" from="W" to="C"><lane id="w_0" index="0" speed="13.9" length="96" shape="-100,0 -4,0" width="3.5"/></edge>
  <edge id="e" from="C" to="E"><lane id="e_0" index="0" speed="13.9" length="96" shape="4,0,1.5 100,0,1.5"/></edge>
  <edge id="s" from="S" to="C">
    <lane id="s_0" index="0" allow="pedestrian" speed="1" length="95" shape="2,-100 2,-5"/>
    <lane id="s_1" index="1" disallow="pedestrian tram hovercraft" speed="8" length="95" shape="0,-100 0,-5"/>
  </edge>
  <tlLogic id="light"/>
  <junction id="W" type="dead_end" incLanes="" intLanes=""/>
  <junction id="E" type="dead_end" incLanes="e_0" intLanes=""/>
  <junction id="S" type="dead_end" incLanes="" intLanes=""/>
  <junction id="C" type="traffic_light" incLanes="w_0 s_0 s_1 :C_w0_0" intLanes=":C_0_0 :C_1_0 :C_c0_0">
    <request index="0" response="000" foes="010" cont="0"/>
    <request index="1" response="101" foes="101" cont="1"/>
    <request index="2" response="000" foes="010" cont="0"/>
  </junction>
  <connection from="w" to="e" fromLane="0" toLane="0" via=":C_0_0" dir="s" state="M"/>
  <connection from="s" to=":C_w0" fromLane="0" toLane="0" dir="s" state="M"/>
  <connection from="s" to="e" fromLane="1" toLane="0" via=":C_1_0" tl="light" linkIndex="3" dir="r" state="m"/>
  <connection from=":C_0" to="e" fromLane="0" toLane="0" dir="s" state="M"/>
  <connection from=":C_1" to="e" fromLane="0" toLane="0" dir="r" state="M"/>
  <connection from=":C_w0" to=":C_c0" fromLane="0" toLane="0" dir="s" state="M"/>
</net>)";

std::string Replaced(std::string text, const std::string& from, const std::string& to) {
  const auto at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

const Connection& ConnectionFrom(const RoadNetwork& network, const std::string& lane,
                                 std::size_t number = 0) {
  return network.connections[network.lanes[network.FindLane(lane)].outgoing.at(number)];
}

TEST(RoadNetwork, ReadsLanesWithTheirAttributes) {
  const RoadNetwork network = LoadText(kNet);
  ASSERT_EQ(network.edges.size(), 7U);
  ASSERT_EQ(network.lanes.size(), 8U);
  const Lane& w = network.lanes[network.FindLane("w_0")];
  EXPECT_DOUBLE_EQ(w.length, 96.0);
  EXPECT_DOUBLE_EQ(w.speed_limit, 13.9);
  EXPECT_DOUBLE_EQ(w.width, 3.5);
  EXPECT_FALSE(w.internal);
  EXPECT_TRUE(network.lanes[network.FindLane(":C_0_0")].internal);
  const Lane& e = network.lanes[network.FindLane("e_0")];  // Three coordinates: the height is dropped.
  ASSERT_EQ(e.shape.size(), 2U);
  EXPECT_DOUBLE_EQ(e.shape[1].x, 100.0);
  EXPECT_DOUBLE_EQ(e.shape[1].y, 0.0);
  EXPECT_EQ(network.FindLane("nowhere"), kNone);
  EXPECT_EQ(network.FindEdge("nowhere"), kNone);
}

TEST(RoadNetwork, KnowsEdgeFunctionsAndJunctions) {
  const RoadNetwork network = LoadText(kNet);
  EXPECT_EQ(network.edges[network.FindEdge(":C_c0")].function, EdgeFunction::kCrossing);
  EXPECT_EQ(network.edges[network.FindEdge(":C_w0")].function, EdgeFunction::kWalkingArea);
  const Edge& w = network.edges[network.FindEdge("w")];
  EXPECT_EQ(w.function, EdgeFunction::kNormal);
  EXPECT_EQ(network.junctions[w.from_junction].id, "W");
  EXPECT_EQ(network.junctions[w.to_junction].id, "C");
  const Edge& inside = network.edges[network.FindEdge(":C_1")];
  EXPECT_EQ(network.junctions[inside.from_junction].id, "C");
  EXPECT_EQ(network.junctions[inside.to_junction].id, "C");
}

TEST(RoadNetwork, NeighborStaysOnTheEdge) {
  const RoadNetwork network = LoadText(kNet);
  const LaneIndex right = network.FindLane("s_0"), left = network.FindLane("s_1");
  EXPECT_EQ(network.Neighbor(right, +1), left);
  EXPECT_EQ(network.Neighbor(left, -1), right);
  EXPECT_EQ(network.Neighbor(right, -1), kNone);
  EXPECT_EQ(network.Neighbor(left, +1), kNone);
}

TEST(RoadNetwork, LinksLanesBothWays) {
  const RoadNetwork network = LoadText(kNet);
  const Connection& turn = ConnectionFrom(network, "s_1");
  EXPECT_EQ(network.lanes[turn.to].id, "e_0");
  EXPECT_EQ(network.lanes[turn.via].id, ":C_1_0");
  EXPECT_EQ(turn.direction, 'r');
  EXPECT_EQ(turn.state, 'm');
  EXPECT_EQ(network.signal_ids.at(turn.signal), "light");
  EXPECT_EQ(turn.link_index, 3);
  EXPECT_EQ(network.lanes[turn.via].incoming, network.lanes[turn.from].outgoing);
  const Connection& leaving = ConnectionFrom(network, ":C_1_0");
  EXPECT_EQ(leaving.to, turn.to);
  EXPECT_EQ(leaving.via, kNone);
  EXPECT_EQ(leaving.signal, kNone);
  EXPECT_EQ(leaving.request, kNone);
  EXPECT_EQ(network.lanes[turn.to].incoming.size(), 4U);  // Two from the roads, two from inside the junction.
}

TEST(RoadNetwork, RequestBitsReadRightToLeftAndPedestriansOnlyCountOnCrossings) {
  const RoadNetwork network = LoadText(kNet);
  const Connection& through = ConnectionFrom(network, "w_0");
  const Connection& turn = ConnectionFrom(network, "s_1");
  const Connection& crossing = ConnectionFrom(network, ":C_w0_0");
  EXPECT_EQ(through.request, 0);
  EXPECT_EQ(ConnectionFrom(network, "s_0").request, kNone);  // Onto a walking area: no link.
  EXPECT_EQ(turn.request, 1);
  EXPECT_EQ(crossing.request, 2);
  const Junction& junction = network.junctions[turn.junction];
  ASSERT_EQ(junction.requests.size(), 3U);
  EXPECT_EQ(junction.requests[1].response, (std::vector<bool>{true, false, true}));
  EXPECT_EQ(junction.requests[0].foes, (std::vector<bool>{false, true, false}));
  EXPECT_TRUE(junction.requests[1].cont);
  EXPECT_FALSE(junction.requests[0].cont);
}

// Four links, all straight: SUMO's minor straight link has the response "1100" and yields to links 2 and 3.
TEST(RoadNetwork, AsymmetricResponse) {
  const std::string net = Replaced(kNet, R"(response="101")", R"(response="1100")");
  EXPECT_EQ(LoadText(net).junctions[3].requests[1].response, (std::vector<bool>{false, false, true, true}));
}

TEST(RoadNetwork, AllowAndDisallow) {
  const RoadNetwork network = LoadText(kNet);
  const auto allowed = [&](const std::string& lane, const char* name) {
    return (network.lanes[network.FindLane(lane)].allowed & VehicleClassBit(name)) != 0;
  };
  EXPECT_TRUE(allowed("w_0", "passenger"));
  EXPECT_TRUE(allowed("s_0", "pedestrian"));
  EXPECT_FALSE(allowed("s_0", "passenger"));
  EXPECT_FALSE(allowed("s_1", "pedestrian"));
  EXPECT_FALSE(allowed("s_1", "tram"));
  EXPECT_TRUE(allowed("s_1", "bus"));
  const auto mask = [&](const std::string& permission) {
    const RoadNetwork changed =
        LoadText(Replaced(kNet, R"(disallow="pedestrian tram hovercraft")", permission));
    return changed.lanes[changed.FindLane("s_1")].allowed;
  };
  EXPECT_EQ(mask(R"(disallow="all")"), 0U);
  EXPECT_EQ(mask(R"(allow="all")"), kAllVehicleClasses);
  EXPECT_EQ(mask(R"(allow="bus taxi")"), VehicleClassBit("bus") | VehicleClassBit("taxi"));
}

TEST(RoadNetwork, VehicleClassBits) {
  EXPECT_EQ(VehicleClassBit("ignoring"), kAllVehicleClasses);
  EXPECT_EQ(VehicleClassBit("hovercraft"), 0U);
  EXPECT_NE(VehicleClassBit("passenger"), VehicleClassBit("bus"));
  EXPECT_NE(VehicleClassBit("custom2"), 0U);
}

TEST(RoadNetwork, ReadsGzip) {
  const auto path = TemporaryFile("net.net.xml.gz");
  const gzFile file = gzopen(path.c_str(), "wb");
  ASSERT_NE(file, nullptr);
  gzwrite(file, kNet.data(), static_cast<unsigned>(kNet.size()));
  gzclose(file);
  EXPECT_EQ(LoadRoadNetwork(path).lanes.size(), 8U);
  std::filesystem::resize_file(path, std::filesystem::file_size(path) / 2);
  const std::string message = LoadError(path);
  EXPECT_NE(message.find(path.string() + ": cannot be read"), std::string::npos) << message;
}

struct BrokenNet {
  std::string from, to, message;
};

class BrokenNetTest : public testing::TestWithParam<BrokenNet> {};

TEST_P(BrokenNetTest, IsRefusedWithItsFault) {
  const std::string message = LoadErrorOf(Replaced(kNet, GetParam().from, GetParam().to));
  EXPECT_NE(message.find("broken.net.xml"), std::string::npos) << message;
  EXPECT_NE(message.find(GetParam().message), std::string::npos) << message;
}

INSTANTIATE_TEST_SUITE_P(
    RoadNetwork, BrokenNetTest,
    testing::Values(
        BrokenNet{R"( length="96" shape="-100)", R"( shape="-100)",
                  R"(:7: <lane id="w_0" index="0">: attribute "length" is missing)"},
        BrokenNet{R"(length="96" shape="-100)", R"(length="far" shape="-100)",
                  R"(attribute "length" is "far", expected a number)"},
        BrokenNet{R"(length="96" shape="-100)", R"(length="-1" shape="-100)",
                  R"("length" is -1, expected >= 0)"},
        BrokenNet{"-100,0 -4,0", "-100;0 -4,0", R"(has the point "-100;0", expected "x,y")"},
        BrokenNet{R"(to="E"><lane id="e_0")", R"(to="E"><lane id="w_0")",
                  R"(<lane id="w_0" index="0">: is defined twice)"},
        BrokenNet{R"(from="W" to="C")", R"(from="W" to="Q")", R"("to" names the unknown junction "Q")"},
        BrokenNet{R"(incLanes="e_0")", R"(incLanes="x_0")",
                  R"(<junction id="E">: attribute "incLanes" names the unknown lane "x_0")"},
        BrokenNet{R"(<request index="1")", R"(<request index="5")", R"(attribute "index", expected 1)"},
        BrokenNet{R"(from="w" to="e")", R"(from="w" to="q")",
                  R"(<connection from="w" to="q">: attribute "to" names the unknown edge "q")"},
        BrokenNet{R"(from="w" to="e" fromLane="0")", R"(from="w" to="e" fromLane="2")",
                  R"("fromLane" is 2, but edge "w" has the lanes 0 to 0)"},
        BrokenNet{R"(via=":C_0_0")", R"(via=":C_9_0")", R"("via" names the unknown lane ":C_9_0")"},
        BrokenNet{"</net>", "", "broken XML: "}));

TEST(RoadNetwork, RefusesWhatIsNoNet) {
  EXPECT_NE(LoadErrorOf("<routes/>").find("not a SUMO net file: the root element is <routes>"),
            std::string::npos);
  EXPECT_NE(LoadErrorOf("").find("broken XML"), std::string::npos);
  EXPECT_EQ(LoadError("/nowhere/a.net.xml"), "/nowhere/a.net.xml: no such file");
}

TEST(RoadNetwork, ReadsBolognaAcosta) {
  if (!std::filesystem::exists(kAcosta)) GTEST_SKIP() << "no net file " << kAcosta;
  const RoadNetwork network = LoadRoadNetwork(kAcosta);
  EXPECT_EQ(network.lanes.size(), 650U);
  for (const Connection& connection : network.connections) {
    // Every link of a normal lane has its row, and the row is as wide as the matrix is high.
    if (network.lanes[connection.from].internal) continue;
    const auto& requests = network.junctions[connection.junction].requests;
    ASSERT_NE(connection.request, kNone) << network.lanes[connection.from].id;
    EXPECT_EQ(requests[connection.request].response.size(), requests.size());
  }
}

}  // namespace
}  // namespace lanewise
