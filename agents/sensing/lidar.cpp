#include "agents/sensing/lidar.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <numbers>

#include "agents/core/check.h"

namespace lanewise {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kHalfPi = 0.5 * std::numbers::pi;
/// Standard deviations at which the range error is cut off.
constexpr double kErrorLimit = 4.0;
/// [m^2] of area between sensor and edge below which the edge is seen end on.
constexpr double kEndOn = 1e-12;

double Cross(Point2 a, Point2 b) {
  return a.x * b.y - a.y * b.x;
}

/// [rad] angle of a point of the right half-plane, x >= 0, to 2e-4: a polynomial, much faster than
/// std::atan2. Good enough to find the beams near it, which are then tested exactly.
constexpr double kFastAngleError = 2e-4;
double FastAngle(Point2 p) {
  const double across = std::abs(p.y);
  const double low = std::min(p.x, across), high = std::max(p.x, across);
  const double t = high > 0.0 ? low / high : 0.0, q = t * t;
  const double angle = ((-0.0464964749 * q + 0.15931422) * q - 0.327622764) * q * t + t;
  return std::copysign(across > p.x ? kHalfPi - angle : angle, p.y);
}

/// Keeps the part t in [t0, t1] where value + t * slope >= 0.
void Clip(double value, double slope, double* t0, double* t1) {
  if (slope > 0.0) {
    *t0 = std::max(*t0, -value / slope);
  } else if (slope < 0.0) {
    *t1 = std::min(*t1, -value / slope);
  } else if (value < 0.0) {
    *t1 = -1.0;
  }
}

/// Does any edge come nearer to the sensor than this?
bool ReachesWithin(const LidarScene& scene, double radius) {
  return std::any_of(scene.edges().begin(), scene.edges().end(), [&](const ReflectingEdge& edge) {
    const double ex = edge.b.x - edge.a.x, ey = edge.b.y - edge.a.y, ee = ex * ex + ey * ey;
    const double along = std::clamp(-(edge.a.x * ex + edge.a.y * ey), 0.0, ee);
    const double x = edge.a.x * ee + along * ex, y = edge.a.y * ee + along * ey;
    return x * x + y * y <= radius * radius * ee * ee;
  });
}

void SetBits(int first, int last, std::uint64_t* words) {
  const int first_word = first / 64, last_word = last / 64;
  const std::uint64_t head = ~std::uint64_t{0} << (first % 64);
  const std::uint64_t tail = ~std::uint64_t{0} >> (63 - last % 64);
  if (first_word == last_word) {
    words[first_word] |= head & tail;
    return;
  }
  words[first_word] |= head;
  for (int w = first_word + 1; w < last_word; ++w) words[w] = ~std::uint64_t{0};
  words[last_word] |= tail;
}

/// Of word w, the bits begin to end - 1 of all.
std::uint64_t BitsOfWord(int w, int begin, int end) {
  std::uint64_t bits = ~std::uint64_t{0};
  if (w == begin / 64) bits &= ~std::uint64_t{0} << (begin % 64);
  if (w == (end - 1) / 64) bits &= ~std::uint64_t{0} >> (63 - (end - 1) % 64);
  return bits;
}

void ClearBits(int begin, int end, std::uint64_t* words) {
  for (int w = begin / 64; w <= (end - 1) / 64; ++w) words[w] &= ~BitsOfWord(w, begin, end);
}

int CountBits(int begin, int end, const std::uint64_t* words) {
  int count = 0;
  for (int w = begin / 64; w <= (end - 1) / 64; ++w)
    count += std::popcount(words[w] & BitsOfWord(w, begin, end));
  return count;
}

}  // namespace

LidarParams SongLidar() {
  LidarParams params;
  params.beams = 1081;
  params.field = 1.5 * std::numbers::pi;
  params.max_range = 30.0;
  params.scan_period = 0.025;
  return params;
}

