"""Wind from tilt against true wind: `.venv/bin/python -m tests.benchmarks.wind`.

Recordings of PX4 and ArduPilot with a set wind, from beside the checkout. The flight code plays
them, with the default drag and with that of the simulated aircraft. The fake autopilots with the
drag of the estimator, and with 30 % less and more. The drag measured from a flight.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass

import numpy as np

from moar_companion.mavlink.passive_listener import PassiveListener
from moar_companion.mavlink.tlog import Tlog
from moar_companion.risk import RiskEstimate, update
from moar_companion.risk.drag import air_velocity_mps, deceleration_mps2
from moar_companion.risk.drag_fit import DragFlight
from moar_companion.risk.wind import FROM_TILT
from moar_companion.settings.risk_model import RiskModel
from tests.flights.airs import AirFlight, airframe_of
from tests.flights.operator import Manner
from tests.mavlink.conftest import SHARED

DRAGS = (0.7, 1.0, 1.3)
WINDS_MPS = (4.0, 8.0, 12.0)
SETTLING_S = 3.0
PERIOD_S = 0.1
CLOSE = 0.15
"""Fraction of the true wind: within it the wind counts as followed."""
NEAR_MPS = 1.0


@dataclass(frozen=True)
class Recording:
    """segments: from and to when (s), and the true wind (m/s)."""

    path: str
    manner: Manner
    segments: tuple[tuple[float, float, float], ...]


RECORDINGS = (
    Recording(
        "ardupilot/c3_wind_const",
        Manner.ARDUPILOT,
        ((4.0, 8.0, 0.0), (11.0, 26.0, 6.0), (29.0, 44.0, 12.0), (47.0, 62.0, 12.0)),
    ),
    Recording(
        "ardupilot/c1_wind",
        Manner.ARDUPILOT,
        ((4.0, 8.0, 0.0), (14.0, 26.0, 2.5), (32.0, 44.0, 4.9), (50.0, 90.0, 4.9)),
    ),
    Recording(
        "px4/c1_wind_v118",
        Manner.PX4,
        ((4.0, 36.0, 5.0), (40.0, 52.0, 9.43), (57.0, 66.0, 0.0)),
    ),
)


def drag_of(manner: Manner) -> RiskModel:
    """A risk model with the drag of this autopilot's simulated aircraft."""
    frame = airframe_of(manner, 1.0)
    return RiskModel(drag_per_s=frame.drag_per_s, drag_per_m=frame.drag_per_m)


def table(title: str, head: str, rows: list[str]) -> None:
    rule = "|".join("---" for _ in head.split("|")[1:-1])
    sys.stdout.write("\n".join((f"\n{title}\n", head, f"|{rule}|", *rows)) + "\n")


def estimates_in(path: str, model: RiskModel) -> np.ndarray:
    """Time and wind from tilt, (n, 2), for the estimated instants of a recording."""
    witness, estimate = PassiveListener(), RiskEstimate.unknown(model)
    begin_s, due_s, reported = None, 0.0, []
    for record in Tlog((SHARED / "traces" / f"{path}.companion.tlog").read_bytes()):
        begin_s = record.time_s if begin_s is None else begin_s
        now_s = record.time_s - begin_s
        while due_s <= now_s:
            witness.tick(due_s)
            estimate = update(estimate, witness.telemetry, due_s, model=model, cruise_mps=5.0)
            reported += [
                (due_s, item.value)
                for item in estimate.report.wind.inputs
                if item.name == FROM_TILT and item.known
            ]
            due_s += PERIOD_S
        witness.handle(record.packet, now_s)
    return np.array(reported)


def recordings() -> list[str]:
    rows = []
    for recording in RECORDINGS:
        default, known = (
            estimates_in(recording.path, model)
            for model in (RiskModel(), drag_of(recording.manner))
        )
        for begin_s, end_s, true_mps in recording.segments:
            cells = []
            for reported in (default, known):
                wind = reported[(reported[:, 0] >= begin_s) & (reported[:, 0] < end_s), 1]
                cells.append(f"{wind.mean():.1f} ± {wind.std():.1f}")
            when = f"{begin_s:.0f} to {end_s:.0f} s"
            rows.append(f"| {recording.path}, {when} | {true_mps:g} | {' | '.join(cells)} |")
    return rows


def followed_s(flight: AirFlight, wind_mps: float) -> float:
    """Set a wind. Return the time until the reported wind stays within `CLOSE` or `NEAR_MPS`."""
    began_s, late_s = flight.now_s, 0.0
    flight.reported.clear()
    flight.wind(wind_mps)
    flight.run(10.0)
    for item in flight.reported:
        error = abs((item.tilt_mps or 0.0) - item.true_mps)
        if error > max(NEAR_MPS, CLOSE * item.true_mps):
            late_s = item.time_s - began_s
    return late_s


