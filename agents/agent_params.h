#pragma once

#include "agents/core/params.h"

namespace lanewise {

/// Dynamic Window planner.
struct DwaParams {
  int speed_samples{15};
  int path_samples{20};
  double horizon{3.0};
  double path_weight{0.35};
  double goal_weight{1.0};
  double clearance_weight{0.6};
  double speed_weight{4.0};
  double comfort_weight{0.05};
  double clearance_margin{0.25};
  double clearance_comfort{0.6};
};

/// What an agent wants and tolerates on the road, whatever its policy.
struct DrivingParams {
  double comfort_decel{4.0};
  double max_lateral_accel{7.0};
  double tracking_time{0.9};
  double tracking_distance{3.0};
  double max_course_angle{0.5};
  double response_time{0.3};
  double pass_clearance{0.5};
  double guard_margin{8.0};
};

struct LaneChangeParams {
  double lookahead_time{35.0};
  double lookahead_distance{30.0};
  double reserve{14.0};
  double gain_threshold{0.35};
  double politeness{0.2};
  double safe_decel{3.0};
  double min_gap{1.0};
  double cooperation_decel{2.0};
  double queue_weight{0.02};
  double patience{10.0};
  double max_detour{300.0};
};

struct ControlParams {
  double speed_kp{2.0};
  double speed_ki{0.05};
  double speed_kd{0.0};
  double steering_kp{1.0};
  double steering_ki{0.02};
  double steering_kd{0.15};
  double derivative_filter{0.2};
};

/// The simulated lidar; the presets are SongLidar and RingLidar.
struct LidarParams {
  int beams{1081};
  double field{4.71238898038469};
  double max_range{30.0};
  double scan_period{0.025};
  double range_noise{0.01};
  double dropout{0.0};
};

/// The sector code of [A] and how the policies `bp`, `bls` and `apf` drive.
struct SectorParams {
  int min_points{10};
  double near_limit{0.1};
  double standstill{3.5};
  double reaction_time{0.3};
  double decel{4.0};
  double side_clearance{0.6};
  double side_range{8.5};
  double turn_reach{10.0};
  double turn_width{4.5};
  double turn_speed{2.5};
  double decide_by{6.0};
  double stop_distance{0.8};
  double strip_clearance{0.5};
  double flank_clearance{0.25};
  double guard_reach{3.0};
};

/// Artificial potential field.
struct ApfParams {
  double gain{6.0};
  double range{8.0};
};

/// Driving on roads without lanes, among standing and moving things.
struct OpenRoadParams {
  double min_width{8.0};
  double sight{70.0};
  double max_course{0.8};
  double decel{2.5};
  double lateral_accel{3.0};
  double steering_share{0.5};
  double near_speed{4.0};
  double moving_margin{0.5};
  double pursuit_time{0.3};
  double pursuit_distance{1.0};
};

/// The radio channel between vehicles and with roadside units; `--v2x` says how much of it there is.
struct V2xParams {
  double share{1.0};
  double range{300.0};
  double loss{0.0};
  double fading_range{400.0};
  double latency_min{0.005};
  double latency_mean{0.02};
  double latency_max{0.3};
  double position_noise{1.0};
  double carrier_sense_range{450.0};
  double message_bytes{350.0};
  double bitrate{6e6};
  double memory{2.0};
  double cam_min_interval{0.1};
  double cam_max_interval{1.0};
  double cam_heading{0.06981317007977318};
  double cam_position{4.0};
  double cam_speed{0.5};
  int cruise{0};
  double cruise_gap{0.6};
  double cruise_kp{0.2};
  double cruise_kd{0.7};
  double cruise_max_age{0.4};
  double cruise_reaction{0.35};
};

/// Rules of the road, where the agents answer for them.
struct RulesParams {
  double gap_time{1.0};
  double patience{60.0};
};

/// Every parameter of the agents. The Visit table is the only declaration of name, unit, range,
/// meaning and source.
struct AgentParams {
  DwaParams dwa;
  DrivingParams driving;
  LaneChangeParams lane_change;
  ControlParams control;
  LidarParams lidar;
  SectorParams sector;
  ApfParams apf;
  OpenRoadParams open_road;
  V2xParams v2x;
  RulesParams rules;