LidarParams RingLidar() {
  LidarParams params = SongLidar();
  params.beams = 360;
  // The last beam is one spacing before the first one.
  params.field = 2.0 * std::numbers::pi * 359.0 / 360.0;
  return params;
}

void LidarScene::AddBox(const ReflectingBox& box) {
  const Point2 u = box.axis, w{-u.y, u.x};
  // The sensor in the frame of the box.
  const double along = -(box.center.x * u.x + box.center.y * u.y);
  const double across = -(box.center.x * w.x + box.center.y * w.y);
  const auto corner = [&](double l, double m) {
    return Point2{box.center.x + l * box.half_length * u.x + m * box.half_width * w.x,
                  box.center.y + l * box.half_length * u.y + m * box.half_width * w.y};
  };
  const bool inside = std::abs(along) <= box.half_length && std::abs(across) <= box.half_width;
  if (along > box.half_length || inside) AddEdge(corner(1, -1), corner(1, 1));
  if (along < -box.half_length || inside) AddEdge(corner(-1, 1), corner(-1, -1));
  if (across > box.half_width || inside) AddEdge(corner(1, 1), corner(-1, 1));
  if (across < -box.half_width || inside) AddEdge(corner(-1, -1), corner(1, -1));
}

void LidarScene::AddEdge(Point2 a, Point2 b) {
  const double area = Cross(a, b);
  if (std::abs(area) < kEndOn) return;
  edges_.push_back(area > 0.0 ? ReflectingEdge{a, b} : ReflectingEdge{b, a});
}

ScanErrors::ScanErrors(const LidarParams& params, std::uint64_t seed, std::int32_t vehicle, std::int64_t step)
    : deviation_(params.range_noise),
      bound_(kErrorLimit * params.range_noise),
      dropout_(static_cast<unsigned>(std::lround(256.0 * params.dropout))),
      range_(seed, static_cast<std::uint64_t>(vehicle), RandomPurpose::kLidarRange,
             static_cast<std::uint64_t>(step)),
      drop_(seed, static_cast<std::uint64_t>(vehicle), RandomPurpose::kLidarDropout,
            static_cast<std::uint64_t>(step)) {}

ScanErrors::ScanErrors() : ScanErrors(LidarParams{.range_noise = 0.0, .dropout = 0.0}, 0, 0, 0) {}

double ScanErrors::RangeError(int beam) const {
  return deviation_ > 0.0 ? deviation_ * range_.Normal(static_cast<std::uint64_t>(beam), kErrorLimit) : 0.0;
}

std::uint64_t ScanErrors::DroppedWord(int word) const {
  if (dropout_ == 0) return 0;
  if (dropout_ >= 256) return ~std::uint64_t{0};
  // 64 independent bits that are 1 with probability dropout / 256: the binary digits of the probability from
  // the last to the first, each with fair bits (or them in for a 1, and for a 0).
  std::uint64_t bits = 0;
  for (unsigned digit = 0; digit < 8; ++digit) {
    const std::uint64_t fair = drop_.Bits(static_cast<std::uint64_t>(word) * 8 + digit);
    bits = dropout_ >> digit & 1 ? bits | fair : bits & fair;
  }
  return bits;
}

AvoidanceZone ZoneForSpeed(const AgentParams& params, double width, double speed, double leader_speed) {
  const SectorParams& s = params.sector;
  const double braking = std::max(0.0, speed * speed - leader_speed * leader_speed) / (2.0 * s.decel);
  const double far = std::min(s.standstill + speed * (s.reaction_time + params.lidar.scan_period) + braking,
                              params.lidar.max_range);
  return {s.near_limit, far, 0.5 * width + s.side_clearance, std::min(far, s.side_range)};
}

AvoidanceZone TurnZone(const AgentParams& params, double width, double speed) {
  const SectorParams& s = params.sector;
  AvoidanceZone zone = ZoneForSpeed(params, width, speed);
  zone.far = std::min(zone.far - s.standstill + s.turn_reach, params.lidar.max_range);
  zone.side = s.turn_reach;
  zone.side_width = s.turn_width;
  return zone;
}