def followed() -> list[str]:
    rows = []
    for manner in Manner:
        for wind_mps in WINDS_MPS:
            flight = AirFlight(manner)
            up_s = followed_s(flight, wind_mps)
            down_s = followed_s(flight, 0.0)
            rows.append(f"| {manner.value} | {wind_mps:g} | {up_s:.1f} | {down_s:.1f} |")
    return rows


def errors() -> list[str]:
    rows = []
    for manner in Manner:
        for drag in DRAGS:
            flight = AirFlight(manner, drag=drag)
            cells = []
            for wind_mps in WINDS_MPS:
                flight.wind(wind_mps)
                flight.steer((0.0, 0.0))
                flight.run(SETTLING_S)
                flight.reported.clear()
                flight.run(5.0)
                flight.fly_to((12.0, 0.0), 3.0)
                flight.fly_to((0.0, 0.0), 3.0)
                wind = np.array([item.tilt_mps for item in flight.reported], dtype=float)
                error = wind - wind_mps
                cells.append(f"{error.mean():+.1f} ({np.abs(error).max():.1f})")
            rows.append(f"| {manner.value} | {drag:.0%} | {' | '.join(cells)} |")
    return rows


def calm() -> list[str]:
    rows = []
    for manner in Manner:
        for drag in DRAGS:
            flight = AirFlight(manner, drag=drag)
            flight.run(15.0)
            rest = flight.reported[-1].risk
            flight.reported.clear()
            flight.manoeuvre()
            wind = np.array([item.tilt_mps for item in flight.reported], dtype=float)
            fast = max(math.hypot(*item.velocity_ned_mps[:2]) for item in flight.reported)
            risk = max(item.risk for item in flight.reported)
            fit = DragFlight()
            for telemetry in flight.telemetry:
                fit.take(telemetry)
            found = fit.fit()
            frame = airframe_of(manner, drag)
            true, measured = (
                deceleration_mps2(
                    (8.0, 0.0), RiskModel(drag_per_s=item.drag_per_s, drag_per_m=item.drag_per_m)
                )[0]
                for item in (frame, found)
            )
            rows.append(
                f"| {manner.value} | {drag:.0%} | {fast:.1f} | {np.percentile(wind, 95):.1f} | "
                f"{wind.max():.1f} | {risk - rest:+.2f} | {measured / true - 1.0:+.1%} |"
            )
    return rows


def spread_of_drags() -> list[str]:
    """Wind by the default drag, of aircraft with a known drag."""
    known = {
        "recorded quadrotor of 2015 (dronekit_flight_replay)": RiskModel(
            drag_per_s=0.227, drag_per_m=0.0
        ),
        "recorded quadrotor of 2015 (pymavlink_swift_flight)": RiskModel(
            drag_per_s=0.209, drag_per_m=0.008
        ),
        "PX4's simulated quadrotor": drag_of(Manner.PX4),
        "ArduPilot's simulated quadrotor": drag_of(Manner.ARDUPILOT),
    }
    rows = []
    for name, model in known.items():
        cells = [
            f"{air_velocity_mps(deceleration_mps2((wind, 0.0), model), RiskModel())[0]:.1f}"
            for wind in (5.0, 8.0, 12.0, 15.0)
        ]
        rows.append(f"| {name} | {' | '.join(cells)} |")
    return rows


def main() -> None:
    if (SHARED / "traces").exists():
        table(
            "Recordings: computed wind (m/s), mean ± standard deviation",
            "| recording | true | default drag | drag as simulated |",
            recordings(),
        )
    else:
        sys.stdout.write("no recordings beside the checkout: left out\n")
    winds = " | ".join(f"{wind:g} m/s" for wind in WINDS_MPS)
    for title, head, rows in (
        (
            "The default drag: computed wind of a hover in 5, 8, 12, 15 m/s",
            "| drag of | 5 | 8 | 12 | 15 |",
            spread_of_drags,
        ),
        (
            "A step of the wind: time until the error is within 15 % or 1 m/s (s)",
            "| autopilot | wind (m/s) | up | down |",
            followed,
        ),
        (
            "Error in hover and on legs of 3 m/s (m/s), mean (greatest), by the true drag's part",
            f"| autopilot | true drag | {winds} |",
            errors,
        ),
        (
            "Calm air, legs of 2 and 5 m/s, jumps of the setpoint by 15 m (m/s; risk above rest)",
            "| autopilot | true drag | fastest | computed, p95 | greatest | risk | measured drag |",
            calm,
        ),
    ):
        table(title, head, rows())


if __name__ == "__main__":
    main()
