#include "scenarios/arena.h"

#include <fmt/core.h>
#include <fmt/ranges.h>
#include <omp.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <memory>
#include <thread>

#include "agents/agent_pipeline.h"
#include "agents/core/check.h"
#include "agents/core/geometry.h"
#include "agents/sector_net/weight_file.h"
#include "scenarios/run_config.h"

namespace lanewise {
namespace {

constexpr double kMaxTime = 180.0;      // [s] of a drive.
constexpr double kStoppedTime = 15.0;   // [s] of standing after which a drive has ended.
constexpr double kStoppedSpeed = 0.05;  // [m/s]

/// One vehicle on the arena's lane; things and persons are the rows behind it.
void Populate(const RoadNetwork& network, const RoutePlan& plan, const ArenaRoad& road,
              const VehicleParams& vehicle, const ArenaField& field, Policy policy, std::int64_t number,
              Traffic* traffic) {
  traffic->Resize(1 + field.things.size() + field.persons.size());
  traffic->vehicle_count = 1;
  const LaneIndex lane = network.edges[plan.route()[0]].first_lane;
  for (std::size_t i = 0; i < traffic->size(); ++i) {
    traffic->number[i] = static_cast<std::int32_t>(number * 1000 + static_cast<std::int64_t>(i));
    traffic->policy[i] = i == 0 ? policy : Policy::kSumo;
    traffic->plan[i] = i == 0 ? &plan : nullptr;
    traffic->driven[i] = i == 0;
    traffic->hazard[i] = i != 0;
    traffic->stop_distance[i] = 1e9;
    traffic->stop_lane[i] = kNone;
    traffic->speed_limit[i] = network.lanes[lane].speed_limit;
    for (Motion* motion : {&traffic->now, &traffic->next}) {
      motion->lane[i] = i == 0 ? lane : kNone;
      motion->yielded_to[i] = kNone;
      motion->since_change[i] = 100.0f;
    }
  }
  traffic->params[0] = vehicle;
  traffic->now.s[0] = road.start;
}

/// Puts things and persons where they are at `time`.
void PlaceField(const LaneCurve& curve, const ArenaField& field, double time, Traffic* traffic) {
  const auto place = [&](std::size_t row, const Footprint& box, double speed) {
    const PathPoint at = curve.At(box.front.x / curve.scale());
    Motion& now = traffic->now;
    now.x[row] = at.x - box.front.y * std::sin(at.heading);
    now.y[row] = at.y + box.front.y * std::cos(at.heading);
    now.heading[row] = WrapAngle(at.heading + box.front.heading);
    now.speed[row] = speed;
    traffic->params[row].length = box.length;
    traffic->params[row].width = box.width;
  };
  std::size_t row = 1;
  for (const Footprint& box : field.things) place(row++, box, 0.0);
  for (const CrossingPerson& person : field.persons) {
    constexpr double kDepth = 0.3, kShoulders = 0.5;  // [m]
    // Across and as far again behind the other border.
    const double way = 2.0 * std::abs(person.from.y),
                 gone = person.speed * std::max(0.0, time - person.start_time);
    const double y = person.from.y + person.direction * std::min(way, gone);
    const bool walks = time >= person.start_time && gone < way;
    const double heading = 0.5 * 3.14159265358979 * person.direction;
    place(row++, {{person.from.x, y + 0.5 * kDepth * person.direction, heading}, kDepth, kShoulders},
          walks ? person.speed : 0.0);
  }
}

Footprint BoxOf(const Traffic& traffic, std::size_t row) {
  return {{traffic.now.x[row], traffic.now.y[row], traffic.now.heading[row]},
          traffic.params[row].length,
          traffic.params[row].width};
}

/// [m] from the outline to the nearest thing, person or border; 0 in contact.
double ClearanceNow(const Traffic& traffic, const ArenaRoad& road) {
  const Footprint ego = BoxOf(traffic, 0);
  const double heading = traffic.now.heading_error[0], half_length = 0.5 * ego.length;
  const double y = traffic.now.d[0] - half_length * std::sin(heading);
  const double extent = half_length * std::abs(std::sin(heading)) + 0.5 * ego.width * std::cos(heading);
  double clearance = std::max(0.0, road.half_width - std::abs(y) - extent);
  for (std::size_t i = 1; i < traffic.size(); ++i) {
    const Footprint other = BoxOf(traffic, i);
    const double reach = ego.length + other.length + other.width + clearance;
    if (std::hypot(other.front.x - ego.front.x, other.front.y - ego.front.y) > reach) continue;
    clearance = std::min(clearance, Distance(ego, other));
  }
  return clearance;
}

/// One line that tells how many drives are done, on a terminal.
class DriveProgress {
 public:
  DriveProgress(std::int64_t all, bool quiet) : all_(all), shown_(!quiet && isatty(STDERR_FILENO) != 0) {}
  ~DriveProgress() {
    if (shown_) fmt::print(stderr, "\r{:60}\r", "");
  }
  void Done() {
    const std::int64_t done = ++done_;
    if (!shown_ || omp_get_thread_num() != 0) return;
    const auto now = std::chrono::steady_clock::now();
    if (now - last_ < std::chrono::milliseconds(500)) return;
    last_ = now;
    const double left = std::chrono::duration<double>(now - start_).count() *
                        static_cast<double>(all_ - done) / static_cast<double>(done);
    fmt::print(stderr, "\rarena: {} of {} drives, {:.0f} s left   ", done, all_, left);
  }

