#include "analysis/report.h"

#include <SQLiteCpp/SQLiteCpp.h>
#include <fmt/chrono.h>

#include <algorithm>
#include <cmath>
#include <ctime>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "agents/core/check.h"
#include "agents/network/road_network.h"
#include "analysis/comparison_format.h"
#include "analysis/report_assets.h"  // Generated from analysis/report/.
#include "analysis/results_file.h"

namespace lanewise {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

// What keeps the page small and quick; each is told in the page where it cuts something off.
constexpr std::size_t kMaxFlowPoints = 3000;       // A policy.
constexpr std::size_t kMaxMapPoints = 4000;        // A run.
constexpr std::size_t kMaxCurvePoints = 300;       // A distribution.
constexpr std::size_t kMaxDiagramVehicles = 3000;  // Looked through for the time-space diagram.

/// Three decimals are a millimetre or a millisecond.
double Round(double value) {
  return std::round(value * 1e3) / 1e3;
}

Json OrNull(const SQLite::Column& column) {
  return column.isNull() ? Json() : Json(Round(column.getDouble()));
}

/// Runs of one file and label that count.
struct RunGroup {
  std::string scenario{}, label{};
  std::vector<const RunRecord*> runs{};
};

bool Counts(const RunRecord& run) {
  return run.status == "finished" && run.over_budget == 0;
}

std::vector<RunGroup> Groups(std::span<const RunRecord> runs) {
  std::map<std::pair<std::string, std::string>, RunGroup> groups;
  for (const RunRecord& run : runs) {
    if (!Counts(run)) continue;
    RunGroup& group = groups[{run.scenario, run.label}];
    group.scenario = run.scenario;
    group.label = run.label;
    group.runs.push_back(&run);
  }
  std::vector<RunGroup> list;
  for (auto& [key, group] : groups) list.push_back(std::move(group));
  std::stable_sort(list.begin(), list.end(), [](const RunGroup& a, const RunGroup& b) {
    return a.scenario == b.scenario ? LabelOrder()(a.label, b.label) : a.scenario < b.scenario;
  });
  return list;
}

/// Opens each results file once.
class Files {
 public:
  SQLite::Database& Of(const RunRecord& run) {
    auto found = files_.find(run.file);
    if (found == files_.end())
      found = files_.emplace(run.file, ResultsFile::Open(run.file, ResultsFile::Mode::kRead)).first;
    return found->second.database();
  }

