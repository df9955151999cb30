"""The page of the aircraft for browsers, in a process of its own.

In: statuses and the site from the service (`page_channel`), requests of browsers. Out: HTTP, frames
of a WebSocket, orders for the service. Read first: `page_server` (the addresses, and what each
answers). Without I/O: `live_state` (statuses to frames), `request_checks`. The page itself, without
a build step and without anything from outside, is in `static/`.

What needs the planner or a recording's reader (what-if, playback) is handed in by `commands`.
"""
