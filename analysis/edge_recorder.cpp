#include "analysis/edge_recorder.h"

#include <algorithm>
#include <utility>

#include "agents/core/check.h"

namespace lanewise {
namespace {

constexpr double kHaltingSpeed = 0.1;  // [m/s] SUMO's.

}  // namespace

EdgeRecorder::EdgeRecorder(const RoadNetwork& network, double begin, double step_length, double interval)
    : network_(network),
      step_length_(step_length),
      interval_(interval),
      interval_begin_(begin),
      sums_(network.edges.size()) {
  LANEWISE_CHECK(interval >= 0.0 && step_length > 0.0);
}

void EdgeRecorder::Observe(const TrafficFrame& frame) {
  if (interval_ == 0.0) return;
  for (std::size_t i = 0; i < frame.size(); ++i) {
    if (frame.pedestrian[i]) continue;
    const auto number = static_cast<std::size_t>(frame.vehicle_number[i]);
    if (number >= edge_of_.size()) edge_of_.resize(number + 1, kNone);
    const EdgeIndex edge = frame.lane[i] == kNone ? kNone : network_.lanes[frame.lane[i]].edge;
    const EdgeIndex before = std::exchange(edge_of_[number], edge);
    if (edge == kNone) continue;  // Off the road: teleporting, parking.
    if (edge != before) ++sums_[edge].entered;
    if (before == kNone) continue;  // Inserted in this step: it has not driven yet.
    const double distance = frame.speed[i] * step_length_;
    const double here = edge == before ? distance : std::min(distance, frame.lane_pos[i]);
    const double share = distance > 0.0 ? here / distance : 1.0;
    Add(frame, i, edge, share * step_length_, here);
    if (share < 1.0) Add(frame, i, before, (1.0 - share) * step_length_, distance - here);
  }
  // Half a step of tolerance: times are sums of steps.
  if (frame.time >= interval_begin_ + interval_ - 0.5 * step_length_) CloseInterval(frame.time);
}

void EdgeRecorder::Add(const TrafficFrame& frame, std::size_t row, EdgeIndex edge, double time,
                       double distance) {
  Sums& sums = sums_[edge];
  const double speed = frame.speed[row], allowed = frame.allowed_speed[row];
  sums.time += time;
  sums.distance += distance;
  sums.speed += speed * time;
  sums.speed_square += speed * speed * time;
  if (!frame.planned_stop[row]) {
    if (speed < kHaltingSpeed) sums.waiting += time;
    if (allowed > 0.0) sums.time_loss += time * (1.0 - std::min(speed, allowed) / allowed);
  }
  sums.co2 += frame.co2_rate[row] * time;
  sums.nox += frame.nox_rate[row] * time;
  sums.pmx += frame.pmx_rate[row] * time;
  sums.fuel += frame.fuel_rate[row] * time;
  sums.electricity += frame.electricity_rate[row] * time;
}

void EdgeRecorder::CloseInterval(double end) {
  const double duration = end - interval_begin_;
  for (std::size_t e = 0; e < sums_.size(); ++e) {
    Sums& sums = sums_[e];
    if (sums.time == 0.0 && sums.entered == 0) continue;
    const double length = network_.lanes[network_.edges[e].first_lane].length;
    const double area = length * duration;
    EdgeIntervalRow row;
    row.begin = interval_begin_;
    row.end = end;
    row.edge = static_cast<EdgeIndex>(e);
    row.vehicle_time = sums.time;
    row.vehicle_distance = sums.distance;
    row.flow = area > 0.0 ? sums.distance / area : 0.0;
    row.density = area > 0.0 ? sums.time / area : 0.0;
    if (sums.time > 0.0) {
      const double mean = sums.speed / sums.time;
      row.speed = sums.distance / sums.time;
      row.speed_variance = std::max(0.0, sums.speed_square / sums.time - mean * mean);
    }
    row.waiting_time = sums.waiting;
    row.time_loss = sums.time_loss;
    row.entered = sums.entered;
    row.co2 = sums.co2;
    row.nox = sums.nox;
    row.pmx = sums.pmx;
    row.fuel = sums.fuel;
    row.electricity = sums.electricity;
    finished_.push_back(row);
    sums = {};
  }
  interval_begin_ = end;
}

std::vector<EdgeIntervalRow> EdgeRecorder::TakeFinished() {
  return std::exchange(finished_, {});
}

void EdgeRecorder::Finish(double time) {
  if (interval_ > 0.0 && time > interval_begin_ + 0.5 * step_length_) CloseInterval(time);
}

}  // namespace lanewise
