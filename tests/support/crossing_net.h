#pragma once

#include <array>
#include <cmath>
#include <string>

#include "tests/support/small_nets.h"

namespace lanewise {

inline constexpr double kArm = 150.0;         ///< [m] length of every road of CrossingNet.
inline constexpr double kCrossingHalf = 8.0;  ///< [m] from its middle to the stop lines.
inline constexpr double kCrossingSide = 1.6;  ///< [m] of every lane to the right of the middle of its road.

/// Four one-lane roads "n", "e", "s", "w" towards a crossing at (0, 0), named by where they come from, and
/// four away from it, "n_out" to "w_out". All go straight on: links 0 (from n), 1 (from e), 2 (from s), 3
/// (from w).
/// @param states SUMO's state letter of each link; @param yields by link, the links it yields to.
/// @param signal all links have a signal "J".
inline RoadNetwork CrossingNet(const std::string& states, const std::array<std::string, 4>& yields,
                               bool signal = false) {
  struct Arm {
    const char* name;
    double x, y;  // Where it comes from.
    const char* to;
  };
  const Arm arms[] = {
      {"n", 0, 1, "s_out"}, {"e", 1, 0, "w_out"}, {"s", 0, -1, "n_out"}, {"w", -1, 0, "e_out"}};
  std::string inner, roads, requests, links, inner_links;
  const auto bits = [](const std::string& set) {
    std::string text = "0000";
    for (const char c : set) text[3 - (c - '0')] = '1';
    return text;
  };
  const char* foes[] = {"13", "02", "13", "02"};
  for (int k = 0; k < 4; ++k) {
    const Arm& a = arms[k];
    // Right of the direction of travel (-x, -y) is (-y, x).
    const double rx = -a.y * kCrossingSide, ry = a.x * kCrossingSide;
    const double in = kCrossingHalf, out = kCrossingHalf + kArm;
    const std::string lane =
        R"(<edge id="{0}"{1}><lane id="{0}_0" index="0" speed="13.89" length="{2}" shape="{3},{4} {5},{6}"/></edge>)";
    inner += fmt::format(fmt::runtime(lane), fmt::format(":J_{}", k), " function=\"internal\"", 2.0 * in,
                         a.x * in + rx, a.y * in + ry, -a.x * in + rx, -a.y * in + ry);
    roads += fmt::format(fmt::runtime(lane), a.name, fmt::format(" from=\"{}\" to=\"J\"", a.name), kArm,
                         a.x * out + rx, a.y * out + ry, a.x * in + rx, a.y * in + ry);
    roads +=
        fmt::format(fmt::runtime(lane), a.to, fmt::format(" from=\"J\" to=\"{}\"", std::string(1, a.to[0])),
                    kArm, -a.x * in + rx, -a.y * in + ry, -a.x * out + rx, -a.y * out + ry);
    requests += fmt::format(R"(<request index="{}" response="{}" foes="{}" cont="0"/>)", k, bits(yields[k]),
                            bits(foes[k]));
    links += fmt::format(
        R"(<connection from="{}" to="{}" fromLane="0" toLane="0" via=":J_{}_0" dir="s" state="{}"{}/>)",
        a.name, a.to, k, states[k], signal ? fmt::format(R"( tl="J" linkIndex="{}")", k) : "");
    inner_links += fmt::format(
        R"(<connection from=":J_{}" to="{}" fromLane="0" toLane="0" dir="s" state="M"/>)", k, a.to);
  }
  std::string ends;
  for (const Arm& a : arms)
    ends +=
        fmt::format(R"(<junction id="{}" type="dead_end" incLanes="{}_out_0" intLanes=""/>)", a.name, a.name);
  return LoadNetText(fmt::format(
      R"(<net version="1.9">{}{}{}<junction id="J" type="priority" incLanes="n_0 e_0 s_0 w_0" intLanes=":J_0_0 :J_1_0 :J_2_0 :J_3_0">{}</junction>{}{}</net>)",
      inner, roads, ends, requests, links, inner_links));
}

/// From east and west first; from north and south yield.
inline RoadNetwork PriorityCrossing() {
  return CrossingNet("mMmM", {"13", "", "13", ""});
}
/// Each yields to who comes from its right.
inline RoadNetwork RightBeforeLeftCrossing() {
  return CrossingNet("====", {"3", "0", "1", "2"});
}

/// Two one-lane roads of kArm become one, "out", at (0, 0) eastward: "w" from the west at 5 m/s, with
/// priority, and "s", which comes at 45 degrees from the south-west at 13.89 m/s. Links 0 (from s) and 1
/// (from w), 8 m long.
inline RoadNetwork MergeNet() {
  const double far = kJunctionLength + kArm, slant = std::sqrt(0.5);
  const double x1 = -kJunctionLength * slant, x2 = -far * slant;
  return LoadNetText(fmt::format(
      R"(<net version="1.9">
<edge id=":J_0" function="internal"><lane id=":J_0_0" index="0" speed="13.89" length="{0}" shape="{1},{1} -2.8,-1.2 0,0"/></edge>
<edge id=":J_1" function="internal"><lane id=":J_1_0" index="0" speed="5" length="{0}" shape="-{0},0 0,0"/></edge>
<edge id="s" from="s" to="J"><lane id="s_0" index="0" speed="13.89" length="{3}" shape="{2},{2} {1},{1}"/></edge>
<edge id="w" from="w" to="J"><lane id="w_0" index="0" speed="5" length="{3}" shape="-{4},0 -{0},0"/></edge>
<edge id="out" from="J" to="e"><lane id="out_0" index="0" speed="13.89" length="{3}" shape="0,0 {3},0"/></edge>
<junction id="J" type="priority" incLanes="s_0 w_0" intLanes=":J_0_0 :J_1_0"><request index="0" response="10" foes="10" cont="0"/><request index="1" response="00" foes="01" cont="0"/></junction>
<junction id="e" type="dead_end" incLanes="out_0" intLanes=""/><junction id="s" type="dead_end" incLanes="" intLanes=""/><junction id="w" type="dead_end" incLanes="" intLanes=""/>
<connection from="s" to="out" fromLane="0" toLane="0" via=":J_0_0" dir="s" state="m"/>
<connection from="w" to="out" fromLane="0" toLane="0" via=":J_1_0" dir="s" state="M"/>
<connection from=":J_0" to="out" fromLane="0" toLane="0" dir="s" state="M"/>
<connection from=":J_1" to="out" fromLane="0" toLane="0" dir="s" state="M"/></net>)",
      kJunctionLength, x1, x2, kArm, far));
}

