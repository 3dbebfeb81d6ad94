#include "analysis/run_metrics.h"

#include <SQLiteCpp/SQLiteCpp.h>
#include <fmt/ranges.h>
#include <sqlite3.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <sstream>
#include <tuple>

#include "agents/core/check.h"
#include "analysis/results_views.h"  // Generated from results_views.sql.

namespace lanewise {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr MetricInfo kMetrics[] = {
    {"time_loss_s", "time loss [s]", Better::kLower, true, "mean over arrived vehicles, SUMO's definition"},
    {"delay_s", "delay, all vehicles [s]", Better::kLower, true,
     "time loss and departure delay per vehicle that entered, arrived or not"},
    {"travel_time_s", "travel time [s]", Better::kLower, false, "mean over arrived vehicles"},
    {"waiting_time_s", "waiting time [s]", Better::kLower, false,
     "below 0.1 m/s; mean over arrived vehicles"},
    {"depart_delay_s", "departure delay [s]", Better::kLower, false, "mean over all that entered"},
    {"mean_speed_mps", "mean speed [m/s]", Better::kHigher, false, "distance by time, all vehicles"},
    {"arrived", "arrived", Better::kHigher, true, "vehicles that reached their destination"},
    {"stops_per_km", "stops [1/km]", Better::kLower, true, "times a vehicle came below 0.1 m/s"},
    {"contacts_per_1000km", "contacts, mid-block [1/1000 km]", Better::kLower, true,
     "overlapping bodies outside junctions"},
    {"junction_contacts_per_1000km", "contacts, junctions [1/1000 km]", Better::kLower, true,
     "overlapping bodies inside junctions"},
    {"agent_strikes_per_1000km", "agent strikes [1/1000 km]", Better::kLower, false,
     "an agent struck something outside junctions"},
    {"near_misses_per_1000km", "near misses [1/1000 km]", Better::kLower, true,
     "TTC below 1.5 s without contact"},
    {"encounters_per_1000km", "encounters [1/1000 km]", Better::kLower, false,
     "TTC, DRAC or PET beyond its threshold"},
    {"serious_encounters_per_1000km", "serious encounters [1/1000 km]", Better::kLower, false,
     "encounters of severity 2 and above"},
    {"ttc_exposed_s_per_h", "time below TTC 3 s [s/h]", Better::kLower, true,
     "time exposed TTC (TET) per hour driven"},
    {"hard_braking_per_100km", "hard braking [1/100 km]", Better::kLower, true,
     "decelerations above 4.5 m/s^2"},
    {"jerk_mps3", "jerk, rms [m/s^3]", Better::kLower, true, "root mean square over all steps driven"},
    {"max_lateral_accel_mps2", "lateral accel., max [m/s^2]", Better::kLower, false,
     "mean of the trips' largest values"},
    {"co2_g_per_km", "CO2 [g/km]", Better::kLower, true, "SUMO's emission classes, all vehicles"},
    {"nox_g_per_km", "NOx [g/km]", Better::kLower, true, "likewise"},
    {"pmx_g_per_km", "PMx [g/km]", Better::kLower, false, "likewise"},
    {"fuel_g_per_km", "fuel [g/km]", Better::kLower, false, "likewise"},
    {"electricity_wh_per_km", "electricity [Wh/km]", Better::kLower, false, "likewise"},
    {"v2x_sent_hz", "V2X messages sent [Hz]", Better::kNeither, false, "per station; CAM trigger rules"},
    {"v2x_delivered_share", "V2X delivered [-]", Better::kHigher, false,
     "share of messages at receivers in range"},
    {"v2x_age_s", "V2X age of information [s]", Better::kLower, false, "mean over pairs and time"},
    {"v2x_busy_ratio", "V2X channel busy ratio [-]", Better::kLower, false, "mean over stations and time"},
    {"cruise_share", "cooperative cruise [-]", Better::kNeither, false,
     "share of the agents' driving time behind a leader that tells what it is about to do"},
    {"advised", "advised approaches", Better::kNeither, false, "to a signal, with green-light advice"},
    {"advice_followed", "advice followed [-]", Better::kHigher, false, "share of them without a stop"},
    {"signal_changes", "signal changes", Better::kNeither, false,
     "cycles with another split or offset than the program's"},
    {"reroutes", "reroutes", Better::kNeither, false, "routes taken around crowded edges"},
    {"holds", "holds", Better::kNeither, false, "departures held back"},
    {"red_lights_run", "red lights run", Better::kLower, false, "by vehicles that could have stopped"},
    {"junctions_blocked", "junctions blocked", Better::kLower, false,
     "vehicles that stood for 10 s in a junction where they may not"},
    {"standstills", "standstills of 300 s", Better::kLower, false, "vehicles that stood so long in traffic"},
    {"forced_entries", "forced entries", Better::kNeither, false,
     "agents that broke a circle of vehicles waiting for each other"},
    {"teleported", "teleports", Better::kLower, false, "vehicles SUMO lifted out of a jam"},
    {"speed_variance_m2ps2", "speed variance [m^2/s^2]", Better::kLower, false,
     "of each vehicle's speed over its trip; mean over driving time"},
    {"stops_per_h", "stops [1/h]", Better::kLower, false, "per hour driven by all vehicles together"},
    {"contacts_per_1000h", "contacts, mid-block [1/1000 h]", Better::kLower, false, "likewise"},
    {"junction_contacts_per_1000h", "contacts, junctions [1/1000 h]", Better::kLower, false, "likewise"},
    {"near_misses_per_h", "near misses [1/h]", Better::kLower, false, "likewise"},
    {"encounters_per_h", "encounters [1/h]", Better::kLower, false, "likewise"},
    {"serious_encounters_per_h", "serious encounters [1/h]", Better::kLower, false, "likewise"},
    {"hard_braking_per_h", "hard braking [1/h]", Better::kLower, false, "likewise"},
    {"co2_g_per_h", "CO2 [g/h]", Better::kLower, false, "likewise"},
    {"nox_g_per_h", "NOx [g/h]", Better::kLower, false, "likewise"},
    {"pmx_g_per_h", "PMx [g/h]", Better::kLower, false, "likewise"},
    {"fuel_g_per_h", "fuel [g/h]", Better::kLower, false, "likewise"},
    {"electricity_wh_per_h", "electricity [Wh/h]", Better::kLower, false, "likewise"},
};

/// Is this no more than the unit at the end of a metric's name, such as "g_per_km"?
bool IsUnit(const std::string& text) {
  static const std::set<std::string> kWords = {"s",  "mps", "mps2", "mps3", "m2ps2", "hz",     "g",
                                               "wh", "per", "h",    "km",   "100km", "1000km", "1000h"};
  std::istringstream words(text);
  std::string word;
  while (std::getline(words, word, '_')) {
    if (!kWords.contains(word)) return false;
  }
  return true;
}

/// Options that name files or say what is written: the files' content is hashed, outputs change no traffic.
bool ChangesNoTraffic(const std::string& option) {
  static const std::set<std::string> kNames = {
      "configuration-file", "net-file", "route-files", "additional-files", "seed",     "no-step-log",
      "no-warnings",        "verbose",  "log",         "message-log",      "error-log"};
  return kNames.count(option) != 0 || option.ends_with("output") ||
         option.find("-output.") != std::string::npos;
}

/// SUMO's options as given to it, without those that change no traffic, and those that a run of agents adds
/// by itself (SumoCommandLine): they belong to who drives, not to the demand.
std::string TrafficOptions(const std::string& command_line) {
  static const std::set<std::string> kOfAgents = {"--ignore-junction-blocker 10", "--time-to-impatience 60",
                                                  "--default.action-step-length 1",
                                                  "--step-method.ballistic false"};
  std::istringstream words(command_line);
  std::vector<std::string> options;
  std::string word;
  while (words >> word) {
    if (word.starts_with("--") || options.empty()) {
      options.push_back(word);
    } else {
      options.back() += " " + word;
    }
  }
  std::erase_if(options, [](const std::string& option) {
    return kOfAgents.contains(option) ||
           (option.starts_with("--") && ChangesNoTraffic(option.substr(2, option.find_first_of("= ") - 2)));
  });
  return fmt::format("{}", fmt::join(options, " "));
}

/// Equal for runs of the same inputs, wherever the files lie.
std::string DemandOf(const std::string& input_hashes_json, const std::string& options) {
  std::multiset<std::string> hashes;
  const Json inputs = Json::parse(input_hashes_json, nullptr, false);
  if (inputs.is_object()) {
    for (const auto& [file, hash] : inputs.items()) hashes.insert(hash.dump());
  }
  return fmt::format("{} {}", fmt::join(hashes, " "), options);
}

std::string TextOf(const SQLite::Column& column) {
  return column.isNull() ? "" : column.getString();
}

std::optional<double> Finite(const SQLite::Column& column) {
  if (column.isNull() || column.getType() == SQLITE_TEXT || !std::isfinite(column.getDouble()))
    return std::nullopt;
  return column.getDouble();
}

void LoadFile(const fs::path& path, std::vector<RunRecord>* runs) {
  ResultsFile file = ResultsFile::Open(path, ResultsFile::Mode::kRead);
  SQLite::Database& database = file.database();
  database.exec(TemporaryViews());
  std::string columns;
  for (const MetricInfo& metric : kMetrics) columns += fmt::format(", m.{}", metric.name);
  SQLite::Statement query(
      database,
      "SELECT run.run_id, run.scenario, run.policy, run.penetration_rate, run.rules, run.v2x, "
      "run.coordination, run.seed, run.status, "
      "run.message, "
      "run.sumo_options, "
      "run.parameters_json, run.input_hashes_json, run.config_file, run.lanewise_version, run.git_commit, "
      "run.sumo_version, run.compiler, run.machine, run.started_at, run.state_hash, run.begin_s, run.end_s, "
      "run.step_length_s, run.wall_time_s, run.simulated_time_s, m.agent_share, m.over_budget, run.inserted, "
      "m.arrived, run.still_running, run.not_inserted, run.teleported" +
          columns + " FROM run JOIN v_run_metrics AS m ON m.run_id = run.run_id ORDER BY run.run_id");
  SQLite::Statement shares(
      database,
      "SELECT policy, vehicles * 1.0 / (SELECT SUM(vehicles) FROM policy_share WHERE run_id = "
      "?1) FROM policy_share WHERE run_id = ?1 AND vehicles > 0 ORDER BY vehicles DESC, policy");
  while (query.executeStep()) {
    int k = 0;
    const auto next = [&] { return query.getColumn(k++); };
    const auto text = [&] { return TextOf(next()); };
    RunRecord& run = runs->emplace_back();
    run.file = path;
    run.run_id = next().getInt64();
    run.scenario = text();
    run.policy = text();
    run.penetration = next().getDouble();
    run.rules = text();
    run.v2x = text();
    run.coordination = text();
    run.seed = next().getInt64();
    run.status = text();
    run.message = text();
    const std::string sumo_options = text();
    run.parameters_json = text();
    run.input_hashes_json = text();
    run.config_file = text();
    run.lanewise_version = text();
    run.git_commit = text();
    run.sumo_version = text();
    run.compiler = text();
    run.machine = text();
    run.started_at = text();
    run.state_hash = text();
    const std::string begin = text(), end = text();
    run.step_length = next().getDouble();
    run.wall_time = Finite(next());
    run.simulated_time = Finite(next());
    run.agent_share = Finite(next()).value_or(0.0);
    run.over_budget = next().getInt64();
    run.inserted = next().getInt64();
    run.arrived = next().getInt64();
    run.still_running = next().getInt64();
    run.not_inserted = next().getInt64();
    run.teleported = next().getInt64();
    for (std::size_t m = 0; m < std::size(kMetrics); ++m) run.metrics.push_back(Finite(next()));
    run.options =
        fmt::format("begin {} end {} step {} {}", begin, end, run.step_length, TrafficOptions(sumo_options));
    run.demand = DemandOf(run.input_hashes_json, run.options);
    shares.reset();
    shares.bind(1, run.run_id);
    while (shares.executeStep())
      run.shares.push_back({shares.getColumn(0).getString(), shares.getColumn(1).getDouble()});
  }
}

/// "dwa 40 %, sumo 60 %", or the policy's bare name where one drove all but a few. Shares are the means over
/// `same`, runs of the same inputs: what each seed draws from them would tear the seeds apart. So it would
/// with a penetration rate that was asked for: it names the run.
std::string DriversOf(const RunRecord& run, const std::vector<const RunRecord*>& same) {
  if (run.penetration > 0.0 && run.penetration < 1.0 && run.policy != "sumo")
    return fmt::format("{} at {:.4g} %", run.policy, 100.0 * run.penetration);
  constexpr double kFew = 0.025;
  std::map<std::string, double> means;
  for (const RunRecord* other : same) {
    for (const PolicyShare& share : other->shares)
      means[share.policy] += share.share / static_cast<double>(same.size());
  }
  std::vector<std::string> parts;
  std::string last;
  for (const auto& [policy, share] : means) {
    if (share < kFew) continue;
    parts.push_back(fmt::format("{} {:.0f} %", policy, 100.0 * share));
    last = policy;
  }
  if (parts.empty()) return run.policy;
  return parts.size() == 1 ? last : fmt::format("{}", fmt::join(parts, ", "));
}

/// Parameters in which the runs differ, name to value, for each run.
std::vector<std::string> Differences(const std::vector<RunRecord*>& runs) {
  std::vector<Json> parameters;
  std::set<std::string> names;
  for (const RunRecord* run : runs) {
    parameters.push_back(Json::parse(run->parameters_json, nullptr, false));
    if (parameters.back().is_object()) {
      for (const auto& [name, value] : parameters.back().items()) names.insert(name);
    }
  }
  std::vector<std::string> texts(runs.size());
  for (const std::string& name : names) {
    std::vector<std::string> values;
    for (const Json& json : parameters)
      values.push_back(json.is_object() && json.contains(name) ? json[name].dump() : "unset");
    if (std::set(values.begin(), values.end()).size() < 2) continue;
    for (std::size_t i = 0; i < runs.size(); ++i)
      texts[i] += fmt::format("{}{}={}", texts[i].empty() ? "" : ", ", name, values[i]);
  }
  return texts;
}

}  // namespace

