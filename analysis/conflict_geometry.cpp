#include "analysis/conflict_geometry.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace lanewise {
namespace {

constexpr double kNever = std::numeric_limits<double>::infinity();

double Dot(Point2 a, Point2 b) {
  return a.x * b.x + a.y * b.y;
}
Point2 Left(Point2 u) {
  return {-u.y, u.x};
}

/// The four candidate separating axes of two boxes with the sum of both half extents along each.
struct Axes {
  Point2 axis[4];
  double reach[4];
};

Axes SeparatingAxes(const MovingBox& a, const MovingBox& b) {
  // The boxes' relative rotation alone gives the extent of one along the axes of the other.
  const double c = std::abs(Dot(a.u, b.u)), s = std::abs(a.u.x * b.u.y - a.u.y * b.u.x);
  return {{a.u, Left(a.u), b.u, Left(b.u)},
          {a.half_length + c * b.half_length + s * b.half_width,
           a.half_width + s * b.half_length + c * b.half_width,
           b.half_length + c * a.half_length + s * a.half_width,
           b.half_width + s * a.half_length + c * a.half_width}};
}

/// The part of the region where ka a + kb b <= limit (Sutherland and Hodgman 1974).
void Clip(double ka, double kb, double limit, ConflictRegion* region) {
  ConflictRegion inside;
  for (std::size_t k = 0; k < region->size; ++k) {
    const auto p = region->corner[k];
    const auto q = region->corner[k + 1 == region->size ? 0 : k + 1];
    const double over_p = ka * p.a + kb * p.b - limit;
    const double over_q = ka * q.a + kb * q.b - limit;
    if (over_p <= 0.0) inside.corner[inside.size++] = p;
    if ((over_p < 0.0 && over_q > 0.0) || (over_p > 0.0 && over_q < 0.0)) {
      const double t = over_p / (over_p - over_q);
      inside.corner[inside.size++] = {p.a + t * (q.a - p.a), p.b + t * (q.b - p.b)};
    }
  }
  *region = inside;
}

/// Deceleration [m/s^2] with which a vehicle of this speed, instead of at time `t`, is at `t` only where it
/// would have been at time `own`: own = t - decel t^2 / (2 speed) while it rolls, speed / (2 decel) once it
/// stands.
double DecelerationTo(double own, double t, double speed) {
  if (t <= own) return 0.0;
  if (own <= 0.0) return kNever;
  return t >= 2.0 * own ? 0.5 * speed / own : 2.0 * speed * (t - own) / (t * t);
}

/// Smallest deceleration that takes the one who brakes behind the region: at every time of the other that
/// belongs to it, its own lies below the region's lower border. The border is piecewise linear; over one
/// piece own = p + q t the demand is largest at an end, where it is stationary (t = 2 p / (1 - q)), or where
/// rolling becomes standing (t = 2 own).
template <class Times>
double DecelerationBehind(const ConflictRegion& region, double speed, Times&& times) {
  if (speed <= 0.0) return kNever;
  double needed = 0.0;
  for (std::size_t k = 0; k < region.size; ++k) {
    auto [t1, own1] = times(region.corner[k]);
    auto [t2, own2] = times(region.corner[k + 1 == region.size ? 0 : k + 1]);
    // Upper border pieces ask for less than the lower ones at the same time: taking them along is harmless.
    needed = std::max({needed, DecelerationTo(own1, t1, speed), DecelerationTo(own2, t2, speed)});
    if (t1 == t2) continue;
    if (t1 > t2) {
      std::swap(t1, t2);
      std::swap(own1, own2);
    }
    const double q = (own2 - own1) / (t2 - t1);
    const double p = own1 - q * t1;
    for (const double t : {2.0 * p / (1.0 - q), 2.0 * p / (1.0 - 2.0 * q)}) {
      if (t > t1 && t < t2) needed = std::max(needed, DecelerationTo(p + q * t, t, speed));
    }
  }
  return needed;
}

}  // namespace

MovingBox BoxOf(const Footprint& f, Point2 velocity) {
  const Point2 u{std::cos(f.front.heading), std::sin(f.front.heading)};
  const double half_length = 0.5 * f.length;
  return {{f.front.x - half_length * u.x, f.front.y - half_length * u.y},
          velocity,
          u,
          half_length,
          0.5 * f.width};
}

