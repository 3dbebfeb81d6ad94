#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace lanewise {

/// A vehicle that wants to pass a junction.
struct Arrival {
  double distance{0.0};   ///< [m] from its front to the stop line, > 0.
  double speed{0.0};      ///< [m/s] now.
  double limit{13.9};     ///< [m/s] on the way there.
  double crossing{13.9};  ///< [m/s] with which it passes the junction if it can; at most the limit.
  double earliest{0.0};   ///< [s] from now at which it could be there.
};

/// Vehicle `second` arrives at least `time` [s] after `first`; both index the arrivals, first < second.
struct Separation {
  std::int32_t first{0}, second{0};
  double time{0.0};
};

/// [m/s^2] with which vehicles speed up again to pass a junction.
inline constexpr double kCrossingAccel = 1.5;

/// Arrival times [s] from now, of all vehicles together. A profile is one speed u, held until a vehicle slower
/// than its crossing speed v has to speed up to it; compared with driving at the limit it takes longer by
/// (s - r) / u + (v - u) / a - s / limit, with the run-up r = (v^2 - u^2) / (2 a), or, from v on, by
/// s / u - s / limit. The speeds solve a bounded least-squares problem (Ceres) of delays, changes of speed,
/// and what each separation lacks; arrivals are then moved back in the given order until all separations hold.
std::vector<double> PlanArrivals(std::span<const Arrival> arrivals, std::span<const Separation> separations);

/// Speed [m/s] to approach with for passing the stop line, `distance` [m] ahead, in `time` [s], as near to
/// `crossing` as there is room to speed up to.
double SpeedToPass(double distance, double time, double limit, double crossing);

}  // namespace lanewise
