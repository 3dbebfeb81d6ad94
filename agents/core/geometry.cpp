#include "agents/core/geometry.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace lanewise {
namespace {

/// A box by its center, unit axes (u forward, left = u turned by 90 degrees) and half extents [m].
struct Box {
  Point2 center;
  Point2 u;
  double half_length;
  double half_width;
};

Box MakeBox(const Footprint& f) {
  const Point2 u{std::cos(f.front.heading), std::sin(f.front.heading)};
  const double half_length = 0.5 * f.length;
  return {{f.front.x - half_length * u.x, f.front.y - half_length * u.y}, u, half_length, 0.5 * f.width};
}

Point2 Left(Point2 u) {
  return {-u.y, u.x};
}
double Dot(Point2 a, Point2 b) {
  return a.x * b.x + a.y * b.y;
}
double Cross(Point2 a, Point2 b) {
  return a.x * b.y - a.y * b.x;
}

/// The four candidate separating axes of two rectangles with the sum of both half extents along each.
struct Axes {
  std::array<Point2, 4> axis;
  std::array<double, 4> reach;
};

Axes SeparatingAxes(const Box& a, const Box& b) {
  // The boxes' relative rotation alone gives the extent of one along the axes of the other.
  const double c = std::abs(Dot(a.u, b.u));
  const double s = std::abs(Cross(a.u, b.u));
  return {{a.u, Left(a.u), b.u, Left(b.u)},
          {a.half_length + c * b.half_length + s * b.half_width,
           a.half_width + s * b.half_length + c * b.half_width,
           b.half_length + c * a.half_length + s * a.half_width,
           b.half_width + s * a.half_length + c * a.half_width}};
}

double SquaredDistance(Point2 p, const Box& box) {
  const Point2 d{p.x - box.center.x, p.y - box.center.y};
  const double outside_u = std::max(0.0, std::abs(Dot(d, box.u)) - box.half_length);
  const double outside_left = std::max(0.0, std::abs(Cross(box.u, d)) - box.half_width);
  return outside_u * outside_u + outside_left * outside_left;
}

/// Smallest squared distance of the corners of `a` from `b`.
double CornerDistanceSquared(const Box& a, const Box& b) {
  const Point2 l{a.half_length * a.u.x, a.half_length * a.u.y};
  const Point2 w{-a.half_width * a.u.y, a.half_width * a.u.x};
  const Point2 c = a.center;
  return std::min({SquaredDistance({c.x + l.x + w.x, c.y + l.y + w.y}, b),
                   SquaredDistance({c.x + l.x - w.x, c.y + l.y - w.y}, b),
                   SquaredDistance({c.x - l.x + w.x, c.y - l.y + w.y}, b),
                   SquaredDistance({c.x - l.x - w.x, c.y - l.y - w.y}, b)});
}

double PenetrationDepth(const Box& a, const Box& b) {
  const Axes axes = SeparatingAxes(a, b);
  const Point2 d{b.center.x - a.center.x, b.center.y - a.center.y};
  double depth = axes.reach[0] - std::abs(Dot(d, axes.axis[0]));
  for (std::size_t k = 1; k < axes.axis.size(); ++k) {
    depth = std::min(depth, axes.reach[k] - std::abs(Dot(d, axes.axis[k])));
  }
  return depth;
}

}  // namespace

Point2 PointOn(std::span<const Point2> line, double share) {
  const auto piece = [&](std::size_t i) {
    return std::hypot(line[i].x - line[i - 1].x, line[i].y - line[i - 1].y);
  };
  double ahead = 0.0;
  for (std::size_t i = 1; i < line.size(); ++i) ahead += share * piece(i);
  for (std::size_t i = 1; i < line.size(); ++i) {
    const double length = piece(i);
    if (ahead < length) {
      const double part = ahead / length;
      return {line[i - 1].x + part * (line[i].x - line[i - 1].x),
              line[i - 1].y + part * (line[i].y - line[i - 1].y)};
    }
    ahead -= length;
  }
  return line.back();
}

double WrapAngle(double angle) {
  // Most angles are already wrapped; std::remainder is slow.
  if (std::abs(angle) <= std::numbers::pi) return angle;
  return std::remainder(angle, 2.0 * std::numbers::pi);
}

double PenetrationDepth(const Footprint& a, const Footprint& b) {
  return PenetrationDepth(MakeBox(a), MakeBox(b));
}

double Distance(const Footprint& a, const Footprint& b) {
  const Box box_a = MakeBox(a);
  const Box box_b = MakeBox(b);
  if (PenetrationDepth(box_a, box_b) >= 0.0) return 0.0;
  // Two disjoint convex polygons are nearest at a corner of at least one of them.
  return std::sqrt(std::min(CornerDistanceSquared(box_a, box_b), CornerDistanceSquared(box_b, box_a)));
}

}  // namespace lanewise
