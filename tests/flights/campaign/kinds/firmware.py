"""Autopilots with the parameter names of another firmware, which brake slowly by one of them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ...operator import Manner
from .table import kind

OPTIONS: dict[str, dict[str, Any]] = {
    "4.6": {"firmware": (4, 6, 3)},
    "4.7": {"firmware": (4, 7, 1)},
}
"""Options of the fake autopilot with the names of this ArduPilot."""
BRAKING = {"4.6": ("WPNAV_ACCEL", 100.0), "4.7": ("WP_ACC", 1.0)}
"""Name of the level acceleration, and its value for 1 m/s²."""


def _prepared(firmware: str):
    def prepare(drawn, rng):
        name, one = BRAKING[firmware]
        parameters = {**drawn.parameters, name: one * rng.uniform(0.5, 2.5)}
        return replace(drawn, firmware=firmware, parameters=parameters)

    return prepare


def _slow(flight, _):
    name, one = BRAKING[flight.drawn.firmware]
    flight.note(acceleration_mps2=flight.drawn.parameters[name] / one)


@kind(
    "ArduPilot 4.6 brakes with 0.5 to 2.5 m/s²",
    manners=frozenset({Manner.ARDUPILOT}),
    prepare=_prepared("4.6"),
)
def firmware_4_6(flight, rng):
    return _slow(flight, rng)


@kind(
    "ArduPilot 4.7 brakes with 0.5 to 2.5 m/s²",
    manners=frozenset({Manner.ARDUPILOT}),
    prepare=_prepared("4.7"),
)
def firmware_4_7(flight, rng):
    return _slow(flight, rng)


@kind(
    "PX4 brakes with 0.5 to 3 m/s²",
    manners=frozenset({Manner.PX4}),
    prepare=lambda drawn, rng: replace(
        drawn, parameters={**drawn.parameters, "MPC_ACC_HOR": rng.uniform(0.5, 3.0)}
    ),
)
def px4_brakes_slowly(flight, _):
    flight.note(acceleration_mps2=flight.drawn.parameters["MPC_ACC_HOR"])
