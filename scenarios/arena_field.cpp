#include "scenarios/arena_field.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "agents/core/random.h"

namespace lanewise {
namespace {

/// Numbers drawn one after the other from a field's stream.
class Draw {
 public:
  explicit Draw(RandomStream stream) : stream_(stream) {}
  double Between(double low, double high) { return low + (high - low) * stream_.Uniform(count_++); }
  int Whole(int low, int high) { return low + static_cast<int>(Between(0.0, high - low + 1.0)); }
  bool Chance(double p) { return Between(0.0, 1.0) < p; }
  double Sign() { return Chance(0.5) ? 1.0 : -1.0; }

 private:
  RandomStream stream_;
  std::uint64_t count_{0};
};

/// A box by its middle.
Footprint Box(double x, double y, double heading, double length, double width) {
  return {
      {x + 0.5 * length * std::cos(heading), y + 0.5 * length * std::sin(heading), heading}, length, width};
}

/// A wall from a to b, in pieces short enough to be found by their middles.
void AddWall(Point2 a, Point2 b, std::vector<Footprint>* things) {
  constexpr double kThickness = 0.3, kPiece = 4.0;  // [m]
  const double length = std::hypot(b.x - a.x, b.y - a.y), heading = std::atan2(b.y - a.y, b.x - a.x);
  const int pieces = std::max(1, static_cast<int>(std::ceil(length / kPiece)));
  for (int k = 0; k < pieces; ++k) {
    const double t = (k + 0.5) / pieces;
    things->push_back(
        Box(a.x + t * (b.x - a.x), a.y + t * (b.y - a.y), heading, length / pieces, kThickness));
  }
}

/// [m] of road that holds things: room to start before it and to come to rest behind it.
constexpr double kFirst = 45.0, kLast = 255.0;

/// Walls that stand out from either side, one after the other, each leaving a gap.
void Walls(Draw* draw, const ArenaRoad& road, ArenaField* field) {
  for (double x = kFirst + draw->Between(0.0, 15.0); x < kLast; x += draw->Between(40.0, 70.0)) {
    const double side = draw->Sign(), gap = draw->Between(3.5, 7.0), tilt = draw->Between(-0.25, 0.25);
    const double length = 2.0 * road.half_width - gap;
    AddWall({x, side * road.half_width}, {x + tilt * length, side * (road.half_width - length)},
            &field->things);
  }
}

void Boxes(Draw* draw, const ArenaRoad& road, ArenaField* field) {
  const int count = draw->Whole(10, 24);
  for (int k = 0; k < count; ++k) {
    field->things.push_back(
        Box(draw->Between(kFirst, kLast), draw->Between(-road.half_width, road.half_width),
            draw->Between(0.0, std::numbers::pi), draw->Between(0.5, 2.5), draw->Between(0.5, 1.5)));
  }
}

/// Tables with chairs around them, somewhat pulled out.
void Furniture(Draw* draw, const ArenaRoad& road, ArenaField* field) {
  const int tables = draw->Whole(4, 8);
  for (int k = 0; k < tables; ++k) {
    const double x = draw->Between(kFirst, kLast),
                 y = draw->Between(1.0 - road.half_width, road.half_width - 1.0);
    const double heading = draw->Between(0.0, std::numbers::pi), length = draw->Between(1.2, 2.4);
    const double width = draw->Between(0.8, 1.2), c = std::cos(heading), n = std::sin(heading);
    field->things.push_back(Box(x, y, heading, length, width));
    const int chairs = draw->Whole(2, 6);
    for (int j = 0; j < chairs; ++j) {
      const double along = draw->Between(-0.5, 0.5) * length;
      const double across = draw->Sign() * (0.5 * width + draw->Between(0.3, 1.2));
      field->things.push_back(Box(x + along * c - across * n, y + along * n + across * c,
                                  heading + draw->Between(-0.6, 0.6), 0.5, 0.5));
    }
  }
}

/// Two walls side by side along the road, with bends; at its mouth they open to the borders.
void Corridor(Draw* draw, const ArenaRoad& road, ArenaField* field) {
  const double half = 0.5 * draw->Between(3.6, 5.5), limit = road.half_width - half - 0.5;
  double x = kFirst + 10.0, y = draw->Between(-1.0, 1.0) * limit;
  for (const double side : {1.0, -1.0})
    AddWall({x - 12.0, side * road.half_width}, {x, y + side * half}, &field->things);
  const double end = kLast - draw->Between(0.0, 60.0);
  while (x < end) {
    const double length = draw->Between(12.0, 35.0);
    const double next = std::clamp(y + draw->Between(-0.1, 0.1) * length, -limit, limit);
    for (const double side : {1.0, -1.0})
      AddWall({x, y + side * half}, {x + length, next + side * half}, &field->things);
    x += length;
    y = next;
  }
}

/// Cars at both kerbs, some beside them in the second row or askew.
void ParkedCars(Draw* draw, const ArenaRoad& road, ArenaField* field) {
  for (const double side : {1.0, -1.0}) {
    for (double x = kFirst + draw->Between(0.0, 20.0); x < kLast; x += draw->Between(5.5, 22.0)) {
      const double length = draw->Between(3.8, 5.0), width = draw->Between(1.65, 1.95);
      const bool second_row = draw->Chance(0.2), askew = draw->Chance(0.2);
      const double y =
          side * (road.half_width - 0.5 * width - 0.2 - (second_row ? draw->Between(1.5, 3.0) : 0.0));
      field->things.push_back(
          Box(x, y, askew ? draw->Between(-0.5, 0.5) : draw->Between(-0.03, 0.03), length, width));
    }
  }
}

/// Persons who cross about when a vehicle may come, among a few cars parked at the kerb.
void Pedestrian(Draw* draw, const ArenaRoad& road, ArenaField* field) {
  const int persons = draw->Whole(1, 3);
  for (int k = 0; k < persons; ++k) {
    const double x = draw->Between(80.0, 240.0), side = draw->Sign(), speed = draw->Between(0.7, 2.0);
    const double from = road.half_width + draw->Between(0.6, 3.0);
    const double vehicle_at = x / draw->Between(6.0, 12.0);
    // It is within two metres of the road's middle when a vehicle at that speed is there.
    const double arrive = (from + draw->Between(-2.0, 2.0)) / speed;
    field->persons.push_back({{x, side * from}, speed, -side, std::max(0.0, vehicle_at - arrive)});
  }
  const int cars = draw->Whole(0, 6);
  for (int k = 0; k < cars; ++k) {
    const double x = draw->Between(kFirst, kLast);
    const bool crossed = std::any_of(field->persons.begin(), field->persons.end(),
                                     [&](const CrossingPerson& p) { return std::abs(p.from.x - x) < 4.0; });
    if (!crossed) field->things.push_back(Box(x, draw->Sign() * (road.half_width - 1.1), 0.0, 4.6, 1.8));
  }
}

// The lattice: layers along the road, slopes tan(heading), and positions so fine that a motion between slopes
// i and j over a layer, (i + j) / 2 * kSlope * kLayer across, is a whole number of them.
constexpr double kLayer = 0.25, kSlope = 0.04;   // [m], [-]
constexpr int kSlopes = 18;                      // -18 .. 18: up to 36 deg.
constexpr double kCell = 0.5 * kSlope * kLayer;  // [m] 5 mm.

/// A set of lateral positions, one bit a cell.
class PositionSet {
 public:
  static constexpr int kWords = 40;
  static constexpr int kCells = 64 * kWords;

