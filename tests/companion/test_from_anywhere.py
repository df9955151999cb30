"""Orders from random places around the shipped sites: flown on free legs, or refused.

The judge samples the legs densely and takes distances from the site's own obstacles. Places are in
the workspace, beside, above and below it, below the least altitude, and within keep-outs.
"""

from __future__ import annotations

import functools
import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from moar_companion.companion.error_margin import flown_site
from moar_companion.companion.planning.plan_jobs import PlanJob, answer_job
from moar_companion.companion.planning.planner_set import PlannerSet
from moar_companion.planner.plan_values import PlanRequest
from moar_companion.planner.plane_fence import Bound, PlaneFence
from moar_companion.planner.planner import Planner
from moar_companion.planner.site import Site
from moar_companion.settings.config import Supervision, shipped_configs
from moar_companion.texts.text_format import pilot_text
from moar_companion.types import ARDUPILOT, PX4, Mission, RiskIndices
from tests.thorough import sampled
from tests.vehicles import named_vehicle

from ..flights.judging import clearances_m

SITES = ("120kv_single_circuit", "315kv_double_circuit", "horizontal_three_conductors")
KINDS = (PX4, ARDUPILOT)
FENCE = PlaneFence(
    bounds=(Bound(name="GF_MAX_HOR_DIST 30 m", x_m=((-1.0, 36.0),), z_m=(-5.0, 18.0)),),
    margin_m=1.5,
)
_NEAR_M = 1e-3
"""Tolerance: clearances are sampled, and legs are checked ten times a cell."""


@functools.cache
def planners(name, kind):
    site = Site.load(shipped_configs() / "sites" / f"{name}.yaml")
    vehicle = named_vehicle("linedrone_uniform")
    vehicle = replace(vehicle, autopilot=kind)
    return PlannerSet(Planner(flown_site(site, vehicle, Supervision()), vehicle))


def samples(points):
    """Points (n, 2), at most 2 cm apart, along a line."""
    parts = [
        np.linspace(one, two, 2 + int(np.hypot(*np.subtract(two, one)) / 0.02))
        for one, two in itertools.pairwise(points)
    ]
    return np.concatenate(parts)


