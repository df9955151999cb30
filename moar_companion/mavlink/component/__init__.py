"""Services of component 195 for ground stations: requests in, answers out. No I/O.

`services.ComponentServices` is the session's one hook. It takes the messages that a service reads,
and returns what each link has room for, so that setpoints, heartbeats and answers to orders never
wait behind a list or a file. A service has the methods of `component_service.ComponentService`, or
of `PacedService` if it answers with lists or files.
Read first: `component_service`, `services`, then any service.
"""
