#include "analysis/platoon_response.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include "agents/agent_pipeline.h"
#include "agents/core/check.h"
#include "agents/core/random.h"

namespace lanewise {
namespace {

constexpr double kRampTime = 20.0;    // [s] in which the swing grows.
constexpr double kLeastTime = 120.0;  // [s]
constexpr double kFast = 50.0;        // [m/s] the road's limit: nobody is held by it.

RoadNetwork StraightRoad(double length) {
  RoadNetwork network;
  Lane lane;
  lane.id = "road_0";
  lane.edge = 0;
  lane.speed_limit = kFast;
  lane.length = length;
  lane.shape = {{0.0, 0.0}, {length, 0.0}};
  network.lanes.push_back(lane);
  Edge edge;
  edge.id = "road";
  edge.first_lane = 0;
  edge.lane_count = 1;
  network.edges.push_back(edge);
  network.lane_by_id["road_0"] = 0;
  network.edge_by_id["road"] = 0;
  return network;
}

/// The leader's motion; it is scripted, and tells what it does as an agent would.
struct Swing {
  double speed, amplitude, omega;

  double Envelope(double t) const { return amplitude * std::min(1.0, t / kRampTime); }
  double SpeedAt(double t) const { return speed + Envelope(t) * std::sin(omega * t); }
};

void FillRow(const Traffic& traffic, std::size_t row, double s, double speed, Motion* motion) {
  motion->lane[row] = 0;
  motion->s[row] = motion->x[row] = s;
  motion->speed[row] = motion->speed_ref[row] = speed;
  motion->time_gap[row] = traffic.params[row].time_gap;
  motion->since_change[row] = 100.0f;
  motion->yielded_to[row] = motion->follows[row] = kNone;
}

/// Amplitude of a signal at a frequency, over whole periods of it.
double AmplitudeAt(const std::vector<double>& signal, std::size_t first, double step_angle) {
  double mean = 0.0;
  const auto count = static_cast<double>(signal.size() - first);
  for (std::size_t k = first; k < signal.size(); ++k) mean += signal[k] / count;
  std::complex<double> sum;
  for (std::size_t k = first; k < signal.size(); ++k)
    sum += (signal[k] - mean) * std::polar(1.0, -step_angle * static_cast<double>(k));
  return 2.0 * std::abs(sum) / count;
}

}  // namespace

PlatoonResponse DrivePlatoon(const AgentParams& params, const PlatoonTrial& trial, double frequency) {
  const double dt = trial.step_length, omega = 2.0 * std::numbers::pi * frequency;
  const auto period = static_cast<std::size_t>(std::lround(1.0 / (frequency * dt)));
  LANEWISE_CHECK(std::abs(static_cast<double>(period) * dt * frequency - 1.0) < 1e-9);
  const std::size_t half_swings =
      std::max<std::size_t>(static_cast<std::size_t>(trial.swings + 1) / 2,
                            static_cast<std::size_t>(std::ceil(kLeastTime / 2.0 * frequency)));
  const std::size_t steps = 2 * half_swings * period, first = half_swings * period;
  const auto cars = static_cast<std::size_t>(trial.cars);

  Traffic traffic;
  traffic.vehicle_count = cars + 1;
  traffic.Resize(cars + 1);
  const VehicleParams car;
  const double spacing = car.length + car.min_gap + params.v2x.cruise_gap * trial.speed;
  const double start = spacing * static_cast<double>(cars) + 10.0;
  const RoadNetwork network =
      StraightRoad(start + (trial.speed + trial.max_swing) * static_cast<double>(steps) * dt + 500.0);
  const std::vector<LaneCurve> curves = FitLaneCurves(network, {});
  const RoutePlan plan(network, {0}, VehicleClassBit("passenger"));
  for (std::size_t row = 0; row <= cars; ++row) {
    traffic.number[row] = static_cast<std::int32_t>(row);
    traffic.id_hash[row] = HashText(std::to_string(row));
    traffic.vehicle_class[row] = VehicleClassBit("passenger");
    traffic.policy[row] = Policy::kDwa;
    traffic.params[row] = car;
    traffic.plan[row] = &plan;
    traffic.driven[row] = row > 0;
    traffic.stop_distance[row] = 1e9;
    traffic.stop_lane[row] = kNone;
    traffic.speed_limit[row] = kFast;
    for (Motion* motion : {&traffic.now, &traffic.next})
      FillRow(traffic, row, start - spacing * static_cast<double>(row), trial.speed, motion);
  }
  AgentPipeline pipeline(network, curves, params);
  pipeline.channel().Open(trial.level, trial.seed);
  const std::vector<std::uint8_t> guarded(cars + 1, 0);
  Commands commands;

  PlatoonResponse response;
  response.frequency = frequency;
  response.speed.resize(cars + 1);
  response.time_gap.resize(cars);
  response.least_gap = 1e9;
  const Swing swing{trial.speed, std::min(trial.max_swing, trial.max_accel / omega), omega};
  double leader_s = start, accel = 0.0;
  for (std::size_t k = 0; k < steps; ++k) {
    const double t = static_cast<double>(k) * dt, speed = swing.SpeedAt(t);
    Motion& now = traffic.now;
    now.s[0] = now.x[0] = leader_s;
    now.speed[0] = speed;
    now.accel[0] = now.planned_accel[0] = accel;  // Of the step that has just ended.
    const double next_accel = (swing.SpeedAt(t + dt) - speed) / dt;
    now.planned_jerk[0] = (next_accel - accel) / dt;
    pipeline.UpdatePoses(&traffic);
    response.time.push_back(t);
    for (std::size_t row = 0; row <= cars; ++row) response.speed[row].push_back(now.speed[row]);
    for (std::size_t row = 1; row <= cars; ++row) {
      const double gap = now.s[row - 1] - car.length - now.s[row];
      if (k < first) continue;
      response.least_gap = std::min(response.least_gap, gap);
      response.time_gap[row - 1] +=
          (gap - car.min_gap) / std::max(0.1, now.speed[row]) / static_cast<double>(steps - first);
      response.cruise_share += (now.follows[row] != kNone) / static_cast<double>((steps - first) * cars);
    }
    pipeline.Step(dt, guarded, &traffic, &commands);
    std::swap(traffic.now, traffic.next);
    leader_s += 0.5 * (speed + swing.SpeedAt(t + dt)) * dt;
    accel = next_accel;
  }
  for (const std::vector<double>& speed : response.speed)
    response.amplitude.push_back(AmplitudeAt(speed, first, omega * dt));
  for (std::size_t row = 1; row <= cars; ++row)
    response.gain.push_back(response.amplitude[row] / response.amplitude[row - 1]);
  return response;
}

}  // namespace lanewise
