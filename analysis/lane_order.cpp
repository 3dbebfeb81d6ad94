#include "analysis/lane_order.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "agents/core/geometry.h"

namespace lanewise {
namespace {

constexpr double kOncomingAngle = 0.75 * std::numbers::pi;  // [rad] between the headings; own choice.
constexpr double kParallelAngle = 0.25 * std::numbers::pi;  // [rad] below it neither crosses the other's way.

bool Contains(const LanePath& path, LaneIndex lane, std::size_t from = 0) {
  return lane != kNone && std::find(path.lane.begin() + static_cast<std::ptrdiff_t>(from), path.lane.end(),
                                    lane) != path.lane.end();
}

bool IsOnLanes(const LaneUser& user, LaneIndex lane) {
  return lane != kNone && (lane == user.lane || lane == user.behind || Contains(user.path, lane));
}

bool IsAcrossTheLine(const RoadNetwork& network, const LaneUser& user) {
  return std::abs(user.lateral_offset) + 0.5 * user.width > 0.5 * network.lanes[user.lane].width;
}

}  // namespace

LaneUser LaneUserAt(const TrafficFrame& frame, std::size_t row) {
  const LaneIndex lane = frame.lane[row];
  const bool reaches_back = lane != kNone && frame.lane_pos[row] < frame.length[row];
  return {lane,
          frame.lane_behind[row],
          reaches_back ? frame.lane_behind[row] : lane,
          frame.path[row],
          frame.heading[row],
          frame.lateral_offset[row],
          frame.lateral_speed[row],
          frame.width[row]};
}

bool IsOnWayOf(const LaneUser& b, const LaneUser& a) {
  return IsOnLanes(b, a.lane) && (a.rear == kNone || IsOnLanes(b, a.rear));
}

EncounterType ClassifyMeeting(const RoadNetwork* network, const LaneUser& a, const LaneUser& b) {
  const double angle = std::abs(WrapAngle(a.heading - b.heading));
  if (angle > kOncomingAngle) return EncounterType::kOncoming;
  const bool on_lanes = network != nullptr && a.path.lane[0] != kNone && b.path.lane[0] != kNone;
  if (!on_lanes) return angle < kParallelAngle ? EncounterType::kFollowing : EncounterType::kCrossing;
  const auto& lanes = network->lanes;
  if (lanes[a.lane].edge == lanes[b.lane].edge) {
    const bool straddling = IsAcrossTheLine(*network, a) || IsAcrossTheLine(*network, b);
    return straddling ? EncounterType::kStraddling : EncounterType::kSideSwipe;
  }
  // One is leaving the way of the other, its rear still on it.
  const auto leaves = [](const LaneUser& ahead, const LaneUser& follower) {
    return !IsOnLanes(follower, ahead.lane) &&
           (follower.lane == ahead.behind || (ahead.behind != kNone && follower.behind == ahead.behind));
  };
  if (angle < kParallelAngle && (leaves(a, b) || leaves(b, a))) return EncounterType::kFollowing;
  const auto joins = [](const LaneUser& u, const LaneUser& v) {
    return std::any_of(u.path.lane.begin(), u.path.lane.end(),
                       [&](LaneIndex lane) { return Contains(v.path, lane); });
  };
  if (joins(a, b)) return EncounterType::kMerging;
  // Side by side through a junction.
  if (angle < kParallelAngle) {
    const bool straddling = IsAcrossTheLine(*network, a) || IsAcrossTheLine(*network, b);
    return straddling ? EncounterType::kStraddling : EncounterType::kSideSwipe;
  }
  return EncounterType::kCrossing;
}

void LaneOrder::Build(const TrafficFrame& frame) {
  const std::size_t lanes = network_.lanes.size();
  start_.assign(lanes + 1, 0);
  max_length_ = 0.0;
  for (std::size_t i = 0; i < frame.size(); ++i) {
    if (frame.path[i].lane[0] == kNone) continue;
    ++start_[static_cast<std::size_t>(frame.path[i].lane[0])];
    max_length_ = std::max(max_length_, frame.length[i]);
  }
  std::uint32_t end = 0;
  for (std::uint32_t& start : start_) start = end += start;
  rows_.resize(end);
  // start_ holds the ends now; filling from behind turns them into starts.
  for (std::size_t i = frame.size(); i-- > 0;) {
    if (frame.path[i].lane[0] == kNone) continue;
    rows_[--start_[static_cast<std::size_t>(frame.path[i].lane[0])]] = static_cast<std::int32_t>(i);
  }
  for (std::size_t lane = 0; lane < lanes; ++lane) {
    if (start_[lane + 1] - start_[lane] < 2) continue;
    std::sort(rows_.begin() + start_[lane], rows_.begin() + start_[lane + 1],
              [&](std::int32_t a, std::int32_t b) { return frame.lane_pos[a] < frame.lane_pos[b]; });
  }
}

std::optional<double> LaneOrder::GapOnWay(const TrafficFrame& frame, std::size_t i, std::size_t j,
                                          std::size_t k, double offset) const {
  const double gap = offset + frame.lane_pos[j] - frame.length[j];
  // Its rear is on a lane further back: is that one on the way too?
  if (k > 0 && frame.lane_pos[j] < frame.length[j] && frame.lane_behind[j] != kNone &&
      frame.lane_behind[j] != frame.path[i].lane[k - 1])
    return std::nullopt;
  if (gap < 0.0) return std::nullopt;
  const double apart = std::abs(frame.lateral_offset[i] - frame.lateral_offset[j]);
  if (apart >= 0.5 * (frame.width[i] + frame.width[j])) return std::nullopt;
  return gap;
}

std::optional<double> LaneOrder::GapBetween(const TrafficFrame& frame, std::size_t i, std::size_t j) const {
  const LanePath& path = frame.path[i];
  double offset = -frame.lane_pos[i];
  for (std::size_t k = 0; k < LanePath::kLanes && path.lane[k] != kNone; ++k) {
    if (path.lane[k] == frame.lane[j] && (k > 0 || frame.lane_pos[j] > frame.lane_pos[i]))
      return GapOnWay(frame, i, j, k, offset);
    offset += network_.lanes[path.lane[k]].length;
  }
  return std::nullopt;
}

}  // namespace lanewise
