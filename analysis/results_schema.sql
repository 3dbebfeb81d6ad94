-- The one place of Lanewise's results schema; embedded into the binary. Columns carry their units, times are
-- simulated seconds unless named otherwise, an undefined value is NULL. A change that readers notice raises
-- user_version (and kSchemaVersion in results_file.h).

PRAGMA application_id = 0x4C414E45;  -- 'LANE': marks a Lanewise results file.
PRAGMA user_version = 6;

-- One row a run: what was run, on what, and how it ended. status 'running' with no process behind it: killed.
CREATE TABLE run (
  run_id INTEGER PRIMARY KEY,
  started_at TEXT NOT NULL,            -- UTC, ISO 8601.
  finished_at TEXT,
  status TEXT NOT NULL CHECK (status IN ('running', 'finished', 'interrupted', 'failed')),
  message TEXT,                        -- Why it was interrupted or failed.
  scenario TEXT NOT NULL,
  config_file TEXT NOT NULL,
  policy TEXT NOT NULL,                -- As asked for; what drove in fact: table policy_share.
  penetration_rate REAL NOT NULL,      -- Share of vehicles given the policy, as asked for; 1: all that may have one.
  rules TEXT NOT NULL,                 -- Who answers for signals and right of way: 'agent' or 'sumo'.
  v2x TEXT NOT NULL CHECK (v2x IN ('off', 'ideal', 'range', 'lossy', 'loaded')),  -- How much of a radio channel.
  coordination TEXT NOT NULL,          -- What the roadside units coordinate, as asked for; 'none' or names with commas.
  safety TEXT NOT NULL CHECK (safety IN ('off', 'contacts', 'full')),  -- What was watched; off: no collisions known.
  seed INTEGER NOT NULL,
  begin_s REAL NOT NULL,
  end_s REAL,                          -- As asked for; NULL: until all have arrived.
  step_length_s REAL NOT NULL,
  threads INTEGER NOT NULL,
  sumo_options TEXT NOT NULL,
  arguments_json TEXT NOT NULL,        -- Of `lanewise run`, but for parameters and threads: they repeat the run.
  parameters_json TEXT NOT NULL,
  input_hashes_json TEXT NOT NULL,     -- File to hash.
  config_text TEXT,                    -- The .sumocfg itself; NULL: run from -n and -r.
  lanewise_version TEXT NOT NULL,
  git_commit TEXT NOT NULL,
  sumo_version TEXT NOT NULL,
  compiler TEXT NOT NULL,
  machine TEXT NOT NULL,
  wall_time_s REAL,                    -- From here on NULL until the run has ended.
  sumo_time_s REAL,                    -- Wall time within SUMO.
  simulated_time_s REAL,
  steps INTEGER,
  vehicle_steps INTEGER,
  agent_steps INTEGER,
  inserted INTEGER,
  arrived INTEGER,
  teleported INTEGER,
  vaporized INTEGER,
  still_running INTEGER,
  not_inserted INTEGER,                -- Waiting for insertion at the end.
  trajectory_rows INTEGER,
  state_hash TEXT                      -- 16 hex digits; equal for every number of threads.
);

-- The running numbers' meaning: every vehicle and pedestrian that entered. Pedestrians have vclass 'pedestrian',
-- policy 'sumo' and no trip; they are in no count of vehicles.
CREATE TABLE vehicle (
  run_id INTEGER NOT NULL REFERENCES run,
  vehicle_number INTEGER NOT NULL,
  vehicle_id TEXT NOT NULL,            -- SUMO's id.
  type TEXT NOT NULL,
  vclass TEXT NOT NULL,
  policy TEXT NOT NULL,
  depart_s REAL NOT NULL,
  depart_delay_s REAL NOT NULL,
  length_m REAL NOT NULL,
  width_m REAL NOT NULL,
  PRIMARY KEY (run_id, vehicle_number)
) WITHOUT ROWID;

-- The lane numbers' meaning in other tables.
CREATE TABLE lane (
  run_id INTEGER NOT NULL REFERENCES run,
  lane INTEGER NOT NULL,
  lane_id TEXT NOT NULL,               -- SUMO's id.
  PRIMARY KEY (run_id, lane)
) WITHOUT ROWID;

