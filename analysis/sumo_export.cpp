#include "analysis/sumo_export.h"

#include <SQLiteCpp/SQLiteCpp.h>
#include <fmt/core.h>
#include <sqlite3.h>
#include <zlib.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string_view>
#include <vector>

#include "agents/core/check.h"
#include "analysis/results_file.h"
#include "analysis/run_metrics.h"

namespace lanewise {
namespace {

namespace fs = std::filesystem;

/// A file that gets its name when it is complete; gzipped if the name ends in .gz.
class OutputFile {
 public:
  explicit OutputFile(fs::path path) : path_(std::move(path)), part_(path_.string() + ".part") {
    const bool zip = path_.extension() == ".gz";
    file_ = gzopen(part_.c_str(), zip ? "wb6" : "wbT");
    if (file_ == nullptr)
      throw ConfigError(
          fmt::format("{}: cannot be written; its folder must exist and be writable", path_.string()));
    gzbuffer(file_, 1 << 18);
  }
  ~OutputFile() {
    if (file_ == nullptr) return;
    gzclose(file_);
    std::error_code ignored;
    fs::remove(part_, ignored);
  }
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;

  void Write(std::string_view text) {
    if (!text.empty() && gzwrite(file_, text.data(), static_cast<unsigned>(text.size())) <= 0) Fail();
  }
  void Finish() {
    const int status = gzclose(file_);
    file_ = nullptr;
    std::error_code error;
    if (status == Z_OK) fs::rename(part_, path_, error);
    if (status == Z_OK && !error) return;
    fs::remove(part_, error);
    Fail();
  }

 private:
  [[noreturn]] void Fail() const {
    throw ConfigError(fmt::format("{}: could not be written; is the disk full?", path_.string()));
  }

