-- The views below serve SQL, pandas and R: ids instead of numbers, units in the names, an undefined value is NULL. New files hold
-- them; Lanewise's own commands define them anew for older files, without writing.

-- One row a run with every measure `lanewise compare` knows; rates are over all that was driven, means named so over
-- arrived vehicles only.
CREATE VIEW v_run_metrics (
  run_id,
  scenario,
  policy,                   -- As asked for; what drove in fact: agent_share.
  seed,
  status,
  agent_share,              -- Share of vehicles under an agent policy, 0 to 1.
  over_budget,              -- Mid-block commands SUMO did not carry out exactly; the budget is 0.
  inserted,
  arrived,
  still_running,
  not_inserted,
  teleported,
  distance_km,
  driving_time_h,
  time_loss_s,              -- Mean over arrived vehicles.
  travel_time_s,            -- Mean over arrived vehicles.
  waiting_time_s,           -- Mean over arrived vehicles.
  delay_s,                  -- Time loss and departure delay per vehicle, arrived or still driving.
  depart_delay_s,           -- Mean over all that entered.
  mean_speed_mps,           -- Distance by time, all vehicles.
  speed_variance_m2ps2,     -- Of each vehicle's speed over its trip, planned stops excluded; mean over driving time.
  stops_per_km,
  contacts_per_1000km,      -- Outside junctions. NULL, as below, where run.safety says it was not watched.
  junction_contacts_per_1000km,
  agent_strikes_per_1000km, -- An agent struck something outside junctions.
  near_misses_per_1000km,
  encounters_per_1000km,
  serious_encounters_per_1000km,
  ttc_exposed_s_per_h,      -- Time with a TTC below the encounter threshold (TET), per hour driven.
  hard_braking_per_100km,
  jerk_mps3,                -- Root mean square over all steps driven.
  max_lateral_accel_mps2,   -- Mean of the trips' largest values.
  co2_g_per_km,
  nox_g_per_km,
  pmx_g_per_km,
  fuel_g_per_km,
  electricity_wh_per_km,
  v2x_sent_hz,              -- Messages a second and station; here and below NULL without V2X.
  v2x_delivered_share,      -- Of messages at receivers in range.
  v2x_age_s,                -- Mean age of information.
  v2x_busy_ratio,           -- Mean channel busy ratio.
  cruise_share,             -- Of the agents' driving time: following by cooperative cruise.
  advised,                  -- Approaches to a signal with green-light advice.
  advice_followed,          -- Share of them without a stop.
  signal_changes,           -- Cycles that differed from their program, in split or offset.
  reroutes,
  holds,
  red_lights_run,           -- By vehicles that could have stopped.
  junctions_blocked,        -- Vehicles that stood for 10 s in a junction where they may not.
  standstills,              -- Vehicles that stood for 300 s.
  forced_entries,           -- Agents that broke a circle of vehicles waiting for each other.
  stops_per_h,              -- Here and below: per hour driven by all vehicles together.
  contacts_per_1000h,
  junction_contacts_per_1000h,
  near_misses_per_h,
  encounters_per_h,
  serious_encounters_per_h,
  hard_braking_per_h,
  co2_g_per_h,
  nox_g_per_h,
  pmx_g_per_h,
  fuel_g_per_h,
  electricity_wh_per_h
) AS
SELECT run.run_id, run.scenario, run.policy, run.seed, run.status,
       shares.agent_share, COALESCE(mid_block.count, 0),
       run.inserted, COALESCE(t.arrived, 0), run.still_running, run.not_inserted, run.teleported,
       t.km, t.hours,
       t.time_loss_s, t.travel_time_s, t.waiting_time_s,
       t.delay_s, t.depart_delay_s,
       1e3 * t.km / t.some_h / 3600.0, t.speed_variance_m2ps2, t.stops / t.some_km,
       CASE WHEN run.safety <> 'off' THEN 1e3 * COALESCE(c.outside, 0) / t.some_km END,
       CASE WHEN run.safety <> 'off' THEN 1e3 * COALESCE(c.inside, 0) / t.some_km END,
       CASE WHEN run.safety <> 'off' THEN 1e3 * COALESCE(c.strikes, 0) / t.some_km END,
       CASE WHEN run.safety = 'full' THEN 1e3 * COALESCE(e.near_misses, 0) / t.some_km END,
       CASE WHEN run.safety = 'full' THEN 1e3 * COALESCE(e.encounters, 0) / t.some_km END,
       CASE WHEN run.safety = 'full' THEN 1e3 * COALESCE(e.serious, 0) / t.some_km END,
       CASE WHEN run.safety = 'full' THEN t.ttc_exposed_s / t.some_h END,
       1e2 * t.hard_braking / t.some_km, t.jerk_mps3, t.max_lateral_accel_mps2,
       t.co2_g / t.some_km, t.nox_g / t.some_km, t.pmx_g / t.some_km, t.fuel_g / t.some_km, t.electricity_wh / t.some_km,
       v.sent / v.station_time_s, v.delivered * 1.0 / v.heard, v.age_s, v.busy_ratio, v.cruise_time_s / NULLIF(run.agent_steps * run.step_length_s, 0.0),
       COALESCE(k.advised, 0), k.followed * 1.0 / NULLIF(k.advised, 0), COALESCE(k.signal_changes, 0),
       COALESCE(k.reroutes, 0), COALESCE(k.holds, 0),
       COALESCE(r.red_lights, 0), COALESCE(r.blocked, 0), COALESCE(r.standstills, 0), COALESCE(r.forced, 0),
       t.stops / t.some_h,
       CASE WHEN run.safety <> 'off' THEN 1e3 * COALESCE(c.outside, 0) / t.some_h END,
       CASE WHEN run.safety <> 'off' THEN 1e3 * COALESCE(c.inside, 0) / t.some_h END,
       CASE WHEN run.safety = 'full' THEN COALESCE(e.near_misses, 0) / t.some_h END,
       CASE WHEN run.safety = 'full' THEN COALESCE(e.encounters, 0) / t.some_h END,
       CASE WHEN run.safety = 'full' THEN COALESCE(e.serious, 0) / t.some_h END,
       t.hard_braking / t.some_h,
       t.co2_g / t.some_h, t.nox_g / t.some_h, t.pmx_g / t.some_h, t.fuel_g / t.some_h, t.electricity_wh / t.some_h
