// The command line. Exit codes: 0 success, 1 a run failed or a check missed its target, 2 bad input,
// 130 interrupted.

#include <fmt/core.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <numeric>
#include <optional>

#include "agents/core/check.h"
#include "analysis/results_file.h"
#include "libsumo_bridge/sumo_session.h"
#include "scenarios/arena.h"
#include "scenarios/calibrate.h"
#include "scenarios/city_bench.h"
#include "scenarios/compare.h"
#include "scenarios/cost_bench.h"
#include "scenarios/doctor.h"
#include "scenarios/export.h"
#include "scenarios/merge.h"
#include "scenarios/platoon_bench.h"
#include "scenarios/report.h"
#include "scenarios/run.h"
#include "scenarios/slots_bench.h"
#include "scenarios/ssm_bench.h"
#include "scenarios/study.h"
#include "scenarios/train.h"
#include "scenarios/verify.h"

namespace lanewise {
namespace {

constexpr int kOk = 0, kFailed = 1, kBadInput = 2, kInterrupted = 130;

/// What `run`, `demo` and `bench city` share, as text: checked by Finish.
struct RunOptions {
  std::string config_file, net_file, scenario, policy{"dwa"}, rules{"agent"}, v2x{"off"}, coordinate{"none"},
      results, params_file, output_folder, samples_file, safety{"full"};
  std::vector<std::string> assignments;
  std::optional<double> end;
  RunConfig config;
};

void AddRunOptions(CLI::App* app, RunOptions* o) {
  app->add_option("-c,--configuration-file", o->config_file,
                  "SUMO configuration (.sumocfg); taken unchanged");
  app->add_option("-n,--net-file", o->net_file, "SUMO network, instead of -c");
  app->add_option("-r,--route-files", o->config.route_files, "demand to -n, comma-separated");
  app->add_option("-a,--additional-files", o->config.additional_files,
                  "additional files to -n, comma-separated");
  app->add_option(
      "--scenario", o->scenario,
      "a network shipped with Lanewise: town, merge, roundabout, priority_crossing, breakdown, arena, "
      "arterial");
  app->add_option(
         "--policy", o->policy,
         "who drives: dwa (Dynamic Window), bp_dwa (a network picks the side, the window searches there), "
         "bp, bls\n"
         "(networks on the sector code alone), apf (potential field), idm (Intelligent Driver Model),\n"
         "sumo (native, the baseline).\n"
         "A vType with <param key=\"lanewise.policy\" value=\"idm\"/> overrides it, so a vTypeDistribution "
         "mixes policies")
      ->capture_default_str();
  app->add_option("--penetration", o->config.penetration,
                  "share of vehicles, 0 to 1, that get the policy; SUMO drives the others. Drawn by vehicle "
                  "id and seed: a higher rate contains the vehicles of a lower one")
      ->capture_default_str();
  app->add_option(
         "--rules", o->rules,
         "who answers for signals and right of way: agent (the agents themselves; with a penetration of 1 "
         "SUMO is passive\nthen: it works out its own driving once a second only), or sumo (its checks "
         "guard the junctions)")
      ->capture_default_str();
  app->add_option(
         "--v2x", o->v2x,
         "radio between vehicles: off, ideal (everybody hears everybody at once), range (within "
         "v2x.range),\nlossy (latency, loss by distance, noise of positions too), loaded (loss by the "
         "channel's load too).\nWhich vehicles carry one: --set v2x.share")
      ->capture_default_str();
  app->add_option(
         "--coordinate", o->coordinate,
         "what the roadside units coordinate over that radio: none, or of these, separated by commas:\n"
         "green-advice (speeds at which agents arrive in green), signals (green split and offset adapt),\n"
         "dispatch (routes around crowded edges, departures held while it is crowded),\n"
         "slots (turns at all junctions without signals; slots:A:B: at A and B), with --rules agent")
      ->capture_default_str();
  app->add_option("--seed", o->config.seed, "SUMO's random seed")->capture_default_str();
  app->add_option("-e,--end", o->end,
                  "simulated time to stop at [s]; default: the configuration's, or until all have arrived");
  app->add_option("--step-length", o->config.step_length, "[s]")->capture_default_str();
  app->add_option("--threads", o->config.threads,
                  "threads for the agents; 0 = all cores. The result does not depend on it")
      ->capture_default_str();
  app->add_option("--config", o->params_file, "TOML file with parameters; `lanewise params` lists them");
  app->add_option("--set", o->assignments,
                  "one parameter, e.g. --set dwa.clearance_weight=1.5; may be repeated");
  app->add_option("--sumo-outputs", o->output_folder,
                  "folder for the outputs the .sumocfg asks SUMO for; default: where it says");
  app->add_flag("-q,--quiet", o->config.quiet, "no progress line");
}

/// Those and what only `run` has.
void AddRunCommandOptions(CLI::App* app, RunOptions* o) {
  AddRunOptions(app, o);
  app->add_option("--results", o->results, "SQLite file that gains this run; created if it does not exist");
  app->add_option("--sample-period", o->config.sample_period, "[s] between trajectory rows; 0 = every step")
      ->capture_default_str();
  app->add_option(
         "--safety", o->safety,
         "what is watched: off, contacts (who touches whom), full (contacts and encounters: TTC, DRAC, "
         "PET and the rest)")
      ->capture_default_str();
  app->add_option("--edge-interval", o->config.edge_interval,
                  "[s] of the intervals of flow, density and speed by edge; 0 = none")
      ->capture_default_str();
  app->add_option("--record-samples", o->samples_file,
                  "CSV file of sector-scan samples for `lanewise train`: what each vehicle's lidar sees, and "
                  "where it then goes");
  app->add_option("--samples-period", o->config.samples.period, "[s] between scans of a vehicle")
      ->capture_default_str();
  app->add_option("--samples-horizon", o->config.samples.horizon, "[s] after which the way taken is judged")
      ->capture_default_str();
  app->add_option("--samples-shift", o->config.samples.min_shift,
                  "[m] moved to a side within the horizon that make the way 'left' or 'right'")
      ->capture_default_str();
  app->add_option("--progress-fd", o->config.progress_fd, "open file to be told of progress, for programs")
      ->group("");
}

/// Text to configuration. @throws ConfigError.
RunConfig Finish(RunOptions* o, const std::vector<std::string>& sumo_options) {
  RunConfig config = o->config;
  if (!o->scenario.empty() && !o->config_file.empty())
    throw ConfigError("--scenario and -c exclude each other");
  config.config_file =
      o->scenario.empty() ? std::filesystem::path(o->config_file) : FindShippedScenario(o->scenario);
  config.scenario = o->scenario;
  config.net_file = o->net_file;
  config.policy = ParsePolicy(o->policy, "--policy");
  config.v2x = ParseV2xLevel(o->v2x, "--v2x");
  config.rules = ParseRules(o->rules, "--rules");
  config.coordinate = ParseCoordination(o->coordinate);
  config.safety_level = ParseSafetyLevel(o->safety);
  config.end = o->end;
  if (!o->results.empty()) config.results = o->results;
  if (!o->samples_file.empty()) config.samples_file = o->samples_file;
  RunParams params{config.params, config.safety, config.coordination};
  if (!o->params_file.empty()) LoadParams(o->params_file, &params);
  for (const std::string& assignment : o->assignments) SetParamFromText(assignment, &params);
  config.params = params.agents;
  config.safety = params.safety;
  config.coordination = params.coordination;
  if (!o->output_folder.empty()) {
    if (!std::filesystem::is_directory(o->output_folder))
      throw ConfigError(fmt::format("--sumo-outputs: {}: no such folder", o->output_folder));
    config.sumo_output_folder = o->output_folder;
  }
  config.sumo_options = sumo_options;
  Resolve(&config);
  return config;
}

/// What studies have to know of `lanewise run`.
RunInterface DescribeRunCommand() {
  RunInterface run;
  RunOptions defaults;
  CLI::App app;
  AddRunCommandOptions(&app, &defaults);
  for (const CLI::Option* option : app.get_options()) {
    if (option->get_lnames().empty() || option->get_group().empty()) continue;
    run.options.push_back({option->get_lnames().front(), option->get_items_expected_max() == 0});
  }
  run.parse = [](std::vector<std::string> arguments, const std::vector<std::string>& sumo_options) {
    RunOptions options;
    CLI::App parser;
    AddRunCommandOptions(&parser, &options);
    std::reverse(arguments.begin(), arguments.end());
    try {
      parser.parse(arguments);
    } catch (const CLI::ParseError& error) {
      throw ConfigError(error.what());
    }
    return Finish(&options, sumo_options);
  };
  return run;
}

void PrintV2x(const RunConfig& config, const ChannelCounts& v2x) {
  const auto ratio = [](auto part, auto whole) {
    return whole > 0 ? static_cast<double>(part) / static_cast<double>(whole) : 0.0;
  };
  const auto fate = [&](Fate f) { return v2x.fates[static_cast<std::size_t>(f)]; };
  const std::int64_t heard = std::accumulate(v2x.fates.begin(), v2x.fates.end(), std::int64_t{0});
  fmt::print(
      "v2x {}: {} messages sent ({:.2f} Hz), {:.1f} % of {} arrived ({} dropped, {} faded, {} collided), "
      "{:.2f} s old on average",
      kV2xLevelNames[static_cast<std::size_t>(config.v2x)], v2x.sent,
      ratio(v2x.sent, v2x.station_steps) / config.step_length, 100.0 * ratio(fate(Fate::kDelivered), heard),
      heard, fate(Fate::kDropped), fate(Fate::kFaded), fate(Fate::kCollided),
      ratio(v2x.age_steps, v2x.age_count) * config.step_length);
  if (config.v2x == V2xLevel::kLoaded)
    fmt::print(", channel busy {:.1f} %",
               100.0 * v2x.busy_sum / std::max(1.0, static_cast<double>(v2x.station_steps)));
  if (config.params.v2x.cruise != 0)
    fmt::print("; {} platoons joined, {:.1f} % of all driving in one", v2x.platoon_joins,
               100.0 * ratio(v2x.cruise_steps, v2x.station_steps));
  fmt::print("\n");
}

int Report(const RunConfig& config, const RunReport& report) {
  const RunOutcome& o = report.outcome;
  const AuditCount& audit = report.audit.by_cause[static_cast<std::size_t>(AuditCause::kMidBlock)];
  fmt::print("{}: {} inserted, {} arrived, {} still running, {} not inserted, {} teleports\n",
             config.scenario, o.inserted, o.arrived, o.still_running, o.not_inserted, o.teleported);
  fmt::print(
      "{:.0f} s simulated in {:.1f} s ({:.1f} x real time): SUMO {:.1f} s, coupling {:.1f} s, agents {:.1f} "
      "s, measures {:.1f} s (safety {:.1f} s)\n",
      o.simulated_time, o.wall_time, o.wall_time > 0 ? o.simulated_time / o.wall_time : 0.0, o.sumo_time,
      report.coupling_time, report.agent_time, report.record_time, report.safety_time);
  for (const PolicyShareRow& share : o.policy_shares) {
    fmt::print("policy {}: {} vehicles, {:.1f} % of their steps agent-driven\n", share.policy, share.vehicles,
               share.vehicle_steps > 0
                   ? 100.0 * static_cast<double>(share.agent_steps) / static_cast<double>(share.vehicle_steps)
                   : 0.0);
  }
  fmt::print(
      "audit: {} of {} mid-block commands not carried out exactly; {} halts at a lane's end, {} "
      "detours for want of a lane change ({:.1f} km)\n",
      audit.different, audit.steps, report.lane_end_halts, report.detours, 1e-3 * report.detour_length);
  if (config.v2x != V2xLevel::kOff) PrintV2x(config, report.v2x);
  const auto events = [&](RuleEventKind kind) { return report.rule_events[static_cast<std::size_t>(kind)]; };
  fmt::print(
      "rules ({}{}): {} red lights run, {} blocked a junction, {} stood for 300 s, {} forced entries\n",
      kRulesNames[static_cast<std::size_t>(config.rules)],
      PassiveActionStep(config) > 0.0 ? ", SUMO passive" : "", events(RuleEventKind::kRedLight),
      events(RuleEventKind::kJunctionBlocked), events(RuleEventKind::kStandstill),
      events(RuleEventKind::kForcedEntry));
  fmt::print("state hash {:016x}\n", o.state_hash);
  if (config.samples_file) fmt::print("{} samples in {}\n", report.samples, config.samples_file->string());
  if (config.results) fmt::print("run {} in {}\n", report.run_id, config.results->string());
  return o.status == RunStatus::kInterrupted ? kInterrupted : kOk;
}

int Demo(const RunConfig& base) {
  RunConfig config = base;
  std::vector<RunSummary> shown;
  std::vector<std::int64_t> ids;
  for (const Policy policy : {base.policy, Policy::kSumo}) {
    config.policy = policy;
    const RunReport report = Run(config);
    if (report.outcome.status == RunStatus::kInterrupted) return kInterrupted;
    ids.push_back(report.run_id);
  }
  for (const RunSummary& summary : LoadRunSummaries(*config.results)) {
    if (std::find(ids.begin(), ids.end(), summary.run_id) != ids.end()) shown.push_back(summary);
  }
  fmt::print("\n{}\nResults: {} (`lanewise info {}`)\n", FormatComparison(shown), config.results->string(),
             config.results->string());
  return kOk;
}

int PrintParams(bool markdown) {
  if (markdown) {
    fmt::print(
        "# Parameters\n\nSet one with `--set NAME=VALUE`, many with `--config FILE.toml`. This page is "
        "generated: `lanewise params --markdown`.\n\n"
        "| parameter | unit | default | range | meaning | source |\n|---|---|---|---|---|---|\n");
  }
  for (const ParamDescription& p : DescribeParams(RunParams{})) {
    if (markdown) {
      fmt::print("| `{}` | {} | {} | {} to {} | {} | {} |\n", p.name, p.unit, p.value, p.range.min,
                 p.range.max, p.meaning, p.source);
    } else {
      fmt::print("{:<32} {:>6} {:<6} [{} to {}]\n    {} ({})\n", p.name, p.value, p.unit, p.range.min,
                 p.range.max, p.meaning, p.source);
    }
  }
  return kOk;
}

int Main(int argc, char** argv) {
  // Everything behind `--` is SUMO's.
  std::vector<std::string> own, sumo_options;
  bool behind = false;
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i];
    if (!behind && argument == "--") {
      behind = true;
    } else {
      (behind ? sumo_options : own).push_back(argument);
    }
  }
  std::reverse(own.begin(), own.end());  // CLI11 takes its arguments last first.

