#include "agents/network/lane_curve.h"

#include <ceres/ceres.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <numeric>
#include <optional>
#include <span>

#include "agents/core/check.h"
#include "agents/core/spatial_grid.h"

namespace lanewise {
namespace {

constexpr double kJointReach = 1.5;         // [m] farther apart, two lane ends are no common joint.
constexpr double kCurvatureBase = 6.0;      // [m] of polyline that a joint's curvature is read from.
constexpr double kMaxJointCurvature = 0.2;  // [1/m] beyond is digitising noise.
constexpr double kNoticeableBend = 0.03;    // [1/m] of a lane's end.
constexpr double kMaxSpeedCap = 100.0;      // [m/s]
constexpr double kMinSegment = 1e-3;        // [m] vertices nearer than this are one.
constexpr double kKnotSpacing = 1.0;        // [m] between the knots of a finished curve.
constexpr double kSoleTurnRadius = 7.0;     // [m] a car's front bumper can follow 6.
constexpr double kLeastTurn = 0.5, kGreatestTurn = 2.4;  // [rad] turns that are rounded.
constexpr double kBusWidth = 2.5;                        // [m] SUMO's.
constexpr double kPassingRoom = 2.9;                     // [m] between the middles of two buses 0.4 m apart.
constexpr double kMaxShift = 0.65;                       // [m] a lane is moved by.
constexpr double kShiftTaper = 0.05;                     // [m/m] at which the move begins and ends.
constexpr double kSampleSpacing = 2.0;                   // [m] of lane between the places that are compared.
constexpr double kOpposingCosine = -0.85;                // Of the angle between lanes of opposite directions.

Point2 operator+(Point2 a, Point2 b) {
  return {a.x + b.x, a.y + b.y};
}
Point2 operator-(Point2 a, Point2 b) {
  return {a.x - b.x, a.y - b.y};
}
Point2 operator*(double f, Point2 a) {
  return {f * a.x, f * a.y};
}
double Dot(Point2 a, Point2 b) {
  return a.x * b.x + a.y * b.y;
}
double Cross(Point2 a, Point2 b) {
  return a.x * b.y - a.y * b.x;
}
double Norm(Point2 a) {
  return std::hypot(a.x, a.y);
}
double Heading(Point2 a) {
  return std::atan2(a.y, a.x);
}
Point2 Direction(double heading) {
  return {std::cos(heading), std::sin(heading)};
}
Point2 Position(const PathPoint& p) {
  return {p.x, p.y};
}

/// Signed curvature [1/m] of the circle through three points; 0 where there is none.
double CircleCurvature(Point2 a, Point2 b, Point2 c) {
  const double product = Norm(b - a) * Norm(c - b) * Norm(c - a);
  return product < 1e-6 ? 0.0 : 2.0 * Cross(b - a, c - b) / product;
}

/// A lane's center line by arc length, without repeated vertices.
class Polyline {
 public:
  explicit Polyline(std::span<const Point2> shape) {
    for (const Point2& point : shape) Append(point);
  }

  void Append(Point2 point) {
    if (!vertices_.empty()) {
      const double step = Norm(point - vertices_.back());
      if (step < kMinSegment) return;
      stations_.push_back(stations_.back() + step);
    } else {
      stations_.push_back(0.0);
    }
    vertices_.push_back(point);
  }

  std::span<const Point2> vertices() const { return vertices_; }
  bool empty() const { return vertices_.empty(); }
  double length() const { return empty() ? 0.0 : stations_.back(); }

  /// Needs two vertices; beyond the ends straight on.
  Point2 At(double station) const { return Interpolate(Segment(station), station); }
  double HeadingAt(double station) const {
    const std::size_t i = Segment(station);
    return Heading(vertices_[i + 1] - vertices_[i]);
  }
  double SegmentLengthAt(double station) const {
    const std::size_t i = Segment(station);
    return stations_[i + 1] - stations_[i];
  }
  /// Curvature [1/m] of the circle through the points at three stations.
  double Curvature(double a, double b, double c) const {
    const double curvature = CircleCurvature(At(a), At(b), At(c));
    return std::clamp(curvature, -kMaxJointCurvature, kMaxJointCurvature);
  }

 private:
  std::size_t Segment(double station) const {
    const auto above = std::upper_bound(stations_.begin() + 1, stations_.end() - 1, station);
    return static_cast<std::size_t>(above - stations_.begin()) - 1;
  }
  Point2 Interpolate(std::size_t i, double station) const {
    const double part = (station - stations_[i]) / (stations_[i + 1] - stations_[i]);
    return vertices_[i] + part * (vertices_[i + 1] - vertices_[i]);
  }

  std::vector<Point2> vertices_;
  std::vector<double> stations_;
};

// ── Turns
// ──────────────────────────────────────────────────────────────────────────────────────────────────────────

/// A turn through a junction, from the end of one lane to the start of another, as an arc that touches the
/// straight parts before and behind it.
struct RoundedTurn {
  Point2 center;
  double radius;                  // [m] signed: left positive.
  double begin;                   // [rad] heading where the arc begins.
  double angle;                   // [rad] signed.
  double before, inside, behind;  // Shares of the arc on the three lanes.

