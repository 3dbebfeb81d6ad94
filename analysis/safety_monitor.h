#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <unordered_map>
#include <vector>

#include "agents/core/geometry.h"
#include "agents/core/spatial_grid.h"
#include "agents/core/types.h"
#include "agents/network/road_network.h"
#include "analysis/conflict_geometry.h"
#include "analysis/encounter.h"
#include "analysis/encroachment_watch.h"
#include "analysis/lane_motion.h"
#include "analysis/lane_order.h"
#include "analysis/safety_params.h"
#include "analysis/traffic_frame.h"

namespace lanewise {

/// One contact of a pair, from the first overlap of the boxes until they stay apart.
struct Contact {
  std::int32_t first{kNone};  ///< Vehicle number; first < second.
  std::int32_t second{kNone};
  std::int32_t striking{kNone};  ///< first, second, or kNone if both stood. See ChooseStriking.
  bool first_agent{false};       ///< Agent-driven at first touch.
  bool second_agent{false};
  double begin{0.0};      ///< [s] first step with overlap.
  double end{0.0};        ///< [s] last step with overlap.
  double x{0.0}, y{0.0};  ///< [m] middle of the touching region at first touch.
  LaneIndex first_lane{kNone};
  LaneIndex second_lane{kNone};
  bool in_junction{false};  ///< Either of them was at first touch.
  double first_speed{0.0};  ///< [m/s] at first touch.
  double second_speed{0.0};
  double closing_speed{0.0};  ///< [m/s] relative speed along the contact normal at first touch, >= 0.
  double max_depth{0.0};      ///< [m] largest penetration over the contact.

  bool striking_agent() const {
    return striking != kNone && (striking == first ? first_agent : second_agent);
  }
};

/// Watches all pairs of road users on their true 2-D poses: who touches whom, and who comes close in time.
/// Pairs that follow each other along their lanes are measured along them, as SUMO's device.ssm does; all
/// others by their boxes in the plane, each keeping its speed and going on along its lanes, straight where it
/// has none. Pedestrian pairs and pairs both standing at planned stops are no traffic conflict: skipped. The
/// result does not depend on the number of threads nor on the order of the rows.
class SafetyMonitor {
 public:
  /// Without a network (null) or paths in the frames nobody is known to follow along lanes.
  explicit SafetyMonitor(SafetyParams params = {}, const RoadNetwork* network = nullptr,
                         SafetyLevel level = SafetyLevel::kFull);

  /// Call once per step, in order of time.
  void Observe(const TrafficFrame& frame);

  /// Smallest TTC [s] of each row of the last frame; infinity = none below ttc_encounter. Empty unless
  /// watched.
  std::span<const double> row_ttc() const { return row_ttc_; }
  /// Largest DRAC [m/s^2] of each row of the last frame over its pairs with such a TTC; 0 = none. Likewise.
  std::span<const double> row_drac() const { return row_drac_; }

  /// Ends everything that is still open: at the end of the run.
  void Finish();

  /// Closed events since the last call, in order of closing; the monitor forgets them.
  std::vector<Contact> TakeFinishedContacts();
  std::vector<Encounter> TakeFinishedEncounters();
  /// Of the encounters closed since the last call: how both moved around the critical moment.
  std::vector<EncounterSample> TakeFinishedSamples();

  /// Contacts begun since the start of the run, open ones included.
  std::int64_t contact_count() const { return contact_count_; }

 private:
  /// Circle around all that a row sweeps within ttc_encounter. Small: the search reads many of them.
  struct Sweep {
    double x, y;    // [m] middle of the swept path.
    double radius;  // [m]
    std::int32_t row;
  };
  /// Sweeps by place.
  struct SweepIndex {
    SpatialGrid grid;
    std::vector<Sweep> sweeps{};   // In the order of the grid's slots, once it is built.
    std::vector<double> x{}, y{};  // The grid's columns.
    std::vector<Sweep> unsorted{};
    void Clear();
    void Add(const Sweep& sweep);
    void Build();
  };
  /// What the finer tests read of a row, side by side in memory.
  struct Body {
    double x, y;                     // [m] center of the box.
    double vx, vy;                   // [m/s]
    double ux, uy;                   // Unit vector of the heading.
    double half_length, half_width;  // [m]
    double radius;                   // [m] of the circumscribed circle.
    bool turns;                      // Its lanes take it elsewhere than straight on.
  };
  static constexpr std::size_t kWindows = 3;  // Parts of the horizon in which turning ones are searched.
  static constexpr std::size_t kPieces = 15;  // Of straight motion, of which a turning one's is made: 0.2 s.
  /// Where a turning one will be at the ends of the windows.
  struct Outline {
    std::array<BoxPose, kWindows + 1> pose;
    double radius;  // [m] of the circle around all that it sweeps within one.
  };
  /// Two on collision course, moving straight as they do at the first touch: they will come to it in `ttc`
  /// [s].
  struct Meeting {
    double ttc;
    MovingBox a, b;
  };
  /// A pair beyond a threshold in this step.
  struct ClosePair {
    std::int32_t first, second;  // Vehicle numbers, first < second.
    std::int32_t first_row, second_row;
    double ttc;      // [s]
    double depth;    // [m] > contact_depth: in contact.
    double drac;     // [m/s^2] 0: undefined.
    double mttc;     // [s] infinity: undefined.
    double closing;  // [m/s]
    EncounterType type;
    bool ego_is_first;
  };
  struct OpenEncounter {
    Encounter encounter;
    std::vector<EncounterSample> samples;  // In order of time, of all of it.
    ClosePair now{};                       // Its measures when it last was beyond a threshold,
    double now_time{-1.0};                 // [s] and when that was; < 0: never.
    /// The least distance [m] since more than separation_time after its end: of it only if it goes on.
    double late_distance{Encounter::kUndefined};
    double late_distance_time{0.0};