 private:
  std::int64_t all_;
  bool shown_;
  std::atomic<std::int64_t> done_{0};
  std::chrono::steady_clock::time_point start_{std::chrono::steady_clock::now()}, last_{start_};
};

}  // namespace

Arena::Arena() {
  const std::filesystem::path config = FindShippedScenario("arena");
  network_ = LoadRoadNetwork(ReadSumoConfig(config).net_file);
  CurveFitParams fit;
  curves_ = FitLaneCurves(network_, fit);
  const EdgeIndex edge = network_.FindEdge("arena");
  if (edge == kNone)
    throw ConfigError(fmt::format("{}: no edge 'arena'; the fields need one", config.string()));
  const Lane& lane = network_.lanes[network_.edges[edge].first_lane];
  road_.length = lane.length;
  road_.half_width = 0.5 * lane.width;
  // The car of the arena's demand.
  vehicle_.length = 4.7;
  vehicle_.width = 1.84;
  vehicle_.max_accel = 2.8;
  AxlesAndActuators("passenger", &vehicle_);
}

DriveResult Arena::Drive(const ArenaField& field, Policy policy, const ArenaConfig& config,
                         std::int64_t number) const {
  return Drive(field, policy, config, number, [](double, const Traffic&) {});
}

DriveResult Arena::Drive(const ArenaField& field, Policy policy, const ArenaConfig& config,
                         std::int64_t number,
                         const std::function<void(double, const Traffic&)>& observe) const {
  const EdgeIndex edge = network_.FindEdge("arena");
  const RoutePlan plan(network_, {edge}, VehicleClassBit("passenger"));
  AgentPipeline pipeline(network_, curves_, config.params);
  pipeline.avoider().SetTables(config.bp, config.bls);
  pipeline.avoider().SetSeed(config.seed);
  Traffic traffic;
  Commands commands;
  const std::vector<std::uint8_t> guarded(1, 0);
  Populate(network_, plan, road_, vehicle_, field, policy, number, &traffic);
  const LaneCurve& curve = curves_[network_.edges[edge].first_lane];
  const double dt = config.step_length;
  DriveResult result;
  result.clearance = road_.half_width;
  double standing = 0.0;
  for (std::int64_t step = 0;; ++step) {
    const double time = static_cast<double>(step) * dt;
    PlaceField(curve, field, time, &traffic);
    pipeline.UpdatePoses(&traffic);
    observe(time, traffic);
    result.time = time;
    result.at_s = traffic.now.s[0];
    result.clearance = std::min(result.clearance, ClearanceNow(traffic, road_));
    standing = traffic.now.speed[0] < kStoppedSpeed && time > 2.0 ? standing + dt : 0.0;
    if (result.clearance <= 0.0) {
      result.end = DriveEnd::kContact;
      return result;
    }
    if (result.at_s >= road_.goal) {
      result.end = DriveEnd::kReached;
      return result;
    }
    if (time >= kMaxTime || standing >= kStoppedTime) return result;
    pipeline.Step(dt, guarded, &traffic, &commands);
    std::swap(traffic.now, traffic.next);
  }
}

ArenaResults RunArena(const Arena& arena, const ArenaConfig& config) {
  ArenaResults results;
  const auto kinds = config.kinds.size(), policies = config.policies.size();
  const auto count = static_cast<std::size_t>(config.count);
  results.passable.assign(kinds, std::vector<std::uint8_t>(count));
  results.drives.assign(kinds,
                        std::vector<std::vector<DriveResult>>(policies, std::vector<DriveResult>(count)));
  DriveProgress progress(static_cast<std::int64_t>(kinds * policies * count), config.quiet);
  for (std::size_t k = 0; k < kinds; ++k) {
#pragma omp parallel for schedule(dynamic, 1)
    for (std::size_t n = 0; n < count; ++n) {
      const std::int64_t number = config.first + static_cast<std::int64_t>(n);
      const ArenaField field = MakeField(config.kinds[k], config.seed, number, arena.road());
      results.passable[k][n] = IsPassable(field, arena.road(), arena.vehicle(), config.clearance);
      for (std::size_t p = 0; p < policies; ++p) {
        results.drives[k][p][n] = arena.Drive(field, config.policies[p], config, number);
        progress.Done();
      }
    }
  }
  return results;
}

ArenaTally Tally(const std::vector<std::uint8_t>& passable, const std::vector<DriveResult>& drives) {
  ArenaTally tally;
  tally.least_clearance = 1e9;
  for (std::size_t n = 0; n < drives.size(); ++n) {
    const DriveResult& drive = drives[n];
    ++tally.fields;
    tally.passable += passable[n];
    tally.contacts += drive.end == DriveEnd::kContact;
    tally.stopped += drive.end == DriveEnd::kStopped;
    if (drive.end != DriveEnd::kReached) continue;
    ++tally.reached;
    tally.reached_passable += passable[n];
    tally.mean_clearance += drive.clearance;
    tally.least_clearance = std::min(tally.least_clearance, drive.clearance);
    tally.mean_time += drive.time;
  }
  if (tally.reached > 0) {
    tally.mean_clearance /= static_cast<double>(tally.reached);
    tally.mean_time /= static_cast<double>(tally.reached);
  } else {
    tally.least_clearance = 0.0;
  }
  return tally;
}

namespace {

template <class Names>
std::size_t IndexOf(const std::string& name, const Names& names, std::string_view option) {
  const auto it = std::find(std::begin(names), std::end(names), name);
  if (it == std::end(names))
    throw ConfigError(
        fmt::format("{}: unknown value '{}'; allowed: {}", option, name, fmt::join(names, ", ")));
  return static_cast<std::size_t>(it - std::begin(names));
}

struct ArenaOptions {
  std::vector<std::string> kinds, policies{"dwa", "bp_dwa", "bp", "bls", "apf"}, assignments;
  std::string params_file, csv, trace, bp_weights, bls_weights;
  ArenaConfig config;
};

ArenaConfig Finish(const ArenaOptions& options) {
  ArenaConfig config = options.config;
  config.bp = TableOf(options.bp_weights.empty() ? DefaultBpNet() : LoadBpNet(options.bp_weights));
  config.bls = TableOf(options.bls_weights.empty() ? DefaultBlsNet() : LoadBlsNet(options.bls_weights));
  for (const std::string& name : options.kinds)
    config.kinds.push_back(static_cast<FieldKind>(IndexOf(name, kFieldKindNames, "--kind")));
  if (config.kinds.empty()) {
    for (int k = 0; k < kFieldKinds; ++k) config.kinds.push_back(static_cast<FieldKind>(k));
  }
  for (const std::string& name : options.policies) {
    const auto policy = static_cast<Policy>(IndexOf(name, kPolicyNames, "--policy"));
    if (policy == Policy::kSumo)
      throw ConfigError("--policy: 'sumo' does not drive in the arena; it knows nothing beside its lane");
    config.policies.push_back(policy);
  }
  if (config.count < 1 || config.count > 1'000'000)
    throw ConfigError(fmt::format("--count is {}; allowed: 1 to 1000000", config.count));
  if (!(config.step_length >= 0.01 && config.step_length <= 1.0))
    throw ConfigError(fmt::format("--step-length is {} s; allowed: 0.01 to 1 s", config.step_length));
  if (!(config.clearance >= 0.0 && config.clearance <= 2.0))
    throw ConfigError(fmt::format("--clearance is {} m; allowed: 0 to 2 m", config.clearance));
  if (config.threads < 0 || config.threads > 1024)
    throw ConfigError(fmt::format("--threads is {}; allowed: 0 (all cores) to 1024", config.threads));
  if (!options.trace.empty() && config.count > 100)
    throw ConfigError(
        fmt::format("--trace with --count {}; allowed: at most 100 fields a kind", config.count));
  RunParams params;
  if (!options.params_file.empty()) LoadParams(options.params_file, &params);
  for (const std::string& assignment : options.assignments) SetParamFromText(assignment, &params);
  config.params = params.agents;
  return config;
}

constexpr std::string_view kEndNames[] = {"reached", "contact", "stopped"};

void WriteCsv(const std::filesystem::path& file, const ArenaConfig& config, const ArenaResults& results) {
  std::FILE* out = std::fopen(file.c_str(), "w");
  if (out == nullptr) throw ConfigError(fmt::format("--csv: {}: cannot be created", file.string()));
  fmt::print(out, "kind,field,passable,policy,end,clearance_m,time_s,position_m\n");
  for (std::size_t k = 0; k < config.kinds.size(); ++k) {
    for (std::size_t n = 0; n < results.passable[k].size(); ++n) {
      for (std::size_t p = 0; p < config.policies.size(); ++p) {
        const DriveResult& drive = results.drives[k][p][n];
        fmt::print(out, "{},{},{},{},{},{:.3f},{:.1f},{:.2f}\n",
                   kFieldKindNames[static_cast<std::size_t>(config.kinds[k])],
                   config.first + static_cast<std::int64_t>(n), results.passable[k][n],
                   kPolicyNames[static_cast<std::size_t>(config.policies[p])],
                   kEndNames[static_cast<std::size_t>(drive.end)], drive.clearance, drive.time, drive.at_s);
      }
    }
  }
  std::fclose(out);
}

/// Every step of every drive, and what stood in the field: for plots.
void WriteTrace(const std::filesystem::path& file, const Arena& arena, const ArenaConfig& config) {
  std::FILE* out = std::fopen(file.c_str(), "w");
  if (out == nullptr) throw ConfigError(fmt::format("--trace: {}: cannot be created", file.string()));
  fmt::print(out, "kind,field,policy,time_s,object,x_m,y_m,heading_rad,length_m,width_m,speed_mps\n");
  for (const FieldKind kind : config.kinds) {
    for (std::int64_t n = config.first; n < config.first + config.count; ++n) {
      const ArenaField field = MakeField(kind, config.seed, n, arena.road());
      for (const Policy policy : config.policies) {
        arena.Drive(field, policy, config, n, [&](double time, const Traffic& traffic) {
          // Things stand: once is enough.
          for (std::size_t i = 0; i < traffic.size(); ++i) {
            if (i > 0 && i <= field.things.size() && time > 0.0) continue;
            const Footprint box = BoxOf(traffic, i);
            fmt::print(out, "{},{},{},{:.2f},{},{:.3f},{:.3f},{:.4f},{:.2f},{:.2f},{:.3f}\n",
                       kFieldKindNames[static_cast<std::size_t>(kind)], n,
                       kPolicyNames[static_cast<std::size_t>(policy)], time, i, box.front.x, box.front.y,
                       box.front.heading, box.length, box.width, traffic.now.speed[i]);
          }
        });
      }
    }
  }
  std::fclose(out);
}

int RunCommand(const ArenaOptions& options) {
  const ArenaConfig config = Finish(options);
  omp_set_num_threads(config.threads > 0
                          ? config.threads
                          : static_cast<int>(std::max(1u, std::thread::hardware_concurrency())));
  const Arena arena;
  const auto start = std::chrono::steady_clock::now();
  const ArenaResults results = RunArena(arena, config);
  const double wall = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  fmt::print(
      "{} fields a kind, seed {}; passable: a way with {} m of clearance exists\n\n"
      "{:<17} {:<7} {:>8} {:>8} {:>19} {:>9} {:>8} {:>16} {:>9}\n",
      config.count, config.seed, config.clearance, "kind", "policy", "fields", "passable", "of these reached",
      "contacts", "stopped", "clearance [m]", "time [s]");
  for (std::size_t k = 0; k < config.kinds.size(); ++k) {
    for (std::size_t p = 0; p < config.policies.size(); ++p) {
      const ArenaTally t = Tally(results.passable[k], results.drives[k][p]);
      fmt::print("{:<17} {:<7} {:>8} {:>8} {:>9} {:>7.2f} % {:>9} {:>8} {:>6.2f} (> {:.2f}) {:>9.1f}\n",
                 kFieldKindNames[static_cast<std::size_t>(config.kinds[k])],
                 kPolicyNames[static_cast<std::size_t>(config.policies[p])], t.fields, t.passable,
                 t.reached_passable,
                 t.passable > 0
                     ? 100.0 * static_cast<double>(t.reached_passable) / static_cast<double>(t.passable)
                     : 0.0,
                 t.contacts, t.stopped, t.mean_clearance, t.least_clearance, t.mean_time);
    }
  }
  fmt::print(
      "\nclearance: mean (least) of the drives that reached the goal; contacts and stopped: of all fields; "
      "{:.1f} s\n",
      wall);
  if (!options.csv.empty()) WriteCsv(options.csv, config, results);
  if (!options.trace.empty()) WriteTrace(options.trace, arena, config);
  return 0;
}

}  // namespace

std::function<int()> AddArenaCommand(CLI::App* app) {
  CLI::App* arena = app->add_subcommand(
      "arena",
      "Drive one car through random obstacle fields and compare policies: success, contacts, clearance");
  auto options = std::make_shared<ArenaOptions>();
  arena
      ->add_option(
          "--kind", options->kinds,
          fmt::format("kinds of fields, comma-separated: {}; default: all", fmt::join(kFieldKindNames, ", ")))
      ->delimiter(',');
  arena->add_option("--policy", options->policies, "policies, comma-separated")
      ->delimiter(',')
      ->capture_default_str();
  arena->add_option("--count", options->config.count, "fields a kind")->capture_default_str();
  arena->add_option("--first", options->config.first, "number of the first field, to look at one again")
      ->capture_default_str();
  arena->add_option("--seed", options->config.seed, "of the fields and of the lidar's errors")
      ->capture_default_str();
  arena
      ->add_option("--clearance", options->config.clearance,
                   "[m] to everything, with which a way must exist for a field to be called passable")
      ->capture_default_str();
  arena->add_option("--step-length", options->config.step_length, "[s]")->capture_default_str();
  arena->add_option("--threads", options->config.threads, "0 = all cores. The result does not depend on it")
      ->capture_default_str();
  arena->add_option("--config", options->params_file,
                    "TOML file with parameters; `lanewise params` lists them");
  arena->add_option("--set", options->assignments,
                    "one parameter, e.g. --set sector.turn_speed=2; may be repeated");
  arena->add_option("--bp-weights", options->bp_weights,
                    "network of bp and bp_dwa (`lanewise train bp`); default: the one shipped");
  arena->add_option("--bls-weights", options->bls_weights,
                    "network of bls (`lanewise train bls`); default: the one shipped");
  arena->add_option("--csv", options->csv, "file for one row a drive");
  arena->add_option(
      "--trace", options->trace,
      "file for every step of every drive (object 0 is the car; poses are of front middles); at most 100 "
      "fields a kind");
  arena->add_flag("-q,--quiet", options->config.quiet, "no progress line");
  arena->footer(
      "Examples:\n"
      "  lanewise arena --count 1000 --policy dwa,bp_dwa\n"
      "  lanewise arena --kind corridor,walls --policy bp --csv corridor.csv\n"
      "  lanewise arena --kind boxes --policy dwa --first 17 --count 1   (field 17 again)");
  return [options] { return RunCommand(*options); };
}

}  // namespace lanewise
