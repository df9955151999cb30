"""Drift that a place tolerates until a failsafe of the autopilot hits an obstacle."""

from __future__ import annotations

import random
from dataclasses import replace

import numpy as np
import pytest

from moar_companion.companion.safety.failsafe_paths import failsafe_hit, spare_drift_m
from moar_companion.mavlink.autopilots.failsafe_actions import (
    AutopilotAction,
    FailsafeAction,
    Failsafes,
    Trigger,
)
from moar_companion.planner.free_distance import FreeDistance

from ..planner.problems import conductor, make_site, random_problem

DESCENT = FailsafeAction(
    trigger=Trigger.GPS_LOSS, action=AutopilotAction.DESCEND, setting="", drift_m=1.0
)
RADIUS_M = 0.5


def spare(site, action, *places, margin_m=0.0, radius_m=RADIUS_M):
    return spare_drift_m(
        Failsafes(actions=(action,)),
        FreeDistance.over(site, radius_m),
        np.array(places, dtype=float),
        radius_m=radius_m,
        margin_m=margin_m,
    )


@pytest.mark.parametrize("action", [AutopilotAction.DESCEND, AutopilotAction.DRIFT])
@pytest.mark.parametrize("seed", range(10))
def test_a_drift_is_tolerated_where_no_blocked_cell_is_within_it(seed, action):
    """Against a search of the cells, one drift after the other, and against the action's paths."""
    generator = random.Random(seed)
    site = random_problem(generator).site
    reach = FreeDistance.over(site, RADIUS_M)
    cells = np.argwhere(reach.blocked == 0)
    centres = np.array(reach.grid.lower_m) + (cells + 0.5) * reach.grid.resolution_m
    tolerated_m = spare(site, replace(DESCENT, action=action, drift_m=0.0), *centres)
    for index in generator.sample(range(len(centres)), min(10, len(centres))):
        x, z = cells[index]
        for aside in range(8):
            drift_m = aside * reach.grid.resolution_m
            low = 0 if action is AutopilotAction.DESCEND else z
            swept = reach.blocked[max(0, x - aside) : x + aside + 1, low : z + 1]
            assert (tolerated_m[index] >= drift_m) == (not swept.any())
            item = replace(DESCENT, action=action, drift_m=drift_m)
            place = centres[index : index + 1]
            if failsafe_hit(Failsafes(actions=(item,)), reach, place, drifting=True):
                assert tolerated_m[index] < drift_m


def test_a_place_beside_a_conductor_has_what_lies_between_to_spare():
    site = make_site(conductor(5.5, 4.5, 0.1))
    above, beside, below = spare(site, DESCENT, (5.5, 7.5), (8.5, 7.5), (8.5, 1.5))
    assert above < -1.0
    assert beside == pytest.approx(8.5 - 5.5 - 0.5 - 1.0, abs=0.6)
    assert below == np.inf


def test_the_margin_is_a_part_of_the_drift():
    wide = make_site(replace(conductor(5.5, 4.5, 0.1), keep_out_m=1.0))
    bare = make_site(conductor(5.5, 4.5, 0.1))
    assert spare(wide, DESCENT, (8.5, 7.5), margin_m=1.0) == spare(bare, DESCENT, (8.5, 7.5))
    smaller = replace(DESCENT, drift_m=0.2)
    assert spare(wide, smaller, (8.5, 7.5), margin_m=1.0) == spare(bare, DESCENT, (8.5, 7.5))


def test_beside_the_site_a_place_has_its_distance_to_spare():
    site = make_site(conductor(5.5, 4.5, 0.1))
    (inside,), (outside,) = spare(site, DESCENT, (9.5, 7.5)), spare(site, DESCENT, (19.5, 7.5))
    assert outside == pytest.approx(inside + 10.0, abs=1.0)


def test_a_return_through_an_obstacle_has_nothing_to_spare():
    site = make_site(conductor(5.5, 4.5, 0.1))
    climb = replace(DESCENT, action=AutopilotAction.RETURN, drift_m=0.0)
    assert spare(site, climb, (5.5, 2.5), (8.5, 2.5)).tolist() == [-np.inf, np.inf]
