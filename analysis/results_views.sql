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
  electricity_wh_per_km
) AS
SELECT run.run_id, run.scenario, run.policy, run.seed, run.status,
       shares.agent_share, COALESCE(mid_block.count, 0),
       run.inserted, COALESCE(t.arrived, 0), run.still_running, run.not_inserted, run.teleported,
       t.km, t.hours,
       t.time_loss_s, t.travel_time_s, t.waiting_time_s,
       t.delay_s, t.depart_delay_s,
       1e3 * t.km / NULLIF(3600.0 * t.hours, 0.0), t.stops / t.some_km,
       CASE WHEN run.safety <> 'off' THEN 1e3 * COALESCE(c.outside, 0) / t.some_km END,
       CASE WHEN run.safety <> 'off' THEN 1e3 * COALESCE(c.inside, 0) / t.some_km END,
       CASE WHEN run.safety <> 'off' THEN 1e3 * COALESCE(c.strikes, 0) / t.some_km END,
       CASE WHEN run.safety = 'full' THEN 1e3 * COALESCE(e.near_misses, 0) / t.some_km END,
       CASE WHEN run.safety = 'full' THEN 1e3 * COALESCE(e.encounters, 0) / t.some_km END,
       CASE WHEN run.safety = 'full' THEN 1e3 * COALESCE(e.serious, 0) / t.some_km END,
       CASE WHEN run.safety = 'full' THEN t.ttc_exposed_s / NULLIF(t.hours, 0.0) END,
       1e2 * t.hard_braking / t.some_km, t.jerk_mps3, t.max_lateral_accel_mps2,
       t.co2_g / t.some_km, t.nox_g / t.some_km, t.pmx_g / t.some_km, t.fuel_g / t.some_km, t.electricity_wh / t.some_km
FROM run
LEFT JOIN (SELECT run_id, SUM(trip_end = 'arrived') AS arrived,
                  SUM(route_length_m) / 1e3 AS km, NULLIF(SUM(route_length_m) / 1e3, 0.0) AS some_km,
                  SUM(duration_s) / 3600.0 AS hours,
                  AVG(CASE WHEN trip_end = 'arrived' THEN time_loss_s END) AS time_loss_s,
                  AVG(CASE WHEN trip_end = 'arrived' THEN duration_s END) AS travel_time_s,
                  AVG(CASE WHEN trip_end = 'arrived' THEN waiting_time_s END) AS waiting_time_s,
                  AVG(time_loss_s + depart_delay_s) AS delay_s, AVG(depart_delay_s) AS depart_delay_s,
                  SUM(waiting_count) AS stops, SUM(hard_braking_count) AS hard_braking,
                  SQRT(SUM(rms_jerk_mps3 * rms_jerk_mps3 * steps)
                       / NULLIF(SUM(CASE WHEN rms_jerk_mps3 IS NOT NULL THEN steps END), 0)) AS jerk_mps3,
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
LEFT JOIN (SELECT run_id, SUM(CASE WHEN policy <> 'sumo' THEN vehicles ELSE 0 END) * 1.0
                  / NULLIF(SUM(vehicles), 0) AS agent_share
           FROM policy_share GROUP BY run_id) AS shares ON shares.run_id = run.run_id
LEFT JOIN audit AS mid_block ON mid_block.run_id = run.run_id AND mid_block.cause = 'mid_block'
ORDER BY run.run_id;