  void Clear() { words_.fill(0); }
  bool Empty() const {
    return std::all_of(words_.begin(), words_.end(), [](std::uint64_t w) { return w == 0; });
  }
  void Set(int cell) { words_[cell / 64] |= std::uint64_t{1} << (cell % 64); }
  void Erase(int first, int last) {
    first = std::max(first, 0);
    last = std::min(last, kCells - 1);
    for (int w = first / 64; first <= last && w <= last / 64; ++w) {
      std::uint64_t mask = ~std::uint64_t{0};
      if (w == first / 64) mask &= ~std::uint64_t{0} << (first % 64);
      if (w == last / 64) mask &= ~std::uint64_t{0} >> (63 - last % 64);
      words_[w] &= ~mask;
    }
  }
  /// Adds every position of `other`, moved by `shift` cells.
  void AddShifted(const PositionSet& other, int shift) {
    const int whole = shift >= 0 ? shift / 64 : -((-shift + 63) / 64), part = shift - 64 * whole;
    for (int w = 0; w < kWords; ++w) {
      const int from = w - whole;
      std::uint64_t word = from >= 0 && from < kWords ? other.words_[from] << part : 0;
      if (part > 0 && from - 1 >= 0 && from - 1 < kWords) word |= other.words_[from - 1] >> (64 - part);
      words_[w] |= word;
    }
  }

