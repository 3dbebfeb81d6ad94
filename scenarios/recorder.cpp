#include "scenarios/recorder.h"

#include <cmath>

#include "agents/core/geometry.h"
#include "agents/sensing/road_view.h"
#include "agents/vehicle/kinematic_bicycle.h"
#include "analysis/vehicle_mass.h"
#include "scenarios/timed.h"

namespace lanewise {
namespace {

constexpr double kHaltingSpeed = 0.1;  // [m/s], SUMO's.

/// Is `step` the first at or after a multiple of `period`? Period 0: always.
bool IsDue(std::int64_t step, double period, double step_length) {
  if (period <= step_length) return true;
  const auto every = static_cast<std::int64_t>(std::llround(period / step_length));
  return step % every == 0;
}

}  // namespace

Recorder::Recorder(const RoadNetwork& network, const RecorderParams& params, RunWriter* writer)
    : network_(network),
      params_(params),
      writer_(writer),
      safety_(params.safety, &network, params.safety_level),
      trips_(params.step_length, {.ttc_encounter = params.safety.ttc_encounter}),
      edges_(network, params.begin, params.step_length, params.edge_interval),
      comfort_(params.step_length),
      rules_(network, params.step_length),
      shares_(std::size(kPolicyNames)) {
  for (std::size_t i = 0; i < shares_.size(); ++i) shares_[i].policy = kPolicyNames[i];
  if (writer_ == nullptr) return;
  std::vector<LaneRow> lanes;
  for (std::size_t i = 0; i < network.lanes.size(); ++i)
    lanes.push_back({static_cast<LaneIndex>(i), network.lanes[i].id});
  writer_->Add(lanes);
  std::vector<EdgeRow> edges;
  for (std::size_t i = 0; i < network.edges.size(); ++i) {
    const Edge& edge = network.edges[i];
    const double length = edge.first_lane == kNone ? 0.0 : network.lanes[edge.first_lane].length;
    edges.push_back({static_cast<EdgeIndex>(i), edge.id, edge.lane_count, length,
                     edge.function == EdgeFunction::kInternal});
  }
  writer_->Add(edges);
}

void Recorder::Observe(std::int64_t step, double time, double wall_time, const Traffic& traffic,
                       const VehicleBridge& bridge) {
  Depart(traffic, bridge);
  FillFrame(step, time, traffic, bridge);
  if (params_.safety_level != SafetyLevel::kOff) Timed(&safety_time_, [&] { safety_.Observe(frame_); });
  trips_.Observe(frame_, safety_.row_ttc(), safety_.row_drac());
  edges_.Observe(frame_);
  comfort_.Observe(frame_);
  rules_.Observe(time, traffic);
  for (const Departure& gone : bridge.gone())
    FinishTrip(gone.number, time, gone.arrived ? TripEnd::kArrived : TripEnd::kVaporized);
  if (IsDue(step, params_.sample_period, params_.step_length)) Timed(&sampling_time_, [&] { Sample(); });
  if (IsDue(step, 1.0, params_.step_length)) {
    Summarize(wall_time, bridge);
    Flush();
  }
}

void Recorder::Depart(const Traffic& traffic, const VehicleBridge& bridge) {
  for (const std::int32_t row : bridge.new_vehicles()) {
    const VehicleRecord& record = bridge.record(row);
    const auto policy = traffic.policy[row];
    vehicles_.push_back({traffic.number[row], record.id, record.type, record.vehicle_class,
                         std::string(kPolicyNames[static_cast<std::size_t>(policy)]), record.depart,
                         record.depart_delay, traffic.params[row].length, traffic.params[row].width});
    trips_.Depart(vehicles_.back());
    comfort_.Depart(traffic.number[row], vehicles_.back().policy);
    ++inserted_;
    ++shares_[static_cast<std::size_t>(policy)].vehicles;
  }
  const auto weigh = [this](std::int32_t number, const std::string& vehicle_class) {
    const auto n = static_cast<std::size_t>(number);
    if (n >= ways_.size()) ways_.resize(n + 1);
    ways_[n].mass = TypicalMass(vehicle_class);
  };
  for (const VehicleRow& vehicle : vehicles_) weigh(vehicle.number, vehicle.vclass);
  // Persons have a number and samples, but no trip and no share in the policies.
  for (const NewPerson& person : bridge.new_persons()) {
    const VehicleRecord& record = person.record;
    vehicles_.push_back({traffic.number[person.row], record.id, record.type, record.vehicle_class,
                         std::string(kPolicyNames[static_cast<std::size_t>(Policy::kSumo)]), record.depart,
                         record.depart_delay, traffic.params[person.row].length,
                         traffic.params[person.row].width});
    weigh(vehicles_.back().number, vehicles_.back().vclass);
  }
}

void Recorder::FillFrame(std::int64_t step, double time, const Traffic& traffic,
                         const VehicleBridge& bridge) {
  const Motion& now = traffic.now;
  frame_.step = step;
  frame_.time = time;
  frame_.Resize(traffic.size());
  for (std::size_t i = 0; i < traffic.size(); ++i) {
    const bool vehicle = i < traffic.vehicle_count;
    const VehicleParams& params = traffic.params[i];
    const bool driven = traffic.driven[i] != 0;
    frame_.vehicle_number[i] = traffic.number[i];
    frame_.x[i] = now.x[i];
    frame_.y[i] = now.y[i];
    frame_.heading[i] = now.heading[i];
    frame_.speed[i] = now.speed[i];
    frame_.accel[i] = now.accel[i];
    frame_.length[i] = params.length;
    frame_.width[i] = params.width;
    frame_.pedestrian[i] = !vehicle;
    frame_.agent_driven[i] = driven;
    frame_.lane[i] = now.lane[i];
    FillWay(traffic, i);
    const double slip =
        driven ? SlipAngle(now.steering_angle[i], params.wheelbase, params.rear_axle_to_front) : 0.0;
    frame_.vx[i] = now.speed[i] * std::cos(now.heading[i] + slip);
    frame_.vy[i] = now.speed[i] * std::sin(now.heading[i] + slip);
    if (!vehicle) continue;
    // Yaw: the bicycle's own for agents; along the lane for SUMO's point on a lane, whose drawn angle jumps.
    frame_.yaw_rate[i] =
        driven ? now.speed[i] / params.rear_axle_to_front * std::sin(slip) : now.speed[i] * now.curvature[i];
    frame_.lateral_accel[i] = frame_.yaw_rate[i] * now.speed[i];
    frame_.lane_pos[i] = now.s[i];
    frame_.lateral_offset[i] = now.d[i];
    frame_.lateral_speed[i] = driven ? now.speed[i] * std::sin(now.heading_error[i] + slip) : 0.0;
    frame_.allowed_speed[i] = traffic.speed_limit[i];
    frame_.in_junction[i] = now.lane[i] != kNone && network_.lanes[now.lane[i]].internal;
    frame_.planned_stop[i] = traffic.hazard[i];
    const EmissionRates& rates = bridge.emissions()[i];
    frame_.co2_rate[i] = rates.co2;
    frame_.nox_rate[i] = rates.nox;
    frame_.pmx_rate[i] = rates.pmx;
    frame_.fuel_rate[i] = rates.fuel;
    frame_.electricity_rate[i] = rates.electricity;
    PolicyShareRow& share = shares_[static_cast<std::size_t>(traffic.policy[i])];
    ++share.vehicle_steps;
    share.agent_steps += driven;
    ++vehicle_steps_;
    agent_steps_ += driven;
  }
}

void Recorder::FillWay(const Traffic& traffic, std::size_t row) {
  Way& way = ways_[static_cast<std::size_t>(traffic.number[row])];
  const LaneIndex lane = traffic.now.lane[row];
  if (lane != way.lane) {
    const bool beside =
        lane != kNone && way.lane != kNone && network_.lanes[lane].edge == network_.lanes[way.lane].edge;
    if (!beside) way.behind = way.lane;  // A lane change leaves the way behind as it was.
  }
  if (lane != way.lane || traffic.plan[row] != way.plan ||
      traffic.route_position[row] != way.route_position) {
    way.lane = lane;
    way.plan = traffic.plan[row];
    way.route_position = traffic.route_position[row];
    way.path = {};
    LaneIndex next = lane;
    auto position = static_cast<std::size_t>(std::max(0, way.route_position));
    for (std::size_t k = 0; k < LanePath::kLanes && next != kNone; ++k) {
      way.path.lane[k] = next;
      if (way.plan == nullptr) break;
      next = NextLane(network_, *way.plan, position, next);
      if (next != kNone && !network_.lanes[next].internal) ++position;
    }
  }
  frame_.path[row] = way.path;
  frame_.lane_behind[row] = way.behind;
  frame_.mass[row] = way.mass;
}

void Recorder::FinishTrip(std::int32_t number, double time, TripEnd end) {
  if (end == TripEnd::kArrived) ++arrived_;
  if (end == TripEnd::kVaporized) ++vaporized_;
  finished_trips_.push_back(trips_.Finish(number, time, end));
}

void Recorder::Add(const std::vector<CoordinationEvent>& events) {
  if (writer_ != nullptr && !events.empty()) writer_->Add(events);
}

void Recorder::Sample() {
  for (std::size_t i = 0; i < frame_.size(); ++i) {
    samples_.push_back({frame_.time, frame_.vehicle_number[i], frame_.lane[i], frame_.x[i], frame_.y[i],
                        frame_.heading[i], frame_.speed[i], frame_.accel[i], frame_.lane_pos[i],
                        frame_.lateral_offset[i]});
  }
}

void Recorder::Summarize(double wall_time, const VehicleBridge& bridge) {
  StepSummaryRow row;
  row.time = frame_.time;
  double speed_sum = 0.0;
  for (std::size_t i = 0; i < frame_.size(); ++i) {
    if (frame_.pedestrian[i]) continue;
    ++row.running;
    row.halting += frame_.speed[i] < kHaltingSpeed;
    row.agent_driven += frame_.agent_driven[i];
    speed_sum += frame_.speed[i];
  }
  if (row.running > 0) row.mean_speed = speed_sum / static_cast<double>(row.running);
  row.arrived = arrived_;
  row.waiting_to_insert = static_cast<std::int64_t>(bridge.pending());
  row.wall_time = wall_time;
  summaries_.push_back(row);
}

void Recorder::Flush() {
  if (writer_ != nullptr) {
    writer_->Add(vehicles_);
    writer_->Add(finished_trips_);
    Timed(&sampling_time_, [&] { writer_->Add(samples_); });
    writer_->Add(summaries_);
    Timed(&safety_time_, [&] {
      writer_->Add(safety_.TakeFinishedContacts());
      writer_->Add(safety_.TakeFinishedEncounters());
      writer_->Add(safety_.TakeFinishedSamples());
    });
    writer_->Add(edges_.TakeFinished());
    writer_->Add(rules_.TakeEvents());
  } else {
    safety_.TakeFinishedContacts();
    safety_.TakeFinishedEncounters();
    safety_.TakeFinishedSamples();
    edges_.TakeFinished();
    rules_.TakeEvents();
  }
  vehicles_.clear();
  finished_trips_.clear();
  samples_.clear();
  summaries_.clear();
}

void Recorder::Finish(double time) {
  for (const std::int32_t number : trips_.UnderWay())
    finished_trips_.push_back(trips_.Finish(number, time, TripEnd::kRunning));
  safety_.Finish();
  edges_.Finish(time);
  Flush();
  if (writer_ != nullptr) writer_->Add(comfort_.Rows());
}

std::vector<PolicyShareRow> Recorder::policy_shares() const {
  std::vector<PolicyShareRow> used;
  for (const PolicyShareRow& share : shares_) {
    if (share.vehicles > 0) used.push_back(share);
  }
  return used;
}

}  // namespace lanewise