  Point2 At(double share) const {
    const Point2 direction = Direction(begin + share * angle);
    return {center.x + radius * direction.y, center.y - radius * direction.x};
  }
};

/// Where the way from `from` to `to` turns more tightly than vehicles can, the arc they can follow.
/// @param inside_length [m] of the internal lane between them.
std::optional<RoundedTurn> RoundTurn(const Polyline& from, const Polyline& to, double inside_length) {
  if (from.vertices().size() < 2 || to.vertices().size() < 2) return std::nullopt;
  const double begin = from.HeadingAt(from.length());
  const double angle = std::remainder(to.HeadingAt(0.0) - begin, 2.0 * std::numbers::pi);
  if (std::abs(angle) < kLeastTurn || std::abs(angle) > kGreatestTurn) return std::nullopt;
  const Point2 in = Direction(begin), out = Direction(begin + angle);
  const Point2 chord = to.vertices().front() - from.vertices().back();
  // Both straights meet at the corner: so far [m] behind the one's end and before the other's start.
  const double to_corner = Cross(chord, out) / Cross(in, out),
               from_corner = Cross(in, chord) / Cross(in, out);
  const double half_tangent = std::tan(0.5 * std::abs(angle));
  const double room = std::min(to_corner + 0.8 * from.SegmentLengthAt(from.length()),
                               from_corner + 0.8 * to.SegmentLengthAt(0.0));
  const double radius = std::min(kSoleTurnRadius, room / half_tangent);
  const double tangent = radius * half_tangent;
  const double before = tangent - to_corner, behind = tangent - from_corner;
  if (before <= 0.0 || behind <= 0.0) return std::nullopt;  // There is room inside the junction.
  const double whole = before + inside_length + behind;
  const double side = angle > 0.0 ? 1.0 : -1.0;
  const Point2 start = from.vertices().back() + (-before) * in;
  const Point2 center = start + side * radius * Point2{-in.y, in.x};
  return RoundedTurn{center,         side * radius,         begin,         angle,
                     before / whole, inside_length / whole, behind / whole};
}

/// Rounds the turns of junctions that only one way leads through, as at the ends of a carriageway whose
/// directions were digitised apart: there SUMO's internal lane is a corner of 1 to 3 m, and a vehicle that
/// turned only there would swing into the lane beside it. Elsewhere the lanes before and behind are shared
/// with other ways and stay as they are.
void RoundSoleTurns(const RoadNetwork& network, std::vector<Polyline>* polylines) {
  std::vector<int> ways_out(network.lanes.size()), ways_in(network.lanes.size());
  for (const Connection& connection : network.connections) {
    if (network.lanes[connection.from].internal) continue;
    ++ways_out[connection.from];
    ++ways_in[connection.to];
  }
  constexpr int kPieces = 4;  // Segments of each lane's part of the arc.
  for (const Connection& connection : network.connections) {
    const LaneIndex via = connection.via;
    if (via == kNone || network.lanes[connection.from].internal || ways_out[connection.from] != 1 ||
        ways_in[connection.to] != 1) {
      continue;
    }
    Polyline &from = (*polylines)[connection.from], &to = (*polylines)[connection.to];
    const std::optional<RoundedTurn> turn = RoundTurn(from, to, network.lanes[via].length);
    if (!turn) continue;
    const auto append_arc = [&](double begin, double share, Polyline* line) {
      for (int k = 0; k <= kPieces; ++k) line->Append(turn->At(begin + share * k / kPieces));
    };
    Polyline before(from.vertices().first(from.vertices().size() - 1)), inside({}), behind({});
    append_arc(0.0, turn->before, &before);
    append_arc(turn->before, turn->inside, &inside);
    append_arc(turn->before + turn->inside, turn->behind, &behind);
    for (const Point2& vertex : to.vertices().subspan(1)) behind.Append(vertex);
    from = std::move(before);
    to = std::move(behind);
    (*polylines)[via] = std::move(inside);
  }
}

// ── Carriageways that overlap
// ──────────────────────────────────────────────────────────────────────────────────────────────────────────

/// A place on a lane's center line.
struct LaneSample {
  LaneIndex lane;
  Point2 at;
  Point2 direction;  // Of travel, length 1.
};

/// The lanes that cars and buses drive on, sampled at equal distances: those of lane i are
/// samples[first[i]] .. samples[first[i + 1] - 1].
struct LaneSamples {
  std::vector<LaneSample> samples;
  std::vector<std::size_t> first;
};

LaneSamples SampleRoads(const RoadNetwork& network, std::span<const Polyline> polylines) {
  const VehicleClassMask motor_vehicles =
      VehicleClassBit("passenger") | VehicleClassBit("bus") | VehicleClassBit("truck");
  LaneSamples all;
  for (std::size_t i = 0; i < polylines.size(); ++i) {
    all.first.push_back(all.samples.size());
    const Lane& lane = network.lanes[i];
    const Polyline& line = polylines[i];
    if (lane.internal || (lane.allowed & motor_vehicles) == 0 || line.vertices().size() < 2) continue;
    const int pieces = std::max(1, static_cast<int>(std::ceil(line.length() / kSampleSpacing)));
    for (int k = 0; k <= pieces; ++k) {
      const double station = line.length() * k / pieces;
      all.samples.push_back(
          {static_cast<LaneIndex>(i), line.At(station), Direction(line.HeadingAt(station))});
    }
  }
  all.first.push_back(all.samples.size());
  return all;
}

/// For each sample, how far [m] to its left the middle of the nearest lane of the opposite direction lies
/// (negative: to its right); infinity where none is nearer than kPassingRoom.
std::vector<double> OpposingLanes(std::span<const LaneSample> samples) {
  std::vector<double> x, y;
  for (const LaneSample& sample : samples) {
    x.push_back(sample.at.x);
    y.push_back(sample.at.y);
  }
  SpatialGrid grid(kPassingRoom + kSampleSpacing);
  grid.Build(x, y);
  std::vector<double> opposing;
  for (const LaneSample& sample : samples) {
    double nearest = std::numeric_limits<double>::infinity();
    grid.ForEachNear(sample.at.x, sample.at.y, kPassingRoom + kSampleSpacing, [&](AgentIndex other) {
      const Point2 chord = samples[other].at - sample.at;
      if (Dot(sample.direction, samples[other].direction) > kOpposingCosine ||
          std::abs(Dot(sample.direction, chord)) > 0.5 * kSampleSpacing) {
        return;
      }
      const double left = Cross(sample.direction, chord);
      if (std::abs(left) < std::min(kPassingRoom, std::abs(nearest))) nearest = left;
    });
    opposing.push_back(nearest);
  }
  return opposing;
}

/// How far [m] to the left the samples of one lane are moved away from the lane that overlaps it, if any:
/// half of what is missing, as the other lane moves too. Always to one side, on a common middle to the right.
/// None where two buses just pass.
std::vector<double> ShiftsOf(std::span<const double> opposing) {
  constexpr double kOneMiddle = 0.05;  // [m] nearer, neither side is meant.
  double sum = 0.0, nearest = kPassingRoom;
  for (const double left : opposing) {
    if (!std::isfinite(left)) continue;
    sum += left + kOneMiddle;
    nearest = std::min(nearest, std::abs(left));
  }
  const double side = sum < 0.0 ? 1.0 : -1.0;
  std::vector<double> shifts(opposing.size(), 0.0);
  if (nearest >= kBusWidth) return shifts;
  for (std::size_t k = 0; k < opposing.size(); ++k) {
    if (std::isfinite(opposing[k]))
      shifts[k] = side * std::min(kMaxShift, 0.5 * (kPassingRoom - std::abs(opposing[k])));
  }
  return shifts;
}

/// Lets the shift begin and end gradually.
void Taper(std::span<double> shifts) {
  const auto limit = [](double before, double* shift) {
    const double least = std::abs(before) - kShiftTaper * kSampleSpacing;
    if (least > std::abs(*shift)) *shift = std::copysign(least, before);
  };
  for (std::size_t k = 1; k < shifts.size(); ++k) limit(shifts[k - 1], &shifts[k]);
  for (std::size_t k = shifts.size(); k-- > 1;) limit(shifts[k], &shifts[k - 1]);
}

/// Moves the center lines of opposite directions apart where a network lays them so near that two buses
/// cannot pass each other: digitised carriageways overlap by up to a metre, and SUMO's own vehicles drive
/// through each other there. The lanes beside them give way as far as they have to.
void PartCarriageways(const RoadNetwork& network, std::vector<Polyline>* polylines) {
  const LaneSamples roads = SampleRoads(network, *polylines);
  const std::vector<double> opposing = OpposingLanes(roads.samples);
  std::vector<double> shifts;
  const auto of_lane = [&](auto& values, LaneIndex lane) {
    return std::span(values).subspan(roads.first[lane], roads.first[lane + 1] - roads.first[lane]);
  };
  const auto lane_count = static_cast<LaneIndex>(network.lanes.size());
  for (LaneIndex lane = 0; lane < lane_count; ++lane) {
    const std::vector<double> own = ShiftsOf(of_lane(opposing, lane));
    shifts.insert(shifts.end(), own.begin(), own.end());
    Taper(of_lane(shifts, lane));
  }
  // Outwards, lane by lane: to the right first, then to the left.
  const auto give_way = [&](LaneIndex lane, LaneIndex beside, double side) {
    if (network.lanes[beside].edge != network.lanes[lane].edge || network.lanes[lane].edge == kNone) return;
    const auto pushing = of_lane(shifts, lane), pushed = of_lane(shifts, beside);
    const auto from = of_lane(roads.samples, lane), to = of_lane(roads.samples, beside);
    if (pushing.empty()) return;
    for (std::size_t k = 0; k < pushed.size(); ++k) {
      const std::size_t abeam = k * (pushing.size() - 1) / std::max<std::size_t>(1, pushed.size() - 1);
      const double slack = std::max(0.0, Norm(to[k].at - from[abeam].at) - kPassingRoom);
      const double push = side * pushing[abeam] - slack;
      if (push > side * pushed[k]) pushed[k] = side * push;
    }
  };
  for (LaneIndex lane = lane_count - 1; lane > 0; --lane) give_way(lane, lane - 1, -1.0);
  for (LaneIndex lane = 1; lane < lane_count; ++lane) give_way(lane - 1, lane, 1.0);

  for (LaneIndex lane = 0; lane < lane_count; ++lane) {
    const auto shift = of_lane(shifts, lane);
    if (std::all_of(shift.begin(), shift.end(), [](double left) { return left == 0.0; })) continue;
    const auto samples = of_lane(roads.samples, lane);
    Polyline moved({});
    for (std::size_t k = 0; k < shift.size(); ++k) {
      const Point2 left{-samples[k].direction.y, samples[k].direction.x};
      moved.Append(samples[k].at + shift[k] * left);
    }
    (*polylines)[lane] = std::move(moved);
  }
}

// ── Joints
// ──────────────────────────────────────────────────────────────────────────────────────────────────────────

/// Where lanes meet: one position, tangent and curvature for all lane ends and starts there.
struct LaneJoints {
  PathPoint start;
  PathPoint end;
};

/// Groups lane ends with the starts of the lanes they lead to, and gives each group one joint. Node 2 i is
/// the start of lane i, node 2 i + 1 its end.
class JointTable {
 public:
  explicit JointTable(const RoadNetwork& network)
      : network_(network), parent_(2 * network.lanes.size()), joints_(parent_.size()) {
    for (const Lane& lane : network.lanes) polylines_.emplace_back(lane.shape);
    RoundSoleTurns(network, &polylines_);
    PartCarriageways(network, &polylines_);
    std::iota(parent_.begin(), parent_.end(), 0);
    for (const Connection& connection : network.connections) {
      const LaneIndex successor = connection.via != kNone ? connection.via : connection.to;
      JoinIfNear(EndOf(connection.from), StartOf(successor));
    }
    std::vector<std::vector<std::int32_t>> groups(parent_.size());
    for (std::size_t node = 0; node < parent_.size(); ++node) {
      groups[Root(static_cast<std::int32_t>(node))].push_back(static_cast<std::int32_t>(node));
    }
    for (const auto& group : groups) DefineJoint(group);
  }