 private:
  std::array<std::uint64_t, kWords> words_{};
};

struct Interval {
  double min, max;
};

/// The lateral positions d at which a box with middle (x, d + y0) meets another one; none if min > max.
Interval Meeting(double x, double y0, Point2 u, double half_length, double half_width,
                 const Footprint& other) {
  const Point2 v{std::cos(other.front.heading), std::sin(other.front.heading)};
  const double other_length = 0.5 * other.length, other_width = 0.5 * other.width;
  const double dx = other.front.x - other_length * v.x - x, dy = other.front.y - other_length * v.y - y0;
  const double c = std::abs(u.x * v.x + u.y * v.y), s = std::abs(u.x * v.y - u.y * v.x);
  const Point2 axes[4] = {u, {-u.y, u.x}, v, {-v.y, v.x}};
  const double reach[4] = {
      half_length + c * other_length + s * other_width, half_width + s * other_length + c * other_width,
      other_length + c * half_length + s * half_width, other_width + s * half_length + c * half_width};
  Interval meeting{-1e9, 1e9};
  for (int k = 0; k < 4; ++k) {
    // |n . (delta - (0, d))| <= reach
    const double along = axes[k].x * dx + axes[k].y * dy, slope = axes[k].y;
    if (std::abs(slope) < 1e-9) {
      if (std::abs(along) > reach[k]) return {1.0, 0.0};
      continue;
    }
    const double a = (along - reach[k]) / slope, b = (along + reach[k]) / slope;
    meeting.min = std::max(meeting.min, std::min(a, b));
    meeting.max = std::min(meeting.max, std::max(a, b));
  }
  return meeting;
}

}  // namespace

ArenaField MakeField(FieldKind kind, std::uint64_t seed, std::int64_t number, const ArenaRoad& road) {
  Draw draw(RandomStream(seed, static_cast<std::uint64_t>(number), RandomPurpose::kArenaField,
                         static_cast<std::uint64_t>(kind)));
  ArenaField field;
  constexpr void (*kMakers[kFieldKinds])(Draw*, const ArenaRoad&, ArenaField*) = {
      Walls, Boxes, Furniture, Corridor, ParkedCars, Pedestrian};
  kMakers[static_cast<std::size_t>(kind)](&draw, road, &field);
  return field;
}

bool IsPassable(const ArenaField& field, const ArenaRoad& road, const VehicleParams& vehicle,
                double clearance) {
  const double l_r = vehicle.rear_axle_to_front, rear = vehicle.length - l_r;
  const double half_length = 0.5 * vehicle.length + clearance, half_width = 0.5 * vehicle.width + clearance;
  const double to_middle = l_r - 0.5 * vehicle.length;  // From the rear axle forward.
  const double left_end = -0.5 * PositionSet::kCells * kCell;
  const auto cell_of = [&](double d) { return (d - left_end) / kCell; };

  std::array<PositionSet, 2 * kSlopes + 1> now, next;
  now[kSlopes].Set(static_cast<int>(std::lround(cell_of(0.0))));
  const double begin = road.start - l_r, end = road.goal - l_r;
  for (double s = begin; s < end; s += kLayer) {
    bool any = false;
    for (int j = -kSlopes; j <= kSlopes; ++j) {
      PositionSet& set = next[j + kSlopes];
      set.Clear();
      for (int i = std::max(-kSlopes, j - 1); i <= std::min(kSlopes, j + 1); ++i)
        set.AddShifted(now[i + kSlopes], i + j);
      if (set.Empty()) continue;
      // Takes away where the outline would meet something.
      const double heading = std::atan(j * kSlope), c = std::cos(heading), n = std::sin(heading);
      const double x = s + kLayer + to_middle * c, y0 = to_middle * n;
      const double extent = half_length * std::abs(n) + half_width * c;
      set.Erase(0, static_cast<int>(std::ceil(cell_of(-road.half_width + extent - y0))));
      set.Erase(static_cast<int>(std::floor(cell_of(road.half_width - extent - y0))),
                PositionSet::kCells - 1);
      for (const Footprint& thing : field.things) {
        if (std::abs(thing.front.x - x) > thing.length + half_length + half_width + rear) continue;
        const Interval meeting = Meeting(x, y0, {c, n}, half_length, half_width, thing);
        if (meeting.min > meeting.max) continue;
        set.Erase(static_cast<int>(std::floor(std::max(cell_of(meeting.min), -1.0))),
                  static_cast<int>(std::ceil(std::min(cell_of(meeting.max), 1.0 * PositionSet::kCells))));
      }
      any = any || !set.Empty();
    }
    if (!any) return false;
    std::swap(now, next);
  }
  return true;
}

}  // namespace lanewise
