#pragma once

#include <algorithm>
#include <cmath>

#include "agents/planning/dwa.h"

namespace lanewise {

/// A path of constant curvature [1/m] without obstacles, for planner tests.
inline RoadView PathView(double horizon, double curvature = 0.0) {
  RoadView view;
  view.spacing = static_cast<float>(horizon / (kPathNodes - 1));
  view.curvature.fill(static_cast<float>(curvature));
  for (int n = -kNodesBehind; n < kPathNodes; ++n) {
    const double s = n * static_cast<double>(n < 0 ? kSpacingBehind : view.spacing), angle = s * curvature;
    const int k = kNodesBehind + n;
    view.s[k] = static_cast<float>(s);
    view.x[k] = static_cast<float>(curvature == 0.0 ? s : std::sin(angle) / curvature);
    view.y[k] = static_cast<float>(curvature == 0.0 ? 0.0 : (1.0 - std::cos(angle)) / curvature);
    view.cos_heading[k] = static_cast<float>(std::cos(angle));
    view.sin_heading[k] = static_cast<float>(std::sin(angle));
  }
  return view;
}

/// Horizon [m] the pipeline gives a vehicle at this speed.
inline double ViewHorizon(double speed) {
  return std::max(10.0, speed * speed / 9.0 + speed * 3.0 + 5.0);
}

/// A car-sized obstacle along the path; `gap` [m] from the ego's front to its rear.
inline void AddObstacle(double gap, double d, double speed, double half_width, RoadView* view) {
  Obstacle o{};
  o.half_length = 2.5f;
  o.half_width = static_cast<float>(half_width);
  o.s = static_cast<float>(gap) + o.half_length;
  o.d = static_cast<float>(d);
  o.speed_s = static_cast<float>(speed);
  o.along = 1.0f;
  o.row = view->obstacle_count + 1;
  view->obstacles[view->obstacle_count++] = o;
}

}  // namespace lanewise
