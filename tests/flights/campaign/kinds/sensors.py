"""Faults of a lidar on board, and errors that it can see."""

from __future__ import annotations

from dataclasses import replace

from sitl.lidar import Box
from sitl.lidar_scene import LidarMount

from .. import packets
from ..sites import moved_conductors
from .near import _when, between, between_circuits, drift, inspection
from .table import kind

LASTS_S = 45.0
"""A lidar takes most of a flight's processor time."""
WIND_MPS = 8.0
_GHOST_M = (3.0, 8.0)


def with_lidar(drawn, rng):
    """An inspection with a lidar."""
    return replace(inspection(drawn, rng), lidar=True, lasts_s=LASTS_S)


def _filter(flight, one):
    flight.lidar.filters.append(one)
    return lambda: flight.lidar.filters.remove(one)


@kind("the lidar loses 20 to 95 % of its packets", prepare=with_lidar)
def lidar_loses(flight, rng):
    part = rng.uniform(0.2, 0.95)
    flight.note(part=part)
    return _filter(flight, packets.lose(lambda: rng.random() < part))


@kind("the lidar is silent", lasts_s=(0.3, 10.0), prepare=with_lidar)
def lidar_silent(flight, rng):
    return _filter(flight, lambda *_: [])


@kind("the lidar's packets arrive 0.05 to 1.5 s late", prepare=with_lidar)
def lidar_late(flight, rng):
    by_s = rng.uniform(0.05, 1.5)
    flight.note(by_s=by_s)
    return _filter(flight, packets.late(by_s))


@kind("1 to 50 % of the lidar's packets have a wrong bit", prepare=with_lidar)
def lidar_corrupts(flight, rng):
    part = rng.uniform(0.01, 0.5)
    flight.note(part=part)
    return _filter(flight, packets.corrupt(lambda: rng.random() < part, rng.randrange))


@kind("rain: drops return 0.002 to 0.05 of the beams per metre", prepare=with_lidar)
def lidar_rain(flight, rng):
    per_m = rng.uniform(0.002, 0.05)
    flight.note(per_m=per_m)
    return _show(flight, rain_per_m=per_m)


@kind("the lidar is turned by 0.5 to 5 degrees in its mount", prepare=with_lidar)
def lidar_turned(flight, rng):
    turned_deg = [rng.choice((-1.0, 1.0)) * rng.uniform(0.5, 5.0) for _ in range(3)]
    flight.note(turned_deg=turned_deg)
    before = flight.lidar.placed
    angles = (
        angle + turned
        for angle, turned in zip(before.mount.roll_pitch_yaw_deg, turned_deg, strict=True)
    )
    flight.lidar.show(replace(before, mount=LidarMount(roll_pitch_yaw_deg=tuple(angles))))
    return lambda: flight.lidar.show(before)


@kind("the lidar sees a solid where nothing is", lasts_s=(0.3, 10.0), prepare=with_lidar)
def lidar_ghost(flight, rng):
    x_m, _, z_m = flight.place_m
    side, away_m = rng.choice((-1.0, 1.0)), rng.uniform(*_GHOST_M)
    x_m, z_m, half_m = x_m + side * away_m, z_m + rng.uniform(-3.0, 3.0), rng.uniform(0.2, 1.0)
    flight.note(x_m=x_m, z_m=z_m, half_m=half_m)
    ghost = Box(
        lower_m=(x_m - half_m, -half_m, z_m - half_m), upper_m=(x_m + half_m, half_m, z_m + half_m)
    )
    return _show(flight, boxes=(ghost,))


def _show(flight, **changes):
    before = flight.lidar.placed
    flight.lidar.show(replace(before, scene=replace(before.scene, **changes)))
    return lambda: flight.lidar.show(before)


def _between_with_lidar(drawn, rng):
    return replace(between_circuits(drawn, rng), lidar=True, lasts_s=60.0)


@kind(
    "between the circuits the estimate drifts, and a lidar is on board", prepare=_between_with_lidar
)
def lidar_sees_drift(flight, rng):
    reported = rng.random() < 0.5
    flight.note(reported=reported)
    return _when(flight, between, lambda: drift(flight, rng, reported=reported))


def _wrong_map_with_lidar(drawn, rng):
    mapped, error_m = moved_conductors(drawn.site, rng, rng.uniform(0.3, 1.9))
    return replace(with_lidar(drawn, rng), mapped=mapped, map_error_m=error_m)


@kind(
    "each conductor is up to 0.3 to 1.9 m from its place in the site file, and a lidar is on board",
    prepare=_wrong_map_with_lidar,
)
def lidar_sees_wrong_file(flight, _):
    flight.note(map_error_m=flight.drawn.map_error_m)
