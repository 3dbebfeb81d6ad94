#include "scenarios/export.h"

#include <fmt/ranges.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <memory>

#include "agents/core/check.h"
#include "analysis/results_file.h"
#include "analysis/sumo_export.h"

namespace lanewise {
namespace {

namespace fs = std::filesystem;

struct ExportOptions {
  std::string results, run;
  std::string outputs[4];  ///< By ExportTable.
  bool force{false};
};

/// The run asked for; nothing: all of them.
std::optional<std::int64_t> ChooseRun(const ExportOptions& o) {
  const std::vector<RunSummary> runs = LoadRunSummaries(o.results);
  if (runs.empty()) throw ConfigError(fmt::format("results file {}: it holds no runs", o.results));
  if (o.run == "all") return std::nullopt;
  std::vector<std::string> names;
  for (const RunSummary& run : runs) {
    if (o.run == std::to_string(run.run_id) || (o.run.empty() && runs.size() == 1)) {
      if (run.status != "finished")
        fmt::print(stderr, "lanewise: run {} is '{}': what it recorded so far is exported\n", run.run_id,
                   run.status);
      return run.run_id;
    }
    if (names.size() < 10) names.push_back(fmt::format("{} ({}, seed {})", run.run_id, run.policy, run.seed));
  }
  const std::string more =
      runs.size() > names.size() ? fmt::format(" and {} more", runs.size() - names.size()) : "";
  throw ConfigError(fmt::format("--run: {}; allowed: {}{}, or all (CSV)",
                                o.run.empty() ? fmt::format("{} holds {} runs", o.results, runs.size())
                                              : fmt::format("there is no run '{}' in {}", o.run, o.results),
                                fmt::join(names, ", "), more));
}

int RunExport(const ExportOptions& o) {
  bool any = false;
  for (const std::string& output : o.outputs) {
    if (output.empty()) continue;
    any = true;
    CheckExportName(output, o.run == "all");
    if (fs::exists(output) && !o.force)
      throw ConfigError(fmt::format("{}: it exists; --force replaces it", output));
  }
  if (!any)
    throw ConfigError(
        "export: nothing to write; name at least one of --trips, --trajectories, --encounters, --edges");
  const std::optional<std::int64_t> run = ChooseRun(o);
  for (int k = 0; k < 4; ++k) {
    if (o.outputs[k].empty()) continue;
    const auto table = static_cast<ExportTable>(k);
    using Clock = std::chrono::steady_clock;
    Clock::time_point last = Clock::now();
    bool shown = false;
    const std::int64_t rows = ExportResults(o.results, table, run, o.outputs[k], [&](std::int64_t so_far) {
      if (::isatty(STDERR_FILENO) == 0 || Clock::now() - last < std::chrono::seconds(1)) return;
      last = Clock::now();
      shown = true;
      fmt::print(stderr, "\r{}: {} rows", ToString(table), so_far);
    });
    if (shown) fmt::print(stderr, "\r\033[K");
    fmt::print("{}: {} rows in {}\n", ToString(table), rows, o.outputs[k]);
    if (rows == 0)
      fmt::print(stderr, "lanewise: {}: the run{} recorded none; the file holds its head only\n",
                 ToString(table), run ? "" : "s");
  }
  return 0;
}

}  // namespace

void AddExportCommand(CLI::App* app, std::function<int()>* chosen) {
  const auto o = std::make_shared<ExportOptions>();
  CLI::App* command = app->add_subcommand(
      "export", "Results as SUMO's tools and spreadsheets read them: CSV, tripinfo, fcd, ssm, edgeData");
  command->add_option("RESULTS", o->results, "results file (SQLite)")->required();
  command->add_option("--run", o->run,
                      "number of the run, or all (CSV only); may be left out if there is one");
  const char* options[] = {"--trips", "--trajectories", "--encounters", "--edges"};
  const char* meanings[] = {"trips: CSV, or tripinfo XML", "sampled states: CSV, or fcd XML",
                            "encounters: CSV, or ssm XML with both trajectories as spans",
                            "flow, density, speed by edge and interval: CSV, or edgeData XML"};
  for (int k = 0; k < 4; ++k)
    command->add_option(options[k], o->outputs[k], std::string("file for ") + meanings[k]);
  command->add_flag("--force", o->force, "replace files that exist");
  command->footer(
      "The name's ending says the format: .csv, .csv.gz, .xml, .xml.gz. CSV columns are named "
      "element_attribute and\n"
      "separated by ';', as SUMO's xml2csv.py does. Examples:\n"
      "  lanewise export town.sqlite --run 2 --trips trips.csv --trajectories fcd.xml.gz\n"
      "  lanewise export town.sqlite --run all --trips trips.csv.gz --encounters encounters.csv.gz\n"
      "  python3 $SUMO_HOME/tools/plot_trajectories.py fcd.xml -t td -o time-distance.png\n"
      "  python3 $SUMO_HOME/tools/visualization/plotXMLAttributes.py -x depart -y timeLoss -i vType "
      "--scatterplot \\\n"
      "    tripinfo.xml -o loss.png\n"
      "In Python: pandas.read_csv('trips.csv.gz', sep=';'); or read the views directly:\n"
      "  pandas.read_sql('SELECT * FROM v_trip WHERE run_id = 2', sqlite3.connect('town.sqlite'))");
  command->callback([o, chosen] { *chosen = [o] { return RunExport(*o); }; });
}

}  // namespace lanewise
