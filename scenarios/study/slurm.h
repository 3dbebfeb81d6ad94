#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace lanewise {

/// A study as an array of Slurm tasks, each of which works on a shard of its own.
struct SlurmArray {
  std::string name;  ///< Of the job.
  int tasks{1};
  int cpus_per_task{1};
  std::string sbatch_options;      ///< Further ones, as a user writes them.
  std::filesystem::path results;   ///< Of the whole study; the shards are named after it.
  std::vector<std::string> words;  ///< Command of a task, but for its shard and its results.
};

/// "my-2-of-4.sqlite" for my.sqlite.
std::filesystem::path ShardFile(const std::filesystem::path& results, const std::string& index, int count);

/// The batch script. @throws ConfigError if a path cannot be told to Slurm.
std::string SlurmScript(const SlurmArray& array);

/// Writes the script beside the results and hands it to sbatch. @return Slurm's number of the job.
/// @throws ConfigError if the script cannot be written, std::runtime_error if sbatch does not take it.
std::string SubmitSlurm(const SlurmArray& array, const std::filesystem::path& script);

}  // namespace lanewise
