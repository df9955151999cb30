"""Random flights that capture views: drawn from seeds, judged by what the pictures truly show."""

from __future__ import annotations

import pytest

from .operator import Manner
from .views import command
from .views.flying import FAULTS, draw, site_with_views

DRAWS = [draw(seed) for seed in range(1, 120)]


def test_a_seed_is_always_the_same_flight():
    assert draw(7) == draw(7)
    assert draw(7) != draw(8)


def test_every_fault_and_both_autopilots_are_drawn():
    assert {drawn.fault for drawn in DRAWS} == set(FAULTS)
    assert {drawn.manner for drawn in DRAWS} == set(Manner)
    assert {drawn.target for drawn in DRAWS} == {0, -1}


def test_three_aims_are_captured_from_one_place():
    level, up, down, _ = site_with_views().targets
    assert level.position_m == up.position_m == down.position_m
    assert down.view.aim_m[1] < level.view.aim_m[1] < up.view.aim_m[1]


@pytest.mark.slow
def test_a_flight_has_a_row_and_a_summary():
    row = command.row_of(12) | {"cpu_s": 1.0}
    assert (row["verdict"], row["faults"]) == ("kept", [])
    assert "1 flights: 0 broken, 0 errors." in command.summary([row])
