#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <vector>

namespace lanewise {

/// A stretch in which a vehicle follows one leader. Row k is at time[k]; all columns are of equal length.
struct FollowingEpisode {
  std::string vehicle, type, leader;
  std::vector<double> time;          ///< [s] increasing.
  std::vector<double> gap;           ///< [m] bumper to bumper, > 0.
  std::vector<double> speed;         ///< [m/s] of the vehicle.
  std::vector<double> leader_speed;  ///< [m/s]
};

/// Which stretches are kept.
struct FollowingOptions {
  double max_gap{100.0};      ///< [m] beyond it nobody is followed.
  double min_duration{10.0};  ///< [s]
  double min_distance{20.0};  ///< [m] driven: who stands teaches nothing.
  double max_interval{1.5};   ///< [s] between rows.
  /// [m] a gap may differ from what the speeds make of the one before; more is a jump of the measurement
  /// (another leader's back, lanes of unlike lengths), and ends the stretch.
  double max_jump{1.5};
  double length{5.0};                     ///< [m] of leaders whose length nothing tells.
  std::map<std::string, double> lengths;  ///< [m] by vehicle type.
};

struct FollowingData {
  std::vector<FollowingEpisode> episodes;  ///< In order of their ends.
  std::int64_t rows{0}, timesteps{0}, vehicles{0};
  std::int64_t jumps{0};            ///< Stretches that a jump of the gap ended.
  std::int64_t too_short{0};        ///< Stretches left out for time or distance.
  std::int64_t unknown_lengths{0};  ///< Rows whose leader got the default length.
  double begin{0.0}, end{0.0};      ///< [s]
  bool leaders_named{false};        ///< The file names leaders; else they are found on the lanes.
};

/// Called now and then with the part of the file read, in [0, 1].
using ReadProgress = std::function<void(double)>;

/// Reads SUMO's fcd output, as XML or as CSV (`xml2csv.py`, `lanewise export --trajectories`: columns
/// vehicle_speed or speed, separated by ';' or ','), gzipped or not; what it is follows from its content. The
/// file is read as a stream: only episodes are kept. Leaders are those the file names (leaderID, leaderGap,
/// leaderSpeed of --fcd-output.max-leader-distance), else the next vehicle ahead on the same lane (lane,
/// pos). Persons are left out. @throws ConfigError naming file, line, field, what was found and what is
/// allowed.
FollowingData LoadFollowing(const std::filesystem::path& file, const FollowingOptions& options,
                            const ReadProgress& progress = {});

/// Lengths [m] by id of all vType elements of a SUMO route or additional file that have one.
/// @throws ConfigError.
std::map<std::string, double> LoadTypeLengths(const std::filesystem::path& file);

}  // namespace lanewise
