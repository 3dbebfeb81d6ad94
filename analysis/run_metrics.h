#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "analysis/results_file.h"

namespace lanewise {

enum class Better : std::uint8_t { kLower, kHigher, kNeither };

/// A measure of a run: a column of the view v_run_metrics.
struct MetricInfo {
  const char* name{};   ///< The column.
  const char* label{};  ///< As a person reads it, with the unit.
  Better better{Better::kLower};
  bool headline{false};  ///< Compared unless the user chooses.
  const char* meaning{};
};

/// All metrics, in the order they are shown.
std::span<const MetricInfo> AllMetrics();
/// Index of a metric; its unit may be left out, and "mean_" be written before it, the first such metric is
/// meant.
/// @throws ConfigError naming `origin` and the metrics there are.
std::size_t FindMetric(const std::string& name, const std::string& origin);

struct PolicyShare {
  std::string policy{};
  double share{0.0};  ///< Of the vehicles, 0 to 1.
};

/// A run as comparisons see it.
struct RunRecord {
  std::filesystem::path file{};
  std::int64_t run_id{0};
  std::string scenario{};
  std::string policy{};              ///< As asked for.
  std::string label{};               ///< What it is compared as: see LabelRuns.
  double penetration{1.0};           ///< As asked for.
  std::string coordination{"none"};  ///< As asked for.
  std::string rules{};
  std::string v2x{};  ///< How much of a radio channel there was.
  std::int64_t seed{0};
  std::string status{};
  std::string message{};
  std::string
      demand{};  ///< Inputs and SUMO's options without seed, files and outputs: equal means the same demand.
  std::string options{};  ///< The options part of it, for people.
  std::string parameters_json{};
  std::string input_hashes_json{};
  std::string config_file{};
  std::string lanewise_version{}, git_commit{}, sumo_version{}, compiler{}, machine{}, started_at{},
      state_hash{};
  double step_length{0.0};                              ///< [s]
  std::optional<double> wall_time{}, simulated_time{};  ///< [s]
  double agent_share{0.0};                              ///< Of the vehicles.
  std::vector<PolicyShare> shares{};                    ///< Who drove in fact, largest first.
  std::int64_t over_budget{0};                          ///< Mid-block commands not carried out exactly.
  std::int64_t inserted{0}, arrived{0}, still_running{0}, not_inserted{0}, teleported{0};
  std::vector<std::optional<double>>
      metrics{};  ///< One a metric of AllMetrics; nothing: undefined or not finite.
};

/// Every run of the files, labelled. Files are opened for reading only.
/// @param by_file puts the file's name into the labels: the same policy of two files is then two policies.
/// @throws ConfigError naming the file.
std::vector<RunRecord> LoadRuns(std::span<const std::filesystem::path> files, bool by_file = false);

/// Makes labels under which runs may be averaged: the policy that drove, with the realised shares (means over
/// the runs of the same inputs) where vehicles of several policies drove, and the parameters, rules and radio
/// in which runs of one policy differ.
void LabelRuns(bool by_file, std::vector<RunRecord>* runs);

/// Orders labels for people: by policy, then by penetration rate; a policy's bare name is its rate of 100 %.
struct LabelOrder {
  bool operator()(const std::string& a, const std::string& b) const;
};

/// The SQL of results_views.sql, each view as TEMP: for a connection that may only read.
std::string TemporaryViews();

}  // namespace lanewise
