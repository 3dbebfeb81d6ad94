#pragma once

#include <fmt/core.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <vector>

#include "agents/network/road_network.h"
#include "tests/support/temporary_folder.h"

namespace lanewise {

inline constexpr double kLaneWidth = 3.2;       ///< [m] of every lane below.
inline constexpr double kJunctionLength = 8.0;  ///< [m] of every internal lane below.

inline RoadNetwork LoadNetText(const std::string& content) {
  const TemporaryFolder folder;
  return LoadRoadNetwork(folder.Write("net.net.xml", content));
}

/// A one-lane edge.
struct PlainEdge {
  std::string id, from, to;
  double length;  ///< [m]
  std::string shape;
};

/// Edges that end at bare junctions. @param connections as in a net file; where they lead on, the junction is
/// one of priority.
inline RoadNetwork PlainNet(const std::vector<PlainEdge>& edges, const std::string& connections = "") {
  std::map<std::string, std::string> incoming;  // Lanes by junction.
  std::string net = R"(<net version="1.9">)";
  for (const PlainEdge& e : edges) {
    net += fmt::format(
        R"(<edge id="{0}" from="{1}" to="{2}"><lane id="{0}_0" index="0" speed="13.89" length="{3}" shape="{4}"/></edge>)",
        e.id, e.from, e.to, e.length, e.shape);
    incoming[e.from];
    incoming[e.to] += e.id + "_0 ";
  }
  for (const auto& [junction, lanes] : incoming)
    net += fmt::format(R"(<junction id="{}" type="{}" incLanes="{}" intLanes=""/>)", junction,
                       connections.empty() ? "dead_end" : "priority", lanes);
  return LoadNetText(net + connections + "</net>");
}

/// A straight road eastward from (0, 0): `edges` edges "e0", "e1", ... of `length` [m] with `lanes` lanes,
/// joined by junctions "J1", "J2", ... whose internal lanes are kJunctionLength long. Lane i lies at y = i *
/// kLaneWidth.
inline RoadNetwork ChainNet(int edges, int lanes, double length, double speed_limit = 13.89) {
  std::string inner, normal, junctions, connections, inner_connections;
  double x = 0.0;
  for (int e = 0; e < edges; ++e) {
    const bool last = e + 1 == edges;
    normal += fmt::format("<edge id=\"e{}\" from=\"J{}\" to=\"J{}\">", e, e, e + 1);
    std::string inc, internal, requests;
    if (!last) inner += fmt::format("<edge id=\":J{}_0\" function=\"internal\">", e + 1);
    for (int i = 0; i < lanes; ++i) {
      const double y = i * kLaneWidth;
      normal += fmt::format(
          "<lane id=\"e{0}_{1}\" index=\"{1}\" speed=\"{2}\" length=\"{3}\" shape=\"{4},{5} {6},{5}\"/>", e,
          i, speed_limit, length, x, y, x + length);
      inc += fmt::format("e{}_{} ", e, i);
      if (last) continue;
      internal += fmt::format(":J{}_0_{} ", e + 1, i);
      requests += fmt::format("<request index=\"{}\" response=\"{}\" foes=\"{}\" cont=\"0\"/>", i,
                              std::string(static_cast<std::size_t>(lanes), '0'),
                              std::string(static_cast<std::size_t>(lanes), '0'));
      inner += fmt::format(
          "<lane id=\":J{0}_0_{1}\" index=\"{1}\" speed=\"{2}\" length=\"{3}\" shape=\"{4},{5} {6},{5}\"/>",
          e + 1, i, speed_limit, kJunctionLength, x + length, y, x + length + kJunctionLength);
      connections += fmt::format(
          "<connection from=\"e{0}\" to=\"e{1}\" fromLane=\"{2}\" toLane=\"{2}\" via=\":J{1}_0_{2}\" "
          "dir=\"s\" state=\"M\"/>",
          e, e + 1, i);
      inner_connections += fmt::format(
          "<connection from=\":J{0}_0\" to=\"e{0}\" fromLane=\"{1}\" toLane=\"{1}\" dir=\"s\" state=\"M\"/>",
          e + 1, i);
    }
    normal += "</edge>";
    if (!last) inner += "</edge>";
    if (e == 0) junctions += "<junction id=\"J0\" type=\"dead_end\" incLanes=\"\" intLanes=\"\"/>";
    junctions += fmt::format("<junction id=\"J{}\" type=\"{}\" incLanes=\"{}\" intLanes=\"{}\">{}</junction>",
                             e + 1, last ? "dead_end" : "priority", inc, internal, requests);
    x += length + kJunctionLength;
  }
  return LoadNetText("<net version=\"1.9\">" + inner + normal + junctions + connections + inner_connections +
                     "</net>");
}

/// Junctions and connections of a fork: edge "a", whose lanes are `lanes`, leads from "A" to "J"; from its
/// lane `left` to "b" by :J_1_0, from lane 0 to "c" by :J_0_0. The edges are the caller's.
inline std::string ForkLinks(const std::string& lanes, int left) {
  return fmt::format(R"(
    <junction id="A" type="dead_end" incLanes="" intLanes=""/>
    <junction id="B" type="dead_end" incLanes="b_0" intLanes=""/>
    <junction id="C" type="dead_end" incLanes="c_0" intLanes=""/>
    <junction id="J" type="priority" incLanes="{0}" intLanes=":J_0_0 :J_1_0">
      <request index="0" response="00" foes="00" cont="0"/>
      <request index="1" response="00" foes="00" cont="0"/></junction>
    <connection from="a" to="c" fromLane="0" toLane="0" via=":J_0_0" dir="r" state="M"/>
    <connection from="a" to="b" fromLane="{1}" toLane="0" via=":J_1_0" dir="l" state="M"/>
    <connection from=":J_0" to="c" fromLane="0" toLane="0" dir="r" state="M"/>
    <connection from=":J_1" to="b" fromLane="0" toLane="0" dir="l" state="M"/>
  )",
                     lanes, left);
}

