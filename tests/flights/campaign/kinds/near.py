"""Faults beside the conductors: directed errors and gusts, narrow gaps, wrong site files."""

from __future__ import annotations

import math
from dataclasses import replace

from .. import packets
from ..sites import moved_conductors, narrow_site, shipped_site
from .table import kind, set_conditions

BETWEEN_M = (10.5, 19.5)
"""x between the 315 kV line's circuits, with the target at the far one."""
NEAR_M = 4.5
"""Distance from the hull to an obstacle within which an aircraft is beside it."""
DRIFTED_M = 4.0
LONG_S = 80.0
_ACCURACY_MM = 1e3


def between_circuits(drawn, rng):
    """An inspection of the 315 kV line's far circuit, from between the two."""
    order = replace(drawn.orders[0], word="mission", mission=1, index=1)
    site = shipped_site("315kv_double_circuit")
    return replace(drawn, site=site, orders=(order,), lasts_s=LONG_S)


def inspection(drawn, rng):
    """An inspection of all targets."""
    order = replace(drawn.orders[0], word="mission", mission=1, index=-1)
    return replace(drawn, orders=(order,), lasts_s=LONG_S)


def beside(flight) -> bool:
    """True while the companion flies the aircraft beside an obstacle."""
    return flight.commanded and flight.room_m < NEAR_M


def between(flight) -> bool:
    """True while the companion flies the aircraft between the circuits."""
    low_m, high_m = BETWEEN_M
    return flight.commanded and low_m < flight.place_m[0] < high_m


def direction_of(rng) -> float:
    """One of eight directions in the plane of the site, in radians from +x upwards."""
    return rng.randrange(8) * math.pi / 4.0


def drift(flight, rng, *, reported: bool):
    """The estimate drifts in the plane to `DRIFTED_M`. reported: the accuracy, too."""
    estimator = flight.autopilot._world.estimator
    speed_mps, towards_rad = rng.uniform(0.1, 0.4), direction_of(rng)
    flight.note(speed_mps=speed_mps, towards_deg=math.degrees(towards_rad))
    along, up = math.cos(towards_rad), math.sin(towards_rad)
    cos, sin = flight._cos, flight._sin
    state = {"off_m": 0.0}

    def step(step_s):
        moved_m = min(speed_mps * step_s, DRIFTED_M - state["off_m"])
        state["off_m"] += moved_m
        estimator._off_n += along * moved_m * cos
        estimator._off_e += along * moved_m * sin
        estimator._err_d += 0.05 * (-up * state["off_m"] - estimator._err_d) if up else 0.0

    def edit(message):
        if message.get_msgId() == packets.ESTIMATOR_STATUS:
            message.pos_horiz_accuracy += state["off_m"]
            message.pos_vert_accuracy += abs(up) * state["off_m"]
        else:
            message.h_acc += round(state["off_m"] * _ACCURACY_MM)

    flight.each_step(step)
    if reported:
        ids = {packets.ESTIMATOR_STATUS, packets.GPS_RAW_INT}
        flight.filter(packets.change(ids, edit, flight.key))


def note_place(flight) -> None:
    """Adds the time and place at which a waiting fault begins to its note."""
    x_m, _, z_m = flight.place_m
    flight.note(began_at_s=flight.now_s - flight.start_s, x_m=x_m, z_m=z_m)


@kind(
    "between the circuits the estimate drifts at 0.1 to 0.4 m/s in one of eight directions",
    prepare=between_circuits,
)
def drift_between(flight, rng):
    return _when(flight, between, lambda: drift(flight, rng, reported=False))


@kind("the same, and the reported accuracy grows as much", prepare=between_circuits)
def drift_between_reported(flight, rng):
    return _when(flight, between, lambda: drift(flight, rng, reported=True))


@kind("beside an obstacle the estimated height drifts off by 0.5 to 3 m", prepare=inspection)
def height_beside(flight, rng):
    estimator = flight.autopilot._world.estimator
    off_m, within_s = rng.choice((-1.0, 1.0)) * rng.uniform(0.5, 3.0), rng.uniform(0.5, 5.0)
    flight.note(off_m=off_m, within_s=within_s)

    def begin():
        began_s = flight.now_s

        def step(_):
            wanted_m = off_m * min(1.0, (flight.now_s - began_s) / within_s)
            estimator._err_d += 0.1 * (wanted_m - estimator._err_d)

        flight.each_step(step)

    return _when(flight, beside, begin)


@kind("beside an obstacle the air changes by 2.5 to 3.9 m/s at once", prepare=inspection)
def gust_beside(flight, rng):
    return _gust(flight, rng, 2.5, 3.9)


@kind("beside an obstacle the air changes by 5 to 12 m/s at once", prepare=inspection)
def gust_hard_beside(flight, rng):
    return _gust(flight, rng, 5.0, 12.0)


def _gust(flight, rng, low_mps, high_mps):
    towards_rad, by_mps = rng.randrange(8) * math.pi / 4.0, rng.uniform(low_mps, high_mps)
    lasts_s = rng.uniform(2.0, 8.0)
    flight.note(towards_deg=math.degrees(towards_rad), by_mps=by_mps, gust_s=lasts_s)

    def begin():
        conditions = flight.autopilot.conditions
        to_rad = math.radians(conditions.wind_from_deg) + math.pi
        heading_rad = math.radians(flight.site.frame.azimuth_deg) + towards_rad
        north = conditions.wind_mps * math.cos(to_rad) + by_mps * math.cos(heading_rad)
        east = conditions.wind_mps * math.sin(to_rad) + by_mps * math.sin(heading_rad)
        from_deg = math.degrees(math.atan2(-east, -north)) % 360.0
        undo = set_conditions(flight, wind_mps=math.hypot(north, east), wind_from_deg=from_deg)
        flight.later(lasts_s, undo)

    return _when(flight, beside, begin)


def _when(flight, condition, begin) -> None:
    def start():
        note_place(flight)
        begin()

    flight.when(lambda: condition(flight), start)


def _narrow(drawn, rng):
    site, part = narrow_site(rng, drawn.manner, drawn.vehicle)
    return replace(inspection(drawn, rng), site=site, gap_part=part)


@kind("the target is behind a gap of 0.98 to 1.2 times the width that is needed", prepare=_narrow)
def gap_narrow(flight, _):
    flight.note(part=flight.drawn.gap_part)


def _wrong_map(drawn, rng):
    mapped, error_m = moved_conductors(drawn.site, rng, rng.uniform(0.3, 2.5))
    return replace(inspection(drawn, rng), mapped=mapped, map_error_m=error_m)


@kind("each conductor is up to 0.3 to 2.5 m from its place in the site file", prepare=_wrong_map)
def site_file_wrong(flight, _):
    flight.note(map_error_m=flight.drawn.map_error_m)
