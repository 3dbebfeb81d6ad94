#pragma once

#include <string>

#include "agents/network/road_network.h"

namespace lanewise {

/// Builds a network of edges by hand; no files, no shapes.
class NetBuilder {
 public:
  NetBuilder& AddEdge(const std::string& id, int lane_count, double length) {
    network.edges.push_back(
        {.id = id, .first_lane = static_cast<LaneIndex>(network.lanes.size()), .lane_count = lane_count});
    for (int i = 0; i < lane_count; ++i) {
      Lane lane;
      lane.id = id + "_" + std::to_string(i);
      lane.edge = static_cast<EdgeIndex>(network.edges.size()) - 1;
      lane.index = i;
      lane.length = length;
      network.lane_by_id[lane.id] = static_cast<LaneIndex>(network.lanes.size());
      network.lanes.push_back(lane);
    }
    return *this;
  }

  NetBuilder& Connect(const std::string& from, const std::string& to, const std::string& via = "") {
    Connection connection{.from = network.FindLane(from), .to = network.FindLane(to)};
    if (!via.empty()) connection.via = network.FindLane(via);
    network.lanes[connection.from].outgoing.push_back(static_cast<std::int32_t>(network.connections.size()));
    network.connections.push_back(connection);
    return *this;
  }

  Lane& At(const std::string& id) { return network.lanes[network.FindLane(id)]; }

  RoadNetwork network;
};

}  // namespace lanewise