/// Edge "a" (two lanes, 400 m, 13.89 m/s) forks: its left lane leads to "b", its right lane to "c".
inline RoadNetwork ForkNet() {
  return LoadNetText(R"(<net version="1.9">
    <edge id=":J_0" function="internal">
      <lane id=":J_0_0" index="0" speed="13.89" length="8" shape="400,0 408,-1"/></edge>
    <edge id=":J_1" function="internal">
      <lane id=":J_1_0" index="0" speed="13.89" length="8" shape="400,3.2 408,4"/></edge>
    <edge id="a" from="A" to="J">
      <lane id="a_0" index="0" speed="13.89" length="400" shape="0,0 400,0"/>
      <lane id="a_1" index="1" speed="13.89" length="400" shape="0,3.2 400,3.2"/></edge>
    <edge id="b" from="J" to="B">
      <lane id="b_0" index="0" speed="13.89" length="300" shape="408,4 708,40"/></edge>
    <edge id="c" from="J" to="C">
      <lane id="c_0" index="0" speed="13.89" length="300" shape="408,-1 708,-40"/></edge>)" +
                     ForkLinks("a_0 a_1", 1) + "</net>");
}

/// Points of a left-hand arc of `radius` [m] about (0, center_y), through `angle` [rad] from due south of it,
/// 1 m apart.
inline std::vector<std::string> ArcPoints(double radius, double center_y, double angle) {
  std::vector<std::string> points;
  const int pieces = static_cast<int>(std::ceil(radius * angle));
  for (int k = 0; k <= pieces; ++k) {
    const double a = angle * k / pieces;
    points.push_back(fmt::format("{:.6f},{:.6f}", radius * std::sin(a), center_y - radius * std::cos(a)));
  }
  return points;
}

/// Edge "bend": one lane on a left-hand arc of `radius` [m] through `angle` [rad], from (0, 0) eastward. With
/// `two_way` edge "back" leads the other way, on its right.
inline RoadNetwork BendNet(double radius, double angle, bool two_way = false) {
  const std::vector<std::string> points = ArcPoints(radius, radius, angle);
  std::vector<std::string> back = ArcPoints(radius + kLaneWidth, radius, angle);
  std::reverse(back.begin(), back.end());
  const std::string edge =
      R"(<edge id="{0}" from="{1}" to="{2}"><lane id="{0}_0" index="0" speed="13.89" length="{3:.3f}" shape="{4}"/></edge>)";
  std::string edges =
      fmt::format(fmt::runtime(edge), "bend", "A", "B", radius * angle, fmt::join(points, " "));
  if (two_way)
    edges += fmt::format(fmt::runtime(edge), "back", "B", "A", (radius + kLaneWidth) * angle,
                         fmt::join(back, " "));
  return LoadNetText(fmt::format(R"(<net version="1.9">{}
      <junction id="A" type="dead_end" incLanes="{}" intLanes=""/>
      <junction id="B" type="dead_end" incLanes="bend_0" intLanes=""/></net>)",
                                 edges, two_way ? "back_0" : ""));
}

}  // namespace lanewise
