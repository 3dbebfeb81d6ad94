#include "analysis/report.h"

#include <fmt/core.h>

#include <filesystem>
#include <fstream>
#include <memory>

#include "agents/core/check.h"
#include "scenarios/report.h"

namespace lanewise {
namespace {

namespace fs = std::filesystem;

struct ReportOptions {
  std::vector<std::string> files;
  std::string output{"report.html"}, baseline;
  bool ignore_demand{false}, by_file{false}, force{false};
};

int WriteReport(const ReportOptions& o) {
  if (fs::is_directory(o.output)) throw ConfigError(fmt::format("{}: it is a folder; name a file", o.output));
  if (fs::exists(o.output) && !o.force)
    throw ConfigError(fmt::format("{}: it exists; --force replaces it", o.output));
  const std::vector<fs::path> files(o.files.begin(), o.files.end());
  const std::vector<RunRecord> runs = LoadRuns(files, o.by_file);
  if (runs.empty())
    throw ConfigError(
        fmt::format("results file {}: it holds no runs; record some with: lanewise run --results {}",
                    o.files[0], o.files[0]));
  CompareParams params;
  params.baseline = o.baseline;
  params.ignore_demand = o.ignore_demand;
  const std::string page = BuildReport(runs, params, LANEWISE_VERSION);
  const fs::path part = o.output + ".part";
  std::ofstream out(part, std::ios::binary);
  out << page;
  out.close();
  std::error_code error;
  if (out) fs::rename(part, o.output, error);
  if (!out || error) {
    fs::remove(part, error);
    throw ConfigError(
        fmt::format("{}: could not be written; its folder must exist and be writable", o.output));
  }
  fmt::print("{}: {} runs, {:.1f} MB{}\n", o.output, runs.size(), static_cast<double>(page.size()) / 1e6,
             Compare(runs, params).partial() ? "; PARTIAL, see the notes in it" : "");
  return 0;
}

}  // namespace

void AddReportCommand(CLI::App* app, std::function<int()>* chosen) {
  const auto o = std::make_shared<ReportOptions>();
  CLI::App* report =
      app->add_subcommand("report", "Results as one interactive HTML page that needs no network");
  report->add_option("RESULTS", o->files, "results files (SQLite); their runs are taken together")
      ->required();
  report->add_option("-o,--output", o->output, "the page")->capture_default_str();
  report->add_option("--baseline", o->baseline, "policy the others are compared with; default: sumo");
  report->add_flag("--ignore-demand", o->ignore_demand,
                   "pair by scenario and seed alone (penetration studies)");
  report->add_flag("--by-file", o->by_file, "the same policy in two files is two policies");
  report->add_flag("--force", o->force, "replace the page if it exists");
  report->footer("Example: lanewise report town.sqlite -o town.html");
  report->callback([o, chosen] { *chosen = [o] { return WriteReport(*o); }; });
}

}  // namespace lanewise
