#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "agents/core/types.h"

namespace lanewise {

/// Set of SUMO vehicle classes, one bit each (bit order of kVehicleClassNames).
using VehicleClassMask = std::uint64_t;
inline constexpr VehicleClassMask kAllVehicleClasses = ~VehicleClassMask{0};

/// The bit of a SUMO vehicle class name ("passenger"); 0 if the name is unknown. "ignoring" is every bit.
VehicleClassMask VehicleClassBit(std::string_view name);

/// A drivable link from one lane to another (element `connection` of the net file).
struct Connection {
  LaneIndex from{kNone};
  LaneIndex to{kNone};             ///< Target lane behind the junction (or behind this part of it).
  LaneIndex via{kNone};            ///< Internal lane that carries it; kNone if the junction has none.
  char direction{'s'};             ///< SUMO's `dir`: s straight, l/r turn, L/R partial, t turnaround.
  char state{'M'};                 ///< SUMO's `state`: M major, m minor, = equal, s stop, o off, ...
  std::int32_t signal{kNone};      ///< Index in RoadNetwork::signal_ids; kNone if unsignalised.
  std::int32_t link_index{kNone};  ///< Character in the signal's state string.
  std::int32_t junction{kNone};    ///< Index in RoadNetwork::junctions.
  std::int32_t request{kNone};  ///< Row of the junction's right-of-way matrix (links of normal lanes only).
  bool keep_clear{true};        ///< SUMO's `keepClear`: enter only with room behind the junction.
};

/// Has who takes the connection to yield, with no signal to tell when?
inline bool MustYield(const Connection& connection) {
  return connection.signal == kNone && !(connection.state >= 'A' && connection.state <= 'Z');
}

struct Lane {
  std::string id;
  EdgeIndex edge{kNone};
  std::int32_t index{0};      ///< 0 = rightmost.
  bool internal{false};       ///< Inside a junction.
  double speed_limit{13.89};  ///< [m/s]
  double length{0.0};         ///< [m] SUMO's length: positions on the lane run from 0 to this.
  double width{3.2};          ///< [m]
  VehicleClassMask allowed{kAllVehicleClasses};
  std::vector<Point2> shape;  ///< [m] center line; may be shorter or longer than length, may be empty.
  std::vector<std::int32_t> outgoing;  ///< Indices in RoadNetwork::connections, in file order.
  std::vector<std::int32_t> incoming;  ///< Likewise; for internal lanes too.
};

enum class EdgeFunction : std::uint8_t { kNormal, kInternal, kCrossing, kWalkingArea, kConnector };

struct Edge {
  std::string id;
  EdgeFunction function{EdgeFunction::kNormal};
  LaneIndex first_lane{kNone};  ///< Lanes are contiguous: first_lane .. first_lane + lane_count - 1.
  std::int32_t lane_count{0};
  std::int32_t from_junction{kNone};
  std::int32_t to_junction{kNone};
};

/// Right of way of one link of a junction; bit j belongs to link j of the same junction.
struct RightOfWay {
  std::vector<bool> response;  ///< Links this one must yield to.
  std::vector<bool> foes;      ///< Links whose paths cross this one's.
  bool cont{false};            ///< May wait inside the junction.
};

struct Junction {
  std::string id;
  std::string type;                  ///< SUMO's type: priority, traffic_light, dead_end, ...
  std::vector<LaneIndex> incoming;   ///< incLanes.
  std::vector<LaneIndex> internal;   ///< intLanes.
  std::vector<RightOfWay> requests;  ///< By link index.
};

/// The road network of a SUMO net file, as plain tables. Immutable after loading.
struct RoadNetwork {
  std::vector<Edge> edges;
  std::vector<Lane> lanes;
  std::vector<Connection> connections;
  std::vector<Junction> junctions;
  std::vector<std::string> signal_ids;
  bool left_hand{false};  ///< Traffic keeps to the left.
  std::unordered_map<std::string, LaneIndex> lane_by_id;
  std::unordered_map<std::string, EdgeIndex> edge_by_id;

  LaneIndex FindLane(const std::string& id) const;  ///< kNone if there is none.
  EdgeIndex FindEdge(const std::string& id) const;  ///< kNone if there is none.
  /// Neighbour lane of the same edge: side +1 = left, -1 = right; kNone if there is none.
  LaneIndex Neighbor(LaneIndex lane, int side) const;
};

/// Reads a SUMO net file (.net.xml or .net.xml.gz).
/// @throws ConfigError naming the file, and the element where one is at fault.
RoadNetwork LoadRoadNetwork(const std::filesystem::path& file);

}  // namespace lanewise
