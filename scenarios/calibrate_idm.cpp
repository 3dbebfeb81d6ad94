#include <fmt/core.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cmath>
#include <map>
#include <memory>
#include <string>

#include "agents/core/check.h"
#include "analysis/idm_calibration.h"
#include "scenarios/calibrate.h"
#include "scenarios/plot.h"

namespace lanewise {
namespace {

struct IdmOptions {
  std::vector<std::string> files, vtypes, fixed;
  std::string by{"all"}, output, residuals, plot;
  FollowingOptions following;
  IdmFitOptions fit;
  int hold_out{5};
  bool force{false};
};

void CheckRange(const char* option, double value, double min, double max) {
  if (!(value >= min && value <= max))
    throw ConfigError(fmt::format("{}: {}; allowed: {} to {}", option, value, min, max));
}

/// "v0=13.9" into the options of the fit.
void Fix(const std::string& text, IdmFitOptions* fit) {
  const std::size_t equals = text.find('=');
  std::string names;
  for (int k = 0; k < kIdmParams; ++k) {
    const IdmParamInfo& info = kIdmParamInfo[k];
    names += fmt::format("{}{}", k == 0 ? "" : ", ", info.name);
    if (equals == std::string::npos || text.substr(0, equals) != info.name) continue;
    double value = 0.0;
    const char *begin = text.data() + equals + 1, *last = text.data() + text.size();
    const auto [end, error] = std::from_chars(begin, last, value);
    if (error != std::errc{} || end != last || !(value >= info.min && value <= info.max))
      throw ConfigError(
          fmt::format("--fix: {}: allowed: {} to {} [{}]", text, info.min, info.max, info.unit));
    fit->fixed[k] = true;
    fit->start[k] = value;
    return;
  }
  throw ConfigError(fmt::format("--fix: {}: needed: NAME=VALUE with one of {}", text, names));
}

void Check(IdmOptions* o) {
  if (o->by != "all" && o->by != "type" && o->by != "vehicle")
    throw ConfigError(fmt::format("--by: unknown value '{}'; allowed: all, type, vehicle", o->by));
  CheckRange("--max-gap", o->following.max_gap, 1.0, 1000.0);
  CheckRange("--min-duration", o->following.min_duration, 0.5, 3600.0);
  CheckRange("--min-distance", o->following.min_distance, 0.0, 1e5);
  CheckRange("--max-interval", o->following.max_interval, 0.01, 60.0);
  CheckRange("--max-jump", o->following.max_jump, 0.01, 1000.0);
  CheckRange("--length", o->following.length, 0.1, 1000.0);
  CheckRange("--hold-out", o->hold_out, 0, 1000);
  if (o->hold_out == 1)
    throw ConfigError("--hold-out: 1; it would leave nothing to fit to; allowed: 0, 2 ...");
  for (const std::string& text : o->fixed) Fix(text, &o->fit);
  CheckOutputFile("--output", o->output, o->force);
  CheckOutputFile("--residuals", o->residuals, o->force);
  CheckPlotFile("--plot", o->plot, o->force);
  for (const std::string& file : o->vtypes) o->following.lengths.merge(LoadTypeLengths(file));
}

/// How far work is, on stderr, from its third second on.
class WorkLine {
 public:
  ~WorkLine() {
    if (any_ && isatty(STDERR_FILENO) != 0) fmt::print(stderr, "\r\x1b[K");
  }
  void operator()(const std::string& text) {
    const bool terminal = isatty(STDERR_FILENO) != 0;
    const auto now = std::chrono::steady_clock::now();
    if (now - shown_ < std::chrono::seconds(any_ && !terminal ? 10 : 2)) return;
    shown_ = now;
    any_ = true;
    fmt::print(stderr, "{}{}{}", terminal ? "\r\x1b[K" : "", text, terminal ? "" : "\n");
    std::fflush(stderr);
  }

