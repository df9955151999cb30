"""Cost of the machine without I/O: `.venv/bin/python -m tests.benchmarks.machine`.

Processor time of: updates of the risk indices without and with their explanation; telemetry through
`Session.receive`; telemetry through the whole companion, at 50 cycles per second of its time. Also
a whole inspection in lockstep; that figure includes the fake autopilot. The telemetry is a
recording of PX4 if there is one beside the checkout, and otherwise that of the inspection.
"""

from __future__ import annotations

import math
import os
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import replace

from moar_companion.companion.companion import Companion
from moar_companion.companion.planning.site_maps import SiteMaps
from moar_companion.mavlink.session import Session
from moar_companion.planner.adaptation import Adaptation
from moar_companion.planner.planner import Planner
from moar_companion.planner.site import Site
from moar_companion.risk import update
from moar_companion.risk.explain import risk_section, weights_section
from moar_companion.risk.power import PowerModel
from moar_companion.settings.config import CompanionConfig, shipped_configs
from moar_companion.settings.link_config import LinkRole
from moar_companion.settings.vehicle import Vehicle
from moar_companion.status_values import json_dict
from moar_companion.types import Mission
from tests.flights.lockstep import Lockstep
from tests.flights.operator import INSPECTION
from tests.mavlink.conftest import SHARED, packets
from tests.risk.conftest import Flight

RECORDING = SHARED / "traces" / "px4" / "b1_battery_drain.companion.tlog"
VEHICLE = Vehicle.load(shipped_configs() / "vehicles" / "linedrone_flight.yaml")
LINK = CompanionConfig(vehicle=shipped_configs()).links[0].url
PERIOD_S = 0.02
UPDATES, REPEATS, FLIGHTS = 200, 20, 3

Stream = list[tuple[float, bytes]]


def fly() -> tuple[float, Stream]:
    """An inspection of all targets: simulated seconds per second, and the received packets."""
    flight = Lockstep()
    began = time.perf_counter()
    flight.begin(INSPECTION)
    flight.run_until_state("holding", 300.0)
    speed = flight.now_s / (time.perf_counter() - began)
    return speed, flight.received


def risk_update_us(*, explained: bool) -> Callable[[], float]:
    """Mean time of an update in a healthy flight with all sources; with its JSON and text."""
    flight = Flight.healthy()
    flight.fly(60.0)
    received = []
    for number in range(1, UPDATES + 1):
        now_s = flight.now_s + 0.1 * number
        reported = {name: source(now_s) for name, source in flight.sources.items()}
        received.append((now_s, replace(flight.telemetry, **reported)))
    power = PowerModel.of(VEHICLE)

    def measure() -> float:
        judged = flight.estimate
        began = time.process_time()
        for now_s, telemetry in received:
            judged = update(
                judged,
                telemetry,
                now_s,
                model=flight.model,
                cruise_mps=5.0,
                power=power,
                tracking_error_m=0.3,
            )
            if explained:
                json_dict(risk_section(judged))
                adaptation = Adaptation.of(VEHICLE, Mission.INSPECTION)
                json_dict(weights_section(adaptation, judged.indices))
        return 1e6 * (time.process_time() - began) / UPDATES

    return measure


def messages_in(stream: Stream) -> int:
    """Number of messages that a session finds in it."""
    count = 0
    session = Session(links={"serial": LinkRole.AUTOPILOT})
    for time_s, data in stream:
        session.receive("serial", data, time_s)
        count += len(session.received_packets())
    return count


def messages_per_second(stream: Stream, count: int) -> Callable[[], float]:
    """Messages that a session takes in a second, each as it came."""

    def measure() -> float:
        session = Session(links={"serial": LinkRole.AUTOPILOT})
        began = time.process_time()
        for time_s, data in stream:
            session.receive("serial", data, time_s)
        return count / (time.process_time() - began)

    return measure


def messages_through_the_companion(stream: Stream, count: int) -> Callable[[], float]:
    """Messages that the whole companion takes in a second, with as many cycles as in flight."""
    site = Site.load(shipped_configs() / "sites" / "315kv_double_circuit.yaml")
    site_maps = SiteMaps(site=site, maps=Planner(site, VEHICLE).maps)

    def measure() -> float:
        companion = Companion(CompanionConfig(vehicle=shipped_configs()), VEHICLE, site_maps)
        assessed_s = -math.inf
        began = time.process_time()
        for time_s, data in stream:
            companion.receive(LINK, data, time_s)
            if time_s - assessed_s >= PERIOD_S:
                assessed_s = time_s
                companion.tick(time_s)
                companion.data_to_send()
                companion.decisions()
        return count / (time.process_time() - began)

    return measure


def _row(what: str, unit: str, values: list[float]) -> str:
    spread = f"{min(values):.0f} to {max(values):.0f}"
    return f"| {what} | {statistics.median(values):.0f} | {spread} | {unit} |"


def main() -> None:
    flights = [fly() for _ in range(FLIGHTS)]
    recorded = RECORDING.exists()
    stream = list(packets(RECORDING)) if recorded else flights[0][1]
    source = "recorded" if recorded else "generated"
    count = messages_in(stream)
    rows = [
        _row(what, unit, [measure() for _ in range(REPEATS)])
        for what, unit, measure in (
            ("update of the risk indices", "µs", risk_update_us(explained=False)),
            ("the same with their explanation", "µs", risk_update_us(explained=True)),
            (f"messages through a session, {source}", "1/s", messages_per_second(stream, count)),
            (
                f"messages through the companion, {source}",
                "1/s",
                messages_through_the_companion(stream, count),
            ),
        )
    ]
    rows += [
        _row("inspection in lockstep", "s/s", [speed for speed, _ in flights]),
    ]
    sys.stdout.write(f"load average {os.getloadavg()[0]:.2f}, {os.cpu_count()} cores\n\n")
    sys.stdout.write("| what | median | range | |\n|---|---|---|---|\n")
    sys.stdout.write("\n".join(rows) + "\n")


if __name__ == "__main__":
    main()
