#include "scenarios/calibrate.h"

#include <fmt/core.h>

#include <array>
#include <cmath>
#include <memory>
#include <string>

#include "agents/core/check.h"
#include "analysis/pid_calibration.h"
#include "scenarios/plot.h"

namespace lanewise {
namespace {

constexpr double kKmh = 1.0 / 3.6;  // [m/s]

void CheckRange(const char* option, double value, double min, double max) {
  if (!(value >= min && value <= max))
    throw ConfigError(fmt::format("{}: {}; allowed: {} to {}", option, value, min, max));
}

struct PidOptions {
  double from_kmh{60.0}, to_kmh{50.0};
  SpeedPlant plant;
  SpeedStep step;
  WantedResponse wanted;
  PidGains start{2.0, 0.5, 3.0, 0.0, 1e9};
  double max_gain{50.0};
  std::string plot, csv, output;
  bool force{false};
};

void Check(const PidOptions& o) {
  CheckRange("--from-kmh", o.from_kmh, 0.0, 300.0);
  CheckRange("--to-kmh", o.to_kmh, 0.0, 300.0);
  if (o.from_kmh == o.to_kmh)
    throw ConfigError(fmt::format("--to-kmh: {}; it must differ from --from-kmh", o.to_kmh));
  CheckRange("--lag", o.plant.lag, 0.01, 60.0);
  CheckRange("--delay", o.plant.delay, 0.0, 10.0);
  CheckRange("--slope", o.plant.disturbance, -5.0, 5.0);
  CheckRange("--slope-begin", o.plant.slope_begin, 0.0, 3600.0);
  CheckRange("--period", o.step.dt, 0.001, 1.0);
  CheckRange("--duration", o.step.duration, 20.0 * o.step.dt, 3600.0);
  CheckRange("--settling-time", o.wanted.settling_time, 5.0 * o.step.dt, o.step.duration);
  CheckRange("--overshoot", o.wanted.overshoot, 0.0, 0.9);
  CheckRange("--effort", o.wanted.effort_weight, 0.0, 100.0);
  CheckRange("--filter", o.start.derivative_filter, 0.0, 60.0);
  CheckRange("--limit", o.start.output_limit, 0.01, 1e9);
  CheckRange("--max-gain", o.max_gain, 0.01, 1e4);
  CheckRange("--kp", o.start.kp, 0.0, o.max_gain);
  CheckRange("--ki", o.start.ki, 0.0, o.max_gain);
  CheckRange("--kd", o.start.kd, 0.0, o.max_gain);
  CheckPlotFile("--plot", o.plot, o.force);
  CheckOutputFile("--csv", o.csv, o.force);
  CheckOutputFile("--output", o.output, o.force);
}

struct Controller {
  const char* name;
  PidGains gains;
  SpeedResponse response;
};

void PrintController(const Controller& c, const SpeedPlant& plant, const SpeedStep& step) {
  const ResponseScore score = ScoreResponse(c.response, plant, step);
  fmt::print("{:<12} {:>7.3f} {:>7.3f} {:>7.3f}  {:>9.2f} {:>9} {:>9} {:>9.3f} {:>9.3f} {:>9.2f}\n", c.name,
             c.gains.kp, c.gains.ki, c.gains.kd, score.overshoot / kKmh, score.crossings,
             score.settling_time < 0.0 ? "never" : fmt::format("{:.2f}", score.settling_time),
             score.offset / kKmh, score.swing / kKmh, score.largest_command);
}

void DrawResponses(const PidOptions& o, std::span<const Controller> controllers,
                   const std::vector<double>& wanted) {
  std::array<PlotPanel, 2> panels{
      PlotPanel{fmt::format("From {:g} to {:g} km/h, then a slope of {:g} m/s² from {:g} s on", o.from_kmh,
                            o.to_kmh, o.plant.disturbance, o.plant.slope_begin),
                "time [s]",
                "speed [km/h]",
                false,
                false,
                {}},
      PlotPanel{"Command", "time [s]", "acceleration [m/s²]", false, false, {}}};
  const auto add = [&](PlotPanel* panel, const char* name, const std::vector<double>& values, double unit,
                       bool dashed) {
    PlotLine line{name, {}, {}, dashed};
    for (std::size_t k = 0; k < values.size(); ++k) {
      line.x.push_back(static_cast<double>(k) * o.step.dt);
      line.y.push_back(values[k] / unit);
    }
    panel->lines.push_back(std::move(line));
  };
  for (const Controller& c : controllers) {
    add(&panels[0], c.name, c.response.speed, kKmh, false);
    add(&panels[1], c.name, c.response.command, 1.0, false);
  }
  add(&panels[0], "wanted response", wanted, kKmh, true);
  add(&panels[0], "set speed", std::vector<double>(wanted.size(), o.step.to), kKmh, true);
  DrawPlot(o.plot, panels);
}

std::string ResponsesCsv(std::span<const Controller> controllers, const std::vector<double>& wanted) {
  std::string text = "time_s,wanted_mps";
  for (const char* name : {"p", "pd", "pid", "fitted"})
    text += fmt::format(",{}_speed_mps,{}_command_mps2", name, name);
  text += '\n';
  for (std::size_t k = 0; k < wanted.size(); ++k) {
    text += fmt::format("{:.6g},{}", controllers[0].response.time[k], wanted[k]);
    for (const Controller& c : controllers)
      text += fmt::format(",{},{}", c.response.speed[k], c.response.command[k]);
    text += '\n';
  }
  return text;
}

int RunCalibratePid(PidOptions o) {
  o.step.from = o.from_kmh * kKmh;
  o.step.to = o.to_kmh * kKmh;
  Check(o);
  const double filter = o.start.derivative_filter, limit = o.start.output_limit;
  const PidFit fit = FitPid(o.start, o.plant, o.step, o.wanted, o.max_gain);
  const std::vector<double> wanted = WantedSpeeds(o.wanted, o.step);
  std::array<Controller, 4> controllers{{{"P", {o.start.kp, 0.0, 0.0, filter, limit}, {}},
                                         {"PD", {o.start.kp, 0.0, o.start.kd, filter, limit}, {}},
                                         {"PID", o.start, {}},
                                         {"PID, fitted", fit.gains, {}}}};
  fmt::print(
      "{:g} to {:g} km/h; powertrain with a lag of {:g} s and a delay of {:g} s; a slope of {:g} m/s^2 from "
      "{:g} "
      "s on; control period {:g} s\n\n"
      "{:<12} {:>7} {:>7} {:>7}  {:>9} {:>9} {:>9} {:>9} {:>9} {:>9}\n"
      "{:<12} {:>7} {:>7} {:>7}  {:>9} {:>9} {:>9} {:>9} {:>9} {:>9}\n",
      o.from_kmh, o.to_kmh, o.plant.lag, o.plant.delay, o.plant.disturbance, o.plant.slope_begin, o.step.dt,
      "", "kp", "ki", "kd", "overshoot", "crossings", "settled", "offset", "swing", "command", "", "[1/s]",
      "[1/s^2]", "[-]", "[km/h]", "", "[s]", "[km/h]", "[km/h]", "[m/s^2]");
  for (Controller& c : controllers) {
    c.response = SimulateSpeedStep(c.gains, o.plant, o.step);
    PrintController(c, o.plant, o.step);
  }
  fmt::print(
      "before the slope: overshoot beyond the set speed, crossings of it, settled within 2 % of the step; "
      "over the last tenth: offset and swing; command: the largest\n\n"
      "fitted to a response that settles in {:g} s with {:g} % overshoot: root mean square error {:.4f} km/h "
      "(before: {:.4f}), {} searches, {} simulations{}\n",
      o.wanted.settling_time, 100.0 * o.wanted.overshoot, fit.rms_error / kKmh, fit.start_rms_error / kKmh,
      fit.starts, fit.evaluations, fit.converged ? "" : "; NOT CONVERGED");
  if (!o.csv.empty()) WriteTextFile(o.csv, ResponsesCsv(controllers, wanted));
  if (!o.plot.empty()) DrawResponses(o, controllers, wanted);
  if (!o.output.empty()) {
    WriteTextFile(o.output, fmt::format("# lanewise {} calibrate pid: lag {:g} s, delay {:g} s, slope {:g} "
                                        "m/s^2, settling time {:g} s, overshoot {:g}, period {:g} s\n"
                                        "[control]\nspeed_kp = {:.6f}\nspeed_ki = {:.6f}\nspeed_kd = {:.6f}\n"
                                        "derivative_filter = {:.6f}\n",
                                        LANEWISE_VERSION, o.plant.lag, o.plant.delay, o.plant.disturbance,
                                        o.wanted.settling_time, o.wanted.overshoot, o.step.dt, fit.gains.kp,
                                        fit.gains.ki, fit.gains.kd, fit.gains.derivative_filter));
    fmt::print("parameters in {} (lanewise run --config {})\n", o.output, o.output);
  }
  return fit.converged ? 0 : 1;
}

void AddPid(CLI::App* calibrate, std::function<int()>* chosen) {
  const auto o = std::make_shared<PidOptions>();
  CLI::App* pid = calibrate->add_subcommand(
      "pid",
      "Speed control: what P, PD and PID make of a change of speed on a slope ([C]), and gains fitted to a "
      "wanted response");
  pid->add_option("--from-kmh", o->from_kmh, "speed before [km/h]")->capture_default_str();
  pid->add_option("--to-kmh", o->to_kmh, "set speed [km/h]")->capture_default_str();
  pid->add_option("--lag", o->plant.lag, "first-order lag of powertrain and brakes [s]")
      ->capture_default_str();
  pid->add_option("--delay", o->plant.delay, "until a command begins to act [s]")->capture_default_str();
  pid->add_option("--slope", o->plant.disturbance,
                  "acceleration by the slope, unknown to the controller [m/s^2]; -0.5 is 5 % uphill")
      ->capture_default_str();
  pid->add_option("--slope-begin", o->plant.slope_begin, "when the slope begins [s]")->capture_default_str();
  pid->add_option("--settling-time", o->wanted.settling_time,
                  "wanted: within 2 % of the step from this time on [s]")
      ->capture_default_str();
  pid->add_option("--overshoot", o->wanted.overshoot, "wanted: share of the step, 0 to 0.9")
      ->capture_default_str();
  pid->add_option(
         "--effort", o->wanted.effort_weight,
         "what 1 m/s^2 of command beyond holding the speed counts, in m/s of deviation [s]; 0: gains "
         "grow until something else bounds them")
      ->capture_default_str();
  pid->add_option("--kp", o->start.kp, "of P, PD and PID, and where the search begins")
      ->capture_default_str();
  pid->add_option("--ki", o->start.ki, "of PID, likewise")->capture_default_str();
  pid->add_option("--kd", o->start.kd, "of PD and PID, likewise")->capture_default_str();
  pid->add_option("--max-gain", o->max_gain, "no fitted gain is larger")->capture_default_str();
  pid->add_option("--filter", o->start.derivative_filter,
                  "time constant of the low-pass on the derivative [s]; 0 = none")
      ->capture_default_str();
  pid->add_option("--limit", o->start.output_limit, "of the command [m/s^2]; the integral does not wind up")
      ->capture_default_str();
  pid->add_option("--period", o->step.dt, "control period [s]")->capture_default_str();
  pid->add_option("--duration", o->step.duration, "simulated time [s]")->capture_default_str();
  pid->add_option("--plot", o->plot, "speeds and commands as .svg, .png or .pdf; needs gnuplot");
  pid->add_option("--csv", o->csv, "the same as CSV");
  pid->add_option("-o,--output", o->output,
                  "the fitted gains as parameter file (TOML) for `lanewise run --config`");
  pid->add_flag("--force", o->force, "replace output files that exist");
  pid->footer(
      "Examples:\n"
      "  lanewise calibrate pid --plot pid.svg             P oscillates, PD keeps an offset, PID removes "
      "both\n"
      "  lanewise calibrate pid --settling-time 4 --overshoot 0.05 --delay 0.2\n"
      "  lanewise calibrate pid --lag 0.15 --period 0.1 --filter 0.2 --limit 2.6 -o gains.toml   (the "
      "agents' "
      "cars)\n"
      "Exit code 1: the search for gains did not converge; what was found is printed all the same.");
  pid->callback([o, chosen] { *chosen = [o] { return RunCalibratePid(*o); }; });
}

}  // namespace

void AddCalibrateCommand(CLI::App* app, std::function<int()>* chosen) {
  CLI::App* calibrate = app->add_subcommand("calibrate", "Fit controllers and models");
  calibrate->require_subcommand(1);
  AddPid(calibrate, chosen);
  AddCalibrateIdm(calibrate, chosen);
}

}  // namespace lanewise
