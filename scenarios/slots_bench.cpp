#include "scenarios/slots_bench.h"

#include <fmt/core.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>
#include <pugixml.hpp>
#include <string>
#include <utility>
#include <vector>

#include "agents/core/check.h"
#include "analysis/results_file.h"
#include "scenarios/run.h"
#include "scenarios/scratch_folder.h"

namespace lanewise {
namespace {

namespace fs = std::filesystem;

constexpr const char* kScenario = "priority_crossing";
constexpr double kScenarioDemand = 930.0;  // [veh/h] its routes hold.
constexpr double kTarget = 0.5;            // Of the delay by the rule of priority, where that is
constexpr double kFreeFlow = 0.5;          // [s] or more: below it traffic flows freely.

struct SlotsOptions {
  std::vector<double> demands{600, 900, 1200, 1500, 1800};  // [veh/h]
  int seeds{3}, threads{0};
  std::string v2x{"ideal"}, params_file, results;
  std::vector<std::string> assignments;
};

/// The demand of each approach without the others, a file for each edge at which routes begin.
std::vector<fs::path> WriteApproaches(const fs::path& routes, const fs::path& folder) {
  pugi::xml_document all;
  LANEWISE_CHECK(all.load_file(routes.c_str()));
  std::map<std::string, std::string> approach_of_route;
  for (const pugi::xml_node route : all.child("routes").children("route")) {
    const std::string edges = route.attribute("edges").value();
    approach_of_route[route.attribute("id").value()] = edges.substr(0, edges.find(' '));
  }
  std::map<std::string, fs::path> files;
  for (const auto& [route, approach] : approach_of_route) files[approach] = folder / (approach + ".rou.xml");
  std::vector<fs::path> written;
  for (const auto& [approach, file] : files) {
    pugi::xml_document one;
    one.reset(all);
    pugi::xml_node root = one.child("routes");
    for (pugi::xml_node vehicle = root.child("vehicle"); vehicle;) {
      const pugi::xml_node next = vehicle.next_sibling("vehicle");
      if (approach_of_route.at(vehicle.attribute("route").value()) != approach) root.remove_child(vehicle);
      vehicle = next;
    }
    if (!one.save_file(file.c_str())) throw ConfigError(file.string() + ": cannot be written");
    written.push_back(file);
  }
  return written;
}

/// What runs of the same kind came to.
struct Outcome {
  std::int64_t arrived{0}, contacts{0};
  double loss{0.0};  // [s] summed over the vehicles.

  double mean_loss() const { return loss / static_cast<double>(std::max<std::int64_t>(1, arrived)); }
  void Add(const Outcome& other) {
    arrived += other.arrived;
    contacts += other.contacts;
    loss += other.loss;
  }
};

Outcome Drive(const RunConfig& config) {
  const std::int64_t run = Run(config).run_id;
  for (const RunSummary& summary : LoadRunSummaries(*config.results)) {
    if (summary.run_id != run) continue;
    return {summary.arrived, summary.collisions.value_or(0),
            summary.mean_time_loss.value_or(0.0) * static_cast<double>(summary.arrived)};
  }
  throw ConfigError(config.results->string() + ": the run is not in it any more");
}

/// The same demand three times.
struct Comparison {
  Outcome alone;  ///< With nobody on the other approaches.
  Outcome priority, slots;