  LaneJoints Of(LaneIndex lane) const { return {joints_[StartOf(lane)], joints_[EndOf(lane)]}; }
  const Polyline& PolylineOf(LaneIndex lane) const { return polylines_[lane]; }

 private:
  static std::int32_t StartOf(LaneIndex lane) { return 2 * lane; }
  static std::int32_t EndOf(LaneIndex lane) { return 2 * lane + 1; }
  static bool IsEnd(std::int32_t node) { return node % 2 != 0; }
  static LaneIndex LaneOf(std::int32_t node) { return node / 2; }
  bool IsInternal(std::int32_t node) const { return network_.lanes[LaneOf(node)].internal; }

  Point2 PositionOf(std::int32_t node) const {
    const auto vertices = polylines_[LaneOf(node)].vertices();
    return IsEnd(node) ? vertices.back() : vertices.front();
  }

  /// A lane without shape joins anything: it has no place of its own.
  bool IsNear(std::int32_t a, std::int32_t b) const {
    if (polylines_[LaneOf(a)].empty() || polylines_[LaneOf(b)].empty()) return true;
    return Norm(PositionOf(a) - PositionOf(b)) <= kJointReach;
  }

  std::int32_t Root(std::int32_t node) {
    while (parent_[node] != node) node = parent_[node] = parent_[parent_[node]];
    return node;
  }

