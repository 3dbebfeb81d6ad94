#include "analysis/lane_motion.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace lanewise {
namespace {

constexpr double kStraight = 0.02;       // [rad] bends and misalignment up to this are none: 0.8 m in 40 m.
constexpr double kLeastSegment = 0.01;   // [m] points of a line closer than this are one.
constexpr double kFarthestBeside = 5.0;  // [m] who is further from its lane does not drive on it.

Point2 Minus(Point2 a, Point2 b) {
  return {a.x - b.x, a.y - b.y};
}
double Dot(Point2 a, Point2 b) {
  return a.x * b.x + a.y * b.y;
}
double Cross(Point2 a, Point2 b) {
  return a.x * b.y - a.y * b.x;
}
double Angle(Point2 a, Point2 b) {
  return std::abs(std::atan2(Cross(a, b), Dot(a, b)));
}

}  // namespace

/// The center line of a way in front of a rear bumper, as a polyline over the distance driven.
struct LaneMotion::Way {
  static constexpr std::size_t kPoints = 48;
  std::array<double, kPoints> s, x, y;  // s [m]: 0 at the rear bumper.
  std::size_t size{0};

  void Add(double s_new, double x_new, double y_new) {
    if (size == kPoints || (size > 0 && s_new - s[size - 1] < kLeastSegment)) return;
    s[size] = s_new;
    x[size] = x_new;
    y[size] = y_new;
    ++size;
  }

  /// The point at `at`, straight on beyond both ends. `segment` is where the last search ended: searches
  /// come in order.
  Point2 At(double at, std::size_t* segment) const {
    while (*segment + 2 < size && s[*segment + 1] < at) ++*segment;
    const std::size_t k = *segment;
    const double t = (at - s[k]) / (s[k + 1] - s[k]);
    return {x[k] + t * (x[k + 1] - x[k]), y[k] + t * (y[k + 1] - y[k])};
  }
};

LaneMotion::LaneMotion(const RoadNetwork& network) : network_(network) {
  start_.reserve(network.lanes.size() + 1);
  for (const Lane& lane : network.lanes) {
    start_.push_back(static_cast<std::uint32_t>(points_.size()));
    const std::size_t begin = points_.size();
    double length = 0.0;
    for (const Point2 p : lane.shape) {
      if (points_.size() > begin) {
        const double step = std::hypot(p.x - points_.back().x, p.y - points_.back().y);
        if (step < kLeastSegment) continue;
        length += step;
      }
      points_.push_back({length, p.x, p.y, 0.0});
    }
    if (points_.size() < begin + 2) {  // A lane without extent tells nothing.
      points_.resize(begin);
      continue;
    }
    double turned = 0.0;
    for (std::size_t k = begin; k < points_.size(); ++k) {
      points_[k].s *= lane.length / length;
      if (k > begin && k + 1 < points_.size()) {
        const Point2 before{points_[k].x - points_[k - 1].x, points_[k].y - points_[k - 1].y};
        turned += Angle(before, {points_[k + 1].x - points_[k].x, points_[k + 1].y - points_[k].y});
      }
      points_[k].turned = turned;
    }
  }
  start_.push_back(static_cast<std::uint32_t>(points_.size()));
}

double LaneMotion::TurnedAt(LaneIndex lane, double s) const {
  const auto line = Line(lane);
  const auto after =
      std::upper_bound(line.begin(), line.end(), s, [](double at, const LinePoint& p) { return at < p.s; });
  return after == line.begin() ? 0.0 : (after - 1)->turned;
}

bool LaneMotion::Turns(const TrafficFrame& frame, std::size_t i, double seconds) const {
  const LanePath& path = frame.path[i];
  if (path.lane[0] == kNone || frame.speed[i] <= 0.0 || Line(path.lane[0]).empty()) return false;
  const auto line = Line(path.lane[0]);
  const double front = frame.lane_pos[i], rear = front - frame.length[i];

  // Out of line with the lane?
  auto at = std::upper_bound(line.begin() + 1, line.end() - 1, front,
                             [](double s, const LinePoint& p) { return s < p.s; });
  const Point2 along{at->x - (at - 1)->x, at->y - (at - 1)->y};
  const Point2 u{std::cos(frame.heading[i]), std::sin(frame.heading[i])};
  const double aside = Cross(along, u), ahead = Dot(along, u);
  if (ahead <= 0.0 || std::abs(aside) > kStraight * ahead) return true;

  // Bends, from the rear bumper on.
  double turned = 0.0;
  const auto joint = [this](LaneIndex from, LaneIndex to) {
    const auto a = Line(from), b = Line(to);
    if (a.empty() || b.empty()) return 0.0;
    const LinePoint &p = a[a.size() - 2], &q = a.back();
    return Angle({q.x - p.x, q.y - p.y}, {b[1].x - b[0].x, b[1].y - b[0].y});
  };
  if (rear < 0.0 && frame.lane_behind[i] != kNone) {
    const LaneIndex behind = frame.lane_behind[i];
    if (!Line(behind).empty())
      turned += Line(behind).back().turned - TurnedAt(behind, network_.lanes[behind].length + rear);
    turned += joint(behind, path.lane[0]);
  }
  double begin = std::max(0.0, rear), end = front + seconds * frame.speed[i];
  for (std::size_t k = 0; k < LanePath::kLanes && path.lane[k] != kNone && turned <= kStraight; ++k) {
    const LaneIndex lane = path.lane[k];
    if (k > 0) turned += joint(path.lane[k - 1], lane);
    if (!Line(lane).empty() && Line(lane).back().turned > 0.0)
      turned += TurnedAt(lane, end) - TurnedAt(lane, begin);
    begin = 0.0;
    end -= network_.lanes[lane].length;
    if (end <= 0.0) break;
  }
  return turned > kStraight;
}

