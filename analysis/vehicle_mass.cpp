#include "analysis/vehicle_mass.h"

#include <utility>

namespace lanewise {

double TypicalMass(std::string_view vehicle_class) {
  constexpr std::pair<std::string_view, double> kMasses[] = {
      {"pedestrian", 70.0},    {"bicycle", 85.0},     {"scooter", 85.0},          {"moped", 155.0},
      {"motorcycle", 275.0},   {"emergency", 5000.0}, {"delivery", 5000.0},       {"truck", 4500.0},
      {"trailer", 13000.0},    {"bus", 12000.0},      {"coach", 25000.0},         {"tram", 37900.0},
      {"rail_urban", 59000.0}, {"rail", 79500.0},     {"rail_electric", 83000.0}, {"rail_fast", 409000.0}};
  for (const auto& [name, mass] : kMasses) {
    if (name == vehicle_class) return mass;
  }
  return 1500.0;  // Cars, and what has no default of its own.
}

}  // namespace lanewise