  void JoinIfNear(std::int32_t a, std::int32_t b) {
    if (IsNear(a, b)) parent_[std::max(Root(a), Root(b))] = std::min(Root(a), Root(b));
  }

  /// Normal lanes know best where the road is; among equals the lower lane index.
  std::int32_t Owner(std::span<const std::int32_t> group) const {
    const auto rank = [this](std::int32_t node) {
      return 2 * int{polylines_[LaneOf(node)].vertices().size() < 2} + int{IsInternal(node)};
    };
    return *std::min_element(group.begin(), group.end(),
                             [&](std::int32_t a, std::int32_t b) { return rank(a) < rank(b); });
  }

  void DefineJoint(std::span<const std::int32_t> group) {
    if (group.empty()) return;
    const std::int32_t owner = Owner(group);
    const PathPoint joint = JointAt(owner, Opposite(owner, group), group);
    for (const std::int32_t node : group) {
      joints_[node] = IsNear(node, owner) ? joint : JointAt(node, kNone, {});
    }
  }

  /// The first lane end or start on the other side of the joint, if it is of the owner's own kind. Between a
  /// normal and an internal lane the normal one alone decides; two internal parts, or two normal lanes, share
  /// the kink.
  std::int32_t Opposite(std::int32_t owner, std::span<const std::int32_t> group) const {
    for (const std::int32_t node : group) {
      const bool fits = IsEnd(node) != IsEnd(owner) && IsInternal(node) == IsInternal(owner);
      if (fits && polylines_[LaneOf(node)].vertices().size() >= 2) return node;
    }
    return kNone;
  }

  /// The straightest way on through the joint on an internal lane, where the lane of `node` bends one way
  /// just before it and that way the other: the bend is digitising noise, which an arc must not continue.
  std::int32_t CounterBend(std::int32_t node, double curvature, std::span<const std::int32_t> group) const {
    std::int32_t straightest = kNone;
    double least = 1e9;
    for (const std::int32_t other : group) {
      const Polyline& line = polylines_[LaneOf(other)];
      if (IsEnd(other) == IsEnd(node) || !IsInternal(other) || line.length() < kCurvatureBase) continue;
      const double at = IsEnd(other) ? line.length() - kCurvatureBase : 0.0;
      const double bend = line.Curvature(at, at + 0.5 * kCurvatureBase, at + kCurvatureBase);
      if (std::abs(bend) >= least) continue;
      least = std::abs(bend);
      straightest = bend * curvature < 0.0 ? other : kNone;
    }
    return straightest;
  }