    void Extend(double time);  // It is beyond a threshold until `time` [s].
  };
  /// All road users at one moment.
  struct Snapshot {
    double time;                               // [s]
    std::vector<std::int32_t> row_of;          // By vehicle number; kNone: was not there.
    std::vector<EncounterSample::State> rows;  // By row.
  };

  void PrepareBodies(const TrafficFrame& frame);
  void FindClosePairs(const TrafficFrame& frame);
  void FindPartners(const TrafficFrame& frame, std::size_t i, std::vector<ClosePair>* found) const;
  void MeasurePair(const TrafficFrame& frame, std::size_t i, std::size_t j,
                   std::vector<ClosePair>* found) const;
  void FindLeaders(const TrafficFrame& frame, std::size_t i, std::vector<ClosePair>* found) const;
  std::optional<Meeting> MeetStraight(const MovingBox& a, const MovingBox& b) const;
  std::optional<Meeting> MeetOnLanes(const TrafficFrame& frame, std::size_t i, std::size_t j) const;
  void MeasureInPlane(const TrafficFrame& frame, const Meeting& meeting, ClosePair* pair) const;
  bool MayMeetOnLanes(std::size_t i, std::size_t j) const;
  bool MayTouch(const Body& a, const Body& b) const;
  MovingBox BoxOf(std::size_t row) const;
  Footprint FootprintOf(const TrafficFrame& frame, std::size_t row) const;

  void UpdateContact(const TrafficFrame& frame, const ClosePair& pair);
  void UpdateEncounter(const TrafficFrame& frame, const ClosePair& pair);
  void UpdateEncroachment(const TrafficFrame& frame, const Encroachment& encroachment);
  void UpdateOpenEncounters(const TrafficFrame& frame);
  void TakeSnapshot(const TrafficFrame& frame);
  /// The pair's open encounter that a measure beyond a threshold at `time` [s] belongs to, or a new one.
  OpenEncounter& Open(std::int32_t first, std::int32_t second, double time);
  void CloseUntil(double last_seen);
  void CloseEncounter(OpenEncounter* open);

  SafetyParams params_;
  const RoadNetwork* network_;
  SafetyLevel level_;
  double horizon_;                         // [s] within which contact is searched.
  std::unique_ptr<LaneOrder> lane_order_;  // Null without a network; so is the next.
  std::unique_ptr<LaneMotion> lane_motion_;
  EncroachmentWatch encroachments_;
  double step_length_{0.0};  // [s] between the last two frames.
  double last_time_{0.0};
  bool observed_{false};
  std::vector<Sweep> sweeps_;  // By row.
  SweepIndex fast_{SpatialGrid(25.0)},
      slow_{SpatialGrid(12.0)};  // Circles above kSlowRadius, and the others.
  std::vector<BoxPose> poses_;   // By row.
  std::vector<Body> bodies_;
  std::vector<Outline> outlines_;     // Of turning ones only.
  std::vector<std::int32_t> row_of_;  // By vehicle number; kNone: not in the frame.
  std::vector<std::vector<ClosePair>> found_by_thread_;
  std::vector<ClosePair> close_pairs_;
  std::vector<double> row_ttc_, row_drac_;
  std::deque<Snapshot> snapshots_;                                    // The last event_before seconds.
  bool is_snapshot_{false};                                           // The last frame is one.
  std::unordered_map<std::uint64_t, Contact> open_contacts_;          // By pair.
  std::unordered_map<std::uint64_t, OpenEncounter> open_encounters_;  // By pair.
  std::vector<Contact> finished_contacts_;
  std::vector<Encounter> finished_encounters_;
  std::vector<EncounterSample> finished_samples_;
  std::int64_t contact_count_{0};
  std::int32_t encounter_count_{0};  // Finished ones.
};

/// A vehicle at the moment of first touch.
struct TouchingVehicle {
  Footprint footprint;
  Point2 velocity;  ///< [m/s] world.
  bool agent_driven{false};
};

struct Touch {
  Point2 point;               ///< [m] middle of the touching region.
  Point2 normal;              ///< Unit vector from a to b: the direction that separates them soonest.
  double closing_speed{0.0};  ///< [m/s] relative speed along the normal, >= 0.
};

/// Where and how two boxes touch that just overlap.
Touch DescribeTouch(const TouchingVehicle& a, const TouchingVehicle& b);

/// Which of two touching vehicles struck the other: 0 = a, 1 = b, kNone.
/// 1. A vehicle slower than standing_speed never strikes; if both stand, none does.
/// 2. Striking is who could still have braked. A vehicle qualifies if, at first touch, the touching region
/// lies
///    in the leading front_zone of its box (leading in its direction of motion) and it gains on the other:
///    along its own axis it is the faster. So the follower strikes in a rear-end contact, who runs into the
///    flank of a crossing vehicle strikes, and a vehicle whose front corner is clipped by a faster one
///    cutting in does not.
/// 3. Both qualify (head-on, or crossing with both fronts in it): the agent-driven one; if both or none are
///    agents, the one with the higher speed along the contact normal towards the other, who entered more
///    frontally.
/// 4. None qualifies (side-swipe): the one that moves faster along the normal towards the other; for flank on
///    flank that is the greater lateral velocity.
/// Equal in every respect: a, which SafetyMonitor makes the lower vehicle number.
std::int32_t ChooseStriking(const TouchingVehicle& a, const TouchingVehicle& b, const Touch& touch,
                            const SafetyParams& params);

}  // namespace lanewise
