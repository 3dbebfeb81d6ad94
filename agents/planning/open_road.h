#pragma once

#include <vector>

#include "agents/agent_params.h"
#include "agents/planning/dwa.h"
#include "agents/planning/way_search.h"
#include "agents/sector_net/sector_io.h"
#include "agents/sensing/road_view.h"

namespace lanewise {

/// A thing or road user other than a driven vehicle, in the frame of the lane's curve.
struct RoadThing {
  Footprint box;    ///< x is s, y is d, heading relative to the road.
  Point2 velocity;  ///< [m/s] along and across the road.
};

/// What stands and moves on the ego's open road.
struct OpenRoadView {
  std::vector<Footprint> standing;
  std::vector<RoadThing> moving;
  bool vehicles{false};  ///< Other vehicles are near: lanes or not, one follows them.
  void Clear();
};

/// An open road is a lane so wide that one drives freely on it, outside junctions: at least
/// open_road.min_width.
bool IsOpenRoad(const RoadNetwork& network, LaneIndex lane, const OpenRoadParams& params);

/// Collects what is on the road from behind the ego to its sight.
void SenseOpenRoad(const World& world, AgentIndex ego, double sight, OpenRoadView* view);

/// What an agent remembers of its way through standing things.
struct WayMemory {
  std::int32_t vehicle{kNone};
  LaneIndex lane{kNone};
  double searched_at{0.0};  ///< [m] s of the last search.
  std::uint64_t things{0};  ///< Signature of what stands beside the way.
  Avoidance advice{Avoidance::kForward};
  Way way;
};

/// What the ego does next on an open road.
struct OpenRoadPlan {
  double accel{0.0};   ///< [m/s^2]
  double course{0.0};  ///< [rad] wanted direction of the front bumper relative to the road.
  bool emergency{false};
};

/// Dynamic Window along a way: the way search settles the steering ([C]: a route first, then the window), the
/// window holds the reachable speeds. A speed is admissible if some continuation, driving on or braking,
/// stays clear of everything that moves. With `advice` to a side only ways to that side are searched; all if
/// there is none.
/// @param free_speed [m/s] wanted without anything in the way.
OpenRoadPlan PlanOpenRoad(const World& world, AgentIndex ego, const AgentParams& params, double free_speed,
                          double target_d, Avoidance advice, const OpenRoadView& view, WaySearch* search,
                          WayMemory* memory);

/// Steers the front bumper into a course: the steering follows through its rate limit and lag.
/// @return new steering angle [rad].
double SteerCourse(const VehicleParams& vehicle, double course, double heading_error, double steering_now,
                   double dt);

}  // namespace lanewise
