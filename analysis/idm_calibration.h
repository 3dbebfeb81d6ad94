#pragma once

#include <array>
#include <functional>
#include <span>
#include <string_view>

#include "analysis/following_data.h"

namespace lanewise {

/// The Intelligent Driver Model's parameters, in this order: wanted speed v0 [m/s], time gap T [s],
/// standstill gap s0 [m], acceleration a [m/s^2], comfortable deceleration b [m/s^2] (Treiber, Hennecke,
/// Helbing 2000).
inline constexpr int kIdmParams = 5;
using IdmValues = std::array<double, kIdmParams>;

struct IdmParamInfo {
  std::string_view name, unit, meaning;
  double start, min, max;
};
inline constexpr std::array<IdmParamInfo, kIdmParams> kIdmParamInfo{
    {{"v0", "m/s", "wanted speed", 15.0, 1.0, 70.0},
     {"T", "s", "time gap", 1.5, 0.1, 5.0},
     {"s0", "m", "standstill gap", 2.0, 0.1, 10.0},
     {"a", "m/s^2", "acceleration", 1.5, 0.1, 6.0},
     {"b", "m/s^2", "comfortable deceleration", 2.0, 0.1, 9.0}}};

/// Drives the follower of an episode with the IDM from its first row on, behind the recorded leader: the
/// gaps [m] at the episode's times. Rows are cut into steps of at most 0.2 s, integrated to second order
/// (Heun), so that neither the rows' interval nor a simulator's step is taken for a driver's property. The
/// leader's way between rows is the one the recorded gaps and speeds give. `gap` has the episode's length.
void SimulateIdmGaps(const FollowingEpisode& episode, const IdmValues& values, std::span<double> gap);

struct IdmFitOptions {
  std::array<bool, kIdmParams> fixed{};  ///< Keep these at `start`.
  IdmValues start{kIdmParamInfo[0].start, kIdmParamInfo[1].start, kIdmParamInfo[2].start,
                  kIdmParamInfo[3].start, kIdmParamInfo[4].start};
  int max_iterations{200};
  /// Called after each iteration of each search; may be empty.
  std::function<void(int iteration, double rms_error)> progress{};
};

enum class IdmParamState {
  kFree,
  kFixed,
  kAtBound,       ///< The search was stopped by the allowed range: no confidence is given.
  kUndetermined,  ///< The data do not tell it apart from others: no confidence is given.
};

struct IdmFit {
  IdmValues values{};
  std::array<IdmParamState, kIdmParams> state{};
  /// Standard errors that allow for residuals of one vehicle that belong together (sandwich estimate
  /// A^-1 B A^-1 with vehicles as clusters, Liang and Zeger 1986). 0 without at least two vehicles.
  IdmValues error{};
  IdmValues half_width{};  ///< Of the 95 % interval: Student's t, vehicles - 1 degrees of freedom.
  /// Standard errors if all residuals were independent, sigma^2 (J^T J)^-1: too small, for those of one
  /// simulation are not.
  IdmValues independent_error{};
  std::array<IdmValues, kIdmParams> correlation{};  ///< Of the estimates, by `error` if there is one.
  double rms_error{0.0}, start_rms_error{0.0};      ///< [m] of the gap.
  double mean_error{0.0};                           ///< [m] simulated minus recorded.
  int vehicles{0}, iterations{0};
  std::size_t episodes{0}, rows{0};
  bool converged{false};
};

/// Least squares of the gaps (Ceres, Levenberg-Marquardt within the allowed ranges), after Kesting and
/// Treiber 2008 and Punzo and Montanino 2016: gaps of whole simulated episodes, not accelerations. Begins at
/// `start` and at a fixed set of others; the best one counts. @throws ConfigError without episodes.
IdmFit FitIdm(std::span<const FollowingEpisode* const> episodes, const IdmFitOptions& options);

/// [m] root mean square of simulated minus recorded gaps.
double GapRmsError(std::span<const FollowingEpisode* const> episodes, const IdmValues& values);

}  // namespace lanewise
