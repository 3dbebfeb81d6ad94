#pragma once

#include <array>
#include <cstdint>
#include <string_view>
#include <vector>

#include "agents/core/geometry.h"
#include "agents/vehicle/vehicle_params.h"

namespace lanewise {

/// The kinds of fields of the papers' drives ([A]: tables, chairs, walls, doors, boxes, a corridor; [C]:
/// parked vehicles, a pedestrian who crosses).
enum class FieldKind : std::uint8_t { kWalls, kBoxes, kFurniture, kCorridor, kParkedCars, kPedestrian };
inline constexpr int kFieldKinds = 6;
inline constexpr std::array<std::string_view, kFieldKinds> kFieldKindNames{
    "walls", "boxes", "table_and_chairs", "corridor", "parked_cars", "pedestrian"};

/// Road frame of the arena: x is s [m] along the road, y is d [m] to the left of its middle.
struct ArenaRoad {
  double length{300.0};
  double half_width{6.0};
  double start{10.0};  ///< [m] s of the front bumper at the start.
  double goal{285.0};  ///< [m] s at which a drive has succeeded.
};

/// A person who stands off the road, then crosses it at a constant speed, whatever the vehicle does.
struct CrossingPerson {
  Point2 from;        ///< [m] middle at first.
  double speed;       ///< [m/s]
  double direction;   ///< +1 to the left, -1 to the right.
  double start_time;  ///< [s]
};

struct ArenaField {
  std::vector<Footprint> things;
  std::vector<CrossingPerson> persons;
};

/// A field; a function of kind, seed and number.
ArenaField MakeField(FieldKind kind, std::uint64_t seed, std::int64_t number, const ArenaRoad& road);

/// Is there a way for the vehicle's outline from the start to the goal, with `clearance` [m] to everything
/// that stands and to the borders? Decided on its own, by no planner's code: the set of all positions
/// reachable by the rear axle of a bicycle with the given turning radius, over a lattice in (s, d, heading)
/// whose motions meet lattice points exactly. Blocked positions of the outline are computed in closed form
/// (separating axes).
/// @param turning_radius [m] of the rear axle's middle; rounded to the lattice.
bool IsPassable(const ArenaField& field, const ArenaRoad& road, const VehicleParams& vehicle,
                double clearance);

}  // namespace lanewise
