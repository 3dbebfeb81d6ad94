#pragma once

#include <cstdint>
#include <string_view>

#include "agents/core/params.h"

namespace lanewise {

/// What the safety engine watches: nothing, who touches whom, or contacts and encounters.
enum class SafetyLevel : std::uint8_t { kOff, kContacts, kFull };
inline constexpr std::string_view kSafetyLevelNames[] = {"off", "contacts", "full"};

/// Thresholds of the safety engine; the defaults are those of SUMO's device.ssm where it has one.
struct SafetyParams {
  double ttc_encounter{3.0};    ///< [s] a pair below it has an encounter.
  double drac_encounter{3.0};   ///< [m/s^2] a pair above it has one.
  double pet_encounter{2.0};    ///< [s] a pair below it has one.
  double ttc_near_miss{1.5};    ///< [s] an encounter below it, without contact, is a near miss, and serious.
  double drac_serious{6.0};     ///< [m/s^2] an encounter above it is serious.
  double pet_serious{1.0};      ///< [s] an encounter below it is serious.
  double separation_time{2.0};  ///< [s] apart for less than this: still the same contact or encounter.
  double event_before{2.0};     ///< [s] of both trajectories kept before the critical moment.
  double event_after{1.0};      ///< [s] and after it; at most separation_time.
  double event_period{0.5};     ///< [s] between two samples of them; 0: none are kept.
  double contact_depth{0.001};  ///< [m] boxes overlapping by more are in contact: above rounding, below
                                ///< relevance.
  double standing_speed{0.1};   ///< [m/s] slower vehicles never strike.
  double front_zone{0.25};  ///< Leading part of a box, ratio of its length, in which a hit counts as frontal.

  template <class Self, class Field>
  static void Visit(Self& p, Field&& field) {
    field("safety.ttc_encounter", p.ttc_encounter, "s", Range{0.1, 30}, "a pair below it has an encounter",
          "SUMO device.ssm: TTC 3.0");
    field("safety.drac_encounter", p.drac_encounter, "m/s^2", Range{0.1, 100},
          "a pair above it has an encounter", "SUMO device.ssm: DRAC 3.0");
    field("safety.pet_encounter", p.pet_encounter, "s", Range{0, 10}, "a pair below it has an encounter",
          "SUMO device.ssm: PET 2.0");
    field("safety.ttc_near_miss", p.ttc_near_miss, "s", Range{0, 30},
          "an encounter below it, without contact, is a near miss, and serious",
          "van der Horst 1990; FHWA SSAM: 1.5");
    field("safety.drac_serious", p.drac_serious, "m/s^2", Range{0.1, 100}, "an encounter above it is serious",
          "Archer 2005: emergency braking from 6 on");
    field("safety.pet_serious", p.pet_serious, "s", Range{0, 10}, "an encounter below it is serious",
          "own choice: about the reaction time");
    field("safety.separation_time", p.separation_time, "s", Range{0, 60},
          "apart for less than this is still the same contact or encounter", "own choice");
    field("safety.event_before", p.event_before, "s", Range{0, 30},
          "part of both trajectories kept before an encounter's critical moment", "own choice");
    field("safety.event_after", p.event_after, "s", Range{0, 30},
          "and after it, at most safety.separation_time", "own choice");
    field("safety.event_period", p.event_period, "s", Range{0, 10},
          "time between two samples of them; 0: none are kept", "own choice");
  }
};

}  // namespace lanewise
