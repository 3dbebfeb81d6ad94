#pragma once

#include <cstdint>
#include <deque>
#include <span>
#include <unordered_map>
#include <vector>

#include "agents/core/spatial_grid.h"
#include "agents/core/types.h"
#include "agents/network/road_network.h"
#include "analysis/conflict_geometry.h"
#include "analysis/lane_motion.h"
#include "analysis/lane_order.h"
#include "analysis/traffic_frame.h"

namespace lanewise {

/// One road user came to where another one had been.
struct Encroachment {
  std::int32_t earlier{kNone};  ///< Vehicle number of who left.
  std::int32_t later{kNone};    ///< Of who came.
  double pet{0.0};              ///< [s] between the one leaving and the other coming.
  double time{0.0};             ///< [s] when the later one came.
  double x{0.0}, y{0.0};        ///< [m] front bumper of the later one then.
  EncounterType type{EncounterType::kCrossing};
  LaneIndex earlier_lane{kNone}, later_lane{kNone};  ///< At the end of the time looked at.
  double earlier_speed{0.0}, later_speed{0.0};       ///< [m/s] likewise.
  bool earlier_agent{false}, later_agent{false};     ///< Agent-driven, likewise.
};

/// Post encroachment time (PET; B. L. Allen, B. T. Shin, P. J. Cooper 1978) of all pairs on their true 2-D
/// poses: the least time between a point of the plane being left by one box and being reached by the other.
/// For paths that cross it equals the time from the one leaving the area they share to the other entering it;
/// exact for motion that is straight within a step. Pairs that follow each other on the same lanes have none,
/// as in SUMO, nor have pairs of pedestrians. Traffic is looked at in blocks of about half a second, so
/// results come that late.
class EncroachmentWatch {
 public:
  /// network: may be null; then nobody is known to follow. threshold [s]: longer times are no encroachment.
  EncroachmentWatch(const RoadNetwork* network, double threshold)
      : network_(network), threshold_(threshold) {}

  /// Call once per step, in order of time. `poses`: of the frame's boxes.
  void Observe(const TrafficFrame& frame, std::span<const BoxPose> poses);

  /// Encroachments found by the last Observe, in order of earlier, later; empty within a block.
  const std::vector<Encroachment>& found() const { return found_; }

  /// [s] at most from the earlier one's leaving until the encroachment is found.
  double delay() const { return threshold_ > 0.0 ? threshold_ + kBlockTime + 2.0 * step_length_ : 0.0; }

 private:
  static constexpr double kBlockTime = 0.5;  // [s]

  /// Motion of one road user within one block.
  struct Trail {
    std::int32_t number;
    std::uint32_t first_piece, pieces;  // In Block::pieces: one a step.
    MovingBox sweep;  // Box around all that its own sweeps, along its last heading; at rest.
    double radius;    // [m] of the circle around that, for the grid.
    bool pedestrian, planned_stop, agent;
    double speed;
    LaneUser lanes;  // At the end of the block.
  };
  struct Piece {
    double begin;  // [s]
    MovingBox box;
  };
  struct Block {
    double end{0.0};  // [s]
    std::vector<Trail> trails;
    std::vector<Piece> pieces;
  };
  struct LastPose {
    double x, y;  // [m] center.
    double time;  // [s]
  };

  void AddStep(const TrafficFrame& frame, std::span<const BoxPose> poses);
  void CloseBlock(const TrafficFrame& frame);
  void FindEncroachments(const Trail& later, std::vector<Encroachment>* found) const;
  /// The least time gap of the two, if it is below the threshold and they do not touch.
  void Compare(const Block& before, const Trail& earlier, const Trail& later,
               std::vector<Encroachment>* found) const;

  const RoadNetwork* network_;
  double threshold_;  // [s]
  std::int64_t steps_{0};
  double last_time_{0.0};
  double step_length_{0.0};          // [s]
  std::vector<LastPose> last_pose_;  // By vehicle number.
  /// The block being filled: pieces in order of time, by vehicle.
  struct Filling {
    std::int32_t number;
    std::vector<Piece> pieces;
  };
  double block_begin_{0.0};
  std::vector<std::int32_t> slot_of_;  // By vehicle number, in filling_; kNone: not in this block.
  std::vector<Filling> filling_;       // The first filled_ are in use.
  std::size_t filled_{0};
  std::deque<Block> blocks_;  // The last ones, oldest first; the newest is the last.
  std::vector<std::pair<std::uint32_t, std::uint32_t>> grid_items_;  // Block, trail of each grid item.
  std::vector<double> grid_x_, grid_y_;
  double max_radius_{0.0};  // [m] of all trails in the grid.
  SpatialGrid grid_{20.0};
  std::vector<std::vector<Encroachment>> found_by_thread_;
  std::vector<Encroachment> found_;
};

}  // namespace lanewise