AvoidanceZone DrawnIn(const AvoidanceZone& zone, double factor) {
  AvoidanceZone drawn = zone;
  drawn.far *= factor;
  drawn.side = std::min(zone.side, drawn.far);
  return drawn;
}

std::uint8_t SectorCode(const SectorCounts& counts, int min_points) {
  unsigned code = 0;
  for (int i = 0; i < kSectors; ++i) code |= (counts[i] > min_points ? 0u : 1u) << i;
  return static_cast<std::uint8_t>(code);
}

Lidar::Lidar(const LidarParams& params)
    : params_(params),
      first_angle_(-0.5 * params.field),
      spacing_(params.beams > 1 ? params.field / (params.beams - 1) : 1.0) {
  LANEWISE_CHECK(params.beams > 0 && params.beams <= kMaxWords * 64);
  for (int k = 0; k < params.beams; ++k) {
    x_.push_back(std::cos(Angle(k)));
    y_.push_back(std::sin(Angle(k)));
  }
  // A beam on the border of two sectors belongs to the left one; straight left still to the last one.
  for (int i = 0; i <= kSectors; ++i) {
    const double border = -kHalfPi + i * std::numbers::pi / kSectors + (i == kSectors ? 1e-9 : -1e-9);
    sector_begin_[i] =
        std::clamp(static_cast<int>(std::ceil((border - first_angle_) / spacing_)), 0, params.beams);
  }
}

double Lidar::Range(const ReflectingEdge& edge, int beam) const {
  const Point2 u{x_[beam], y_[beam]};
  const double before = Cross(edge.a, u), behind = Cross(u, edge.b);
  if (before < 0.0 || behind < 0.0) return kInfinity;
  const double range = Cross(edge.a, edge.b) / (before + behind);
  // Both are zero only for the beam away from an edge that is nearly end on.
  return range > 0.0 ? range : kInfinity;
}

double Lidar::NearestRange(const LidarScene& scene, int beam) const {
  double nearest = kInfinity;
  for (const ReflectingEdge& edge : scene.edges()) nearest = std::min(nearest, Range(edge, beam));
  return nearest;
}

bool Lidar::InZone(double range, int beam, const AvoidanceZone& zone) const {
  if (range < zone.near) return false;
  return IsFront(beam) ? range <= zone.far && range * std::abs(y_[beam]) <= zone.half_width
                       : range <= zone.side && range * std::abs(y_[beam]) <= zone.side_width;
}

void Lidar::Cast(const LidarScene& scene, const ScanErrors& errors, std::span<double> ranges) const {
  LANEWISE_CHECK(ranges.size() == x_.size());
  for (int k = 0; k < beams(); ++k) {
    const double range = NearestRange(scene, k);
    const bool reflects = range <= params_.max_range && !errors.Dropped(k);
    ranges[k] = reflects ? std::max(0.0, range + errors.RangeError(k)) : kInfinity;
  }
}

SectorCounts Lidar::Count(std::span<const double> ranges, const AvoidanceZone& zone) const {
  LANEWISE_CHECK(ranges.size() == x_.size());
  SectorCounts counts{};
  for (int i = 0; i < kSectors; ++i) {
    for (int k = sector_begin_[i]; k < sector_begin_[i + 1]; ++k)
      counts[kSectors - 1 - i] += InZone(ranges[k], k, zone) ? 1 : 0;
  }
  return counts;
}

