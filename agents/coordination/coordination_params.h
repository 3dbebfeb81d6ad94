#pragma once

#include "agents/core/params.h"

namespace lanewise {

/// Green-light speed advice.
struct AdviceParams {
  double range{300.0};
  double min_speed{3.0};
  double decel{0.5};
  double headway{1.5};
  double start_delay{1.5};
  double green_margin{-3.0};
};

/// Signals that adapt to the shared positions.
struct SignalParams {
  double max_change{4.0};
  double max_cycle_change{8.0};
  double min_green{5.0};
  double walking_speed{1.2};
  double smoothing{0.3};
};

/// A dispatcher that advises routes and departures.
struct DispatchParams {
  double interval{30.0};
  double crowded_speed{0.4};
  double relieved_speed{0.6};
  double crowded_density{0.03};
  double share{0.5};
  double min_gain{0.1};
  double pause{120.0};
  double max_hold{120.0};
};

/// Slots at junctions without signals.
struct SlotParams {
  double range{250.0};
  double interval{0.5};
  double fixed_time{4.0};
  double margin{0.6};
  double headway{1.0};
  double max_age{1.0};
};

/// What is coordinated over the roadside units. The Visit table is the only declaration of name, unit, range,
/// meaning and source.
struct CoordinationParams {
  AdviceParams advice;
  SignalParams signals;
  DispatchParams dispatch;
  SlotParams slots;

  template <class Self, class Field>
  static void Visit(Self& p, Field&& field) {
    field("advice.range", p.advice.range, "m", Range{20, 2000},
          "green-light advice is given from this far before a stop line", "as v2x.range");
    field("advice.min_speed", p.advice.min_speed, "m/s", Range{0.5, 20}, "nobody is advised to be slower",
          "own choice");
    field("advice.decel", p.advice.decel, "m/s^2", Range{0.1, 4},
          "a vehicle slows down so to the advised speed", "own choice: coasting");
    field("advice.headway", p.advice.headway, "s", Range{1, 5},
          "vehicles of a lane pass a stop line this long after each other",
          "measured: 1.48 s behind an agents' queue");
    field("advice.start_delay", p.advice.start_delay, "s", Range{0, 5},
          "the first one passes this long after green begins",
          "own choice: rolling, it need not brake before the line while that is red");
    field("advice.green_margin", p.advice.green_margin, "s", Range{-3, 5},
          "and the last one this long before it ends; negative: into the yellow",
          "own choice: who is told to wait for the next green loses a cycle if it could have passed");
    field("signals.max_change", p.signals.max_change, "s", Range{0, 20},
          "a cycle's green times and its offset change by no more than this", "SCOOT, Hunt et al. 1981: 4 s");
    field("signals.max_cycle_change", p.signals.max_cycle_change, "s", Range{0, 60},
          "a cycle is no more than this longer or shorter than the program's", "own choice");
    field("signals.min_green", p.signals.min_green, "s", Range{1, 60}, "no green is shorter",
          "RiLSA 2015: 5 s");
    field("signals.walking_speed", p.signals.walking_speed, "m/s", Range{0.5, 2},
          "a pedestrian's green and clearance together let one cross at this speed", "RiLSA 2015: 1.2 m/s");
    field("signals.smoothing", p.signals.smoothing, "-", Range{0.01, 1},
          "weight of the last cycle in the arrivals expected of the next one", "own choice");
    field("dispatch.interval", p.dispatch.interval, "s", Range{1, 3600},
          "edges are judged, and routes advised, so often", "own choice");
    field("dispatch.crowded_speed", p.dispatch.crowded_speed, "-", Range{0, 1},
          "an edge is crowded below this share of its limit ...", "own choice");
    field("dispatch.relieved_speed", p.dispatch.relieved_speed, "-", Range{0, 1},
          "and until the speed is above this one: hysteresis", "own choice");
    field("dispatch.crowded_density", p.dispatch.crowded_density, "1/m", Range{0, 0.2},
          "... and above this density on each lane, 1/m", "about where flow is greatest: 25 to 35 veh/km");
    field("dispatch.share", p.dispatch.share, "-", Range{0, 1},
          "share of vehicles that follow advice, drawn by id and seed", "own choice");
    field("dispatch.min_gain", p.dispatch.min_gain, "-", Range{0, 1},
          "a route is advised if it is faster than the present one by this share of its time", "own choice");
    field("dispatch.pause", p.dispatch.pause, "s", Range{0, 3600}, "time between two advices to a vehicle",
          "own choice");
    field("dispatch.max_hold", p.dispatch.max_hold, "s", Range{0, 3600},
          "nobody is held at the depot for longer", "own choice");
    field("slots.range", p.slots.range, "m", Range{20, 2000},
          "vehicles get a turn at a junction from this far before its stop line", "own choice");
    field("slots.interval", p.slots.interval, "s", Range{0.1, 5}, "arrivals are planned anew so often",
          "own choice");
    field("slots.fixed_time", p.slots.fixed_time, "s", Range{0, 20},
          "who could be there within this time keeps its place in the order",
          "own choice: a stop and a message");
    field("slots.margin", p.slots.margin, "s", Range{0.1, 5},
          "between one vehicle's leaving the common area and the next one's coming to it", "own choice");
    field("slots.headway", p.slots.headway, "s", Range{0.3, 5},
          "gap between vehicles of a lane, or into the same lane", "own choice");
    field("slots.max_age", p.slots.max_age, "s", Range{0.1, 5}, "older slots are not used", "own choice");
  }
};

}  // namespace lanewise
