"""Obstacle inflation: in steps, at once upwards, slowly downwards."""

from __future__ import annotations

import gc
import math
import weakref
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from moar_companion.companion.plan_inflation import STEP_M, ObstacleInflation
from moar_companion.companion.planning.planner_set import PlannerSet
from moar_companion.planner.planner import Planner
from moar_companion.planner.site import Site
from moar_companion.settings.config import shipped_configs
from tests.vehicles import named_vehicle

LOOK_S = 0.02
SHRUNK_S = 3.1


class Story:
    """Required inflation over time, and the inflation of plans."""

    def __init__(self):
        self.widening, self.now_s = ObstacleInflation(), 0.0
        self.widths_m = [0.0]

    @property
    def width_m(self):
        return self.widening.width_m

    def need(self, *needed_m, seconds=LOOK_S):
        """Applies the needed values in turn, one per cycle, for a time."""
        for look in range(max(len(needed_m), round(seconds / LOOK_S))):
            self.now_s += LOOK_S
            self.widening = self.widening.followed(needed_m[look % len(needed_m)], self.now_s)
            if self.width_m != self.widths_m[-1]:
                self.widths_m.append(self.width_m)
        return self


@pytest.mark.parametrize(
    ("needed_m", "width_m"),
    [(0.0, 0.0), (1e-9, 0.1), (0.05, 0.1), (0.1, 0.1), (0.11, 0.2), (0.3, 0.3), (1.0, 1.0)],
)
def test_the_inflation_is_the_next_sufficient_step(needed_m, width_m):
    assert Story().need(needed_m).width_m == pytest.approx(width_m)


def test_the_inflation_grows_at_once_and_shrinks_after_a_delay():
    story = Story().need(0.62)
    assert story.width_m == pytest.approx(0.7)
    story.need(0.15, seconds=2.9)
    assert story.width_m == pytest.approx(0.7)
    story.need(0.15, seconds=0.3)
    assert story.width_m == pytest.approx(0.3)  # one step more than just enough
    story.need(0.0, seconds=SHRUNK_S)
    assert story.width_m == 0.0
    assert len(story.widths_m) == 4


def test_a_single_greater_need_restarts_the_delay():
    story = Story().need(0.62).need(0.2, seconds=2.9).need(0.62).need(0.2, seconds=2.9)
    assert story.width_m == pytest.approx(0.7)


def test_the_greatest_need_during_the_delay_counts():
    story = Story().need(0.95).need(0.1, 0.42, 0.1, seconds=SHRUNK_S)
    assert story.width_m == pytest.approx(0.6)


@pytest.mark.parametrize("middle_m", [0.1, 0.25, 0.3, 0.349, 0.7])
def test_noise_of_half_a_step_changes_the_inflation_once_at_most(middle_m):
    story = Story().need(middle_m)
    count = len(story.widths_m)
    noise_m = [0.05, -0.05, 0.03, 0.0, -0.05, -0.02, 0.05]
    story.need(*(middle_m + part_m for part_m in noise_m), seconds=60.0)
    assert len(story.widths_m) - count <= 1


@given(st.lists(st.tuples(st.floats(0.0, 5.0), st.floats(0.0, 4.0)), max_size=40))
def test_the_inflation_is_never_less_than_needed_and_always_whole_steps(looks):
    widening, now_s = ObstacleInflation(), 0.0
    for needed_m, seconds in looks:
        now_s += seconds
        before, widening = widening, widening.followed(needed_m, now_s)
        assert widening.width_m >= needed_m
        assert widening.width_m / STEP_M == pytest.approx(round(widening.width_m / STEP_M))
        if before.width_m >= needed_m:
            assert widening.width_m <= before.width_m


@given(st.floats(0.0, 5.0), st.floats(0.0, 5.0))
def test_a_lasting_need_is_followed_within_two_steps(before_m, needed_m):
    story = Story().need(before_m).need(needed_m, seconds=SHRUNK_S)
    assert needed_m <= story.width_m <= needed_m + 2.0 * STEP_M


# Planners of an inflation -------------------------------------------------------------------------


@pytest.fixture(scope="module")
def exact():
    configs = shipped_configs()
    site = Site.load(configs / "sites" / "315kv_double_circuit.yaml")
    return Planner(site, named_vehicle("linedrone_uniform"))


def test_the_planner_of_an_inflation_is_built_once(exact):
    planners = PlannerSet(exact)
    assert planners.widened_by(0.0) is exact
    wide = planners.widened_by(0.3)
    assert wide.maps.position_uncertainty_m == 0.3
    assert planners.widened_by(0.3) is wide


def test_the_planners_of_recent_inflations_are_kept(exact):
    planners = PlannerSet(exact)
    first, second = planners.widened_by(0.1), planners.widened_by(0.2)
    for width_m in (0.3, 0.1, 0.4, 0.5):
        planners.widened_by(width_m)
    assert planners.widened_by(0.1) is first
    again = planners.widened_by(0.2)
    assert again is not second
    assert again.maps.reach == second.maps.reach != first.maps.reach
    assert planners.widened_by(0.0) is exact


@pytest.mark.slow
def test_on_a_large_site_one_inflated_planner_is_kept(exact):
    space = replace(exact.site.workspace, resolution_m=0.03)
    planners = PlannerSet(Planner(replace(exact.site, workspace=space), exact.vehicle))
    wide = planners.widened_by(0.3)
    assert planners.widened_by(0.3) is wide
    built = weakref.ref(wide)
    del wide
    planners.widened_by(0.4)
    gc.collect()
    assert built() is None


def test_a_need_just_above_a_whole_step_is_covered_by_the_next_one():
    for steps in range(1, 60):
        needed_m = math.nextafter(steps * STEP_M, math.inf)
        width_m = ObstacleInflation().followed(needed_m, 0.0).width_m
        assert needed_m <= width_m < needed_m + STEP_M + 1e-9
