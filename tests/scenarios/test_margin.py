"""The margin in flight: no true collision under wind and errors of the estimate."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from moar_companion.planner.site import Polygon, Site, Target
from moar_companion.settings.config import shipped_configs

from ..copies import flown_once
from ..flights.judging import (
    assert_nothing_was_touched,
    assert_setpoints_keep_to_free_space,
    true_places,
)
from ..flights.lockstep import hovering
from ..flights.operator import DENIED, EXIT, INSPECTION, Manner
from ..thorough import sampled
from .marks import ARDUPILOT_FIRST

BESIDE_M = 3.6
"""From the target to the wall: the margin of PX4, an X500, and a cell."""


def site_with_a_wall(beside_m=BESIDE_M):
    """A target beside a wall without a keep-out of its own."""
    site = Site.load(shipped_configs() / "sites" / "315kv_double_circuit.yaml")
    wall = Polygon(name="wall", vertices_m=((10.0, 0.0), (16.0, 0.0), (16.0, 14.0), (10.0, 14.0)))
    target = Target(name="crack", position_m=(16.0 + beside_m, 8.0), dwell_s=20.0)
    return replace(site, obstacles=(wall,), targets=(target,))


@flown_once
def beside_the_wall():
    """A flight that is at the target beside the wall."""
    flight = hovering(site=site_with_a_wall(), vehicle="x500", start_m=(20.0, 0.0))
    flight.begin(INSPECTION, 0)
    flight.run_until_state("at_target", 90.0)
    return flight


@pytest.mark.slow
@ARDUPILOT_FIRST
def test_beside_a_wall_without_a_keep_out_wind_causes_no_collision(manner):
    flight = hovering(site=site_with_a_wall(), vehicle="x500", manner=manner, start_m=(20.0, 0.0))
    flight.autopilot.conditions.wind_mps = 6.3
    flight.autopilot.conditions.wind_from_deg = 90.0  # towards the wall
    flight.begin(INSPECTION, 0)
    flight.run_until_state("at_target", 90.0)
    flight.run(15.0)
    assert_nothing_was_touched(flight)
    assert_setpoints_keep_to_free_space(flight)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("manner", "factor", "error_m"),
    sampled([(Manner.PX4, 3.0, 0.8)], [(Manner.PX4, 3.0, 0.8), (Manner.ARDUPILOT, 4.0, 0.5)]),
)
def test_beside_a_wall_an_error_beyond_the_reported_accuracy_causes_no_collision(
    manner, factor, error_m
):
    """The greatest error that was measured of each autopilot; the reported accuracy hides it."""
    flight = hovering(site=site_with_a_wall(), vehicle="x500", manner=manner)
    flight.autopilot.conditions.gps_noise_factor = factor
    flight.autopilot.conditions.wind_mps = 4.5
    flight.autopilot.conditions.wind_from_deg = 90.0  # towards the wall
    flight.begin(INSPECTION, 0)
    errors_m, reported_m = [], []
    for _ in range(60):
        flight.run(1.0)
        errors_m.append(math.dist(flight.companion.pose.position_m, true_places(flight)[-1]))
        reported_m.append(flight.companion.risk.indices.localization)
    assert flight.state in {"at_target", "holding"}
    assert max(errors_m) > error_m, max(errors_m)
    assert max(reported_m[5:]) < 0.2  # at first the accuracy is unknown, which raises the risk
    assert_nothing_was_touched(flight)


@pytest.mark.parametrize(
    ("manner", "beside_m", "margin"), [(Manner.PX4, 2.5, "2.55"), (Manner.ARDUPILOT, 1.2, "1.4")]
)
def test_a_target_nearer_to_the_wall_than_the_margin_is_denied(manner, beside_m, margin):
    flight = hovering(site=site_with_a_wall(beside_m), vehicle="x500", manner=manner)
    flight.operator.mission(INSPECTION, 0)
    flight.run(2.0)
    assert flight.operator.answers()[-1] == DENIED
    assert flight.operator.has_received(f"MOAR: no path with margin {margin} m, denied")
    assert not flight.setpoints


@pytest.mark.slow
@pytest.mark.parametrize("east_m", [2.5, -2.5])
def test_an_estimator_jump_greater_than_the_remaining_margin_holds_the_mission(east_m):
    flight = beside_the_wall()
    flight.autopilot.jump(0.0, east_m)
    flight.run(1.0)
    assert flight.state == "holding"
    assert flight.operator.has_received("MOAR: the position jumped 2.5 m > ")
    flight.run(10.0)
    assert_nothing_was_touched(flight)


@pytest.mark.slow
@pytest.mark.parametrize("manner", sampled([Manner.ARDUPILOT], list(Manner)))
def test_an_exit_that_the_margin_blocks_is_flown_with_the_largest_margin_that_fits(manner):
    """Through a window in a tower, 4.2 m high (PX4) or 3.4 m (ArduPilot)."""
    gap_m = 4.2 if manner is Manner.PX4 else 3.4
    walls = tuple(
        Polygon(name=name, vertices_m=((14.0, low), (15.0, low), (15.0, high), (14.0, high)))
        for name, low, high in (
            ("lower wall", -5.0, 10.05 - 0.5 * gap_m),
            ("upper wall", 10.05 + 0.5 * gap_m, 30.0),
        )
    )
    site = site_with_a_wall()
    site = replace(site, obstacles=walls, targets=(), start_m=(4.0, 2.5))
    flight = hovering(site=site, vehicle="x500", manner=manner)
    flight.begin(EXIT)
    flight.run_until_state("holding", 120.0)
    flight.run(1.0)
    assert flight.operator.has_received(" wall < ")
    assert flight.operator.has_received("MOAR: above the landing point, holding")
    assert not flight.operator.has_received("no room here")
    assert_nothing_was_touched(flight)