 private:
  std::map<fs::path, ResultsFile> files_;
};

/// Share of the vehicles that carry a radio, as asked for; null without a channel.
Json RadioShare(const RunRecord& run) {
  const Json parameters = Json::parse(run.parameters_json, nullptr, false);
  return run.v2x != "off" && parameters.contains("v2x.share") ? parameters["v2x.share"] : Json();
}

Json RunsJson(std::span<const RunRecord> runs) {
  Json list = Json::array();
  for (const RunRecord& run : runs) {
    Json metrics = Json::object();
    for (std::size_t m = 0; m < run.metrics.size(); ++m)
      metrics[AllMetrics()[m].name] = run.metrics[m] ? Json(*run.metrics[m]) : Json();
    Json shares = Json::array();
    for (const PolicyShare& share : run.shares) shares.push_back({share.policy, share.share});
    list.push_back({{"run_id", run.run_id},
                    {"file", run.file.filename().string()},
                    {"started_at", run.started_at},
                    {"status", run.status},
                    {"used", Counts(run)},
                    {"scenario", run.scenario},
                    {"label", run.label},
                    {"seed", run.seed},
                    {"inserted", run.inserted},
                    {"arrived", run.arrived},
                    {"not_inserted", run.not_inserted},
                    {"version", run.lanewise_version + " " + run.git_commit},
                    {"sumo_version", run.sumo_version},
                    {"machine", run.machine},
                    {"wall_time", run.wall_time ? Json(Round(*run.wall_time)) : Json()},
                    {"state_hash", run.state_hash},
                    {"options", run.options},
                    {"agent_share", run.agent_share},
                    {"radio_share", RadioShare(run)},
                    {"shares", shares},
                    {"metrics", metrics}});
  }
  return list;
}

/// Calls `visit` with each row a query finds in the runs of a group. @param sql one parameter: the run_id.
template <class F>
void ForEachRow(const RunGroup& group, Files* files, const std::string& sql, F&& visit) {
  for (const RunRecord* run : group.runs) {
    SQLite::Statement query(files->Of(*run), sql);
    query.bind(1, run->run_id);
    while (query.executeStep()) visit(query);
  }
}

/// Every k-th value so that at most `limit` stay.
std::size_t Stride(std::size_t count, std::size_t limit) {
  return std::max<std::size_t>(1, (count + limit - 1) / limit);
}

Json FlowDensity(const RunGroup& group, Files* files) {
  Json all = Json::array();
  ForEachRow(
      group, files,
      "SELECT i.density_veh_per_km / e.lanes, i.flow_veh_per_h / e.lanes, e.edge_id FROM edge_interval AS i "
      "JOIN edge AS e USING (run_id, edge) WHERE i.run_id = ? AND NOT e.in_junction AND i.end_s - i.begin_s "
      "> 30.0",
      [&](SQLite::Statement& row) {
        all.push_back({OrNull(row.getColumn(0)), OrNull(row.getColumn(1)), row.getColumn(2).getString()});
      });
  Json points = Json::array();
  for (std::size_t i = 0; i < all.size(); i += Stride(all.size(), kMaxFlowPoints))
    points.push_back(std::move(all[i]));
  return {{"scenario", group.scenario}, {"label", group.label}, {"points", points}};
}

Json Distribution(const RunGroup& group, const char* measure, Files* files) {
  std::vector<double> values;
  ForEachRow(group, files,
             fmt::format("SELECT {0} FROM encounter WHERE run_id = ? AND {0} IS NOT NULL", measure),
             [&](SQLite::Statement& row) { values.push_back(row.getColumn(0).getDouble()); });
  std::sort(values.begin(), values.end());
  Json points = Json::array();
  const std::size_t count = values.size();
  for (std::size_t i = 0; i < count; i += Stride(count, kMaxCurvePoints))
    points.push_back({Round(values[i]), Round(static_cast<double>(i + 1) / static_cast<double>(count))});
  if (count > 0) points.push_back({Round(values.back()), 1.0});
  return {{"scenario", group.scenario},
          {"label", group.label},
          {"measure", measure},
          {"count", count},
          {"points", points}};
}

/// Jerk, lateral acceleration and acceleration over driving time: shares of the recorded bins, whoever drove.
Json Comfort(const RunGroup& group, Files* files) {
  struct Bin {
    Json lower, upper;
    double time{0.0};
  };
  std::map<std::string, std::map<std::int64_t, Bin>> measures;
  ForEachRow(
      group, files,
      "SELECT measure, bin, lower, upper, SUM(vehicle_time_s) FROM histogram WHERE run_id = ? GROUP BY "
      "measure, bin",
      [&](SQLite::Statement& row) {
        Bin& bin = measures[row.getColumn(0).getString()][row.getColumn(1).getInt64()];
        bin.lower = OrNull(row.getColumn(2));
        bin.upper = OrNull(row.getColumn(3));
        bin.time += row.getColumn(4).getDouble();
      });
  Json shares = Json::object();
  for (const auto& [measure, bins] : measures) {
    double time = 0.0;
    for (const auto& [number, bin] : bins) time += bin.time;
    shares[measure] = Json::array();
    for (const auto& [number, bin] : bins) shares[measure].push_back({bin.lower, bin.upper, bin.time / time});
  }
  return {{"scenario", group.scenario}, {"label", group.label}, {"shares", shares}};
}

/// What went over the radio, by run and interval.
Json Radio(const RunGroup& group, Files* files) {
  Json points = Json::array();
  ForEachRow(
      group, files,
      "SELECT (begin_s + end_s) / 2, sent / station_time_s, delivered * 1.0 / NULLIF(delivered + dropped + "
      "faded + collided, 0), mean_age_s, mean_busy_ratio FROM v2x_interval WHERE run_id = ? AND "
      "station_time_s > 0.0 ORDER BY begin_s",
      [&](SQLite::Statement& row) {
        points.push_back({{"time", OrNull(row.getColumn(0))},
                          {"sent", OrNull(row.getColumn(1))},
                          {"delivered", OrNull(row.getColumn(2))},
                          {"age", OrNull(row.getColumn(3))},
                          {"busy", OrNull(row.getColumn(4))}});
      });
  return {{"scenario", group.scenario}, {"label", group.label}, {"points", points}};
}

Json ConflictMap(const RunGroup& group, Files* files) {
  const RunRecord& run = *group.runs.front();
  // The severe ones first: they are kept if there are too many.
  SQLite::Statement query(
      files->Of(run),
      "SELECT e.x_m, e.y_m, e.type, e.severity, e.min_ttc_s, e.pet_s, a.vehicle_id, b.vehicle_id "
      "FROM encounter AS e JOIN vehicle AS a ON a.run_id = e.run_id AND a.vehicle_number = "
      "e.ego_vehicle JOIN vehicle AS b ON b.run_id = e.run_id AND b.vehicle_number = "
      "e.foe_vehicle WHERE e.run_id = ? ORDER BY e.severity DESC, e.encounter LIMIT ?");
  query.bind(1, run.run_id);
  query.bind(2, static_cast<std::int64_t>(kMaxMapPoints));
  Json points = Json::array();
  while (query.executeStep()) {
    points.push_back({OrNull(query.getColumn(0)), OrNull(query.getColumn(1)), query.getColumn(2).getString(),
                      query.getColumn(3).getInt(), OrNull(query.getColumn(4)), OrNull(query.getColumn(5)),
                      query.getColumn(6).getString(), query.getColumn(7).getString()});
  }
  return {{"scenario", group.scenario}, {"label", group.label}, {"run_id", run.run_id}, {"points", points}};
}

/// The states of vehicles on the busiest edge in its busiest interval, by way of the run's trajectory index.
Json TimeSpace(const RunGroup& group, Files* files) {
  const RunRecord& run = *group.runs.front();
  SQLite::Database& database = files->Of(run);
  Json diagram{{"label", group.label}, {"run_id", run.run_id}, {"edge", ""}, {"lines", Json::array()}};
  SQLite::Statement busiest(
      database,
      "SELECT i.edge, e.edge_id, i.begin_s, i.end_s FROM edge_interval AS i JOIN edge AS e USING "
      "(run_id, edge) WHERE i.run_id = ? AND NOT e.in_junction AND e.length_m > 40.0 ORDER BY "
      "i.vehicle_time_s DESC, i.edge LIMIT 1");
  busiest.bind(1, run.run_id);
  if (!busiest.executeStep()) return diagram;
  const std::string edge = busiest.getColumn(1).getString();
  const double begin = busiest.getColumn(2).getDouble(), end = busiest.getColumn(3).getDouble();
  diagram["edge"] = edge;
  std::set<std::int64_t> lanes;
  SQLite::Statement lane_query(database, "SELECT lane, lane_id FROM lane WHERE run_id = ?");
  lane_query.bind(1, run.run_id);
  while (lane_query.executeStep()) {
    const std::string id = lane_query.getColumn(1).getString();
    if (id.substr(0, id.rfind('_')) == edge) lanes.insert(lane_query.getColumn(0).getInt64());
  }
  SQLite::Statement vehicles(
      database,
      "SELECT t.vehicle_number, v.vehicle_id FROM trip AS t JOIN vehicle AS v USING (run_id, "
      "vehicle_number) WHERE t.run_id = ?1 AND t.depart_s < ?3 AND t.depart_s + t.duration_s > "
      "?2 ORDER BY t.vehicle_number LIMIT ?4");
  vehicles.bind(1, run.run_id);
  vehicles.bind(2, begin);
  vehicles.bind(3, end);
  vehicles.bind(4, static_cast<std::int64_t>(kMaxDiagramVehicles));
  // The run as a literal: SQLite uses the run's partial index only then.
  SQLite::Statement states(
      database, fmt::format("SELECT time_s, lane_pos_m, speed_mps, lane FROM trajectory WHERE run_id "
                            "= {} AND vehicle_number = ?1 AND time_s BETWEEN ?2 AND ?3 ORDER BY "
                            "time_s",
                            run.run_id));
  while (vehicles.executeStep()) {
    states.reset();
    states.bind(1, vehicles.getColumn(0).getInt64());
    states.bind(2, begin);
    states.bind(3, end);
    Json points = Json::array();
    while (states.executeStep()) {
      if (states.getColumn(3).isNull() || lanes.count(states.getColumn(3).getInt64()) == 0) continue;
      points.push_back(
          {OrNull(states.getColumn(0)), OrNull(states.getColumn(1)), OrNull(states.getColumn(2))});
    }
    if (!points.empty())
      diagram["lines"].push_back({{"id", vehicles.getColumn(1).getString()}, {"points", points}});
  }
  return diagram;
}

/// Center lines of the lanes of the net file in the run's inputs; empty if it cannot be read any more.
Json NetworkOf(const RunRecord& run) {
  Json lines = Json::array();
  const Json inputs = Json::parse(run.input_hashes_json, nullptr, false);
  if (!inputs.is_object()) return lines;
  for (const auto& [file, hash] : inputs.items()) {
    if (!file.ends_with(".net.xml") && !file.ends_with(".net.xml.gz")) continue;
    std::error_code error;
    if (!fs::exists(file, error)) continue;
    try {
      for (const Lane& lane : LoadRoadNetwork(file).lanes) {
        if (lane.shape.size() < 2) continue;
        Json line = Json::array();
        for (const Point2& point : lane.shape) line.push_back({Round(point.x), Round(point.y)});
        lines.push_back(std::move(line));
      }
    } catch (const ConfigError&) {
      lines = Json::array();  // The map goes without; the page's conflicts stand for themselves.
    }
    break;
  }
  return lines;
}

/// JSON within <script>: no tag may end in it.
std::string ForScript(std::string json) {
  for (std::size_t at = 0; (at = json.find("</", at)) != std::string::npos; at += 3)
    json.replace(at, 2, "<\\/");
  return json;
}

void Replace(std::string* text, const std::string& mark, const std::string& by) {
  const std::size_t at = text->find(mark);
  LANEWISE_CHECK(at != std::string::npos);
  text->replace(at, mark.size(), by);
}

const char* BetterName(Better better) {
  return better == Better::kLower ? "lower" : better == Better::kHigher ? "higher" : "neither";
}

/// The comparison, with each policy's means of all metrics: a larger family of tests is not wanted for those.
Json ComparisonJson(std::span<const RunRecord> runs, const CompareParams& params) {
  Json json = Json::parse(FormatComparison(Compare(runs, params), TableFormat::kJson));
  CompareParams of_all = params;
  of_all.metrics.clear();
  for (std::size_t m = 0; m < AllMetrics().size(); ++m) of_all.metrics.push_back(m);
  Json all = Json::parse(FormatComparison(Compare(runs, of_all), TableFormat::kJson));
  for (std::size_t i = 0; i < json["scenarios"].size(); ++i)
    json["scenarios"][i]["policies"] = std::move(all["scenarios"][i]["policies"]);
  return json;
}

}  // namespace

