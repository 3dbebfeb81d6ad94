#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "analysis/comparison.h"

namespace lanewise {

/// One self-contained HTML page about the runs of results files: comparison, metric by policy with intervals,
/// time-space diagram, flow and density, distributions of TTC and PET, conflict map, metric against
/// penetration, V2X, provenance. Sections of which nothing was recorded say so; those of V2X are left out.
/// The network's geometry comes from the net file named in the run's inputs; without it the map shows its
/// conflicts only.
/// @param runs as LoadRuns gave them. @param params of the comparison in its tables; means by policy are of
/// all metrics.
/// @throws ConfigError.
std::string BuildReport(std::span<const RunRecord> runs, const CompareParams& params,
                        const std::string& version);

}  // namespace lanewise
