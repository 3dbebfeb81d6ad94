#include "agents/v2x/v2x_level.h"

#include <fmt/ranges.h>

#include "agents/core/check.h"

namespace lanewise {

V2xLevel ParseV2xLevel(std::string_view name, std::string_view origin) {
  for (std::size_t i = 0; i < std::size(kV2xLevelNames); ++i) {
    if (kV2xLevelNames[i] == name) return static_cast<V2xLevel>(i);
  }
  throw ConfigError(
      fmt::format("{}: unknown level '{}'; allowed: {}", origin, name, fmt::join(kV2xLevelNames, ", ")));
}

void CheckV2xParams(const V2xParams& p) {
  const auto at_most = [](const char* name, double value, const char* other, double limit, const char* unit) {
    if (value > limit) {
      throw ConfigError(fmt::format("parameter '{}' is {} {}; allowed: at most {}, {} {}", name, value, unit,
                                    other, limit, unit));
    }
  };
  at_most("v2x.latency_min", p.latency_min, "v2x.latency_mean", p.latency_mean, "s");
  at_most("v2x.latency_mean", p.latency_mean, "v2x.latency_max", p.latency_max, "s");
  at_most("v2x.latency_max", p.latency_max, "v2x.memory", p.memory, "s");
  at_most("v2x.cam_min_interval", p.cam_min_interval, "v2x.cam_max_interval", p.cam_max_interval, "s");
  at_most("v2x.cruise_max_age", p.cruise_max_age, "v2x.memory", p.memory, "s");
  at_most("v2x.cruise_reaction", p.cruise_reaction, "v2x.cruise_gap", p.cruise_gap, "s");
  at_most("v2x.range", p.range, "v2x.carrier_sense_range", p.carrier_sense_range, "m");
}

}  // namespace lanewise