void Lidar::MarkEdge(const ReflectingEdge& edge, double far, double half_width, int first, int last,
                     std::uint64_t* marks) const {
  // Most edges lie wholly behind, beside or beyond.
  if (std::max(edge.a.x, edge.b.x) < -1e-9 || std::min(edge.a.x, edge.b.x) > far) return;
  const double beside = std::min(far, half_width);
  if (std::min(edge.a.y, edge.b.y) > beside || std::max(edge.a.y, edge.b.y) < -beside) return;
  const Point2 e{edge.b.x - edge.a.x, edge.b.y - edge.a.y};
  // The part of the edge in front of the sensor, in the strip and in the circle.
  double t0 = 0.0, t1 = 1.0;
  Clip(edge.a.x + 1e-9, e.x, &t0, &t1);
  if (half_width < kInfinity) {
    Clip(half_width - edge.a.y, -e.y, &t0, &t1);
    Clip(half_width + edge.a.y, e.y, &t0, &t1);
  }
  if (t0 > t1) return;
  const double ee = e.x * e.x + e.y * e.y, ae = edge.a.x * e.x + edge.a.y * e.y;
  const double aa = edge.a.x * edge.a.x + edge.a.y * edge.a.y;
  const double root = ae * ae - ee * (aa - far * far);
  if (root < 0.0) return;
  const double half_chord = std::sqrt(root);
  t0 = std::max(t0, (-ae - half_chord) / ee);
  t1 = std::min(t1, (-ae + half_chord) / ee);
  if (t0 > t1) return;
  const Point2 p{std::max(0.0, edge.a.x + t0 * e.x), edge.a.y + t0 * e.y};
  const Point2 q{std::max(0.0, edge.a.x + t1 * e.x), edge.a.y + t1 * e.y};
  // Ends right of the first beam, or begins left of the last one.
  if (Cross({x_[first], y_[first]}, q) < -1e-9 || Cross(p, {x_[last], y_[last]}) < -1e-9) return;
  const double slack = kFastAngleError / spacing_ + 0.01;
  first = std::max(first, static_cast<int>((FastAngle(p) - first_angle_) / spacing_ - slack));
  last = std::min(last, static_cast<int>((FastAngle(q) - first_angle_) / spacing_ + slack) + 1);
  const auto hits = [&](int k) {
    const double range = Range(edge, k);
    return range <= far && range * std::abs(y_[k]) <= half_width;
  };
  while (first <= last && !hits(first)) ++first;
  while (first <= last && !hits(last)) --last;
  if (first <= last) SetBits(first, last, marks);
}

void Lidar::MarkDisc(const LidarScene& scene, double radius, double half_width, int begin, int end,
                     Marks* marks) const {
  std::fill_n(marks->begin(), words(), std::uint64_t{0});
  if (radius <= 0.0 || half_width <= 0.0 || begin >= end) return;
  for (const ReflectingEdge& edge : scene.edges())
    MarkEdge(edge, radius, half_width, begin, end - 1, marks->data());
}

void Lidar::MarkZone(const LidarScene& scene, const AvoidanceZone& zone, double grown, int begin, int end,
                     Marks* marks) const {
  const auto reach = [&](double limit) { return std::min(limit + grown, params_.max_range); };
  const int front = std::max(begin, front_begin()), behind_front = std::min(end, front_end());
  const bool all_front = front == begin && behind_front == end;
  MarkDisc(scene, all_front ? 0.0 : reach(zone.side), zone.side_width + grown, begin, end, marks);
  if (front >= behind_front) return;
  ClearBits(front, behind_front, marks->data());
  const double far = reach(zone.far), half_width = zone.half_width + grown;
  if (far <= 0.0 || half_width <= 0.0) return;
  for (const ReflectingEdge& edge : scene.edges())
    MarkEdge(edge, far, half_width, front, behind_front - 1, marks->data());
}

void Lidar::MarkSure(const LidarScene& scene, const ScanErrors& errors, const AvoidanceZone& zone,
                     Marks* sure) const {
  const double bound = errors.max_range_error();
  const int begin = sector_begin_[0], end = sector_begin_[kSectors];
  MarkZone(scene, zone, -bound, begin, end, sure);
  if (ReachesWithin(scene, zone.near + bound)) {
    // Nearer than the near limit is dust. A reading at the limit is in the zone.
    Marks dust;
    MarkDisc(scene, std::nextafter(zone.near + bound, 0.0), kInfinity, begin, end, &dust);
    for (int w = 0; w < words(); ++w) (*sure)[w] &= ~dust[w];
  }
  for (int w = 0; errors.drops() && w < words(); ++w) (*sure)[w] &= ~errors.DroppedWord(w);
}