std::string BuildReport(std::span<const RunRecord> runs, const CompareParams& params,
                        const std::string& version) {
  Json data{{"version", version},
            {"created", fmt::format("{:%Y-%m-%d %H:%M} UTC", fmt::gmtime(std::time(nullptr)))}};
  data["runs"] = RunsJson(runs);
  data["comparison"] = ComparisonJson(runs, params);
  data["metrics"] = Json::array();
  for (const MetricInfo& m : AllMetrics())
    data["metrics"].push_back({{"name", m.name}, {"label", m.label}, {"better", BetterName(m.better)}});
  for (const char* list :
       {"labels", "flow_density", "cdf", "comfort", "radio", "maps", "time_space", "demands"})
    data[list] = Json::array();
  data["networks"] = Json::object();
  Files files;
  std::set<std::string, LabelOrder> labels;
  for (const RunRecord& run : runs) labels.insert(run.label);
  for (const std::string& label : labels) data["labels"].push_back(label);
  for (const RunGroup& group : Groups(runs)) {
    GuardResults(group.runs.front()->file, [&] {
      data["flow_density"].push_back(FlowDensity(group, &files));
      for (const char* measure : {"min_ttc_s", "pet_s"})
        data["cdf"].push_back(Distribution(group, measure, &files));
      data["comfort"].push_back(Comfort(group, &files));
      data["radio"].push_back(Radio(group, &files));
      data["maps"].push_back(ConflictMap(group, &files));
      data["time_space"].push_back(TimeSpace(group, &files));
    });
    if (!data["networks"].contains(group.scenario)) {
      data["networks"][group.scenario] = NetworkOf(*group.runs.front());
      data["demands"].push_back(
          {{"scenario", group.scenario},
           {"files", Json::parse(group.runs.front()->input_hashes_json, nullptr, false)}});
    }
  }
  std::string page = kReportPage;
  Replace(&page, "/*ECHARTS*/", kReportEcharts);
  Replace(&page, "/*REPORT*/", kReportScript);
  Replace(&page, "/*DATA*/", ForScript(data.dump(-1, ' ', false, Json::error_handler_t::replace)));
  return page;
}

}  // namespace lanewise
