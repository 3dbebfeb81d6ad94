#pragma once

#include <cstdint>
#include <span>
#include <unordered_map>
#include <vector>

#include "agents/coordination/coordination_params.h"
#include "agents/coordination/roadside.h"
#include "agents/network/road_network.h"
#include "agents/traffic.h"
#include "agents/v2x/channel.h"

namespace lanewise {

/// Edges joined by their connections, as far as a vehicle class may drive.
class EdgeGraph {
 public:
  explicit EdgeGraph(const RoadNetwork& network);

  /// The fastest way from edge `from` to edge `to`, both included, by `seconds` an edge; empty if there is
  /// none. Of equally fast ways always the same one (Dijkstra 1959).
  std::vector<EdgeIndex> FastestRoute(EdgeIndex from, EdgeIndex to, VehicleClassMask vehicle_class,
                                      std::span<const double> seconds) const;

 private:
  struct Link {
    EdgeIndex to;
    VehicleClassMask allowed;
  };
  std::vector<std::vector<Link>> links_;  // By edge.
};

/// Which edges are crowded: slow and dense. An edge stays crowded until it is clearly faster again.
class CongestionWatch {
 public:
  CongestionWatch(const RoadNetwork& network, const DispatchParams& params);

  /// A vehicle was on `edge` at `speed` [m/s] in a look.
  void See(EdgeIndex edge, double speed);
  /// A look at all edges is complete.
  void EndLook() { ++looks_; }
  /// Judges the edges by the looks since the last call.
  void Judge();

  bool IsCrowded(EdgeIndex edge) const { return crowded_[static_cast<std::size_t>(edge)] != 0; }
  /// [s] to drive along each edge.
  std::span<const double> seconds() const { return seconds_; }
  /// Share of the edges with vehicles that are crowded.
  double crowded_share() const { return crowded_share_; }

 private:
  struct Seen {
    double speed_sum{0.0};  // [m/s]
    std::int64_t count{0};
  };

  const RoadNetwork& network_;
  DispatchParams params_;
  std::vector<Seen> seen_;  // By edge, as all of these.
  std::vector<std::uint8_t> crowded_;
  std::vector<double> seconds_;
  std::int64_t looks_{0};
  double crowded_share_{0.0};
};

/// Hears from the roadside units where vehicles are, advises some of them other routes around crowded edges,
/// and holds back those that are about to depart into a crowd.
class Dispatcher {
 public:
  struct Reroute {
    std::size_t row;
    std::vector<EdgeIndex> route;  ///< From the edge the vehicle is on.
    double gain;                   ///< [s] expected.
  };

  Dispatcher(const RoadNetwork& network, const CoordinationParams& params, std::uint64_t seed);

  /// After an Exchange. `may_hold` by row: it stands where it departed. The answers hold until the next call.
  void Step(double time, const Traffic& traffic, std::span<const std::uint8_t> may_hold,
            const Roadside& roadside, const Channel& channel);
  std::span<const Reroute> reroutes() const { return reroutes_; }
  std::span<const std::size_t> holds() const { return holds_; }  ///< Rows to hold.
  /// Running numbers of vehicles that may go.
  std::span<const std::int32_t> releases() const { return releases_; }
  double max_hold() const { return params_.max_hold; }  ///< [s]

 private:
  void Look(const Roadside& roadside, const Channel& channel);
  void AdviseRoutes(double time, const Traffic& traffic, const Roadside& roadside, const Channel& channel);
  bool IsReached(const Roadside& roadside, const Channel& channel, std::int32_t number) const;
  bool FollowsAdvice(const Traffic& traffic, std::size_t row) const;

  const RoadNetwork& network_;
  DispatchParams params_;
  std::uint64_t seed_;
  EdgeGraph graph_;
  CongestionWatch watch_;
  double next_look_{0.0}, next_judgement_{0.0};          // [s]
  std::unordered_map<StationId, const Message*> heard_;  // Of one look.
  std::unordered_map<std::int32_t, double> advised_;     // [s] By vehicle number: when last.
  std::vector<std::pair<std::int32_t, double>> held_;    // Vehicle number, since when [s].
  std::vector<Reroute> reroutes_;
  std::vector<std::size_t> holds_;
  std::vector<std::int32_t> releases_;
};

}  // namespace lanewise