  PathPoint JointAt(std::int32_t node, std::int32_t opposite, std::span<const std::int32_t> group) const {
    const Polyline& line = polylines_[LaneOf(node)];
    if (line.empty()) return {};
    const Point2 position = PositionOf(node);
    if (line.vertices().size() < 2) return {position.x, position.y, 0.0, 0.0};
    if (opposite != kNone && IsEnd(node)) return JointBetween(line, polylines_[LaneOf(opposite)]);
    if (opposite != kNone) return JointBetween(polylines_[LaneOf(opposite)], line);
    const double at = IsEnd(node) ? line.length() : 0.0;
    const double base = std::min(kCurvatureBase, line.length());
    const double begin = IsEnd(node) ? at - base : 0.0;
    const double curvature = line.Curvature(begin, begin + base / 2.0, begin + base);
    if (std::abs(curvature) > kNoticeableBend) {
      const std::int32_t counter = CounterBend(node, curvature, group);
      if (counter != kNone) return JointAt(node, counter, {});
    }
    // A segment of a digitised arc is a chord: the arc's tangent at its end differs by half the angle it
    // spans.
    const double half_angle = 0.5 * curvature * std::min(line.SegmentLengthAt(at), base);
    return {position.x, position.y, line.HeadingAt(at) + (IsEnd(node) ? half_angle : -half_angle), curvature};
  }

  static PathPoint JointBetween(const Polyline& before, const Polyline& behind) {
    Polyline both(before.vertices());
    const double at = both.length();
    for (const Point2& vertex : behind.vertices()) both.Append(vertex);
    const double reach = std::min({kCurvatureBase / 2.0, before.length(), behind.length()});
    const Point2 tangent = both.At(at + reach) - both.At(at - reach);
    const Point2 position = before.vertices().back();
    return {position.x, position.y, Heading(tangent), both.Curvature(at - reach, at, at + reach)};
  }

  const RoadNetwork& network_;
  std::vector<Polyline> polylines_;
  std::vector<std::int32_t> parent_;
  std::vector<PathPoint> joints_;
};

// ── Spline
// ──────────────────────────────────────────────────────────────────────────────────────────────────────────

struct SplinePoint {
  Point2 position;
  Point2 velocity;  // Per parameter unit.
  Point2 acceleration;

  double Speed() const { return Norm(velocity); }
  double Curvature() const {
    const double speed = Speed();
    return speed < 1e-9 ? 0.0 : Cross(velocity, acceleration) / (speed * speed * speed);
  }
};

using Weights = std::array<double, 4>;

/// Uniform cubic B-spline basis at u in [0, 1] of one interval.
Weights Basis(double u) {
  const double r = 1.0 - u, u2 = u * u, u3 = u2 * u;
  return {r * r * r / 6.0, (3.0 * u3 - 6.0 * u2 + 4.0) / 6.0, (-3.0 * u3 + 3.0 * u2 + 3.0 * u + 1.0) / 6.0,
          u3 / 6.0};
}

class Spline {
 public:
  explicit Spline(std::size_t intervals) : control_(intervals + 3) {}

  std::size_t intervals() const { return control_.size() - 3; }
  std::vector<Point2>& control() { return control_; }

  SplinePoint At(double t) const {
    const auto i = std::min(static_cast<std::size_t>(std::max(t, 0.0)), intervals() - 1);
    const double u = t - static_cast<double>(i), r = 1.0 - u;
    return {Combine(i, Basis(u)),
            Combine(i, {-r * r / 2.0, (3.0 * u * u - 4.0 * u) / 2.0, (-3.0 * u * u + 2.0 * u + 1.0) / 2.0,
                        u * u / 2.0}),
            Combine(i, {r, 3.0 * u - 2.0, 1.0 - 3.0 * u, u})};
  }

 private:
  Point2 Combine(std::size_t i, const Weights& w) const {
    return w[0] * control_[i] + w[1] * control_[i + 1] + w[2] * control_[i + 2] + w[3] * control_[i + 3];
  }

  std::vector<Point2> control_;
};

/// Arc length along a spline, tabulated so that a curve can be cut into equal pieces.
class ArcLengthTable {
 public:
  explicit ArcLengthTable(const Spline& spline) : spline_(spline) {
    arc_.reserve(spline.intervals() * kPieces + 1);
    arc_.push_back(0.0);
    for (std::size_t i = 0; i < spline.intervals() * kPieces; ++i)
      arc_.push_back(arc_.back() + Piece(i, 1.0));
  }

  double length() const { return arc_.back(); }

  /// Spline parameter at an arc length.
  double Parameter(double arc) const {
    const auto above = std::upper_bound(arc_.begin() + 1, arc_.end() - 1, arc);
    const auto i = static_cast<std::size_t>(above - arc_.begin()) - 1;
    const double whole = arc_[i + 1] - arc_[i];
    if (whole <= 0.0) return static_cast<double>(i) / kPieces;
    double part = (arc - arc_[i]) / whole;
    // The speed hardly varies within a piece: two corrections reach rounding.
    for (int k = 0; k < 2; ++k) part += (arc - arc_[i] - Piece(i, part)) / whole;
    return (static_cast<double>(i) + std::clamp(part, 0.0, 1.0)) / kPieces;
  }

