"""MAVLink: bytes in, `Telemetry` and events out; setpoints, answers and texts in, bytes out.

`session.Session` is a machine without I/O over `codec`, `translate`, `commands`, `identity`,
`message_rates` and `outbox`; `link` holds the sockets.
"""