-- The edge numbers' meaning in other tables.
CREATE TABLE edge (
  run_id INTEGER NOT NULL REFERENCES run,
  edge INTEGER NOT NULL,
  edge_id TEXT NOT NULL,               -- SUMO's id.
  lanes INTEGER NOT NULL,
  length_m REAL NOT NULL,              -- Of its first lane.
  in_junction INTEGER NOT NULL,
  PRIMARY KEY (run_id, edge)
) WITHOUT ROWID;

-- One row a trip, written when it ends. Sums as in SUMO's tripinfo output.
CREATE TABLE trip (
  run_id INTEGER NOT NULL REFERENCES run,
  vehicle_number INTEGER NOT NULL,
  trip_end TEXT NOT NULL,              -- arrived, vaporized, teleported; running: the run ended first.
  depart_s REAL NOT NULL,
  arrival_s REAL,
  duration_s REAL NOT NULL,
  depart_delay_s REAL NOT NULL,
  route_length_m REAL NOT NULL,
  waiting_time_s REAL NOT NULL,
  waiting_count INTEGER NOT NULL,
  stop_time_s REAL NOT NULL,
  time_loss_s REAL NOT NULL,
  max_accel_mps2 REAL,
  max_decel_mps2 REAL,                 -- A magnitude.
  max_jerk_mps3 REAL,
  rms_jerk_mps3 REAL,
  max_lateral_accel_mps2 REAL,
  hard_braking_count INTEGER NOT NULL,
  co2_mg REAL NOT NULL,
  nox_mg REAL NOT NULL,
  pmx_mg REAL NOT NULL,
  fuel_mg REAL NOT NULL,
  electricity_wh REAL NOT NULL,
  steps INTEGER NOT NULL,
  agent_steps INTEGER NOT NULL,        -- Of these, with our agent at the wheel.
  min_ttc_s REAL,                      -- NULL: never below the encounter threshold.
  max_drac_mps2 REAL,                  -- Of its TTC below the encounter threshold.
  ttc_exposed_s REAL,                  -- Time with a TTC below the threshold (TET); NULL: not watched.
  ttc_integrated_s2 REAL,              -- Integral of threshold - TTC over that time (TIT).
  speed_variance_m2ps2 REAL,           -- Over the trip's time, planned stops excluded.
  PRIMARY KEY (run_id, vehicle_number)
) WITHOUT ROWID;

-- Sampled states in order of time. A finished run N has the index trajectory_of_run_N on (vehicle_number, time_s), in
-- files of up to 64 runs; SQLite uses it for queries that name the run by a literal: WHERE run_id = 3 AND vehicle_number = ?.
CREATE TABLE trajectory (
  run_id INTEGER NOT NULL,
  time_s REAL NOT NULL,
  vehicle_number INTEGER NOT NULL,
  x_m REAL NOT NULL,                   -- Middle of the front bumper, world.
  y_m REAL NOT NULL,
  heading_rad REAL NOT NULL,           -- Counter-clockwise from east.
  speed_mps REAL NOT NULL,
  accel_mps2 REAL,
  lane INTEGER,
  lane_pos_m REAL,
  lateral_offset_m REAL                -- Left of the lane's center.
);

-- Contacts of two boxes, one row a contact; see analysis/README.md for who strikes.
CREATE TABLE collision (
  collision_id INTEGER PRIMARY KEY,
  run_id INTEGER NOT NULL REFERENCES run,
  first_vehicle INTEGER NOT NULL,      -- vehicle_number; the lower one.
  second_vehicle INTEGER NOT NULL,
  striking_vehicle INTEGER,            -- NULL: both stood.
  struck_vehicle INTEGER,
  first_agent INTEGER NOT NULL,        -- Agent-driven at first touch.
  second_agent INTEGER NOT NULL,
  striking_agent INTEGER NOT NULL,
  begin_s REAL NOT NULL,
  end_s REAL NOT NULL,
  x_m REAL NOT NULL,
  y_m REAL NOT NULL,
  first_lane INTEGER,
  second_lane INTEGER,
  in_junction INTEGER NOT NULL,
  first_speed_mps REAL NOT NULL,
  second_speed_mps REAL NOT NULL,
  closing_speed_mps REAL NOT NULL,
  max_depth_m REAL NOT NULL
);
CREATE INDEX collision_of_run ON collision (run_id);

