#pragma once

#include <cstdint>
#include <limits>
#include <string_view>

#include "agents/core/types.h"

namespace lanewise {

/// How the paths of an encounter's two road users meet.
enum class EncounterType : std::uint8_t {
  kFollowing,   ///< One drives behind the other on the same path.
  kMerging,     ///< From different lanes into the same one.
  kCrossing,    ///< Their lanes cross; everybody beside the lanes (pedestrians) too.
  kSideSwipe,   ///< On neighboring lanes, each within its own.
  kStraddling,  ///< On neighboring lanes, one of them across the line between.
  kOncoming,    ///< Head on.
};
inline constexpr std::string_view kEncounterTypeNames[] = {"following",  "merging",    "crossing",
                                                           "side_swipe", "straddling", "oncoming"};

/// SUMO's code of the type (docs: Simulation/Output/SSM_Device) as its device.ssm gives it for the ego
/// vehicle. An encounter's ego follows or comes second; at another moment of it ego may lead. SUMO knows no
/// straddling: it is its ON_ADJACENT_LANES too.
constexpr std::int32_t SumoTypeCode(EncounterType type, bool contact, bool ego_leads = false) {
  constexpr std::int32_t kFollows[] = {2, 7, 11, 4, 4, 20};
  constexpr std::int32_t kLeads[] = {3, 6, 10, 4, 4, 20};
  return contact ? 111 : (ego_leads ? kLeads : kFollows)[static_cast<std::size_t>(type)];
}
inline constexpr std::int32_t kSumoNoConflict = 0;  ///< SUMO's NOCONFLICT_AHEAD.

/// How serious an encounter was.
enum class Severity : std::uint8_t {
  kConflict = 1,  ///< A measure crossed SUMO's threshold.
  kSerious = 2,   ///< TTC, PET or DRAC crossed the threshold of a serious conflict.
  kContact = 3,
};

/// One encounter of a pair: the time during which TTC, DRAC or PET crosses its threshold.
struct Encounter {
  static constexpr double kUndefined = std::numeric_limits<double>::infinity();

  std::int32_t number{0};     ///< Running number within the run, in order of ending.
  std::int32_t first{kNone};  ///< Vehicle number; first < second.
  std::int32_t second{kNone};
  bool ego_is_first{false};  ///< Ego follows or comes second; the other is the foe.
  EncounterType type{EncounterType::kFollowing};
  Severity severity{Severity::kConflict};
  bool first_agent{false};  ///< Agent-driven at `critical`.
  bool second_agent{false};
  double begin{0.0};      ///< [s]
  double end{0.0};        ///< [s] last step with a measure beyond its threshold.
  double critical{0.0};   ///< [s] moment of min_ttc; without one of pet, else of max_drac.
  double x{0.0}, y{0.0};  ///< [m] midway between both front bumpers then.
  LaneIndex first_lane{kNone};
  LaneIndex second_lane{kNone};
  bool in_junction{false};  ///< Either of them was then.
  double first_speed{0.0};  ///< [m/s] then.
  double second_speed{0.0};
  double min_ttc{kUndefined};  ///< [s]; 0 if they touched.
  double min_ttc_time{0.0};    ///< [s] simulated time of it (the first, if several); so below.
  double max_drac{0.0};        ///< [m/s^2]; 0: undefined, there was no collision course.
  double max_drac_time{0.0};
  double min_mttc{kUndefined};  ///< [s]
  double min_mttc_time{0.0};
  double pet{kUndefined};           ///< [s]
  double pet_time{0.0};             ///< [s] when the second one came.
  double min_distance{kUndefined};  ///< [m] between the boxes.
  double min_distance_time{0.0};
  double max_closing_speed{0.0};  ///< [m/s] of the pair on collision course; 0: it never was.
  double max_closing_speed_time{0.0};
  double first_delta_v{0.0};  ///< [m/s] change of velocity at first touch; 0 without contact.
  double second_delta_v{0.0};
  bool contact{false};    ///< The boxes touched.
  bool near_miss{false};  ///< min_ttc below the near-miss threshold and no contact.
};

/// One moment of the event recorder: both road users of an encounter. Positions are those of the middle of
/// the front bumper.
struct EncounterSample {
  struct State {
    double x{0.0}, y{0.0};  ///< [m]
    double heading{0.0};    ///< [rad]
    double speed{0.0};      ///< [m/s]
    double accel{0.0};      ///< [m/s^2]
  };
  std::int32_t encounter{0};  ///< Encounter::number.
  double time{0.0};           ///< [s]
  State first, second;
  double ttc{Encounter::kUndefined};        ///< [s] at this moment, as in Encounter; so the next.
  double drac{0.0};                         ///< [m/s^2]
  std::int32_t type_code{kSumoNoConflict};  ///< SumoTypeCode seen by the encounter's ego, while close.
};

}  // namespace lanewise
