#pragma once

#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "agents/agent_pipeline.h"
#include "agents/core/random.h"
#include "agents/sensing/road_view.h"

namespace lanewise {

/// Agents on a road network without SUMO: the fleet itself carries them along their lanes. For tests and
/// benchmarks.
class Fleet {
 public:
  Fleet(const RoadNetwork& network, const AgentParams& params = {}, Rules rules = Rules::kSumo)
      : network_(network),
        rules_(rules),
        params_(params),
        curves_(FitLaneCurves(network, {})),
        pipeline_(network_, curves_, params, rules) {}

  /// Adds a vehicle; `route` are edge ids, the vehicle starts on lane number `lane` of the first.
  std::size_t Add(const std::vector<std::string>& route, int lane, double s, double speed,
                  const VehicleParams& vehicle = {}, Policy policy = Policy::kDwa) {
    std::vector<EdgeIndex> edges;
    for (const std::string& id : route) edges.push_back(network_.FindEdge(id));
    plans_.push_back(std::make_unique<RoutePlan>(network_, edges, VehicleClassBit("passenger")));
    const std::size_t row = traffic.vehicle_count++;
    traffic.Resize(traffic.vehicle_count);
    traffic.number[row] = static_cast<std::int32_t>(row);
    traffic.id_hash[row] = HashText(std::to_string(row));
    traffic.vehicle_class[row] = VehicleClassBit("passenger");
    traffic.policy[row] = policy;
    traffic.params[row] = vehicle;
    AxlesAndActuators("passenger", &traffic.params[row]);
    traffic.plan[row] = plans_.back().get();
    traffic.route_position[row] = 0;
    traffic.driven[row] = 1;
    traffic.hazard[row] = 0;
    traffic.stop_distance[row] = 1e9;
    traffic.stop_lane[row] = kNone;
    Motion& now = traffic.now;
    now.lane[row] = network_.edges[edges[0]].first_lane + lane;
    now.s[row] = s;
    now.speed[row] = now.speed_ref[row] = speed;
    now.since_change[row] = 100.0f;
    now.yielded_to[row] = now.follows[row] = kNone;
    now.time_gap[row] = vehicle.time_gap;
    traffic.speed_limit[row] = network_.lanes[now.lane[row]].speed_limit;
    guarded_.push_back(rules_ == Rules::kAgent);
    pipeline_.UpdatePoses(&traffic);
    return row;
  }

  /// Adds a person who stands at (x, y), after all vehicles.
  void AddPerson(double x, double y) {
    const std::size_t row = traffic.size();
    traffic.Resize(row + 1);
    traffic.number[row] = static_cast<std::int32_t>(row);
    traffic.params[row].length = 0.2;
    traffic.params[row].width = 0.5;
    traffic.plan[row] = nullptr;
    traffic.driven[row] = 0;
    traffic.hazard[row] = 0;
    Motion& now = traffic.now;
    now.lane[row] = kNone;
    now.x[row] = x;
    now.y[row] = y;
    now.heading[row] = now.speed[row] = now.accel[row] = 0.0;
  }

  void Step(double dt) {
    pipeline_.Step(dt, guarded_, &traffic, &commands);
    for (std::size_t i = 0; i < traffic.size(); ++i) {
      if (!traffic.driven[i]) KeepRow(i);
    }
    std::swap(traffic.now, traffic.next);
    for (std::size_t i = 0; i < traffic.vehicle_count; ++i) {
      if (traffic.driven[i]) Carry(i);
    }
    pipeline_.UpdatePoses(&traffic);
  }

  const LaneCurve& curve(LaneIndex lane) const { return curves_[lane]; }
  AgentPipeline& pipeline() { return pipeline_; }

  Traffic traffic;
  Commands commands;

 private:
  void KeepRow(std::size_t i) {
    traffic.next.lane[i] = traffic.now.lane[i];
    traffic.next.s[i] = traffic.now.s[i];
    traffic.next.d[i] = traffic.now.d[i];
    traffic.next.speed[i] = traffic.now.speed[i];
    traffic.next.x[i] = traffic.now.x[i];
    traffic.next.y[i] = traffic.now.y[i];
    traffic.next.heading[i] = traffic.now.heading[i];
  }

  /// What SUMO does in a coupled run: over lane ends, and into the neighbour lane on command.
  void Carry(std::size_t i) {
    Motion& now = traffic.now;
    if (const int change = commands.change_lane[i]; change != 0) {
      const LaneIndex to = network_.Neighbor(now.lane[i], change);
      const PathPoint a = curves_[now.lane[i]].At(now.s[i]);
      now.s[i] += commands.change_shift[i];
      const PathPoint b = curves_[to].At(now.s[i]);
      const double x = a.x - now.d[i] * std::sin(a.heading), y = a.y + now.d[i] * std::cos(a.heading);
      now.d[i] = (y - b.y) * std::cos(b.heading) - (x - b.x) * std::sin(b.heading);
      now.lane[i] = to;
      now.blinker[i] = 0;
      now.since_change[i] = 0.0f;
    }
    while (now.s[i] > network_.lanes[now.lane[i]].length) {
      const LaneIndex next = NextLane(network_, *traffic.plan[i],
                                      static_cast<std::size_t>(traffic.route_position[i]), now.lane[i]);
      if (next == kNone) break;
      now.s[i] -= network_.lanes[now.lane[i]].length;
      if (!network_.lanes[next].internal) ++traffic.route_position[i];
      now.lane[i] = next;
      traffic.speed_limit[i] = network_.lanes[next].speed_limit;
    }
  }

  const RoadNetwork& network_;
  Rules rules_;
  AgentParams params_;
  std::vector<LaneCurve> curves_;
  AgentPipeline pipeline_;
  std::vector<std::unique_ptr<RoutePlan>> plans_;
  std::vector<std::uint8_t> guarded_;
};

}  // namespace lanewise
