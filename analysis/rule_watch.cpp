#include "analysis/rule_watch.h"

#include <utility>

namespace lanewise {
namespace {

constexpr double kStanding = 0.1;      // [m/s]
constexpr double kReaction = 0.5;      // [s] of who sees a signal turn.
constexpr double kBlocking = 10.0;     // [s] of standing in a junction.
constexpr double kStandstill = 300.0;  // [s]

/// Green for somebody, or no signal at all.
bool IsStop(char state) {
  return state == 'r' || state == 'u' || state == 'y' || state == 'Y';
}

}  // namespace

std::vector<RuleEventRow> RuleWatch::TakeEvents() {
  return std::exchange(events_, {});
}

void RuleWatch::Note(RuleEventKind kind, double time, std::int32_t number, LaneIndex lane) {
  events_.push_back({time, number, kind, lane});
  ++counts_[static_cast<std::size_t>(kind)];
}

char RuleWatch::Shows(const Traffic& traffic, std::int32_t connection) const {
  const Connection& link = network_.connections[connection];
  if (link.signal >= std::ssize(traffic.signal_states)) return 'O';
  const std::string& states = traffic.signal_states[link.signal];
  return link.link_index < std::ssize(states) ? states[link.link_index] : 'O';
}

void RuleWatch::Observe(double time, const Traffic& traffic) {
  for (std::size_t row = 0; row < traffic.vehicle_count; ++row) {
    const auto number = static_cast<std::size_t>(traffic.number[row]);
    if (number >= watched_.size()) watched_.resize(number + 1);
    Watched& watched = watched_[number];
    WatchSignal(time, traffic, row, &watched);
    WatchStandstill(time, traffic, row, &watched);
    const RuleState& rule = traffic.now.rule[row];
    const bool forced = rule.forced != 0 && rule.reason == RuleReason::kGo;
    if (forced && !watched.forced)
      Note(RuleEventKind::kForcedEntry, time, traffic.number[row], traffic.now.lane[row]);
    watched.forced = forced;
    watched.lane = traffic.now.lane[row];
  }
}

void RuleWatch::WatchSignal(double time, const Traffic& traffic, std::size_t row, Watched* watched) {
  const LaneIndex lane = traffic.now.lane[row];
  if (lane == kNone || watched->lane == kNone) {
    watched->connection = kNone;
    watched->could_stop = false;
    if (lane == kNone) return;
  }
  const Lane& here = network_.lanes[lane];
  if (watched->connection != kNone && lane != watched->lane) {
    const char shown = Shows(traffic, watched->connection);
    if (here.edge != network_.lanes[watched->lane].edge && watched->could_stop &&
        (shown == 'r' || shown == 'u'))
      Note(RuleEventKind::kRedLight, time, traffic.number[row], watched->lane);
  }
  // The link its route takes at the end of this lane.
  std::int32_t next = kNone;
  const RoutePlan* plan = traffic.plan[row];
  const auto position = static_cast<std::size_t>(traffic.route_position[row]);
  if (plan != nullptr && !here.internal && position + 1 < plan->route().size() &&
      plan->route()[position] == here.edge) {
    next = plan->At(position, here.index).connection;
  }
  if (next != kNone && network_.connections[next].signal == kNone) next = kNone;
  if (next != watched->connection) {
    watched->connection = next;
    watched->could_stop = false;
  }
  if (next == kNone) return;
  if (!IsStop(Shows(traffic, next))) {
    watched->could_stop = false;
    return;
  }
  const double speed = traffic.now.speed[row];
  watched->could_stop =
      watched->could_stop || speed * kReaction + speed * speed / (2.0 * traffic.params[row].max_decel) <=
                                 here.length - traffic.now.s[row];
}

void RuleWatch::WatchStandstill(double time, const Traffic& traffic, std::size_t row, Watched* watched) {
  const LaneIndex lane = traffic.now.lane[row];
  if (lane == kNone || traffic.now.speed[row] >= kStanding || traffic.hazard[row] != 0) {
    watched->stood = 0.0;
    return;
  }
  const double before = watched->stood, now = before + dt_;
  watched->stood = now;
  if (before < kStandstill && now >= kStandstill)
    Note(RuleEventKind::kStandstill, time, traffic.number[row], lane);
  // The first part of a way that has two is where one may wait.
  const Lane& here = network_.lanes[lane];
  const bool waiting_place =
      !here.outgoing.empty() && network_.connections[here.outgoing.front()].via != kNone;
  if (here.internal && !waiting_place && before < kBlocking && now >= kBlocking)
    Note(RuleEventKind::kJunctionBlocked, time, traffic.number[row], lane);
}

}  // namespace lanewise