-- Pairs that came close, one row an encounter: the time during which TTC, DRAC or PET crossed its threshold. Extreme
-- values come with their times. ego is who follows or comes second (SUMO's word), foe the other.
CREATE TABLE encounter (
  run_id INTEGER NOT NULL REFERENCES run,
  encounter INTEGER NOT NULL,          -- Running number within the run, in order of ending.
  first_vehicle INTEGER NOT NULL,      -- vehicle_number; the lower one.
  second_vehicle INTEGER NOT NULL,
  ego_vehicle INTEGER NOT NULL,
  foe_vehicle INTEGER NOT NULL,
  type TEXT NOT NULL CHECK (type IN ('following', 'merging', 'crossing', 'side_swipe', 'straddling', 'oncoming')),
  type_code INTEGER NOT NULL,          -- SUMO's device.ssm, seen by ego; 111: they touched.
  severity INTEGER NOT NULL,           -- 1 conflict, 2 serious, 3 contact.
  first_agent INTEGER NOT NULL,        -- Agent-driven at the critical moment.
  second_agent INTEGER NOT NULL,
  begin_s REAL NOT NULL,
  end_s REAL NOT NULL,
  critical_s REAL NOT NULL,            -- The moment of min_ttc_s; without one of pet_s, else of max_drac_mps2.
  x_m REAL NOT NULL,                   -- Midway between both front bumpers at that moment.
  y_m REAL NOT NULL,
  first_lane INTEGER,
  second_lane INTEGER,
  in_junction INTEGER NOT NULL,
  first_speed_mps REAL NOT NULL,       -- At that moment.
  second_speed_mps REAL NOT NULL,
  min_ttc_s REAL,
  min_ttc_time_s REAL,
  max_drac_mps2 REAL,
  max_drac_time_s REAL,
  min_mttc_s REAL,
  min_mttc_time_s REAL,
  pet_s REAL,
  pet_time_s REAL,                     -- When the second one came.
  min_distance_m REAL,                 -- Between the boxes, until 2 s after end_s; 0: they touched; NULL: one had left.
  min_distance_time_s REAL,
  max_closing_speed_mps REAL,          -- Of a pair on collision course.
  max_closing_speed_time_s REAL,
  first_delta_v_mps REAL,              -- Change of velocity in a plastic impact at first touch; NULL without contact.
  second_delta_v_mps REAL,
  contact INTEGER NOT NULL,            -- They touched: also in table collision.
  near_miss INTEGER NOT NULL,          -- TTC below the near-miss threshold without contact.
  PRIMARY KEY (run_id, encounter)
) WITHOUT ROWID;

-- Event recorder: how both moved around the critical moment of an encounter.
CREATE TABLE encounter_sample (
  run_id INTEGER NOT NULL,
  encounter INTEGER NOT NULL,
  time_s REAL NOT NULL,
  first_x_m REAL NOT NULL,             -- Middle of the front bumper, world.
  first_y_m REAL NOT NULL,
  first_heading_rad REAL NOT NULL,     -- Counter-clockwise from east.
  first_speed_mps REAL NOT NULL,
  first_accel_mps2 REAL NOT NULL,
  second_x_m REAL NOT NULL,
  second_y_m REAL NOT NULL,
  second_heading_rad REAL NOT NULL,
  second_speed_mps REAL NOT NULL,
  second_accel_mps2 REAL NOT NULL,
  ttc_s REAL,                          -- Of this moment; NULL: not below the threshold.
  drac_mps2 REAL,
  type_code INTEGER NOT NULL,          -- SUMO's, seen by the encounter's ego; 0: beyond no threshold.
  PRIMARY KEY (run_id, encounter, time_s)
) WITHOUT ROWID;

-- Edges over intervals of time, by Edie's definitions: flow = distance / (length * time), density = time / (length *
-- time), speed = flow / density. Only edges that were driven on in the interval; lanes together.
CREATE TABLE edge_interval (
  run_id INTEGER NOT NULL REFERENCES run,
  begin_s REAL NOT NULL,
  end_s REAL NOT NULL,
  edge INTEGER NOT NULL,
  vehicle_time_s REAL NOT NULL,        -- Spent on the edge by all vehicles together.
  vehicle_distance_m REAL NOT NULL,    -- Driven on it by all together.
  flow_veh_per_h REAL NOT NULL,
  density_veh_per_km REAL NOT NULL,
  speed_mps REAL NOT NULL,             -- Space mean.
  speed_variance_m2ps2 REAL NOT NULL,  -- Over vehicle time.
  waiting_time_s REAL NOT NULL,        -- Of vehicle_time_s slower than 0.1 m/s, planned stops excluded.
  time_loss_s REAL NOT NULL,
  entered INTEGER NOT NULL,            -- Vehicles that drove in or were inserted.
  co2_mg REAL NOT NULL,
  nox_mg REAL NOT NULL,
  pmx_mg REAL NOT NULL,
  fuel_mg REAL NOT NULL,
  electricity_wh REAL NOT NULL,
  PRIMARY KEY (run_id, begin_s, edge)
) WITHOUT ROWID;