def judge_leg(planner, start_m, corners_m, fence):
    """Asserts that a leg is free or leaves an occupied start without coming nearer or lower."""
    site, radius_m = planner.site, planner.vehicle.radius_m
    places_m = samples([start_m, *corners_m])
    low_m = site.workspace.min_altitude_m
    assert (places_m[:, 1] >= min(start_m[1], low_m) - _NEAR_M).all()
    own_m, nearest_m = [], []
    for item in site.obstacles:
        alone = replace(site, obstacles=(item,))
        at_m = np.array(clearances_m(alone, [(x, 0.0, z) for x, z in places_m.tolist()]))
        own_m.append(item.keep_out_m + radius_m)
        nearest_m.append(at_m)
    nearest_m = np.array(nearest_m)
    free = all(
        (at_m >= min(need_m, at_m[0]) - _NEAR_M).all()
        for need_m, at_m in zip(own_m, nearest_m, strict=True)
    )
    least_m = nearest_m.min(axis=0)
    escapes = bool((np.diff(least_m) >= -_NEAR_M).all())
    assert free or escapes, (start_m, corners_m)
    if fence is not None:
        inside = fence.holds(places_m)
        assert (np.diff(inside.astype(int)) >= 0).all()


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", SITES)
@pytest.mark.parametrize("fence", [None, FENCE])
@settings(deadline=None, max_examples=sampled(25, 60), derandomize=True, database=None)
@given(
    x_m=st.floats(-70.0, 100.0),
    z_m=st.one_of(st.floats(0.1, 2.5), st.floats(0.1, 30.0)),
    near=st.booleans(),
    mission=st.sampled_from(list(Mission)),
)
def test_an_order_is_flown_on_legs_that_are_free_or_refused_with_a_reason(
    kind, name, fence, x_m, z_m, near, mission
):
    known = planners(name, kind)
    planner = known.exact
    site, vehicle = planner.site, planner.vehicle
    if near:
        x_m = (x_m + 70.0) / 170.0 * 40.0 - 5.0
    start_m = (x_m, z_m)
    assume(clearances_m(site, [(x_m, 0.0, z_m)])[0] > 0.0)
    request = PlanRequest(
        mission=mission,
        target=site.targets[0].name if mission is Mission.INSPECTION else None,
        start_m=start_m,
        velocity_mps=(0.0, 0.0),
        weights=vehicle.weights[mission],
        risk=RiskIndices(),
    )
    answer = answer_job(known, PlanJob(job_id=1, request=request, fence=fence))
    if answer.plan is None:
        text = pilot_text(answer.reason, "denied")
        assert len(text) <= 50
        assert text.endswith(", denied")
        outside_m = site.workspace.outside_m(start_m)
        assert fence is not None or outside_m > vehicle.guidance.recovery_m, answer.reason
        return
    assert answer.narrowed_m == 0.0
    if answer.escape_m:
        judge_leg(planner, start_m, answer.escape_m, fence)
    path_m = samples(answer.plan.waypoints.position_m.tolist())
    room_m = clearances_m(site, [(x, 0.0, z) for x, z in path_m.tolist()], keep_out=True)
    # A path is checked at cell centres: between two of them it may be nearer by part of a cell.
    assert min(room_m) >= vehicle.radius_m - 0.5 * site.workspace.resolution_m
    assert answer.plan.waypoints.position_m[0] == pytest.approx(
        answer.escape_m[-1] if answer.escape_m else start_m,
        abs=0.5 * site.workspace.resolution_m + 1e-6,
    )


def refused(start_m, mission=Mission.EXIT, **changes):
    """The reason why an order from a place is denied."""
    known = planners("315kv_double_circuit", PX4)
    site = replace(known.exact.site, **changes)
    planner = Planner(site, known.exact.vehicle)
    request = PlanRequest(
        mission=mission,
        target=None,
        start_m=start_m,
        velocity_mps=(0.0, 0.0),
        weights=planner.vehicle.weights[mission],
        risk=RiskIndices(),
    )
    answer = answer_job(PlannerSet(planner), PlanJob(job_id=1, request=request))
    assert answer.plan is None
    return pilot_text(answer.reason, "denied")


def test_where_no_leg_is_free_the_pilot_receives_the_direction_to_fly():
    """A cage 2 m wide, too narrow for hull and margin, outside on each side, and inside."""
    known = planners("315kv_double_circuit", PX4)
    conductor = known.exact.site.obstacles[0]

    def cage(x_m, z_m):
        around = ((-1.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.0, -0.9))
        return tuple(
            replace(conductor, name=f"bar {n}", position_m=(x_m + dx, z_m + dz))
            for n, (dx, dz) in enumerate(around)
        )

    assert refused((101.0, 5.0)) == "MOAR: 71 m off workspace > 60, E, denied"
    assert refused((40.0, 6.0), obstacles=cage(40.0, 6.0)) == (
        "MOAR: 10.0 m off workspace: fly W, denied"
    )
    assert refused((-9.0, 6.0), obstacles=cage(-9.0, 6.0)) == (
        "MOAR: 9.0 m off workspace: fly E, denied"
    )
    assert refused((15.0, 24.0), obstacles=cage(15.0, 24.0)) == (
        "MOAR: 4.2 m off workspace: descend, denied"
    )
    assert refused((15.0, 1.2), obstacles=cage(15.0, 1.2)) == (
        "MOAR: height 1.2 m < 2: climb, denied"
    )
    assert refused((15.0, 10.0), obstacles=cage(15.0, 10.0)).startswith("MOAR: too near bar ")
