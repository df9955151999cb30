"""The shell of the companion: the only package with sockets, threads, files and clocks.

In: datagrams and bytes of links, lidar packets, files, signals. Out: the companion's packets, its
recording, log, live status and MQTT. Read first: `app` (one loop, which runs the companion),
`planner_worker`, `optional_parts`. Without I/O: `recording`, `mqtt`.
"""