  CLI::App app{
      "Lanewise: puts a driving agent into every vehicle of a SUMO scenario and compares avoidance "
      "policies."};
  app.set_version_flag("--version", LANEWISE_VERSION);
  app.require_subcommand(1);
  app.footer(
      "Exit codes: 0 success, 1 a run failed or a check missed its target, 2 bad input, 130 interrupted.\n"
      "Each command has its own --help. Start with: lanewise run --scenario town --results town.sqlite");

  RunOptions run_options, demo_options, bench_options;
  CLI::App* run = app.add_subcommand("run", "Drive one scenario and store the results");
  AddRunCommandOptions(run, &run_options);
  run->footer(
      "Examples:\n"
      "  lanewise run --scenario town --results town.sqlite\n"
      "  lanewise run -c my.sumocfg --policy idm --seed 7 --results my.sqlite\n"
      "  lanewise run -n my.net.xml -r my.rou.xml --end 600 --set dwa.clearance_weight=1.5\n"
      "  lanewise run --scenario town --policy dwa --record-samples town.csv    (then: lanewise train bp "
      "--samples town.csv)\n"
      "  lanewise run -c my.sumocfg -- --scale 1.2 --tripinfo-output trips.xml   (behind -- : SUMO's "
      "options)\n"
      "Ctrl-C ends the run after the present step; what was recorded is kept and marked 'interrupted'.");
  CLI::App* demo =
      app.add_subcommand("demo", "Drive the default scenario with agents and natively, and compare");
  AddRunOptions(demo, &demo_options);
  demo_options.results = "lanewise-demo.sqlite";
  demo->add_option("--results", demo_options.results, "SQLite file that gains the runs")
      ->capture_default_str();
  CLI::App* bench = app.add_subcommand("bench", "Measure");
  bench->require_subcommand(1);
  CLI::App* city = bench->add_subcommand(
      "city", "A scenario under a policy against the native run: traffic, safety, audit, wall time");
  AddRunOptions(city, &bench_options);
  std::vector<int> thread_counts;
  city->add_option("--results", bench_options.results, "keep both runs in this SQLite file");
  city->add_option("--repeat-threads", thread_counts,
                   "run again with these numbers of threads; the state hashes must be equal")
      ->delimiter(',');
  city->footer(
      "Example: lanewise bench city -c bologna/acosta/run.sumocfg --threads 2 --repeat-threads 1,2,4");
  CLI::App* ssm = bench->add_subcommand(
      "ssm", "The safety engine against SUMO's own device.ssm, on one native run of a scenario");
  RunOptions ssm_options;
  AddRunOptions(ssm, &ssm_options);
  std::string differences_file;
  ssm->add_option("--results", ssm_options.results, "keep the run in this SQLite file");
  ssm->add_option("--differences", differences_file, "CSV file of the encounters that do not agree");
  ssm->footer(
      "Example: lanewise bench ssm -c bologna/acosta/run.sumocfg --end 600 --differences differences.csv\n"
      "With its device on every vehicle SUMO is about ten times slower.");
  CLI::App* cost = bench->add_subcommand(
      "cost", "What the safety engine and recording add to a run's wall time, and rows a second into SQLite");
  RunOptions cost_options;
  AddRunOptions(cost, &cost_options);
  int repetitions = 3;
  cost->add_option("--repeat", repetitions, "repetitions of three runs each, compared within each")
      ->capture_default_str()
      ->check(CLI::Range(1, 1000));
  cost->footer(
      "Example: lanewise bench cost -c bologna/joined/run.sumocfg --policy sumo --end 600 --repeat 5\n"
      "Let nothing else run meanwhile.");
  const std::function<int()> run_arena = AddArenaCommand(&app);
  std::string results_file;
  CLI::App* info = app.add_subcommand("info", "What a results file holds: runs, policies, counts");
  info->add_option("RESULTS", results_file, "SQLite file")->required();
  bool markdown = false;
  CLI::App* params = app.add_subcommand("params", "Every parameter: meaning, unit, default, range, source");
  params->add_flag("--markdown", markdown, "as the reference page");
  CLI::App* doctor =
      app.add_subcommand("doctor", "Check SUMO, libraries and versions, and drive two seconds");

