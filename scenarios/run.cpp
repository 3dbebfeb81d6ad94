#include "scenarios/run.h"

#include <omp.h>
#include <sys/utsname.h>

#include <fmt/ranges.h>
#include <chrono>
#include <ctime>
#include <memory>

#include <nlohmann/json.hpp>
#include <thread>

#include "agents/agent_pipeline.h"
#include "analysis/v2x_log.h"
#include "libsumo_bridge/sumo_session.h"
#include "scenarios/input_file.h"
#include "scenarios/interrupt.h"
#include "scenarios/progress.h"
#include "scenarios/recorder.h"
#include "scenarios/state_trace.h"
#include "scenarios/test_fault.h"
#include "scenarios/timed.h"

namespace lanewise {
namespace {

RunInfo Describe(const RunConfig& config, const std::vector<std::string>& sumo_options) {
  RunInfo info;
  info.scenario = config.scenario;
  info.config_file = config.config_file.empty() ? config.net_file.string() : config.config_file.string();
  info.policy = kPolicyNames[static_cast<std::size_t>(config.policy)];
  info.penetration = config.penetration;
  info.v2x = kV2xLevelNames[static_cast<std::size_t>(config.v2x)];
  info.coordination = CoordinationText(config.coordinate);
  info.rules = kRulesNames[static_cast<std::size_t>(config.rules)];
  info.safety = kSafetyLevelNames[static_cast<std::size_t>(config.safety_level)];
  info.seed = config.seed;
  if (!config.config_file.empty()) info.begin = ReadSumoConfig(config.config_file).begin;
  info.end = config.end;
  info.step_length = config.step_length;
  info.threads = config.threads;
  info.sumo_options = fmt::format("{}", fmt::join(sumo_options, " "));
  nlohmann::ordered_json params, hashes;
  for (const ParamDescription& p :
       DescribeParams(RunParams{config.params, config.safety, config.coordination}))
    params[p.name] = p.value;
  for (const auto& file : InputFiles(config))
    hashes[std::filesystem::absolute(file).lexically_normal().string()] = HashFile(file);
  if (!config.config_file.empty()) info.config_text = ReadText(config.config_file);
  info.arguments_json = nlohmann::ordered_json(RepeatArguments(config)).dump();
  info.parameters_json = params.dump();
  info.input_hashes_json = hashes.dump();
  info.lanewise_version = LANEWISE_VERSION;
  info.git_commit = LANEWISE_GIT_COMMIT;
  info.sumo_version = SumoSession::Version();
  info.compiler = LANEWISE_COMPILER;
  utsname name{};
  uname(&name);
  info.machine = fmt::format("{} {} {} cores, {}", name.sysname, name.machine,
                             std::thread::hardware_concurrency(), name.nodename);
  return info;
}

std::vector<AuditRow> AuditRows(const CouplingAudit& audit, std::int64_t lane_end_halts,
                                std::int64_t emergency_stops, std::int64_t detours) {
  std::vector<AuditRow> rows;
  for (std::size_t i = 0; i < kAuditCauses; ++i) {
    const AuditCount& count = audit.by_cause[i];
    rows.push_back({std::string(kAuditCauseNames[i]) + "_steps", count.steps, std::nullopt, std::nullopt});
    rows.push_back(
        {std::string(kAuditCauseNames[i]), count.different, count.max_position_error, count.max_speed_error});
  }
  rows.push_back({"lane_end_halts", lane_end_halts, std::nullopt, std::nullopt});
  rows.push_back({"detours", detours, std::nullopt, std::nullopt});
  rows.push_back({"sumo_emergency_stops", emergency_stops, std::nullopt, std::nullopt});
  return rows;
}

constexpr std::size_t kHashRowsPerWrite = 64;

void WriteHashes(RunWriter* writer, StateTrace* trace) {
  if (writer != nullptr) writer->Add(trace->rows());
  trace->Clear();
}

}  // namespace

RunReport Run(const RunConfig& config) {
  RunConfig effective = config;
  if (effective.threads == 0)
    effective.threads = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  omp_set_num_threads(effective.threads);

  // A file that cannot take the run is refused before SUMO starts; one that can is created, or added to, only
  // when SUMO has accepted the run.
  if (effective.results) ResultsFile::CheckAppend(*effective.results);
  const RoadNetwork network = LoadRoadNetwork(effective.net_file);
  CurveFitParams fit;
  fit.max_lateral_accel = effective.params.driving.max_lateral_accel;
  fit.comfort_decel = effective.params.driving.comfort_decel;
  const std::vector<LaneCurve> curves = FitLaneCurves(network, fit);
  const std::vector<std::string> sumo_options = SumoCommandLine(effective);
  SumoSession session(sumo_options);
  if (effective.coordinate.signals && effective.v2x != V2xLevel::kOff)
    CheckSignals(network, effective.coordination.signals, session.time());
  AgentPipeline pipeline(network, curves, effective.params, effective.rules);
  pipeline.avoider().SetSeed(static_cast<std::uint64_t>(effective.seed));
  pipeline.channel().Open(effective.v2x, static_cast<std::uint64_t>(effective.seed));
  Coordination coordination(network, effective.coordination, effective.coordinate,
                            static_cast<std::uint64_t>(effective.seed), &pipeline);
  const TestFault fault(effective.seed);
  std::unique_ptr<RunWriter> writer;
  if (effective.results) {
    const RunInfo info = Describe(effective, sumo_options);
    writer = std::make_unique<RunWriter>(ResultsFile::Open(*effective.results, ResultsFile::Mode::kAppend),
                                         info, WriterParams{.max_file_bytes = fault.max_file_bytes()});
  }

  std::unique_ptr<SampleRecorder> samples;
  if (effective.samples_file) {
    samples = std::make_unique<SampleRecorder>(
        network, curves, effective.params, effective.samples, static_cast<std::uint64_t>(effective.seed),
        effective.samples_file->string(),
        fmt::format(
            "scenario {}, policy {}, seed {}; a scan each {:g} s, its way judged after {:g} s, to a side "
            "from {:g} m on; Lanewise {}",
            effective.scenario, kPolicyNames[static_cast<std::size_t>(effective.policy)], effective.seed,
            effective.samples.period, effective.samples.horizon, effective.samples.min_shift,
            LANEWISE_VERSION));
  }
  Traffic traffic;
  Commands commands;
  VehicleBridge bridge(network, curves, effective.params, effective.policy, effective.rules,
                       {effective.penetration, effective.seed}, PassiveActionStep(effective));
  const double dt = session.step_length();
  const double begin = session.time();
  Recorder recorder(network,
                    {begin, effective.step_length, effective.sample_period, effective.edge_interval,
                     effective.safety_level, effective.safety},
                    writer.get());
  Progress progress(
      fmt::format("{} [{}]", effective.scenario, kPolicyNames[static_cast<std::size_t>(effective.policy)]),
      effective.end, effective.quiet, effective.progress_fd);
  V2xLog v2x_log(begin, dt, effective.v2x == V2xLevel::kLoaded);
  StateTrace trace;
  RunReport report;
  RunOutcome& outcome = report.outcome;
  const InterruptGuard interrupt;
  const std::clock_t cpu_start = std::clock();

  try {
    while (session.ExpectedNumber() > 0 && (!effective.end || session.time() < *effective.end - 0.5 * dt)) {
      Timed(&outcome.sumo_time, [&] { session.Step(); });
      Timed(&report.coupling_time, [&] { bridge.Read(session.time(), dt, &traffic); });
      Timed(&report.agent_time, [&] { pipeline.UpdatePoses(&traffic); });
      Timed(&report.record_time,
            [&] { recorder.Observe(outcome.steps, session.time(), outcome.wall_time, traffic, bridge); });
      if (samples) {
        Timed(&report.record_time,
              [&] { samples->Observe(outcome.steps, session.time(), dt, traffic, bridge); });
      }
      trace.Add(outcome.steps, traffic);
      if (trace.rows().size() >= kHashRowsPerWrite) WriteHashes(writer.get(), &trace);
      Timed(&report.coupling_time, [&] { coordination.Step(session.time(), dt, &traffic, &bridge); });
      Timed(&report.agent_time, [&] { pipeline.Step(dt, bridge.guarded(), &traffic, &commands); });
      Timed(&report.coupling_time, [&] { bridge.Write(dt, &traffic, commands); });
      Timed(&report.record_time, [&] {
        coordination.Observe(session.time(), traffic);
        recorder.Add(coordination.TakeEvents());
      });
      ++outcome.steps;
      if (effective.v2x != V2xLevel::kOff) v2x_log.Observe(session.time(), pipeline.channel().counts());
      outcome.wall_time = outcome.sumo_time + report.coupling_time + report.agent_time + report.record_time;
      progress.Update(session.time(), recorder.running(), recorder.arrived(), session.ExpectedNumber());
      fault.Step(session.time());
      if (Interrupted()) break;
    }
  } catch (const std::exception& error) {
    if (writer)
      writer->EndAs(
          RunStatus::kFailed,
          fmt::format("at {:.1f} s: {}", begin + static_cast<double>(outcome.steps) * dt, error.what()));
    throw;
  }
  report.safety_time = recorder.safety_time();
  report.sampling_time = recorder.sampling_time();
  report.v2x = pipeline.channel().counts();
  const double end = session.time();
  const auto finish_start = std::chrono::steady_clock::now();
  Timed(&report.record_time, [&] { recorder.Finish(end); });
  if (samples) {
    samples->Finish();
    report.samples = samples->count();
  }
  WriteHashes(writer.get(), &trace);
  if (writer && effective.v2x != V2xLevel::kOff) {
    v2x_log.Finish(end, report.v2x);
    writer->Add(v2x_log.TakeFinished());
    writer->Add(v2x_log.AgeRows(report.v2x));
  }
  outcome.status = Interrupted() ? RunStatus::kInterrupted : RunStatus::kFinished;
  if (Interrupted()) outcome.message = fmt::format("interrupted at {:.1f} s", end);
  outcome.simulated_time = end - begin;
  outcome.vehicle_steps = recorder.vehicle_steps();
  outcome.agent_steps = recorder.agent_steps();
  outcome.inserted = recorder.inserted();
  outcome.arrived = recorder.arrived();
  outcome.vaporized = recorder.vaporized();
  outcome.teleported = bridge.teleports();
  outcome.still_running = recorder.running();
  outcome.not_inserted = static_cast<std::int64_t>(bridge.pending());
  outcome.state_hash = trace.hash();
  outcome.policy_shares = recorder.policy_shares();
  report.audit = bridge.audit();
  report.lane_end_halts = bridge.lane_end_halts();
  report.detours = bridge.detours();
  report.detour_length = bridge.detour_length();
  report.coordination = coordination.counts();
  report.emergency_stops = bridge.emergency_stops();
  for (std::size_t k = 0; k < report.rule_events.size(); ++k)
    report.rule_events[k] = recorder.rules().count(static_cast<RuleEventKind>(k));
  outcome.audit = AuditRows(report.audit, report.lane_end_halts, report.emergency_stops, report.detours);
  if (writer) {
    report.run_id = writer->run_id();
    writer->Finish(outcome);
    report.writing_time = writer->writing_time() + writer->index_time();
  }
  report.finish_time = std::chrono::duration<double>(std::chrono::steady_clock::now() - finish_start).count();
  report.cpu_time = static_cast<double>(std::clock() - cpu_start) / CLOCKS_PER_SEC;
  return report;
}

}  // namespace lanewise
