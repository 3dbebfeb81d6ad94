#pragma once

#include <array>
#include <cstddef>
#include <optional>

#include "agents/core/geometry.h"
#include "agents/core/types.h"

namespace lanewise {

/// A box that moves straight at constant velocity, its heading kept.
struct MovingBox {
  Point2 center;                             ///< [m] at time 0.
  Point2 velocity;                           ///< [m/s] world.
  Point2 u{1.0, 0.0};                        ///< Unit vector of the heading.
  double half_length{0.0}, half_width{0.0};  ///< [m]
};

MovingBox BoxOf(const Footprint& footprint, Point2 velocity);

/// When the two first touch [s], in [0, horizon], or nothing. Separating axes swept in time: exact.
std::optional<double> TimeToContact(const MovingBox& a, const MovingBox& b, double horizon);

/// Do the two, as they stand at time 0, not overlap?
bool AreApart(const MovingBox& a, const MovingBox& b);

/// Where two moving boxes would touch, if each were free in time: the set of pairs (a's time, b's time) [s]
/// in [0, a_max] x [0, b_max] at which box a, as it stands at a's time, meets box b, as it stands at b's
/// time. The separating axis test is linear in both times, so the set is a convex polygon: four strips and
/// the bounds cut it out. Real motion runs along its diagonal; the rest tells how far the two are from
/// meeting (post encroachment time) and what braking would do (deceleration to avoid the crash).
struct ConflictRegion {
  struct Corner {
    double a, b;  ///< [s]
  };
  std::array<Corner, 12> corner{};  ///< Counter-clockwise.
  std::size_t size{0};              ///< 0: they never meet, whatever their times.

  bool empty() const { return size == 0; }
};

ConflictRegion FindConflictRegion(const MovingBox& a, const MovingBox& b, double a_max, double b_max);

/// Corner of a region that is not empty with the least of b's time minus a's time: that difference is the
/// post encroachment time if a goes first.
ConflictRegion::Corner SoonestAfter(const ConflictRegion& region);

/// Smallest constant deceleration [m/s^2] of one of the two, along its own way, that keeps them apart while
/// the other keeps its velocity (DRAC, D. F. Cooper, N. Ferguson 1976; for crossings SUMO's 2 (v - d / t) /
/// t). For two in line it is (speed difference)^2 / (2 gap). Nothing if braking cannot help: they touch
/// already, or the other one drives into it. `speed_a`, `speed_b`: [m/s].
std::optional<double> DecelerationToAvoid(const ConflictRegion& region, double speed_a, double speed_b);

/// Time until a gap [m] closes at this speed [m/s] and relative acceleration [m/s^2]: the modified time to
/// collision (MTTC, K. Ozbay et al. 2008), the smallest t > 0 with gap = speed t + accel t^2 / 2. Nothing if
/// it never does.
std::optional<double> ModifiedTimeToCollision(double gap, double closing_speed, double closing_accel);

}  // namespace lanewise
