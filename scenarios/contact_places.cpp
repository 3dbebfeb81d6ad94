#include "scenarios/contact_places.h"

#include <SQLiteCpp/SQLiteCpp.h>

#include <algorithm>
#include <cmath>

namespace lanewise {
namespace {

/// The connection of normal lanes whose way through its junction an internal lane is part of, or kNone.
std::int32_t ConnectionThrough(const RoadNetwork& network, LaneIndex lane) {
  while (network.lanes[lane].internal && !network.lanes[lane].incoming.empty()) {
    const std::int32_t index = network.lanes[lane].incoming.front();
    if (!network.lanes[network.connections[index].from].internal) return index;
    lane = network.connections[index].from;
  }
  return kNone;
}

/// Does one lane lead to the other, through a junction?
bool LeadsTo(const RoadNetwork& network, std::int32_t connection, LaneIndex lane) {
  return connection != kNone &&
         (network.connections[connection].from == lane || network.connections[connection].to == lane);
}

/// Does one of the two follow the other, or does the junction's matrix say that their ways conflict?
bool HasRightOfWay(const RoadNetwork& network, LaneIndex a, LaneIndex b) {
  if (a == b) return true;
  const std::int32_t first = ConnectionThrough(network, a), second = ConnectionThrough(network, b);
  if (LeadsTo(network, first, b) || LeadsTo(network, second, a)) return true;
  if (first == kNone || second == kNone) return false;
  const Connection &one = network.connections[first], &other = network.connections[second];
  if (one.from == other.from) return true;  // One follows the other.
  if (one.junction != other.junction || one.request == kNone || other.request == kNone) return false;
  const std::vector<bool>& foes =
      network.junctions[one.junction].requests[static_cast<std::size_t>(one.request)].foes;
  return other.request < std::ssize(foes) && foes[static_cast<std::size_t>(other.request)];
}

double DistanceToSegment(Point2 p, Point2 a, Point2 b) {
  const double x = b.x - a.x, y = b.y - a.y, squared = x * x + y * y;
  const double share =
      squared > 0.0 ? std::clamp(((p.x - a.x) * x + (p.y - a.y) * y) / squared, 0.0, 1.0) : 0.0;
  return std::hypot(p.x - a.x - share * x, p.y - a.y - share * y);
}

/// [m] at the least between two lines; where they cross, less than half of `step` [m].
double LineDistance(const std::vector<Point2>& a, const std::vector<Point2>& b) {
  constexpr double step = 0.1;
  double least = 1e9;
  for (std::size_t i = 0; i + 1 < a.size(); ++i) {
    const double length = std::hypot(a[i + 1].x - a[i].x, a[i + 1].y - a[i].y);
    const int pieces = std::max(1, static_cast<int>(length / step));
    for (int k = 0; k <= pieces; ++k) {
      const double share = static_cast<double>(k) / pieces;
      const Point2 p{a[i].x + share * (a[i + 1].x - a[i].x), a[i].y + share * (a[i + 1].y - a[i].y)};
      for (std::size_t j = 0; j + 1 < b.size(); ++j)
        least = std::min(least, DistanceToSegment(p, b[j], b[j + 1]));
    }
  }
  return least;
}

}  // namespace

std::vector<ContactPlace> FindContactPlaces(const std::filesystem::path& results, std::int64_t run_id,
                                            const RoadNetwork& network) {
  SQLite::Database database(results.string(), SQLite::OPEN_READONLY);
  SQLite::Statement query(
      database,
      "SELECT MIN(first, second), MAX(first, second), COUNT(*), MAX(max_depth_m), "
      "MAX(v.width_m + w.width_m) / 2 FROM (SELECT c.*, COALESCE(a.lane_id, 'off the lanes') AS first, "
      "COALESCE(b.lane_id, 'off the lanes') AS second FROM collision AS c "
      "LEFT JOIN lane AS a ON a.run_id = c.run_id AND a.lane = first_lane "
      "LEFT JOIN lane AS b ON b.run_id = c.run_id AND b.lane = second_lane) AS c "
      "JOIN vehicle AS v ON v.run_id = c.run_id AND v.vehicle_number = first_vehicle "
      "JOIN vehicle AS w ON w.run_id = c.run_id AND w.vehicle_number = second_vehicle "
      "WHERE c.run_id = ? AND striking_agent = 1 GROUP BY 1, 2 ORDER BY 3 DESC, 4 DESC, 1, 2");
  query.bind(1, run_id);
  std::vector<ContactPlace> places;
  while (query.executeStep()) {
    ContactPlace place{query.getColumn(0).getString(), query.getColumn(1).getString(),
                       query.getColumn(2).getInt(), query.getColumn(3).getDouble()};
    place.bodies_width = query.getColumn(4).getDouble();
    const LaneIndex a = network.FindLane(place.first_lane), b = network.FindLane(place.second_lane);
    if (a != kNone && b != kNone) {
      place.lane_distance = a == b ? 0.0 : LineDistance(network.lanes[a].shape, network.lanes[b].shape);
      place.right_of_way = HasRightOfWay(network, a, b);
    }
    places.push_back(place);
  }
  return places;
}

}  // namespace lanewise
