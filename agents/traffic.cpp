#include "agents/traffic.h"

namespace lanewise {
namespace {

template <class... Columns>
void ResizeAll(std::size_t n, Columns&... columns) {
  (columns.resize(n), ...);
}

template <class... Columns>
void MoveAll(std::size_t from, std::size_t to, Columns&... columns) {
  ((columns[to] = columns[from]), ...);
}

/// Calls f with every column of a Motion.
template <class F>
void WithColumns(Motion& m, F&& f) {
  f(m.lane, m.s, m.d, m.heading_error, m.speed, m.accel, m.speed_ref, m.planned_accel, m.planned_jerk,
    m.time_gap, m.follows, m.steering_angle, m.x, m.y, m.heading, m.curvature, m.blinker, m.urgent,
    m.since_change, m.waited, m.yielded_to, m.speed_pid, m.steering_pid);
}

/// Calls f with every column of Traffic but its motions.
template <class F>
void WithColumns(Traffic& t, F&& f) {
  f(t.number, t.id_hash, t.vehicle_class, t.policy, t.params, t.plan, t.route_position, t.driven, t.hazard,
    t.stop_distance, t.stop_lane, t.speed_limit);
}

}  // namespace

void Motion::Resize(std::size_t n) {
  WithColumns(*this, [n](auto&... columns) { ResizeAll(n, columns...); });
}

void Motion::MoveRow(std::size_t from, std::size_t to) {
  WithColumns(*this, [=](auto&... columns) { MoveAll(from, to, columns...); });
}

void Traffic::Resize(std::size_t n) {
  WithColumns(*this, [n](auto&... columns) { ResizeAll(n, columns...); });
  now.Resize(n);
  next.Resize(n);
}

void Traffic::RemoveRow(std::size_t row) {
  const std::size_t last = size() - 1;
  WithColumns(*this, [=](auto&... columns) { MoveAll(last, row, columns...); });
  now.MoveRow(last, row);
  next.MoveRow(last, row);
  Resize(last);
}

void Commands::Resize(std::size_t n) {
  ResizeAll(n, lane_speed, change_lane, change_shift, emergency, passed_on_lane);
}

std::size_t AgentStateBytes() {
  Traffic traffic;
  const auto row_bytes = [](auto&... columns) { return (sizeof(columns[0]) + ...); };
  std::size_t motion = 0, rest = 0;
  WithColumns(traffic.now, [&](auto&... columns) { motion = row_bytes(columns...); });
  WithColumns(traffic, [&](auto&... columns) { rest = row_bytes(columns...); });
  return 2 * motion + rest + sizeof(double) + sizeof(std::int8_t) + 2 * sizeof(std::uint8_t);
}

}  // namespace lanewise