-- Distributions over the driving time of a policy's vehicles. The outermost bins are open: their bound is NULL.
CREATE TABLE histogram (
  run_id INTEGER NOT NULL REFERENCES run,
  policy TEXT NOT NULL,
  measure TEXT NOT NULL CHECK (measure IN ('jerk_mps3', 'lateral_accel_mps2', 'accel_mps2')),
  bin INTEGER NOT NULL,                -- In ascending order.
  lower REAL,
  upper REAL,
  vehicle_time_s REAL NOT NULL,
  PRIMARY KEY (run_id, policy, measure, bin)
) WITHOUT ROWID;

-- The whole network once a simulated second.
CREATE TABLE step_summary (
  run_id INTEGER NOT NULL REFERENCES run,
  time_s REAL NOT NULL,
  running INTEGER NOT NULL,
  halting INTEGER NOT NULL,
  waiting_to_insert INTEGER NOT NULL,
  arrived INTEGER NOT NULL,            -- Since the begin.
  agent_driven INTEGER NOT NULL,
  mean_speed_mps REAL,                 -- NULL: no vehicle.
  wall_time_s REAL,
  PRIMARY KEY (run_id, time_s)
) WITHOUT ROWID;

-- Signatures of the state after each step, for `lanewise verify`. 64 bits each, stored as SQLite's signed integers.
CREATE TABLE step_hash (
  run_id INTEGER NOT NULL REFERENCES run,
  step INTEGER NOT NULL,               -- From 0.
  rolling_hash INTEGER NOT NULL,       -- Of this step and all before it; the last one is run.state_hash.
  vehicle_sum INTEGER NOT NULL,        -- Sum over vehicles of the hash of each one's state, modulo 2^64.
  weighted_sum INTEGER NOT NULL,       -- The same, each hash times vehicle_number + 1: tells which single one differs.
  PRIMARY KEY (run_id, step)
) WITHOUT ROWID;

-- What went over the radio, in intervals of 60 s. A message counts once per receiver in range: delivered, or lost by
-- the first of its causes.
CREATE TABLE v2x_interval (
  run_id INTEGER NOT NULL REFERENCES run,
  begin_s REAL NOT NULL,
  end_s REAL NOT NULL,
  station_time_s REAL NOT NULL,        -- Of all that carry a radio together.
  sent INTEGER NOT NULL,
  delivered INTEGER NOT NULL,
  dropped INTEGER NOT NULL,            -- By v2x.loss.
  faded INTEGER NOT NULL,              -- Too weak over its distance.
  collided INTEGER NOT NULL,           -- With a message of a station its sender did not hear.
  pair_time_s REAL NOT NULL,           -- Over pairs, from one message to the next: what mean_age_s is over.
  mean_age_s REAL,                     -- Age of information: of the last message known.
  mean_busy_ratio REAL,                -- Channel busy ratio, over station_time_s; NULL: v2x is not 'loaded'.
  max_busy_ratio REAL,                 -- Of any station in any step.
  cruise_time_s REAL NOT NULL,         -- Of vehicles that followed by cooperative cruise.
  platoon_joins INTEGER NOT NULL,
  platoon_leaves INTEGER NOT NULL,
  PRIMARY KEY (run_id, begin_s)
) WITHOUT ROWID;