  fs::path path_, part_;
  gzFile file_{nullptr};
};

/// A column of an export's query: "element_attribute". Elements are nested in the order they come in.
struct Column {
  std::string element{};
  std::string attribute{};
};

struct TableSpec {
  const char* name;   ///< For people.
  const char* root;   ///< XML's document element.
  const char* group;  ///< Element that stays open while its attributes do not change; "": none.
  const char* row;    ///< Elements after this one are its children, unless it is empty.
  std::string sql;    ///< With {run} for the condition on the run.
};

/// The states' columns for one of SUMO's elements: NULL for rows of the other one.
std::string StateColumns(const char* element, const char* condition, bool person) {
  const auto column = [&](const char* expression, const char* attribute) {
    return fmt::format(", CASE WHEN {} THEN {} END AS {}_{}", condition, expression, element, attribute);
  };
  // The order of SUMO's fcd output: plot_trajectories.py relies on it.
  return column("v.vehicle_id", "id") + column("t.x_m", "x") + column("t.y_m", "y") +
         column(
             "(CASE WHEN t.heading_rad > 1.5707963267948966 THEN 450.0 ELSE 90.0 END) - 57.29577951308232 * "
             "t.heading_rad",
             "angle") +
         column("v.type", "type") + column("t.speed_mps", "speed") + column("t.lane_pos_m", "pos") +
         (person ? column("COALESCE(substr(l.lane_id, 1, length(rtrim(l.lane_id, '0123456789')) - 1), '')",
                          "edge")
                 : column("COALESCE(l.lane_id, '')", "lane") + column("t.lateral_offset_m", "posLat") +
                       column("t.accel_mps2", "acceleration"));
}

/// The event recorder's samples of each encounter as device.ssm writes trajectories: a value a sample, with
/// spaces between. Spans are for XML; a table of them would be of no use to anybody.
std::string SpanColumns() {
  const auto span = [](const char* element, const char* name) {
    return fmt::format(", s.{} AS {}_values", name, element);
  };
  return span("timeSpan", "times") + span("typeSpan", "types") + span("egoPosition", "ego_xy") +
         span("egoVelocity", "ego_v") + span("foePosition", "foe_xy") + span("foeVelocity", "foe_v") +
         span("conflictPoint", "points");
}

/// What SpanColumns and the two spans of measures read, one row an encounter. The conflict point is SUMO's
/// for following, the leader's rear; else the encounter's place.
std::string SpanTable() {
  const auto of = [](const char* role, const char* text) {
    const bool ego = std::string_view(role) == "ego";
    std::string sql = fmt::format("CASE WHEN (e.ego_vehicle = e.first_vehicle) = {} THEN ", ego ? 1 : 0);
    for (const char* who : {"first", "second"}) {
      std::string expression = text;
      for (std::size_t at; (at = expression.find('@')) != std::string::npos;)
        expression.replace(at, 1, fmt::format("c.{}_", who));
      sql += expression + (std::string_view(who) == "first" ? " ELSE " : " END");
    }
    return sql;
  };
  const char* position = "printf('%.2f,%.2f', @x_m, @y_m)";
  const char* velocity =
      "printf('%.2f,%.2f', @speed_mps * cos(@heading_rad), @speed_mps * sin(@heading_rad))";
  const char* rear =
      "printf('%.2f,%.2f', @x_m - f.length_m * cos(@heading_rad), @y_m - f.length_m * sin(@heading_rad))";
  // A group's rows come in the order of the inner query.
  return fmt::format(
      " LEFT JOIN (SELECT run_id, encounter, group_concat(time, ' ') AS times, group_concat(type, ' ') AS "
      "types, "
      "group_concat(ego_xy, ' ') AS ego_xy, group_concat(ego_v, ' ') AS ego_v, group_concat(foe_xy, ' ') AS "
      "foe_xy, "
      "group_concat(foe_v, ' ') AS foe_v, group_concat(point, ' ') AS points, group_concat(ttc, ' ') AS "
      "ttcs, "
      "group_concat(drac, ' ') AS dracs FROM (SELECT c.run_id, c.encounter, "
      "printf('%.2f', c.time_s - run.step_length_s) AS time, c.type_code AS type, {} AS ego_xy, {} AS ego_v, "
      "{} AS "
      "foe_xy, {} AS foe_v, CASE WHEN e.type = 'following' THEN {} ELSE printf('%.2f,%.2f', e.x_m, e.y_m) "
      "END AS "
      "point, CASE WHEN c.ttc_s < 1e9 THEN printf('%.2f', c.ttc_s) ELSE 'NA' END AS ttc, CASE WHEN "
      "c.drac_mps2 < 1e9 THEN printf('%.2f', c.drac_mps2) ELSE 'NA' END AS "
      "drac "
      "FROM encounter_sample AS c JOIN encounter AS e USING (run_id, encounter) JOIN run USING (run_id) JOIN "
      "vehicle "
      "AS f ON f.run_id = e.run_id AND f.vehicle_number = e.foe_vehicle WHERE {{run}} ORDER BY c.run_id, "
      "c.encounter, "
      "c.time_s) GROUP BY run_id, encounter) AS s ON s.run_id = e.run_id AND s.encounter = e.encounter",
      of("ego", position), of("ego", velocity), of("foe", position), of("foe", velocity), of("foe", rear));
}

TableSpec SpecOf(ExportTable table, bool xml) {
  switch (table) {
    case ExportTable::kTrips:
      return {
          "trips", "tripinfos", "", "tripinfo",
          "SELECT v.vehicle_id AS tripinfo_id, t.depart_s - run.step_length_s AS tripinfo_depart, "
          "t.depart_delay_s AS "
          "tripinfo_departDelay, COALESCE(t.arrival_s - run.step_length_s, -1.0) AS tripinfo_arrival, "
          "t.duration_s AS "
          "tripinfo_duration, t.route_length_m AS tripinfo_routeLength, t.waiting_time_s AS "
          "tripinfo_waitingTime, "
          "t.waiting_count AS tripinfo_waitingCount, t.stop_time_s AS tripinfo_stopTime, t.time_loss_s AS "
          "tripinfo_timeLoss, v.type AS tripinfo_vType, CASE WHEN t.trip_end IN ('vaporized', 'teleported') "
          "THEN "
          "t.trip_end ELSE '' END AS tripinfo_vaporized, t.co2_mg AS emissions_CO2_abs, t.nox_mg AS "
          "emissions_NOx_abs, t.pmx_mg AS emissions_PMx_abs, t.fuel_mg AS emissions_fuel_abs, "
          "t.electricity_wh AS "
          "emissions_electricity_abs, v.policy AS lanewise_policy, v.vclass AS lanewise_vClass, t.trip_end "
          "AS "
          "lanewise_tripEnd, t.agent_steps * 1.0 / NULLIF(t.steps, 0) AS lanewise_agentShare, "
          "t.max_accel_mps2 AS "
          "lanewise_maxAccel, t.max_decel_mps2 AS lanewise_maxDecel, t.max_jerk_mps3 AS lanewise_maxJerk, "
          "t.rms_jerk_mps3 AS lanewise_rmsJerk, t.max_lateral_accel_mps2 AS lanewise_maxLateralAccel, "
          "t.hard_braking_count AS lanewise_hardBraking, t.min_ttc_s AS lanewise_minTTC, t.max_drac_mps2 AS "
          "lanewise_maxDRAC, t.ttc_exposed_s AS lanewise_TET FROM trip AS t JOIN vehicle AS v USING (run_id, "
          "vehicle_number) JOIN run USING (run_id) WHERE {run} ORDER BY t.run_id, t.depart_s + t.duration_s, "
          "t.vehicle_number"};
    case ExportTable::kTrajectories:
      // In the order of rows, which is that of time within a run; a sort of millions of rows would cost
      // minutes.
      return {"trajectories", "fcd-export", "timestep", "vehicle",
              "SELECT t.time_s - run.step_length_s AS timestep_time" +
                  StateColumns("vehicle", "v.vclass <> 'pedestrian'", false) +
                  StateColumns("person", "v.vclass = 'pedestrian'", true) +
                  " FROM trajectory AS t NOT INDEXED CROSS JOIN vehicle AS v ON v.run_id = t.run_id AND "
                  "v.vehicle_number = t.vehicle_number CROSS JOIN run ON run.run_id = t.run_id LEFT JOIN "
                  "lane AS l ON "
                  "l.run_id = t.run_id AND l.lane = t.lane WHERE {run} ORDER BY t.rowid"};
    case ExportTable::kEncounters: {
      // SUMO writes NA for what is undefined; in a table an empty field says so.
      const auto extreme = [xml](const char* element, const char* value, const char* time) {
        const auto or_na = [xml](const std::string& text) {
          return xml ? fmt::format("COALESCE({}, 'NA')", text) : text;
        };
        const auto if_known = [&](const std::string& text) {
          return or_na(fmt::format("CASE WHEN {} IS NOT NULL THEN {} END", value, text));
        };
        return fmt::format(
            ", {1} AS {0}_time{2}, {3} AS {0}_type, {4} AS {0}_value", element,
            or_na(fmt::format("{} - run.step_length_s", time)),
            xml ? fmt::format(", {} AS {}_position", if_known("printf('%.2f,%.2f', e.x_m, e.y_m)"), element)
                : "",
            if_known("e.type_code"), or_na(value));
      };
      const auto measured = [xml](const char* element, const char* name) {
        return xml ? fmt::format(", s.{} AS {}_values", name, element) : "";
      };
      return {
          "encounters", "SSMLog", "", "conflict",
          "SELECT e.begin_s - run.step_length_s AS conflict_begin, e.end_s - run.step_length_s AS "
          "conflict_end, a.vehicle_id AS conflict_ego, b.vehicle_id "
          "AS conflict_foe" +
              (xml ? SpanColumns() : "") + measured("TTCSpan", "ttcs") +
              extreme("minTTC", "e.min_ttc_s", "e.min_ttc_time_s") + measured("DRACSpan", "dracs") +
              extreme("maxDRAC", "e.max_drac_mps2", "e.max_drac_time_s") +
              extreme("PET", "e.pet_s", "e.pet_time_s") +
              extreme("minMTTC", "e.min_mttc_s", "e.min_mttc_time_s") +
              ", e.type AS lanewise_type, e.severity AS lanewise_severity, e.critical_s - run.step_length_s "
              "AS lanewise_critical, e.x_m "
              "AS lanewise_x, e.y_m AS lanewise_y, e.in_junction AS lanewise_inJunction, e.min_distance_m AS "
              "lanewise_minDistance, e.max_closing_speed_mps AS lanewise_maxClosingSpeed, e.contact AS "
              "lanewise_contact, e.near_miss AS lanewise_nearMiss, a.policy AS lanewise_egoPolicy, b.policy "
              "AS "
              "lanewise_foePolicy FROM encounter AS e JOIN run USING (run_id) JOIN vehicle AS a ON a.run_id "
              "= "
              "e.run_id AND a.vehicle_number = e.ego_vehicle JOIN vehicle AS b ON b.run_id = e.run_id AND "
              "b.vehicle_number = e.foe_vehicle" +
              (xml ? SpanTable() : "") + " WHERE {run} ORDER BY e.run_id, e.encounter"};
    }
    case ExportTable::kEdges:
      return {"edges", "meandata", "interval", "edge",
              "SELECT i.begin_s AS interval_begin, i.end_s AS interval_end, 'lanewise' AS interval_id, "
              "e.edge_id AS "
              "edge_id, i.vehicle_time_s AS edge_sampledSeconds, e.length_m / NULLIF(i.speed_mps, 0.0) AS "
              "edge_traveltime, i.density_veh_per_km AS edge_density, i.density_veh_per_km / e.lanes AS "
              "edge_laneDensity, i.speed_mps AS edge_speed, i.waiting_time_s AS edge_waitingTime, "
              "i.time_loss_s AS "
              "edge_timeLoss, i.entered AS edge_entered, i.flow_veh_per_h AS edge_flow, i.co2_mg AS "
              "edge_CO2_abs, "
              "i.nox_mg AS edge_NOx_abs, i.pmx_mg AS edge_PMx_abs, i.fuel_mg AS edge_fuel_abs, "
              "i.electricity_wh AS "
              "edge_electricity_abs, i.speed_variance_m2ps2 AS edge_speedVariance FROM edge_interval AS i "
              "JOIN run "
              "USING (run_id) JOIN edge AS e USING (run_id, edge) WHERE {run} ORDER BY i.run_id, i.begin_s, "
              "i.edge"};
  }
  return {};
}

/// Six decimals at most, none that are zero.
void AppendNumber(double value, std::string* text) {
  if (!std::isfinite(value)) return;
  const std::size_t start = text->size();
  fmt::format_to(std::back_inserter(*text), "{:.6f}", value);
  while (text->back() == '0') text->pop_back();
  if (text->back() == '.') text->pop_back();
  if (std::string_view(*text).substr(start) == "-0") text->erase(start, 1);
}

void AppendXml(std::string_view value, std::string* text) {
  for (const char c : value) {
    switch (c) {
      case '&':
        *text += "&amp;";
        break;
      case '<':
        *text += "&lt;";
        break;
      case '>':
        *text += "&gt;";
        break;
      case '"':
        *text += "&quot;";
        break;
      default:
        *text += c;
    }
  }
}

void AppendCsv(std::string_view value, std::string* text) {
  if (value.find_first_of(";\"\n") == std::string_view::npos) {
    text->append(value);
    return;
  }
  *text += '"';
  for (const char c : value) text->append(c == '"' ? 2 : 1, c);
  *text += '"';
}

/// SQLite's own interface: a row of an export has up to twenty columns, and a wrapper's object for each is
/// dear.
class RowReader {
 public:
  RowReader(SQLite::Database* database, const std::string& sql, const fs::path& path) : path_(path) {
    database_ = database->getHandle();
    if (sqlite3_prepare_v2(database_, sql.c_str(), -1, &statement_, nullptr) != SQLITE_OK) Fail();
    for (int k = 0; k < sqlite3_column_count(statement_); ++k) {
      const std::string name = sqlite3_column_name(statement_, k);
      const std::size_t split = name.find('_');
      columns_.push_back({name.substr(0, split), name.substr(split + 1)});
    }
  }
  ~RowReader() { sqlite3_finalize(statement_); }
  RowReader(const RowReader&) = delete;
  RowReader& operator=(const RowReader&) = delete;

