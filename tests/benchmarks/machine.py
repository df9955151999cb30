"""What the machine without I/O costs: `.venv/bin/python -m tests.benchmarks.machine`.

Updates of the risk indices, telemetry through `Session.receive`, and a whole inspection in
lockstep with the fake autopilot, whose share is in the figure. The telemetry is a recording of PX4
where there is one beside the checkout, and otherwise what the companion heard in that inspection.
"""

from __future__ import annotations

import os
import statistics
import sys
import time
from collections.abc import Callable

from moar_companion.config import LinkRole
from moar_companion.mavlink.session import Session
from moar_companion.risk import update
from tests.flights.lockstep import INSPECTION, Lockstep
from tests.mavlink.conftest import SHARED, packets
from tests.risk.conftest import Flight

RECORDING = SHARED / "traces" / "px4" / "b1_battery_drain.companion.tlog"
UPDATES, REPEATS, FLIGHTS = 200, 20, 3

Stream = list[tuple[float, bytes]]


def fly() -> tuple[float, Stream]:
    """An inspection of all targets: simulated seconds per second, and what was heard in it."""
    flight = Lockstep()
    began = time.perf_counter()
    flight.begin(INSPECTION)
    flight.run_until_state("holding", 300.0)
    speed = flight.now_s / (time.perf_counter() - began)
    return speed, [(time_s, data) for kind, time_s, data in flight.inputs if kind == "bytes"]


def risk_update_us() -> Callable[[], float]:
    """Mean time of an update in a healthy flight that has settled."""
    flight = Flight.healthy()
    flight.fly(60.0)

    def measure() -> float:
        began = time.perf_counter()
        for _ in range(UPDATES):
            update(
                flight.estimate, flight.telemetry, flight.now_s, model=flight.model, cruise_mps=5.0
            )
        return 1e6 * (time.perf_counter() - began) / UPDATES

    return measure


def messages_per_second(stream: Stream) -> Callable[[], float]:
    """How many messages a session takes in a second, each as it came."""
    count = 0
    counting = Session(links={"serial": LinkRole.AUTOPILOT})
    for time_s, data in stream:
        counting.receive("serial", data, time_s)
        count += len(counting.packets_heard())

    def measure() -> float:
        session = Session(links={"serial": LinkRole.AUTOPILOT})
        began = time.perf_counter()
        for time_s, data in stream:
            session.receive("serial", data, time_s)
        return count / (time.perf_counter() - began)

    return measure


def _row(what: str, unit: str, values: list[float]) -> str:
    spread = f"{min(values):.0f} to {max(values):.0f}"
    return f"| {what} | {statistics.median(values):.0f} | {spread} | {unit} |"


def main() -> None:
    flights = [fly() for _ in range(FLIGHTS)]
    recorded = RECORDING.exists()
    stream = list(packets(RECORDING)) if recorded else flights[0][1]
    source = "recorded" if recorded else "generated"
    risk, messages = risk_update_us(), messages_per_second(stream)
    rows = [
        _row("update of the risk indices", "µs", [risk() for _ in range(REPEATS)]),
        _row(f"messages through a session, {source}", "1/s", [messages() for _ in range(REPEATS)]),
        _row("inspection in lockstep", "s/s", [speed for speed, _ in flights]),
    ]
    sys.stdout.write(f"load average {os.getloadavg()[0]:.2f}, {os.cpu_count()} cores\n\n")
    sys.stdout.write("| what | median | range | |\n|---|---|---|---|\n")
    sys.stdout.write("\n".join(rows) + "\n")


if __name__ == "__main__":
    main()
