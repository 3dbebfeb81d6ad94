#pragma once

#include <algorithm>

namespace lanewise {

/// Gains and limits of a PID controller, U = Kp e + Ki sum(e) dt + Kd de/dt ([C]).
struct PidGains {
  double kp{1.0};
  double ki{0.0};
  double kd{0.0};
  double derivative_filter{0.1};  ///< [s] time constant of the low-pass on de/dt; 0 = unfiltered.
  double output_limit{1e9};       ///< |U| is clamped to this; the integral does not wind up beyond it.
};

/// What the controller remembers.
struct PidState {
  double integral{0.0};    ///< sum(e) dt.
  double derivative{0.0};  ///< Filtered de/dt.
  double last_error{0.0};
  bool started{false};  ///< The first error has no derivative.
};

/// One control period. Anti-windup by conditional integration: the integral stands still while the
/// output is saturated and the error would drive it further.
inline double StepPid(const PidGains& gains, double error, double dt, PidState* state) {
  const double raw_derivative = state->started ? (error - state->last_error) / dt : 0.0;
  const double blend = dt / (gains.derivative_filter + dt);
  state->derivative += blend * (raw_derivative - state->derivative);
  state->last_error = error;
  state->started = true;

  const double integral = state->integral + error * dt;
  const double wanted = gains.kp * error + gains.ki * integral + gains.kd * state->derivative;
  const double output = std::clamp(wanted, -gains.output_limit, gains.output_limit);
  if (output == wanted || (wanted > 0.0) != (error > 0.0)) state->integral = integral;
  return output;
}

}  // namespace lanewise
