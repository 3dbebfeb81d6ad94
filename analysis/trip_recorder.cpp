#include "analysis/trip_recorder.h"

#include <algorithm>
#include <cmath>

#include "agents/core/check.h"

namespace lanewise {
namespace {

constexpr std::size_t kMinParallelRows = 1024;  // A row costs some 20 ns: less does not pay for a team.

void RaiseTo(double value, std::optional<double>* maximum) {
  if (!*maximum || value > **maximum) *maximum = value;
}

}  // namespace

const char* ToString(TripEnd end) {
  switch (end) {
    case TripEnd::kArrived:
      return "arrived";
    case TripEnd::kVaporized:
      return "vaporized";
    case TripEnd::kTeleported:
      return "teleported";
    case TripEnd::kRunning:
      return "running";
  }
  return "";
}

void TripRecorder::Depart(const VehicleRow& vehicle) {
  LANEWISE_CHECK(vehicle.number >= 0);
  const auto number = static_cast<std::size_t>(vehicle.number);
  if (number >= slot_of_.size()) slot_of_.resize(number + 1, kNone);
  LANEWISE_CHECK(slot_of_[number] == kNone);
  if (free_slots_.empty()) {
    free_slots_.push_back(static_cast<std::int32_t>(trips_.size()));
    trips_.emplace_back();
  }
  slot_of_[number] = free_slots_.back();
  free_slots_.pop_back();
  Trip& trip = trips_[static_cast<std::size_t>(slot_of_[number])];
  trip = {};
  trip.row.vehicle_number = vehicle.number;
  trip.row.depart = vehicle.depart;
  trip.row.depart_delay = vehicle.depart_delay;
}

void TripRecorder::Observe(const TrafficFrame& frame, std::span<const double> row_ttc,
                           std::span<const double> row_drac) {
  LANEWISE_CHECK(row_ttc.empty() || row_ttc.size() == frame.size());
  const std::size_t rows = frame.size();
  // Each row writes its own vehicle's slot only.
#pragma omp parallel for schedule(static) if (rows >= kMinParallelRows)
  for (std::size_t i = 0; i < rows; ++i) {
    const auto number = static_cast<std::size_t>(frame.vehicle_number[i]);
    if (number >= slot_of_.size() || slot_of_[number] == kNone) continue;
    Trip& trip = trips_[static_cast<std::size_t>(slot_of_[number])];
    if (!row_ttc.empty()) {
      TripRow& row = trip.row;
      const bool close = row_ttc[i] < params_.ttc_encounter;
      row.ttc_exposed = row.ttc_exposed.value_or(0.0) + (close ? step_length_ : 0.0);
      row.ttc_integrated = row.ttc_integrated.value_or(0.0) +
                           (close ? (params_.ttc_encounter - row_ttc[i]) * step_length_ : 0.0);
      if (close) row.min_ttc = std::min(row.min_ttc.value_or(row_ttc[i]), row_ttc[i]);
    }
    if (!row_drac.empty() && row_drac[i] > 0.0) RaiseTo(row_drac[i], &trip.row.max_drac);
    if (trip.inserted) AddStep(frame, i, &trip);
    trip.inserted = true;
  }
}

void TripRecorder::AddStep(const TrafficFrame& frame, std::size_t i, Trip* trip) const {
  const double dt = step_length_;
  const double speed = frame.speed[i];
  const double accel = frame.accel[i];
  TripRow& row = trip->row;
  row.route_length += speed * dt;

  const bool waits = speed < params_.halting_speed && !frame.planned_stop[i];
  if (waits) {
    row.waiting_time += dt;
    if (!trip->waiting) ++row.waiting_count;
  }
  trip->waiting = waits;
  if (frame.planned_stop[i]) {
    row.stop_time += dt;
  } else if (frame.allowed_speed[i] > 0.0) {
    row.time_loss += dt * (1.0 - std::min(speed, frame.allowed_speed[i]) / frame.allowed_speed[i]);
  }
  if (!frame.planned_stop[i]) {
    trip->speeds += speed;
    trip->speed_squares += speed * speed;
    ++trip->moving_steps;
  }

  RaiseTo(std::max(0.0, accel), &row.max_accel);
  RaiseTo(std::max(0.0, -accel), &row.max_decel);
  RaiseTo(std::abs(frame.lateral_accel[i]), &row.max_lateral_accel);
  const bool brakes_hard = accel < -params_.hard_braking;
  if (brakes_hard && !trip->braking_hard) ++row.hard_braking_count;
  trip->braking_hard = brakes_hard;
  if (row.steps > 0) {
    const double jerk = (accel - trip->last_accel) / dt;
    RaiseTo(std::abs(jerk), &row.max_jerk);
    trip->jerk_squares += jerk * jerk;
    ++trip->jerks;
  }
  trip->last_accel = accel;

  row.co2 += frame.co2_rate[i] * dt;
  row.nox += frame.nox_rate[i] * dt;
  row.pmx += frame.pmx_rate[i] * dt;
  row.fuel += frame.fuel_rate[i] * dt;
  row.electricity += frame.electricity_rate[i] * dt;
  ++row.steps;
  if (frame.agent_driven[i]) ++row.agent_steps;
}

TripRow TripRecorder::Finish(std::int32_t vehicle_number, double time, TripEnd end) {
  const auto number = static_cast<std::size_t>(vehicle_number);
  LANEWISE_CHECK(number < slot_of_.size() && slot_of_[number] != kNone);
  const Trip& trip = trips_[static_cast<std::size_t>(slot_of_[number])];
  TripRow row = trip.row;
  row.end = end;
  if (end == TripEnd::kArrived) row.arrival = time;
  row.duration = time - row.depart;
  if (trip.jerks > 0) row.rms_jerk = std::sqrt(trip.jerk_squares / static_cast<double>(trip.jerks));
  if (trip.moving_steps > 0) {
    const auto steps = static_cast<double>(trip.moving_steps);
    const double mean = trip.speeds / steps;
    row.speed_variance = std::max(0.0, trip.speed_squares / steps - mean * mean);
  }
  free_slots_.push_back(slot_of_[number]);
  slot_of_[number] = kNone;
  return row;
}

std::vector<std::int32_t> TripRecorder::UnderWay() const {
  std::vector<std::int32_t> numbers;
  for (std::size_t number = 0; number < slot_of_.size(); ++number) {
    if (slot_of_[number] != kNone) numbers.push_back(static_cast<std::int32_t>(number));
  }
  return numbers;
}

}  // namespace lanewise