/// "a" comes from the east to its stop line at (12, 0), through the junction to (0, 0) and on as "a_out";
/// "b", from the south, has its stop line at (-2, -4) and crosses the lane behind the junction: 2 m behind
/// the end of link 0 (a). Link 1 (b) yields to it.
inline RoadNetwork CrossingBehindNet() {
  return LoadNetText(R"(<net version="1.9">
<edge id=":J_0" function="internal"><lane id=":J_0_0" index="0" speed="13.89" length="12" shape="12,0 0,0"/></edge>
<edge id=":J_1" function="internal"><lane id=":J_1_0" index="0" speed="13.89" length="16" shape="-2,-4 -2,12"/></edge>
<edge id="a" from="e" to="J"><lane id="a_0" index="0" speed="13.89" length="150" shape="162,0 12,0"/></edge>
<edge id="b" from="s" to="J"><lane id="b_0" index="0" speed="13.89" length="150" shape="-2,-154 -2,-4"/></edge>
<edge id="a_out" from="J" to="w"><lane id="a_out_0" index="0" speed="13.89" length="150" shape="0,0 -150,0"/></edge>
<edge id="b_out" from="J" to="n"><lane id="b_out_0" index="0" speed="13.89" length="150" shape="-2,12 -2,162"/></edge>
<junction id="J" type="priority" incLanes="a_0 b_0" intLanes=":J_0_0 :J_1_0"><request index="0" response="00" foes="10" cont="0"/><request index="1" response="01" foes="01" cont="0"/></junction>
<junction id="e" type="dead_end" incLanes="" intLanes=""/><junction id="s" type="dead_end" incLanes="" intLanes=""/>
<junction id="w" type="dead_end" incLanes="a_out_0" intLanes=""/><junction id="n" type="dead_end" incLanes="b_out_0" intLanes=""/>
<connection from="a" to="a_out" fromLane="0" toLane="0" via=":J_0_0" dir="s" state="M"/>
<connection from="b" to="b_out" fromLane="0" toLane="0" via=":J_1_0" dir="s" state="m"/>
<connection from=":J_0" to="a_out" fromLane="0" toLane="0" dir="s" state="M"/>
<connection from=":J_1" to="b_out" fromLane="0" toLane="0" dir="s" state="M"/></net>)");
}