 private:
  static constexpr std::size_t kPieces = 4;  // Per spline interval.

  /// Length of the first `part` of piece i: three-point Gauss-Legendre.
  double Piece(std::size_t i, double part) const {
    const double width = part / kPieces, begin = static_cast<double>(i) / kPieces;
    const auto speed = [&](double node) { return spline_.At(begin + node * width).Speed(); };
    const double offset = 0.5 * std::sqrt(0.6);
    return width * (5.0 * speed(0.5 - offset) + 8.0 * speed(0.5) + 5.0 * speed(0.5 + offset)) / 18.0;
  }

  const Spline& spline_;
  std::vector<double> arc_;
};

/// Deviation of one spline point from its place on the polyline: across it, and a little along it, so that
/// the parametrisation stays even.
class PolylineDeviation : public ceres::SizedCostFunction<2, 2, 2, 2, 2> {
 public:
  PolylineDeviation(Point2 target, double heading, const Weights& basis)
      : target_(target), tangent_(Direction(heading)), basis_(basis) {}

  bool Evaluate(double const* const* control, double* residuals, double** jacobians) const override {
    constexpr double kAlong = 0.2;
    const Point2 along = kAlong * tangent_, across{-tangent_.y, tangent_.x};
    Point2 offset = -1.0 * target_;
    for (std::size_t k = 0; k < 4; ++k) offset = offset + basis_[k] * Point2{control[k][0], control[k][1]};
    residuals[0] = Dot(across, offset);
    residuals[1] = Dot(along, offset);
    for (std::size_t k = 0; jacobians != nullptr && k < 4; ++k) {
      if (jacobians[k] == nullptr) continue;
      const Point2 first = basis_[k] * across, second = basis_[k] * along;
      const std::array<double, 4> jacobian{first.x, first.y, second.x, second.y};
      std::copy(jacobian.begin(), jacobian.end(), jacobians[k]);
    }
    return true;
  }

 private:
  Point2 target_;
  Point2 tangent_;
  Weights basis_;
};

/// Third difference of four control points: the third derivative within one interval, up to the spacing.
class ThirdDifference : public ceres::SizedCostFunction<2, 2, 2, 2, 2> {
 public:
  explicit ThirdDifference(double weight) : weight_(weight) {}

  bool Evaluate(double const* const* control, double* residuals, double** jacobians) const override {
    constexpr Weights kSigns{-1.0, 3.0, -3.0, 1.0};
    residuals[0] = residuals[1] = 0.0;
    for (std::size_t k = 0; k < 4; ++k) {
      const double factor = weight_ * kSigns[k];
      residuals[0] += factor * control[k][0];
      residuals[1] += factor * control[k][1];
      if (jacobians == nullptr || jacobians[k] == nullptr) continue;
      const std::array<double, 4> jacobian{factor, 0.0, 0.0, factor};
      std::copy(jacobian.begin(), jacobian.end(), jacobians[k]);
    }
    return true;
  }

 private:
  double weight_;
};

}  // namespace

/// Fits the curve of one lane between its two joints.
class LaneCurveFitter {
 public:
  LaneCurveFitter(const Lane& lane, const Polyline& shape, const LaneJoints& joints,
                  const CurveFitParams& params)
      : lane_(lane), joints_(joints), params_(params), line_(Guide(shape, joints)) {}

  LaneCurve Fit() const {
    LaneCurve curve;
    curve.length_ = lane_.length;
    if (line_.vertices().size() < 2 || RunsBack()) {
      MakePoint(&curve);
    } else {
      MakeSpline(&curve);
    }
    LimitSpeed(&curve);
    return curve;
  }

 private:
  static constexpr double kMinScale = 0.1;
  static constexpr std::size_t kMinIntervals = 3;  // Six control points: three for each joint.
  // Where knot_spacing would leave a turn nothing to bend with.
  static constexpr std::size_t kShortIntervals = 12;

  /// The polyline to follow: the lane's own, but from joint to joint.
  static Polyline Guide(const Polyline& shape, const LaneJoints& joints) {
    Polyline guide({});
    const auto vertices = shape.vertices();
    guide.Append(Position(joints.start));
    for (std::size_t i = 1; i + 1 < vertices.size(); ++i) guide.Append(vertices[i]);
    guide.Append(Position(joints.end));
    return guide;
  }

  /// Where the lanes before and behind overlap by a little, a lane of centimetres leads back.
  bool RunsBack() const {
    const Point2 chord = Position(joints_.end) - Position(joints_.start);
    return Norm(chord) < kJointReach && Dot(chord, Direction(joints_.start.heading)) < 0.0 &&
           Dot(chord, Direction(joints_.end.heading)) < 0.0;
  }

  /// A lane without extent: a place to be, turning from one joint's direction to the other's.
  void MakePoint(LaneCurve* curve) const {
    curve->scale_ = 1.0;
    curve->spacing_ = std::max(lane_.length, kMinSegment);
    curve->knots_ = {joints_.start, joints_.end};
    UnwrapHeadings(&curve->knots_);
  }