std::span<const MetricInfo> AllMetrics() {
  return kMetrics;
}

std::size_t FindMetric(const std::string& name, const std::string& origin) {
  std::vector<std::string> names;
  std::optional<std::size_t> meant;
  const std::string stem = name.starts_with("mean_") ? name.substr(5) : name;
  for (std::size_t i = 0; i < std::size(kMetrics); ++i) {
    const std::string metric = kMetrics[i].name;
    if (name == metric) return i;
    const auto names_it = [&](const std::string& short_name) {
      return metric == short_name ||
             (metric.starts_with(short_name + "_") && IsUnit(metric.substr(short_name.size() + 1)));
    };
    if (!meant && (names_it(stem) || names_it(name))) meant = i;
    names.push_back(metric);
  }
  if (meant) return *meant;
  throw ConfigError(
      fmt::format("{}: unknown metric '{}'; allowed: all, {}", origin, name, fmt::join(names, ", ")));
}

std::string TemporaryViews() {
  std::string sql = kResultsViews;
  const std::string from = "CREATE VIEW", to = "CREATE TEMP VIEW";
  for (std::size_t at = 0; (at = sql.find(from, at)) != std::string::npos; at += to.size())
    sql.replace(at, from.size(), to);
  return sql;
}

void LabelRuns(bool by_file, std::vector<RunRecord>* runs) {
  const auto inputs_of = [](const RunRecord& run) {
    return std::tuple(run.scenario, run.policy, run.penetration, run.demand);
  };
  std::map<decltype(inputs_of(RunRecord())), std::vector<const RunRecord*>> by_inputs;
  for (const RunRecord& run : *runs) {
    std::vector<const RunRecord*>& same = by_inputs[inputs_of(run)];
    if (!run.shares.empty()) same.push_back(&run);
  }
  std::map<std::string, std::vector<RunRecord*>> by_driver;
  for (RunRecord& run : *runs) {
    run.label = DriversOf(run, by_inputs[inputs_of(run)]);
    by_driver[run.label].push_back(&run);
  }
  for (auto& [driver, same] : by_driver) {
    std::set<std::string> rules, radios;
    for (const RunRecord* run : same) {
      rules.insert(run->rules);
      radios.insert(run->v2x);
    }
    // Parameters are the agents': natively driven runs do not depend on them, nor on who answers for signals.
    const bool native = driver == "sumo";
    const std::vector<std::string> parameters = Differences(same);
    for (std::size_t i = 0; i < same.size(); ++i) {
      std::string detail = native ? "" : parameters[i];
      if (!native && same[i]->coordination != "none")
        detail += fmt::format("{}{}", detail.empty() ? "" : ", ", same[i]->coordination);
      if (!native && rules.size() > 1)
        detail += fmt::format("{}rules={}", detail.empty() ? "" : ", ", same[i]->rules);
      if (!native && radios.size() > 1)
        detail += fmt::format("{}v2x={}", detail.empty() ? "" : ", ", same[i]->v2x);
      if (!detail.empty()) same[i]->label += fmt::format(" [{}]", detail);
      if (by_file) same[i]->label = fmt::format("{}:{}", same[i]->file.stem().string(), same[i]->label);
    }
  }
}

bool LabelOrder::operator()(const std::string& a, const std::string& b) const {
  const auto key = [](const std::string& label) {
    const std::string drivers = label.substr(0, label.find(" ["));
    const std::size_t at = drivers.rfind(" at ");
    const double rate = at == std::string::npos ? 100.0 : std::strtod(drivers.c_str() + at + 4, nullptr);
    return std::tuple(drivers.substr(0, at), rate, label);
  };
  return key(a) < key(b);
}

std::vector<RunRecord> LoadRuns(std::span<const fs::path> files, bool by_file) {
  std::vector<RunRecord> runs;
  std::set<fs::path> seen;
  for (const fs::path& path : files) {
    std::error_code error;
    if (!seen.insert(fs::weakly_canonical(path, error)).second)
      throw ConfigError(
          fmt::format("results file {}: it is named twice; its runs would count double", path.string()));
    GuardResults(path, [&] { LoadFile(path, &runs); });
  }
  LabelRuns(by_file, &runs);
  return runs;
}

}  // namespace lanewise