FROM run
LEFT JOIN (SELECT run_id, SUM(trip_end = 'arrived') AS arrived,
                  SUM(route_length_m) / 1e3 AS km, NULLIF(SUM(route_length_m) / 1e3, 0.0) AS some_km,
                  SUM(duration_s) / 3600.0 AS hours, NULLIF(SUM(duration_s) / 3600.0, 0.0) AS some_h,
                  AVG(CASE WHEN trip_end = 'arrived' THEN time_loss_s END) AS time_loss_s,
                  AVG(CASE WHEN trip_end = 'arrived' THEN duration_s END) AS travel_time_s,
                  AVG(CASE WHEN trip_end = 'arrived' THEN waiting_time_s END) AS waiting_time_s,
                  AVG(time_loss_s + depart_delay_s) AS delay_s, AVG(depart_delay_s) AS depart_delay_s,
                  SUM(waiting_count) AS stops, SUM(hard_braking_count) AS hard_braking,
                  SQRT(SUM(rms_jerk_mps3 * rms_jerk_mps3 * steps)
                       / NULLIF(SUM(CASE WHEN rms_jerk_mps3 IS NOT NULL THEN steps END), 0)) AS jerk_mps3,
                  SUM(speed_variance_m2ps2 * steps)
                  / NULLIF(SUM(CASE WHEN speed_variance_m2ps2 IS NOT NULL THEN steps END), 0) AS speed_variance_m2ps2,
                  AVG(max_lateral_accel_mps2) AS max_lateral_accel_mps2,
                  SUM(ttc_exposed_s) AS ttc_exposed_s,
                  SUM(co2_mg) / 1e3 AS co2_g, SUM(nox_mg) / 1e3 AS nox_g, SUM(pmx_mg) / 1e3 AS pmx_g,
                  SUM(fuel_mg) / 1e3 AS fuel_g, SUM(electricity_wh) AS electricity_wh
           FROM trip GROUP BY run_id) AS t ON t.run_id = run.run_id
