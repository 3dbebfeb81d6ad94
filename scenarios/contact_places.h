#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "agents/network/road_network.h"

namespace lanewise {

/// Where vehicles touched with an agent striking: a pair of lanes, those on which the two fronts were.
struct ContactPlace {
  std::string first_lane, second_lane;
  int contacts{0};
  double max_depth{0.0};      ///< [m] of the deepest.
  double lane_distance{1e9};  ///< [m] between the lanes' centre lines at the least; 1e9 for one off the road.
  double bodies_width{0.0};   ///< [m] half the widths of the two bodies together, the largest.
  bool right_of_way{false};   ///< One follows the other, or the network says who goes first.
  /// Do the network's own shapes overlap: would two on the centre lines touch, with nobody told to yield?
  bool shapes_overlap() const { return lane_distance < bodies_width && !right_of_way; }
};

/// Contacts of a run with an agent striking and a vehicle struck, by place; the most frequent first.
/// @throws SQLite::Exception
std::vector<ContactPlace> FindContactPlaces(const std::filesystem::path& results, std::int64_t run_id,
                                            const RoadNetwork& network);

}  // namespace lanewise