  void Add(const Comparison& other) {
    alone.Add(other.alone);
    priority.Add(other.priority);
    slots.Add(other.slots);
  }
  /// [s] for which the junction is to blame.
  double DelayOf(const Outcome& outcome) const { return outcome.mean_loss() - alone.mean_loss(); }
  double ratio() const { return DelayOf(slots) / DelayOf(priority); }
  void Print(double demand, const std::string& seed) const {
    fmt::print("{:>8.0f}{:>6}{:>10}{:>12.2f}{:>10.2f}{:>10.2f}{:>8.2f}{:>10}\n", demand, seed, slots.arrived,
               alone.mean_loss(), DelayOf(priority), DelayOf(slots), ratio(), slots.contacts);
    std::fflush(stdout);
  }
};

Comparison Measure(RunConfig config, const std::vector<fs::path>& approaches) {
  Comparison result;
  const V2xLevel v2x = std::exchange(config.v2x, V2xLevel::kOff);
  result.priority = Drive(config);
  for (const fs::path& routes : approaches) {
    RunConfig one = config;
    one.sumo_options.insert(one.sumo_options.end(), {"--route-files", routes.string()});
    result.alone.Add(Drive(one));
  }
  config.v2x = v2x;
  config.coordinate = ParseCoordination("slots");
  result.slots = Drive(config);
  return result;
}

int RunSlots(const SlotsOptions& o) {
  for (const double demand : o.demands) {
    if (!(demand >= 60 && demand <= 3600))
      throw ConfigError(fmt::format("--demand: {} veh/h; allowed: 60 to 3600 veh/h", demand));
  }
  if (o.seeds < 1 || o.seeds > 1000)
    throw ConfigError(fmt::format("--seeds: {}; allowed: 1 to 1000", o.seeds));
  const ScratchFolder scratch;
  RunConfig config;
  config.config_file = FindShippedScenario(kScenario);
  config.scenario = kScenario;
  config.rules = Rules::kAgent;
  config.v2x = ParseV2xLevel(o.v2x, "--v2x");
  config.threads = o.threads;
  config.quiet = true;
  config.results = o.results.empty() ? scratch.path() / "slots.sqlite" : fs::path(o.results);
  RunParams params;
  if (!o.params_file.empty()) LoadParams(o.params_file, &params);
  for (const std::string& assignment : o.assignments) SetParamFromText(assignment, &params);
  config.params = params.agents;
  config.safety = params.safety;
  config.coordination = params.coordination;
  Resolve(&config);
  const auto approaches = WriteApproaches(
      config.config_file.parent_path() / (std::string(kScenario) + ".rou.xml"), scratch.path());

  fmt::print(
      "Delay at {}: mean time loss beyond that of the same demand with nobody on the other approaches\n\n",
      kScenario);
  fmt::print("{:>8}{:>6}{:>10}{:>12}{:>10}{:>10}{:>8}{:>10}\n", "demand", "seed", "vehicles", "loss alone",
             "priority", "slots", "ratio", "contacts");
  fmt::print("{:>8}{:>28}{:>10}{:>10}\n", "[veh/h]", "[s]", "[s]", "[s]");
  bool passed = true;
  for (const double demand : o.demands) {
    Comparison all;
    for (int seed = 1; seed <= o.seeds; ++seed) {
      RunConfig one = config;
      one.seed = seed;
      one.sumo_options = {"--scale", fmt::format("{:.4f}", demand / kScenarioDemand)};
      const Comparison comparison = Measure(one, approaches);
      comparison.Print(demand, fmt::format("{}", seed));
      all.Add(comparison);
    }
    all.Print(demand, "all");
    const bool flows_freely = all.DelayOf(all.priority) < kFreeFlow;
    passed = passed && (flows_freely || all.ratio() <= kTarget) && all.slots.contacts == 0;
  }
  fmt::print(
      "\n{}: no contact, and at most {:g} x the delay by the rule of priority wherever that is {:g} s or "
      "more.\n",
      passed ? "ok" : "MISSED", kTarget, kFreeFlow);
  return passed ? 0 : 1;
}

}  // namespace

void AddSlotsCommand(CLI::App* bench, std::function<int()>* chosen) {
  auto o = std::make_shared<SlotsOptions>();
  CLI::App* command = bench->add_subcommand(
      "slots", "Junction slots: the delay at a crossing by the rule of priority and by slots");
  command->add_option("--demand", o->demands, "[veh/h] on priority_crossing, comma-separated")
      ->delimiter(',')
      ->capture_default_str();
  command->add_option("--seeds", o->seeds, "runs of each demand; seeds count from 1")->capture_default_str();
  command->add_option("--v2x", o->v2x, "radio: ideal, range, lossy, loaded")->capture_default_str();
  command->add_option("--threads", o->threads, "0: all cores")->capture_default_str();
  command->add_option("--results", o->results, "keep the runs in this SQLite file");
  command->add_option("--config", o->params_file, "TOML file with parameters");
  command->add_option("--set", o->assignments, "one parameter, e.g. --set slots.margin=0.8; may be repeated");
  command->footer(
      "Example: lanewise bench slots --demand 900,1500 --seeds 5\n"
      "Exit code 1: with slots a delay is more than half of one of 0.5 s or more by the rule of priority, or "
      "there was a contact.");
  command->callback([chosen, o] { *chosen = [o] { return RunSlots(*o); }; });
}

}  // namespace lanewise
