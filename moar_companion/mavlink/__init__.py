"""MAVLink: bytes in, `Telemetry` and events out; setpoints, answers and texts in, bytes out.

`session.Session` is a machine without I/O: it decodes (`peers`, `codec`), and passes each message
to `telemetry_receiver`, `autopilot_requests`, `autopilot_control`, `received_commands`, or to the
services for ground stations (`component`). All of them send by `outbox`; `link` holds the sockets.
What differs between autopilots: `autopilots`.
Read first: `session`, `telemetry`, `autopilots.profile`.
"""