void Lidar::MarkDoubtful(const LidarScene& scene, const ScanErrors& errors, const AvoidanceZone& zone,
                         const Marks& sure, int begin, int end, Marks* doubtful) const {
  // Those of the grown zone that are neither surely in nor surely dust.
  const double bound = errors.max_range_error();
  MarkZone(scene, zone, bound, begin, end, doubtful);
  for (int w = 0; w < words(); ++w) (*doubtful)[w] &= ~sure[w];
  if (ReachesWithin(scene, zone.near - bound)) {
    Marks dust;
    MarkDisc(scene, std::nextafter(zone.near - bound, 0.0), kInfinity, begin, end, &dust);
    for (int w = 0; w < words(); ++w) (*doubtful)[w] &= ~dust[w];
  }
  for (int w = 0; errors.drops() && w < words(); ++w) (*doubtful)[w] &= ~errors.DroppedWord(w);
}

int Lidar::CountDoubtful(const LidarScene& scene, const ScanErrors& errors, const AvoidanceZone& zone, int i,
                         const Marks& doubtful) const {
  const int begin = sector_begin_[i], end = sector_begin_[i + 1];
  int count = 0;
  for (int w = begin / 64; w <= (end - 1) / 64; ++w) {
    for (std::uint64_t rest = doubtful[w] & BitsOfWord(w, begin, end); rest != 0; rest &= rest - 1) {
      const int k = 64 * w + std::countr_zero(rest);
      const double reading = std::max(0.0, NearestRange(scene, k) + errors.RangeError(k));
      count += InZone(reading, k, zone) ? 1 : 0;
    }
  }
  return count;
}

SectorCounts Lidar::CountExactly(const LidarScene& scene, const ScanErrors& errors,
                                 const AvoidanceZone& zone) const {
  return CountAtLeast(scene, errors, zone, std::nullopt);
}

std::uint8_t Lidar::Code(const LidarScene& scene, const ScanErrors& errors, const AvoidanceZone& zone,
                         int min_points) const {
  return SectorCode(CountAtLeast(scene, errors, zone, min_points), min_points);
}

SectorCounts Lidar::CountAtLeast(const LidarScene& scene, const ScanErrors& errors, const AvoidanceZone& zone,
                                 std::optional<int> enough) const {
  Marks sure;
  MarkSure(scene, errors, zone, &sure);
  SectorCounts counts{};
  int first_open = kSectors, last_open = -1;  // Sectors that doubtful beams may still block.
  for (int i = 0; i < kSectors; ++i) {
    const int begin = sector_begin_[i], end = sector_begin_[i + 1];
    if (begin == end) continue;
    counts[kSectors - 1 - i] = CountBits(begin, end, sure.data());
    if (enough && counts[kSectors - 1 - i] > *enough) continue;
    first_open = std::min(first_open, i);
    last_open = i;
  }
  if (errors.max_range_error() <= 0.0 || last_open < 0) return counts;
  Marks doubtful;
  MarkDoubtful(scene, errors, zone, sure, sector_begin_[first_open], sector_begin_[last_open + 1], &doubtful);
  for (int i = first_open; i <= last_open; ++i) {
    const int begin = sector_begin_[i], end = sector_begin_[i + 1];
    int& count = counts[kSectors - 1 - i];
    if (begin == end || (enough && count > *enough)) continue;
    if (!enough || count + CountBits(begin, end, doubtful.data()) > *enough)
      count += CountDoubtful(scene, errors, zone, i, doubtful);
  }
  return counts;
}

}  // namespace lanewise
