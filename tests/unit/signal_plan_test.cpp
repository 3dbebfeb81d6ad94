#include "agents/coordination/signal_plan.h"

#include <gtest/gtest.h>

#include <functional>

#include "agents/core/check.h"
#include "tests/support/small_nets.h"

namespace lanewise {
namespace {

/// Two one-way roads that cross at a signal S: link 0 from the south, link 1 from the west, and link 2, a
/// crossing 9 m long over the road from the west.
RoadNetwork CrossingNet(const std::string& speed = "13.89") {
  return LoadNetText(R"(<net version="1.9">
    <edge id=":S_0" function="internal"><lane id=":S_0_0" index="0" speed="13.89" length="10" shape="0,-5 0,5"/></edge>
    <edge id=":S_1" function="internal"><lane id=":S_1_0" index="0" speed="13.89" length="10" shape="-5,0 5,0"/></edge>
    <edge id=":S_c0" function="crossing" crossingEdges="west"><lane id=":S_c0_0" index="0" allow="pedestrian" speed="1.4" length="9" shape="-7,5 -7,-4"/></edge>
    <edge id=":S_w0" function="walkingarea"><lane id=":S_w0_0" index="0" allow="pedestrian" speed="1.4" length="2" shape="-7,5 -7,7"/></edge>
    <edge id=":S_w1" function="walkingarea"><lane id=":S_w1_0" index="0" allow="pedestrian" speed="1.4" length="2" shape="-7,-4 -7,-6"/></edge>
    <edge id="south" from="A" to="S"><lane id="south_0" index="0" speed=")" +
                     speed + R"(" length="100" shape="0,-105 0,-5"/></edge>
    <edge id="west" from="B" to="S"><lane id="west_0" index="0" speed=")" +
                     speed + R"(" length="100" shape="-105,0 -5,0"/></edge>
    <edge id="north" from="S" to="C"><lane id="north_0" index="0" speed="13.89" length="100" shape="0,5 0,105"/></edge>
    <edge id="east" from="S" to="D"><lane id="east_0" index="0" speed="13.89" length="100" shape="5,0 105,0"/></edge>
    <junction id="A" type="dead_end" incLanes="" intLanes=""/>
    <junction id="B" type="dead_end" incLanes="" intLanes=""/>
    <junction id="C" type="dead_end" incLanes="north_0" intLanes=""/>
    <junction id="D" type="dead_end" incLanes="east_0" intLanes=""/>
    <junction id="S" type="traffic_light" incLanes="south_0 west_0 :S_w0_0" intLanes=":S_0_0 :S_1_0 :S_c0_0">
      <request index="0" response="000" foes="010" cont="0"/>
      <request index="1" response="101" foes="101" cont="0"/>
      <request index="2" response="000" foes="010" cont="0"/></junction>
    <connection from="south" to="north" fromLane="0" toLane="0" via=":S_0_0" tl="S" linkIndex="0" dir="s" state="o"/>
    <connection from="west" to="east" fromLane="0" toLane="0" via=":S_1_0" tl="S" linkIndex="1" dir="s" state="o"/>
    <connection from=":S_w0" to=":S_c0" fromLane="0" toLane="0" tl="S" linkIndex="2" dir="s" state="M"/>
    <connection from=":S_c0" to=":S_w1" fromLane="0" toLane="0" dir="s" state="M"/>
    <connection from=":S_0" to="north" fromLane="0" toLane="0" dir="s" state="M"/>
    <connection from=":S_1" to="east" fromLane="0" toLane="0" dir="s" state="M"/>
  </net>)");
}

// Pedestrians cross with the road from the south.
const std::vector<SignalPhase> kProgram = {{10.0, "GrG"}, {3.0, "yrr"}, {2.0, "rrr"},
                                           {20.0, "rGr"}, {3.0, "ryr"}, {2.0, "rrr"}};

std::string RefusalOf(const std::function<void()>& check) {
  try {
    check();
  } catch (const ConfigError& error) {
    return error.what();
  }
  return "";
}

std::string Refusal(const std::vector<SignalPhase>& phases, const std::string& speed = "13.89") {
  return RefusalOf([&] { CheckSignalProgram(CrossingNet(speed), {}, 0, phases); });
}

#define EXPECT_NAMES(text, ...) \
  for (const char* part : {__VA_ARGS__}) EXPECT_NE((text).find(part), std::string::npos) << (text)

TEST(SignalPlan, ASafeProgramIsAccepted) {
  EXPECT_EQ(Refusal(kProgram), "");
}

TEST(SignalPlan, AShortYellowIsRefused) {
  auto phases = kProgram;
  phases[1].duration = 2.0;
  EXPECT_NAMES(Refusal(phases), "signal 'S'", "phase 1", "link 0", "yellow for 2 s",
               "at least 3 s at 50 km/h");
}

TEST(SignalPlan, FasterRoadsNeedLongerYellow) {
  EXPECT_DOUBLE_EQ(MinimumYellow(13.89), 3.0);
  EXPECT_DOUBLE_EQ(MinimumYellow(16.67), 4.0);
  EXPECT_DOUBLE_EQ(MinimumYellow(19.44), 5.0);
  EXPECT_NAMES(Refusal(kProgram, "16.67"), "signal 'S'", "yellow for 3 s", "at least 4 s at 60 km/h");
}

TEST(SignalPlan, GreenWithoutYellowIsRefused) {
  auto phases = kProgram;
  phases[4].state = "rrr";
  EXPECT_NAMES(Refusal(phases), "signal 'S'", "phase 4", "link 1", "yellow for 0 s");
}

TEST(SignalPlan, AShortGreenIsRefused) {
  auto phases = kProgram;
  phases[3].duration = 4.0;
  EXPECT_NAMES(Refusal(phases), "signal 'S'", "phase 3", "link 1", "green for 4 s", "at least 5 s");
}

TEST(SignalPlan, FoesAtTheSameTimeAreRefused) {
  auto phases = kProgram;
  phases[3].state = "GGr";
  EXPECT_NAMES(Refusal(phases), "signal 'S'", "phase 3", "green while its foe");
  phases = kProgram;
  phases[1].state = "yGr";  // Green begins in the other's yellow.
  EXPECT_NAMES(Refusal(phases), "signal 'S'", "phase 1", "link 1", "its foe, link 0, has yellow");
}

TEST(SignalPlan, PedestriansMustBeAbleToCross) {
  auto phases = kProgram;
  // 9 m at 1.2 m/s take 7.5 s: 5 s of green and 2 s until the cars' green are too short.
  phases = {{5.0, "rrG"}, {2.0, "rrr"}, {20.0, "rGr"}, {3.0, "ryr"},  {2.0, "rrr"},
            {8.0, "Grr"}, {3.0, "yrr"}, {2.0, "rrr"},  {20.0, "rGr"}, {3.0, "ryr"}};
  EXPECT_NAMES(Refusal(phases), "signal 'S'", "phase 0", "link 2", "7 s to cross", "at least 7.5 s");
  phases[1].duration = 3.0;
  EXPECT_EQ(Refusal(phases), "");
}

TEST(SignalPlan, APhaseWithoutDurationOrALinkIsRefused) {
  auto phases = kProgram;
  phases[2].duration = 0.0;
  EXPECT_NAMES(Refusal(phases), "signal 'S'", "phase 2", "duration is 0 s");
  phases = kProgram;
  phases[5].state = "rr";
  EXPECT_NAMES(Refusal(phases), "signal 'S'", "phase 5", "no link 2");
}

TEST(SignalPlan, OnlyGreensOfVehiclesMayShrink) {
  const std::vector<double> minimum = MinimumDurations(CrossingNet(), {}, 0, kProgram);
  // Phase 0 serves pedestrians: its own time.
  EXPECT_EQ(minimum, (std::vector<double>{10.0, 3.0, 2.0, 5.0, 3.0, 2.0}));
}

TEST(SignalPlan, APlanMayChangeGreensWithinBounds) {
  const RoadNetwork network = CrossingNet();
  const std::vector<double> minimum = MinimumDurations(network, {}, 0, kProgram);
  const auto refusal = [&](const std::vector<double>& plan) {
    return RefusalOf([&] { CheckPlan(network, {}, 0, kProgram, minimum, plan); });
  };
  EXPECT_EQ(refusal({10, 3, 2, 24, 3, 2}), "");
  EXPECT_EQ(refusal({10, 3, 2, 12, 3, 2}), "");
  EXPECT_NAMES(refusal({10, 3, 2, 4, 3, 2}), "signal 'S'", "phase 3", "4 s", "at least 5 s");
  EXPECT_NAMES(refusal({9, 3, 2, 21, 3, 2}), "phase 0", "at least 10 s");
  EXPECT_NAMES(refusal({10, 2, 2, 21, 3, 2}), "phase 1", "at least 3 s");
  EXPECT_NAMES(refusal({10, 3, 3, 20, 3, 2}), "phase 2", "allowed: its 2 s");
  EXPECT_NAMES(refusal({10, 3, 2, 29, 3, 2}), "cycle by 9 s", "up to 8 s");
}

}  // namespace
}  // namespace lanewise
