#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "agents/agent_params.h"
#include "agents/coordination/junction_slots.h"
#include "agents/rules/junction_map.h"
#include "agents/sensing/road_view.h"
#include "agents/traffic.h"

namespace lanewise {

/// A road user on its way to a link, or on it.
struct Approach {
  AgentIndex row{kNone};
  std::int32_t link{kNone};
  float distance{0.0f};  ///< [m] from the front bumper to the stop line; < 0 behind it.
  float stops_at{0.0f};  ///< [m] on the link: the next place where it still can halt and may; huge if none.
  bool going{true};      ///< Will take the link as soon as it is there, as far as known.
  bool behind{false};    ///< Behind one of its lane that waits before the junction, bound wherever.
  bool person{false};    ///< On a crossing.
  bool backward{false};  ///< Walks against the link's direction.

  float position() const { return -distance; }  ///< [m] of the front on the link.
};

/// What the rules allow an agent in this step.
struct RuleAnswer {
  double speed_cap{1e9};  ///< [m/s]
  bool emergency{false};  ///< Only the hardest braking still stops it where it must.
  RuleState state;        ///< To be remembered.
};

/// [s] until a vehicle at `speed` has come `distance` further if it speeds up to `limit`.
double TimeToCover(double distance, double speed, double limit, double accel);
/// [s] the same while it brakes at `decel`; huge if it halts before.
double TimeToCoverBraking(double distance, double speed, double decel);
/// Can a vehicle still halt within `distance`, braking at `decel` after `reaction` [s]?
bool CanStop(double distance, double speed, double decel, double reaction);

/// Signals, right of way, and junctions kept clear: the rules of the road. Build lists once a step who
/// approaches which link; Decide then tells an agent how fast it may drive. Both read the state `now` only.
class JunctionRules {
 public:
  JunctionRules(const RoadNetwork& network, const std::vector<LaneCurve>& curves, const AgentParams& params);

  void Build(const World& world);
  RuleAnswer Decide(const World& world, AgentIndex ego, const WayAhead& way, const Leader& leader,
                    double dt) const;

  /// Does the ego wait, by way of others, for itself?
  bool IsInCircle(const World& world, AgentIndex ego) const;

  const JunctionMap& map() const { return map_; }
  /// Has the agents keep to the turns these coordinators give them from now on.
  void CoordinateBy(const JunctionSlots* slots) { slots_ = slots; }
  /// Who approaches a link or is on it, the foremost first.
  std::span<const Approach> On(std::int32_t link) const {
    return {by_link_.data() + link_start_[link], by_link_.data() + link_start_[link + 1]};
  }
  /// The links of a vehicle: the one it is on or has its rear on, then those ahead.
  std::span<const Approach> Of(AgentIndex row) const {
    return {own_.data() + static_cast<std::size_t>(row) * kMaxLinks, static_cast<std::size_t>(count_[row])};
  }
  /// Do the ways of two vehicles conflict at a junction, so that the rules say who goes first? Where
  /// a coordinator gives the first a turn all are taken to: who brakes for one that comes misses its turn.
  bool Conflict(const World& world, AgentIndex a, AgentIndex b) const;
  /// SUMO's letter for what a link shows now.
  char StateOf(const Traffic& traffic, const JunctionLink& link) const;

 private:
  static constexpr int kMaxLinks = 4;

  struct Verdict {
    RuleReason reason{RuleReason::kGo};
    float stop_at{0.0f};  // [m] on the link.
    AgentIndex by{kNone};
    bool hard{false};  // Somebody is in the way: brake as hard as need be.
  };

  /// The ego's turn at the junction ahead, as it has heard.
  struct OwnTurn {
    HeardSlots heard;
    std::int32_t turn;
    double time;  // [s] until its front is at the stop line.
  };

  std::int32_t LinkBehind(LaneIndex lane, EdgeIndex from) const;
  void ListLinks(const World& world, AgentIndex row);
  void ListPersons(const World& world);
  /// Is one ahead on its lane that will not take its next link as soon as it is there?
  bool IsBehindOneThatWaits(const World& world, AgentIndex row) const;
  Approach* Append(AgentIndex row, std::int32_t link, double distance);
  Verdict CheckLink(const World& world, AgentIndex ego, const Approach& own, const WayAhead& way, int forced,
                    const OwnTurn* turn, RuleAnswer* answer) const;
  AgentIndex BlockerBehind(const World& world, AgentIndex ego, const Approach& own, const WayAhead& way,
                           bool* blocked) const;
  bool GivesWay(const World& world, const Approach& own, const ConflictArea& area, const Approach& other,
                char state, int forced, const OwnTurn* turn, bool* hard) const;
  std::optional<OwnTurn> TurnOf(const World& world, const Approach& own) const;
  int Forced(const World& world, AgentIndex ego) const;
  bool WaitsFor(const World& world, AgentIndex row, AgentIndex whom) const;
  AgentIndex RowOf(std::int32_t number) const;
  double TimeTo(const World& world, const Approach& approach, double position, double accel_share) const;

  const RoadNetwork& network_;
  AgentParams params_;
  JunctionMap map_;
  const JunctionSlots* slots_{nullptr};  // Null: no coordinators.
  std::vector<Approach> own_;            // By row, kMaxLinks each.
  std::vector<std::int8_t> count_;       // By row.
  std::vector<Approach> by_link_;
  std::vector<std::uint32_t> link_start_, link_fill_;
  std::vector<AgentIndex> row_of_number_;
  SpatialGrid crossing_grid_{30.0};
};

}  // namespace lanewise
