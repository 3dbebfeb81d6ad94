#include "agents/planning/dwa.h"

#include <algorithm>
#include <cmath>
#include <tuple>

#include "agents/planning/body_sweep.h"
#include "agents/planning/car_following.h"

namespace lanewise {
namespace {

/// [s] between the points at which a rollout is checked against what moves beside the ego.
constexpr float kCheckPeriod = 0.2f;
/// [m] below which a body's bulge into a bend is left out.
constexpr float kNoBulge = 0.01f;
/// [m] to what is beside the ego, below which no plan comes nearer.
constexpr float kLeastGap = 0.05f;
/// [m] of overlap that is worth swerving for.
constexpr float kSwerve = 0.6f;
/// Courses are simulated in groups that fill vector registers.
int RoundUp(int count) {
  return (count + 15) / 16 * 16;
}

/// Speed profiles of a plan: constant accelerations, the first one the reference.
struct SpeedProfiles {
  int count;
  std::array<float, kMaxSpeedProfiles> accel;
  std::array<float, kMaxSpeedProfiles> next_speed;  // After the response time.
};

SpeedProfiles MakeSpeedProfiles(const AgentParams& params, const PlanContext& c, double reference_speed) {
  const double response = params.driving.response_time;
  const DynamicWindow window = ReachableSpeeds(c.speed, c.vehicle->max_decel, c.vehicle->max_accel, response);
  SpeedProfiles profiles;
  profiles.count = params.dwa.speed_samples;
  for (int i = 0; i < profiles.count; ++i) {
    const double share = static_cast<double>(i - 1) / (profiles.count - 2);
    const double speed = i == 0 ? std::clamp(reference_speed, window.min, window.max)
                                : window.min + share * (window.max - window.min);
    profiles.next_speed[i] = static_cast<float>(speed);
    profiles.accel[i] = static_cast<float>((speed - c.speed) / response);
  }
  return profiles;
}

/// [m] the gap below which a rollout is dropped: less when creeping, as drivers do.
float Margin(const DwaParams& params, const PlanContext& c) {
  return static_cast<float>(params.clearance_margin * std::clamp(c.speed / 5.0, 0.3, 1.4));
}

/// Smallest and largest value of each course over `window` nodes from each node on.
void RangeFromNodeOn(const float (&value)[kPathNodes][kMaxCourses], int padded, int window,
                     float (&min)[kPathNodes][kMaxCourses], float (&max)[kPathNodes][kMaxCourses]) {
  for (int n = 0; n < kPathNodes; ++n) {
    std::copy_n(value[n], padded, min[n]);
    std::copy_n(value[n], padded, max[n]);
    for (int m = n + 1; m < std::min(kPathNodes, n + window); ++m) {
#pragma omp simd
      for (int j = 0; j < padded; ++j) {
        const float here = value[m][j];
        min[n][j] = here < min[n][j] ? here : min[n][j];
        max[n][j] = here > max[n][j] ? here : max[n][j];
      }
    }
  }
}

/// Nodes over which the ego may be beside something it reaches: its length, the thing's, and the way the
/// thing still makes meanwhile.
int NodesBeside(const RoadView& view, float ego_length) {
  constexpr float kMeanwhile = 1.0f;  // [s]
  float longest = 0.0f;
  for (int m = 0; m < view.obstacle_count; ++m) {
    const Obstacle& o = view.obstacles[m];
    longest = std::max(longest, 2.0f * o.half_length + kMeanwhile * std::max(0.0f, o.speed_s));
  }
  return 1 + static_cast<int>(std::ceil((ego_length + longest) / view.spacing));
}

struct PathPoint {
  float x, y, cos_heading, sin_heading;
};

/// The path `back` [m] behind node n: cubic Hermite between nodes, which are far apart behind the ego.
PathPoint Behind(const RoadView& view, int n, float back) {
  const int front = kNodesBehind + n;
  const float s = view.s[front] - back;
  int k = 0;
  while (k + 1 < front && view.s[k + 1] <= s) ++k;
  const float step = view.s[k + 1] - view.s[k], t = std::clamp((s - view.s[k]) / step, 0.0f, 1.0f);
  const float t2 = t * t, t3 = t2 * t;
  const float p1 = 3.0f * t2 - 2.0f * t3, p0 = 1.0f - p1;
  const float m0 = step * (t3 - 2.0f * t2 + t), m1 = step * (t3 - t2);
  return {p0 * view.x[k] + p1 * view.x[k + 1] + m0 * view.cos_heading[k] + m1 * view.cos_heading[k + 1],
          p0 * view.y[k] + p1 * view.y[k + 1] + m0 * view.sin_heading[k] + m1 * view.sin_heading[k + 1],
          (1.0f - t) * view.cos_heading[k] + t * view.cos_heading[k + 1],
          (1.0f - t) * view.sin_heading[k] + t * view.sin_heading[k + 1]};
}

/// A straight body's place in a bend, its bumpers' middles on the path, the front one at a node.
struct BodyInBend {
  float tangent;  ///< [m] how far left of the front's tangent the rear is.
  float bulge;    ///< [m] how far left of the path the body's middle is.
};

BodyInBend PlaceInBend(const RoadView& view, int n, float length) {
  const int front = kNodesBehind + n;
  const PathPoint rear = Behind(view, n, length), middle = Behind(view, n, 0.5f * length);
  const float dx = rear.x - view.x[front], dy = rear.y - view.y[front];
  const float mx = view.x[front] + 0.5f * dx - middle.x, my = view.y[front] + 0.5f * dy - middle.y;
  return {dy * view.cos_heading[front] - dx * view.sin_heading[front],
          my * middle.cos_heading - mx * middle.sin_heading};
}

/// Distance driven and whether it still moves, under constant acceleration until standstill.
float Travel(float speed, float accel, float time) {
  if (accel < 0.0f) time = std::min(time, speed / -accel);
  return speed * time + 0.5f * accel * time * time;
}

/// As selections, so that loops over courses fill vector registers.
float Least(float a, float b, float c) {
  const float ab = a < b ? a : b;
  return ab < c ? ab : c;
}
float Most(float a, float b, float c) {
  const float ab = a > b ? a : b;
  return ab > c ? ab : c;
}

/// Lowers scratch->blocked_clearance[i][j] to the lateral gap of rollout (i, j) to road users beside the ego,
/// which move on at constant velocity. What is ahead limits the speed instead; what is behind keeps
/// its own distance. Who is too near already must not come nearer: a rollout that keeps the gap is free.
void CheckBeside(const AgentParams& params, const PlanContext& c, const SpeedProfiles& profiles,
                 PlanScratch* scratch) {
  const RoadView& view = scratch->view;
  const CourseSet& courses = scratch->courses;
  const int padded = RoundUp(courses.count);
  for (int i = 0; i < profiles.count; ++i) std::fill_n(scratch->blocked_clearance[i], padded, 1e3f);
  const float ego_length = static_cast<float>(c.vehicle->length);
  const int checks = static_cast<int>(params.dwa.horizon / kCheckPeriod);
  const float half_width = static_cast<float>(0.5 * c.vehicle->width);
  float leftmost = -1e3f, rightmost = 1e3f;
  for (int n = 0; n < kPathNodes; n += NodesBeside(view, ego_length)) {
    for (int j = 0; j < courses.count; ++j) {
      const float* middle_min = courses.bent ? courses.middle_min[n] : courses.front_min[n];
      const float* middle_max = courses.bent ? courses.middle_max[n] : courses.front_max[n];
      leftmost = std::max(leftmost,
                          Most(courses.front_max[n][j], courses.rear_max[n][j], middle_max[j]) + half_width);
      rightmost = std::min(
          rightmost, Least(courses.front_min[n][j], courses.rear_min[n][j], middle_min[j]) - half_width);
    }
  }
  const float comfort = static_cast<float>(params.dwa.clearance_comfort), margin = Margin(params.dwa, c);
  const bool sweeps = SweepsAcross(view, c);
  for (int m = 0; m < view.obstacle_count; ++m) {
    const Obstacle& o = view.obstacles[m];
    if (sweeps && o.body.length > 0.0) continue;  // LimitBySweep sees those.
    if (o.forgiven > 0.0f || o.s - o.half_length > 0.0f || o.s < -ego_length) continue;
    const float drift = std::abs(o.speed_d) * o.drift_time;
    if (o.d - o.half_width - drift > leftmost + comfort || o.d + o.half_width + drift < rightmost - comfort)
      continue;
    // A long body that makes room for us at walking speed may stop doing so at once.
    const bool makes_room = o.half_length > 0.5f * static_cast<float>(kLongBody) &&
                            std::abs(o.speed_s) < static_cast<float>(kWalkingSpeed) && o.d * o.speed_d > 0.0f;
    const float front_now = courses.front[0][0], rear_now = courses.rear[0][0];
    const float middle_now = courses.bent ? courses.middle[0][0] : front_now;
    const float left_now = Most(front_now, rear_now, middle_now) + half_width;
    const float right_now = Least(front_now, rear_now, middle_now) - half_width;
    const float gap_now = std::max(right_now - (o.d + o.half_width), o.d - o.half_width - left_now);
    // Nearer by what rounding makes of standing beside it, but many plans must not add up to a touch.
    const float rounding = std::clamp(gap_now - kLeastGap, 0.0f, 0.02f);
    const float allowance = std::max(0.0f, margin - gap_now) + rounding;
    for (int i = 0; i < profiles.count; ++i) {
      for (int k = 0; k <= checks; ++k) {
        const float t = static_cast<float>(k) * kCheckPeriod;
        const float front = Travel(static_cast<float>(c.speed), profiles.accel[i], t);
        const float obstacle_s = o.s + o.speed_s * t;
        if (obstacle_s + o.half_length < front - ego_length || obstacle_s - o.half_length > front) continue;
        const int n = std::min(kPathNodes - 1, static_cast<int>(front / view.spacing));
        // Room between the centre lines: half the ego's width is taken off here once for all courses.
        const float moved = makes_room ? 0.0f : o.speed_d * std::min(t, o.drift_time);
        const float obstacle_left = o.d + moved + o.half_width - allowance + half_width;
        const float obstacle_right = o.d + moved - o.half_width + allowance - half_width;
        float* clearance = scratch->blocked_clearance[i];
        const float* ego_front = courses.front[n];
        const bool abreast = o.parallel && ego_length < kLongBody;
        const float* ego_rear = abreast ? ego_front : courses.rear[n];
        const float* ego_middle = abreast || !courses.bent ? ego_front : courses.middle[n];
#pragma omp simd
        for (int j = 0; j < padded; ++j) {
          const float low = Least(ego_front[j], ego_rear[j], ego_middle[j]);
          const float high = Most(ego_front[j], ego_rear[j], ego_middle[j]);
          const float gap_right = low - obstacle_left, gap_left = obstacle_right - high;
          const float gap = gap_right > gap_left ? gap_right : gap_left;
          clearance[j] = gap < clearance[j] ? gap : clearance[j];
        }
      }
    }
  }
}

/// Where a point of the body is, on each course, while it passes an obstacle.
class Passage {
 public:
  using Places = float[kPathNodes][kMaxCourses];
  /// @param node place along the path, in nodes, from which it passes; min and max: from each node on.
  Passage(const Places& at, const Places& min, const Places& max, float node) {
    const int n = std::min(kPathNodes - 1, static_cast<int>(node)), after = std::min(kPathNodes - 1, n + 1);
    share_ = node - static_cast<float>(n);
    here_ = at[n];
    next_ = at[after];
    min_ = min[after];
    max_ = max[after];
  }
  /// Least and greatest d [m] on course j.
  float Low(int j) const {
    const float first = here_[j] + share_ * (next_[j] - here_[j]);
    return first < min_[j] ? first : min_[j];
  }
  float High(int j) const {
    const float first = here_[j] + share_ * (next_[j] - here_[j]);
    return first > max_[j] ? first : max_[j];
  }

