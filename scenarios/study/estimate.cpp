#include "scenarios/study/estimate.h"

#include <poll.h>
#include <signal.h>

#include "scenarios/interrupt.h"
#include "scenarios/scratch_folder.h"
#include "scenarios/study/worker.h"

namespace lanewise {
namespace {

namespace fs = std::filesystem;

std::string KindOf(const RunSettings& settings) {
  std::string text;
  for (const auto& [name, value] : settings) {
    if (name != "seed" && !name.starts_with("set.")) text += name + "=" + value + " ";
  }
  return text;
}

}  // namespace

void CostEstimate::Add(const RunSettings& settings, double wall_time, double bytes) {
  for (Mean* mean : {&kinds_[KindOf(settings)], &all_}) {
    mean->wall_time += wall_time;
    mean->bytes += bytes;
    ++mean->runs;
  }
}

bool CostEstimate::Knows(const RunSettings& settings) const {
  return kinds_.count(KindOf(settings)) != 0;
}

RunCost CostEstimate::Of(const RunSettings& settings) const {
  const auto kind = kinds_.find(KindOf(settings));
  const Mean& mean = kind == kinds_.end() ? all_ : kind->second;
  const auto runs = static_cast<double>(mean.runs);
  return {mean.wall_time / runs, mean.bytes / runs};
}

std::optional<RunCost> ProbeCost(const StudyPlan& plan, const RunSettings& settings, double seconds,
                                 int threads) {
  const ScratchFolder folder;
  const WorkerFiles files(folder.path(), "probe");
  files.Prepare();
  Worker worker(WorkerArguments(files, threads, plan.Arguments(settings)), files.log);
  const InterruptGuard guard;
  double started = -1.0;  // [s] when its first step was done.
  while (!Interrupted()) {
    pollfd fd{worker.pipe(), POLLIN, 0};
    ::poll(&fd, 1, 100);
    if (!worker.Read()) {
      const double wall_time = worker.elapsed();
      if (worker.Wait() != 0) return std::nullopt;
      return RunCost{wall_time, static_cast<double>(fs::file_size(files.results))};
    }
    if (started < 0.0 && worker.time() >= 0.0) started = worker.elapsed();
    if (started >= 0.0 && worker.elapsed() - started >= seconds) break;
  }
  const double wall_time = worker.elapsed() - std::max(0.0, started);
  worker.Kill(SIGTERM);  // It then writes what it holds.
  worker.Wait();
  if (started < 0.0 || worker.share() <= 0.0) return std::nullopt;
  return RunCost{started + wall_time / worker.share(),
                 static_cast<double>(fs::file_size(files.results)) / worker.share()};
}

}  // namespace lanewise
