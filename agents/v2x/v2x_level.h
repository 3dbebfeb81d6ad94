#pragma once

#include <cstdint>
#include <string_view>

#include "agents/agent_params.h"

namespace lanewise {

/// How much of a radio channel there is; each level adds to the one before it.
enum class V2xLevel : std::uint8_t {
  kOff,     ///< No messages.
  kIdeal,   ///< Everybody hears everybody at once.
  kRange,   ///< Within v2x.range.
  kLossy,   ///< Latency, loss by distance, noise of the positions.
  kLoaded,  ///< Loss by the load of the channel.
};
inline constexpr std::string_view kV2xLevelNames[] = {"off", "ideal", "range", "lossy", "loaded"};

/// @throws ConfigError naming `origin` and the levels there are.
V2xLevel ParseV2xLevel(std::string_view name, std::string_view origin);

/// Relations between parameters that their ranges cannot tell. @throws ConfigError naming the parameter.
void CheckV2xParams(const V2xParams& params);

}  // namespace lanewise
