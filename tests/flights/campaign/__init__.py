"""Random flights with faults, each from one seed, judged by the truth.

    python -m tests.flights.campaign --seeds 1:101 --workers 2 --out DIR
    moar-companion evaluate campaign --seeds 1:101 --out DIR

`command` describes the files of DIR, and how a run is continued; `kinds` has the faults. Three of
four flights begin beside an aircraft in the air, and end after a landing; the others are whole.

The promise, which no flight may break. At an instant a flight is within it when all of these have
held for the last `AFTERMATH_S` seconds:

- Position: the estimate is off by at most k times R, with k = `ERROR_FACTOR` = 1. R is the greater
  of the margin's position error (1.4 m of PX4, 0.5 m of ArduPilot) and the accuracy that the
  autopilot reports (PX4: ESTIMATOR_STATUS, level and height; ArduPilot: the receiver's h_acc).
  k is 1 because plans and the gate keep exactly R free. A greater k would promise room that they
  do not keep; a smaller one would leave kept room unjudged. The greatest distance of an obstacle
  from its place in the companion's site file is added to the error of the estimate, also where a
  lidar sees the obstacle.
- Wind: at most what the aircraft holds, 0.8 times the wind at its greatest lean, and at most the
  supervisor's limit of 15 m/s; and the air's velocity changes by at most `GUST_MPS` within
  `GUST_S`. A harder gust moves the aircraft by more than the tracking margin before any setpoint
  can answer.
- Aircraft: drag, motors and the autopilot's response to setpoints are as configured, by its
  parameters. Its heading is right to 8 degrees. The aircraft is not disarmed, and its autopilot
  does not restart in the air.
- Words: a packet with the autopilot's ids was sent by the autopilot, recently, and its local frame
  keeps its origin. Unsigned MAVLink does not identify another sender. On a signed link this part
  holds unless the autopilot itself moves its origin.

A lidar that errs is within the promise while the site file is right: what it sees adds obstacles.

Judged on the truth, while the companion's setpoints command the aircraft, and for `LET_GO_S` after
the end of the stream while the autopilot holds. Flight by a pilot, a return or a landing is not
judged:

- collision: the hull (a ball of the vehicle's radius) touches no obstacle;
- keep_out: the hull enters no keep-out of the site file.

Judged on setpoints, while the packets are the autopilot's, in any wind and with any estimate, by
the obstacles of the companion's site file, and where a lidar shows the line in its frame:

- step: from one setpoint to the next no more than the vehicle's greatest speed (and v_MIN more
  while it moves over to its path) takes it. A reset of the estimate takes it along by as much. So
  does the aircraft when it is blown off by more than `off_path_m`: then the setpoint may come
  nearer to it at once;
- begins: a stream begins within 2 m of the aircraft, or where the last one may have come to;
- stale: the position that the companion received last was sent by the autopilot at most
  `POSITION_AGE_S` before a setpoint that moves, `REST_SETPOINT_AGE_S` before one at rest; the
  mode at most `MODE_AGE_S` before;
- outside: none is outside the workspace, below the least altitude or more than 2 m off the plane.
  A landing leg may go there, and its rest for `LEFT_LEG_S` until another plan is joined. From
  there, on escape and recovery legs, the setpoint comes nearer and never goes farther away;
- setpoint_keep_out: none is nearer to an obstacle than the radius and its keep-out. Exception: a
  stream that begins at an aircraft that is there, and does not go deeper;
- silence: when the mode is taken, the stream ends within `SILENCE_S`, or `REPORTED_S` after the
  first message that reports it, if a bad link makes that later, or when the mode is stale. No
  setpoint comes later without a new order;
- authority: nothing is armed or disarmed; without `engage` no mode is requested; no order by MQTT
  is taken that is forged, repeated, late, cut, or of another vehicle.

Outside the promise a violation is counted, with the parts of the promise that did not hold, and
the faults of the flight. Not judged, but in each row: `reached`, if the goal of the first order was
reached (a target, or the leg to a landing point), else `why`, the reason that operators were told.
"""

ERROR_FACTOR = 1.0
AFTERMATH_S = 10.0
"""A deviation is flown back at v_MIN to v_MAX, and the velocity integral of PX4 takes 10 s."""
GUST_MPS = 4.0
GUST_S = 2.0
LET_GO_S = 5.0
POSITION_AGE_S = 0.6
"""`position_timeout_s`, a packet's interval, and a cycle."""
REST_SETPOINT_AGE_S = 0.8
MODE_AGE_S = 3.3
SILENCE_S = 0.25
REPORTED_S = 0.1
LEFT_LEG_S = 3.0
"""A plan begins beyond where the reference can stop: 1 s at these speeds; and plans may be slow."""
DEVELOPMENT = range(1, 1_000_001)
"""Seeds for development."""
HELD_OUT = range(1_000_001, 2_000_001)
"""Seeds for a final measurement, not used during development."""
