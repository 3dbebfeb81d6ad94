#include "scenarios/study/slurm.h"

#include <fmt/core.h>
#include <sys/wait.h>

#include <cctype>
#include <cstdio>
#include <fstream>
#include <stdexcept>

#include "agents/core/check.h"

namespace lanewise {
namespace {

namespace fs = std::filesystem;

/// For the shell: 'it'\''s'.
std::string Quoted(const std::string& word) {
  std::string text(1, '\'');
  for (const char c : word) c == '\'' ? text.append("'\\''") : text.append(1, c);
  text.append(1, '\'');
  return text;
}

/// Slurm reads its own lines of the script by rules of its own: % stands for numbers.
void CheckPath(const fs::path& path) {
  if (path.string().find_first_of("\"'%\\\n") != std::string::npos)
    throw ConfigError(
        fmt::format("--slurm: results {}; allowed: a path without quotes, backslashes and %", path.string()));
}

std::string JobName(std::string name) {
  for (char& c : name) {
    if (std::isalnum(static_cast<unsigned char>(c)) == 0 && c != '-' && c != '_' && c != '.') c = '_';
  }
  return name;
}

}  // namespace

fs::path ShardFile(const fs::path& results, const std::string& index, int count) {
  return results.parent_path() /
         fmt::format("{}-{}-of-{}{}", results.stem().string(), index, count, results.extension().string());
}

std::string SlurmScript(const SlurmArray& array) {
  const fs::path results = fs::absolute(array.results).lexically_normal();
  CheckPath(results);
  const std::string index = "$SLURM_ARRAY_TASK_ID";
  fs::path log = ShardFile(results, "%a", array.tasks);
  log.replace_extension(".log");
  std::string script = "#!/bin/sh\n";
  const auto option = [&](const std::string& text) { script += fmt::format("#SBATCH {}\n", text); };
  option("--job-name=" + JobName(array.name));
  option(fmt::format("--array=1-{}", array.tasks));
  option(fmt::format("--cpus-per-task={}", array.cpus_per_task));
  option(fmt::format("--output=\"{}\"", log.string()));
  option("--open-mode=append");
  option("--requeue");           // A task that starts again goes on where it was.
  option("--signal=B:TERM@60");  // Before the time is up: it then stops cleanly.
  if (!array.sbatch_options.empty()) option(array.sbatch_options);
  script += "exec";
  for (const std::string& word : array.words) script += fmt::format(" {}", Quoted(word));
  script += fmt::format(" --shard \"{}/{}\" --results \"{}\"\n", index, array.tasks,
                        ShardFile(results, index, array.tasks).string());
  return script;
}

std::string SubmitSlurm(const SlurmArray& array, const fs::path& script) {
  std::ofstream out(script);
  out << SlurmScript(array);
  out.close();
  if (!out)
    throw ConfigError(
        fmt::format("--slurm: {} cannot be written; its folder must exist and be writable", script.string()));
  std::FILE* sbatch = ::popen(fmt::format("sbatch --parsable {}", Quoted(script.string())).c_str(), "re");
  if (sbatch == nullptr) throw std::runtime_error("sbatch could not be started");
  std::string job;
  char chunk[256];
  while (std::fgets(chunk, sizeof chunk, sbatch) != nullptr) job += chunk;
  const int status = ::pclose(sbatch);
  if (!WIFEXITED(status) || WEXITSTATUS(status) != 0) {
    throw std::runtime_error(
        fmt::format("{}; its script is {}; without Slurm: lanewise study --shard I/N for each I",
                    WIFEXITED(status) && WEXITSTATUS(status) == 127
                        ? "there is no sbatch here; on Debian it comes with slurm-client"
                        : fmt::format("sbatch refused the job (exit code {})",
                                      WIFEXITED(status) ? WEXITSTATUS(status) : -1),
                    script.string()));
  }
  return job.substr(0, job.find_first_of(";\n"));  // "job;cluster".
}

}  // namespace lanewise
