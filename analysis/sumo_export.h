#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>

namespace lanewise {

enum class ExportTable : std::uint8_t { kTrips, kTrajectories, kEncounters, kEdges };

const char* ToString(ExportTable table);

/// How often and of what progress is told: rows written so far.
using ExportProgress = std::function<void(std::int64_t rows)>;

/// Writes a table of a results file as SUMO's tools name and nest it. The file's name says how:
///   .csv, .csv.gz   columns element_attribute separated by ';', as SUMO's xml2csv.py writes them
///   .xml, .xml.gz   SUMO's own output: tripinfo, fcd, ssm or edgeData (meandata)
/// Angles are SUMO's (degrees clockwise from north), times and lengths SI; what SUMO's outputs do not know
/// stands in an element `lanewise` of its own. Moments are SUMO's: it names a step by the time it began at,
/// the results by the time it led to, so exported times are one step length less. Undefined values are empty
/// in CSV and left out in XML. The file appears under its name only when it is complete. An existing one is
/// replaced.
/// @param run_id nothing: every run of the file, with leading columns run_id;run_policy;run_seed; CSV only.
/// @returns the number of rows. @throws ConfigError naming the file and what is wrong.
std::int64_t ExportResults(const std::filesystem::path& results, ExportTable table,
                           std::optional<std::int64_t> run_id, const std::filesystem::path& output,
                           const ExportProgress& progress = {});

/// Refuses a name that ExportResults could not write. @throws ConfigError.
void CheckExportName(const std::filesystem::path& output, bool all_runs);

}  // namespace lanewise
