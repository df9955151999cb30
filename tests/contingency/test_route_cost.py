"""Routes: their cost, and the better of two escape routes."""

from __future__ import annotations

import pytest

from moar_companion.companion.contingency.route_cost import RouteCost, better_of
from moar_companion.types import Mission

NOW_S = 100.0


def routes(exit_wh, evacuation_wh, *, exit_age_s=0.0, evacuation_age_s=0.0):
    return {
        mission: None
        if energy is None
        else RouteCost(duration_s=1.0, energy_wh=energy, asked_s=NOW_S - age_s)
        for mission, energy, age_s in (
            (Mission.EXIT, exit_wh, exit_age_s),
            (Mission.EVACUATION, evacuation_wh, evacuation_age_s),
        )
    }


@pytest.mark.parametrize(
    ("exit_wh", "evacuation_wh", "before", "better"),
    [
        (1.0, 2.0, None, Mission.EXIT),
        (2.0, 1.0, None, Mission.EVACUATION),
        (1.0, 0.95, Mission.EXIT, Mission.EXIT),
        (0.95, 1.0, Mission.EVACUATION, Mission.EVACUATION),
        (1.0, 0.8, Mission.EXIT, Mission.EVACUATION),
        (None, 3.0, Mission.EXIT, Mission.EVACUATION),
        (None, None, Mission.EXIT, None),
    ],
)
def test_the_better_escape_route_stays_unless_another_is_clearly_better(
    exit_wh, evacuation_wh, before, better
):
    assert better_of(routes(exit_wh, evacuation_wh), before) is better


@pytest.mark.parametrize(
    ("ages", "better"),
    [
        ({"exit_age_s": 14.0}, Mission.EXIT),
        ({"exit_age_s": 16.0}, Mission.EVACUATION),
        ({"exit_age_s": 40.0, "evacuation_age_s": 30.0}, Mission.EXIT),
    ],
)
def test_an_outdated_route_does_not_count_while_another_is_current(ages, better):
    assert better_of(routes(1.0, 2.0, **ages), Mission.EXIT) is better


def test_two_routes_together_have_the_age_of_the_older_one():
    first = RouteCost(duration_s=1.0, energy_wh=2.0, asked_s=10.0)
    second = RouteCost(duration_s=3.0, energy_wh=4.0, asked_s=5.0)
    assert first.then(second) == RouteCost(duration_s=4.0, energy_wh=6.0, asked_s=5.0)
    assert second.then(first).asked_s == 5.0


def test_at_half_the_pace_a_route_costs_twice_as_much():
    route = RouteCost(duration_s=3.0, energy_wh=4.0, asked_s=5.0)
    assert route.paced(0.5) == RouteCost(duration_s=6.0, energy_wh=8.0, asked_s=5.0)
