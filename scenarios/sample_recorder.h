#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <string>
#include <vector>

#include "agents/agent_params.h"
#include "agents/core/spatial_grid.h"
#include "agents/network/lane_curve.h"
#include "agents/sector_net/samples.h"
#include "agents/sensing/lane_occupancy.h"
#include "agents/sensing/sector_scan.h"
#include "libsumo_bridge/vehicle_bridge.h"

namespace lanewise {

/// What is recorded as a sample: a scan, and the way its driver took in the time after it.
struct SampleParams {
  double period{1.0};     ///< [s] between scans of a vehicle.
  double horizon{2.0};    ///< [s] after which the way taken is judged.
  double min_shift{0.4};  ///< [m] moved to a side within the horizon that make the way "left" or "right".
};

/// [m] a vehicle must have driven within the horizon to have taken a way at all.
inline constexpr double kLeastProgress = 1.0;

/// Where vehicles are across the road, whatever their lane is called: sums up what they move sideways.
/// A change of lanes is a movement by the lanes' spacing, whether SUMO carries it out at once or an agent's
/// body comes over later.
class LateralTrack {
 public:
  /// The next step of a vehicle on `lane`, d [m] left of its middle, `progress` [m] farther.
  void Follow(const RoadNetwork& network, LaneIndex lane, double d, double progress);
  /// The vehicle is off the road.
  void Lose() { lane_ = kNone; }

  double lateral() const { return offset_ + d_; }  ///< [m] left positive, from wherever it was first seen.
  double distance() const { return distance_; }    ///< [m] driven.
  /// Counts the times it was lost: places of different ones do not compare.
  int part() const { return part_; }
  bool on_road() const { return lane_ != kNone; }

 private:
  LaneIndex lane_{kNone};
  double d_{0.0}, offset_{0.0}, distance_{0.0};
  int part_{0};
};

/// The way taken from a movement; forward below min_shift.
Avoidance WayTaken(double shift, double min_shift);

/// Records sector-scan samples of every vehicle on the road: what its lidar would see, and where it went
/// then. Scans with nothing free, vehicles that stand and those that leave within the horizon are left out.
class SampleRecorder {
 public:
  /// @throws ConfigError if the file cannot be created. @param note one line about the run, for the file.
  SampleRecorder(const RoadNetwork& network, const std::vector<LaneCurve>& curves, const AgentParams& params,
                 const SampleParams& samples, std::uint64_t seed, const std::string& file,
                 const std::string& note);

  /// After the poses of a step are known. @param step running number, for the lidar's errors.
  void Observe(std::int64_t step, double time, double dt, const Traffic& traffic,
               const VehicleBridge& bridge);
  /// @throws ConfigError if the file could not be written.
  void Finish() { writer_.Finish(); }

  std::int64_t count() const { return writer_.count(); }

 private:
  struct Open {
    double due, time;
    std::int32_t number;
    int part;
    double lateral, distance;
    std::uint8_t code;
  };
  struct Scratch {
    LidarScene reflectors;
    RoadView view;
  };

  void Track(double dt, const Traffic& traffic, const VehicleBridge& bridge);
  void Label(double time);
  void Scan(std::int64_t step, double time, const Traffic& traffic);

  const RoadNetwork& network_;
  const std::vector<LaneCurve>& curves_;
  AgentParams params_;
  SampleParams samples_;
  std::uint64_t seed_;
  SampleWriter writer_;
  Lidar lidar_;
  LaneOccupancy occupancy_;
  SpatialGrid grid_{20.0};
  std::vector<std::unique_ptr<Scratch>> scratch_;  // By thread.
  std::vector<double> center_x_, center_y_;
  std::vector<std::uint8_t> codes_;      // By row; 0: none.
  std::vector<LateralTrack> tracks_;     // By vehicle number.
  std::vector<std::int64_t> last_seen_;  // By vehicle number: count of Observe.
  std::vector<std::string> ids_;         // By vehicle number.
  std::deque<Open> open_;                // In order of time.
  std::int64_t observed_{0};
  double next_scan_{-1e300};  // [s]
};

}  // namespace lanewise
