#include "scenarios/city_bench.h"

#include <fmt/core.h>
#include <sys/resource.h>
#include <unistd.h>

#include <fstream>

#include "agents/traffic.h"
#include "scenarios/contact_places.h"
#include "scenarios/run.h"

namespace lanewise {
namespace {

namespace fs = std::filesystem;

/// [MiB] resident memory now.
double ResidentMemory() {
  std::ifstream statm("/proc/self/statm");
  double total = 0.0, resident = 0.0;
  statm >> total >> resident;
  return resident * static_cast<double>(sysconf(_SC_PAGESIZE)) / 1048576.0;
}

double MicrosecondsPerVehicleStep(const RunReport& report) {
  return 1e6 * report.outcome.wall_time /
         static_cast<double>(std::max<std::int64_t>(1, report.outcome.vehicle_steps));
}

struct Table {
  bool passed{true};
  void Row(const char* name, const std::string& native, const std::string& agents, const std::string& target,
           bool ok) {
    fmt::print("{:<44} {:>14} {:>14}   {:<28} {}\n", name, native, agents, target, ok ? "ok" : "MISSED");
    passed = passed && ok;
  }
};

void PrintContactPlaces(const std::vector<ContactPlace>& places) {
  if (places.empty()) return;
  fmt::print(
      "\nContacts with an agent striking, by the lanes of the two fronts:\n{:>8} {:>11} {:>14}  lanes\n",
      "contacts", "deepest [m]", "lanes apart [m]");
  for (const ContactPlace& place : places) {
    fmt::print("{:>8} {:>11.3f} {:>14.2f}  {} and {}{}\n", place.contacts, place.max_depth,
               place.lane_distance, place.first_lane, place.second_lane,
               place.shapes_overlap() ? ": the network's shapes overlap, and nobody has to yield" : "");
  }
}

}  // namespace

bool BenchCity(const RunConfig& config, const std::vector<int>& thread_counts) {
  // Both runs go into one results file; the bench's own unless the user wants to keep it.
  const fs::path folder = fs::temp_directory_path() / fmt::format("lanewise-bench-{}", getpid());
  fs::create_directories(folder);
  RunConfig native = config;
  if (!native.results) native.results = folder / "bench.sqlite";
  if (native.sumo_output_folder.empty()) native.sumo_output_folder = folder;
  RunConfig agents = native;
  native.policy = Policy::kSumo;
  const RunReport native_report = Run(native);
  const double memory_before = ResidentMemory();
  const RunReport report = Run(agents);
  const double memory_after = ResidentMemory();

  RunSummary n, a;
  for (const RunSummary& summary : LoadRunSummaries(*native.results)) {
    if (summary.run_id == native_report.run_id) n = summary;
    if (summary.run_id == report.run_id) a = summary;
  }
  const auto count = [](std::int64_t value) { return fmt::format("{}", value); };
  const std::int64_t n_in_junctions = n.collisions_in_junctions.value_or(0),
                     a_in_junctions = a.collisions_in_junctions.value_or(0),
                     a_striking = a.agent_striking_outside_junctions.value_or(0);
  fmt::print("\n{} seed {}, step {} s, {} threads, rules = {}\n\n", config.scenario, config.seed,
             config.step_length, config.threads == 0 ? "all" : fmt::format("{}", config.threads),
             kRulesNames[static_cast<std::size_t>(config.rules)]);
  fmt::print("{:<44} {:>14} {:>14}   {:<28}\n", "", "sumo",
             kPolicyNames[static_cast<std::size_t>(config.policy)], "target");
  Table table;
  table.Row("arrived", count(n.arrived), count(a.arrived), ">= 99 % of native",
            static_cast<double>(a.arrived) >= 0.99 * static_cast<double>(n.arrived));
  const double loss_n = n.mean_time_loss.value_or(0.0), loss_a = a.mean_time_loss.value_or(0.0);
  table.Row("mean time loss [s]", fmt::format("{:.1f}", loss_n), fmt::format("{:.1f}", loss_a),
            "<= 1.15 x native", loss_a <= 1.15 * loss_n);
  table.Row("mean trip [s]", fmt::format("{:.1f}", n.mean_duration.value_or(0.0)),
            fmt::format("{:.1f}", a.mean_duration.value_or(0.0)), "", true);
  table.Row("teleports", count(native_report.outcome.teleported), count(report.outcome.teleported), "0",
            report.outcome.teleported == 0);
  table.Row("contacts outside junctions", count(n.collisions.value_or(0) - n_in_junctions),
            count(a.collisions.value_or(0) - a_in_junctions), "", true);
  table.Row("  of these with an agent striking", count(n.agent_striking_outside_junctions.value_or(0)),
            count(a_striking), "0", a_striking == 0);
  table.Row("contacts inside junctions", count(n_in_junctions), count(a_in_junctions), "<= native",
            a_in_junctions <= n_in_junctions);
  table.Row("halts at a lane's end for want of a change", "-", count(report.lane_end_halts), "0",
            report.lane_end_halts == 0);
  for (std::size_t k = 0; k < report.rule_events.size(); ++k) {
    const auto kind = static_cast<RuleEventKind>(k);
    const std::int64_t theirs = native_report.rule_events[k], ours = report.rule_events[k];
    const bool red = kind == RuleEventKind::kRedLight, standstill = kind == RuleEventKind::kStandstill;
    table.Row(fmt::format("rules: {}", kRuleEventNames[k]).c_str(), count(theirs), count(ours),
              red          ? "0"
              : standstill ? "<= native"
                           : "",
              red ? ours == 0 : !standstill || ours <= theirs);
  }
  table.Row("detours for want of a lane change", "-", count(report.detours), "", true);
  table.Row("near misses (TTC < 1.5 s)", count(n.near_misses.value_or(0)), count(a.near_misses.value_or(0)),
            "", true);
  table.Row("CO2 [g/km]", fmt::format("{:.1f}", n.co2_g_per_km.value_or(0.0)),
            fmt::format("{:.1f}", a.co2_g_per_km.value_or(0.0)), "", true);
  for (std::size_t i = 0; i < kAuditCauses; ++i) {
    const AuditCount& audit = report.audit.by_cause[i];
    const bool mid_block = i == static_cast<std::size_t>(AuditCause::kMidBlock);
    table.Row(fmt::format("audit {}: different of checked", kAuditCauseNames[i]).c_str(),
              count(audit.different), count(audit.steps), mid_block ? "0 different" : "",
              !mid_block || audit.different == 0);
  }
  table.Row("wall time per vehicle-step [us]",
            fmt::format("{:.2f}", MicrosecondsPerVehicleStep(native_report)),
            fmt::format("{:.2f}", MicrosecondsPerVehicleStep(report)), "", true);
  const auto parts = [](const RunReport& r, double seconds) {
    return fmt::format(
        "{:.2f}", 1e6 * seconds / static_cast<double>(std::max<std::int64_t>(1, r.outcome.vehicle_steps)));
  };
  table.Row("  SUMO's step", parts(native_report, native_report.outcome.sumo_time),
            parts(report, report.outcome.sumo_time), "", true);
  table.Row("  coupling", parts(native_report, native_report.coupling_time),
            parts(report, report.coupling_time), "", true);
  table.Row("  agents", parts(native_report, native_report.agent_time), parts(report, report.agent_time), "",
            true);
  table.Row("  measures and results", parts(native_report, native_report.record_time),
            parts(report, report.record_time), "", true);
  const double ratio = MicrosecondsPerVehicleStep(report) / MicrosecondsPerVehicleStep(native_report);
  table.Row("  ratio to the native run", "1.00", fmt::format("{:.2f}", ratio), "<= 2.5", ratio <= 2.5);
  const double strict = MicrosecondsPerVehicleStep(report) /
                        (1e6 * native_report.outcome.sumo_time /
                         static_cast<double>(std::max<std::int64_t>(1, native_report.outcome.vehicle_steps)));
  table.Row("  ratio to SUMO's step alone", "1.00", fmt::format("{:.2f}", strict), "", true);
  table.Row("agent state per vehicle [B]", "-", count(static_cast<std::int64_t>(AgentStateBytes())),
            "<= 2048", AgentStateBytes() <= 2048);
  table.Row("resident memory after the run [MiB]", fmt::format("{:.0f}", memory_before),
            fmt::format("{:.0f}", memory_after), "", true);

  PrintContactPlaces(FindContactPlaces(*native.results, report.run_id, LoadRoadNetwork(config.net_file)));

  bool same = true;
  std::string hashes = fmt::format("{:016x}", report.outcome.state_hash);
  for (const int threads : thread_counts) {
    RunConfig again = agents;
    again.threads = threads;
    again.results.reset();
    const RunReport repeat = Run(again);
    fmt::print("state hash with {} threads: {:016x}\n", threads, repeat.outcome.state_hash);
    same = same && repeat.outcome.state_hash == report.outcome.state_hash;
  }
  if (!thread_counts.empty())
    table.Row("state hash for every number of threads", "", same ? "identical" : "different", "identical",
              same);
  std::error_code ignored;
  fs::remove_all(folder, ignored);
  return table.passed;
}

}  // namespace lanewise
