#pragma once

#include <vector>

#include "agents/core/types.h"
#include "agents/network/road_network.h"

namespace lanewise {

/// A point of a reference path.
struct PathPoint {
  double x{0.0};          ///< [m] world.
  double y{0.0};          ///< [m] world.
  double heading{0.0};    ///< [rad] tangent, continuous along the curve (may leave [-pi, pi]).
  double curvature{0.0};  ///< [1/m] left positive.
};

/// The reference path over one lane: a uniform cubic B-spline fitted to the lane's polyline. Curves of
/// lanes that follow each other share position, tangent and curvature at the joint, so the reference
/// path over every lane sequence is curvature-continuous, junctions included.
/// Positions are SUMO's: s in [0, lane length]; where the shape is shorter or longer than the length, s is
/// scaled.
class LaneCurve {
 public:
  /// Point at s [m]; s outside [0, length] continues straight along the end tangent. No allocation.
  PathPoint At(double s) const noexcept;
  /// Highest speed [m/s] at s that respects the lateral acceleration limit here and, braking
  /// comfortably, everywhere ahead on this lane.
  double SpeedCap(double s) const noexcept;
  double length() const noexcept { return length_; }
  /// Curve length over lane length: world metres per metre of s.
  double scale() const noexcept { return scale_; }

 private:
  friend class LaneCurveFitter;
  double length_{0.0};
  double scale_{1.0};
  double spacing_{1.0};            // [m] of s between knots.
  std::vector<PathPoint> knots_;   // At s = k * spacing_.
  std::vector<double> speed_cap_;  // At the knots.
};

/// Position on `to` abeam of position `s` on `from`, both as SUMO counts [m]: lanes of an edge may begin at
/// different places, or be stretched differently. May lie outside `to`.
double Abeam(const LaneCurve& from, double s, const LaneCurve& to) noexcept;

struct CurveFitParams {
  double knot_spacing{2.0};  ///< [m] between spline control points.
  double smoothness{3.0};    ///< [m] length over which kinks are rounded; its sixth power weighs the squared
                             ///< third derivative against the squared deviation.
  double max_lateral_accel{5.5};  ///< [m/s^2] for SpeedCap.
  double comfort_decel{2.5};      ///< [m/s^2] braking before a bend, for SpeedCap.
  double curvature_window{
      10.0};  ///< [m] of curve whose mean curvature counts for SpeedCap: about a car's length.
};

/// One curve a lane, by LaneIndex. Fitted with Ceres, in parallel; the result does not depend on the number
/// of threads.
std::vector<LaneCurve> FitLaneCurves(const RoadNetwork& network, const CurveFitParams& params);

}  // namespace lanewise
