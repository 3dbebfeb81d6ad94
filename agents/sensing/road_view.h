#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "agents/core/geometry.h"
#include "agents/core/spatial_grid.h"
#include "agents/network/lane_curve.h"
#include "agents/network/road_network.h"
#include "agents/sensing/lane_occupancy.h"
#include "agents/traffic.h"

namespace lanewise {

class JunctionRules;

class Channel;

/// Read-only world of one step, shared by all agents.
struct World {
  const RoadNetwork* network;
  const std::vector<LaneCurve>* curves;
  const Traffic* traffic;
  const LaneOccupancy* occupancy;
  const SpatialGrid* grid;                     ///< Over the middles of all road users.
  std::span<const double> center_x, center_y;  ///< [m] by row.
  const Channel* channel{nullptr};             ///< What was told over the radio.
  /// The agents' own, with which RuleState::waits_for tells of everyone who stands for another; null: SUMO's
  /// checks guard the junctions.
  const JunctionRules* rules{nullptr};
};

/// One lane of the way ahead.
struct LaneAhead {
  LaneIndex lane;
  double start;  ///< [m] from the ego's front bumper to the lane's start; <= 0 for the ego's own lane.
};

/// The lanes ahead along the route, junctions included, as far as the ego looks.
struct WayAhead {
  static constexpr int kMaxLanes = 24;
  std::array<LaneAhead, kMaxLanes> lanes;
  int count{0};
  double length{0.0};   ///< [m] from the front bumper to the end of the last lane listed.
  bool leads_on{true};  ///< False: the way ends at `length` because the lane does not lead along the route.
};

/// The lane behind `lane` on the ego's route (an internal lane counts); kNone at the trip's end or where
/// the lane does not lead on. @param position route edge of `lane`, or the one before an internal lane.
LaneIndex NextLane(const RoadNetwork& network, const RoutePlan& plan, std::size_t position, LaneIndex lane);

/// Follows the route from the ego's lane as far as `distance` [m].
WayAhead LookAhead(const World& world, AgentIndex ego, double distance);

/// The way from position s [m] on `lane`, a lane of the ego's edge, along the ego's route.
WayAhead LookAheadFrom(const World& world, AgentIndex ego, LaneIndex lane, double s, double distance);

/// The vehicle in front along a way.
struct Leader {
  AgentIndex row{kNone};
  double gap{std::numeric_limits<double>::infinity()};  ///< [m] bumper to bumper.
  double speed{0.0};                                    ///< [m/s]
};

/// Nearest vehicle ahead whose front is on the ego's way (own lane and the lanes it leads to), within the
/// way's length. It is followed wherever it stands in the lane: within a lane nobody passes, hazards
/// excepted.
Leader FindLeader(const World& world, AgentIndex ego, const WayAhead& way);

/// Nearest vehicle ahead of and behind position s on `lane`; vehicles beside the ego count with a
/// negative gap. Looks on through `lookahead`/`lookback` [m] of connected lanes.
Leader FindLeaderOnLane(const World& world, AgentIndex ego, LaneIndex lane, double s, double lookahead);
Leader FindFollowerOnLane(const World& world, AgentIndex ego, LaneIndex lane, double s, double lookback);

/// [m] from which a body in a bend reaches into the lane beside.
inline constexpr double kLongBody = 7.0;

/// A road user or thing near the ego, in the frame of the ego's reference path: s from the ego's front
/// bumper.
struct Obstacle {
  float s, d;                     ///< [m] middle of its box.
  float half_length, half_width;  ///< [m] extent along and across the path.
  float speed_s, speed_d;         ///< [m/s]
  float accel;                    ///< [m/s^2] along its heading.
  float drift_time;               ///< [s] for which speed_d is taken to last.
  float along;                    ///< Cosine of its heading to the path's.
  AgentIndex row;
  bool parallel;  ///< Drives beside our way on the same road: bends move both bodies alike.
  /// [m] of lateral overlap that does not stop us: kept clear of where there is room, not waited for.
  float forgiven;
  bool hazard;  ///< Stands with hazard lights, or is a person: may be passed at any time.
  /// Of a vehicle that stands, under the agents' own rules: its box relative to the view's origin, world
  /// axes. Otherwise of length 0.
  Footprint body;
};

inline constexpr int kMaxObstacles = 24;
inline constexpr int kPathNodes = 16;
/// Nodes behind the front bumper, for what is beside the ego.
inline constexpr int kNodesBehind = 3;
inline constexpr float kSpacingBehind = 4.0f;  ///< [m]

/// The reference path ahead, sampled at equal distances, and what is around it. No heap memory.
struct RoadView {
  float spacing{1.0f};                        ///< [m] between nodes.
  std::array<float, kPathNodes> curvature{};  ///< [1/m]
  /// Nodes from the rearmost to the farthest: s [m] from the front bumper, and the pose relative to the
  /// origin, world axes.
  std::array<float, kNodesBehind + kPathNodes> s{}, x{}, y{}, cos_heading{}, sin_heading{};
  double origin_x{0.0}, origin_y{0.0};  ///< [m] world, path point beside the front bumper.
  std::array<Obstacle, kMaxObstacles> obstacles;
  int obstacle_count{0};
};

/// [m/s] up to which a vehicle may feel its way past others.
inline constexpr double kWalkingSpeed = 1.5;

/// Samples the path over `horizon` [m] and collects the obstacles around it.
/// @param crossing_traffic also take vehicles that cross or come against the path (false while
/// SUMO's checks guard the junction).
void SenseRoad(const World& world, AgentIndex ego, const WayAhead& way, double horizon, bool crossing_traffic,
               RoadView* view);

}  // namespace lanewise
