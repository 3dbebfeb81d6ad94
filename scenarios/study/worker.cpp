#include "scenarios/study/worker.h"

#include <fcntl.h>
#include <fmt/core.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <sstream>
#include <stdexcept>

namespace lanewise {
namespace {

constexpr int kProgressFd = 3;              // In the child.
constexpr std::size_t kMaxLog = 64 * 1024;  // [bytes] kept of a log.

/// The child's side between fork and exec: only calls that are safe there.
[[noreturn]] void Become(char* const* argv, int log, int pipe, pid_t parent) {
  ::setpgid(0, 0);                     // Ctrl-C is the runner's to handle.
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);  // Whatever happens to the runner, nobody is left over.
  if (::getppid() != parent) ::_exit(127);
  ::dup2(log, STDOUT_FILENO);
  ::dup2(log, STDERR_FILENO);
  if (pipe == kProgressFd) {
    ::fcntl(pipe, F_SETFD, 0);
  } else {
    ::dup2(pipe, kProgressFd);
  }
  ::execv("/proc/self/exe", argv);
  ::_exit(127);
}

double Seconds(const timeval& t) {
  return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
}

/// What a worker says of its end: its own last error, or else the last line.
std::string LastMessage(const std::string& log) {
  std::istringstream lines(log);
  std::string last, own;
  for (std::string line; std::getline(lines, line);) {
    if (line.empty()) continue;
    last = line;
    if (line.starts_with("lanewise: ")) own = line.substr(10);
  }
  return own.empty() ? last : own;
}

}  // namespace

WorkerFiles::WorkerFiles(const std::filesystem::path& folder, const std::string& name)
    : results(folder / (name + ".sqlite")),
      log(folder / (name + ".log")),
      outputs(folder / (name + ".sumo")) {}

void WorkerFiles::Prepare() const {
  Remove();
  std::filesystem::create_directories(outputs);
}

void WorkerFiles::Remove() const {
  std::error_code ignored;
  for (const char* tail : {"", "-wal", "-shm", "-journal"})
    std::filesystem::remove(results.string() + tail, ignored);
  std::filesystem::remove(log, ignored);
  std::filesystem::remove_all(outputs, ignored);
}

std::vector<std::string> WorkerArguments(const WorkerFiles& files, int threads,
                                         const std::vector<std::string>& arguments) {
  std::vector<std::string> all{"run",
                               "-q",
                               "--results",
                               files.results.string(),
                               "--sumo-outputs",
                               files.outputs.string(),
                               "--threads",
                               std::to_string(threads)};
  all.insert(all.end(), arguments.begin(), arguments.end());
  return all;
}

std::string LogTail(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary | std::ios::ate);
  if (!in) return "";
  const auto size = static_cast<std::size_t>(in.tellg());
  in.seekg(static_cast<std::streamoff>(size > kMaxLog ? size - kMaxLog : 0));
  std::string text{std::istreambuf_iterator<char>(in), {}};
  std::erase(text, '\0');
  return text;
}

std::string EndOfWorker(int code, const std::filesystem::path& log, const std::string& at) {
  const std::string last = LastMessage(LogTail(log));
  if (code > 0) return last;
  return fmt::format("aborted: signal {} ({}) {}{}{}", -code, ::strsignal(-code), at,
                     last.empty() ? "" : ": ", last);
}

Worker::Worker(const std::vector<std::string>& arguments, const std::filesystem::path& log)
    : started_(Clock::now()), heard_(started_) {
  std::vector<std::string> words{"lanewise"};
  const auto dashes = std::find(arguments.begin(), arguments.end(), "--");
  words.insert(words.end(), arguments.begin(), dashes);
  words.insert(words.end(), {"--progress-fd", std::to_string(kProgressFd)});
  words.insert(words.end(), dashes, arguments.end());
  std::vector<char*> argv;
  for (std::string& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);
  const int log_fd = ::open(log.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_APPEND | O_CLOEXEC, 0666);
  int ends[2] = {-1, -1};
  if (log_fd < 0 || ::pipe2(ends, O_CLOEXEC) != 0) {
    const std::string what = std::strerror(errno);
    if (log_fd >= 0) ::close(log_fd);
    throw std::runtime_error(fmt::format("{}: {}", log.string(), what));
  }
  const pid_t self = ::getpid();
  pid_ = ::fork();
  if (pid_ == 0) Become(argv.data(), log_fd, ends[1], self);
  ::close(log_fd);
  ::close(ends[1]);
  pipe_ = ends[0];
  ::fcntl(pipe_, F_SETFL, O_NONBLOCK);
  if (pid_ < 0) {
    ::close(pipe_);
    throw std::runtime_error(fmt::format("no process could be started: {}", std::strerror(errno)));
  }
}

Worker::~Worker() {
  if (!ended_) {
    Kill(SIGKILL);
    Wait();
  }
  ::close(pipe_);
}

bool Worker::Read() {
  char chunk[4096];
  while (true) {
    const ssize_t size = ::read(pipe_, chunk, sizeof chunk);
    if (size == 0) return false;
    if (size < 0) {
      if (errno == EINTR) continue;
      break;
    }
    heard_ = Clock::now();
    buffer_.append(chunk, static_cast<std::size_t>(size));
  }
  const std::size_t last = buffer_.rfind('\n');
  if (last == std::string::npos) return true;
  const std::size_t before = last == 0 ? std::string::npos : buffer_.rfind('\n', last - 1);
  const std::string line = buffer_.substr(before == std::string::npos ? 0 : before + 1, last);
  std::sscanf(line.c_str(), "%lf %lf %ld %ld %ld", &time_, &end_, &running_, &arrived_, &expected_);
  buffer_.erase(0, last + 1);
  return true;
}

void Worker::Kill(int signal) {
  if (!ended_) ::kill(pid_, signal);
}

int Worker::Wait() {
  if (!ended_) {
    rusage usage{};
    while (::wait4(pid_, &status_, 0, &usage) < 0 && errno == EINTR) {
    }
    ended_ = true;
    cpu_time_ = Seconds(usage.ru_utime) + Seconds(usage.ru_stime);
  }
  return WIFEXITED(status_) ? WEXITSTATUS(status_) : -WTERMSIG(status_);
}

double Worker::elapsed() const {
  return std::chrono::duration<double>(Clock::now() - started_).count();
}

double Worker::silent_for() const {
  return std::chrono::duration<double>(Clock::now() - heard_).count();
}

double Worker::share() const {
  if (time_ < 0.0) return -1.0;
  double share = -1.0;
  if (arrived_ > 0) share = static_cast<double>(arrived_) / static_cast<double>(arrived_ + expected_);
  if (end_ > 0.0) share = std::max(share, time_ / end_);
  return std::min(share, 1.0);
}

}  // namespace lanewise