LEFT JOIN (SELECT run_id, SUM(NOT in_junction) AS outside, SUM(in_junction) AS inside,
                  SUM(striking_agent AND NOT in_junction) AS strikes
           FROM collision GROUP BY run_id) AS c ON c.run_id = run.run_id
LEFT JOIN (SELECT run_id, COUNT(*) AS encounters, SUM(near_miss) AS near_misses, SUM(severity >= 2) AS serious
           FROM encounter GROUP BY run_id) AS e ON e.run_id = run.run_id
LEFT JOIN (SELECT run_id, SUM(kind IN ('advice_followed', 'advice_missed')) AS advised,
                  SUM(kind = 'advice_followed') AS followed, SUM(kind = 'reroute') AS reroutes, SUM(kind = 'hold') AS holds,
                  COUNT(DISTINCT CASE WHEN kind IN ('signal_plan', 'signal_offset') THEN signal || time_s END)
                    AS signal_changes
           FROM coordination_event GROUP BY run_id) AS k ON k.run_id = run.run_id
LEFT JOIN (SELECT run_id, SUM(kind = 'red_light') AS red_lights, SUM(kind = 'junction_blocked') AS blocked,
                  SUM(kind = 'standstill') AS standstills, SUM(kind = 'forced_entry') AS forced
           FROM rule_event GROUP BY run_id) AS r ON r.run_id = run.run_id
LEFT JOIN (SELECT run_id, SUM(CASE WHEN policy <> 'sumo' THEN vehicles ELSE 0 END) * 1.0
                  / NULLIF(SUM(vehicles), 0) AS agent_share
           FROM policy_share GROUP BY run_id) AS shares ON shares.run_id = run.run_id
LEFT JOIN (SELECT run_id, NULLIF(SUM(station_time_s), 0.0) AS station_time_s, SUM(sent) AS sent,
                  SUM(delivered) AS delivered, NULLIF(SUM(delivered + dropped + faded + collided), 0) AS heard,
                  SUM(pair_time_s * mean_age_s) / NULLIF(SUM(pair_time_s), 0.0) AS age_s,
                  SUM(station_time_s * mean_busy_ratio)
                  / NULLIF(SUM(CASE WHEN mean_busy_ratio IS NOT NULL THEN station_time_s END), 0.0) AS busy_ratio,
                  SUM(cruise_time_s) AS cruise_time_s
           FROM v2x_interval GROUP BY run_id) AS v ON v.run_id = run.run_id
LEFT JOIN audit AS mid_block ON mid_block.run_id = run.run_id AND mid_block.cause = 'mid_block'
ORDER BY run.run_id;

-- Trips with the ids of their vehicles.
CREATE VIEW v_trip (
  run_id, scenario, run_policy, seed,
  vehicle_id, type, vclass,
  policy,                   -- Who drove this vehicle.
  trip_end, depart_s, arrival_s, duration_s, depart_delay_s, route_length_m, waiting_time_s, waiting_count, stop_time_s,
  time_loss_s, max_accel_mps2, max_decel_mps2, rms_jerk_mps3, max_lateral_accel_mps2, hard_braking_count, min_ttc_s,
  max_drac_mps2, co2_mg, nox_mg, pmx_mg, fuel_mg, electricity_wh
) AS
SELECT t.run_id, run.scenario, run.policy, run.seed, v.vehicle_id, v.type, v.vclass, v.policy, t.trip_end, t.depart_s,
       t.arrival_s, t.duration_s, t.depart_delay_s, t.route_length_m, t.waiting_time_s, t.waiting_count, t.stop_time_s,
       t.time_loss_s, t.max_accel_mps2, t.max_decel_mps2, t.rms_jerk_mps3, t.max_lateral_accel_mps2,
       t.hard_braking_count, t.min_ttc_s, t.max_drac_mps2, t.co2_mg, t.nox_mg, t.pmx_mg, t.fuel_mg, t.electricity_wh
FROM trip AS t JOIN vehicle AS v USING (run_id, vehicle_number) JOIN run USING (run_id);