/// "w" from the west goes on as "e_out" or turns right to "s_out", from one lane; "s" from the south crosses
/// it to "n_out". Links 0 (w to e_out), 1 (w to s_out) and 2 (s), which yields to link 0, of signal "J".
inline RoadNetwork RightTurnNet() {
  return LoadNetText(R"(<net version="1.9">
<edge id=":J_0" function="internal"><lane id=":J_0_0" index="0" speed="13.89" length="16" shape="-8,0 8,0"/></edge>
<edge id=":J_1" function="internal"><lane id=":J_1_0" index="0" speed="13.89" length="12" shape="-8,0 -2,-2 0,-8"/></edge>
<edge id=":J_2" function="internal"><lane id=":J_2_0" index="0" speed="13.89" length="16" shape="4,-8 4,8"/></edge>
<edge id="w" from="w" to="J"><lane id="w_0" index="0" speed="13.89" length="150" shape="-158,0 -8,0"/></edge>
<edge id="s" from="s" to="J"><lane id="s_0" index="0" speed="13.89" length="150" shape="4,-158 4,-8"/></edge>
<edge id="e_out" from="J" to="e"><lane id="e_out_0" index="0" speed="13.89" length="150" shape="8,0 158,0"/></edge>
<edge id="s_out" from="J" to="s"><lane id="s_out_0" index="0" speed="13.89" length="150" shape="0,-8 0,-158"/></edge>
<edge id="n_out" from="J" to="n"><lane id="n_out_0" index="0" speed="13.89" length="150" shape="4,8 4,158"/></edge>
<junction id="J" type="traffic_light" incLanes="w_0 s_0" intLanes=":J_0_0 :J_1_0 :J_2_0"><request index="0" response="000" foes="100" cont="0"/><request index="1" response="000" foes="000" cont="0"/><request index="2" response="001" foes="001" cont="0"/></junction>
<junction id="w" type="dead_end" incLanes="" intLanes=""/><junction id="s" type="dead_end" incLanes="s_out_0" intLanes=""/>
<junction id="e" type="dead_end" incLanes="e_out_0" intLanes=""/><junction id="n" type="dead_end" incLanes="n_out_0" intLanes=""/>
<connection from="w" to="e_out" fromLane="0" toLane="0" via=":J_0_0" dir="s" state="O" tl="J" linkIndex="0"/>
<connection from="w" to="s_out" fromLane="0" toLane="0" via=":J_1_0" dir="r" state="O" tl="J" linkIndex="1"/>
<connection from="s" to="n_out" fromLane="0" toLane="0" via=":J_2_0" dir="s" state="o" tl="J" linkIndex="2"/>
<connection from=":J_0" to="e_out" fromLane="0" toLane="0" dir="s" state="M"/>
<connection from=":J_1" to="s_out" fromLane="0" toLane="0" dir="r" state="M"/>
<connection from=":J_2" to="n_out" fromLane="0" toLane="0" dir="s" state="M"/></net>)");
}

/// "w" from the west and "e" from the east both turn left at (0, 0), to "n_out" and "s_out": before each
/// other, on arcs of 9.6 m 3.4 m apart, so that the net knows of no conflict. Links 0 (from w) and 1 (from
/// e).
inline RoadNetwork OpposingTurnsNet() {
  constexpr double kRadius = kCrossingHalf + kCrossingSide, kTurn = 1.5707963267948966;
  constexpr int kPieces = 12;
  struct Arm {
    const char *name, *to;
    double side;
  };
  std::string text;
  for (const Arm& arm : {Arm{"w", "n_out", 1.0}, Arm{"e", "s_out", -1.0}}) {
    const auto point = [&](double x, double y) { return fmt::format("{},{}", arm.side * x, arm.side * y); };
    const auto edge = [&](const std::string& id, const std::string& ends, double length, const auto& shape) {
      text += fmt::format(
          R"(<edge id="{0}" {1}><lane id="{0}_0" index="0" speed="13.89" length="{2}" shape="{3}"/></edge>)",
          id, ends, length, fmt::join(shape, " "));
    };
    using Points = std::vector<std::string>;
    Points arc;
    for (int k = 0; k <= kPieces; ++k) {
      const double a = kTurn * k / kPieces;
      arc.push_back(point(kRadius * std::sin(a) - kCrossingHalf, kCrossingHalf - kRadius * std::cos(a)));
    }
    const std::string inside = arm.side > 0.0 ? ":J_0" : ":J_1";
    const double far = kCrossingHalf + kArm;
    edge(inside, "function=\"internal\"", kRadius * kTurn, arc);
    edge(arm.name, fmt::format("from=\"{}\" to=\"J\"", arm.name), kArm,
         Points{point(-far, -kCrossingSide), point(-kCrossingHalf, -kCrossingSide)});
    edge(arm.to, fmt::format("from=\"J\" to=\"{}\"", arm.to), kArm,
         Points{point(kCrossingSide, kCrossingHalf), point(kCrossingSide, far)});
    text += fmt::format(
        R"(<junction id="{0}" type="dead_end" incLanes="" intLanes=""/><junction id="{1}" type="dead_end" incLanes="{1}_0" intLanes=""/>)"
        R"(<connection from="{0}" to="{1}" fromLane="0" toLane="0" via="{2}_0" dir="l" state="M"/>)"
        R"(<connection from="{2}" to="{1}" fromLane="0" toLane="0" dir="l" state="M"/>)",
        arm.name, arm.to, inside);
  }
  text +=
      R"(<junction id="J" type="priority" incLanes="w_0 e_0" intLanes=":J_0_0 :J_1_0"><request index="0" response="00" foes="00" cont="0"/><request index="1" response="00" foes="00" cont="0"/></junction>)";
  return LoadNetText("<net version=\"1.9\">" + text + "</net>");
}

}  // namespace lanewise
