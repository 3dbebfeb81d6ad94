#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "agents/agent_params.h"
#include "agents/v2x/v2x_level.h"
#include "analysis/safety_monitor.h"
#include "libsumo_bridge/vehicle_bridge.h"
#include "scenarios/coordination.h"
#include "scenarios/sample_recorder.h"

namespace lanewise {

/// One run, as the command line asks for it.
struct RunConfig {
  std::filesystem::path config_file;          ///< .sumocfg; empty if net and routes are given.
  std::filesystem::path net_file;             ///< From -n; else read from the .sumocfg.
  std::string route_files, additional_files;  ///< Comma-separated, as SUMO takes them.
  std::string scenario;                       ///< Name in the results.
  Policy policy{Policy::kDwa};
  double penetration{1.0};  ///< Share of vehicles given the policy; 0 to 1.
  Rules rules{Rules::kAgent};
  V2xLevel v2x{V2xLevel::kOff};  ///< How much of a radio channel there is.
  CoordinationSwitches coordinate;
  std::int64_t seed{23423};                      ///< SUMO's default seed.
  std::optional<double> end;                     ///< [s]; nothing: the .sumocfg's, or until all have arrived.
  double step_length{0.1};                       ///< [s]
  int threads{0};                                ///< 0 = all cores.
  std::optional<std::filesystem::path> results;  ///< SQLite file; nothing: no results are stored.
  double sample_period{1.0};                     ///< [s] of trajectory rows; 0 = every step.
  SafetyLevel safety_level{SafetyLevel::kFull};  ///< What the safety engine watches.
  double edge_interval{300.0};                   ///< [s] of the edge measures; 0 = none.
  std::filesystem::path sumo_output_folder;  ///< SUMO's own outputs go there; empty: where the .sumocfg says.
  std::optional<std::filesystem::path> samples_file;  ///< Sector-scan samples; nothing: none are recorded.
  SampleParams samples;
  AgentParams params;
  SafetyParams safety;
  CoordinationParams coordination;
  bool quiet{false};
  int progress_fd{-1};                    ///< Open file that is told of progress in lines; -1: none.
  std::vector<std::string> sumo_options;  ///< Passed to SUMO unchanged, last, so they win.
};

/// What a .sumocfg says that Lanewise has to know.
struct SumoConfigFile {
  std::filesystem::path net_file;
  std::optional<double> end;                                           ///< [s]
  double begin{0.0};                                                   ///< [s]
  std::vector<std::string> options;                                    ///< Names of every option it sets.
  std::vector<std::pair<std::string, std::filesystem::path>> outputs;  ///< Options that write files.
  std::vector<std::filesystem::path> inputs;                           ///< Net, routes, additional files.
};

/// @throws ConfigError: missing, broken, or no SUMO configuration.
SumoConfigFile ReadSumoConfig(const std::filesystem::path& file);

/// The .sumocfg of a network shipped with Lanewise. @throws ConfigError listing the names there are.
std::filesystem::path FindShippedScenario(const std::string& name);
std::vector<std::string> ShippedScenarios();

/// Completes and checks a configuration; fills net_file, scenario and end from the .sumocfg.
/// @throws ConfigError listing what is wrong.
void Resolve(RunConfig* config);

/// Input files of a resolved configuration.
std::vector<std::filesystem::path> InputFiles(const RunConfig& config);

/// [s] SUMO's default action step if it only carries out what it is told: where agents answer for everything,
/// and the user says nothing else, it works out its own driving, which nobody follows, once a second only.
/// 0 if it is not passive.
double PassiveActionStep(const RunConfig& config);

/// SUMO's command line for a resolved configuration.
std::vector<std::string> SumoCommandLine(const RunConfig& config);

/// Arguments of `lanewise run` that repeat a resolved configuration, with absolute paths; all but parameters,
/// threads and where results go.
std::vector<std::string> RepeatArguments(const RunConfig& config);

/// --safety. @throws ConfigError naming what is allowed.
SafetyLevel ParseSafetyLevel(std::string_view name);

/// All parameters a run has, as one table.
struct RunParams {
  AgentParams agents;
  SafetyParams safety;
  CoordinationParams coordination;

  template <class Self, class Field>
  static void Visit(Self& p, Field&& field) {
    AgentParams::Visit(p.agents, field);
    SafetyParams::Visit(p.safety, field);
    CoordinationParams::Visit(p.coordination, field);
  }
};

/// Reads parameters from a TOML file: dotted keys or tables, e.g. `[dwa] clearance_weight = 1.5`.
void LoadParams(const std::filesystem::path& file, RunParams* params);
/// One `--set name=value`.
void SetParamFromText(const std::string& assignment, RunParams* params);

}  // namespace lanewise