  std::function<int()> chosen;  // What the subcommands below do.
  AddPlatoonCommand(bench, &chosen);
  AddSlotsCommand(bench, &chosen);
  AddCompareCommand(&app, &chosen);
  AddExportCommand(&app, &chosen);
  AddReportCommand(&app, &chosen);
  AddTrainCommand(&app, &chosen);
  AddCalibrateCommand(&app, &chosen);
  AddStudyCommand(&app, DescribeRunCommand(), &chosen);
  AddMergeCommand(&app, &chosen);
  AddVerifyCommand(&app, &chosen);

  try {
    app.parse(own);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? kOk : kBadInput;
  }
  if (!sumo_options.empty() && !run->parsed() && !demo->parsed() && !city->parsed() && !ssm->parsed() &&
      !cost->parsed())
    throw ConfigError("options behind -- are for runs only");

  if (chosen) return chosen();
  SumoSession::EnsureHome();
  if (run->parsed()) {
    const RunConfig config = Finish(&run_options, sumo_options);
    return Report(config, Run(config));
  }
  if (demo->parsed()) {
    if (demo_options.scenario.empty() && demo_options.config_file.empty() && demo_options.net_file.empty())
      demo_options.scenario = "town";
    return Demo(Finish(&demo_options, sumo_options));
  }
  if (city->parsed()) return BenchCity(Finish(&bench_options, sumo_options), thread_counts) ? kOk : kFailed;
  if (ssm->parsed()) return BenchSsm(Finish(&ssm_options, sumo_options), differences_file) ? kOk : kFailed;
  if (cost->parsed()) return BenchCost(Finish(&cost_options, sumo_options), repetitions) ? kOk : kFailed;
  if (app.got_subcommand("arena")) return run_arena();
  if (info->parsed()) {
    fmt::print("{}", FormatInfo(results_file, LoadRunSummaries(results_file)));
    return kOk;
  }
  if (params->parsed()) return PrintParams(markdown);
  if (doctor->parsed()) return RunDoctor() ? kOk : kFailed;
  return kBadInput;
}

}  // namespace
}  // namespace lanewise