  bool Next() {
    const int status = sqlite3_step(statement_);
    if (status != SQLITE_ROW && status != SQLITE_DONE) Fail();
    return status == SQLITE_ROW;
  }
  const std::vector<Column>& columns() const { return columns_; }
  bool IsNull(std::size_t k) const {
    return sqlite3_column_type(statement_, static_cast<int>(k)) == SQLITE_NULL;
  }
  template <class AppendText>
  void Append(std::size_t k, AppendText append, std::string* text) const {
    const int column = static_cast<int>(k);
    switch (sqlite3_column_type(statement_, column)) {
      case SQLITE_INTEGER:
        fmt::format_to(std::back_inserter(*text), "{}", sqlite3_column_int64(statement_, column));
        break;
      case SQLITE_FLOAT:
        AppendNumber(sqlite3_column_double(statement_, column), text);
        break;
      case SQLITE_TEXT:
        append(std::string_view(reinterpret_cast<const char*>(sqlite3_column_text(statement_, column)),
                                static_cast<std::size_t>(sqlite3_column_bytes(statement_, column))),
               text);
        break;
      default:
        break;
    }
  }

 private:
  [[noreturn]] void Fail() const { throw SQLite::Exception(database_, sqlite3_extended_errcode(database_)); }

  fs::path path_;
  sqlite3* database_{nullptr};
  sqlite3_stmt* statement_{nullptr};
  std::vector<Column> columns_;
};

void AppendCsvHeader(const std::vector<Column>& columns, std::string* text) {
  for (std::size_t k = 0; k < columns.size(); ++k)
    *text += fmt::format("{}{}_{}", k == 0 ? "" : ";", columns[k].element, columns[k].attribute);
  *text += '\n';
}

void AppendCsvRow(const RowReader& row, std::string* text) {
  for (std::size_t k = 0; k < row.columns().size(); ++k) {
    if (k > 0) *text += ';';
    row.Append(k, AppendCsv, text);
  }
  *text += '\n';
}

/// Rows as nested elements, two levels deep below the root: a group and its rows, or a row and its children.
class XmlNester {
 public:
  XmlNester(const TableSpec& spec, const std::vector<Column>& columns) : spec_(spec) {
    for (std::size_t k = 0; k < columns.size(); ++k) {
      if (elements_.empty() || elements_.back().name != columns[k].element)
        elements_.push_back({columns[k].element, k, k, {}});
      elements_.back().last = k;
    }
  }

