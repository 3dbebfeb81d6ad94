#pragma once

#include <cmath>
#include <string>
#include <vector>

#include "analysis/following_data.h"

namespace lanewise {

/// Parameters of a driver of the Intelligent Driver Model, written down here once more from the paper
/// (Treiber, Hennecke, Helbing 2000, Eq. 1 and 2) so that the fit is not tested with itself.
struct IdmDriver {
  double v0{16.0}, time_gap{1.3}, min_gap{2.4}, accel{1.2}, decel{1.7};

  double Accel(double speed, double gap, double leader_speed) const {
    const double wanted = min_gap + std::fmax(0.0, speed * time_gap + speed * (speed - leader_speed) /
                                                                          (2.0 * std::sqrt(accel * decel)));
    return accel * (1.0 - std::pow(speed / v0, 4) - std::pow(wanted / gap, 2));
  }
};

/// A follower behind a leader that drives, brakes to a stop and goes on, integrated with steps of 5 ms,
/// written down each `period` [s]. @param phase [rad] makes episodes differ.
inline FollowingEpisode DriveBehind(const IdmDriver& driver, double phase, double duration = 90.0,
                                    double period = 0.5) {
  FollowingEpisode episode;
  episode.leader = "leader";
  episode.type = "car";
  const double h = 0.005;
  // Two waves; below zero it stands.
  const auto leader_speed = [&](double t) {
    return std::fmax(0.0, 8.0 + 6.5 * std::sin(0.16 * t + phase) + 4.0 * std::sin(0.41 * t + 2.0 * phase));
  };
  double gap = 20.0, speed = leader_speed(0.0), next_row = 0.0;
  for (int k = 0; k * h <= duration + 1e-9; ++k) {
    const double t = k * h;
    if (t >= next_row - 1e-9) {
      episode.time.push_back(t);
      episode.gap.push_back(gap);
      episode.speed.push_back(speed);
      episode.leader_speed.push_back(leader_speed(t));
      next_row += period;
    }
    const double next = std::fmax(0.0, speed + h * driver.Accel(speed, gap, leader_speed(t)));
    gap += h * (0.5 * (leader_speed(t) + leader_speed(t + h)) - 0.5 * (speed + next));
    speed = next;
  }
  return episode;
}

}  // namespace lanewise