-- Sampled states with ids. Name the run by a literal and the vehicle too, or SQLite reads the whole table.
CREATE VIEW v_trajectory (
  run_id, time_s, vehicle_id, vclass, policy, x_m, y_m,
  heading_rad,              -- Counter-clockwise from east.
  angle_deg,                -- SUMO's: clockwise from north.
  speed_mps, accel_mps2, lane_id, lane_pos_m, lateral_offset_m
) AS
SELECT t.run_id, t.time_s, v.vehicle_id, v.vclass, v.policy, t.x_m, t.y_m, t.heading_rad,
       (CASE WHEN t.heading_rad > 1.5707963267948966 THEN 450.0 ELSE 90.0 END) - 57.29577951308232 * t.heading_rad,
       t.speed_mps, t.accel_mps2, l.lane_id, t.lane_pos_m, t.lateral_offset_m
FROM trajectory AS t JOIN vehicle AS v USING (run_id, vehicle_number)
LEFT JOIN lane AS l ON l.run_id = t.run_id AND l.lane = t.lane;

-- Contacts with ids.
CREATE VIEW v_collision (
  run_id, scenario, policy, seed, begin_s, end_s, first_id, second_id,
  striking_id,              -- NULL: both stood.
  striking_agent, in_junction, lane_id, x_m, y_m, first_speed_mps, second_speed_mps, closing_speed_mps, max_depth_m
) AS
SELECT c.run_id, run.scenario, run.policy, run.seed, c.begin_s, c.end_s, a.vehicle_id, b.vehicle_id, s.vehicle_id,
       c.striking_agent, c.in_junction, l.lane_id, c.x_m, c.y_m, c.first_speed_mps, c.second_speed_mps,
       c.closing_speed_mps, c.max_depth_m
FROM collision AS c JOIN run USING (run_id)
JOIN vehicle AS a ON a.run_id = c.run_id AND a.vehicle_number = c.first_vehicle
JOIN vehicle AS b ON b.run_id = c.run_id AND b.vehicle_number = c.second_vehicle
LEFT JOIN vehicle AS s ON s.run_id = c.run_id AND s.vehicle_number = c.striking_vehicle
LEFT JOIN lane AS l ON l.run_id = c.run_id AND l.lane = c.first_lane;

-- Encounters with ids, seen by ego: who follows or comes second.
CREATE VIEW v_encounter (
  run_id, scenario, policy, seed, encounter, ego_id, foe_id, ego_policy, foe_policy, type, type_code, severity, begin_s,
  end_s, critical_s, x_m, y_m, in_junction, min_ttc_s, max_drac_mps2, min_mttc_s, pet_s, min_distance_m,
  max_closing_speed_mps, contact, near_miss
) AS
SELECT e.run_id, run.scenario, run.policy, run.seed, e.encounter, a.vehicle_id, b.vehicle_id, a.policy, b.policy, e.type,
       e.type_code, e.severity, e.begin_s, e.end_s, e.critical_s, e.x_m, e.y_m, e.in_junction, e.min_ttc_s,
       e.max_drac_mps2, e.min_mttc_s, e.pet_s, e.min_distance_m, e.max_closing_speed_mps, e.contact, e.near_miss
FROM encounter AS e JOIN run USING (run_id)
JOIN vehicle AS a ON a.run_id = e.run_id AND a.vehicle_number = e.ego_vehicle
JOIN vehicle AS b ON b.run_id = e.run_id AND b.vehicle_number = e.foe_vehicle;

-- Edges over intervals with ids; flow, density and speed by Edie's definitions.
CREATE VIEW v_edge_interval (
  run_id, scenario, policy, seed, begin_s, end_s, edge_id, lanes, length_m, in_junction, flow_veh_per_h,
  density_veh_per_km, speed_mps, waiting_time_s, time_loss_s, entered, co2_mg
) AS
SELECT i.run_id, run.scenario, run.policy, run.seed, i.begin_s, i.end_s, e.edge_id, e.lanes, e.length_m, e.in_junction,
       i.flow_veh_per_h, i.density_veh_per_km, i.speed_mps, i.waiting_time_s, i.time_loss_s, i.entered, i.co2_mg
FROM edge_interval AS i JOIN run USING (run_id) JOIN edge AS e USING (run_id, edge);
