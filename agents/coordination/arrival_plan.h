#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace lanewise {

/// A vehicle on its way to a stop line. Its speed profile: from its present speed to a cruising speed, and in
/// time from that one to the speed with which it passes the line.
struct Arrival {
  double distance{0.0};    ///< [m] from its front to the stop line, > 0.
  double speed{0.0};       ///< [m/s] now.
  double limit{13.9};      ///< [m/s] on the way there.
  double crossing{13.9};   ///< [m/s] with which it passes the line if it can; at most the limit.
  double not_before{0.0};  ///< [s] from now.
};

/// Vehicle `second` arrives at least `time` [s] after `first`; both index the arrivals, first < second.
struct Separation {
  std::int32_t first{0}, second{0};
  double time{0.0};
};

/// [m/s^2] with which vehicles speed up and slow down for their profiles.
inline constexpr double kProfileAccel = 1.5, kProfileDecel = 3.0;

/// Speed [m/s] with which it passes the line if it gets there as soon as it can: `crossing`, as far as there
/// is room to come to it.
double LineSpeed(const Arrival& arrival);
/// [s] to the line cruising as fast as it may.
double EarliestArrival(const Arrival& arrival);
/// Cruising speed [m/s] that brings it to the line in `time` [s]. If it would be there earlier with every one
/// from which it can come to its crossing speed, it passes the line with less.
double CruiseToArrive(const Arrival& arrival, double time);

/// Each as early as those before it in the list let it.
std::vector<double> FirstTimes(std::span<const Arrival> arrivals, std::span<const Separation> separations);

/// Arrival times [s] from now, of all vehicles together: their cruising speeds, within what the road and the
/// run-up to the crossing speed allow, solve a least-squares problem (Ceres) of delays, changes of speed, and
/// what separations lack. Whoever is still too early then is moved back.
std::vector<double> PlanArrivals(std::span<const Arrival> arrivals, std::span<const Separation> separations);

}  // namespace lanewise