 private:
  const float *here_, *next_, *min_, *max_;
  float share_;  // Of the way from here_ to next_; their values are equal behind the last node.
};

/// [m] lateral target of the course that may be driven fastest, if there is more room on it than on the
/// present one; of equal ones that which keeps clearest, then that which turns least. None that comes nearer
/// to what is beside the ego than the present one.
/// @param present [m] target of the course the ego is on.
/// @param beside [m] by course, lateral gap to what is beside the ego.
double RoomiestCourse(double present, const CourseSet& courses, const float* beside) {
  constexpr float kAsNear = 0.05f;  // [m]
  const auto turn = [&](int j) { return std::abs(courses.target[j] - present); };
  int nearest = 0;
  for (int j = 1; j < courses.count; ++j) {
    if (turn(j) < turn(nearest)) nearest = j;
  }
  int best = nearest;
  for (int j = 0; j < courses.count; ++j) {
    const auto merit = [&](int k) {
      const bool keeps_off = beside[k] > beside[nearest] - kAsNear;
      return std::tuple(keeps_off, courses.safe_speed[k], std::min(courses.clearance[k], beside[k]),
                        -turn(k));
    };
    if (merit(j) > merit(best)) best = j;
  }
  return best == nearest ? present : courses.target[best];
}

/// The side, +1 left or -1 right, of the body beside the ego, or just ahead, that is nearest to its flank; 0:
/// none.
double TightSide(const RoadView& view, const PlanContext& c) {
  constexpr float kJustAhead = 5.0f;  // [m]
  float nearest = std::numeric_limits<float>::infinity(), side = 0.0f;
  for (int m = 0; m < view.obstacle_count; ++m) {
    const Obstacle& o = view.obstacles[m];
    if (o.s - o.half_length > kJustAhead || o.s + o.half_length < -static_cast<float>(c.vehicle->length))
      continue;
    const float away = o.d - static_cast<float>(c.d), gap = std::abs(away) - o.half_width;
    if (gap >= nearest) continue;
    nearest = gap;
    side = away > 0.0f ? 1.0f : -1.0f;
  }
  return side;
}

/// [m] lateral target for which the steering stays as it is: who swings out past something and finds no way
/// must not turn back into it. Where the ego is while it creeps, or if the course leads towards what is
/// nearest.
double PresentCourse(const DrivingParams& driving, const RoadView& view, const PlanContext& c) {
  if (c.speed < kWalkingSpeed) return c.d;
  const double reach = std::max(driving.tracking_distance, c.speed * driving.tracking_time);
  const double shift = reach * (c.heading_error + c.slip);
  if (shift * TightSide(view, c) > 0.0) return c.d;
  return std::clamp(c.d + shift, std::min(c.d, c.corridor_min), std::max(c.d, c.corridor_max));
}

}  // namespace

DynamicWindow ReachableSpeeds(double speed, double max_decel, double max_accel, double period) {
  return {std::max(0.0, speed - max_decel * period), speed + max_accel * period};
}

DynamicWindow ReachableSteering(double steering_angle, double max_rate, double max_angle, double period) {
  return {std::max(-max_angle, steering_angle - max_rate * period),
          std::min(max_angle, steering_angle + max_rate * period)};
}

void RollOutCourses(const DrivingParams& driving, const RoadView& view, const PlanContext& c, int count,
                    CourseSet* courses) {
  courses->count = count;
  courses->bent = false;
  const int padded = RoundUp(count);
  for (int j = 0; j < padded; ++j) {
    const double share = count < 2 ? 0.0 : std::min(1.0, static_cast<double>(j - 1) / (count - 2));
    courses->target[j] =
        static_cast<float>(j == 0 ? c.target_d : c.corridor_min + share * (c.corridor_max - c.corridor_min));
  }
  const VehicleParams& vehicle = *c.vehicle;
  const float l_r = static_cast<float>(vehicle.rear_axle_to_front);
  const float length = static_cast<float>(vehicle.length);
  // The tracking law d' = -gain (d - target), solved over a node's distance instead of an Euler step.
  const double law = 1.0 / std::max(driving.tracking_distance, c.speed * driving.tracking_time);
  const float gain = static_cast<float>((1.0 - std::exp(-law * view.spacing)) / view.spacing);
  const float max_course = static_cast<float>(driving.max_course_angle);
  const float max_slip = static_cast<float>(
      std::atan(vehicle.rear_axle_to_front / vehicle.wheelbase * std::tan(vehicle.max_steering_angle)));
  const float spacing = view.spacing;
  // Steering turns at a rate in time; over one node it can turn by rate * spacing / speed.
  const float max_turn =
      static_cast<float>(vehicle.max_steering_rate) * spacing / std::max(1.0f, static_cast<float>(c.speed));

  alignas(64) float d[kMaxCourses], heading[kMaxCourses], slip[kMaxCourses];
  std::fill_n(d, padded, static_cast<float>(c.d));
  std::fill_n(heading, padded, static_cast<float>(c.heading_error));
  std::fill_n(slip, padded, static_cast<float>(c.slip));
  const float* target = courses->target.data();
  for (int n = 0; n < kPathNodes; ++n) {
    const float curvature = view.curvature[n];
    const BodyInBend body = PlaceInBend(view, n, length);
    courses->bent = courses->bent || std::abs(body.bulge) > kNoBulge;
    float* front = courses->front[n];
    float* rear = courses->rear[n];
    float* middle = courses->middle[n];
#pragma omp simd
    for (int j = 0; j < padded; ++j) {
      front[j] = d[j];
      // A bend's body is a chord: without its tangent a rear bumper on the path would seem to be beside it.
      rear[j] = d[j] - length * heading[j] - body.tangent;
      middle[j] = 0.5f * (front[j] + rear[j]) + body.bulge;
      // The tracking law of the steering controller; then one step of the bicycle in distance.
      float course = gain * (target[j] - d[j]);
      course = course > max_course ? max_course : (course < -max_course ? -max_course : course);
      float turn = course - heading[j] - slip[j];
      turn = turn > max_turn ? max_turn : (turn < -max_turn ? -max_turn : turn);
      float beta = slip[j] + turn;
      beta = beta > max_slip ? max_slip : (beta < -max_slip ? -max_slip : beta);
      // The steering turns during the first part of the node; this is the mean slip over it.
      const float change = beta - slip[j];
      const float mean = beta - 0.5f * change * (change < 0.0f ? -change : change) / max_turn;
      slip[j] = beta;
      const float angle = heading[j] + mean;
      d[j] += spacing * (angle + angle * angle * angle * (1.0f / 3.0f));                        // tan
      heading[j] += spacing * ((mean - mean * mean * mean * (1.0f / 6.0f)) / l_r - curvature);  // sin
    }
  }
  const int window = NodesBeside(view, length);
  RangeFromNodeOn(courses->front, padded, window, courses->front_min, courses->front_max);
  RangeFromNodeOn(courses->rear, padded, window, courses->rear_min, courses->rear_max);
  RangeFromNodeOn(courses->middle, padded, window, courses->middle_min, courses->middle_max);
}

void LimitCourseSpeeds(const AgentParams& params, const RoadView& view, const PlanContext& c,
                       CourseSet* courses) {
  const int padded = RoundUp(courses->count);
  const VehicleParams& vehicle = *c.vehicle;
  const double comfort_decel = std::min(params.driving.comfort_decel, vehicle.max_decel);
  // By when the ego drives as it wants now.
  const double lag = params.driving.response_time + vehicle.accel_lag;
  const auto limits = [&](double gap, double leader_speed, double leader_accel, bool cruised) {
    const double room = gap - vehicle.min_gap;
    double reaction = c.time_gap;
    if (cruised) {
      // Who hears of the leader's braking at once need not keep the time to notice it; but if the leader
      // brakes harder than the ego can, it stops as from a lower speed.
      reaction = params.v2x.cruise_reaction;
      leader_speed *= std::sqrt(std::min(1.0, vehicle.max_decel / c.leader_decel));
    } else {
      leader_speed = std::max(0.0, leader_speed + lag * leader_accel);
    }
    const double safe = SafeSpeed(room, leader_speed, vehicle.max_decel, reaction);
    return std::pair{std::min(safe, SafeSpeed(room, leader_speed, comfort_decel, reaction)), safe};
  };
  const auto [lane_comfort, lane_safe] = limits(c.leader_gap, c.leader_speed, c.leader_accel, c.cruising);
  double wanted = std::min(c.free_speed, lane_comfort);
  if (c.cruising)
    wanted = std::min(wanted, std::max(0.0, c.speed + c.cruise_accel * params.driving.response_time));
  std::fill_n(courses->comfort_speed.begin(), padded, static_cast<float>(wanted));
  std::fill_n(courses->safe_speed.begin(), padded, static_cast<float>(lane_safe));
  std::fill_n(courses->clearance.begin(), padded, 1e3f);
  courses->leader_gap = static_cast<float>(c.leader_gap);
  courses->leader_speed = static_cast<float>(c.leader_speed);
  courses->leader_row = c.leader_row;

  const float margin = Margin(params.dwa, c);
  const float half_width = static_cast<float>(0.5 * vehicle.width);
  const bool sweeps = SweepsAcross(view, c);
  if (sweeps) LimitBySweep(params, view, c, margin, courses);
  for (int m = 0; m < view.obstacle_count; ++m) {
    const Obstacle& o = view.obstacles[m];
    if (sweeps && o.body.length > 0.0) continue;
    const float gap = o.s - o.half_length;
    if (gap <= 0.0f) continue;
    // Who comes towards us needs room to stop, too.
    const double oncoming = std::max(0.0, -static_cast<double>(o.speed_s));
    const double its_way = oncoming * vehicle.time_gap + oncoming * oncoming / (2.0 * vehicle.max_decel);
    const double its_accel = oncoming > 0.0 ? 0.0 : o.along * o.accel;
    const auto [comfort, safe] =
        limits(gap - its_way, std::max(0.0f, o.speed_s), its_accel, c.cruising && o.row == c.leader_row);
    // What moves across sweeps a band until the ego is there.
    const float drift = o.speed_d * std::min(o.drift_time, gap / std::max(1.0f, static_cast<float>(c.speed)));
    const float obstacle_right = o.d - o.half_width + std::min(0.0f, drift) - half_width;
    const float obstacle_left = o.d + o.half_width + std::max(0.0f, drift) + half_width;
    // The front passes the obstacle from here on, the middle and the rear half a body and a body later.
    const float length = static_cast<float>(vehicle.length);
    const Passage front(courses->front, courses->front_min, courses->front_max, gap / view.spacing);
    const auto rest_of_body = [&](const auto& at, const auto& min, const auto& max, float behind) {
      return Passage(at, min, max, (gap + behind) / view.spacing);
    };
    // A bend moves the rear of both who go abreast; a bus's moves farther.
    const bool abreast = o.parallel && vehicle.length < kLongBody;
    const Passage rear =
        abreast ? front : rest_of_body(courses->rear, courses->rear_min, courses->rear_max, length);
    // Who swings out passes a corner with its flank last.
    const Passage middle =
        abreast ? front
                : rest_of_body(courses->middle, courses->middle_min, courses->middle_max, 0.5f * length);
    const auto lateral_gap_of = [&](int j) {
      const float low = Least(front.Low(j), rear.Low(j), middle.Low(j));
      const float high = Most(front.High(j), rear.High(j), middle.High(j));
      const float gap_right = low - obstacle_left, gap_left = obstacle_right - high;
      return gap_right > gap_left ? gap_right : gap_left;
    };
    const float comfort_speed = static_cast<float>(comfort), safe_speed = static_cast<float>(safe);
    const float least_gap = margin - o.forgiven;
    // What a course runs into limits its speed; as a critic it counts like a touch. But of what reaches only
    // a little into the wanted course, less is better: who stops before it then stops where it can pass.
    const float deepest = lateral_gap_of(0) > -kSwerve ? -kSwerve : 0.0f;
#pragma omp simd
    for (int j = 0; j < padded; ++j) {
      const float lateral_gap = lateral_gap_of(j);
      const bool in_course = lateral_gap < least_gap;
      const float comfort_j = courses->comfort_speed[j], safe_j = courses->safe_speed[j],
                  clear_j = courses->clearance[j];
      courses->comfort_speed[j] = in_course && comfort_speed < comfort_j ? comfort_speed : comfort_j;
      courses->safe_speed[j] = in_course && safe_speed < safe_j ? safe_speed : safe_j;
      const float gap_or_touch = lateral_gap > deepest ? lateral_gap : deepest;
      courses->clearance[j] = gap_or_touch < clear_j ? gap_or_touch : clear_j;
    }
    if (lateral_gap_of(0) < least_gap && gap < courses->leader_gap) {
      courses->leader_gap = gap;
      courses->leader_row = o.row;
      courses->leader_speed = std::max(0.0f, o.speed_s);
    }
  }
}

Plan PlanDwa(const AgentParams& params, const PlanContext& c, PlanScratch* scratch) noexcept {
  CourseSet& courses = scratch->courses;
  RollOutCourses(params.driving, scratch->view, c, params.dwa.path_samples, &courses);
  LimitCourseSpeeds(params, scratch->view, c, &courses);
  const SpeedProfiles profiles = MakeSpeedProfiles(params, c, courses.comfort_speed[0]);
  CheckBeside(params, c, profiles, scratch);

  const DwaParams& w = params.dwa;
  const float free_speed = static_cast<float>(std::max(1.0, c.free_speed));
  const float margin = Margin(w, c), comfort = static_cast<float>(w.clearance_comfort);
  const float slowest = profiles.next_speed[1], fastest = profiles.next_speed[profiles.count - 1];
  const auto nearness = [&](float clearance) {
    return std::max(0.0f, 1.0f - clearance / std::max(comfort, 1e-3f));
  };
  float best_cost = std::numeric_limits<float>::infinity(), widest = -std::numeric_limits<float>::infinity();
  Plan plan{-c.vehicle->max_decel, c.d, PlanStatus::kNoFeasibleCommand}, squeezed = plan;
  for (int j = 0; j < courses.count; ++j) {
    const float reference = courses.comfort_speed[j];
    const float path_cost =
        static_cast<float>(w.path_weight) * std::abs(courses.target[j] - static_cast<float>(c.target_d)) +
        static_cast<float>(w.goal_weight) * std::max(0.0f, free_speed - reference) / free_speed;
    if (path_cost >= best_cost) continue;
    const float reachable = std::clamp(reference, slowest, fastest);
    for (int i = 0; i < profiles.count; ++i) {
      const float speed = profiles.next_speed[i];
      if (speed > courses.safe_speed[j] + 1e-4f) continue;
      const float beside = scratch->blocked_clearance[i][j],
                  clearance = std::min(courses.clearance[j], beside);
      if (beside < margin) {
        // Squeezed it does what gives most room, but does not speed up against a limit.
        if (j == 0 && beside > widest && speed <= std::max(reachable, static_cast<float>(c.speed))) {
          widest = beside;
          squeezed.accel = profiles.accel[i];
        }
        continue;
      }
      const float cost = path_cost +
                         static_cast<float>(w.speed_weight) * std::abs(speed - reachable) / free_speed +
                         static_cast<float>(w.clearance_weight) * nearness(clearance) +
                         static_cast<float>(w.comfort_weight) * std::abs(profiles.accel[i]) /
                             static_cast<float>(c.vehicle->max_decel);
      if (cost < best_cost) {
        best_cost = cost;
        plan = {profiles.accel[i], courses.target[j], PlanStatus::kOk};
      }
    }
  }
  if (plan.status == PlanStatus::kOk) return plan;
  // Squeezed from the side, braking is of use only where it gives more room. Ahead, braking on another course
  // may need less of it.
  squeezed.target_d =
      RoomiestCourse(PresentCourse(params.driving, scratch->view, c), courses, scratch->blocked_clearance[1]);
  return squeezed;
}

Plan PlanIdm(const AgentParams& params, const PlanContext& c, PlanScratch* scratch) noexcept {
  CourseSet& courses = scratch->courses;
  RollOutCourses(params.driving, scratch->view, c, 1, &courses);
  LimitCourseSpeeds(params, scratch->view, c, &courses);
  const VehicleParams& vehicle = *c.vehicle;
  const double accel = IdmAccel(c.speed, c.free_speed, courses.leader_gap, courses.leader_speed,
                                vehicle.max_accel, params.driving.comfort_decel, c.time_gap, vehicle.min_gap);
  return {std::clamp(accel, -vehicle.emergency_decel, vehicle.max_accel), c.target_d, PlanStatus::kOk};
}

}  // namespace lanewise
