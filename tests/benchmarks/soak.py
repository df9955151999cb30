"""Memory over a long flight in lockstep: `.venv/bin/python -m tests.benchmarks.soak [MINUTES]`.

50 Hz, with one inspection after the other on a battery that stays at 80 %. Ground stations, other
vehicles and components send 10 messages a second among those of the autopilot. Prints the anonymous
memory of the process, with the fake autopilot, every 10 simulated minutes. The growth counts after
the first 10 minutes. Another checkout: `PYTHONPATH=DIR` and this file in place of the module.
"""

from __future__ import annotations

import gc
import random
import sys
from pathlib import Path

from pymavlink.dialects.v20 import all as mavlink

from tests.flights.lockstep import Lockstep
from tests.flights.operator import INSPECTION

MINUTE_S = 60.0
REPORT_S = 600.0
FORGET_S = 5.0
STEPS_OF_CHATTER = 5
"""One message of another system in so many cycles."""


class Chatter:
    """Messages of other systems: random senders, random content."""

    def __init__(self) -> None:
        self._random = random.Random(1)
        self._codec = mavlink.MAVLink(None)

    def message(self) -> bytes:
        """A packet of a ground station, of another vehicle or of a component."""
        pick, codec = self._random, self._codec
        codec.srcSystem, codec.srcComponent = pick.randint(2, 255), pick.randint(2, 250)
        codec.seq = pick.randint(0, 255)
        messages = (
            lambda: codec.heartbeat_encode(6, 8, 0, 0, 4),
            lambda: codec.heartbeat_encode(2, 8, 81, pick.randint(0, 20), 4),
            lambda: codec.statustext_encode(6, f"text {pick.random()}".encode()),
            lambda: codec.param_value_encode(b"P%d" % pick.randint(0, 10**6), 1.0, 9, 900, 1),
            lambda: codec.ping_encode(pick.randint(0, 2**40), pick.randint(0, 255), 0, 0),
            lambda: codec.timesync_encode(0, pick.randint(0, 2**40)),
            lambda: codec.command_long_encode(1, 195, 42000, 0, *[pick.random()] * 7),
            lambda: codec.command_ack_encode(511, 0, 0, 0, 1, 195),
            lambda: codec.attitude_encode(0, *[pick.random()] * 6),
        )
        return bytes(pick.choice(messages)().pack(codec))


def forget(flight: Lockstep) -> None:
    """Memory that the rig keeps for tests, which is no part of the companion."""
    for past in (
        flight.decisions,
        flight.truths,
        flight.to_autopilot,
        flight.calls,
        flight.states,
        flight.operator.received,
    ):
        past.clear()
    del flight.setpoints[:-1]


def anonymous_mb() -> float:
    """Memory of the process that is no file's."""
    gc.collect()
    for line in Path("/proc/self/smaps_rollup").read_text().splitlines():
        if line.startswith("Anonymous:"):
            return int(line.split()[1]) / 1024
    raise OSError("/proc/self/smaps_rollup tells no anonymous memory")


def fly(minutes: float) -> list[tuple[float, float]]:
    """Simulated minutes, and MB."""
    flight, chatter = Lockstep(), Chatter()
    flight.begin(INSPECTION)
    figures: list[tuple[float, float]] = []
    report_s, forget_s, steps = REPORT_S, 0.0, 0
    while flight.now_s < minutes * MINUTE_S:
        flight.step()
        steps += 1
        if steps % STEPS_OF_CHATTER == 0:
            flight.handle(chatter.message())
        if flight.now_s >= forget_s:
            forget_s = flight.now_s + FORGET_S
            forget(flight)
            flight.autopilot.conditions.battery_percent = 80.0
            if flight.state == "holding":
                flight.operator.mission(INSPECTION)
        if flight.now_s >= report_s:
            report_s += REPORT_S
            figures.append((flight.now_s / MINUTE_S, anonymous_mb()))
            row = f"| {figures[-1][0]:.0f} | {figures[-1][1]:.2f} | {flight.state} |\n"
            sys.stdout.write(row)
            sys.stdout.flush()
    return figures


def main() -> None:
    figures = fly(float(sys.argv[1]) if len(sys.argv) > 1 else MINUTE_S)
    (begin_min, begin), (end_min, end) = figures[0], figures[-1]
    sys.stdout.write(f"{60 * (end - begin) / (end_min - begin_min):+.2f} MB/h\n")


if __name__ == "__main__":
    main()
