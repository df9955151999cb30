"""Effects of a wind on a setpoint: those that the judge permits, and forbidden ones."""

from __future__ import annotations

import itertools
import math

import pytest

from moar_companion.planner.site import Site
from moar_companion.settings.config import shipped_configs
from tests.vehicles import named_vehicle

from .judging import Blown, Leash

SITE = Site.load(shipped_configs() / "sites" / "315kv_double_circuit.yaml")
VEHICLE = named_vehicle("linedrone_uniform")
"""Flies 0.7 m/s, has a leash of 3 m; x and z end at 30 and 20 m, z begins at 2 m."""
HERE = (28.0, 0.0, 9.0)
OFF = (31.5, 0.0, 9.0)
"""Places of the setpoint, and of an aircraft that is 3.5 m off; between them is room."""
UNDER_A_CONDUCTOR = (22.68, 0.0, 9.0), (22.68, 0.0, 11.5)
LOW = (28.0, 0.0, 2.5), (31.5, 0.0, 1.0)


def look(after_m, *, before_m=HERE, aircraft_m=OFF, moves=False):
    return Leash(SITE, VEHICLE).look(before_m, after_m, aircraft_m, moves=moves)


@pytest.mark.parametrize("after_m", [(28.5, 0.0, 9.0), (30.5, 0.0, 9.0), (30.8, 0.0, 9.0)])
def test_an_aircraft_that_is_blown_off_takes_its_setpoint_along(after_m):
    assert look(after_m) is Blown.TAKEN


def test_above_the_least_altitude_the_setpoint_follows_an_aircraft_that_sinks():
    before_m, aircraft_m = LOW
    assert look((30.5, 0.0, 2.0), before_m=before_m, aircraft_m=aircraft_m) is Blown.TAKEN


before_m, aircraft_m = UNDER_A_CONDUCTOR
WRONG = {
    "the aircraft is near": {"after_m": (29.0, 0.0, 9.0), "aircraft_m": (30.9, 0.0, 9.0)},
    "it moves": {"after_m": (30.5, 0.0, 9.0), "moves": True},
    "to the aircraft": {"after_m": (31.2, 0.0, 9.0)},
    "away from the aircraft": {"after_m": (27.5, 0.0, 9.0)},
    "beside the way": {"after_m": (30.0, 0.3, 9.0)},
    "below the way": {"after_m": (30.0, 0.0, 8.7)},
    "into a keep-out": {
        "after_m": (22.68, 0.0, 10.3),
        "before_m": before_m,
        "aircraft_m": (22.68, 0.0, 12.5),
    },
    "too low": {"after_m": (30.5, 0.0, 1.43), "before_m": LOW[0], "aircraft_m": LOW[1]},
    "the stream has just begun": {"after_m": (30.5, 0.0, 9.0), "before_m": None},
}


@pytest.mark.parametrize("wrong", WRONG.values(), ids=WRONG)
def test_the_wind_excuses_no_other_motion_of_a_setpoint(wrong):
    assert look(**wrong) is None


def taken(at_m=(34.0, 6.0, 9.0)):
    """A leash whose setpoint was taken to a place outside the workspace and beside the plane."""
    leash = Leash(SITE, VEHICLE)
    aircraft_m = tuple(a + (a - b) for a, b in zip(at_m, HERE, strict=True))
    assert leash.look(HERE, at_m, aircraft_m, moves=False) is Blown.TAKEN
    return leash, at_m


def test_a_setpoint_that_was_taken_along_may_stand_only_at_its_place():
    leash, at_m = taken()
    assert leash.look(at_m, at_m, at_m, moves=False) is Blown.STANDS
    assert leash.look(at_m, (34.0, 6.0, 9.1), at_m, moves=False) is None


def follow(leash, places_m):
    before_m = places_m[0]
    found = []
    for place_m in places_m[1:]:
        found.append(leash.look(before_m, place_m, place_m, moves=True))
        before_m = place_m
    return found


def along(*points_m, step_m=0.05):
    places_m = [points_m[0]]
    for start_m, end_m in itertools.pairwise(points_m):
        count = math.ceil(math.dist(start_m, end_m) / step_m)
        places_m += [
            tuple(a + (b - a) * n / count for a, b in zip(start_m, end_m, strict=True))
            for n in range(1, count + 1)
        ]
    return places_m


def test_the_setpoint_returns_to_the_plane_then_to_the_workspace_and_is_then_judged_normally():
    leash, at_m = taken()
    found = follow(leash, along(at_m, (34.0, 0.0, 9.0), (29.5, 0.0, 9.0)))
    back = found.index(None)
    assert set(found[:back]) == {Blown.RETURNS}
    assert set(found[back:]) == {None}
    assert back == pytest.approx((6.0 + 4.0) / 0.05, abs=2)


@pytest.mark.parametrize("end_m", [(34.5, 5.0, 9.0), (33.5, 6.5, 9.0)])
def test_the_setpoint_may_not_move_away_from_the_plane_or_the_workspace(end_m):
    leash, at_m = taken()
    assert None in follow(leash, along(at_m, end_m))[:2]


def test_a_returning_setpoint_stays_out_of_the_keep_outs():
    leash, at_m = taken((22.68, 6.0, 9.0))
    found = follow(leash, along(at_m, (22.68, 5.0, 10.5)))
    assert found[0] is Blown.RETURNS
    assert found[-1] is None