 private:
  std::chrono::steady_clock::time_point shown_{std::chrono::steady_clock::now()};
  bool any_{false};
};

std::vector<FollowingEpisode> LoadAll(const IdmOptions& o) {
  std::vector<FollowingEpisode> episodes;
  for (const std::string& file : o.files) {
    WorkLine line;
    FollowingData data = LoadFollowing(file, o.following, [&](double part) {
      line(fmt::format("reading {}: {:.0f} %", file, 100.0 * part));
    });
    fmt::print(
        "{}: {} rows of {} vehicles, {:g} to {:g} s; leaders {}; {} stretches of following, {} shorter ones "
        "left out, {} ended by a jump of the gap\n",
        file, data.rows, data.vehicles, data.begin, data.end,
        data.leaders_named ? "as the file names them" : "found on the lanes", data.episodes.size(),
        data.too_short, data.jumps);
    if (data.unknown_lengths > 0)
      fmt::print("  {} gaps use the length {:g} m: no length of the leader's type is known (--vtypes)\n",
                 data.unknown_lengths, o.following.length);
    for (FollowingEpisode& episode : data.episodes) episodes.push_back(std::move(episode));
  }
  if (episodes.empty())
    throw ConfigError(fmt::format(
        "{}: no vehicle follows another one for {:g} s and {:g} m within {:g} m; --min-duration, "
        "--min-distance and --max-gap say what counts",
        o.files.front(), o.following.min_duration, o.following.min_distance, o.following.max_gap));
  return episodes;
}

using Episodes = std::vector<const FollowingEpisode*>;

struct Group {
  std::string name;
  Episodes fitted, held_out;
  IdmFit fit;
  double held_out_rms{0.0}, held_out_start_rms{0.0};
};

/// Every hold_out-th vehicle of a group, in the order in which they occur, is held out, if there are enough.
std::vector<Group> GroupsOf(const std::vector<FollowingEpisode>& episodes, const IdmOptions& o) {
  std::vector<Group> groups;
  std::map<std::string, std::size_t> index;
  for (const FollowingEpisode& episode : episodes) {
    const std::string name = o.by == "all" ? "all" : o.by == "type" ? episode.type : episode.vehicle;
    const auto [it, is_new] = index.emplace(name, groups.size());
    if (is_new) groups.push_back({name, {}, {}, {}});
    groups[it->second].fitted.push_back(&episode);
  }
  for (Group& group : groups) {
    std::map<std::string_view, int> number;
    for (const FollowingEpisode* episode : group.fitted)
      number.emplace(episode->vehicle, static_cast<int>(number.size()));
    if (o.hold_out == 0 || static_cast<int>(number.size()) < 2 * o.hold_out) continue;
    Episodes all;
    all.swap(group.fitted);
    for (const FollowingEpisode* episode : all) {
      const bool held_out = number[episode->vehicle] % o.hold_out == o.hold_out - 1;
      (held_out ? group.held_out : group.fitted).push_back(episode);
    }
  }
  return groups;
}

std::string StateText(const IdmFit& fit, int k) {
  switch (fit.state[k]) {
    case IdmParamState::kFixed:
      return "fixed";
    case IdmParamState::kAtBound:
      return "at the end of its range: these data do not bound it";
    case IdmParamState::kUndetermined:
      return "not told apart from others by these data";
    case IdmParamState::kFree:
      break;
  }
  if (fit.half_width[k] == 0.0) return "one vehicle only: no interval";
  const std::string interval =
      fmt::format("{:.3f} to {:.3f}", fit.values[k] - fit.half_width[k], fit.values[k] + fit.half_width[k]);
  return fit.half_width[k] > 0.5 * fit.values[k] ? interval + "  (hardly determined)" : interval;
}

void PrintGroup(const Group& group, const IdmOptions& o) {
  const IdmFit& fit = group.fit;
  fmt::print("\n{}: {} vehicles, {} stretches, {} gaps{}\n", group.name, fit.vehicles, fit.episodes, fit.rows,
             fit.converged ? "" : "; NOT CONVERGED");
  fmt::print("{:<4} {:<26} {:>9} {:<6} {:>10} {:>14}  {}\n", "", "", "value", "", "std. error",
             "if independent", "95 % interval");
  for (int k = 0; k < kIdmParams; ++k) {
    const auto error = [](double value) { return value > 0.0 ? fmt::format("{:.4f}", value) : "-"; };
    fmt::print("{:<4} {:<26} {:>9.4f} {:<6} {:>10} {:>14}  {}\n", kIdmParamInfo[k].name,
               kIdmParamInfo[k].meaning, fit.values[k], kIdmParamInfo[k].unit, error(fit.error[k]),
               error(fit.independent_error[k]), StateText(fit, k));
  }
  fmt::print(
      "gap, simulated against recorded: root mean square {:.3f} m (before the fit: {:.3f}), mean {:+.3f} m\n",
      fit.rms_error, fit.start_rms_error, fit.mean_error);
  if (!group.held_out.empty())
    fmt::print(
        "held out, every {}th vehicle, {} stretches: root mean square {:.3f} m (before the fit: {:.3f})\n",
        o.hold_out, group.held_out.size(), group.held_out_rms, group.held_out_start_rms);
  std::string strong;
  for (int i = 0; i < kIdmParams; ++i) {
    for (int j = i + 1; j < kIdmParams; ++j) {
      const double r = fit.correlation[i][j];
      if (std::abs(r) >= 0.7)
        strong += fmt::format("{} {} with {}: {:+.2f}", strong.empty() ? "" : ",", kIdmParamInfo[i].name,
                              kIdmParamInfo[j].name, r);
    }
  }
  if (!strong.empty()) fmt::print("estimates that trade off against each other (correlation):{}\n", strong);
}

std::string VTypeText(const std::string& id, const IdmValues& values) {
  return fmt::format(
      "<vType id=\"{}\" carFollowModel=\"IDM\" maxSpeed=\"{:.3f}\" tau=\"{:.3f}\" minGap=\"{:.3f}\" "
      "accel=\"{:.3f}\" decel=\"{:.3f}\"/>",
      id, values[0], values[1], values[2], values[3], values[4]);
}

std::string ParametersCsv(const std::vector<Group>& groups) {
  static constexpr std::array<const char*, kIdmParams> kColumns{"v0_mps", "T_s", "s0_m", "a_mps2", "b_mps2"};
  static constexpr std::array<const char*, 4> kStates{"free", "fixed", "at_bound", "undetermined"};
  std::string text = "group,vehicles,episodes,rows,rms_gap_m,held_out_rms_gap_m,converged";
  for (const char* column : kColumns) text += fmt::format(",{0},{0}_std_error,{0}_state", column);
  text += '\n';
  for (const Group& group : groups) {
    const IdmFit& fit = group.fit;
    text += fmt::format("{},{},{},{},{},{},{}", group.name, fit.vehicles, fit.episodes, fit.rows,
                        fit.rms_error, group.held_out.empty() ? "" : fmt::format("{}", group.held_out_rms),
                        fit.converged ? 1 : 0);
    for (int k = 0; k < kIdmParams; ++k)
      text +=
          fmt::format(",{},{},{}", fit.values[k], fit.error[k] > 0.0 ? fmt::format("{}", fit.error[k]) : "",
                      kStates[static_cast<std::size_t>(fit.state[k])]);
    text += '\n';
  }
  return text;
}

std::string ResidualsCsv(const std::vector<Group>& groups) {
  std::string text = "group,vehicle,leader,held_out,time_s,gap_m,simulated_gap_m\n";
  std::vector<double> gap;
  for (const Group& group : groups) {
    for (const Episodes* part : {&group.fitted, &group.held_out}) {
      for (const FollowingEpisode* e : *part) {
        gap.resize(e->time.size());
        SimulateIdmGaps(*e, group.fit.values, gap);
        for (std::size_t k = 0; k < gap.size(); ++k)
          text += fmt::format("{},{},{},{},{:.6g},{:.4f},{:.4f}\n", group.name, e->vehicle, e->leader,
                              part == &group.held_out ? 1 : 0, e->time[k], e->gap[k], gap[k]);
      }
    }
  }
  return text;
}

/// The longest stretch of following and the two whose error is the median and the 95th percentile.
void DrawGaps(const std::string& file, const Group& group) {
  Episodes order = group.fitted;
  std::map<const FollowingEpisode*, double> error;
  for (const FollowingEpisode* e : order) error[e] = GapRmsError({&e, 1}, group.fit.values);
  std::stable_sort(order.begin(), order.end(),
                   [&](const auto* a, const auto* b) { return error[a] < error[b]; });
  const auto longest = std::max_element(order.begin(), order.end(), [](const auto* a, const auto* b) {
    return a->time.back() - a->time.front() < b->time.back() - b->time.front();
  });
  const std::size_t last = order.size() - 1;
  const std::array<std::pair<const char*, const FollowingEpisode*>, 3> shown{
      {{"the longest stretch", *longest},
       {"median error", order[last / 2]},
       {"95th percentile of the errors", order[last * 95 / 100]}}};
  std::vector<PlotPanel> panels;
  for (const auto& [what, e] : shown) {
    std::vector<double> gap(e->time.size());
    SimulateIdmGaps(*e, group.fit.values, gap);
    panels.push_back(
        {fmt::format("{}: {} behind {}, root mean square {:.2f} m", what, e->vehicle, e->leader, error[e]),
         "time [s]",
         "gap [m]",
         false,
         false,
         {{"recorded", e->time, e->gap, false}, {"IDM", e->time, gap, true}}});
  }
  DrawPlot(file, panels);
}

int RunCalibrateIdm(IdmOptions o) {
  Check(&o);
  const std::vector<FollowingEpisode> episodes = LoadAll(o);
  std::vector<Group> groups = GroupsOf(episodes, o);
  bool converged = true;
  for (Group& group : groups) {
    {
      WorkLine line;
      o.fit.progress = [&](int iteration, double rms) {
        line(fmt::format("fitting {}: iteration {}, {:.3f} m", group.name, iteration, rms));
      };
      group.fit = FitIdm(group.fitted, o.fit);
    }
    group.held_out_rms = GapRmsError(group.held_out, group.fit.values);
    group.held_out_start_rms = GapRmsError(group.held_out, o.fit.start);
    converged = converged && group.fit.converged;
    PrintGroup(group, o);
    fmt::print("{}\n", VTypeText(group.name == "all" ? "calibrated" : group.name, group.fit.values));
  }
  fmt::print(
      "\nStandard errors take the vehicles as independent, the gaps of one vehicle not; \"if independent\" "
      "takes all gaps as independent and is too small.\n");
  if (!o.output.empty()) WriteTextFile(o.output, ParametersCsv(groups));
  if (!o.residuals.empty()) WriteTextFile(o.residuals, ResidualsCsv(groups));
  if (!o.plot.empty()) DrawGaps(o.plot, groups.front());
  return converged ? 0 : 1;
}

}  // namespace

void AddCalibrateIdm(CLI::App* calibrate, std::function<int()>* chosen) {
  const auto o = std::make_shared<IdmOptions>();
  CLI::App* idm = calibrate->add_subcommand(
      "idm",
      "Fit the Intelligent Driver Model to trajectories: gaps of whole simulated stretches of following");
  idm->add_option("FILES", o->files,
                  "SUMO fcd output as XML or CSV, gzipped or not. CSV: columns time, id, speed (or "
                  "timestep_time, vehicle_id, vehicle_speed ...) and lane, pos, or leaderID, leaderGap, "
                  "leaderSpeed; optional: type, length; separated by ; or ,")
      ->required();
  idm->add_option("--by", o->by, "one fit for: all, each type, each vehicle")->capture_default_str();
  idm->add_option("--fix", o->fixed,
                  "keep a parameter (v0, T, s0, a, b), e.g. --fix v0=13.9; may be repeated");
  idm->add_option("--vtypes", o->vtypes,
                  "route or additional file with the vTypes' lengths, for files that name no leaders; may be "
                  "repeated");
  idm->add_option("--length", o->following.length, "of leaders whose length nothing tells [m]")
      ->capture_default_str();
  idm->add_option("--max-gap", o->following.max_gap, "beyond it nobody is followed [m]")
      ->capture_default_str();
  idm->add_option("--min-duration", o->following.min_duration, "of a stretch of following [s]")
      ->capture_default_str();
  idm->add_option("--min-distance", o->following.min_distance, "driven in a stretch [m]")
      ->capture_default_str();
  idm->add_option("--max-interval", o->following.max_interval, "between the rows of a stretch [s]")
      ->capture_default_str();
  idm->add_option("--max-jump", o->following.max_jump,
                  "by which a gap may differ from what the speeds make of the one before [m]; more ends a "
                  "stretch")
      ->capture_default_str();
  idm->add_option("--hold-out", o->hold_out,
                  "every so many-th vehicle is left out of the fit and tests it; 0 = none")
      ->capture_default_str();
  idm->add_option("-o,--output", o->output, "the parameters as CSV, one row per group");
  idm->add_option("--residuals", o->residuals, "recorded and simulated gaps as CSV");
  idm->add_option("--plot", o->plot,
                  "recorded and simulated gaps of three stretches as .svg, .png or .pdf; needs gnuplot");
  idm->add_flag("--force", o->force, "replace output files that exist");
  idm->footer(
      "Examples:\n"
      "  sumo -c my.sumocfg --fcd-output fcd.xml.gz --fcd-output.max-leader-distance 100\n"
      "  lanewise calibrate idm fcd.xml.gz --plot gaps.svg\n"
      "  lanewise calibrate idm fcd.csv --vtypes types.add.xml --by type -o idm.csv\n"
      "  lanewise calibrate idm fcd.xml --fix v0=13.9          (in dense traffic nothing tells the wanted "
      "speed)\n"
      "Exit code 1: a fit did not converge; what was found is printed all the same.");
  idm->callback([o, chosen] { *chosen = [o] { return RunCalibrateIdm(*o); }; });
}

}  // namespace lanewise
