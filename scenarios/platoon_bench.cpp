#include "scenarios/platoon_bench.h"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "agents/core/check.h"
#include "analysis/platoon_response.h"
#include "scenarios/plot.h"
#include "scenarios/run_config.h"

namespace lanewise {
namespace {

/// [m/s] below which a swing is lost in the noise of what was planned before it: no gain is told.
constexpr double kLeastSwing = 0.005;

struct PlatoonOptions {
  PlatoonTrial trial;
  std::vector<double> frequencies{0.02, 0.05, 0.1, 0.2, 0.25, 0.5};
  std::string v2x{"ideal"}, params_file, plot;
  std::vector<std::string> assignments;
  bool ordinary{false}, force{false};
};

void Check(const PlatoonOptions& o) {
  const auto range = [](const char* option, double value, double min, double max, const char* unit) {
    if (!(value >= min && value <= max))
      throw ConfigError(fmt::format("{}: {} {}; allowed: {} to {} {}", option, value, unit, min, max, unit));
  };
  range("--cars", o.trial.cars, 1, 100, "cars");
  range("--speed", o.trial.speed, 2, 40, "m/s");
  range("--step-length", o.trial.step_length, 0.01, 0.2, "s");
  for (const double frequency : o.frequencies) {
    range("--frequencies", frequency, 0.005, 2, "Hz");
    const double steps = 1.0 / (frequency * o.trial.step_length);
    if (std::abs(steps - std::round(steps)) > 1e-6)
      throw ConfigError(
          fmt::format("--frequencies: {} Hz is {} steps of {} s; allowed: a whole number of them", frequency,
                      steps, o.trial.step_length));
  }
  CheckPlotFile("--plot", o.plot, o.force);
}

void Draw(const PlatoonOptions& o, const std::vector<PlatoonResponse>& responses) {
  std::array<PlotPanel, 2> panels{PlotPanel{"Swing of the speed along the platoon",
                                            "car behind the leader",
                                            "amplitude by the leader's",
                                            false,
                                            false,
                                            {}},
                                  PlotPanel{"", "time [s]", "speed [m/s]", false, false, {}}};
  for (const PlatoonResponse& response : responses) {
    PlotLine line{fmt::format("{:g} Hz", response.frequency), {}, {}};
    for (std::size_t car = 0; car < response.amplitude.size(); ++car) {
      line.x.push_back(static_cast<double>(car));
      line.y.push_back(response.amplitude[car] / response.amplitude[0]);
    }
    panels[0].lines.push_back(std::move(line));
  }
  // Where it grew most, or shrank least.
  const auto worst = std::max_element(responses.begin(), responses.end(), [](const auto& a, const auto& b) {
    return a.amplitude.back() / a.amplitude[0] < b.amplitude.back() / b.amplitude[0];
  });
  panels[1].title = fmt::format("The last three swings at {:g} Hz", worst->frequency);
  const auto shown = static_cast<std::size_t>(3.0 / (worst->frequency * o.trial.step_length));
  const std::size_t first = worst->time.size() - std::min(shown, worst->time.size());
  for (std::size_t car = 0; car < worst->speed.size(); ++car) {
    PlotLine line{car == 0 ? "leader" : fmt::format("car {}", car),
                  {worst->time.begin() + static_cast<std::ptrdiff_t>(first), worst->time.end()},
                  {worst->speed[car].begin() + static_cast<std::ptrdiff_t>(first), worst->speed[car].end()},
                  car == 0};
    panels[1].lines.push_back(std::move(line));
  }
  DrawPlot(o.plot, panels);
}

int RunPlatoon(PlatoonOptions o) {
  o.trial.level = ParseV2xLevel(o.v2x, "--v2x");
  Check(o);
  RunParams params;
  params.agents.v2x.cruise = !o.ordinary;
  if (!o.params_file.empty()) LoadParams(o.params_file, &params);
  for (const std::string& assignment : o.assignments) SetParamFromText(assignment, &params);
  CheckV2xParams(params.agents.v2x);
  fmt::print("{} cars behind a leader whose speed swings about {:g} m/s; v2x {}, {}\n\n{:>8}{:>9}{:>9}",
             o.trial.cars, o.trial.speed, o.v2x,
             params.agents.v2x.cruise != 0 ? "cooperative cruise" : "ordinary following", "swing", "leader",
             "largest");
  for (int car = 1; car <= o.trial.cars; ++car) fmt::print("{:>8}", fmt::format("car {}", car));
  fmt::print("{:>10}{:>10}{:>9}\n{:>8}{:>9}{:>9}", "time gap", "least gap", "cruise", "[Hz]", "[m/s]",
             "gain");
  for (int car = 1; car <= o.trial.cars; ++car) fmt::print("{:>8}", "gain");
  fmt::print("{:>10}{:>10}{:>9}\n", "[s]", "[m]", "[%]");
  std::vector<PlatoonResponse> responses;
  bool grows = false;
  for (const double frequency : o.frequencies) {
    const PlatoonResponse r = responses.emplace_back(DrivePlatoon(params.agents, o.trial, frequency));
    double largest = 0.0, mean_gap = 0.0;
    std::string gains;
    for (std::size_t car = 0; car < r.gain.size(); ++car) {
      mean_gap += r.time_gap[car] / static_cast<double>(r.gain.size());
      const bool told = r.amplitude[car] >= kLeastSwing;
      if (told) largest = std::max(largest, r.gain[car]);
      gains += told ? fmt::format("{:>8.3f}", r.gain[car]) : fmt::format("{:>8}", "-");
    }
    grows = grows || largest > 1.0;
    fmt::print("{:>8g}{:>9.3f}{:>9.3f}{}{:>10.3f}{:>10.2f}{:>9.1f}\n", frequency, r.amplitude[0], largest,
               gains, mean_gap, r.least_gap, 100.0 * r.cruise_share);
  }
  fmt::print("\n{}\n", grows ? "MISSED: the swing grows along the platoon."
                             : "The swing grows from no car to the next.");
  if (!o.plot.empty()) Draw(o, responses);
  return grows ? 1 : 0;
}

}  // namespace

void AddPlatoonCommand(CLI::App* bench, std::function<int()>* chosen) {
  auto o = std::make_shared<PlatoonOptions>();
  CLI::App* command = bench->add_subcommand(
      "platoon", "Cooperative cruise: what a swing of the leader's speed becomes along a platoon");
  command->add_option("--cars", o->trial.cars, "behind the leader")->capture_default_str();
  command->add_option("--speed", o->trial.speed, "[m/s] the leader's mean")->capture_default_str();
  command->add_option("--frequencies", o->frequencies, "[Hz] of the swing, comma-separated")
      ->delimiter(',')
      ->capture_default_str();
  command->add_option("--v2x", o->v2x, "radio: off, ideal, range, lossy, loaded")->capture_default_str();
  command->add_flag("--ordinary", o->ordinary, "without cooperative cruise, for comparison");
  command->add_option("--step-length", o->trial.step_length, "[s]")->capture_default_str();
  command->add_option("--seed", o->trial.seed, "of the radio's draws")->capture_default_str();
  command->add_option("--config", o->params_file, "TOML file with parameters");
  command->add_option("--set", o->assignments,
                      "one parameter, e.g. --set v2x.cruise_gap=0.8; may be repeated");
  command->add_option("--plot", o->plot, "diagram: .svg, .png or .pdf");
  command->add_flag("--force", o->force, "replace the diagram if it exists");
  command->footer(
      "Example: lanewise bench platoon --v2x lossy --plot platoon.svg\nExit code 1: the swing grows.");
  command->callback([chosen, o] { *chosen = [o] { return RunPlatoon(*o); }; });
}

}  // namespace lanewise