-- Age of information: how long pairs of stations knew nothing newer than this.
CREATE TABLE v2x_age (
  run_id INTEGER NOT NULL REFERENCES run,
  age_s REAL NOT NULL,
  pair_time_s REAL NOT NULL,
  PRIMARY KEY (run_id, age_s)
) WITHOUT ROWID;

-- What coordination over the roadside units did (`--coordinate`).
CREATE TABLE coordination_event (
  run_id INTEGER NOT NULL REFERENCES run,
  time_s REAL NOT NULL,
  kind TEXT NOT NULL CHECK (kind IN ('advice_followed', 'advice_missed', 'signal_plan', 'signal_offset', 'reroute', 'hold',
                                     'release')),
  vehicle_number INTEGER,              -- NULL: a signal's.
  signal TEXT,                         -- SUMO's id; NULL: no signal's.
  value REAL NOT NULL                  -- advice: least advised speed [m/s]; plan: s moved between greens, against the program;
                                       -- offset: s by which the cycle differed; reroute: s expected to be gained.
);
CREATE INDEX coordination_event_of_run ON coordination_event (run_id, kind);

-- What happened against, or for want of, the rules of the road, whoever drives. red_light: left a lane at red though it
-- could have stopped at 0.5 s of reaction and its type's decel; junction_blocked: stood for 10 s in a junction where one
-- may not; standstill: stood for 300 s; forced_entry: an agent's turn in a circle of vehicles that wait for each other.
CREATE TABLE rule_event (
  run_id INTEGER NOT NULL REFERENCES run,
  time_s REAL NOT NULL,
  kind TEXT NOT NULL CHECK (kind IN ('red_light', 'junction_blocked', 'standstill', 'forced_entry')),
  vehicle_number INTEGER NOT NULL,
  lane INTEGER                         -- red_light: the one it left; else where it stands. NULL: beside the road.
);
CREATE INDEX rule_event_of_run ON rule_event (run_id, kind);

-- Did SUMO do what the agents commanded? Differences by cause.
CREATE TABLE audit (
  run_id INTEGER NOT NULL REFERENCES run,
  cause TEXT NOT NULL,
  count INTEGER NOT NULL,
  max_position_error_m REAL,
  max_speed_error_mps REAL,
  PRIMARY KEY (run_id, cause)
) WITHOUT ROWID;

-- Who drove in fact.
CREATE TABLE policy_share (
  run_id INTEGER NOT NULL REFERENCES run,
  policy TEXT NOT NULL,
  vehicles INTEGER NOT NULL,
  vehicle_steps INTEGER NOT NULL,
  agent_steps INTEGER NOT NULL,
  PRIMARY KEY (run_id, policy)
) WITHOUT ROWID;

-- In the file of a study (`lanewise study`): which one.
CREATE TABLE study (
  name TEXT PRIMARY KEY,
  question TEXT NOT NULL,
  study_text TEXT NOT NULL,            -- The TOML file, as it was last used.
  extra_seeds INTEGER NOT NULL DEFAULT 0  -- Added to its seeds by --until-ci.
) WITHOUT ROWID;

-- Every run a study wants; run_id is that of table run once it has finished. A run is claimed before it starts, and
-- its rows arrive in the transaction that marks it finished.
CREATE TABLE study_run (
  run_id INTEGER PRIMARY KEY,
  run_key TEXT NOT NULL UNIQUE,        -- Of its settings; 16 hex digits.
  settings_json TEXT NOT NULL,         -- Options of `lanewise run`, name to value.
  status TEXT NOT NULL CHECK (status IN ('pending', 'claimed', 'finished', 'failed')),
  attempts INTEGER NOT NULL DEFAULT 0, -- Started so often; those the runner took along when it ended do not count.
  message TEXT,                        -- Why it failed.
  log TEXT,                            -- What Lanewise and SUMO wrote then; its last 64 kB.
  claimed_by TEXT,                     -- Host and process while it runs.
  wall_time_s REAL,                    -- Of the worker process, start to end.
  bytes INTEGER                        -- Of its results.
);
CREATE INDEX study_run_by_status ON study_run (status, run_id);

