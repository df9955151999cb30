"""The paper's flight (Section V-C, Fig. 9): planned and flown, with the paper's figures.

Inputs: places and times of flights in lockstep with the fake autopilot. Outputs: their metrics.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...planner.grid import FloatArray
from ...planner.plan_values import Plan
from ...planner.planner import Planner
from ...planner.regions import obstacle_clearance_m
from ...planner.site import Site
from ...settings.vehicle import Vehicle
from ...types import Mission
from .scenes import FLIGHT_SITE, FLIGHT_VEHICLE

COMPARED = ("length (m)", "duration (s)", "least clearance (m)", "mean clearance (m)")
IN_PAPER = {"paper, planned": (16.8, 38.3, 1.7, 3.8), "paper, flown": (17.7, 36.2, 1.8, 3.7)}


@dataclass(frozen=True, kw_only=True, eq=False)
class Flown:
    """A flight. places_m: (n, 2); time_s: (n,)."""

    places_m: FloatArray
    time_s: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class FlightTest:
    """The plan and the flights by autopilot."""

    planner: Planner
    plan: Plan
    flown: Mapping[str, Flown]


def of_flights(flights: Mapping[str, Mapping[str, Sequence[Any]]]) -> FlightTest:
    """The plan, and flights in the form of `tests.flights.paper_flight`."""
    planner = Planner(Site.load(FLIGHT_SITE), Vehicle.load(FLIGHT_VEHICLE))
    return FlightTest(
        planner=planner,
        plan=planner.plan(mission=Mission.INSPECTION),
        flown={
            autopilot: Flown(
                places_m=np.array(flight["places_m"]), time_s=np.array(flight["time_s"])
            )
            for autopilot, flight in flights.items()
        },
    )


def compared(result: FlightTest) -> dict[str, tuple[float, ...]]:
    """Length, duration, least and time-averaged clearance, by row."""
    metrics = result.plan.metrics
    assert metrics is not None
    rows: dict[str, tuple[float, ...]] = {
        **IN_PAPER,
        "planned": (
            metrics.length_m,
            metrics.duration_s,
            metrics.min_clearance_m,
            metrics.mean_clearance_m,
        ),
    }
    for autopilot, flight in result.flown.items():
        clearance = obstacle_clearance_m(result.planner.site, flight.places_m)
        step_s = np.diff(flight.time_s)
        rows[f"flown, {autopilot}"] = (
            float(np.hypot(*np.diff(flight.places_m, axis=0).T).sum()),
            float(flight.time_s[-1]),
            float(clearance.min()),
            float(clearance[1:] @ step_s / step_s.sum()),
        )
    return rows
