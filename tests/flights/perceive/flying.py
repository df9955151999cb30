"""One flight by sight, from a seed to its result."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from moar_companion.settings.vehicle import YawMode
from sitl.autopilot import Truth
from sitl.geodesy import Geodetic, TrueFrame
from tests.vehicles import named_vehicle

from ..aircraft import STEP_S
from ..lockstep import Lockstep
from ..operator import INSPECTION
from ..reasons import reason
from .drawing import Draw, draw
from .judging import clearance_m

LONGEST_S = 75.0
"""From the order on."""
AT_TARGET_S = 2.0
REFUSED_S = 6.0
"""Longest time in `idle` after the order, or in a hold, before the flight is over."""
OFFERED_S = 1.5
"""PX4 takes the mode once a stream has run for a second."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReceivedData:
    """The first report of a conductor. from_m: distance of the aircraft from the true one.

    off_m: distance of the reported place from the true one, the position's error included.
    """

    diameter_m: float
    from_m: float
    off_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Flight:
    """Result of a flight. why: reason why the target was not reached; empty if it was."""

    draw: Draw
    radius_m: float
    true_m: np.ndarray
    airborne: np.ndarray
    flown_s: float
    why: str
    sights: tuple[ReceivedData, ...]
    texts: list[str]

    @property
    def least_clearance_m(self) -> float:
        """Least distance from the hull to the nearest obstacle in the air."""
        places_m = self.true_m[self.airborne]
        return float(clearance_m(self.draw.scene.scene, places_m).min()) - self.radius_m


class _Flight(Lockstep):
    """A flight whose lidar, which takes most of the time, is on only with armed motors."""

    def step(self) -> None:
        self.blind = not self.truth.armed
        super().step()


def fly(seed: int) -> Flight:
    """The flight of a seed."""
    drawn = draw(seed)
    vehicle = named_vehicle("x500")
    heading = math.radians(drawn.site.frame.azimuth_deg)
    fixed = replace(vehicle.guidance, yaw_mode=YawMode.FIXED, fixed_yaw_rad=heading)
    flight = _Flight(
        site=drawn.site,
        vehicle=replace(vehicle, guidance=fixed),
        manner=drawn.manner,
        options={"seed": seed, "yaw_deg": drawn.site.frame.azimuth_deg},
        lidar_scene=drawn.scene,
    )
    conditions = flight.autopilot.conditions
    conditions.wind_mps, conditions.wind_from_deg = drawn.wind_mps, drawn.wind_from_deg
    conditions.gust_mps, conditions.gps_noise_factor = drawn.gust_mps, drawn.position_noise
    flight.take_off()
    ordered_s = flight.now_s
    why = _flown(flight)
    true_m = _true_m(drawn, flight.truths)
    return Flight(
        draw=drawn,
        radius_m=flight.vehicle.radius_m,
        true_m=true_m,
        airborne=np.array([not truth.on_ground for truth in flight.truths]),
        flown_s=round(flight.now_s - ordered_s, 2),
        why=why,
        sights=_sights(drawn, flight, true_m),
        texts=flight.operator.texts(),
    )


def _flown(flight: Lockstep) -> str:
    """Orders and flies; returns the reason why the target was not reached, or an empty text."""
    operator, end_s = flight.operator, flight.now_s + LONGEST_S
    operator.mission(INSPECTION, 0)
    waited_s = offered_s = 0.0
    while flight.now_s < end_s and waited_s < REFUSED_S:
        flight.step()
        if flight.state == "at_target":
            flight.run(AT_TARGET_S)
            return ""
        offered_s = offered_s + STEP_S if flight.state == "ready" else 0.0
        if offered_s > OFFERED_S and not operator.in_mode("ours"):
            operator.mode("ours")
            offered_s = 0.0
        waited_s = 0.0 if flight.state in {"planning", "ready", "flying"} else waited_s + STEP_S
    return reason(flight.state, operator.texts())


def _true_m(drawn: Draw, truths: list[Truth]) -> np.ndarray:
    """(n, 3) places in the site's frame."""
    frame = TrueFrame(drawn.scene.origin)
    ned = np.array(
        [
            frame.ned(
                Geodetic(
                    latitude_deg=truth.latitude_deg,
                    longitude_deg=truth.longitude_deg,
                    altitude_amsl_m=truth.altitude_amsl_m,
                )
            )
            for truth in truths
        ]
    )
    azimuth = math.radians(drawn.scene.azimuth_deg)
    cos, sin = math.cos(azimuth), math.sin(azimuth)
    north, east, down = ned.T
    return np.column_stack((north * cos + east * sin, north * sin - east * cos, -down))


def _sights(drawn: Draw, flight: Lockstep, true_m: np.ndarray) -> tuple[ReceivedData, ...]:
    """The first report of each conductor, by its name."""
    crossings = [(wire, wire.ends()[12]) for wire in drawn.scene.scene.wires]
    times_s = np.array([truth.time_s for truth in flight.truths])
    sights: dict[str, ReceivedData] = {}
    for report in flight.lidar.reports:
        for seen in report.conductors:
            if seen.name in sights:
                continue
            x_m, _, z_m = true_m[np.searchsorted(times_s, report.time_s - 1e-6)]
            wire, crossing = min(
                crossings, key=lambda each: math.dist(each[1][[0, 2]], seen.position_m)
            )
            sights[seen.name] = ReceivedData(
                diameter_m=wire.diameter_m,
                from_m=math.dist((x_m, z_m), crossing[[0, 2]]),
                off_m=math.dist(crossing[[0, 2]], seen.position_m),
            )
    return tuple(sights.values())
