#pragma once

#include <vector>

#include "agents/control/pid.h"

namespace lanewise {

/// The car a speed controller is tried on: a powertrain that follows its command late and with a first-order
/// lag, on a slope it does not know of.
///   a' = (u(t - delay) - a) / lag,  v' = a + disturbance from the slope's beginning on
struct SpeedPlant {
  double lag{1.0};           ///< [s] of the powertrain and the brakes; > 0.
  double delay{0.0};         ///< [s] until a command begins to act; >= 0.
  double disturbance{-0.5};  ///< [m/s^2] of the slope: -0.5 is about 5 % uphill.
  double slope_begin{30.0};  ///< [s]
};

/// A change of the wanted speed at time 0; the car drives steadily before.
struct SpeedStep {
  double from{60.0 / 3.6};  ///< [m/s] [C]'s example: 60 to 50 km/h.
  double to{50.0 / 3.6};    ///< [m/s]
  double duration{60.0};    ///< [s] simulated.
  double dt{0.02};          ///< [s] control period.
};

/// What a controller makes of a step. Row k is at time k dt, before the controller's k-th command.
struct SpeedResponse {
  std::vector<double> time;     ///< [s]
  std::vector<double> speed;    ///< [m/s]
  std::vector<double> command;  ///< [m/s^2] held from this row on.
};

/// Drives the plant with StepPid, the agents' own controller. Between commands the plant is integrated in
/// closed form, so that the control period is the only discretisation.
SpeedResponse SimulateSpeedStep(const PidGains& gains, const SpeedPlant& plant, const SpeedStep& step);

/// The response a designer asks for: of a second-order system.
struct WantedResponse {
  double settling_time{6.0};  ///< [s] until it stays within 2 % of the step.
  double overshoot{0.0};      ///< [-] of the step, in [0, 0.9].
  /// [s] what a command of 1 m/s^2 more than it takes to hold the speed counts, in m/s of deviation. With 0,
  /// gains without bound are best: they keep every disturbance away.
  double effort_weight{0.5};
};

/// The wanted speed response [m/s], sampled as the simulation is. Damping follows from the overshoot,
/// M = exp(-pi zeta / sqrt(1 - zeta^2)); the frequency from 5.834 = w t for critical damping (the root of
/// (1 + x) exp(-x) = 0.02), and from the envelope, exp(-zeta w t) = 0.02 sqrt(1 - zeta^2), below it.
std::vector<double> WantedSpeeds(const WantedResponse& wanted, const SpeedStep& step);

/// How a response is judged: the step until the slope begins, and what stays at the end.
struct ResponseScore {
  double overshoot{0.0};        ///< [m/s] beyond the wanted speed.
  int crossings{0};             ///< Of the wanted speed, from beyond 1 % of the step to beyond it again.
  double settling_time{0.0};    ///< [s] until it stays within 2 % of the step; -1: not before the slope.
  double offset{0.0};           ///< [m/s] wanted minus mean speed over the last tenth.
  double swing{0.0};            ///< [m/s] highest minus lowest speed over the last tenth.
  double largest_command{0.0};  ///< [m/s^2]
};
ResponseScore ScoreResponse(const SpeedResponse& response, const SpeedPlant& plant, const SpeedStep& step);

/// Gains found for a wanted response.
struct PidFit {
  PidGains gains;
  double rms_error{0.0};          ///< [m/s] between the response and the wanted one.
  double start_rms_error{0.0};    ///< [m/s] with the gains the search began from.
  int starts{0}, evaluations{0};  ///< Searches begun at different gains; simulations.
  bool converged{false};
};

/// Least squares (Ceres) over kp, ki and kd, all >= 0 and at most `max_gain`: deviations from the wanted
/// response, which count the more the longer after the step or the slope's beginning they stay (after the
/// ITAE criterion, Graham and Lathrop 1953), and the effort. Filter and limit are kept as they are in
/// `gains`. Searches begin at `gains` and at a fixed set of others; the best one counts.
PidFit FitPid(const PidGains& gains, const SpeedPlant& plant, const SpeedStep& step,
              const WantedResponse& wanted, double max_gain = 50.0);

}  // namespace lanewise
