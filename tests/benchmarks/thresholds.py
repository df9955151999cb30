"""Thresholds against recorded flights: `.venv/bin/python -m tests.benchmarks.thresholds`.

Broken packets by the radio's margin; values of healthy estimators and magnetometers in flight;
delay from a fault of a real autopilot to its risk index. From the recordings beside the checkout.
"""

from __future__ import annotations

import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from moar_companion.mavlink.passive_listener import PassiveListener
from moar_companion.mavlink.telemetry import Telemetry
from moar_companion.risk.localization import LocalizationMemory, remember
from tests.mavlink.conftest import SHARED
from tests.risk.test_trouble_in_recordings import STEP_S, TROUBLES, judged, records

FLIGHTS = (
    "data/mavlink_tlog/dronekit_flight_replay.tlog",
    "data/mavlink_tlog/pymavlink_swift_flight.tlog.gz",
    "data/mavlink_tlog/codelever_2013-10-13_16-58-51.tlog",
    "data/mavlink_tlog/codelever_2013-10-13_18-31-24.tlog",
    "traces/ardupilot/a2_square.companion.tlog",
    "traces/ardupilot/c3_wind_const.companion.tlog",
    "traces/px4/b1_battery_drain.companion.tlog",
    "traces/px4/c1_wind_v118.companion.tlog",
)
MARGINS = (-100, 10, 30, 60, 300)
INNOVATIONS = ("velocity", "position", "height", "compass")


def received(path: Path) -> Iterator[Telemetry]:
    """The telemetry after every packet that changed it."""
    witness, before = PassiveListener(), Telemetry()
    begin_s = None
    for record in records(path):
        begin_s = record.time_s if begin_s is None else begin_s
        witness.handle(record.packet, record.time_s - begin_s)
        if witness.telemetry is not before:
            before = witness.telemetry
            yield before


def broken_packets(paths: list[Path]) -> dict[int, list[float]]:
    """Broken packets a second, by the bin of the worse margin."""
    found: dict[int, list[float]] = defaultdict(list)
    for path in paths:
        before = None
        for telemetry in received(path):
            radio = telemetry.radio
            if radio is None or radio is before:
                continue
            margins = (
                (radio.rssi or 0) - (radio.noise or 0),
                (radio.remote_rssi or 0) - (radio.remote_noise or 0),
            )
            if before is not None:
                elapsed_s = radio.received_s - before.received_s
                errors = radio.receive_errors - before.receive_errors
                if 0.5 <= elapsed_s <= 2.0 and errors >= 0:
                    found[int(np.digitize(min(margins), MARGINS))].append(errors / elapsed_s)
                elif elapsed_s < 0.5:  # the same name in its old and new form
                    continue
            before = radio
    return found


def in_flight(path: Path) -> dict[str, list[float]]:
    """Innovations and changes of the magnetic field while it was armed."""
    found: dict[str, list[float]] = defaultdict(list)
    memory = LocalizationMemory()
    estimator = magnetic = None
    for telemetry in received(path):
        memory = remember(memory, telemetry)
        armed = telemetry.autopilot is not None and telemetry.autopilot.armed
        if telemetry.estimator is not estimator:
            estimator = telemetry.estimator
            for name in INNOVATIONS:
                value = getattr(estimator, f"{name}_innovation", None)
                if armed and value is not None:
                    found[name].append(value)
        if telemetry.magnetic_field is not magnetic and telemetry.magnetic_field is not None:
            magnetic = telemetry.magnetic_field
            change = None if memory.field_mean is None else memory.field_mean.change(magnetic)
            if armed and change is not None:
                found["field"].append(change)
    return found


def spread(values: list[float]) -> str:
    """Median, 99th percentile and greatest of some values."""
    if not values:
        return ""
    return " / ".join(f"{value:.2f}" for value in np.quantile(values, (0.5, 0.99, 1.0)))


def say(*cells: object) -> None:
    sys.stdout.write(f"| {' | '.join(map(str, cells))} |\n")


def main() -> None:
    paths = [path for name in FLIGHTS if (path := SHARED / name).exists()]
    if not paths:
        sys.stdout.write(f"no recordings in {SHARED}\n")
        return
    say("radio margin", "seconds", "broken packets a second, mean / greatest")
    for number, rates in sorted(broken_packets(paths).items()):
        bounds = f"{MARGINS[number - 1]} to {MARGINS[number]}"
        say(bounds, len(rates), f"{np.mean(rates):.3f} / {max(rates):.1f}")
    sys.stdout.write("\nmedian / 99 % / greatest while armed\n")
    say("recording", *INNOVATIONS, "field")
    for path in paths:
        found = in_flight(path)
        say(path.name.split(".")[0], *(spread(found[name]) for name in (*INNOVATIONS, "field")))
    sys.stdout.write("\nseconds from the first packet that shows it\n")
    say("trouble", "index", "0.5", "0.9")
    for title, trouble in TROUBLES.items():
        if not (SHARED / trouble.recording).exists():
            continue
        _, after = judged(trouble)
        values = [getattr(risk.indices, trouble.index) for risk in after]
        reached = (
            next((STEP_S * n for n, value in enumerate(values, 1) if value >= level), None)
            for level in (0.5, 0.9)
        )
        say(title, trouble.index, *("never" if s is None else f"{s:.1f}" for s in reached))


if __name__ == "__main__":
    main()
