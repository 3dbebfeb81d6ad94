#pragma once

#include <string_view>

namespace lanewise {

/// Typical mass [kg] of a SUMO vehicle class: SUMO's defaults (docs: Vehicle_Type_Parameter_Defaults), riders
/// of two-wheelers included with 75 kg. SUMO 1.15 does not tell a vehicle's own.
double TypicalMass(std::string_view vehicle_class);

}  // namespace lanewise
