#include "scenarios/ssm_bench.h"

#include <SQLiteCpp/SQLiteCpp.h>
#include <fmt/core.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <map>
#include <pugixml.hpp>
#include <vector>

#include "agents/core/check.h"
#include "scenarios/run.h"

namespace lanewise {
namespace {

namespace fs = std::filesystem;

constexpr double kTtcTolerance = 0.05;  // [s]
constexpr double kPairGap = 2.0;        // [s] as SafetyParams::separation_time.
constexpr double kFollower = 2.0;       // SUMO's code of an ego that follows.

/// A stretch of time during which device.ssm saw a pair follow each other with a TTC below the threshold.
struct SumoEncounter {
  std::string follower, leader;
  double begin{0.0}, end{0.0};  // [s]
  double min_ttc{1e9}, min_ttc_time{0.0};
  double ttc_before{1e9}, ttc_after{1e9};  // [s] one step before and after the smallest.
  double max_drac{0.0};                    // [m/s^2]
};

struct OurEncounter {
  std::string follower, leader;
  double begin, end, min_ttc, max_drac;
  std::string type;
};

std::vector<double> Numbers(const char* text) {
  std::vector<double> values;
  while (*text != '\0') {
    char* end = nullptr;
    const double value = std::strtod(text, &end);
    if (end == text) {  // NA: nothing there.
      values.push_back(1e9);
      while (*text != '\0' && *text != ' ') ++text;
    } else {
      values.push_back(value);
      text = end;
    }
    while (*text == ' ') ++text;
  }
  return values;
}

/// Cuts SUMO's conflicts, which run on while the pair is near, into stretches below the threshold. It logs
/// every pair twice, once a side; the follower's is taken. `shift` [s]: from SUMO's time of a step to its
/// end.
std::vector<SumoEncounter> ReadSumo(const fs::path& file, double threshold, double shift) {
  pugi::xml_document document;
  const pugi::xml_parse_result result = document.load_file(file.c_str());
  if (!result)
    throw ConfigError(
        fmt::format("{}: broken XML at byte {}: {}", file.string(), result.offset, result.description()));
  std::vector<SumoEncounter> encounters;
  for (const pugi::xml_node conflict : document.child("SSMLog").children("conflict")) {
    const std::vector<double> times = Numbers(conflict.child("timeSpan").attribute("values").as_string());
    const std::vector<double> types = Numbers(conflict.child("typeSpan").attribute("values").as_string());
    const std::vector<double> ttcs = Numbers(conflict.child("TTCSpan").attribute("values").as_string());
    const std::vector<double> dracs = Numbers(conflict.child("DRACSpan").attribute("values").as_string());
    if (types.size() != times.size() || ttcs.size() != times.size() || dracs.size() != times.size())
      throw ConfigError(fmt::format("{}: a conflict's lists differ in length", file.string()));
    bool open = false;
    for (std::size_t k = 0; k < times.size(); ++k) {
      if (types[k] != kFollower || !(ttcs[k] < threshold)) continue;
      const double time = times[k] + shift;
      if (!open || time - encounters.back().end > kPairGap) {
        encounters.push_back(
            {conflict.attribute("ego").as_string(), conflict.attribute("foe").as_string(), time, time});
        open = true;
      }
      SumoEncounter& e = encounters.back();
      e.end = time;
      if (dracs[k] < 1e9) e.max_drac = std::max(e.max_drac, dracs[k]);
      if (ttcs[k] < e.min_ttc) {
        e.min_ttc = ttcs[k];
        e.min_ttc_time = time;
        e.ttc_before = k > 0 ? ttcs[k - 1] : 1e9;
        e.ttc_after = k + 1 < ttcs.size() ? ttcs[k + 1] : 1e9;
      }
    }
  }
  return encounters;
}

using Pair = std::pair<std::string, std::string>;

std::map<Pair, std::vector<OurEncounter>> ReadOurs(const fs::path& file, std::int64_t run) {
  SQLite::Database database(file.string(), SQLite::OPEN_READONLY);
  SQLite::Statement query(
      database,
      "SELECT f.vehicle_id, l.vehicle_id, begin_s, end_s, COALESCE(min_ttc_s, 1e9), COALESCE(max_drac_mps2, "
      "0.0), e.type FROM encounter e "
      "JOIN vehicle f ON f.run_id = e.run_id AND f.vehicle_number = e.ego_vehicle "
      "JOIN vehicle l ON l.run_id = e.run_id AND l.vehicle_number = e.foe_vehicle "
      "WHERE e.run_id = ? ORDER BY encounter");
  query.bind(1, run);
  std::map<Pair, std::vector<OurEncounter>> encounters;
  while (query.executeStep()) {
    OurEncounter e{query.getColumn(0).getString(), query.getColumn(1).getString(),
                   query.getColumn(2).getDouble(), query.getColumn(3).getDouble(),
                   query.getColumn(4).getDouble(), query.getColumn(5).getDouble(),
                   query.getColumn(6).getString()};
    // Without regard to who is ego: that may differ where one turns off.
    encounters[std::minmax(e.follower, e.leader)].push_back(e);
  }
  return encounters;
}

/// Does the smallest TTC agree within the tolerance, or within what SUMO's own changes in one step?
bool Agrees(const SumoEncounter& sumo, double min_ttc) {
  const double difference = std::abs(min_ttc - sumo.min_ttc);
  if (difference <= kTtcTolerance) return true;
  for (const double neighbor : {sumo.ttc_before, sumo.ttc_after}) {
    if (neighbor < 1e9 && difference <= std::abs(neighbor - sumo.min_ttc)) return true;
  }
  return false;
}

}  // namespace

bool BenchSsm(const RunConfig& config, const std::string& differences_file) {
  const fs::path folder = fs::temp_directory_path() / fmt::format("lanewise-ssm-{}", getpid());
  fs::create_directories(folder);
  RunConfig run = config;
  run.policy = Policy::kSumo;
  run.safety_level = SafetyLevel::kFull;
  run.sample_period = 3600.0;
  if (!run.results) run.results = folder / "ssm.sqlite";
  if (run.sumo_output_folder.empty()) run.sumo_output_folder = folder;
  const fs::path log = folder / "ssm.xml";
  for (const std::string option :
       {"--device.ssm.probability", "1", "--device.ssm.measures", "TTC DRAC PET", "--device.ssm.thresholds",
        "3.0 3.0 2.0", "--device.ssm.trajectories", "true", "--device.ssm.file"})
    run.sumo_options.push_back(option);
  run.sumo_options.push_back(log.string());
  const RunReport report = Run(run);

  const double threshold = run.safety.ttc_encounter;
  // SUMO names a step by its begin, and measures in its middle of it: after the vehicles have moved.
  const std::vector<SumoEncounter> theirs = ReadSumo(log, threshold, run.step_length);
  const auto ours = ReadOurs(*run.results, report.run_id);
  std::ofstream differences;
  if (!differences_file.empty()) {
    differences.open(differences_file);
    if (!differences)
      throw ConfigError(fmt::format("--differences: {}: cannot be written", differences_file));
    differences << "follower,leader,begin_s,end_s,sumo_min_ttc_s,sumo_min_ttc_time_s,lanewise_min_ttc_s,"
                   "lanewise_type\n";
  }
  std::size_t found = 0, agree = 0, drac_agree = 0;
  for (const SumoEncounter& sumo : theirs) {
    const OurEncounter* match = nullptr;
    const auto pair = ours.find(std::minmax(sumo.follower, sumo.leader));
    if (pair != ours.end()) {
      for (const OurEncounter& e : pair->second) {
        const bool overlap = e.begin <= sumo.end + kPairGap && e.end >= sumo.begin - kPairGap;
        if (!overlap || e.min_ttc >= threshold) continue;
        if (match == nullptr || std::abs(e.min_ttc - sumo.min_ttc) < std::abs(match->min_ttc - sumo.min_ttc))
          match = &e;
      }
    }
    found += match != nullptr;
    const bool agrees = match != nullptr && Agrees(sumo, match->min_ttc);
    agree += agrees;
    drac_agree +=
        match != nullptr && std::abs(match->max_drac - sumo.max_drac) <= 0.05 * std::max(1.0, sumo.max_drac);
    if (!agrees && differences.is_open()) {
      differences << fmt::format("{},{},{:.1f},{:.1f},{:.3f},{:.1f},{},{}\n", sumo.follower, sumo.leader,
                                 sumo.begin, sumo.end, sumo.min_ttc, sumo.min_ttc_time,
                                 match == nullptr ? "" : fmt::format("{:.3f}", match->min_ttc),
                                 match == nullptr ? "" : match->type);
    }
  }
  if (theirs.empty()) {
    fmt::print(
        "{}: device.ssm saw no following with TTC < {} s within {:.0f} s: nothing to compare; let it run "
        "longer\n",
        config.scenario, threshold, report.outcome.simulated_time);
    return false;
  }
  const auto share = [&](std::size_t count) {
    return 100.0 * static_cast<double>(count) / static_cast<double>(theirs.size());
  };
  const bool ok_found = share(found) >= 98.0, ok_ttc = share(agree) >= 98.0;
  fmt::print("\n{} seed {}, native, {:.0f} s; following encounters with TTC < {} s\n\n", config.scenario,
             config.seed, report.outcome.simulated_time, threshold);
  fmt::print("{:<52} {:>8}\n", "seen by SUMO's device.ssm", theirs.size());
  fmt::print("{:<52} {:>8} {:>7.2f} %   >= 98 %  {}\n", "found by Lanewise too", found, share(found),
             ok_found ? "ok" : "MISSED");
  fmt::print("{:<52} {:>8} {:>7.2f} %   >= 98 %  {}\n", "  smallest TTC within 0.05 s or one step", agree,
             share(agree), ok_ttc ? "ok" : "MISSED");
  fmt::print("{:<52} {:>8} {:>7.2f} %\n", "  largest DRAC within 5 % or 0.05 m/s^2", drac_agree,
             share(drac_agree));
  std::error_code ignored;
  fs::remove_all(folder, ignored);
  return ok_found && ok_ttc;
}

}  // namespace lanewise
