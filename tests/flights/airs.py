"""Flights for wind estimation: steered by the operator, observed by the companion."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from moar_companion.risk.wind import FROM_TILT, strongest
from moar_companion.settings.config import Authority
from sitl.manners import KINDS
from sitl.quadrotor import Airframe

from ..copies import flown_once
from .aircraft import STEP_S
from .lockstep import Lockstep
from .operator import Manner

SAMPLE_STEPS = 5
"""Number of `STEP_S`: as often as risk is judged."""
SETPOINT_STEPS = 3
HEIGHT_M = 10.0
POSITION_VELOCITY_YAW = 0x9C0

Point = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Progress:
    """Reported and true wind at one instant. reported_mps, tilt_mps: None where unknown."""

    time_s: float
    risk: float
    reported_mps: float | None
    tilt_mps: float | None
    true_mps: float
    velocity_ned_mps: tuple[float, float, float]


def airframe_of(manner: Manner, drag: float) -> Airframe:
    """Airframe of this autopilot's aircraft with its drag times `drag`."""
    frame = KINDS[manner.value].airframe
    return replace(frame, drag_per_s=drag * frame.drag_per_s, drag_per_m=drag * frame.drag_per_m)


class AirFlight(Lockstep):
    """In the air at `HEIGHT_M`, in the mode that follows setpoints.

    drag: the aircraft's drag, as a fraction of the configured drag.
    """

    def __init__(self, manner: Manner, *, drag: float = 1.0, **options) -> None:
        super().__init__(
            manner=manner,
            vehicle="x500",
            authority=Authority.OBSERVE,
            options={"airframe": airframe_of(manner, drag), **options},
        )
        self.reported: list[Progress] = []
        self.telemetry = []
        self._setpoint: tuple[Point, Point] | None = None
        self._steps = 0
        self.take_off(HEIGHT_M)
        self.steer((0.0, 0.0))
        self.run(1.5)
        self.operator.mode("ours")
        self.run(8.0)
        self.reported.clear()

    def step(self) -> None:
        super().step()
        self._steps += 1
        if self._setpoint is not None and self._steps % SETPOINT_STEPS == 0:
            self._send(*self._setpoint)
        if self._steps % SAMPLE_STEPS == 0:
            self._note()

    def steer(self, position_m: Point, velocity_mps: Point = (0.0, 0.0)) -> None:
        """Sets the setpoint (north, east) at `HEIGHT_M`."""
        self._setpoint = (position_m, velocity_mps)

    def fly_to(self, position_m: Point, speed_mps: float, acceleration_mps2: float = 2.0) -> None:
        """A moving setpoint along a straight leg from the last setpoint; then a second of rest."""
        assert self._setpoint is not None
        (north, east), _ = self._setpoint
        length_m = math.dist((north, east), position_m)
        along = ((position_m[0] - north) / length_m, (position_m[1] - east) / length_m)
        done_m, now_mps = 0.0, 0.0
        while done_m < length_m - 0.02:
            braking_mps = math.sqrt(2.0 * acceleration_mps2 * (length_m - done_m))
            now_mps = min(speed_mps, braking_mps, now_mps + acceleration_mps2 * STEP_S)
            done_m += now_mps * STEP_S
            self.steer(
                (north + done_m * along[0], east + done_m * along[1]),
                (now_mps * along[0], now_mps * along[1]),
            )
            self.step()
        self.steer(position_m)
        self.run(1.0)

    def wind(self, speed_mps: float, from_deg: float = 250.0, gust_mps: float = 0.0) -> None:
        conditions = self.autopilot.conditions
        conditions.wind_mps, conditions.wind_from_deg = speed_mps, from_deg
        conditions.gust_mps = gust_mps

    def manoeuvre(self) -> None:
        """Legs, turns, braking, and jumps of the setpoint that need the full lean."""
        for speed_mps in (2.0, 5.0):
            for corner in ((20.0, 0.0), (20.0, 20.0), (0.0, 20.0), (0.0, 0.0)):
                self.fly_to(corner, speed_mps)
        for corner in ((15.0, 0.0), (15.0, 15.0), (0.0, 0.0)):
            self.steer(corner)
            self.run(6.0)

    def _send(self, position_m: Point, velocity_mps: Point) -> None:
        message = self.operator._codec.set_position_target_local_ned_encode(
            round(self.now_s * 1000), 1, 1, 1, POSITION_VELOCITY_YAW,
            *position_m, -HEIGHT_M, *velocity_mps, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0,
        )  # fmt: skip
        self.operator.send(message)

    def _note(self) -> None:
        inputs = self.companion.risk.report.wind.inputs
        use = strongest(inputs)
        tilt = next((item for item in inputs if item.name == FROM_TILT), None)
        self.telemetry.append(self.companion.telemetry)
        self.reported.append(
            Progress(
                time_s=self.now_s,
                risk=self.companion.risk.indices.wind,
                reported_mps=None if use is None else use.value,
                tilt_mps=tilt.value if tilt is not None and tilt.known else None,
                true_mps=math.hypot(*self.truth.wind_ned_mps[:2]),
                velocity_ned_mps=self.truth.velocity_ned_mps,
            )
        )


@flown_once
def in_the_air(manner: Manner, **options) -> AirFlight:
    return AirFlight(manner, **options)