  template <class Self, class Field>
  static void Visit(Self& p, Field&& field) {
    field("dwa.speed_samples", p.dwa.speed_samples, "-", Range{3, 31},
          "speed profiles a plan: accelerations over the reachable window", "[C] 300 rollouts = 15 x 20");
    field("dwa.path_samples", p.dwa.path_samples, "-", Range{3, 64},
          "steering courses a plan: lateral targets over the free width", "[C] 300 rollouts = 15 x 20");
    field("dwa.horizon", p.dwa.horizon, "s", Range{1.0, 6.0}, "how far ahead a rollout is simulated",
          "own choice: braking from 50 km/h at 4.5 m/s^2 takes 3.1 s");
    field("dwa.path_weight", p.dwa.path_weight, "1/m", Range{0, 100},
          "critic 1: distance of the rollout's end from the reference path", "[C] DWA criterion 1");
    field("dwa.goal_weight", p.dwa.goal_weight, "-", Range{0, 100},
          "critic 2: progress lost against free driving", "[C] DWA criterion 2");
    field("dwa.clearance_weight", p.dwa.clearance_weight, "-", Range{0, 100},
          "critic 3: nearness of obstacles below clearance_comfort", "[C] DWA criterion 3");
    field("dwa.speed_weight", p.dwa.speed_weight, "-", Range{0, 100},
          "cost of driving faster than the reference speed of the course",
          "own choice, keeps following smooth");
    field("dwa.comfort_weight", p.dwa.comfort_weight, "-", Range{0, 100},
          "cost of braking and of changing course", "own choice");
    field("dwa.clearance_margin", p.dwa.clearance_margin, "m", Range{0, 2},
          "at 5 m/s, in proportion from 1.5 to 7 m/s: a rollout that comes closer to an obstacle is dropped",
          "own choice");
    field("dwa.clearance_comfort", p.dwa.clearance_comfort, "m", Range{0, 5},
          "clearance beyond which an obstacle no longer costs", "own choice");
    field("driving.comfort_decel", p.driving.comfort_decel, "m/s^2", Range{0.5, 9},
          "braking an agent plans with; it may use its type's decel and emergency decel when it must",
          "between the ISO 15622 comfort limit, 3.5, and SUMO's decel for cars, 4.5");
    field("driving.max_lateral_accel", p.driving.max_lateral_accel, "m/s^2", Range{0.5, 9},
          "sets the speed in bends: v = sqrt(a / curvature), of the path ahead and of the turn the vehicle "
          "is in",
          "netconvert --junctions.limit-turn-speed 5.5 is the mean of a turn; a path that steers in and out "
          "bends 1.3 times as much in its middle");
    field("driving.tracking_time", p.driving.tracking_time, "s", Range{0.2, 5},
          "time constant of the return to the reference path", "Stanley-type law, gain 1 / max(v t, d)");
    field("driving.tracking_distance", p.driving.tracking_distance, "m", Range{0.5, 20},
          "least distance constant of the return to the reference path", "the same, at low speed");
    field("driving.max_course_angle", p.driving.max_course_angle, "rad", Range{0.05, 0.8},
          "greatest angle between course and road", "own choice");
    field("driving.response_time", p.driving.response_time, "s", Range{0.05, 2},
          "time in which the speed is brought to the wanted one",
          "own choice: damping 0.9 at a time gap of 1 s");
    field("driving.pass_clearance", p.driving.pass_clearance, "m", Range{0.1, 3},
          "lateral room kept to a broken-down vehicle passed within the lane", "own choice");
    field("driving.guard_margin", p.driving.guard_margin, "m", Range{0, 100},
          "rules = sumo: SUMO's checks come on this much before braking distance to a junction",
          "own choice");
    field("lane_change.lookahead_time", p.lane_change.lookahead_time, "s", Range{1, 120},
          "a needed change is begun this many seconds before the lane ends, per lane",
          "SUMO LC2013 uses 10 and changes at once; a lateral motion in dense queues needs more");
    field("lane_change.lookahead_distance", p.lane_change.lookahead_distance, "m", Range{0, 500},
          "and at least at this distance, per lane", "own choice");
    field("lane_change.reserve", p.lane_change.reserve, "m", Range{0, 100},
          "room kept before the lane's end to steer over from standstill",
          "bicycle model: 3.2 m needs about 10 m");
    field("lane_change.gain_threshold", p.lane_change.gain_threshold, "m/s^2", Range{0, 5},
          "advantage in acceleration worth a change", "MOBIL, Kesting et al. 2007");
    field("lane_change.politeness", p.lane_change.politeness, "-", Range{0, 1},
          "weight of the new follower's loss", "MOBIL, Kesting et al. 2007");
    field("lane_change.safe_decel", p.lane_change.safe_decel, "m/s^2", Range{0.5, 9},
          "braking one may impose on the new follower", "MOBIL, Kesting et al. 2007");
    field("lane_change.min_gap", p.lane_change.min_gap, "m", Range{0.1, 10},
          "least gap to the new leader and the new follower", "own choice");
    field("lane_change.cooperation_decel", p.lane_change.cooperation_decel, "m/s^2", Range{0, 9},
          "braking one accepts to let a vehicle in that must change", "own choice");
    field("lane_change.queue_weight", p.lane_change.queue_weight, "m/s^3", Range{0, 1},
          "advantage a second less of queueing ahead gives a lane in an unforced change",
          "fitted on Bologna (joined, Via Saffi)");
    field("lane_change.patience", p.lane_change.patience, "s", Range{0, 600},
          "at the end of a lane that leaves the route, a vehicle lets the neighbour lane pass for so long; "
          "then "
          "it drives on where its lane leads, and back to its route",
          "own choice");
    field("lane_change.max_detour", p.lane_change.max_detour, "s", Range{0, 3600},
          "unless that takes so much longer at the speed limits, or misses a planned stop; 0: never",
          "own choice");
    field("control.speed_kp", p.control.speed_kp, "1/s", Range{0.1, 10}, "PID speed: proportional",
          "[C] PID");
    field("control.speed_ki", p.control.speed_ki, "1/s^2", Range{0, 10}, "PID speed: integral", "[C] PID");
    field("control.speed_kd", p.control.speed_kd, "-", Range{0, 10}, "PID speed: derivative", "[C] PID");
    field("control.steering_kp", p.control.steering_kp, "-", Range{0.1, 10},
          "PID steering: proportional, on the lateral error over the tracking distance", "[C] PID");
    field("control.steering_ki", p.control.steering_ki, "1/s", Range{0, 10}, "PID steering: integral",
          "[C] PID");
    field("control.steering_kd", p.control.steering_kd, "s", Range{0, 10}, "PID steering: derivative",
          "[C] PID");
    field("control.derivative_filter", p.control.derivative_filter, "s", Range{0, 5},
          "low-pass on the derivative", "[C] lag filter against noise");
    field("lidar.beams", p.lidar.beams, "-", Range{8, 4096}, "beams a scan", "[A] 1,081 (UTM-30LX); [C] 360");
    field("lidar.field", p.lidar.field, "rad", Range{3.2, 6.2831853},
          "angle from the first beam to the last one", "[A] 270 deg; [C] all around");
    field("lidar.max_range", p.lidar.max_range, "m", Range{1, 200}, "farther things do not reflect",
          "[A] 30 m");
    field("lidar.scan_period", p.lidar.scan_period, "s", Range{0, 1},
          "time of a scan: a reading is as old as that, which lengthens the reaction", "[A] 25 ms");
    field("lidar.range_noise", p.lidar.range_noise, "m", Range{0, 1},
          "standard deviation of a range, cut off at four", "UTM-30LX data sheet: repeated accuracy 10 mm");
    field("lidar.dropout", p.lidar.dropout, "-", Range{0, 1},
          "probability that a beam gives no reading, in steps of 1/256", "own choice: none");
    field("sector.min_points", p.sector.min_points, "-", Range{0, 1000},
          "a sector is blocked by more readings than that in the avoidance zone", "[A] Eq. 8, t = 10");
    field("sector.near_limit", p.sector.near_limit, "m", Range{0, 5}, "nearer readings are dust",
          "[A] 0.4 m on a small robot; a car may stand nearer to a wall");
    field("sector.standstill", p.sector.standstill, "m", Range{0.5, 30},
          "how far the avoidance zone reaches ahead at standstill",
          "own choice: about the turning circle of a car; [A] 0.6 m on a small robot");
    field("sector.reaction_time", p.sector.reaction_time, "s", Range{0, 3},
          "the zone grows by speed x (this + scan period)", "own choice, the response time of the planner");
    field("sector.decel", p.sector.decel, "m/s^2", Range{0.5, 9}, "and by the braking distance at this",
          "as driving.comfort_decel");
    field("sector.side_clearance", p.sector.side_clearance, "m", Range{0, 3},
          "the front sectors' zone is the vehicle's width and this on both sides", "own choice");
    field("sector.side_range", p.sector.side_range, "m", Range{0.5, 30},
          "how far the other sectors' zone reaches at most", "own choice: a car's length and its turn");
    field(
        "sector.turn_reach", p.sector.turn_reach, "m", Range{2, 30},
        "open roads: bp and bls choose a side by what is nearer than this, and look so far for a free strip",
        "own choice: a lane's width aside takes a car about 8 m");
    field("sector.turn_width", p.sector.turn_width, "m", Range{1, 30},
          "open roads: and by what is within this to either side",
          "own choice: a lane's width and half a vehicle");
    field("sector.turn_speed", p.sector.turn_speed, "m/s", Range{0.5, 15},
          "speed at which bp, bls and apf turn aside when the strip ahead is not free",
          "own choice: the turning circle lies within the zone at standstill");
    field("sector.decide_by", p.sector.decide_by, "m", Range{0, 30},
          "open roads: nearer than this to what blocks the strip, bp and bls take a side even if the scan "
          "speaks for none",
          "own choice");
    field("sector.stop_distance", p.sector.stop_distance, "m", Range{0.1, 10},
          "open roads: nothing free as near as this, bp, bls and apf stop", "own choice");
    field("sector.strip_clearance", p.sector.strip_clearance, "m", Range{0, 3},
          "open roads: room beside the strip bp and bls steer into", "own choice");
    field("sector.flank_clearance", p.sector.flank_clearance, "m", Range{0, 3},
          "open roads: bp, bls and apf do not steer so that the outline would come nearer to anything",
          "own choice");
    field("sector.guard_reach", p.sector.guard_reach, "m", Range{0.5, 20},
          "open roads: for at least so far, or until they can stop", "own choice: most of a car's length");
    field("apf.gain", p.apf.gain, "m^3", Range{0, 1000},
          "repulsion gain (1/r - 1/range) / r^2 against a pull of 1 along the road", "Khatib 1986, Eq. 16");
    field("apf.range", p.apf.range, "m", Range{0.5, 30}, "farther edges do not repel", "Khatib 1986, Eq. 16");
    field("open_road.min_width", p.open_road.min_width, "m", Range{4, 100},
          "a lane so wide is driven freely: ways through standing things are searched on it",
          "own choice: more than two lanes");
    field("open_road.sight", p.open_road.sight, "m", Range{20, 80}, "how far ahead a way is searched",
          "own choice");
    field("open_road.max_course", p.open_road.max_course, "rad", Range{0.2, 1.0},
          "greatest angle between course and open road", "own choice");
    field("open_road.decel", p.open_road.decel, "m/s^2", Range{0.5, 9}, "braking before slow parts of a way",
          "own choice, comfortable");
    field("open_road.lateral_accel", p.open_road.lateral_accel, "m/s^2", Range{0.5, 9},
          "sets the speed in the bends of a way", "own choice, comfortable");
    field("open_road.steering_share", p.open_road.steering_share, "-", Range{0.1, 1},
          "share of the steering rate a way may ask for, which sets its speed", "own choice");
    field("open_road.near_speed", p.open_road.near_speed, "m/s", Range{0.5, 20},
          "speed beside things nearer than dwa.clearance_comfort", "own choice");
    field("open_road.moving_margin", p.open_road.moving_margin, "m", Range{0, 5},
          "gap kept to what moves, as foreseen", "own choice");
    field("open_road.pursuit_time", p.open_road.pursuit_time, "s", Range{0.05, 3},
          "the front bumper aims at the point of the way this far ahead", "pure pursuit, Coulter 1992");
    field("open_road.pursuit_distance", p.open_road.pursuit_distance, "m", Range{0.2, 20},
          "and at least so far", "pure pursuit, Coulter 1992");
    field("v2x.share", p.v2x.share, "-", Range{0, 1},
          "share of vehicles that carry a radio, whoever drives them; drawn by vehicle id and seed, so a "
          "higher share contains the vehicles of a lower one",
          "own choice: all");
    field("v2x.range", p.v2x.range, "m", Range{0, 2000}, "nothing arrives from farther away",
          "own choice, within what field tests of ITS-G5 show in towns");
    field("v2x.loss", p.v2x.loss, "-", Range{0, 1}, "share of messages lost whatever the distance",
          "own choice: none");
    field("v2x.fading_range", p.v2x.fading_range, "m", Range{1, 5000},
          "distance at which the mean power is what a receiver needs: there 42 % arrive, at half of it 96 %",
          "Killat, Hartenstein 2009, Nakagami m = 3; the distance: own choice");
    field("v2x.latency_min", p.v2x.latency_min, "s", Range{0, 10}, "least time until a message is known",
          "own choice");
    field("v2x.latency_mean", p.v2x.latency_mean, "s", Range{0, 10},
          "mean time, but for the cut: the excess over the least is exponential", "own choice");
    field("v2x.latency_max", p.v2x.latency_max, "s", Range{0, 10}, "the longest time", "own choice");
    field("v2x.position_noise", p.v2x.position_noise, "m", Range{0, 100},
          "standard deviation of a sender's own position, in x and in y, cut off at four",
          "own choice, satellite positioning with correction data");
    field("v2x.carrier_sense_range", p.v2x.carrier_sense_range, "m", Range{1, 5000},
          "senders within it keep the channel busy", "own choice: 1.5 times the range");
    field("v2x.message_bytes", p.v2x.message_bytes, "B", Range{1, 2304}, "size of a CAM on the air",
          "C2C-CC, Survey on ITS-G5 CAM statistics, 2018: mean 350");
    field("v2x.bitrate", p.v2x.bitrate, "bit/s", Range{3e6, 27e6}, "of the channel",
          "ETSI TS 102 687: 6 Mbit/s by default");
    field("v2x.memory", p.v2x.memory, "s", Range{0.1, 60}, "older messages are forgotten", "own choice");
    field("v2x.cam_min_interval", p.v2x.cam_min_interval, "s", Range{0.01, 10},
          "T_GenCamMin: no two CAMs of a vehicle are nearer", "ETSI EN 302 637-2, 6.1.3");
    field("v2x.cam_max_interval", p.v2x.cam_max_interval, "s", Range{0.01, 10},
          "T_GenCamMax: a vehicle in which nothing changes sends so often", "ETSI EN 302 637-2, 6.1.3");
    field("v2x.cam_heading", p.v2x.cam_heading, "rad", Range{0, 6.3},
          "change of heading since the last CAM that triggers one", "ETSI EN 302 637-2, 6.1.3: 4 deg");
    field("v2x.cam_position", p.v2x.cam_position, "m", Range{0, 1000}, "likewise of position",
          "ETSI EN 302 637-2, 6.1.3");
    field("v2x.cam_speed", p.v2x.cam_speed, "m/s", Range{0, 100}, "likewise of speed",
          "ETSI EN 302 637-2, 6.1.3");
    field("v2x.cruise", p.v2x.cruise, "-", Range{0, 1},
          "1: dwa follows by cooperative adaptive cruise where the leader's messages are fresh", "[C]");
    field("v2x.cruise_gap", p.v2x.cruise_gap, "s", Range{0.3, 5},
          "time gap within a platoon, besides the standstill gap",
          "shortest setting of Milanes, Shladover et al. 2014");
    field("v2x.cruise_kp", p.v2x.cruise_kp, "1/s^2", Range{0, 5}, "gain on the spacing error",
          "Ploeg, van de Wouw, Nijmeijer 2014");
    field("v2x.cruise_kd", p.v2x.cruise_kd, "1/s", Range{0, 5}, "gain on its rate",
          "Ploeg, van de Wouw, Nijmeijer 2014");
    field("v2x.cruise_max_age", p.v2x.cruise_max_age, "s", Range{0.05, 5},
          "a leader whose last message is older is followed as by a driver", "own choice");
    field("v2x.cruise_reaction", p.v2x.cruise_reaction, "s", Range{0.1, 2},
          "time until the brakes answer what the leader tells: a message's age, a step, the powertrain's lag",
          "sum of the defaults");
    field("rules.gap_time", p.rules.gap_time, "s", Range{0.1, 10},
          "rules = agent: who gives way goes first only if the other arrives this long after it is gone",
          "SUMO's look-ahead at links: 1 s");
    field("rules.patience", p.rules.patience, "s", Range{1, 1000},
          "rules = agent: waiting after which an agent accepts the smallest gap that is safe",
          "own choice; SUMO's time-to-impatience is 180 s");
  }
};

}  // namespace lanewise
