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
  const auto direction = [](const LinePoint& p, const LinePoint& q) {
    const double length = std::hypot(q.x - p.x, q.y - p.y);
    return Point2{(q.x - p.x) / length, (q.y - p.y) / length};
  };
  for (std::size_t lane = 0; lane < network.lanes.size(); ++lane) {
    const auto line = Line(static_cast<LaneIndex>(lane));
    first_direction_.push_back(line.empty() ? Point2{} : direction(line[0], line[1]));
    last_direction_.push_back(line.empty() ? Point2{} : direction(line[line.size() - 2], line.back()));
  }
}

double LaneMotion::TurnedBetween(LaneIndex from, LaneIndex to) const {
  const Point2 before = last_direction_[from], after = first_direction_[to];
  return Dot(before, after) < 0.0 ? 1.0 : std::abs(Cross(before, after));
}

double LaneMotion::TurnedAt(LaneIndex lane, double s) const {
  const auto line = Line(lane);
  const auto after =
      std::upper_bound(line.begin(), line.end(), s, [](double at, const LinePoint& p) { return at < p.s; });
  return after == line.begin() ? 0.0 : (after - 1)->turned;
}

bool LaneMotion::Turns(const TrafficFrame& frame, std::size_t i, const BoxPose& now, double seconds) const {
  const LanePath& path = frame.path[i];
  const LaneIndex own = path.lane[0];
  if (own == kNone || frame.speed[i] <= 0.0) return false;
  const auto line = Line(own);
  if (line.empty()) return false;
  const double front = frame.lane_pos[i], rear = front - frame.length[i];
  const bool bends = line.back().turned > 0.0;

  // Out of line with the lane?
  Point2 along = first_direction_[own];
  if (bends) {
    const auto at = std::upper_bound(line.begin() + 1, line.end() - 1, front,
                                     [](double s, const LinePoint& p) { return s < p.s; });
    along = {at->x - (at - 1)->x, at->y - (at - 1)->y};
  }
  const double aside = Cross(along, now.u), ahead = Dot(along, now.u);
  if (ahead <= 0.0 || std::abs(aside) > kStraight * ahead) return true;

  // Bends, from the rear bumper on.
  double begin = rear, end = front + seconds * frame.speed[i], turned = 0.0;
  if (rear < 0.0) {
    begin = 0.0;
    const LaneIndex behind = frame.lane_behind[i];
    if (behind != kNone) {
      turned = TurnedBetween(behind, own);
      const auto line_behind = Line(behind);
      if (!line_behind.empty() && line_behind.back().turned > 0.0)
        turned += line_behind.back().turned - TurnedAt(behind, network_.lanes[behind].length + rear);
    }
  }
  if (bends) turned += TurnedAt(own, end) - TurnedAt(own, begin);
  for (std::size_t k = 1; k < LanePath::kLanes && path.lane[k] != kNone && turned <= kStraight; ++k) {
    end -= network_.lanes[path.lane[k - 1]].length;
    if (end <= 0.0) break;
    turned += TurnedBetween(path.lane[k - 1], path.lane[k]);
    if (const auto next = Line(path.lane[k]); !next.empty() && next.back().turned > 0.0)
      turned += TurnedAt(path.lane[k], end);
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

void LaneMotion::Follow(const TrafficFrame& frame, std::size_t i, const BoxPose& now, double period,
                        std::span<BoxPose> poses) const {
  const Point2 center = now.center, u = now.u;
  const double length = frame.length[i], speed = frame.speed[i];
  const double aside = frame.lateral_speed[i];
  const double along = std::sqrt(std::max(0.0, speed * speed - aside * aside));
  poses[0] = now;

  const double last = period * static_cast<double>(poses.size() - 1);
  const Way way = WayOf(frame, i, length + last * along);
  std::size_t rear_segment = 0, front_segment = 0;
  // The box with both bumpers on the line, when it has driven `way_driven`.
  const auto on_line = [&](double way_driven) {
    const Point2 rear = way.At(way_driven, &rear_segment);
    const Point2 chord = Minus(way.At(way_driven + length, &front_segment), rear);
    const double chord_length = std::sqrt(Dot(chord, chord));
    if (chord_length < kLeastSegment) return BoxPose{rear, now.u};  // The way turns on the spot.
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
