#pragma once

#include <fcntl.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <string>
#include <vector>

#include "tests/support/places.h"
#include "tests/support/temporary_folder.h"

namespace lanewise {

/// The built `lanewise` as a child process; its outputs go to files.
class ChildProcess {
 public:
  /// @param environment "NAME=VALUE" added to this process's.
  explicit ChildProcess(const std::vector<std::string>& arguments,
                        const std::vector<std::string>& environment = {}) {
    const std::string out = (folder_ / "stdout").string(), err = (folder_ / "stderr").string();
    std::vector<std::string> words{kLanewiseBinary};
    words.insert(words.end(), arguments.begin(), arguments.end());
    std::vector<char*> argv;
    for (std::string& word : words) argv.push_back(word.data());
    argv.push_back(nullptr);
    pid_ = ::fork();
    if (pid_ == 0) {
      ::dup2(::open(out.c_str(), O_WRONLY | O_CREAT, 0600), STDOUT_FILENO);
      ::dup2(::open(err.c_str(), O_WRONLY | O_CREAT, 0600), STDERR_FILENO);
      for (const std::string& word : environment) ::putenv(const_cast<char*>(word.c_str()));
      ::execv(argv[0], argv.data());
      ::_exit(127);
    }
  }
  ~ChildProcess() {
    if (!ended_) {
      Signal(SIGKILL);
      Wait();
    }
  }
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;

  pid_t pid() const { return pid_; }
  void Signal(int signal) const { ::kill(pid_, signal); }
  bool Running() {
    if (!ended_ && ::waitpid(pid_, &status_, WNOHANG) == pid_) ended_ = true;
    return !ended_;
  }
  /// Waits for the end. @return the exit code, or minus the signal that ended it.
  int Wait() {
    if (!ended_ && ::waitpid(pid_, &status_, 0) == pid_) ended_ = true;
    return WIFEXITED(status_) ? WEXITSTATUS(status_) : -WTERMSIG(status_);
  }
  std::string Output() const { return ReadFile(folder_ / "stdout"); }
  std::string Errors() const { return ReadFile(folder_ / "stderr"); }

 private:
  TemporaryFolder folder_;
  pid_t pid_{-1};
  int status_{0};
  bool ended_{false};
};

}  // namespace lanewise