-- Where merged runs came from (`lanewise merge`).
CREATE TABLE merged_run (
  run_id INTEGER PRIMARY KEY REFERENCES run,
  source_file TEXT NOT NULL,
  source_run_id INTEGER NOT NULL
);

-- One row a run for comparisons. Trip means are over arrived vehicles; distance and emissions over all. Counts of
-- what was not watched (run.safety) are NULL.
CREATE VIEW v_run_summary AS
SELECT run.run_id, run.scenario, run.policy, run.rules, run.v2x, run.coordination, run.seed, run.status, run.started_at,
       run.simulated_time_s, run.wall_time_s, run.inserted, run.still_running, run.not_inserted, run.teleported,
       run.trajectory_rows, run.state_hash,
       COALESCE(t.arrived, 0) AS arrived, t.mean_duration_s, t.mean_time_loss_s, t.mean_waiting_time_s,
       t.mean_depart_delay_s, COALESCE(t.hard_braking_count, 0) AS hard_braking_count,
       COALESCE(t.distance_km, 0.0) AS distance_km, COALESCE(t.co2_kg, 0.0) AS co2_kg,
       1e3 * t.co2_kg / NULLIF(t.distance_km, 0.0) AS co2_g_per_km,
       CASE WHEN run.safety <> 'off' THEN COALESCE(c.collisions, 0) END AS collisions,
       CASE WHEN run.safety <> 'off' THEN COALESCE(c.agent_striking_outside_junctions, 0) END
         AS agent_striking_outside_junctions,
       CASE WHEN run.safety <> 'off' THEN COALESCE(c.collisions_in_junctions, 0) END AS collisions_in_junctions,
       CASE WHEN run.safety = 'full' THEN COALESCE(e.encounters, 0) END AS encounters,
       CASE WHEN run.safety = 'full' THEN COALESCE(e.near_misses, 0) END AS near_misses, e.min_ttc_s,
       COALESCE(r.red_lights_run, 0) AS red_lights_run, COALESCE(r.standstills, 0) AS standstills
FROM run
LEFT JOIN (SELECT run_id, SUM(trip_end = 'arrived') AS arrived,
                  AVG(CASE WHEN trip_end = 'arrived' THEN duration_s END) AS mean_duration_s,
                  AVG(CASE WHEN trip_end = 'arrived' THEN time_loss_s END) AS mean_time_loss_s,
                  AVG(CASE WHEN trip_end = 'arrived' THEN waiting_time_s END) AS mean_waiting_time_s,
                  AVG(CASE WHEN trip_end = 'arrived' THEN depart_delay_s END) AS mean_depart_delay_s,
                  SUM(hard_braking_count) AS hard_braking_count,
                  SUM(route_length_m) / 1e3 AS distance_km, SUM(co2_mg) / 1e6 AS co2_kg
           FROM trip GROUP BY run_id) AS t ON t.run_id = run.run_id
LEFT JOIN (SELECT run_id, COUNT(*) AS collisions,
                  SUM(striking_agent AND NOT in_junction) AS agent_striking_outside_junctions,
                  SUM(in_junction) AS collisions_in_junctions
           FROM collision GROUP BY run_id) AS c ON c.run_id = run.run_id
LEFT JOIN (SELECT run_id, COUNT(*) AS encounters, SUM(near_miss) AS near_misses, MIN(min_ttc_s) AS min_ttc_s
           FROM encounter GROUP BY run_id) AS e ON e.run_id = run.run_id
LEFT JOIN (SELECT run_id, SUM(kind = 'red_light') AS red_lights_run, SUM(kind = 'standstill') AS standstills
           FROM rule_event GROUP BY run_id) AS r ON r.run_id = run.run_id
ORDER BY run.run_id;
