#pragma once

#include <sys/types.h>

#include <chrono>
#include <filesystem>
#include <string>
#include <vector>

namespace lanewise {

/// What a worker writes: files of its own, so that no two processes write to one.
struct WorkerFiles {
  std::filesystem::path results;
  std::filesystem::path log;      ///< What it says, and what SUMO says.
  std::filesystem::path outputs;  ///< Folder of SUMO's own outputs.

  WorkerFiles(const std::filesystem::path& folder, const std::string& name);
  void Prepare() const;  ///< Nothing is left of an earlier one.
  void Remove() const;
};

/// `lanewise run` with these arguments into these files.
std::vector<std::string> WorkerArguments(const WorkerFiles& files, int threads,
                                         const std::vector<std::string>& arguments);

/// The end of a log.
std::string LogTail(const std::filesystem::path& log);

/// Why a worker failed: its own message, or the signal that ended it.
/// @param code of Worker::Wait. @param at when it ended, in words.
std::string EndOfWorker(int code, const std::filesystem::path& log, const std::string& at);

/// One `lanewise run` as a child process: it tells its progress through a pipe and writes what it says, and
/// what SUMO says, to a log. It dies with this process, however that ends.
class Worker {
 public:
  using Clock = std::chrono::steady_clock;

  /// @throws std::runtime_error if the system starts no process.
  Worker(const std::vector<std::string>& arguments, const std::filesystem::path& log);
  ~Worker();  ///< Kills it if it still runs.
  Worker(const Worker&) = delete;
  Worker& operator=(const Worker&) = delete;

  int pipe() const { return pipe_; }  ///< Readable: there is progress, or it has ended.
  /// Takes in what the pipe holds. @return false once the process has ended; then Wait.
  bool Read();
  void Kill(int signal);
  /// Waits for the end. @return the exit code, or minus the signal that ended it.
  int Wait();

  double elapsed() const;                        ///< [s] since the start.
  double silent_for() const;                     ///< [s] since the last sign of progress, or the start.
  double time() const { return time_; }          ///< [s] simulated; -1 before the first step.
  double end() const { return end_; }            ///< [s] simulated; -1: unknown.
  double cpu_time() const { return cpu_time_; }  ///< [s] once waited for.
  long running() const { return running_; }
  long arrived() const { return arrived_; }
  long expected() const { return expected_; }
  /// 0 to 1 of the run that is done; -1: unknown.
  double share() const;

 private:
  pid_t pid_{-1};
  int pipe_{-1}, status_{0};
  bool ended_{false};
  std::string buffer_;
  double time_{-1.0}, end_{-1.0}, cpu_time_{0.0};
  long running_{0}, arrived_{0}, expected_{0};
  Clock::time_point started_, heard_;
};

}  // namespace lanewise
