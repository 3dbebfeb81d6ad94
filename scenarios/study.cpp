#include "scenarios/study.h"

#include <algorithm>
#include <memory>
#include <thread>
#include <unordered_set>

#include "agents/core/check.h"
#include "scenarios/interrupt.h"
#include "scenarios/study/estimate.h"
#include "scenarios/study/precision.h"
#include "scenarios/study/slurm.h"
#include "scenarios/study/study_file.h"
#include "scenarios/study/study_runner.h"

namespace lanewise {
namespace {

namespace fs = std::filesystem;

constexpr int kOk = 0, kFailed = 1, kInterrupted = 130;

struct StudyOptions {
  std::string file, results, shard, until_ci, sbatch;
  bool dry_run{false}, retry_failed{false}, slurm{false};
  double probe{3.0};            // [s] wall time.
  int tasks{0};                 // Of Slurm; 0: as many as runs, up to kMaxDefaultTasks.
  std::int64_t max_seeds{100};  // Of --until-ci.
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

/// Part of the estimate: what a run of each kind takes, where none has finished.
bool ProbeKinds(const StudyPlan& plan, const StudyOptions& o, CostEstimate* estimate) {
  constexpr int kMaxKinds = 8;
  int kinds = 0;
  plan.ForEach(0, [&](const PlannedRun& run) {
    if (kinds == kMaxKinds || Interrupted() || estimate->Knows(run.settings)) return;
    ++kinds;
    fmt::print(stderr, "measuring: {}\n", ToText(run.settings));
    if (const auto cost = ProbeCost(plan, run.settings, o.probe, o.runner.threads)) {
      estimate->Add(run.settings, cost->wall_time, cost->bytes);
    } else if (!Interrupted()) {
      fmt::print(stderr, "  it could not be measured\n");
    }
  });
  return kinds > 0;
}

/// Prints the runs and what those that have not finished will take.
int DryRun(const StudyPlan& plan, const fs::path& results, const Shard& shard, const StudyOptions& o) {
  CostEstimate estimate;
  std::unordered_set<std::string> finished;  // Keys.
  ForEachFinished(results, [&](const std::string& key, const RunSettings& settings, const RunCost& cost) {
    finished.insert(key);
    estimate.Add(settings, cost.wall_time, cost.bytes);
  });
  const std::int64_t measured = static_cast<std::int64_t>(finished.size());
  const bool rough = o.probe > 0.0 && ProbeKinds(plan, o, &estimate);
  if (Interrupted()) return kInterrupted;
  double wall_time = 0.0, bytes = 0.0;
  std::int64_t runs = 0, left = 0;
  plan.ForEach(0, [&](const PlannedRun& run) {
    if ((run.number - 1) % shard.count != shard.index - 1) return;
    ++runs;
    const bool done = finished.count(run.key) != 0;
    fmt::print("{:>6}  {}{}\n", run.number, ToText(run.settings), done ? "  (finished)" : "");
    if (done) return;
    ++left;
    if (estimate.empty()) return;
    const RunCost cost = estimate.Of(run.settings);
    wall_time += cost.wall_time;
    bytes += cost.bytes;
  });
  fmt::print("\n{}: {} runs{}\n", plan.name(), runs, left < runs ? fmt::format(", {} left", left) : "");
  if (!plan.question().empty()) fmt::print("question: {}\n", plan.question());
  if (left == 0) return kOk;
  if (estimate.empty()) {
    fmt::print("no estimate of time and disk: no run has finished, and none could be measured\n");
    return kOk;
  }
  fmt::print(
      "estimate: {} with {} jobs, {} on disk; by {}\n", Hours(wall_time / o.runner.jobs), o.runner.jobs,
      Bytes(bytes),
      rough ? fmt::format("the first {:g} s of a run of each kind: rough, traffic that grows takes longer",
                          o.probe)
            : fmt::format("{} finished runs", measured));
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

void CheckRange(const char* option, double value, double min, double max) {
  if (!(value >= min && value <= max))
    throw ConfigError(fmt::format("{}: {}; allowed: {} to {}", option, value, min, max));
}

/// Adds seeds until the intervals are narrow enough, or there are as many as allowed. @return whether they
/// are.
bool RunUntilPrecise(const StudyPlan& plan, const StudyOptions& o, const PrecisionGoal& goal,
                     StudyFile* study, RunnerReport* total) {
  CompareParams params;
  params.metrics = {goal.metric};
  const std::vector<fs::path> files{study->path()};
  while (true) {
    const RunnerReport report = RunPending(plan, o.runner, study);
    total->Add(report);
    if (report.interrupted) return false;
    const Precision precision = JudgePrecision(Compare(LoadRuns(files), params), goal);
    const std::int64_t seeds = plan.seeds() + study->extra_seeds();
    fmt::print("{} seeds: {}{}\n", seeds, precision.widest, precision.reached ? ": narrow enough" : "");
    std::fflush(stdout);
    if (precision.reached) return true;
    const std::int64_t more = std::min(precision.more_seeds, o.max_seeds - seeds);
    if (more <= 0) {
      fmt::print("--until-ci was not reached with the {} seeds that --max-seeds allows\n", o.max_seeds);
      return false;
    }
    study->SetExtraSeeds(study->extra_seeds() + more);
    study->AddRuns(plan, study->extra_seeds(), Shard{});
  }
}

/// Command of a task: this one, for a shard.
std::vector<std::string> TaskCommand(const StudyOptions& o) {
  std::vector<std::string> words{fs::read_symlink("/proc/self/exe").string(),
                                 "study",
                                 fs::absolute(o.file).lexically_normal().string(),
                                 "--quiet",
                                 "--jobs",
                                 std::to_string(o.runner.jobs),
                                 "--threads",
                                 std::to_string(o.runner.threads),
                                 "--hang-after",
                                 fmt::format("{}", o.runner.hang_after),
                                 "--retries",
                                 std::to_string(o.runner.retries)};
  if (o.retry_failed) words.emplace_back("--retry-failed");
  return words;
}

int RunOnSlurm(const StudyPlan& plan, const fs::path& results, const StudyOptions& o) {
  constexpr int kMaxDefaultTasks = 100;
  std::int64_t runs = 0;
  plan.ForEach(0, [&](const PlannedRun&) { ++runs; });
  const int tasks = static_cast<int>(std::min<std::int64_t>(runs, o.tasks > 0 ? o.tasks : kMaxDefaultTasks));
  const SlurmArray array{plan.name(), tasks,   o.runner.jobs * o.runner.threads,
                         o.sbatch,    results, TaskCommand(o)};
  if (o.dry_run) {
    fmt::print("\n{}", SlurmScript(array));
    return kOk;
  }
  fs::path script = results;
  script.replace_extension(".slurm.sh");
  const std::string job = SubmitSlurm(array, script);
  fmt::print(
      "Slurm job {}: {} runs in {} tasks ({})\nWhen it has ended: lanewise merge {} -o {}\n"
      "The same command again finishes what tasks left undone.\n",
      job, runs, tasks, script.string(), ShardFile(results, "*", tasks).string(), results.string());
  return kOk;
}

int RunStudy(StudyOptions o, const RunInterface& run) {
  const StudyPlan plan = StudyPlan::Load(o.file, run);
  plan.Check(run);
  const Shard shard = ParseShard(o.shard);
  const int cores = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  if (o.runner.jobs == 0) o.runner.jobs = o.slurm ? 1 : cores;
  CheckRange("--jobs", o.runner.jobs, 1, 4096);
  CheckRange("--threads", o.runner.threads, 1, 1024);
  CheckRange("--hang-after", o.runner.hang_after, 1, 1e6);
  CheckRange("--retries", o.runner.retries, 0, 100);
  CheckRange("--probe", o.probe, 0, 3600);
  CheckRange("--tasks", o.tasks, 0, 1'000'000);
  std::optional<PrecisionGoal> goal;
  if (!o.until_ci.empty()) {
    goal = ParsePrecisionGoal(o.until_ci);
    CheckRange("--max-seeds", static_cast<double>(o.max_seeds), static_cast<double>(plan.seeds()), 1e6);
    if (shard.count > 1 || o.slurm)
      throw ConfigError("--until-ci: a shard cannot tell; merge the shards, then use it on the merged file");
  }
  if (o.slurm && shard.count > 1) throw ConfigError("--slurm and --shard exclude each other");
  fs::path results = o.results;
  if (results.empty()) {
    results = fs::path(o.file).stem().string() + ".sqlite";
    if (shard.count > 1)
      results = ShardFile(results, std::to_string(shard.index), static_cast<int>(shard.count));
  }
  if (o.dry_run) {
    const int code = DryRun(plan, results, shard, o);
    if (code != kOk || !o.slurm) return code;
  }
  if (o.slurm) return RunOnSlurm(plan, results, o);

  StudyFile study(results, plan);
  study.ReleaseStale();
  if (o.retry_failed) study.RetryFailed();
  study.AddRuns(plan, study.extra_seeds(), shard);
  RunnerReport report;
  bool precise = true;
  if (goal) {
    precise = RunUntilPrecise(plan, o, *goal, &study, &report);
  } else {
    report = RunPending(plan, o.runner, &study);
  }
  const int code = PrintEnd(study, report, o.runner.jobs);
  return code == kOk && !precise ? kFailed : code;
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
  study->add_flag("--dry-run", o->dry_run, "print the runs and an estimate of time and disk; store nothing");
  study
      ->add_option("--probe", o->probe,
                   "[s] for which --dry-run starts a run of each kind of which none has finished; 0: none")
      ->capture_default_str();
  study->add_option("-j,--jobs", o->runner.jobs, "runs at a time; default: one a core");
  study->add_option("--threads", o->runner.threads, "of each run; results do not depend on it")
      ->capture_default_str();
  study->add_option("--shard", o->shard, "I/N: only every N-th run, from the I-th, into a file of its own");
  study->add_option("--hang-after", o->runner.hang_after, "[s] without progress after which a run is killed")
      ->capture_default_str();
  study->add_option("--retries", o->runner.retries, "of a run that hung or was killed from outside")
      ->capture_default_str();
  study->add_flag("--retry-failed", o->retry_failed, "run failed runs again");
  study->add_option(
      "--until-ci", o->until_ci,
      "SHARE:METRIC: add seeds until the paired 95 % intervals of the metric are at most +- this "
      "share of the\nbaseline's mean, e.g. 0.05:time_loss_s (`lanewise compare --list-metrics`)");
  study->add_option("--max-seeds", o->max_seeds, "of --until-ci")->capture_default_str();
  study->add_flag("--slurm", o->slurm, "write a Slurm job array, a shard of the study a task, and submit it");
  study->add_option("--tasks", o->tasks, "of --slurm; default: one a run, up to 100");
  study->add_option("--sbatch", o->sbatch, "further options of sbatch, e.g. \"--time=2:00:00 --mem=2G\"");
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