std::optional<double> TimeToContact(const MovingBox& a, const MovingBox& b, double horizon) {
  const Axes axes = SeparatingAxes(a, b);
  const Point2 d{b.center.x - a.center.x, b.center.y - a.center.y};
  const Point2 v{b.velocity.x - a.velocity.x, b.velocity.y - a.velocity.y};
  // The boxes touch while their projections overlap on all axes: intersect the intervals in time.
  double enter = 0.0;
  double leave = horizon;
  for (std::size_t k = 0; k < 4; ++k) {
    const double position = Dot(d, axes.axis[k]);
    const double rate = Dot(v, axes.axis[k]);
    const double reach = axes.reach[k];
    if (rate == 0.0) {
      if (std::abs(position) > reach) return std::nullopt;
      continue;
    }
    const double t1 = (-reach - position) / rate;
    const double t2 = (reach - position) / rate;
    enter = std::max(enter, std::min(t1, t2));
    leave = std::min(leave, std::max(t1, t2));
    if (enter > leave) return std::nullopt;
  }
  return enter;
}

bool AreApart(const MovingBox& a, const MovingBox& b) {
  const double c = std::abs(Dot(a.u, b.u)), s = std::abs(a.u.x * b.u.y - a.u.y * b.u.x);
  const Point2 d{b.center.x - a.center.x, b.center.y - a.center.y};
  return (std::abs(Dot(a.u, d)) > a.half_length + c * b.half_length + s * b.half_width) |
         (std::abs(Dot(Left(a.u), d)) > a.half_width + s * b.half_length + c * b.half_width) |
         (std::abs(Dot(b.u, d)) > b.half_length + c * a.half_length + s * a.half_width) |
         (std::abs(Dot(Left(b.u), d)) > b.half_width + s * a.half_length + c * a.half_width);
}

ConflictRegion FindConflictRegion(const MovingBox& a, const MovingBox& b, double a_max, double b_max) {
  const auto [axes, reach] = SeparatingAxes(a, b);
  const Point2 d{b.center.x - a.center.x, b.center.y - a.center.y};
  double ka[4], kb[4], now[4];
  for (std::size_t k = 0; k < 4; ++k) {
    ka[k] = -Dot(axes[k], a.velocity);
    kb[k] = Dot(axes[k], b.velocity);
    now[k] = Dot(axes[k], d);
    // Most pairs stay on one side of some axis at all times.
    const double least = now[k] + std::min(0.0, ka[k] * a_max) + std::min(0.0, kb[k] * b_max);
    const double most = now[k] + std::max(0.0, ka[k] * a_max) + std::max(0.0, kb[k] * b_max);
    if (least > reach[k] || most < -reach[k]) return {};
  }
  ConflictRegion region;
  region.corner[0] = {0.0, 0.0};
  region.corner[1] = {a_max, 0.0};
  region.corner[2] = {a_max, b_max};
  region.corner[3] = {0.0, b_max};
  region.size = 4;
  for (std::size_t k = 0; k < 4 && !region.empty(); ++k) {
    Clip(ka[k], kb[k], reach[k] - now[k], &region);
    Clip(-ka[k], -kb[k], reach[k] + now[k], &region);
  }
  return region;
}

ConflictRegion::Corner SoonestAfter(const ConflictRegion& region) {
  return *std::min_element(
      region.corner.begin(), region.corner.begin() + static_cast<std::ptrdiff_t>(region.size),
      [](const ConflictRegion::Corner& p, const ConflictRegion::Corner& q) { return p.b - p.a < q.b - q.a; });
}

std::optional<double> DecelerationToAvoid(const ConflictRegion& region, double speed_a, double speed_b) {
  using Corner = ConflictRegion::Corner;
  const double decel = std::min(DecelerationBehind(region, speed_b,
                                                   [](Corner p) {
                                                     return std::pair{p.a, p.b};
                                                   }),
                                DecelerationBehind(region, speed_a, [](Corner p) {
                                  return std::pair{p.b, p.a};
                                }));
  return std::isfinite(decel) && decel > 0.0 ? std::optional(decel) : std::nullopt;
}

std::optional<double> ModifiedTimeToCollision(double gap, double closing_speed, double closing_accel) {
  if (gap <= 0.0) return 0.0;
  const double root = closing_speed * closing_speed + 2.0 * closing_accel * gap;
  if (root < 0.0) return std::nullopt;
  // The form without cancellation: 2 gap / (v + sqrt(v^2 + 2 a gap)) is the smaller positive root.
  const double denominator = closing_speed + std::sqrt(root);
  return denominator > 0.0 ? std::optional(2.0 * gap / denominator) : std::nullopt;
}

}  // namespace lanewise