namespace {

/// Idle threads of GCC's OpenMP runtime spin between the parallel parts of a step, which lasts about a
/// millisecond of SUMO alone. On a busy machine they take the cores away from the very thread they wait for:
/// a run on two threads then takes several times as long as on one. A short spin, then sleep, is as fast
/// where cores are free. The runtime reads the setting when it is loaded, before main: so the program starts
/// itself once more with it.
void StartWithShortSpin(char** argv) {
  if (std::getenv("OMP_WAIT_POLICY") != nullptr || std::getenv("GOMP_SPINCOUNT") != nullptr) return;
  std::error_code error;
  const std::filesystem::path self = std::filesystem::read_symlink("/proc/self/exe", error);
  if (error || setenv("GOMP_SPINCOUNT", "1000", 1) != 0) return;
  execv(self.c_str(), argv);  // Comes back only if it failed; then the run is merely slower.
}

}  // namespace

int main(int argc, char** argv) {
  StartWithShortSpin(argv);
  try {
    return lanewise::Main(argc, argv);
  } catch (const lanewise::ConfigError& error) {
    fmt::print(stderr, "lanewise: {}\n", error.what());
    return lanewise::kBadInput;
  } catch (const std::exception& error) {
    fmt::print(stderr, "lanewise: {}\n", error.what());
    return lanewise::kFailed;
  }
}
