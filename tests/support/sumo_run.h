#pragma once

#include <SQLiteCpp/SQLiteCpp.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <string>

#include "libsumo_bridge/sumo_session.h"
#include "scenarios/run.h"
#include "tests/support/places.h"
#include "tests/support/temporary_folder.h"

namespace lanewise {

/// A shipped network under a policy, quietly, on one thread, until `end` [s].
inline RunConfig ShippedRun(const std::string& scenario, Policy policy, double end) {
  SumoSession::EnsureHome();
  RunConfig config;
  config.scenario = scenario;
  config.config_file = FindShippedScenario(scenario);
  config.policy = policy;
  config.end = end;
  config.threads =
      1;  // ctest runs tests side by side; more threads than cores would only wait for each other.
  config.quiet = true;
  return config;
}

inline std::filesystem::path ShippedFile(const std::string& scenario, const std::string& extension) {
  return FindShippedScenario(scenario).parent_path() / (scenario + extension);
}

/// Own demand on a shipped network.
inline RunConfig OwnDemand(const std::string& scenario, const std::filesystem::path& routes, Policy policy,
                           double end) {
  RunConfig config = ShippedRun(scenario, policy, end);
  config.config_file.clear();
  config.net_file = ShippedFile(scenario, ".net.xml");
  config.route_files = routes.string();
  return config;
}

/// Folder of a Bologna scenario; empty if it is not on this machine.
inline std::filesystem::path BolognaScenario(const std::string& name) {
  const auto file = std::filesystem::path(kBolognaFolder) / name / "run.sumocfg";
  return std::filesystem::exists(file) ? file : std::filesystem::path();
}

/// A Bologna scenario (its file from BolognaScenario) under dwa; SUMO's own outputs go to `outputs`.
inline RunConfig BolognaRun(const std::filesystem::path& file, const std::filesystem::path& outputs,
                            double end) {
  RunConfig config = ShippedRun("town", Policy::kDwa, end);
  config.scenario.clear();
  config.config_file = file;
  config.sumo_output_folder = outputs;
  return config;
}

inline RunReport RunResolved(RunConfig config) {
  Resolve(&config);
  return Run(config);
}

inline const AuditCount& MidBlock(const RunReport& report) {
  return report.audit.by_cause[static_cast<std::size_t>(AuditCause::kMidBlock)];
}

/// One number out of a results file.
inline double Query(const std::filesystem::path& file, const std::string& sql) {
  SQLite::Database database(file.string(), SQLite::OPEN_READONLY);
  return database.execAndGet(sql).getDouble();
}

}  // namespace lanewise
