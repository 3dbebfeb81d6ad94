#include "scenarios/doctor.h"

#include <SQLiteCpp/SQLiteCpp.h>
#include <ceres/version.h>
#include <fmt/core.h>
#include <omp.h>

#include <Eigen/Core>
#include <cstdlib>
#include <filesystem>

#include "libsumo_bridge/sumo_session.h"
#include "scenarios/run.h"

namespace lanewise {

bool RunDoctor() {
  bool ok = true;
  const auto line = [&](bool good, const char* what, const std::string& found) {
    fmt::print("{:<5} {:<22} {}\n", good ? "ok" : "FAIL", what, found);
    ok = ok && good;
  };
  line(true, "lanewise",
       fmt::format("{} ({}, {})", LANEWISE_VERSION, LANEWISE_GIT_COMMIT, LANEWISE_COMPILER));
  const char* given = std::getenv("SUMO_HOME");
  const std::string home = SumoSession::EnsureHome();
  const bool schemas = std::filesystem::exists(std::filesystem::path(home) / "data" / "xsd" / "net_file.xsd");
  line(schemas, "SUMO_HOME",
       fmt::format("{}{}{}", home, given == nullptr ? " (not set; found when built)" : "",
                   schemas ? "" : ": holds no data/xsd; install sumo, or set SUMO_HOME"));
  line(true, "libsumo", SumoSession::Version());
  line(true, "SQLite", SQLite::getLibVersion());
  line(true, "Eigen", fmt::format("{}.{}.{}", EIGEN_WORLD_VERSION, EIGEN_MAJOR_VERSION, EIGEN_MINOR_VERSION));
  line(true, "Ceres", CERES_VERSION_STRING);
  line(true, "OpenMP", fmt::format("{} threads", omp_get_max_threads()));
  line(!ShippedScenarios().empty(), "shipped scenarios", fmt::format("{}", ShippedScenarios().size()));
  try {
    RunConfig config;
    config.config_file = FindShippedScenario("town");
    config.end = 2.0;
    config.quiet = true;
    Resolve(&config);
    const RunReport report = Run(config);
    const AuditCount& audit = report.audit.by_cause[static_cast<std::size_t>(AuditCause::kMidBlock)];
    line(audit.different == 0, "self-check",
         fmt::format("2 s of 'town': {} vehicles, {} vehicle-steps, {} of {} commands not carried out",
                     report.outcome.inserted, report.outcome.vehicle_steps, audit.different, audit.steps));
  } catch (const std::exception& error) {
    line(false, "self-check", error.what());
  }
  return ok;
}

}  // namespace lanewise
