#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "agents/agent_params.h"
#include "agents/planning/sector_drive.h"
#include "agents/traffic.h"
#include "scenarios/arena_field.h"

namespace CLI {
class App;
}

namespace lanewise {

/// How a drive through a field ended.
enum class DriveEnd : std::uint8_t { kReached, kContact, kStopped };

struct DriveResult {
  DriveEnd end{DriveEnd::kStopped};
  double clearance{0.0};  ///< [m] least distance of the outline to a thing, a person or a border.
  double time{0.0};       ///< [s] until it reached the goal, or else until the drive ended.
  double at_s{0.0};       ///< [m] where it ended.
};

struct ArenaConfig {
  std::vector<FieldKind> kinds;
  std::vector<Policy> policies;
  std::int64_t count{100};
  std::int64_t first{0};  ///< Number of the first field.
  std::uint64_t seed{1};
  double clearance{0.3};    ///< [m] with which a field is called passable.
  double step_length{0.1};  ///< [s]
  int threads{0};           ///< 0 = all cores.
  AgentParams params;
  AvoidanceTable bp, bls;
  bool quiet{false};
};

struct ArenaResults {
  /// By kind and number of field.
  std::vector<std::vector<std::uint8_t>> passable;
  /// By kind, policy and number of field.
  std::vector<std::vector<std::vector<DriveResult>>> drives;
};

/// The shipped arena's road, agents driven without SUMO: a drive is one vehicle through one field.
class Arena {
 public:
  /// @throws ConfigError if the arena's network is missing, or not as the fields need it.
  Arena();
  DriveResult Drive(const ArenaField& field, Policy policy, const ArenaConfig& config,
                    std::int64_t number) const;
  /// As Drive, and calls `observe` with the state before each step.
  DriveResult Drive(const ArenaField& field, Policy policy, const ArenaConfig& config, std::int64_t number,
                    const std::function<void(double, const Traffic&)>& observe) const;
  const ArenaRoad& road() const { return road_; }
  const VehicleParams& vehicle() const { return vehicle_; }

 private:
  RoadNetwork network_;
  std::vector<LaneCurve> curves_;
  ArenaRoad road_;
  VehicleParams vehicle_;
};

/// All fields by all policies, in parallel. The results do not depend on the number of threads.
ArenaResults RunArena(const Arena& arena, const ArenaConfig& config);

/// What a policy did in the fields of a kind.
struct ArenaTally {
  std::int64_t fields{0}, passable{0};
  std::int64_t reached{0}, contacts{0}, stopped{0};  ///< Of all fields.
  std::int64_t reached_passable{0};
  double mean_clearance{0.0}, least_clearance{0.0};  ///< [m] of drives that reached the goal.
  double mean_time{0.0};                             ///< [s] likewise.
};
ArenaTally Tally(const std::vector<std::uint8_t>& passable, const std::vector<DriveResult>& drives);

/// Adds `lanewise arena`; the returned function runs it and gives the exit code.
std::function<int()> AddArenaCommand(CLI::App* app);

}  // namespace lanewise
