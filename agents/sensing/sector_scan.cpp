#include "agents/sensing/sector_scan.h"

#include <algorithm>
#include <cmath>

namespace lanewise {
namespace {

/// [m] from a road user's middle to its farthest corner, at most: an articulated bus is 18 m long.
constexpr double kLongestReach = 10.0;
/// [m] a border's node may lie beside the chord and still be left out.
constexpr double kStraight = 0.002;

/// The pose of the sensor: the frame of all reflectors.
struct SensorFrame {
  double x, y, cos_heading, sin_heading;

  Point2 Turn(double dx, double dy) const {
    return {dx * cos_heading + dy * sin_heading, dy * cos_heading - dx * sin_heading};
  }
  Point2 Place(double world_x, double world_y) const { return Turn(world_x - x, world_y - y); }
};

/// [m] from a lane's centre to the border of its road, on each side.
struct Borders {
  double left, right;
};

Borders BordersOf(const RoadNetwork& network, LaneIndex index) {
  const Lane& lane = network.lanes[index];
  const Edge& edge = network.edges[lane.edge];
  Borders borders{0.5 * lane.width, 0.5 * lane.width};
  for (int k = 0; k < edge.lane_count; ++k) {
    if (k < lane.index) borders.right += network.lanes[edge.first_lane + k].width;
    if (k > lane.index) borders.left += network.lanes[edge.first_lane + k].width;
  }
  return borders;
}

/// A polyline that is added to the scene as few edges as its bends need.
class BorderLine {
 public:
  explicit BorderLine(LidarScene* scene) : scene_(scene) {}
  ~BorderLine() { End(); }
  void Add(Point2 p) {
    if (points_ == 0) {
      from_ = p;
    } else if (points_ > 1) {
      const double cx = p.x - from_.x, cy = p.y - from_.y;
      const double beside = std::abs(cx * (to_.y - from_.y) - cy * (to_.x - from_.x));
      if (beside * beside > kStraight * kStraight * (cx * cx + cy * cy)) {
        scene_->AddEdge(from_, to_);
        from_ = to_;
      }
    }
    to_ = p;
    ++points_;
  }
  void End() {
    if (points_ > 1) scene_->AddEdge(from_, to_);
    points_ = 0;
  }

 private:
  LidarScene* scene_;
  Point2 from_, to_;
  int points_{0};
};

void AddBorders(const World& world, const WayAhead& way, const RoadView& view, const SensorFrame& sensor,
                double range, LidarScene* scene) {
  const RoadNetwork& network = *world.network;
  BorderLine left(scene), right(scene);
  int k = 0;
  Borders borders = BordersOf(network, way.lanes[0].lane);
  for (int n = 0; n < kNodesBehind + kPathNodes; ++n) {
    while (k + 1 < way.count && way.lanes[k + 1].start <= view.s[n]) {
      ++k;
      left.End();
      right.End();
      borders = BordersOf(network, way.lanes[k].lane);
    }
    if (network.lanes[way.lanes[k].lane].internal) continue;
    const double x = view.origin_x + view.x[n], y = view.origin_y + view.y[n];
    const double normal_x = -view.sin_heading[n], normal_y = view.cos_heading[n];
    left.Add(sensor.Place(x + borders.left * normal_x, y + borders.left * normal_y));
    right.Add(sensor.Place(x - borders.right * normal_x, y - borders.right * normal_y));
    if (view.s[n] > range) break;
  }
}

}  // namespace

void CollectReflectors(const World& world, AgentIndex ego, const WayAhead& way, const RoadView& view,
                       double range, double turn, LidarScene* scene) {
  const Traffic& traffic = *world.traffic;
  const double heading = traffic.now.heading[ego] - turn;
  const SensorFrame sensor{traffic.now.x[ego], traffic.now.y[ego], std::cos(heading), std::sin(heading)};
  scene->Clear();
  AddBorders(world, way, view, sensor, range, scene);
  const double reach = range + kLongestReach;
  world.grid->ForEachNear(sensor.x, sensor.y, reach, [&](AgentIndex row) {
    if (row == ego) return;
    const double dx = world.center_x[row] - sensor.x, dy = world.center_y[row] - sensor.y;
    const double half_length = 0.5 * traffic.params[row].length, half_width = 0.5 * traffic.params[row].width;
    const double near = range + half_length + half_width;
    if (dx * dx + dy * dy > near * near) return;
    const double its_heading = traffic.now.heading[row];
    scene->AddBox({sensor.Turn(dx, dy), sensor.Turn(std::cos(its_heading), std::sin(its_heading)),
                   half_length, half_width});
  });
}

std::uint8_t ScanSectors(const World& world, AgentIndex ego, const WayAhead& way, const RoadView& view,
                         const AgentParams& params, const Lidar& lidar, double leader_speed,
                         const ScanErrors& errors, LidarScene* scene) {
  const Traffic& traffic = *world.traffic;
  const AvoidanceZone zone =
      ZoneForSpeed(params, traffic.params[ego].width, traffic.now.speed[ego], leader_speed);
  CollectReflectors(world, ego, way, view, std::max(zone.far, zone.side) + errors.max_range_error(), 0.0,
                    scene);
  return lidar.Code(*scene, errors, zone, params.sector.min_points);
}

}  // namespace lanewise
