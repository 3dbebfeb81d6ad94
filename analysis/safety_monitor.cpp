#include "analysis/safety_monitor.h"

#include <omp.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "agents/core/check.h"

namespace lanewise {
namespace {

constexpr std::size_t kMinParallelRows =
    2048;                            // Below, a busy machine loses more to waking a team than it saves.
constexpr double kSlowRadius = 8.0;  // [m] of a sweep: about 3.5 m/s.
constexpr double kSlack = 0.5;       // [m] by which a way beside a lane may be longer than it, in the search.
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
  const double touch = TimeToContact(BoxOf(before_a, a->velocity), BoxOf(before_b, b->velocity), step_length)
                           .value_or(step_length);
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

/// Takes out of `open` what was not seen after `last_seen`, in order of the pair: the map's order is an
/// accident of hashing, and the results file shall not show it.
template <class Event, class EndOf>
std::vector<Event> TakeEnded(double last_seen, EndOf&& end_of,
                             std::unordered_map<std::uint64_t, Event>* open) {
  std::vector<std::uint64_t> keys;
  for (const auto& [key, event] : *open) {
    if (end_of(event) <= last_seen) keys.push_back(key);
  }
  std::sort(keys.begin(), keys.end());
  std::vector<Event> ended;
  for (const std::uint64_t key : keys) ended.push_back(std::move(open->extract(key).mapped()));
  return ended;
}

/// SUMO's code of a type with its roles exchanged.
std::int32_t SeenByTheOther(std::int32_t code) {
  constexpr std::pair<std::int32_t, std::int32_t> kRoles[] = {{2, 3}, {6, 7}, {10, 11}};
  for (const auto& [a, b] : kRoles) {
    if (code == a) return b;
    if (code == b) return a;
  }
  return code;
}

bool IsDefined(double value) {
  return value != Encounter::kUndefined;
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

SafetyMonitor::SafetyMonitor(SafetyParams params, const RoadNetwork* network, SafetyLevel level)
    : params_(params),
      network_(network),
      level_(level),
      horizon_(level == SafetyLevel::kFull ? params.ttc_encounter : 0.0),
      encroachments_(network, level == SafetyLevel::kFull ? params.pet_encounter : 0.0) {
  if (network == nullptr || level != SafetyLevel::kFull) return;
  lane_order_ = std::make_unique<LaneOrder>(*network);
  lane_motion_ = std::make_unique<LaneMotion>(*network);
}

void SafetyMonitor::Observe(const TrafficFrame& frame) {
  step_length_ = observed_ ? frame.time - last_time_ : 0.0;
  LANEWISE_CHECK(!observed_ || step_length_ > 0.0);
  last_time_ = frame.time;
  observed_ = true;
  if (level_ == SafetyLevel::kOff) return;

  PrepareBodies(frame);
  if (level_ == SafetyLevel::kFull) TakeSnapshot(frame);
  FindClosePairs(frame);
  for (const ClosePair& pair : close_pairs_) {
    if (pair.depth > params_.contact_depth) UpdateContact(frame, pair);
  }
  if (level_ == SafetyLevel::kFull) {
    row_ttc_.assign(frame.size(), kNoTtc);
    row_drac_.assign(frame.size(), 0.0);
    for (const ClosePair& pair : close_pairs_) {
      for (const std::int32_t row : {pair.first_row, pair.second_row}) {
        const auto r = static_cast<std::size_t>(row);
        if (pair.ttc < params_.ttc_encounter) row_ttc_[r] = std::min(row_ttc_[r], pair.ttc);
        row_drac_[r] = std::max(row_drac_[r], pair.drac);
      }
      UpdateEncounter(frame, pair);
    }
    encroachments_.Observe(frame, poses_);
    for (const Encroachment& encroachment : encroachments_.found()) UpdateEncroachment(frame, encroachment);
    UpdateOpenEncounters(frame);
  }
  // The small term keeps rounding of the times from deciding.
  CloseUntil(frame.time - params_.separation_time + 1e-6);
}

void SafetyMonitor::PrepareBodies(const TrafficFrame& frame) {
  const std::size_t rows = frame.size();
  bodies_.resize(rows);
  sweeps_.resize(rows);
  outlines_.resize(rows);
  poses_.resize(rows);
  const double half_horizon = 0.5 * horizon_;
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
    const double speed = std::sqrt(body.vx * body.vx + body.vy * body.vy);
    poses_[i] = {{body.x, body.y}, {body.ux, body.uy}};
    body.turns = lane_motion_ && lane_motion_->Turns(frame, i, poses_[i], horizon_);
    const auto row = static_cast<std::int32_t>(i);
    if (body.turns) {
      // A way lies within the circle around the middle between its ends, half as large as it is long.
      Outline& outline = outlines_[i];
      lane_motion_->Follow(frame, i, poses_[i], horizon_ / kWindows, outline.pose);
      const double beside = std::abs(frame.lateral_offset[i]) + horizon_ * std::abs(frame.lateral_speed[i]);
      outline.radius = body.radius + 0.5 * horizon_ / kWindows * speed + beside + kSlack;
      const Point2 begin = outline.pose.front().center, end = outline.pose.back().center;
      sweeps_[i] = {0.5 * (begin.x + end.x), 0.5 * (begin.y + end.y),
                    body.radius + half_horizon * speed + beside + kSlack, row};
    } else {
      sweeps_[i] = {body.x + half_horizon * body.vx, body.y + half_horizon * body.vy,
                    body.radius + half_horizon * speed, row};
    }
  }
  fast_.Clear();
  slow_.Clear();
  for (const Sweep& sweep : sweeps_) (sweep.radius > kSlowRadius ? fast_ : slow_).Add(sweep);
  fast_.Build();
  slow_.Build();
  row_of_.assign(row_of_.size(), kNone);
  for (std::size_t i = 0; i < rows; ++i) {
    const auto number = static_cast<std::size_t>(frame.vehicle_number[i]);
    if (number >= row_of_.size()) row_of_.resize(number + 1, kNone);
    row_of_[number] = static_cast<std::int32_t>(i);
  }
}

void SafetyMonitor::FindClosePairs(const TrafficFrame& frame) {
  const std::size_t rows = frame.size();
  found_by_thread_.resize(static_cast<std::size_t>(omp_get_max_threads()));
  for (auto& found : found_by_thread_) found.clear();
  if (lane_order_) lane_order_->Build(frame);
#pragma omp parallel if (rows >= kMinParallelRows)
  {
    std::vector<ClosePair>& found = found_by_thread_[static_cast<std::size_t>(omp_get_thread_num())];
#pragma omp for schedule(static)
    for (std::size_t i = 0; i < rows; ++i) {
      FindPartners(frame, i, &found);
      if (lane_order_) FindLeaders(frame, i, &found);
    }
  }
  close_pairs_.clear();
  for (const auto& found : found_by_thread_)
    close_pairs_.insert(close_pairs_.end(), found.begin(), found.end());
  // Each pair was found once; this order depends on neither the threads nor the rows.
  std::sort(close_pairs_.begin(), close_pairs_.end(), [](const ClosePair& a, const ClosePair& b) {
    return std::pair(PairKey(a.first, a.second), a.ttc) < std::pair(PairKey(b.first, b.second), b.ttc);
  });
}

void SafetyMonitor::SweepIndex::Clear() {
  x.clear();
  y.clear();
  unsorted.clear();
}

void SafetyMonitor::SweepIndex::Add(const Sweep& sweep) {
  x.push_back(sweep.x);
  y.push_back(sweep.y);
  unsorted.push_back(sweep);
}

void SafetyMonitor::SweepIndex::Build() {
  grid.Build(x, y);
  sweeps.resize(unsorted.size());
  for (std::size_t slot = 0; slot < sweeps.size(); ++slot)
    sweeps[slot] = unsorted[static_cast<std::size_t>(grid.items()[slot])];
}

/// Two road users can only touch within the horizon if the circles around their sweeps meet. The one with the
/// larger circle looks for the other: slow ones, the many in a jam, search little.
void SafetyMonitor::FindPartners(const TrafficFrame& frame, std::size_t i,
                                 std::vector<ClosePair>* found) const {
  const Sweep a = sweeps_[i];
  const auto search = [&](const SweepIndex& index, double largest) {
    index.grid.ForEachNearIf(
        a.x, a.y, a.radius + std::min(a.radius, largest),
        [&](std::uint32_t slot) {
          const Sweep& b = index.sweeps[slot];
          const double dx = b.x - a.x, dy = b.y - a.y, reach = a.radius + b.radius;
          const bool meet = dx * dx + dy * dy <= reach * reach;
          const bool mine = (b.radius < a.radius) | ((b.radius == a.radius) & (b.row > a.row));
          return meet & mine;  // One branch: each alone is a coin toss to the processor.
        },
        [&](AgentIndex item) {
          MeasurePair(frame, i, static_cast<std::size_t>(index.unsorted[static_cast<std::size_t>(item)].row),
                      found);
        });
  };
  search(slow_, kSlowRadius);
  if (a.radius > kSlowRadius) search(fast_, kNoTtc);
}

/// Adds the pair, if it is beyond a threshold in the plane.
void SafetyMonitor::MeasurePair(const TrafficFrame& frame, std::size_t i, std::size_t j,
                                std::vector<ClosePair>* found) const {
  const bool on_lanes = bodies_[i].turns | bodies_[j].turns;
  if (on_lanes ? !MayMeetOnLanes(i, j) : !MayTouch(bodies_[i], bodies_[j])) return;
  if ((frame.pedestrian[i] && frame.pedestrian[j]) || (frame.planned_stop[i] && frame.planned_stop[j]))
    return;

  const bool in_order = frame.vehicle_number[i] < frame.vehicle_number[j];
  const std::size_t first = in_order ? i : j;
  const std::size_t second = in_order ? j : i;
  const auto in_line = [&] {
    return lane_order_ &&
           (lane_order_->GapBetween(frame, first, second) || lane_order_->GapBetween(frame, second, first));
  };
  const MovingBox box_first = BoxOf(first), box_second = BoxOf(second);
  if (on_lanes && AreApart(box_first, box_second) && in_line()) return;  // The cheaper question first.
  const std::optional<Meeting> meeting =
      on_lanes ? MeetOnLanes(frame, first, second) : MeetStraight(box_first, box_second);
  if (!meeting || (meeting->ttc >= horizon_ && meeting->ttc > 0.0)) return;
  const double depth =
      meeting->ttc > 0.0 ? 0.0 : PenetrationDepth(FootprintOf(frame, first), FootprintOf(frame, second));
  const bool contact = depth > params_.contact_depth;
  // A queue standing bumper to bumper, gap 0 up to rounding, is no conflict.
  if (meeting->ttc == 0.0 && !contact &&
      std::hypot(frame.vx[first] - frame.vx[second], frame.vy[first] - frame.vy[second]) <
          params_.standing_speed)
    return;
  // Who follows along the lanes is measured along them.
  if (!contact && in_line()) return;
  ClosePair pair = {frame.vehicle_number[first],
                    frame.vehicle_number[second],
                    static_cast<std::int32_t>(first),
                    static_cast<std::int32_t>(second),
                    meeting->ttc,
                    depth,
                    0.0,
                    kNoTtc,
                    0.0,
                    EncounterType::kFollowing,
                    false};
  if (level_ == SafetyLevel::kFull) MeasureInPlane(frame, *meeting, &pair);
  found->push_back(pair);
}

std::optional<SafetyMonitor::Meeting> SafetyMonitor::MeetStraight(const MovingBox& a,
                                                                  const MovingBox& b) const {
  const std::optional<double> ttc = TimeToContact(a, b, horizon_);
  return ttc ? std::optional<Meeting>({*ttc, a, b}) : std::nullopt;
}

/// Both ways in the plane, cut into pieces of straight motion.
std::optional<SafetyMonitor::Meeting> SafetyMonitor::MeetOnLanes(const TrafficFrame& frame, std::size_t i,
                                                                 std::size_t j) const {
  const double period = horizon_ / kPieces;
  std::array<BoxPose, kPieces + 1> poses_i, poses_j;
  const auto predict = [&](std::size_t row, std::span<BoxPose> poses) {
    const Body& body = bodies_[row];
    if (body.turns) return lane_motion_->Follow(frame, row, poses_[row], period, poses);
    for (std::size_t k = 0; k < poses.size(); ++k) {
      const double time = period * static_cast<double>(k);
      poses[k] = {{body.x + time * body.vx, body.y + time * body.vy}, {body.ux, body.uy}};
    }
  };
  predict(i, poses_i);
  predict(j, poses_j);
  const double radius = bodies_[i].radius + bodies_[j].radius;
  const auto distance = [&](std::size_t k) {
    const double dx = poses_i[k].center.x - poses_j[k].center.x;
    const double dy = poses_i[k].center.y - poses_j[k].center.y;
    return std::sqrt(dx * dx + dy * dy);
  };
  const auto piece = [&](std::size_t row, std::span<const BoxPose> poses, std::size_t k) {
    const Point2 from = poses[k].center, to = poses[k + 1].center;
    Point2 u = poses[k].u;
    if (k > 0) {  // The heading halfway; at first the true one, or those side by side might touch.
      u = {u.x + poses[k + 1].u.x, u.y + poses[k + 1].u.y};
      const double norm = std::hypot(u.x, u.y);
      u = norm > 0.0 ? Point2{u.x / norm, u.y / norm} : poses[k].u;
    }
    return MovingBox{from,
                     {(to.x - from.x) / period, (to.y - from.y) / period},
                     u,
                     bodies_[row].half_length,
                     bodies_[row].half_width};
  };
  double near = distance(0);
  for (std::size_t k = 0; k < kPieces; ++k) {
    // Between two moments they come no closer than the mean of both distances less half of what changes.
    const double far = distance(k + 1);
    const double dx =
        poses_i[k + 1].center.x - poses_i[k].center.x - poses_j[k + 1].center.x + poses_j[k].center.x;
    const double dy =
        poses_i[k + 1].center.y - poses_i[k].center.y - poses_j[k + 1].center.y + poses_j[k].center.y;
    const bool apart = 0.5 * (near + far - std::sqrt(dx * dx + dy * dy)) > radius;
    near = far;
    if (apart) continue;
    const MovingBox a = piece(i, poses_i, k), b = piece(j, poses_j, k);
    const std::optional<double> contact = TimeToContact(a, b, period);
    if (!contact) continue;
    const double begin = period * static_cast<double>(k);
    if (begin + *contact == 0.0) return Meeting{0.0, BoxOf(i), BoxOf(j)};
    const auto straightened = [begin](MovingBox box) {
      box.center.x -= begin * box.velocity.x;
      box.center.y -= begin * box.velocity.y;
      return box;
    };
    return Meeting{begin + *contact, straightened(a), straightened(b)};
  }
  return std::nullopt;
}

/// DRAC, MTTC, closing speed, type and ego of a pair on collision course in the plane, from the motion with
/// which they would meet.
void SafetyMonitor::MeasureInPlane(const TrafficFrame& frame, const Meeting& meeting, ClosePair* pair) const {
  constexpr double kTimesSeen = 30.0;  // [s] DRAC is decided within 2 TTC, and stopping takes little longer.
  const auto i = static_cast<std::size_t>(pair->first_row), j = static_cast<std::size_t>(pair->second_row);
  const MovingBox &a = meeting.a, &b = meeting.b;
  const double wx = b.velocity.x - a.velocity.x, wy = b.velocity.y - a.velocity.y;
  pair->closing = std::hypot(wx, wy);
  LaneUser first = LaneUserAt(frame, i), second = LaneUserAt(frame, j);
  if (bodies_[i].turns) first.heading = std::atan2(a.u.y, a.u.x);
  if (bodies_[j].turns) second.heading = std::atan2(b.u.y, b.u.x);
  pair->type = ClassifyMeeting(network_, first, second);
  const ConflictRegion region = FindConflictRegion(a, b, kTimesSeen, kTimesSeen);
  double first_entry = kNoTtc, second_entry = kNoTtc;
  for (std::size_t k = 0; k < region.size; ++k) {
    first_entry = std::min(first_entry, region.corner[k].a);
    second_entry = std::min(second_entry, region.corner[k].b);
  }
  pair->ego_is_first = first_entry > second_entry;
  if (pair->ttc <= 0.0) return;  // They touch: too late to brake.
  pair->drac = DecelerationToAvoid(region, std::hypot(a.velocity.x, a.velocity.y),
                                   std::hypot(b.velocity.x, b.velocity.y))
                   .value_or(0.0);
  if (pair->closing <= 0.0) return;
  const double ax = frame.accel[j] * b.u.x - frame.accel[i] * a.u.x;
  const double ay = frame.accel[j] * b.u.y - frame.accel[i] * a.u.y;
  const double closing_accel = (ax * wx + ay * wy) / pair->closing;
  pair->mttc =
      ModifiedTimeToCollision(pair->closing * pair->ttc, pair->closing, closing_accel).value_or(kNoTtc);
}

/// All that row i follows along its lanes and gains on, beyond a threshold.
void SafetyMonitor::FindLeaders(const TrafficFrame& frame, std::size_t i,
                                std::vector<ClosePair>* found) const {
  const double speed = frame.speed[i];
  // Nobody reverses, so the speed is the most it can gain.
  const double reach =
      std::max(params_.ttc_encounter * speed, speed * speed / (2.0 * params_.drac_encounter));
  if (reach <= 0.0) return;
  lane_order_->ForEachAhead(frame, i, reach, [&](std::size_t j, double gap) {
    const double closing = speed - frame.speed[j];
    if (closing <= 0.0 || (gap == 0.0 && closing < params_.standing_speed)) return;
    if (frame.planned_stop[i] && frame.planned_stop[j]) return;
    const double ttc = gap / closing;
    const double drac = gap > 0.0 ? closing * closing / (2.0 * gap) : 0.0;
    if (ttc >= params_.ttc_encounter && drac <= params_.drac_encounter) return;
    // In contact all the same, on a bend: found, and measured, in the plane.
    if (PenetrationDepth(FootprintOf(frame, i), FootprintOf(frame, j)) > params_.contact_depth) return;
    const double closing_accel = frame.accel[i] - frame.accel[j];
    const bool in_order = frame.vehicle_number[i] < frame.vehicle_number[j];
    const std::size_t first = in_order ? i : j, second = in_order ? j : i;
    found->push_back({frame.vehicle_number[first], frame.vehicle_number[second],
                      static_cast<std::int32_t>(first), static_cast<std::int32_t>(second), ttc, 0.0, drac,
                      ModifiedTimeToCollision(gap, closing, closing_accel).value_or(kNoTtc), closing,
                      EncounterType::kFollowing, in_order});
  });
}

MovingBox SafetyMonitor::BoxOf(std::size_t row) const {
  const Body& b = bodies_[row];
  return {{b.x, b.y}, {b.vx, b.vy}, {b.ux, b.uy}, b.half_length, b.half_width};
}

Footprint SafetyMonitor::FootprintOf(const TrafficFrame& frame, std::size_t row) const {
  return {{frame.x[row], frame.y[row], frame.heading[row]}, frame.length[row], frame.width[row]};
}

/// Are the two at the same time in the same place, roughly? Else they cannot meet.
bool SafetyMonitor::MayMeetOnLanes(std::size_t i, std::size_t j) const {
  const double window = horizon_ / kWindows;
  const auto center = [&](std::size_t row, std::size_t k) -> Point2 {
    const Body& body = bodies_[row];
    if (body.turns) return outlines_[row].pose[k].center;
    const double time = window * static_cast<double>(k);
    return {body.x + time * body.vx, body.y + time * body.vy};
  };
  const auto radius = [&](std::size_t row) {
    const Body& body = bodies_[row];
    return body.turns ? outlines_[row].radius
                      : body.radius + 0.5 * window * std::sqrt(body.vx * body.vx + body.vy * body.vy);
  };
  const double reach = radius(i) + radius(j);
  Point2 a = center(i, 0), b = center(j, 0);
  for (std::size_t k = 1; k <= kWindows; ++k) {
    const Point2 next_a = center(i, k), next_b = center(j, k);
    const double dx = 0.5 * (b.x + next_b.x - a.x - next_a.x);
    const double dy = 0.5 * (b.y + next_b.y - a.y - next_a.y);
    if (dx * dx + dy * dy <= reach * reach) return true;
    a = next_a;
    b = next_b;
  }
  return false;
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
    const double then = now + rate * horizon_;
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

SafetyMonitor::OpenEncounter& SafetyMonitor::Open(std::int32_t first, std::int32_t second, double time) {
  const auto [it, begins] = open_encounters_.try_emplace(PairKey(first, second));
  OpenEncounter& open = it->second;
  if (!begins) {
    if (time <= open.encounter.end + params_.separation_time + 1e-6) return open;
    CloseEncounter(&open);  // It was open only for a PET that might have followed.
    open = {};
  }
  open.encounter.first = first;
  open.encounter.second = second;
  open.encounter.begin = open.encounter.end = time;
  for (const Snapshot& snapshot : snapshots_) {
    const auto row = [&](std::int32_t number) {
      const auto n = static_cast<std::size_t>(number);
      return n < snapshot.row_of.size() ? snapshot.row_of[n] : kNone;
    };
    if (row(first) == kNone || row(second) == kNone) continue;
    open.samples.push_back({0, snapshot.time, snapshot.rows[static_cast<std::size_t>(row(first))],
                            snapshot.rows[static_cast<std::size_t>(row(second))]});
  }
  return open;
}

void SafetyMonitor::OpenEncounter::Extend(double time) {
  Encounter& e = encounter;
  e.end = std::max(e.end, time);
  if (late_distance < e.min_distance) {
    e.min_distance = late_distance;
    e.min_distance_time = late_distance_time;
  }
  late_distance = Encounter::kUndefined;
}

void SafetyMonitor::UpdateEncounter(const TrafficFrame& frame, const ClosePair& pair) {
  OpenEncounter& open = Open(pair.first, pair.second, frame.time);
  open.Extend(frame.time);
  Encounter& e = open.encounter;
  if (open.now_time < frame.time || pair.ttc < open.now.ttc) open.now = pair;
  open.now_time = frame.time;
  const auto i = static_cast<std::size_t>(pair.first_row), j = static_cast<std::size_t>(pair.second_row);
  const bool undefined = !IsDefined(e.min_ttc) && !IsDefined(e.pet);
  if (pair.ttc < e.min_ttc || (undefined && pair.drac > e.max_drac)) {
    e.critical = frame.time;
    e.first_agent = frame.agent_driven[i] != 0;
    e.second_agent = frame.agent_driven[j] != 0;
    e.x = 0.5 * (frame.x[i] + frame.x[j]);
    e.y = 0.5 * (frame.y[i] + frame.y[j]);
    e.first_lane = frame.lane[i];
    e.second_lane = frame.lane[j];
    e.in_junction = frame.in_junction[i] || frame.in_junction[j];
    e.first_speed = frame.speed[i];
    e.second_speed = frame.speed[j];
    e.type = pair.type;
    e.ego_is_first = pair.ego_is_first;
  }
  const auto extreme = [&](bool beyond, double value, double* best, double* time) {
    if (!beyond) return;
    *best = value;
    *time = frame.time;
  };
  const bool counts = pair.ttc < params_.ttc_encounter;  // Else it is here for its DRAC.
  extreme(counts && pair.ttc < e.min_ttc, pair.ttc, &e.min_ttc, &e.min_ttc_time);
  extreme(pair.drac > e.max_drac, pair.drac, &e.max_drac, &e.max_drac_time);
  extreme(pair.mttc < e.min_mttc, pair.mttc, &e.min_mttc, &e.min_mttc_time);
  extreme(pair.closing > e.max_closing_speed, pair.closing, &e.max_closing_speed, &e.max_closing_speed_time);

  if (pair.depth <= params_.contact_depth || e.contact) return;
  e.contact = true;
  const double closing = open_contacts_.at(PairKey(pair.first, pair.second)).closing_speed;
  const bool known = frame.mass[i] > 0.0 && frame.mass[j] > 0.0;
  const double share = known ? frame.mass[j] / (frame.mass[i] + frame.mass[j]) : 0.5;
  e.first_delta_v = share * closing;
  e.second_delta_v = (1.0 - share) * closing;
}

void SafetyMonitor::UpdateEncroachment(const TrafficFrame& frame, const Encroachment& encroachment) {
  const bool later_is_first = encroachment.later < encroachment.earlier;
  const std::int32_t first = std::min(encroachment.earlier, encroachment.later);
  const std::int32_t second = std::max(encroachment.earlier, encroachment.later);
  OpenEncounter& open = Open(first, second, encroachment.time - encroachment.pet);
  Encounter& e = open.encounter;
  // While the later one passes there may be more, none as close.
  if (encroachment.pet >= e.pet) return;
  open.Extend(encroachment.time);
  e.begin = std::min(e.begin, encroachment.time - encroachment.pet);
  e.pet = encroachment.pet;
  e.pet_time = encroachment.time;
  if (IsDefined(e.min_ttc)) return;
  e.critical = encroachment.time;
  e.x = encroachment.x;
  e.y = encroachment.y;
  e.type = encroachment.type;
  e.ego_is_first = later_is_first;
  e.first_agent = later_is_first ? encroachment.later_agent : encroachment.earlier_agent;
  e.second_agent = later_is_first ? encroachment.earlier_agent : encroachment.later_agent;
  e.first_lane = later_is_first ? encroachment.later_lane : encroachment.earlier_lane;
  e.second_lane = later_is_first ? encroachment.earlier_lane : encroachment.later_lane;
  e.first_speed = later_is_first ? encroachment.later_speed : encroachment.earlier_speed;
  e.second_speed = later_is_first ? encroachment.earlier_speed : encroachment.later_speed;
  for (const std::int32_t number : {first, second}) {
    const std::int32_t row = row_of_[static_cast<std::size_t>(number)];
    if (row != kNone) e.in_junction = e.in_junction || frame.in_junction[static_cast<std::size_t>(row)];
  }
}

/// Distance and samples of every open encounter, be its pair beyond a threshold in this step or not.
void SafetyMonitor::UpdateOpenEncounters(const TrafficFrame& frame) {
  for (auto& [key, open] : open_encounters_) {
    Encounter& e = open.encounter;
    const std::int32_t i = row_of_[static_cast<std::size_t>(e.first)];
    const std::int32_t j = row_of_[static_cast<std::size_t>(e.second)];
    if (i == kNone || j == kNone) continue;
    const auto first = static_cast<std::size_t>(i), second = static_cast<std::size_t>(j);
    const double distance = Distance(FootprintOf(frame, first), FootprintOf(frame, second));
    const bool late = frame.time > e.end + params_.separation_time + 1e-6;
    double& least = late ? open.late_distance : e.min_distance;
    if (distance < least) {
      least = distance;
      (late ? open.late_distance_time : e.min_distance_time) = frame.time;
    }
    if (!is_snapshot_) continue;
    if (open.samples.empty() || open.samples.back().time < frame.time) {
      const Snapshot& now = snapshots_.back();
      open.samples.push_back({0, frame.time, now.rows[first], now.rows[second]});
    }
    if (open.now_time < frame.time) continue;
    EncounterSample& sample = open.samples.back();
    if (open.now.ttc < params_.ttc_encounter) sample.ttc = open.now.ttc;
    sample.drac = open.now.drac;
    // Who is ego is known only when the encounter closes: here seen by the first one.
    sample.type_code =
        SumoTypeCode(open.now.type, open.now.depth > params_.contact_depth, !open.now.ego_is_first);
  }
}

void SafetyMonitor::TakeSnapshot(const TrafficFrame& frame) {
  // Half a step of tolerance: times are sums of steps.
  is_snapshot_ = params_.event_period > 0.0 &&
                 (snapshots_.empty() ||
                  frame.time >= snapshots_.back().time + params_.event_period - 0.5 * step_length_);
  if (!is_snapshot_) return;
  Snapshot oldest;  // Its memory is used again.
  // An encroachment is known up to half a second, and its time, after it began.
  const double kept = params_.event_before + params_.pet_encounter + 1.0;
  while (!snapshots_.empty() && snapshots_.front().time < frame.time - kept) {
    oldest = std::move(snapshots_.front());
    snapshots_.pop_front();
  }
  oldest.time = frame.time;
  oldest.row_of = row_of_;
  oldest.rows.resize(frame.size());
  for (std::size_t i = 0; i < frame.size(); ++i) {
    oldest.rows[i] = {frame.x[i], frame.y[i], frame.heading[i], frame.speed[i], frame.accel[i]};
  }
  snapshots_.push_back(std::move(oldest));
}

void SafetyMonitor::CloseUntil(double last_seen) {
  for (Contact& contact : TakeEnded(
           last_seen, [](const Contact& c) { return c.end; }, &open_contacts_))
    finished_contacts_.push_back(contact);
  // A PET that belongs to an encounter may become known only now.
  for (OpenEncounter& open : TakeEnded(
           last_seen - encroachments_.delay(), [](const OpenEncounter& o) { return o.encounter.end; },
           &open_encounters_))
    CloseEncounter(&open);
}

void SafetyMonitor::CloseEncounter(OpenEncounter* open) {
  Encounter& e = open->encounter;
  e.number = encounter_count_++;
  e.near_miss = !e.contact && e.min_ttc < params_.ttc_near_miss;
  const bool serious =
      e.min_ttc < params_.ttc_near_miss || e.max_drac > params_.drac_serious || e.pet < params_.pet_serious;
  e.severity = e.contact ? Severity::kContact : serious ? Severity::kSerious : Severity::kConflict;
  if (e.contact) e.min_distance = 0.0;
  finished_encounters_.push_back(e);
  for (EncounterSample& sample : open->samples) {
    if (sample.time < e.critical - params_.event_before || sample.time > e.critical + params_.event_after)
      continue;
    sample.encounter = e.number;
    if (!e.ego_is_first) sample.type_code = SeenByTheOther(sample.type_code);
    finished_samples_.push_back(sample);
  }
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

std::vector<EncounterSample> SafetyMonitor::TakeFinishedSamples() {
  return std::exchange(finished_samples_, {});
}

}  // namespace lanewise
