#include "scenarios/cost_bench.h"

#include <fmt/core.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <vector>

#include "agents/core/check.h"
#include "scenarios/run.h"

namespace lanewise {
namespace {

namespace fs = std::filesystem;

constexpr double kNeverSampled = 1e9;  // [s] longer than any run: only the first step is.

struct Variant {
  const char* name;
  SafetyLevel level;
  double sample_period;             // [s]
  std::vector<double> wall{};       // [s] of each repetition: the steps, and closing the file.
  std::vector<double> cpu{};        // [s] of processor time for that, all threads.
  std::vector<double> more_wall{};  // Than the first variant of the same repetition, as a share of it.
  std::vector<double> more_cpu{};
  std::vector<double> share{};  // Of its own wall time, spent on what the variant adds.
  std::int64_t rows{0};         // Of trajectories.
};

double Median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const std::size_t n = values.size();
  return n % 2 == 1 ? values[n / 2] : 0.5 * (values[n / 2 - 1] + values[n / 2]);
}

/// "1.2 % (0.7 to 3.7)": median, least and most.
std::string Spread(const std::vector<double>& more) {
  const auto [least, most] = std::minmax_element(more.begin(), more.end());
  return fmt::format("{:.1f} % ({:.1f} to {:.1f})", 100.0 * Median(more), 100.0 * *least, 100.0 * *most);
}

void Drive(const RunConfig& config, const fs::path& file, Variant* variant) {
  RunConfig run = config;
  run.safety_level = variant->level;
  run.sample_period = variant->sample_period;
  run.results = file;
  const RunReport report = Run(run);
  if (report.outcome.status == RunStatus::kInterrupted) throw ConfigError("bench cost: interrupted");
  variant->wall.push_back(report.outcome.wall_time + report.finish_time);
  variant->cpu.push_back(report.cpu_time);
  // All that is written counts as if the run had waited for it.
  const double added =
      variant->level == SafetyLevel::kOff ? report.sampling_time + report.writing_time : report.safety_time;
  variant->share.push_back(added / variant->wall.back());
  for (const RunSummary& summary : LoadRunSummaries(file))
    variant->rows = summary.trajectory_rows.value_or(0);
  fs::remove(file);
}

struct WritingSpeed {
  double rows{0.0}, indexed_rows{0.0};  // [1/s]
};

/// From the first Add to the last commit: what the disk really has; and to the end, with their index.
WritingSpeed MeasureWriting(const fs::path& file) {
  constexpr int kSteps = 2000, kVehicles = 1000;
  std::vector<TrajectoryRow> rows(kVehicles);
  RunWriter writer(ResultsFile::Open(file, ResultsFile::Mode::kAppend), RunInfo{});
  const auto start = std::chrono::steady_clock::now();
  for (int step = 0; step < kSteps; ++step) {
    for (int i = 0; i < kVehicles; ++i) {
      rows[static_cast<std::size_t>(i)] = {0.1 * step,         i,        i % 50,           10.0 * i + step,
                                           std::sin(i + step), 0.01 * i, 10.0 + 0.001 * i, 0.1,
                                           1.0 * step,         0.01 * i};
    }
    writer.Add(rows);
  }
  writer.Finish({});
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  fs::remove(file);
  constexpr double kRows = kSteps * kVehicles;
  return {kRows / (seconds - writer.index_time()), kRows / seconds};
}

}  // namespace

bool BenchCost(const RunConfig& config, int repetitions) {
  const fs::path folder = fs::temp_directory_path() / fmt::format("lanewise-cost-{}", getpid());
  fs::create_directories(folder);
  std::array<Variant, 3> variants{{{"engine off, no sampling", SafetyLevel::kOff, kNeverSampled},
                                   {"engine on", SafetyLevel::kFull, kNeverSampled},
                                   {"sampled every second", SafetyLevel::kOff, 1.0}}};
  for (int repetition = 0; repetition < repetitions; ++repetition) {
    // Each starts in turn: the first run of a process is the slowest.
    for (std::size_t k = 0; k < variants.size(); ++k)
      Drive(config, folder / "cost.sqlite",
            &variants[(k + static_cast<std::size_t>(repetition)) % variants.size()]);
    for (Variant& v : variants) {
      v.more_wall.push_back(v.wall.back() / variants[0].wall.back() - 1.0);
      v.more_cpu.push_back(v.cpu.back() / variants[0].cpu.back() - 1.0);
    }
  }
  const WritingSpeed writing = MeasureWriting(folder / "rows.sqlite");
  std::error_code ignored;
  fs::remove_all(folder, ignored);

  fmt::print("\n{} [{}] seed {}; medians of {} repetitions\n\n", config.scenario,
             kPolicyNames[static_cast<std::size_t>(config.policy)], config.seed, repetitions);
  // Judged by the share of a run's own time: between two runs a shared machine changes its speed by more.
  fmt::print("{:<34} {:>9} {:>10}   {:<15} {:>22} {:>9} {:>22}\n", "", "wall [s]", "of it here", "target",
             "more than without", "CPU [s]", "more than without");
  bool passed = true;
  const double targets[] = {0.0, 0.10, 0.03};
  for (std::size_t k = 0; k < variants.size(); ++k) {
    const Variant& v = variants[k];
    if (k == 0) {
      fmt::print("{:<34} {:>9.2f} {:>10}   {:<15} {:>22} {:>9.2f}\n", v.name, Median(v.wall), "", "", "",
                 Median(v.cpu));
      continue;
    }
    const double share = Median(v.share);
    const bool ok = share <= targets[k];
    passed = passed && ok;
    fmt::print("{:<34} {:>9.2f} {:>10}   {:<15} {:>22} {:>9.2f} {:>22}\n", v.name, Median(v.wall),
               fmt::format("{:.1f} %", 100.0 * share),
               fmt::format("<= {:.0f} %  {}", 100.0 * targets[k], ok ? "ok" : "MISSED"), Spread(v.more_wall),
               Median(v.cpu), Spread(v.more_cpu));
  }
  fmt::print("{:<34} {:>9}\n", "  trajectory rows of a run", variants[2].rows);
  const bool fast = writing.rows >= 500'000.0;
  fmt::print("{:<34} {:>9.0f} {:>10}   >= 500000  {}\n", "trajectory rows into SQLite [1/s]", writing.rows,
             "", fast ? "ok" : "MISSED");
  fmt::print("{:<34} {:>9.0f}\n", "  with their index", writing.indexed_rows);
  return passed && fast;
}

}  // namespace lanewise
