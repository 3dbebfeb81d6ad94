#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "agents/core/types.h"
#include "analysis/traffic_frame.h"

namespace lanewise {

/// A vehicle (or pedestrian) that entered the simulation.
struct VehicleRow {
  std::int32_t number{kNone};  ///< Running number within the run, counted from 0.
  std::string id{};            ///< SUMO's id.
  std::string type{};
  std::string vclass{};
  std::string policy{};
  double depart{0.0};        ///< [s]
  double depart_delay{0.0};  ///< [s] waited for insertion.
  double length{0.0};        ///< [m]
  double width{0.0};         ///< [m]
};

/// How a trip ended; kRunning: the run ended first.
enum class TripEnd : std::uint8_t { kArrived, kVaporized, kTeleported, kRunning };

const char* ToString(TripEnd end);

struct TripRow {
  std::int32_t vehicle_number{kNone};
  TripEnd end{TripEnd::kRunning};
  double depart{0.0};               ///< [s]
  std::optional<double> arrival{};  ///< [s] only if it arrived.
  double duration{0.0};             ///< [s] departure to arrival, or to the end of the record.
  double depart_delay{0.0};         ///< [s]
  double route_length{0.0};         ///< [m] driven.
  double waiting_time{0.0};         ///< [s] slower than halting_speed, planned stops excluded.
  std::int32_t waiting_count{0};    ///< Times it came to wait.
  double stop_time{0.0};            ///< [s] at planned stops.
  double time_loss{0.0};  ///< [s] SUMO's: against driving at the allowed speed, planned stops excluded.
  std::optional<double> max_accel{};          ///< [m/s^2]
  std::optional<double> max_decel{};          ///< [m/s^2] a magnitude.
  std::optional<double> max_jerk{};           ///< [m/s^3] a magnitude.
  std::optional<double> rms_jerk{};           ///< [m/s^3]
  std::optional<double> max_lateral_accel{};  ///< [m/s^2] a magnitude.
  std::int32_t hard_braking_count{0};         ///< Times it began to brake harder than hard_braking.
  double co2{0.0};                            ///< [mg]
  double nox{0.0};                            ///< [mg]
  double pmx{0.0};                            ///< [mg]
  double fuel{0.0};                           ///< [mg]
  double electricity{0.0};                    ///< [Wh]
  std::int64_t steps{0};                      ///< Steps driven.
  std::int64_t agent_steps{0};                ///< Of these, with our agent at the wheel.
  std::optional<double> min_ttc{};            ///< [s] nothing if never below the encounter threshold.
  std::optional<double> max_drac{};           ///< [m/s^2] nothing if never on a collision course.
  std::optional<double> ttc_exposed{};     ///< [s] time with a TTC below the encounter threshold: TET (M. M.
                                           ///< Minderhoud, P. H. L. Bovy 2001); nothing: not watched.
  std::optional<double> ttc_integrated{};  ///< [s^2] integral of threshold - TTC over that time: TIT.
  std::optional<double> speed_variance{};  ///< [m^2/s^2] over the time driven, planned stops excluded.
};

struct TripParams {
  double halting_speed{0.1};  ///< [m/s] slower is waiting (SUMO).
  double hard_braking{4.5};   ///< [m/s^2] a deceleration.
  double ttc_encounter{3.0};  ///< [s] as SafetyParams: what the exposure is measured against.
};

/// Sums up each vehicle's trip over the frames. Holds rows of vehicles under way only.
class TripRecorder {
 public:
  explicit TripRecorder(double step_length, TripParams params = {})
      : step_length_(step_length), params_(params) {}

  /// From now on the vehicle may appear in frames.
  void Depart(const VehicleRow& vehicle);

  /// Adds one step. Rows of vehicles that never departed here are ignored (pedestrians, say). row_ttc [s]
  /// and row_drac [m/s^2] as of SafetyMonitor, or empty. The first frame of a vehicle is its insertion: it
  /// has not driven yet, so only its TTC counts.
  void Observe(const TrafficFrame& frame, std::span<const double> row_ttc,
               std::span<const double> row_drac = {});

  /// Closes the trip. SUMO removes a vehicle within its last step, before a frame could show it: the sums
  /// lack that part of a step.
  TripRow Finish(std::int32_t vehicle_number, double time, TripEnd end);

  /// Vehicle numbers under way, ascending: to be finished with kRunning at the end of the run.
  std::vector<std::int32_t> UnderWay() const;

 private:
  struct Trip {
    TripRow row;
    double last_accel{0.0};    // [m/s^2]
    double jerk_squares{0.0};  // [m^2/s^6] sum.
    std::int64_t jerks{0};
    double speeds{0.0}, speed_squares{0.0};  // [m/s], [m^2/s^2] sums outside planned stops.
    std::int64_t moving_steps{0};            // Likewise.
    bool inserted{false};                    // Its first frame was seen.
    bool waiting{false};
    bool braking_hard{false};
  };

  void AddStep(const TrafficFrame& frame, std::size_t i, Trip* trip) const;

  double step_length_;  // [s]
  TripParams params_;
  std::vector<Trip> trips_;  // Slots, reused.
  std::vector<std::int32_t> free_slots_;
  std::vector<std::int32_t> slot_of_;  // By vehicle number; kNone = not under way.
};

}  // namespace lanewise