  void MakeSpline(LaneCurve* curve) const {
    const double wanted = std::ceil(line_.length() / params_.knot_spacing);
    Spline spline(
        std::max(static_cast<std::size_t>(wanted), line_.length() > 2.0 ? kShortIntervals : kMinIntervals));
    Initialize(&spline);
    if (!IsStraight()) Solve(&spline);
    Resample(spline, curve);
  }

  bool IsStraight() const {
    const double heading = line_.HeadingAt(0.0);
    const Point2 normal = Direction(heading + std::numbers::pi / 2.0);
    const auto is_aligned = [&](const PathPoint& joint) {
      return std::abs(std::remainder(joint.heading - heading, 2.0 * std::numbers::pi)) < 1e-9 &&
             std::abs(joint.curvature) < 1e-9;
    };
    const auto is_on_line = [&](Point2 p) { return std::abs(Dot(p - line_.vertices()[0], normal)) < 1e-6; };
    return is_aligned(joints_.start) && is_aligned(joints_.end) &&
           std::all_of(line_.vertices().begin(), line_.vertices().end(), is_on_line);
  }

  /// Control points along the polyline; the outer three at each end make the joint exact.
  void Initialize(Spline* spline) const {
    std::vector<Point2>& control = spline->control();
    const double spacing = line_.length() / static_cast<double>(spline->intervals());
    for (std::size_t i = 0; i < control.size(); ++i)
      control[i] = line_.At((static_cast<double>(i) - 1.0) * spacing);
    const std::size_t last = control.size() - 1;
    ClampTo(joints_.start, spacing, &control[0], &control[1], &control[2]);
    ClampTo(joints_.end, -spacing, &control[last], &control[last - 1], &control[last - 2]);
  }

  /// Solves p = (outer + 4 middle + inner) / 6, v T = (inner - outer) / 2, v^2 k N = outer - 2 middle +
  /// inner, the spline's position and derivatives at its end, for the control points. v < 0 at the far end,
  /// which is seen from behind.
  static void ClampTo(const PathPoint& joint, double v, Point2* outer, Point2* middle, Point2* inner) {
    const Point2 tangent = Direction(joint.heading);
    const Point2 acceleration = v * v * joint.curvature * Point2{-tangent.y, tangent.x};
    *middle = Position(joint) - (1.0 / 6.0) * acceleration;
    *outer = *middle - v * tangent + 0.5 * acceleration;
    *inner = *middle + v * tangent + 0.5 * acceleration;
  }

  void Solve(Spline* spline) const {
    std::vector<Point2>& control = spline->control();
    const double spacing = line_.length() / static_cast<double>(spline->intervals());
    ceres::Problem::Options ownership;
    ownership.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    ceres::Problem problem(ownership);
    ceres::HuberLoss loss(kHuberDelta);
    AddDeviations(spacing, &loss, &control, &problem);
    AddSmoothness(spacing, &control, &problem);
    for (std::size_t i = 0; i < 3; ++i) {
      problem.SetParameterBlockConstant(&control[i].x);
      problem.SetParameterBlockConstant(&control[control.size() - 1 - i].x);
    }
    ceres::Solver::Options options;
    options.linear_solver_type =
        control.size() < 40 ? ceres::DENSE_NORMAL_CHOLESKY : ceres::SPARSE_NORMAL_CHOLESKY;
    options.initial_trust_region_radius =
        1e8;  // Quadratic but for the Huber loss: full steps from the start.
    options.max_num_iterations = 10;
    options.function_tolerance = 1e-3;
    options.num_threads = 1;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
  }

  void AddDeviations(double spacing, ceres::LossFunction* loss, std::vector<Point2>* control,
                     ceres::Problem* problem) const {
    for (std::size_t i = 0; i + 3 < control->size(); ++i) {
      for (const double u : kSamples) {
        const double station = (static_cast<double>(i) + u) * spacing;
        auto* const deviation = new PolylineDeviation(line_.At(station), line_.HeadingAt(station), Basis(u));
        problem->AddResidualBlock(deviation, loss, Block(control, i));
      }
    }
  }

  /// Minimises the integral of deviation^2 + smoothness^6 (third derivative)^2: kinks get rounded over about
  /// the length `smoothness`. Short lanes bend more: there it gives way.
  void AddSmoothness(double spacing, std::vector<Point2>* control, ceres::Problem* problem) const {
    const double rounding = std::min(params_.smoothness, line_.length() / 4.0);
    const double weight = std::sqrt(std::pow(rounding, 6) * kSamples.size() / std::pow(spacing, 6));
    for (std::size_t i = 0; i + 3 < control->size(); ++i) {
      problem->AddResidualBlock(new ThirdDifference(weight), nullptr, Block(control, i));
    }
  }

  static std::vector<double*> Block(std::vector<Point2>* control, std::size_t i) {
    return {&(*control)[i].x, &(*control)[i + 1].x, &(*control)[i + 2].x, &(*control)[i + 3].x};
  }

  void Resample(const Spline& spline, LaneCurve* curve) const {
    const ArcLengthTable arc(spline);
    const double intervals = std::max(4.0, std::ceil(std::max(arc.length(), lane_.length) / kKnotSpacing));
    curve->scale_ = lane_.length > 0.0 ? arc.length() / lane_.length : 1.0;
    curve->spacing_ = std::max(lane_.length / intervals, 1e-9);
    const auto count = static_cast<std::size_t>(intervals) + 1;
    curve->knots_.reserve(count);
    for (std::size_t k = 0; k < count; ++k) {
      const SplinePoint p = spline.At(arc.Parameter(arc.length() * static_cast<double>(k) / intervals));
      curve->knots_.push_back({p.position.x, p.position.y, Heading(p.velocity), p.Curvature()});
    }
    // Exactly, not only to rounding: lanes that meet agree bit by bit.
    curve->knots_.front() = joints_.start;
    curve->knots_.back() = joints_.end;
    UnwrapHeadings(&curve->knots_);
  }

