"""A flight over a hill between two conductors, in lockstep: setpoints and aircraft keep off it."""

from __future__ import annotations

from dataclasses import replace

import pytest
from shapely.geometry import Point, Polygon

from moar_companion.planner.site import Margin, Site
from moar_companion.settings.config import shipped_configs

from ..flights.judging import assert_nothing_was_touched, setpoint_places, true_places
from ..flights.lockstep import hovering
from ..flights.operator import EXIT, INSPECTION

LEAST_M = 2.0
HILL = ((-20.0, 1.0), (6.0, 0.0), (13.0, 4.5), (17.0, 4.5), (22.0, 0.0), (50.0, 0.0))
"""Between the start and the second target, below three conductors in one layer at 10 m."""


def hilly():
    """Targets below the conductors at both sides of the hill."""
    site = Site.load(shipped_configs() / "sites" / "horizontal_three_conductors.yaml")
    space = replace(site.workspace, min_altitude_m=LEAST_M, ground_m=HILL)
    right, left = site.targets
    targets = (
        replace(right, position_m=(27.0, 7.0)),
        replace(left, position_m=(2.5, 6.0)),
    )
    return replace(site, workspace=space, targets=targets)


@pytest.mark.slow
def test_the_hill_is_kept_by_setpoints_and_by_the_aircraft_to_the_landing():
    site = hilly()
    flight = hovering(site=site, vehicle="x500")
    flight.operator.mission(INSPECTION)
    flight.give_mode()
    flight.run_until_state("holding", 200.0)
    flight.operator.mission(EXIT)
    flight.run_until_state("landing_leg", 120.0)
    sent = len(flight.setpoints)
    flight.run_until_state("holding", 120.0)
    ground = Polygon([*HILL, (50.0, -50.0), (-20.0, -50.0)])
    over = [place for place in setpoint_places(flight)[:sent] if 8.0 <= place[0] <= 20.0]
    assert min(x for x, _, _ in over) < 9.0  # it was crossed
    # Setpoints turn their corners within half a cell.
    assert min(ground.distance(Point(x, z)) for x, _, z in over) >= LEAST_M - 0.15
    margin = Margin(position_m=1.4, tracking_m=1.15)
    flown = [place for place in true_places(flight) if 8.0 <= place[0] <= 20.0]
    assert min(ground.distance(Point(x, z)) for x, _, z in flown) >= LEAST_M - margin.total_m
    assert_nothing_was_touched(flight)
