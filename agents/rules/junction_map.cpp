#include "agents/rules/junction_map.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "agents/core/geometry.h"

namespace lanewise {
namespace {

/// [m] between sampled points of a path.
constexpr double kSpacing = 0.5;
/// [m] at which two paths conflict: half the widths of two cars of 1.8 m, and what they may deviate.
constexpr double kReach = 2.2;
/// [m] at which a long body that turns meets a car on a path beside: it swings out by 1.5 to 2 m.
constexpr double kLongReach = 4.2;
/// [m] by which one waits in a junction before the net's own place where others turn: they cut corners.
constexpr float kCutCorner = 1.0f;
/// [rad] from which a link is a turn.
constexpr double kTurn = 0.5;
/// [m] for which vehicles on the lane behind a link still count for its conflicts: where links come together
/// at the junction's edge, they cross there.
constexpr double kBeyond = 8.0;
/// [m] around a pedestrian crossing: beyond its half width, for the vehicle; half a car and a step, for the
/// pedestrian.
constexpr double kCrossingMargin = 0.3, kPersonReach = 1.6;

struct PathSample {
  float s;
  double x, y;
};

using Path = std::vector<PathSample>;

Path SampleLink(const RoadNetwork& network, const std::vector<LaneCurve>& curves, const JunctionLink& link,
                LaneIndex via) {
  Path path;
  const auto add = [&](double s, const PathPoint& p) { path.push_back({static_cast<float>(s), p.x, p.y}); };
  double start = 0.0;
  while (via != kNone && network.lanes[via].internal) {
    const Lane& lane = network.lanes[via];
    const int pieces = std::max(1, static_cast<int>(std::ceil(lane.length / kSpacing)));
    for (int k = 0; k < pieces; ++k) {
      const double s = lane.length * k / pieces;
      add(start + s, curves[via].At(s));
    }
    start += lane.length;
    via = lane.outgoing.empty() ? kNone : network.connections[lane.outgoing.front()].via;
  }
  if (path.empty()) add(0.0, curves[link.from].At(network.lanes[link.from].length));
  for (double s = 0.0; s <= std::min(kBeyond, network.lanes[link.to].length); s += kSpacing)
    add(start + s, curves[link.to].At(s));
  return path;
}

Path SampleCrossing(const Lane& lane) {
  Path path;
  if (lane.shape.size() < 2) return path;
  const Point2 a = lane.shape.front(), b = lane.shape.back();
  const double length = std::hypot(b.x - a.x, b.y - a.y);
  const int pieces = std::max(1, static_cast<int>(std::ceil(length / kSpacing)));
  for (int k = 0; k <= pieces; ++k) {
    const double share = static_cast<double>(k) / pieces;
    path.push_back(
        {static_cast<float>(share * length), a.x + share * (b.x - a.x), a.y + share * (b.y - a.y)});
  }
  return path;
}

struct Interval {
  float begin, end;
};

/// The part of `path` nearer than `reach` to `other`.
std::optional<Interval> PartNear(const Path& path, const Path& other, double reach) {
  std::optional<Interval> part;
  for (const PathSample& p : path) {
    const bool near = std::any_of(other.begin(), other.end(), [&](const PathSample& o) {
      return (p.x - o.x) * (p.x - o.x) + (p.y - o.y) * (p.y - o.y) < reach * reach;
    });
    if (!near) continue;
    if (!part) part = Interval{p.s, p.s};
    part->end = p.s;
  }
  return part;
}

bool Bit(const std::vector<bool>& bits, std::int32_t index) {
  return index < std::ssize(bits) && bits[static_cast<std::size_t>(index)];
}

}  // namespace

JunctionMap::JunctionMap(const RoadNetwork& network, const std::vector<LaneCurve>& curves)
    : link_of_connection_(network.connections.size(), kNone),
      link_of_lane_(network.lanes.size(), kNone),
      offset_of_lane_(network.lanes.size(), 0.0f) {
  std::vector<Path> paths;
  std::vector<std::vector<std::int32_t>> link_of_request(network.junctions.size());  // By junction.
  for (std::size_t j = 0; j < network.junctions.size(); ++j)
    link_of_request[j].assign(network.junctions[j].requests.size(), kNone);
  for (std::size_t c = 0; c < network.connections.size(); ++c) {
    const Connection& connection = network.connections[c];
    const EdgeFunction to_function = network.edges[network.lanes[connection.to].edge].function;
    const bool crossing = to_function == EdgeFunction::kCrossing;
    if (network.lanes[connection.from].internal || to_function == EdgeFunction::kWalkingArea) continue;
    if (connection.request == kNone && connection.signal == kNone) continue;
    JunctionLink link;
    link.connection = static_cast<std::int32_t>(c);
    link.from = connection.from;
    link.to = connection.to;
    link.signal = connection.signal;
    link.signal_link = connection.link_index;
    link.state = connection.state;
    link.crossing = crossing;
    link.keep_clear = connection.keep_clear;
    const auto index = static_cast<std::int32_t>(links_.size());
    link_of_connection_[c] = index;
    if (crossing) {
      paths.push_back(SampleCrossing(network.lanes[link.to]));
      link.length = paths.back().empty() ? 0.0f : paths.back().back().s;
      crossings_.push_back(index);
    } else {
      double speed_sum = 0.0;
      int samples = 0;
      for (LaneIndex via = connection.via; via != kNone && network.lanes[via].internal;) {
        const Lane& lane = network.lanes[via];
        link_of_lane_[via] = index;
        offset_of_lane_[via] = link.length;
        link.length += static_cast<float>(lane.length);
        for (double s = 0.0; s <= lane.length; s += kSpacing, ++samples)
          speed_sum += std::min(lane.speed_limit, curves[via].SpeedCap(s));
        via = lane.outgoing.empty() ? kNone : network.connections[lane.outgoing.front()].via;
        if (via != kNone && link.wait_at == 0.0f) link.wait_at = link.length;
      }
      const double before = curves[link.from].At(network.lanes[link.from].length).heading;
      link.turns = std::abs(WrapAngle(curves[link.to].At(0.0).heading - before)) > kTurn;
      link.speed = static_cast<float>(samples > 0 ? speed_sum / samples : network.lanes[link.to].speed_limit);
      paths.push_back(SampleLink(network, curves, link, connection.via));
    }
    if (connection.request != kNone) link_of_request[connection.junction][connection.request] = index;
    links_.push_back(link);
  }

  for (std::size_t i = 0; i < links_.size(); ++i) {
    JunctionLink& link = links_[i];
    link.first_area = static_cast<std::uint32_t>(areas_.size());
    const Connection& connection = network.connections[link.connection];
    if (connection.request == kNone || link.crossing) continue;
    const std::vector<RightOfWay>& requests = network.junctions[connection.junction].requests;
    const RightOfWay& own = requests[connection.request];
    if (!own.cont) link.wait_at = 0.0f;
    const std::vector<std::int32_t>& others = link_of_request[connection.junction];
    for (std::int32_t r = 0; r < std::ssize(others); ++r) {
      const std::int32_t foe_index = others[r];
      if (foe_index == kNone) continue;
      const JunctionLink& foe = links_[foe_index];
      const bool only_long = !Bit(own.foes, r) && !Bit(own.response, r);
      if (only_long && (foe.crossing || !(link.turns || foe.turns) ||
                        network.lanes[foe.from].edge == network.lanes[link.from].edge)) {
        continue;
      }
      if (foe.from == link.from) continue;  // Whoever is ahead on the lane is followed.
      const double between = only_long ? kLongReach : kReach;
      const double reach = foe.crossing ? 0.5 * network.lanes[foe.to].width + kCrossingMargin : between;
      const auto mine = PartNear(paths[i], paths[foe_index], reach);
      const auto its = PartNear(paths[foe_index], paths[i], foe.crossing ? kPersonReach : between);
      if (!mine || !its || mine->begin > link.length || its->begin > foe.length) continue;
      ConflictArea area{foe_index,
                        mine->begin,
                        mine->end,
                        its->begin,
                        its->end,
                        !foe.crossing && foe.to == link.to,
                        Bit(own.response, r),
                        Bit(requests[r].response, connection.request),
                        only_long};
      if (area.merges) {
        area.end = link.length;
        area.foe_end = foe.length;
      }
      areas_.push_back(area);
    }
    link.area_count = static_cast<std::uint32_t>(areas_.size()) - link.first_area;
    const auto passes = [&](const ConflictArea& area) { return !area.only_long && links_[area.foe].turns; };
    if (std::any_of(areas_.begin() + link.first_area, areas_.end(), passes))
      link.wait_at = std::max(0.0f, link.wait_at - kCutCorner);
  }
}

}  // namespace lanewise
