#include "analysis/encroachment_watch.h"

#include <omp.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>
#include <utility>

namespace lanewise {
namespace {

constexpr std::size_t kMinParallelRows = 2048;  // As in safety_monitor.cpp.
constexpr double kLeastPath = 0.05;             // [m] who moved less in a block stood.
constexpr double kLargestJump =
    1.5;  // [m] beyond what the speed explains: put elsewhere by SUMO, not driven.

}  // namespace

void EncroachmentWatch::Observe(const TrafficFrame& frame, std::span<const BoxPose> poses) {
  found_.clear();
  if (threshold_ <= 0.0) return;
  step_length_ = steps_ > 0 ? frame.time - last_time_ : 0.0;
  AddStep(frame, poses);
  last_time_ = frame.time;
  const auto steps_of_block =
      step_length_ > 0.0 ? std::max<std::int64_t>(1, std::llround(kBlockTime / step_length_)) : 1;
  if (steps_ > 0 && steps_ % steps_of_block == 0) CloseBlock(frame);
  if (steps_ == 0) block_begin_ = frame.time;
  ++steps_;
}

void EncroachmentWatch::AddStep(const TrafficFrame& frame, std::span<const BoxPose> poses) {
  for (std::size_t i = 0; i < frame.size(); ++i) {
    const auto number = static_cast<std::size_t>(frame.vehicle_number[i]);
    if (number >= last_pose_.size()) {
      last_pose_.resize(number + 1, {0.0, 0.0, -std::numeric_limits<double>::infinity()});
      slot_of_.resize(number + 1, kNone);
    }
    const Point2 center = poses[i].center;
    LastPose& last = last_pose_[number];
    const double dx = center.x - last.x, dy = center.y - last.y;
    const bool seen = steps_ > 0 && last.time == last_time_;
    const LastPose before = std::exchange(last, {center.x, center.y, frame.time});
    const double farthest = frame.speed[i] * step_length_ + kLargestJump;
    if (!seen || dx * dx + dy * dy > farthest * farthest) continue;
    if (slot_of_[number] == kNone) {
      slot_of_[number] = static_cast<std::int32_t>(filled_);
      if (filled_ == filling_.size()) filling_.emplace_back();
      filling_[filled_].number = frame.vehicle_number[i];
      filling_[filled_].pieces.clear();
      ++filled_;
    }
    filling_[static_cast<std::size_t>(slot_of_[number])].pieces.push_back(
        {before.time,
         {{before.x, before.y},
          {dx / step_length_, dy / step_length_},
          poses[i].u,
          0.5 * frame.length[i],
          0.5 * frame.width[i]}});
  }
}

void EncroachmentWatch::CloseBlock(const TrafficFrame& frame) {
  Block oldest;  // Its memory is used again.
  while (!blocks_.empty() && blocks_.front().end < block_begin_ - threshold_) {
    oldest = std::move(blocks_.front());
    blocks_.pop_front();
  }
  oldest.trails.clear();
  oldest.pieces.clear();
  blocks_.push_back(std::move(oldest));
  Block& block = blocks_.back();
  block.end = block_begin_ = frame.time;
  for (std::size_t i = 0; i < frame.size(); ++i) {
    const auto number = static_cast<std::size_t>(frame.vehicle_number[i]);
    if (slot_of_[number] == kNone) continue;
    const Filling& filling = filling_[static_cast<std::size_t>(slot_of_[number])];
    double path_length = 0.0;
    for (const Piece& piece : filling.pieces) {
      const Point2 v = piece.box.velocity;
      path_length += step_length_ * std::sqrt(v.x * v.x + v.y * v.y);
    }
    // Who stands comes nowhere, and what it leaves, it leaves when it drives off.
    if (path_length < kLeastPath) continue;
    Trail trail{};
    trail.number = frame.vehicle_number[i];
    trail.first_piece = static_cast<std::uint32_t>(block.pieces.size());
    trail.pieces = static_cast<std::uint32_t>(filling.pieces.size());
    const Point2 u = filling.pieces.back().box.u;
    double back = std::numeric_limits<double>::infinity(), front = -back, right = back, left = -back;
    for (const Piece& piece : filling.pieces) {
      block.pieces.push_back(piece);
      const MovingBox& box = piece.box;
      const double c = std::abs(u.x * box.u.x + u.y * box.u.y), s = std::abs(u.x * box.u.y - u.y * box.u.x);
      const double half_length = c * box.half_length + s * box.half_width;
      const double half_width = s * box.half_length + c * box.half_width;
      for (const double t : {0.0, step_length_}) {
        const double x = box.center.x + t * box.velocity.x, y = box.center.y + t * box.velocity.y;
        const double ahead = u.x * x + u.y * y, aside = u.x * y - u.y * x;
        back = std::min(back, ahead - half_length);
        front = std::max(front, ahead + half_length);
        right = std::min(right, aside - half_width);
        left = std::max(left, aside + half_width);
      }
    }
    const double ahead = 0.5 * (back + front), aside = 0.5 * (right + left);
    trail.sweep = {{u.x * ahead - u.y * aside, u.y * ahead + u.x * aside},
                   {},
                   u,
                   0.5 * (front - back),
                   0.5 * (left - right)};
    const MovingBox& sweep = trail.sweep;
    trail.radius = std::sqrt(sweep.half_length * sweep.half_length + sweep.half_width * sweep.half_width);
    trail.pedestrian = frame.pedestrian[i] != 0;
    trail.planned_stop = frame.planned_stop[i] != 0;
    trail.agent = frame.agent_driven[i] != 0;
    trail.speed = frame.speed[i];
    trail.lanes = LaneUserAt(frame, i);
    block.trails.push_back(trail);
  }
  for (std::size_t k = 0; k < filled_; ++k) slot_of_[static_cast<std::size_t>(filling_[k].number)] = kNone;
  filled_ = 0;

  grid_items_.clear();
  grid_x_.clear();
  grid_y_.clear();
  max_radius_ = 0.0;
  for (std::size_t b = 0; b < blocks_.size(); ++b) {
    for (std::size_t k = 0; k < blocks_[b].trails.size(); ++k) {
      const Trail& trail = blocks_[b].trails[k];
      grid_items_.emplace_back(static_cast<std::uint32_t>(b), static_cast<std::uint32_t>(k));
      grid_x_.push_back(trail.sweep.center.x);
      grid_y_.push_back(trail.sweep.center.y);
      max_radius_ = std::max(max_radius_, trail.radius);
    }
  }
  grid_.Build(grid_x_, grid_y_);

  const std::vector<Trail>& now = block.trails;
  found_by_thread_.resize(static_cast<std::size_t>(omp_get_max_threads()));
  for (auto& found : found_by_thread_) found.clear();
#pragma omp parallel if (now.size() >= kMinParallelRows)
  {
    auto& found = found_by_thread_[static_cast<std::size_t>(omp_get_thread_num())];
#pragma omp for schedule(static)
    for (std::size_t k = 0; k < now.size(); ++k) FindEncroachments(now[k], &found);
  }
  for (const auto& found : found_by_thread_) found_.insert(found_.end(), found.begin(), found.end());
  // Of a pair, the least; in an order that depends on neither the threads nor the rows.
  std::sort(found_.begin(), found_.end(), [](const Encroachment& a, const Encroachment& b) {
    return std::tie(a.earlier, a.later, a.pet, a.time) < std::tie(b.earlier, b.later, b.pet, b.time);
  });
  found_.erase(std::unique(found_.begin(), found_.end(),
                           [](const Encroachment& a, const Encroachment& b) {
                             return a.earlier == b.earlier && a.later == b.later;
                           }),
               found_.end());
}

void EncroachmentWatch::FindEncroachments(const Trail& later, std::vector<Encroachment>* found) const {
  const Point2 here = later.sweep.center;
  grid_.ForEachNear(here.x, here.y, later.radius + max_radius_, [&](AgentIndex item) {
    const auto [b, k] = grid_items_[static_cast<std::size_t>(item)];
    const Trail& earlier = blocks_[b].trails[k];
    if (earlier.number == later.number || AreApart(earlier.sweep, later.sweep)) return;
    if ((earlier.pedestrian && later.pedestrian) || (earlier.planned_stop && later.planned_stop)) return;
    const LaneUser &a = earlier.lanes, &c = later.lanes;
    if (IsOnWayOf(c, a) || IsOnWayOf(a, c)) return;   // In line;
    if (a.lane != kNone && a.lane == c.lane) return;  // so too when they came from different lanes.
    // The earlier one's tail, or all of it, has turned off the way both had.
    if (a.rear != kNone && (a.rear == c.lane || a.rear == c.behind)) return;
    if (a.behind != kNone && a.behind == c.behind && a.lane != c.lane) return;
    if (ClassifyMeeting(network_, a, c) == EncounterType::kFollowing) return;
    Compare(blocks_[b], earlier, later, found);
  });
}

void EncroachmentWatch::Compare(const Block& before, const Trail& earlier, const Trail& later,
                                std::vector<Encroachment>* found) const {
  const Block& now = blocks_.back();
  double least = threshold_, time = 0.0;
  Point2 place;
  for (std::uint32_t q = 0; q < later.pieces; ++q) {
    const Piece& b = now.pieces[later.first_piece + q];
    for (std::uint32_t p = earlier.pieces; p-- > 0;) {
      const Piece& a = before.pieces[earlier.first_piece + p];
      const double lag = b.begin - a.begin;
      if (lag < -0.5 * step_length_) continue;  // After the later one.
      if (lag - step_length_ >= least) break;   // Pieces before are further away in time.
      const ConflictRegion region = FindConflictRegion(a.box, b.box, step_length_, step_length_);
      if (region.empty()) continue;
      const ConflictRegion::Corner soonest = SoonestAfter(region);
      const double gap = lag + soonest.b - soonest.a;
      if (gap <= 0.0) {
        // Within one step: one is not after the other. Either they touch, or it was the later one's way
        // first.
        const bool touch = std::any_of(
            region.corner.begin(), region.corner.begin() + static_cast<std::ptrdiff_t>(region.size),
            [&](const ConflictRegion::Corner& c) { return lag + c.b - c.a >= 0.0; });
        if (touch) return;
        continue;
      }
      if (gap < least) {
        least = gap;
        time = b.begin + soonest.b;
        place = {b.box.center.x + soonest.b * b.box.velocity.x + b.box.half_length * b.box.u.x,
                 b.box.center.y + soonest.b * b.box.velocity.y + b.box.half_length * b.box.u.y};
      }
    }
  }
  if (least == threshold_) return;
  found->push_back({earlier.number, later.number, least, time, place.x, place.y,
                    ClassifyMeeting(network_, earlier.lanes, later.lanes), earlier.lanes.lane,
                    later.lanes.lane, earlier.speed, later.speed, earlier.agent, later.agent});
}

}  // namespace lanewise