LaneMotion::Way LaneMotion::WayOf(const TrafficFrame& frame, std::size_t i, double ahead) const {
  Way way;
  const LanePath& path = frame.path[i];
  const double rear = frame.lane_pos[i] - frame.length[i];
  // Points of a lane that begins at `offset` of the way, and the one before the rear bumper.
  const auto add = [&](LaneIndex lane, double offset) {
    const auto line = Line(lane);
    for (std::size_t k = 0; k < line.size(); ++k) {
      if (k + 1 < line.size() && offset + line[k + 1].s <= 0.0) continue;
      way.Add(offset + line[k].s, line[k].x, line[k].y);
      if (offset + line[k].s > ahead) return;
    }
  };
  if (rear < 0.0 && frame.lane_behind[i] != kNone)
    add(frame.lane_behind[i], -rear - network_.lanes[frame.lane_behind[i]].length);
  double offset = -rear;
  for (std::size_t k = 0; k < LanePath::kLanes && path.lane[k] != kNone && offset <= ahead; ++k) {
    add(path.lane[k], offset);
    offset += network_.lanes[path.lane[k]].length;
  }
  return way;
}

void LaneMotion::Follow(const TrafficFrame& frame, std::size_t i, double period,
                        std::span<BoxPose> poses) const {
  const Point2 u{std::cos(frame.heading[i]), std::sin(frame.heading[i])};
  const double length = frame.length[i], speed = frame.speed[i];
  const Point2 center{frame.x[i] - 0.5 * length * u.x, frame.y[i] - 0.5 * length * u.y};
  const double aside = frame.lateral_speed[i];
  const double along = std::sqrt(std::max(0.0, speed * speed - aside * aside));
  poses[0] = {center, u};

  const double last = period * static_cast<double>(poses.size() - 1);
  const Way way = WayOf(frame, i, length + last * along);
  std::size_t rear_segment = 0, front_segment = 0;
  // The box with both bumpers on the line, when it has driven `way_driven`.
  const auto on_line = [&](double way_driven) {
    const Point2 rear = way.At(way_driven, &rear_segment);
    const Point2 chord = Minus(way.At(way_driven + length, &front_segment), rear);
    const double chord_length = std::sqrt(Dot(chord, chord));
    if (chord_length < kLeastSegment) return BoxPose{rear, u};  // The way turns on the spot.
    return BoxPose{{rear.x + 0.5 * chord.x, rear.y + 0.5 * chord.y},
                   {chord.x / chord_length, chord.y / chord_length}};
  };
  // Where it is now, seen from there.
  const BoxPose line = way.size >= 2 && length > kLeastSegment ? on_line(0.0) : BoxPose{};
  const Point2 beside = Minus(center, line.center);
  const bool follows = way.size >= 2 && length > kLeastSegment && Dot(line.u, u) > 0.5 &&
                       Dot(beside, beside) < kFarthestBeside * kFarthestBeside;
  const double ahead_of_line = Dot(line.u, beside), left_of_line = Cross(line.u, beside);
  const Point2 askew{Dot(line.u, u), Cross(line.u, u)};
  for (std::size_t k = 1; k < poses.size(); ++k) {
    const double time = period * static_cast<double>(k);
    if (!follows) {
      poses[k] = {{center.x + time * frame.vx[i], center.y + time * frame.vy[i]}, u};
      continue;
    }
    const BoxPose then = on_line(along * time);
    const double left = left_of_line + aside * time;
    poses[k] = {{then.center.x + ahead_of_line * then.u.x - left * then.u.y,
                 then.center.y + ahead_of_line * then.u.y + left * then.u.x},
                {askew.x * then.u.x - askew.y * then.u.y, askew.x * then.u.y + askew.y * then.u.x}};
  }
}

}  // namespace lanewise
