#include "scenarios/study/study_runner.h"

#include <poll.h>
#include <signal.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <list>

#include "scenarios/interrupt.h"
#include "scenarios/study/worker.h"

namespace lanewise {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

double OwnCpuTime() {
  rusage usage{};
  ::getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

std::string Duration(double seconds) {
  const auto s = static_cast<std::int64_t>(seconds + 0.5);
  return s >= 3600 ? fmt::format("{}:{:02}:{:02}", s / 3600, s / 60 % 60, s % 60)
                   : fmt::format("{}:{:02}", s / 60, s % 60);
}

/// A run under way.
struct Job {
  ClaimedRun run;
  WorkerFiles files;
  std::unique_ptr<Worker> worker;
  bool hung{false};
  double wall_time{0.0};  // [s] From start to end.
};

class Runner {
 public:
  Runner(const StudyPlan& plan, const RunnerParams& params, StudyFile* study)
      : plan_(plan),
        params_(params),
        study_(*study),
        folder_(WorkFolder(study->path())),
        started_(Clock::now()) {
    fs::remove_all(folder_);  // Of workers that died with an earlier runner.
    fs::create_directories(folder_);
    counts_ = study_.Counts();
  }
  ~Runner() {
    jobs_.clear();
    std::error_code ignored;
    fs::remove_all(folder_, ignored);
  }

  RunnerReport Run() {
    const InterruptGuard guard;
    const double own_before = OwnCpuTime();
    try {
      while (!Interrupted()) {
        FillSlots();
        if (jobs_.empty()) break;
        WaitForNews();
        SetEndedAside();
        if (!ended_.empty()) FillSlots();  // No core waits while results are copied.
        for (; !ended_.empty(); ended_.pop_front()) End(&ended_.front());
        Show(false);
      }
    } catch (...) {
      Abandon();
      throw;
    }
    report_.interrupted = Interrupted();
    Abandon();
    Show(true);
    report_.own_cpu_time = OwnCpuTime() - own_before;
    report_.wall_time = std::chrono::duration<double>(Clock::now() - started_).count();
    return report_;
  }

 private:
  void FillSlots() {
    while (static_cast<int>(jobs_.size()) < params_.jobs && !Interrupted() && StartNext()) {
    }
  }

  void SetEndedAside() {
    for (auto job = jobs_.begin(); job != jobs_.end();) {
      const auto next = std::next(job);
      if (job->worker->Read()) {
        CheckHang(&*job);
      } else {
        job->wall_time = job->worker->elapsed();
        ended_.splice(ended_.end(), jobs_, job);
      }
      job = next;
    }
  }

  bool StartNext() {
    auto claimed = study_.Claim();
    if (!claimed) return false;
    Job job{*claimed, WorkerFiles(folder_, fmt::format("run-{}", claimed->run_id)), nullptr};
    job.files.Prepare();
    --counts_.pending;
    ++counts_.claimed;
    job.worker = std::make_unique<Worker>(
        WorkerArguments(job.files, params_.threads, plan_.Arguments(job.run.settings)), job.files.log);
    jobs_.push_back(std::move(job));
    return true;
  }

  void WaitForNews() {
    std::vector<pollfd> fds;
    for (const Job& job : jobs_) fds.push_back({job.worker->pipe(), POLLIN, 0});
    ::poll(fds.data(), fds.size(), 250);
  }

  void CheckHang(Job* job) {
    if (job->hung || job->worker->silent_for() < params_.hang_after) return;
    job->hung = true;
    job->worker->Kill(SIGKILL);
  }

  void End(Job* job) {
    const double wall_time = job->wall_time;
    const int code = job->worker->Wait();
    report_.worker_time += wall_time;
    report_.worker_cpu_time += job->worker->cpu_time();
    --counts_.claimed;
    const std::int64_t id = job->run.run_id;
    const std::string at = job->worker->time() < 0.0
                               ? "before the first step"
                               : fmt::format("after {:.0f} s simulated", job->worker->time());
    if (code == 0) {
      study_.Finish(id, job->files.results, wall_time);
      ++counts_.finished;
      ++report_.finished;
      work_done_ += wall_time;
    } else if (job->hung) {
      Retry(*job, fmt::format("hung: no progress for {:.0f} s {}", params_.hang_after, at));
    } else if (code == -SIGKILL || code == -SIGTERM || code == -SIGINT || code == 130) {
      Retry(*job, fmt::format("killed from outside (signal {}, {}); out of memory?",
                              code < 0 ? -code : SIGINT, at));
    } else {
      Fail(*job, EndOfWorker(code, job->files.log, at));
    }
    job->files.Remove();
  }

  void Retry(const Job& job, const std::string& why) {
    if (job.run.attempts > params_.retries) {
      Fail(job, fmt::format("{}; started {} times", why, job.run.attempts));
      return;
    }
    study_.Release(job.run.run_id, /*counts=*/true);
    ++counts_.pending;
    Say(fmt::format("run {} {}; tried again", job.run.run_id, why));
  }

  void Fail(const Job& job, const std::string& message) {
    study_.Fail(job.run.run_id, message, LogTail(job.files.log));
    ++counts_.failed;
    ++report_.failed;
    Say(fmt::format("run {} failed ({}): {}", job.run.run_id, ToText(job.run.settings), message));
  }

  /// Ends what is under way; it will be run again.
  void Abandon() {
    jobs_.splice(jobs_.end(), ended_);
    for (Job& job : jobs_) job.worker->Kill(SIGKILL);
    for (Job& job : jobs_) {
      job.worker->Wait();
      try {
        study_.Release(job.run.run_id, /*counts=*/false);
      } catch (const ConfigError&) {  // A full disk; the next runner sees that nobody is at work.
      }
    }
    jobs_.clear();
  }

  void Say(const std::string& line) {
    ClearShown();
    fmt::print(stderr, "{}\n", line);
  }

  void ClearShown() {
    if (shown_lines_ > 0) fmt::print(stderr, "\x1b[{}A\x1b[J", shown_lines_);
    shown_lines_ = 0;
  }

  /// The study in a line with the time left; on a terminal a line for each run under way too.
  void Show(bool last) {
    if (params_.quiet) return;
    const auto now = Clock::now();
    const double since = std::chrono::duration<double>(now - last_shown_).count();
    if (!last && since < (terminal_ ? 0.5 : 10.0)) return;
    last_shown_ = now;
    ClearShown();
    const double wall = std::chrono::duration<double>(now - started_).count();
    fmt::print(stderr, "{}: {} of {} runs finished{}, {} under way, {}{}\n", plan_.name(), counts_.finished,
               counts_.total(), counts_.failed > 0 ? fmt::format(", {} failed", counts_.failed) : "",
               jobs_.size(), Duration(wall), last ? "" : ", " + TimeLeft());
    if (last || !terminal_) return;
    shown_lines_ = 1;
    for (const Job& job : jobs_) {
      const Worker& w = *job.worker;
      fmt::print(
          stderr, "  run {}: {}: {}\n", job.run.run_id, ToText(job.run.settings),
          w.time() < 0.0
              ? "starting"
              : fmt::format("t = {:.0f} s, {} vehicles, {} arrived{}", w.time(), w.running(), w.arrived(),
                            w.share() >= 0.0 ? fmt::format(", {:.0f} %", 100.0 * w.share()) : ""));
      ++shown_lines_;
    }
    std::fflush(stderr);
  }

  std::string TimeLeft() const {
    // A run costs what those that are finished did, or what one under way lets expect.
    double per_run = report_.finished > 0 ? work_done_ / static_cast<double>(report_.finished) : 0.0;
    double under_way = 0.0;
    for (const Job& job : jobs_) {
      const double share = job.worker->share(), elapsed = job.worker->elapsed();
      const double whole = share > 0.02 ? elapsed / share : per_run;
      if (per_run == 0.0) per_run = whole;
      under_way += std::max(0.0, whole - elapsed);
    }
    if (per_run == 0.0) return "time left unknown";
    const double work = under_way + per_run * static_cast<double>(counts_.pending);
    return fmt::format("about {} left", Duration(work / params_.jobs));
  }

  const StudyPlan& plan_;
  RunnerParams params_;
  StudyFile& study_;
  fs::path folder_;
  std::list<Job> jobs_;   // Under way.
  std::list<Job> ended_;  // Their results are not in the study file yet.
  StudyCounts counts_;
  RunnerReport report_;
  double work_done_{0.0};  // [s] of the runs that finished.
  bool terminal_{::isatty(STDERR_FILENO) != 0};
  int shown_lines_{0};
  Clock::time_point started_, last_shown_{};
};

}  // namespace

fs::path WorkFolder(const fs::path& study_file) {
  return study_file.string() + ".work";
}

void RunnerReport::Add(const RunnerReport& next) {
  interrupted = next.interrupted;
  finished += next.finished;
  failed += next.failed;
  wall_time += next.wall_time;
  worker_time += next.worker_time;
  worker_cpu_time += next.worker_cpu_time;
  own_cpu_time += next.own_cpu_time;
}

RunnerReport RunPending(const StudyPlan& plan, const RunnerParams& params, StudyFile* study) {
  return Runner(plan, params, study).Run();
}

}  // namespace lanewise