  void Append(const RowReader& row, std::string* text) {
    for (Element& element : elements_) {
      element.attributes.clear();
      for (std::size_t k = element.first; k <= element.last; ++k) {
        if (row.IsNull(k)) continue;
        element.attributes += fmt::format(" {}=\"", row.columns()[k].attribute);
        row.Append(k, AppendXml, &element.attributes);
        element.attributes += '"';
      }
    }
    const bool grouped = spec_.group[0] != '\0';
    bool open = false;
    for (const Element& element : elements_) {
      if (element.attributes.empty()) continue;
      if (element.name == spec_.group) {
        if (element.attributes == group_) continue;
        CloseGroup(text);
        group_ = element.attributes;
        *text += fmt::format("    <{}{}>\n", element.name, element.attributes);
      } else if (!grouped && element.name == spec_.row) {
        *text += fmt::format("    <{}{}>\n", element.name, element.attributes);
        open = true;
      } else {
        *text += fmt::format("        <{}{}/>\n", element.name, element.attributes);
      }
    }
    if (open) *text += fmt::format("    </{}>\n", spec_.row);
  }

  void CloseGroup(std::string* text) {
    if (!group_.empty()) *text += fmt::format("    </{}>\n", spec_.group);
    group_.clear();
  }

 private:
  struct Element {
    std::string name{};
    std::size_t first{0}, last{0};
    std::string attributes{};
  };
  const TableSpec& spec_;
  std::vector<Element> elements_;
  std::string group_;
};

bool IsXml(const fs::path& output) {
  const std::string name = output.filename().string();
  return name.ends_with(".xml") || name.ends_with(".xml.gz");
}

std::int64_t Write(SQLite::Database* database, const fs::path& results, const TableSpec& spec,
                   std::optional<std::int64_t> run_id, const fs::path& output,
                   const ExportProgress& progress) {
  std::string sql = spec.sql;
  const std::string condition = run_id ? fmt::format("run.run_id = {}", *run_id) : "1";
  for (std::size_t at; (at = sql.find("{run}")) != std::string::npos;) sql.replace(at, 5, condition);
  if (!run_id)
    sql.replace(0, 7, "SELECT run.run_id AS run_id, run.policy AS run_policy, run.seed AS run_seed, ");
  RowReader row(database, sql, results);
  OutputFile file(output);
  const bool xml = IsXml(output);
  XmlNester nester(spec, row.columns());
  std::string text;
  if (xml) {
    text = fmt::format("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<{}>\n", spec.root);
  } else {
    AppendCsvHeader(row.columns(), &text);
  }
  std::int64_t rows = 0;
  while (row.Next()) {
    xml ? nester.Append(row, &text) : AppendCsvRow(row, &text);
    ++rows;
    if (text.size() > 1 << 16) {
      file.Write(text);
      text.clear();
      if (progress) progress(rows);
    }
  }
  if (xml) {
    nester.CloseGroup(&text);
    text += fmt::format("</{}>\n", spec.root);
  }
  file.Write(text);
  file.Finish();
  return rows;
}

}  // namespace

const char* ToString(ExportTable table) {
  switch (table) {
    case ExportTable::kTrips:
      return "trips";
    case ExportTable::kTrajectories:
      return "trajectories";
    case ExportTable::kEncounters:
      return "encounters";
    case ExportTable::kEdges:
      return "edges";
  }
  return "";
}

void CheckExportName(const fs::path& output, bool all_runs) {
  const std::string name = output.filename().string();
  const bool csv = name.ends_with(".csv") || name.ends_with(".csv.gz");
  if (!csv && !IsXml(output))
    throw ConfigError(fmt::format(
        "{}: the name's ending says the format; allowed: .csv, .csv.gz, .xml, .xml.gz", output.string()));
  if (all_runs && !csv)
    throw ConfigError(fmt::format(
        "{}: SUMO's XML holds one run; choose it with --run, or write .csv or .csv.gz", output.string()));
  std::error_code error;
  if (fs::is_directory(output, error))
    throw ConfigError(fmt::format("{}: it is a folder; name a file", output.string()));
}

std::int64_t ExportResults(const fs::path& results, ExportTable table, std::optional<std::int64_t> run_id,
                           const fs::path& output, const ExportProgress& progress) {
  CheckExportName(output, !run_id);
  std::int64_t rows = 0;
  GuardResults(results, [&] {
    ResultsFile file = ResultsFile::Open(results, ResultsFile::Mode::kRead);
    rows = Write(&file.database(), results, SpecOf(table, IsXml(output)), run_id, output, progress);
  });
  return rows;
}

}  // namespace lanewise
