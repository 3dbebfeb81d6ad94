// A study whose runner or workers are killed, again and again, ends with the rows of an undisturbed one.

#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <random>
#include <thread>

#include "tests/support/same_results.h"
#include "tests/support/study_files.h"

namespace lanewise {
namespace {

namespace fs = std::filesystem;

/// How much is done: by default little. LANEWISE_STUDY_RUNS=40 LANEWISE_STUDY_KILLS=20 repeats the claim made
/// for studies.
int FromEnvironment(const char* name, int otherwise) {
  const char* text = std::getenv(name);
  return text == nullptr ? otherwise : std::atoi(text);
}

std::vector<pid_t> ChildrenOf(pid_t parent) {
  std::vector<pid_t> children;
  std::ifstream list(fmt::format("/proc/{0}/task/{0}/children", parent));
  for (pid_t child = 0; list >> child;) children.push_back(child);
  return children;
}

using KilledStudy = StudyFiles;

TEST_F(KilledStudy, ResumesToTheRowsOfAnUndisturbedOne) {
  const int runs = FromEnvironment("LANEWISE_STUDY_RUNS", 8),
            kills = FromEnvironment("LANEWISE_STUDY_KILLS", 6);
  const auto study = WriteStudy("['sumo', 'dwa']", (runs + 1) / 2, 20), calm = folder_ / "calm.sqlite",
             torn = folder_ / "torn.sqlite";
  const auto started = std::chrono::steady_clock::now();
  ChildProcess undisturbed(Command(study, calm));
  ASSERT_EQ(undisturbed.Wait(), 0) << undisturbed.Errors();
  const double whole = std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();

  // So many moments; a study that is complete before all are used up is done once more from the start.
  std::mt19937 random(static_cast<unsigned>(FromEnvironment("LANEWISE_STUDY_SEED", 1)));
  std::uniform_real_distribution<double> pause(0.0, 1.6 * whole / kills);
  int of_runner = 0, of_worker = 0, completed = 0;
  const auto start = [&] {
    return std::make_unique<ChildProcess>(Command(study, torn, {"--retries", "100"}));
  };
  auto child = start();
  while (of_runner + of_worker < kills || completed == 0) {
    if (of_runner + of_worker < kills) {
      std::this_thread::sleep_for(std::chrono::duration<double>(pause(random)));
    } else {
      child->Wait();
    }
    if (!child->Running()) {
      ASSERT_EQ(child->Wait(), 0) << child->Errors();
      EXPECT_EQ(Value(torn, "PRAGMA integrity_check"), "ok");
      EXPECT_EQ(DifferenceOfResults(calm, torn), "");
      ++completed;
      if (of_runner + of_worker == kills) break;
      fs::remove(torn);
      child = start();
      continue;
    }
    const std::vector<pid_t> workers = ChildrenOf(child->pid());
    if (random() % 2 == 0 && !workers.empty()) {
      ::kill(workers[random() % workers.size()], SIGKILL);
      ++of_worker;
      continue;
    }
    child->Signal(SIGKILL);
    child->Wait();
    ++of_runner;
    if (fs::exists(torn) && fs::file_size(torn) > 0) {
      EXPECT_EQ(Value(torn, "PRAGMA integrity_check"), "ok");
    }
    child = start();
  }
  fmt::print("{} runs, {:.1f} s undisturbed; {} kills of the runner, {} of a worker, completed {} times\n",
             2 * ((runs + 1) / 2), whole, of_runner, of_worker, completed);
}

}  // namespace
}  // namespace lanewise
