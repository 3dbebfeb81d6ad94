#include "analysis/safety_monitor.h"

#include <omp.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "agents/core/check.h"

namespace lanewise {
namespace {

constexpr std::size_t kMinParallelRows = 256;  // Below, forking a team costs more than it saves.
constexpr double kNoTtc = std::numeric_limits<double>::infinity();

std::uint64_t PairKey(std::int32_t first, std::int32_t second) {
  return (static_cast<std::uint64_t>(static_cast<std::uint32_t>(first)) << 32) |
         static_cast<std::uint32_t>(second);
}

double Dot(Point2 a, Point2 b) {
  return a.x * b.x + a.y * b.y;
}
Point2 Left(Point2 u) {
  return {-u.y, u.x};
}
Point2 Forward(const Footprint& f) {
  return {std::cos(f.front.heading), std::sin(f.front.heading)};
}

Point2 Center(const Footprint& f) {
  const Point2 u = Forward(f);
  return {f.front.x - 0.5 * f.length * u.x, f.front.y - 0.5 * f.length * u.y};
}

TouchingVehicle VehicleAt(const TrafficFrame& frame, std::size_t row) {
  return {{{frame.x[row], frame.y[row], frame.heading[row]}, frame.length[row], frame.width[row]},
          {frame.vx[row], frame.vy[row]},
          frame.agent_driven[row] != 0};
}

Footprint Shifted(Footprint f, Point2 velocity, double seconds) {
  f.front.x += velocity.x * seconds;
  f.front.y += velocity.y * seconds;
  return f;
}

/// Takes both vehicles, found overlapping at the end of a step, back to where they first touched in it.
void RewindToFirstTouch(double step_length, TouchingVehicle* a, TouchingVehicle* b) {
  const Footprint before_a = Shifted(a->footprint, a->velocity, -step_length);
  const Footprint before_b = Shifted(b->footprint, b->velocity, -step_length);
  const double touch =
      TimeToContact(before_a, a->velocity, before_b, b->velocity, step_length).value_or(step_length);
  a->footprint = Shifted(before_a, a->velocity, touch);
  b->footprint = Shifted(before_b, b->velocity, touch);
}

/// A convex polygon small enough for the stack: a rectangle cut by four lines has at most eight corners.
struct Polygon {
  std::array<Point2, 12> corner;
  std::size_t size{0};
  void Add(Point2 p) { corner[size++] = p; }
};

/// The part of the polygon where normal . p <= limit (Sutherland and Hodgman 1974).
Polygon Clip(const Polygon& polygon, Point2 normal, double limit) {
  Polygon inside;
  for (std::size_t k = 0; k < polygon.size; ++k) {
    const Point2 p = polygon.corner[k];
    const Point2 q = polygon.corner[(k + 1) % polygon.size];
    const double over_p = Dot(normal, p) - limit;
    const double over_q = Dot(normal, q) - limit;
    if (over_p <= 0.0) inside.Add(p);
    if ((over_p < 0.0 && over_q > 0.0) || (over_p > 0.0 && over_q < 0.0)) {
      const double t = over_p / (over_p - over_q);
      inside.Add({p.x + t * (q.x - p.x), p.y + t * (q.y - p.y)});
    }
  }
  return inside;
}

/// Middle of the common region of both boxes, each grown by a margin: at first touch the bare region is
/// empty.
Point2 ContactPoint(const Footprint& a, const Footprint& b) {
  constexpr double kMargin = 0.05;  // [m]
  const Point2 center_a = Center(a), center_b = Center(b), u = Forward(a), n = Left(u);
  const double l = 0.5 * a.length + kMargin, w = 0.5 * a.width + kMargin;
  Polygon region;
  for (const auto& [along, left] : {std::pair{l, w}, std::pair{-l, w}, std::pair{-l, -w}, std::pair{l, -w}}) {
    region.Add({center_a.x + along * u.x + left * n.x, center_a.y + along * u.y + left * n.y});
  }
  const Point2 ub = Forward(b), nb = Left(ub);
  for (const auto& [axis, half] : {std::pair{ub, 0.5 * b.length}, std::pair{nb, 0.5 * b.width}}) {
    const double middle = Dot(axis, center_b);
    region = Clip(region, axis, middle + half + kMargin);
    region = Clip(region, {-axis.x, -axis.y}, -middle + half + kMargin);
  }
  if (region.size == 0) return {0.5 * (center_a.x + center_b.x), 0.5 * (center_a.y + center_b.y)};
  Point2 sum;
  for (std::size_t k = 0; k < region.size; ++k) {
    sum.x += region.corner[k].x;
    sum.y += region.corner[k].y;
  }
  return {sum.x / static_cast<double>(region.size), sum.y / static_cast<double>(region.size)};
}

/// Axis of least overlap, from a to b.
Point2 ContactNormal(const Footprint& a, const Footprint& b) {
  const Point2 ua = Forward(a), ub = Forward(b);
  const Point2 center_a = Center(a), center_b = Center(b);
  const Point2 d{center_b.x - center_a.x, center_b.y - center_a.y};
  const auto reach = [](const Footprint& f, Point2 u, Point2 axis) {
    return 0.5 * f.length * std::abs(Dot(u, axis)) + 0.5 * f.width * std::abs(Dot(Left(u), axis));
  };
  Point2 best = ua;
  double least = kNoTtc;
  for (const Point2 axis : {ua, ub, Left(ua), Left(ub)}) {
    const double overlap = reach(a, ua, axis) + reach(b, ub, axis) - std::abs(Dot(d, axis));
    // The tolerance makes parallel boxes, whose axes tie up to rounding, take the first.
    if (overlap < least - 1e-9) {
      least = overlap;
      best = axis;
    }
  }
  return Dot(best, d) >= 0.0 ? best : Point2{-best.x, -best.y};
}

/// Rule 2 of ChooseStriking.
bool CouldStillHaveBraked(const TouchingVehicle& ego, const TouchingVehicle& other, Point2 contact,
                          double front_zone) {
  const Point2 u = Forward(ego.footprint);
  const double direction = Dot(ego.velocity, u) >= 0.0 ? 1.0 : -1.0;  // -1: it reverses, its rear leads.
  const Point2 center = Center(ego.footprint);
  const double ahead = direction * Dot({contact.x - center.x, contact.y - center.y}, u);
  const Point2 relative{ego.velocity.x - other.velocity.x, ego.velocity.y - other.velocity.y};
  return ahead >= (0.5 - front_zone) * ego.footprint.length && direction * Dot(relative, u) > 0.0;
}

/// Moves events not seen after `last_seen` from `open` to `finished`, in order of the pair.
template <class Event>
void MoveFinished(double last_seen, std::unordered_map<std::uint64_t, Event>* open,
                  std::vector<Event>* finished) {
  const std::size_t first_new = finished->size();
  for (auto it = open->begin(); it != open->end();) {
    if (it->second.end > last_seen) {
      ++it;
      continue;
    }
    finished->push_back(it->second);
    it = open->erase(it);
  }
  // The map's order is an accident of hashing; the results file shall not show it.
  std::sort(
      finished->begin() + static_cast<std::ptrdiff_t>(first_new), finished->end(),
      [](const Event& a, const Event& b) { return PairKey(a.first, a.second) < PairKey(b.first, b.second); });
}

}  // namespace

Touch DescribeTouch(const TouchingVehicle& a, const TouchingVehicle& b) {
  Touch touch;
  touch.point = ContactPoint(a.footprint, b.footprint);
  touch.normal = ContactNormal(a.footprint, b.footprint);
  const Point2 relative{a.velocity.x - b.velocity.x, a.velocity.y - b.velocity.y};
  touch.closing_speed = std::max(0.0, Dot(relative, touch.normal));
  return touch;
}

std::int32_t ChooseStriking(const TouchingVehicle& a, const TouchingVehicle& b, const Touch& touch,
                            const SafetyParams& params) {
  const bool a_moves = std::hypot(a.velocity.x, a.velocity.y) >= params.standing_speed;
  const bool b_moves = std::hypot(b.velocity.x, b.velocity.y) >= params.standing_speed;
  if (!a_moves || !b_moves) return a_moves ? 0 : b_moves ? 1 : kNone;
  const bool a_qualifies = CouldStillHaveBraked(a, b, touch.point, params.front_zone);
  const bool b_qualifies = CouldStillHaveBraked(b, a, touch.point, params.front_zone);
  if (a_qualifies != b_qualifies) return a_qualifies ? 0 : 1;
  if (a_qualifies && a.agent_driven != b.agent_driven) return a.agent_driven ? 0 : 1;
  const double a_towards_b = Dot(a.velocity, touch.normal);
  const double b_towards_a = -Dot(b.velocity, touch.normal);
  return a_towards_b >= b_towards_a ? 0 : 1;
}

void SafetyMonitor::Observe(const TrafficFrame& frame) {
  step_length_ = observed_ ? frame.time - last_time_ : 0.0;
  LANEWISE_CHECK(!observed_ || step_length_ > 0.0);
  last_time_ = frame.time;
  observed_ = true;

  PrepareBodies(frame);
  FindClosePairs(frame);
  row_ttc_.assign(frame.size(), kNoTtc);
  for (const ClosePair& pair : close_pairs_) {
    for (const std::int32_t row : {pair.first_row, pair.second_row}) {
      row_ttc_[static_cast<std::size_t>(row)] = std::min(row_ttc_[static_cast<std::size_t>(row)], pair.ttc);
    }
    if (pair.depth > params_.contact_depth) UpdateContact(frame, pair);
    UpdateEncounter(frame, pair);
  }
  // The small term keeps rounding of the times from deciding.
  CloseUntil(frame.time - params_.separation_time + 1e-6);
}

void SafetyMonitor::PrepareBodies(const TrafficFrame& frame) {
  const std::size_t rows = frame.size();
  bodies_.resize(rows);
  sweeps_.resize(rows);
  sweep_x_.resize(rows);
  sweep_y_.resize(rows);
  const double half_horizon = 0.5 * params_.ttc_encounter;
#pragma omp parallel for schedule(static) if (rows >= kMinParallelRows)
  for (std::size_t i = 0; i < rows; ++i) {
    Body& body = bodies_[i];
    body.ux = std::cos(frame.heading[i]);
    body.uy = std::sin(frame.heading[i]);
    body.half_length = 0.5 * frame.length[i];
    body.half_width = 0.5 * frame.width[i];
    body.radius = std::sqrt(body.half_length * body.half_length + body.half_width * body.half_width);
    body.x = frame.x[i] - body.half_length * body.ux;
    body.y = frame.y[i] - body.half_length * body.uy;
    body.vx = frame.vx[i];
    body.vy = frame.vy[i];
    sweep_x_[i] = body.x + half_horizon * body.vx;
    sweep_y_[i] = body.y + half_horizon * body.vy;
    const double half_path = half_horizon * std::sqrt(body.vx * body.vx + body.vy * body.vy);
    sweeps_[i] = {sweep_x_[i], sweep_y_[i], body.radius + half_path};
  }
  grid_.Build(sweep_x_, sweep_y_);
}

void SafetyMonitor::FindClosePairs(const TrafficFrame& frame) {
  const std::size_t rows = frame.size();
  found_by_thread_.resize(static_cast<std::size_t>(omp_get_max_threads()));
  for (auto& found : found_by_thread_) found.clear();
#pragma omp parallel if (rows >= kMinParallelRows)
  {
    std::vector<ClosePair>& found = found_by_thread_[static_cast<std::size_t>(omp_get_thread_num())];
#pragma omp for schedule(static)
    for (std::size_t i = 0; i < rows; ++i) FindPartners(frame, i, &found);
  }
  close_pairs_.clear();
  for (const auto& found : found_by_thread_)
    close_pairs_.insert(close_pairs_.end(), found.begin(), found.end());
  // Each pair was found once; this order depends on neither the threads nor the rows.
  std::sort(close_pairs_.begin(), close_pairs_.end(), [](const ClosePair& a, const ClosePair& b) {
    return PairKey(a.first, a.second) < PairKey(b.first, b.second);
  });
}

/// Two road users can only touch within the horizon if the circles around their sweeps meet. The one with the
/// larger circle looks for the other, within twice its radius: slow ones, the many in a jam, search little.
void SafetyMonitor::FindPartners(const TrafficFrame& frame, std::size_t i,
                                 std::vector<ClosePair>* found) const {
  const Sweep a = sweeps_[i];
  grid_.ForEachNear(a.x, a.y, 2.0 * a.radius, [&](AgentIndex index) {
    const auto j = static_cast<std::size_t>(index);
    const Sweep b = sweeps_[j];
    const double dx = b.x - a.x, dy = b.y - a.y, reach = a.radius + b.radius;
    const bool meet = dx * dx + dy * dy <= reach * reach;
    const bool mine = (b.radius < a.radius) | ((b.radius == a.radius) & (j > i));
    if (!(meet & mine)) return;  // One branch: each alone is a coin toss to the processor.
    if (!MayTouch(bodies_[i], bodies_[j])) return;
    if ((frame.pedestrian[i] && frame.pedestrian[j]) || (frame.planned_stop[i] && frame.planned_stop[j]))
      return;

    const bool in_order = frame.vehicle_number[i] < frame.vehicle_number[j];
    const std::size_t first = in_order ? i : j;
    const std::size_t second = in_order ? j : i;
    const TouchingVehicle v = VehicleAt(frame, first);
    const TouchingVehicle w = VehicleAt(frame, second);
    const std::optional<double> ttc =
        TimeToContact(v.footprint, v.velocity, w.footprint, w.velocity, params_.ttc_encounter);
    if (!ttc || *ttc >= params_.ttc_encounter) return;
    const double depth = *ttc > 0.0 ? 0.0 : PenetrationDepth(v.footprint, w.footprint);
    // A queue standing bumper to bumper, gap 0 up to rounding, is no conflict.
    const bool touching = *ttc == 0.0 && depth <= params_.contact_depth;
    if (touching &&
        std::hypot(v.velocity.x - w.velocity.x, v.velocity.y - w.velocity.y) < params_.standing_speed)
      return;
    found->push_back({frame.vehicle_number[first], frame.vehicle_number[second],
                      static_cast<std::int32_t>(first), static_cast<std::int32_t>(second), *ttc, depth});
  });
}

/// Cheap necessary conditions for contact within the horizon; most neighbors fail one.
bool SafetyMonitor::MayTouch(const Body& a, const Body& b) const {
  // The circumscribed circles: they must approach, and not pass each other by.
  const double dx = b.x - a.x, dy = b.y - a.y;
  const double wx = b.vx - a.vx, wy = b.vy - a.vy;
  const double radius = a.radius + b.radius;
  if (dx * dx + dy * dy > radius * radius) {
    if (dx * wx + dy * wy >= 0.0) return false;
    const double miss = dx * wy - dy * wx;
    if (miss * miss > radius * radius * (wx * wx + wy * wy)) return false;
  }

  // Along the axes of a: on one side of it now and at the end of the horizon means apart in between. This
  // clears the neighboring lanes.
  const double c = std::abs(a.ux * b.ux + a.uy * b.uy), s = std::abs(a.ux * b.uy - a.uy * b.ux);
  const auto stays_apart = [this](double now, double rate, double limit) {
    const double then = now + rate * params_.ttc_encounter;
    return (now > limit && then > limit) || (now < -limit && then < -limit);
  };
  return !stays_apart(a.ux * dy - a.uy * dx, a.ux * wy - a.uy * wx,
                      a.half_width + s * b.half_length + c * b.half_width) &&
         !stays_apart(a.ux * dx + a.uy * dy, a.ux * wx + a.uy * wy,
                      a.half_length + c * b.half_length + s * b.half_width);
}

void SafetyMonitor::UpdateContact(const TrafficFrame& frame, const ClosePair& pair) {
  const auto [it, begins] = open_contacts_.try_emplace(PairKey(pair.first, pair.second));
  Contact& contact = it->second;
  contact.end = frame.time;
  contact.max_depth = std::max(contact.max_depth, pair.depth);
  if (!begins) return;

  ++contact_count_;
  const auto i = static_cast<std::size_t>(pair.first_row), j = static_cast<std::size_t>(pair.second_row);
  TouchingVehicle a = VehicleAt(frame, i), b = VehicleAt(frame, j);
  RewindToFirstTouch(step_length_, &a, &b);
  const Touch touch = DescribeTouch(a, b);
  const std::int32_t striking = ChooseStriking(a, b, touch, params_);
  contact.first = pair.first;
  contact.second = pair.second;
  contact.striking = striking == 0 ? pair.first : striking == 1 ? pair.second : kNone;
  contact.first_agent = a.agent_driven;
  contact.second_agent = b.agent_driven;
  contact.begin = frame.time;
  contact.x = touch.point.x;
  contact.y = touch.point.y;
  contact.first_lane = frame.lane[i];
  contact.second_lane = frame.lane[j];
  contact.in_junction = frame.in_junction[i] || frame.in_junction[j];
  contact.first_speed = frame.speed[i];
  contact.second_speed = frame.speed[j];
  contact.closing_speed = touch.closing_speed;
}

void SafetyMonitor::UpdateEncounter(const TrafficFrame& frame, const ClosePair& pair) {
  const auto [it, begins] = open_encounters_.try_emplace(PairKey(pair.first, pair.second));
  Encounter& encounter = it->second;
  if (begins) {
    encounter.first = pair.first;
    encounter.second = pair.second;
    encounter.begin = frame.time;
  }
  encounter.end = frame.time;
  const double distance =
      pair.ttc == 0.0 ? 0.0
                      : Distance(VehicleAt(frame, static_cast<std::size_t>(pair.first_row)).footprint,
                                 VehicleAt(frame, static_cast<std::size_t>(pair.second_row)).footprint);
  if (distance < encounter.min_distance) {
    encounter.min_distance = distance;
    encounter.min_distance_time = frame.time;
  }
  encounter.contact = encounter.contact || pair.depth > params_.contact_depth;
  if (pair.ttc < encounter.min_ttc) {
    const auto i = static_cast<std::size_t>(pair.first_row), j = static_cast<std::size_t>(pair.second_row);
    encounter.first_agent = frame.agent_driven[i] != 0;
    encounter.second_agent = frame.agent_driven[j] != 0;
    encounter.min_ttc = pair.ttc;
    encounter.min_ttc_time = frame.time;
    encounter.x = 0.5 * (frame.x[i] + frame.x[j]);
    encounter.y = 0.5 * (frame.y[i] + frame.y[j]);
    encounter.first_lane = frame.lane[i];
    encounter.second_lane = frame.lane[j];
    encounter.in_junction = frame.in_junction[i] || frame.in_junction[j];
    encounter.critical = frame.time;
    encounter.first_speed = frame.speed[i];
    encounter.second_speed = frame.speed[j];
  }
  encounter.near_miss = !encounter.contact && encounter.min_ttc < params_.ttc_near_miss;
}

void SafetyMonitor::CloseUntil(double last_seen) {
  MoveFinished(last_seen, &open_contacts_, &finished_contacts_);
  const std::size_t first_new = finished_encounters_.size();
  MoveFinished(last_seen, &open_encounters_, &finished_encounters_);
  for (std::size_t k = first_new; k < finished_encounters_.size(); ++k)
    finished_encounters_[k].number = encounter_count_++;
}

void SafetyMonitor::Finish() {
  CloseUntil(std::numeric_limits<double>::infinity());
}

std::vector<Contact> SafetyMonitor::TakeFinishedContacts() {
  return std::exchange(finished_contacts_, {});
}

std::vector<Encounter> SafetyMonitor::TakeFinishedEncounters() {
  return std::exchange(finished_encounters_, {});
}

}  // namespace lanewise
