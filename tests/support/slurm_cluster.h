#pragma once

#include <arpa/inet.h>
#include <fcntl.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <fstream>
#include <initializer_list>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/temporary_folder.h"

namespace lanewise {

/// A real Slurm on this machine while the object lives: authentication, a controller and one node, all on
/// loopback with files in a folder of their own. Needs Debian's munge and slurm-wlm, and root.
class SlurmCluster {
 public:
  SlurmCluster() { problem_ = Start(); }
  ~SlurmCluster() {
    for (auto process = processes_.rbegin(); process != processes_.rend(); ++process) {
      ::kill(*process, SIGTERM);
      for (int k = 0; k < 100 && ::waitpid(*process, nullptr, WNOHANG) == 0; ++k) Pause();
      ::kill(*process, SIGKILL);
      ::waitpid(*process, nullptr, 0);
    }
    ::unsetenv("SLURM_CONF");
  }
  SlurmCluster(const SlurmCluster&) = delete;
  SlurmCluster& operator=(const SlurmCluster&) = delete;

  /// Why it is not there; empty if it is.
  const std::string& problem() const { return problem_; }

  /// Waits until no job is left. @return whether that came about.
  bool WaitForJobs(int seconds) const {
    for (int k = 0; k < 10 * seconds; ++k) {
      if (Run({"squeue", "--noheader"}).empty()) return true;
      Pause();
    }
    return false;
  }

  /// Output of a command.
  static std::string Run(const std::vector<std::string>& words) {
    std::string command;
    for (const std::string& word : words) command += "'" + word + "' ";
    std::FILE* pipe = ::popen((command + "2>&1").c_str(), "re");
    std::string output;
    char chunk[256];
    while (pipe != nullptr && std::fgets(chunk, sizeof chunk, pipe) != nullptr) output += chunk;
    if (pipe != nullptr) ::pclose(pipe);
    return output;
  }

 private:
  static void Pause() { std::this_thread::sleep_for(std::chrono::milliseconds(100)); }

  /// A port that is free now.
  static int FreePort() {
    const int fd = ::socket(AF_INET, SOCK_STREAM, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    ::bind(fd, reinterpret_cast<sockaddr*>(&address), size);
    ::getsockname(fd, reinterpret_cast<sockaddr*>(&address), &size);
    ::close(fd);
    return ntohs(address.sin_port);
  }

  static std::string FindProgram(const std::string& name) {
    for (const char* folder : {"/usr/sbin/", "/usr/bin/", "/sbin/", "/bin/"}) {
      if (::access((folder + name).c_str(), X_OK) == 0) return folder + name;
    }
    return "";
  }

  void Launch(const std::vector<std::string>& words) {
    const std::string log =
        (folder_ / (std::filesystem::path(words[0]).filename().string() + ".out")).string();
    std::vector<char*> argv;
    for (const std::string& word : words) argv.push_back(const_cast<char*>(word.c_str()));
    argv.push_back(nullptr);
    const pid_t pid = ::fork();
    if (pid == 0) {
      const int fd = ::open(log.c_str(), O_WRONLY | O_CREAT | O_APPEND, 0600);
      ::dup2(fd, STDOUT_FILENO);
      ::dup2(fd, STDERR_FILENO);
      ::execv(argv[0], argv.data());
      ::_exit(127);
    }
    processes_.push_back(pid);
  }

  void WriteConfiguration(const std::string& host, const std::string& socket) const {
    const std::string folder = folder_.path().string();
    folder_.Write(
        "slurm.conf",
        fmt::format(
            "ClusterName=test\nSlurmctldHost={0}(127.0.0.1)\nSlurmctldPort={1}\nSlurmdPort={2}\n"
            "CommunicationParameters=NoInAddrAny,NoCtldInAddrAny\nSlurmUser=root\nSlurmdUser=root\n"
            "AuthType=auth/munge\nAuthInfo=socket={3}\nCredType=cred/munge\n"
            "StateSaveLocation={4}/state\nSlurmdSpoolDir={4}/spool\nSlurmctldPidFile={4}/slurmctld.pid\n"
            "SlurmdPidFile={4}/slurmd.pid\nProctrackType=proctrack/pgid\nTaskPlugin=task/none\n"
            "SelectType=select/cons_tres\nSelectTypeParameters=CR_Core\nMpiDefault=none\n"
            "JobAcctGatherType=jobacct_gather/none\nAccountingStorageType=accounting_storage/none\n"
            "ReturnToService=2\nKillWait=2\nSchedulerParameters=sched_interval=1,batch_sched_delay=0\n"
            "NodeName={0} NodeAddr=127.0.0.1 CPUs=2 State=UNKNOWN\n"
            "PartitionName=main Nodes=ALL Default=YES MaxTime=INFINITE State=UP\n",
            host, FreePort(), FreePort(), socket, folder));
  }

  std::string Start() {
    if (::geteuid() != 0) return "Slurm's node daemon needs root";
    for (const char* name : {"munged", "slurmctld", "slurmd", "sbatch", "squeue", "sinfo"}) {
      if (FindProgram(name).empty())
        return fmt::format("there is no {}; Debian's packages are munge and slurm-wlm", name);
    }
    char host[256] = "";
    ::gethostname(host, sizeof host - 1);
    const std::string short_host = std::string(host).substr(0, std::string(host).find('.'));
    const std::filesystem::path socket = folder_ / "munge.sock", config = folder_ / "slurm.conf";
    std::string key(128, '\0');
    std::random_device random;
    for (char& c : key) c = static_cast<char>(random());
    ::chmod(folder_.Write("munge.key", key).c_str(), 0600);
    WriteConfiguration(short_host, socket.string());
    for (const char* name : {"state", "spool"}) std::filesystem::create_directory(folder_ / name);
    ::setenv("SLURM_CONF", config.c_str(), 1);
    Launch({FindProgram("munged"), "--foreground", "--force",
            "--key-file=" + (folder_ / "munge.key").string(), "--socket=" + socket.string(),
            "--pid-file=" + (folder_ / "munged.pid").string(),
            "--log-file=" + (folder_ / "munged.log").string(),
            "--seed-file=" + (folder_ / "munge.seed").string()});
    for (int k = 0; k < 50 && !std::filesystem::exists(socket); ++k) Pause();
    Launch({FindProgram("slurmctld"), "-D", "-i", "-f", config.string()});
    Launch({FindProgram("slurmd"), "-D", "-f", config.string()});
    std::string state;
    for (int k = 0; k < 200 && state.find("idle") == std::string::npos; ++k) {
      Pause();
      state = Run({"sinfo", "--noheader", "--format=%T"});
    }
    if (state.find("idle") != std::string::npos) return "";
    std::string why = fmt::format("Slurm did not come up: {}", state);
    for (const char* log : {"munged.out", "slurmctld.out", "slurmd.out"}) why += ReadFile(folder_ / log);
    return why;
  }

  TemporaryFolder folder_;
  std::vector<pid_t> processes_;
  std::string problem_;
};

}  // namespace lanewise
