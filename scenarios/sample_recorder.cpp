#include "scenarios/sample_recorder.h"

#include <omp.h>

#include <algorithm>
#include <cmath>

namespace lanewise {

void LateralTrack::Follow(const RoadNetwork& network, LaneIndex lane, double d, double progress) {
  if (lane_ == kNone) {
    ++part_;
    offset_ = 0.0;
  } else if (const Lane& from = network.lanes[lane_], &to = network.lanes[lane];
             lane != lane_ && from.edge == to.edge) {
    // From lane middle to lane middle over every lane between.
    const int step = to.index > from.index ? 1 : -1;
    const LaneIndex first = network.edges[from.edge].first_lane;
    for (int k = from.index; k != to.index; k += step)
      offset_ += step * 0.5 * (network.lanes[first + k].width + network.lanes[first + k + step].width);
  }
  lane_ = lane;
  d_ = d;
  distance_ += progress;
}

Avoidance WayTaken(double shift, double min_shift) {
  if (shift >= min_shift) return Avoidance::kLeft;
  return shift <= -min_shift ? Avoidance::kRight : Avoidance::kForward;
}

SampleRecorder::SampleRecorder(const RoadNetwork& network, const std::vector<LaneCurve>& curves,
                               const AgentParams& params, const SampleParams& samples, std::uint64_t seed,
                               const std::string& file, const std::string& note)
    : network_(network),
      curves_(curves),
      params_(params),
      samples_(samples),
      seed_(seed),
      writer_(file, note),
      lidar_(params.lidar),
      occupancy_(network) {
  for (int t = 0; t < omp_get_max_threads(); ++t) scratch_.push_back(std::make_unique<Scratch>());
}

void SampleRecorder::Observe(std::int64_t step, double time, double dt, const Traffic& traffic,
                             const VehicleBridge& bridge) {
  Track(dt, traffic, bridge);
  Label(time);
  if (time < next_scan_ - 0.5 * dt) return;
  next_scan_ = time + samples_.period;
  Scan(step, time, traffic);
}

void SampleRecorder::Track(double dt, const Traffic& traffic, const VehicleBridge& bridge) {
  ++observed_;
  for (std::size_t i = 0; i < traffic.vehicle_count; ++i) {
    const auto number = static_cast<std::size_t>(traffic.number[i]);
    if (number >= tracks_.size()) {
      tracks_.resize(number + 1);
      last_seen_.resize(number + 1, -1);
      ids_.resize(number + 1);
    }
    if (last_seen_[number] < 0) ids_[number] = bridge.record(i).id;
    last_seen_[number] = observed_;
    const LaneIndex lane = traffic.now.lane[i];
    if (lane == kNone) {
      tracks_[number].Lose();
    } else {
      tracks_[number].Follow(network_, lane, traffic.now.d[i], traffic.now.speed[i] * dt);
    }
  }
}

void SampleRecorder::Label(double time) {
  for (; !open_.empty() && open_.front().due <= time + 1e-6; open_.pop_front()) {
    const Open& scan = open_.front();
    const auto number = static_cast<std::size_t>(scan.number);
    const LateralTrack& track = tracks_[number];
    const bool is_here = last_seen_[number] == observed_ && track.on_road() && track.part() == scan.part;
    if (!is_here || track.distance() - scan.distance < kLeastProgress) continue;
    writer_.Add(scan.time, ids_[number], InputsOfCode(scan.code),
                WayTaken(track.lateral() - scan.lateral, samples_.min_shift));
  }
}

void SampleRecorder::Scan(std::int64_t step, double time, const Traffic& traffic) {
  const std::size_t n = traffic.size();
  center_x_.resize(n);
  center_y_.resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    const double half = 0.5 * traffic.params[i].length;
    center_x_[i] = traffic.now.x[i] - half * std::cos(traffic.now.heading[i]);
    center_y_[i] = traffic.now.y[i] - half * std::sin(traffic.now.heading[i]);
  }
  grid_.Build(center_x_, center_y_);
  occupancy_.Build(traffic);
  const World world{&network_, &curves_, &traffic, &occupancy_, &grid_, center_x_, center_y_};
  codes_.assign(traffic.vehicle_count, 0);
#pragma omp parallel for schedule(dynamic, 16)
  for (std::size_t i = 0; i < traffic.vehicle_count; ++i) {
    if (traffic.plan[i] == nullptr || traffic.now.lane[i] == kNone || traffic.hazard[i]) continue;
    Scratch& scratch = *scratch_[static_cast<std::size_t>(omp_get_thread_num())];
    const auto ego = static_cast<AgentIndex>(i);
    const double reach = params_.lidar.max_range + 10.0;
    const WayAhead way = LookAhead(world, ego, reach);
    const Leader leader = FindLeader(world, ego, way);
    SenseRoad(world, ego, way, reach, false, &scratch.view);
    const ScanErrors errors(params_.lidar, seed_, traffic.number[i], step);
    codes_[i] = ScanSectors(world, ego, way, scratch.view, params_, lidar_,
                            leader.row == kNone ? 0.0 : leader.speed, errors, &scratch.reflectors);
  }
  for (std::size_t i = 0; i < traffic.vehicle_count; ++i) {
    if (codes_[i] == 0) continue;
    const LateralTrack& track = tracks_[static_cast<std::size_t>(traffic.number[i])];
    open_.push_back({time + samples_.horizon, time, traffic.number[i], track.part(), track.lateral(),
                     track.distance(), codes_[i]});
  }
}

}  // namespace lanewise