  static void UnwrapHeadings(std::vector<PathPoint>* knots) {
    for (std::size_t k = 1; k < knots->size(); ++k) {
      const double before = (*knots)[k - 1].heading;
      (*knots)[k].heading = before + std::remainder((*knots)[k].heading - before, 2.0 * std::numbers::pi);
    }
  }

  /// A car yaws with the curvature under its length, not at a point, and a driver cuts a bend a little: by
  /// about window^2 * curvature / 24. So a spike, as on a junction lane of a few decimetres, does not slow it
  /// down.
  double MeanCurvature(const LaneCurve& curve, double s) const {
    const double window = params_.curvature_window;
    const double reach = 0.5 * window / std::max(curve.scale_, kMinScale);
    return (curve.At(s + reach).heading - curve.At(s - reach).heading) / window;
  }

  void LimitSpeed(LaneCurve* curve) const {
    const double step = curve->spacing_ * curve->scale_;
    std::vector<double>& cap = curve->speed_cap_;
    for (std::size_t k = 0; k < curve->knots_.size(); ++k) {
      const double curvature = MeanCurvature(*curve, static_cast<double>(k) * curve->spacing_);
      const double limit = std::sqrt(params_.max_lateral_accel / std::max(std::abs(curvature), 1e-12));
      cap.push_back(std::min(kMaxSpeedCap, limit));
    }
    for (std::size_t k = cap.size() - 1; k-- > 0;) {
      cap[k] = std::min(cap[k], std::sqrt(cap[k + 1] * cap[k + 1] + 2.0 * params_.comfort_decel * step));
    }
  }

  static constexpr double kHuberDelta = 0.5;                    // [m] beyond, a deviation counts linearly.
  static constexpr std::array<double, 2> kSamples{0.25, 0.75};  // Per spline interval.

  const Lane& lane_;
  const LaneJoints& joints_;
  const CurveFitParams& params_;
  Polyline line_;
};

PathPoint LaneCurve::At(double s) const noexcept {
  if (s <= 0.0 || s >= length_) {
    const PathPoint& end = s <= 0.0 ? knots_.front() : knots_.back();
    const double ahead = scale_ * (s <= 0.0 ? s : s - length_);
    return {end.x + ahead * std::cos(end.heading), end.y + ahead * std::sin(end.heading), end.heading,
            ahead == 0.0 ? end.curvature : 0.0};
  }
  const double position = s / spacing_;
  const auto k = std::min(static_cast<std::size_t>(position), knots_.size() - 2);
  const PathPoint& a = knots_[k];
  const PathPoint& b = knots_[k + 1];
  const double u = position - static_cast<double>(k), r = 1.0 - u;
  // Cubic Hermite between the knots' tangents.
  const double step = spacing_ * scale_;
  const double wa = r * r * (1.0 + 2.0 * u), wb = u * u * (1.0 + 2.0 * r);
  const double ta = step * u * r * r, tb = -step * u * u * r;
  return {wa * a.x + wb * b.x + ta * std::cos(a.heading) + tb * std::cos(b.heading),
          wa * a.y + wb * b.y + ta * std::sin(a.heading) + tb * std::sin(b.heading),
          r * a.heading + u * b.heading, r * a.curvature + u * b.curvature};
}

double LaneCurve::SpeedCap(double s) const noexcept {
  const double position = std::clamp(s, 0.0, length_) / spacing_;
  const auto k = std::min(static_cast<std::size_t>(position), speed_cap_.size() - 2);
  const double u = std::min(position - static_cast<double>(k), 1.0);
  const double a = speed_cap_[k], b = speed_cap_[k + 1];
  return std::sqrt((1.0 - u) * a * a + u * b * b);  // Constant braking between knots.
}

double Abeam(const LaneCurve& from, double s, const LaneCurve& to) noexcept {
  const PathPoint here = from.At(s);
  double there = s;
  for (int k = 0; k < 3; ++k) {  // Newton's method; lanes side by side are nearly parallel.
    const PathPoint point = to.At(there);
    const double ahead =
        (here.x - point.x) * std::cos(point.heading) + (here.y - point.y) * std::sin(point.heading);
    there += ahead / std::max(to.scale(), 0.1);
  }
  return there;
}

std::vector<LaneCurve> FitLaneCurves(const RoadNetwork& network, const CurveFitParams& params) {
  const JointTable joints(network);
  std::vector<LaneCurve> curves(network.lanes.size());
#pragma omp parallel for schedule(dynamic, 4)
  for (std::size_t i = 0; i < curves.size(); ++i) {
    const auto lane = static_cast<LaneIndex>(i);
    const LaneJoints ends = joints.Of(lane);
    curves[i] = LaneCurveFitter(network.lanes[i], joints.PolylineOf(lane), ends, params).Fit();
  }
  return curves;
}

}  // namespace lanewise
