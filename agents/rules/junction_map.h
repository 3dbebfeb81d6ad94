#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "agents/core/types.h"
#include "agents/network/lane_curve.h"
#include "agents/network/road_network.h"

namespace lanewise {

/// Where the paths of two links of a junction come so near that vehicles on both would touch. Positions [m]
/// count along each link from its stop line.
struct ConflictArea {
  std::int32_t foe{kNone};         ///< Index of the other link.
  float begin{0}, end{0};          ///< On this link.
  float foe_begin{0}, foe_end{0};  ///< On the other one.
  bool merges{false};              ///< Both lead to the same lane.
  bool yields{false};              ///< The net file has this link give way to the other.
  bool foe_yields{false};          ///< And the other way round.
  /// Cars pass each other here and no rule tells who goes first: only a long body that turns comes so near.
  bool only_long{false};
};

/// A way through a junction, from the stop line of a normal lane to the lane behind the junction; or a
/// pedestrian crossing, from one end to the other.
struct JunctionLink {
  std::int32_t connection{kNone};  ///< Where it begins, index in RoadNetwork::connections.
  LaneIndex from{kNone}, to{kNone};
  std::int32_t signal{kNone}, signal_link{kNone};
  char state{'M'};        ///< Without a signal; SUMO's letter.
  bool crossing{false};   ///< For pedestrians.
  bool keep_clear{true};  ///< Must not be entered without room behind it.
  bool turns{false};      ///< By so much that a long body swings wide.
  float length{0.0f};     ///< [m] through the junction.
  float wait_at{0.0f};    ///< [m] where one may wait inside the junction; 0: nowhere.
  float speed{13.9f};     ///< [m/s] mean of what its bends and limits allow.
  std::uint32_t first_area{0}, area_count{0};
};

/// [m] above which a body swings out of its path in a turn.
inline constexpr double kSwingingBody = 8.0;

/// Does a vehicle of this length [m] swing so wide on the link that it meets those of
/// ConflictArea::only_long?
inline bool SwingsWide(const JunctionLink& link, double length) {
  return link.turns && length > kSwingingBody;
}

/// Geometry of all junctions: links and the areas where they conflict. Immutable after construction.
class JunctionMap {
 public:
  JunctionMap(const RoadNetwork& network, const std::vector<LaneCurve>& curves);

  std::span<const JunctionLink> links() const { return links_; }
  std::span<const ConflictArea> Areas(const JunctionLink& link) const {
    return {areas_.data() + link.first_area, link.area_count};
  }
  /// Link that begins with a connection, or kNone.
  std::int32_t LinkOfConnection(std::int32_t connection) const { return link_of_connection_[connection]; }
  /// Link an internal lane belongs to, or kNone, and where on the link the lane begins [m].
  std::int32_t LinkOfLane(LaneIndex lane) const { return link_of_lane_[lane]; }
  float OffsetOfLane(LaneIndex lane) const { return offset_of_lane_[lane]; }
  /// Indices of the links that are crossings.
  std::span<const std::int32_t> crossings() const { return crossings_; }

 private:
  std::vector<JunctionLink> links_;
  std::vector<ConflictArea> areas_;
  std::vector<std::int32_t> link_of_connection_, link_of_lane_, crossings_;
  std::vector<float> offset_of_lane_;
};

}  // namespace lanewise
