#include "scenarios/study.h"

#include <algorithm>
#include <map>
#include <memory>
#include <thread>

#include "agents/core/check.h"
#include "scenarios/study/study_file.h"
#include "scenarios/study/study_runner.h"

namespace lanewise {
namespace {

namespace fs = std::filesystem;

constexpr int kOk = 0, kFailed = 1, kInterrupted = 130;

struct StudyOptions {
  std::string file, results, shard;
  bool dry_run{false}, retry_failed{false};
  RunnerParams runner;
};

/// "2/5". @throws ConfigError.
Shard ParseShard(const std::string& text) {
  Shard shard;
  if (text.empty()) return shard;
  char rest = 0;
  if (std::sscanf(text.c_str(), "%ld/%ld%c", &shard.index, &shard.count, &rest) != 2 || shard.index < 1 ||
      shard.index > shard.count)
    throw ConfigError(fmt::format("--shard: '{}'; allowed: I/N with 1 <= I <= N, e.g. 2/5", text));
  return shard;
}

std::string Bytes(double bytes) {
  return bytes < 1e9 ? fmt::format("{:.1f} MB", bytes / 1e6) : fmt::format("{:.1f} GB", bytes / 1e9);
}

std::string Hours(double seconds) {
  return seconds < 120    ? fmt::format("{:.0f} s", seconds)
         : seconds < 7200 ? fmt::format("{:.0f} min", seconds / 60)
                          : fmt::format("{:.1f} h", seconds / 3600);
}

/// Every setting but those that hardly change what a run costs.
std::string CostClass(const RunSettings& settings) {
  std::string text;
  for (const auto& [name, value] : settings) {
    if (name != "seed" && !name.starts_with("set.")) text += name + "=" + value + " ";
  }
  return text;
}

struct MeanCost {
  double wall_time{0.0}, bytes{0.0};
  std::int64_t runs{0};
  void Add(const RunCost& cost) {
    wall_time += cost.wall_time;
    bytes += cost.bytes;
    ++runs;
  }
};

/// Prints the runs and what they will take, by the runs of the same kind that have finished.
int DryRun(const StudyPlan& plan, const fs::path& results, const Shard& shard, int jobs) {
  std::map<std::string, MeanCost> costs;
  MeanCost all;
  for (const RunCost& cost : LoadCosts(results)) {
    costs[CostClass(cost.settings)].Add(cost);
    all.Add(cost);
  }
  double wall_time = 0.0, bytes = 0.0;
  std::int64_t runs = 0, unlike = 0;
  plan.ForEach(0, [&](const PlannedRun& run) {
    if ((run.number - 1) % shard.count != shard.index - 1) return;
    ++runs;
    fmt::print("{:>6}  {}\n", run.number, ToText(run.settings));
    if (all.runs == 0) return;
    const auto cost = costs.find(CostClass(run.settings));
    unlike += cost == costs.end();
    const MeanCost& mean = cost == costs.end() ? all : cost->second;
    wall_time += mean.wall_time / static_cast<double>(mean.runs);
    bytes += mean.bytes / static_cast<double>(mean.runs);
  });
  fmt::print("\n{}: {} runs\n", plan.name(), runs);
  if (!plan.question().empty()) fmt::print("question: {}\n", plan.question());
  if (all.runs == 0) {
    fmt::print("no estimate of time and disk yet: none of its runs has finished in {}\n", results.string());
  } else {
    fmt::print(
        "estimate from {} finished runs: {} with {} jobs, {} on disk{}\n", all.runs, Hours(wall_time / jobs),
        jobs, Bytes(bytes),
        unlike > 0 ? fmt::format(" ({} runs of kinds not measured yet, taken as the mean)", unlike) : "");
  }
  return kOk;
}

int PrintEnd(const StudyFile& study, const RunnerReport& report, int jobs) {
  const StudyCounts counts = study.Counts();
  for (const FailedRun& run : study.Failed())
    fmt::print("run {} failed ({}): {}\n", run.run_id, ToText(run.settings), run.message);
  fmt::print("{}: {} of {} runs finished, {} failed, {} to do\n", study.path().string(), counts.finished,
             counts.total(), counts.failed, counts.pending);
  if (report.worker_time > 0.0)
    fmt::print(
        "{:.1f} s with {} jobs for {:.1f} s of runs; the runner itself used {:.2f} s of processor time, "
        "{:.1f} % of "
        "theirs\n",
        report.wall_time, jobs, report.worker_time, report.own_cpu_time,
        100.0 * report.own_cpu_time / std::max(1e-9, report.worker_cpu_time));
  if (report.interrupted) {
    fmt::print("interrupted; the same command goes on\n");
    return kInterrupted;
  }
  if (counts.failed > 0) fmt::print("failed runs are kept as they are; --retry-failed runs them again\n");
  return counts.failed > 0 ? kFailed : kOk;
}

int RunStudy(const StudyOptions& o, const RunInterface& run) {
  const StudyPlan plan = StudyPlan::Load(o.file, run);
  plan.Check(run);
  const Shard shard = ParseShard(o.shard);
  RunnerParams params = o.runner;
  const int cores = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  if (params.jobs == 0) params.jobs = cores;
  const auto check = [](const char* option, double value, double min, double max) {
    if (!(value >= min && value <= max))
      throw ConfigError(fmt::format("{}: {}; allowed: {} to {}", option, value, min, max));
  };
  check("--jobs", params.jobs, 1, 4096);
  check("--threads", params.threads, 1, 1024);
  check("--hang-after", params.hang_after, 1, 1e6);
  check("--retries", params.retries, 0, 100);
  fs::path results = o.results;
  if (results.empty())
    results = fmt::format("{}{}.sqlite", fs::path(o.file).stem().string(),
                          shard.count > 1 ? fmt::format("-{}-of-{}", shard.index, shard.count) : "");
  if (o.dry_run) return DryRun(plan, results, shard, params.jobs);

  StudyFile study(results, plan);
  study.ReleaseStale();
  if (o.retry_failed) study.RetryFailed();
  study.AddRuns(plan, study.extra_seeds(), shard);
  const RunnerReport report = RunPending(plan, params, &study);
  return PrintEnd(study, report, params.jobs);
}

}  // namespace

void AddStudyCommand(CLI::App* app, const RunInterface& run, std::function<int()>* chosen) {
  const auto o = std::make_shared<StudyOptions>();
  o->runner.jobs = 0;
  CLI::App* study =
      app->add_subcommand("study", "Every run of a study file, once, in parallel; resumes where it was");
  study->add_option("STUDY", o->file, "study file (TOML)")->required();
  study->add_option("--results", o->results,
                    "the study's one SQLite file; default: the study file's name, .sqlite");
  study->add_flag("--dry-run", o->dry_run, "print the runs and an estimate of time and disk; run nothing");
  study->add_option("-j,--jobs", o->runner.jobs, "runs at a time; default: one a core");
  study->add_option("--threads", o->runner.threads, "of each run; results do not depend on it")
      ->capture_default_str();
  study->add_option("--shard", o->shard, "I/N: only every N-th run, from the I-th, into a file of its own");
  study->add_option("--hang-after", o->runner.hang_after, "[s] without progress after which a run is killed")
      ->capture_default_str();
  study->add_option("--retries", o->runner.retries, "of a run that hung or was killed from outside")
      ->capture_default_str();
  study->add_flag("--retry-failed", o->retry_failed, "run failed runs again");
  study->add_flag("-q,--quiet", o->runner.quiet, "no progress");
  study->footer(
      "A study file:\n"
      "  question = \"Is dwa safer than native driving in the town?\"\n"
      "  [grid]                              # every combination is run\n"
      "  scenario = \"town\"                   # or configuration-file = \"my.sumocfg\"\n"
      "  policy = [\"sumo\", \"dwa\"]            # any option of `lanewise run`, one value or a list\n"
      "  seed = { from = 1, count = 10 }\n"
      "  set.\"dwa.clearance_weight\" = [0.5, 1.0]\n"
      "Ctrl-C stops; the same command goes on where it was, also after a crash. Then: lanewise compare "
      "FILE.sqlite\n"
      "Exit code 1: a run failed; its message and log are in table study_run.");
  study->callback([o, run, chosen] { *chosen = [o, run] { return RunStudy(*o, run); }; });
}

}  // namespace lanewise
