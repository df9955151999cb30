"""Drag learnt in flight, and the aircraft's own motion apart from the wind."""

from __future__ import annotations

import math
import random

import pytest

from moar_companion.risk.braking import Braking
from moar_companion.risk.drag_learning import DragLearning, apart_from_own_motion
from moar_companion.settings.risk_model import RiskModel

MODEL = RiskModel(drag_per_m=0.0)


def windows(drag_per_s, speed_mps, wind_mps=0.0, gust_mps=0.0, count=60):
    """Flight there and back along north, with hovers between; wind from south is positive."""
    dice = random.Random(3)
    for step in range(count):
        velocity_mps = speed_mps * (0.0, 1.0, 1.0, 0.0, -1.0, -1.0)[step // 5 % 6]
        air_mps = velocity_mps - wind_mps - dice.gauss(0.0, gust_mps)
        yield Braking(
            time_s=0.75 * step,
            velocity_ne_mps=(velocity_mps, 0.0),
            deceleration_ne_mps2=(drag_per_s * air_mps + dice.gauss(0.0, 0.03), 0.0),
        )


def learnt(**flight):
    learning = DragLearning()
    for air in windows(**flight):
        learning = learning.then(air, MODEL)
    return learning


@pytest.mark.parametrize("drag_per_s", [0.1, 0.25, 1.0])
@pytest.mark.parametrize("wind_mps", [0.0, 6.0])
def test_a_flight_there_and_back_gives_the_drag_in_calm_and_in_steady_wind(drag_per_s, wind_mps):
    learning = learnt(drag_per_s=drag_per_s, speed_mps=3.0, wind_mps=wind_mps)
    assert learning.drag_per_s(MODEL) == pytest.approx(drag_per_s, abs=0.03)
    assert abs(learning.drag_per_s(MODEL) - drag_per_s) < 3.0 * learning.error_per_s


def test_a_hover_gives_no_drag_and_the_vehicle_files_drag_is_used():
    learning = learnt(drag_per_s=1.0, speed_mps=0.0, wind_mps=5.0)
    assert not learning.known(MODEL)
    assert learning.used(MODEL) == MODEL


def test_gusts_increase_the_error_of_the_drag():
    calm = learnt(drag_per_s=0.3, speed_mps=1.0)
    gusty = learnt(drag_per_s=0.3, speed_mps=1.0, gust_mps=3.0)
    assert gusty.error_per_s > 2.0 * calm.error_per_s


def test_the_used_drag_is_the_lower_bound_so_that_the_wind_is_not_underestimated():
    learning = learnt(drag_per_s=1.0, speed_mps=3.0)
    used = learning.used(MODEL).drag_per_s
    assert learning.known(MODEL)
    assert used == pytest.approx(learning.drag_per_s(MODEL) - learning.error_per_s)


def still(velocity_mps, drag_per_s):
    return Braking(
        time_s=0.0,
        velocity_ne_mps=(velocity_mps, 0.0),
        deceleration_ne_mps2=(drag_per_s * velocity_mps, 0.0),
    )


@pytest.mark.parametrize("drag_per_s", [0.1, 0.3, 0.9])
def test_a_lean_explained_by_the_aircrafts_motion_is_not_reported_as_wind(drag_per_s):
    rest, _ = apart_from_own_motion(still(0.7, drag_per_s), DragLearning(), MODEL)
    assert rest == pytest.approx(MODEL.drag_per_s * 0.7)


def test_a_lean_in_hover_or_across_the_path_is_reported_in_full_as_wind():
    hover = Braking(time_s=0.0, velocity_ne_mps=(0.0, 0.0), deceleration_ne_mps2=(2.0, 0.0))
    assert apart_from_own_motion(hover, DragLearning(), MODEL) == (2.0, 0.0)
    across = Braking(time_s=0.0, velocity_ne_mps=(0.7, 0.0), deceleration_ne_mps2=(0.14, 2.0))
    _, east = apart_from_own_motion(across, DragLearning(), MODEL)
    assert east == pytest.approx(2.0)


@pytest.mark.parametrize("speed_mps", [2.0, -2.0])
def test_the_wind_estimated_in_a_hover_stays_on_a_leg_along_the_wind(speed_mps):
    """The wind rises after 20 s of calm, then a hover of 5 s; the drag is the file's."""
    learning, wind_mps = DragLearning(), 4.0
    for step in range(33):
        through_mps = 0.0 if step < 26 else -wind_mps
        braked = (MODEL.drag_per_s * through_mps, 0.0)
        air = Braking(time_s=0.75 * step, velocity_ne_mps=(0.0, 0.0), deceleration_ne_mps2=braked)
        learning = learning.then(air, MODEL)
    along = Braking(
        time_s=25.0,
        velocity_ne_mps=(speed_mps, 0.0),
        deceleration_ne_mps2=(MODEL.drag_per_s * (speed_mps - wind_mps), 0.0),
    )
    north, _ = apart_from_own_motion(along, learning, MODEL)
    assert speed_mps - north / MODEL.drag_per_s == pytest.approx(wind_mps, rel=0.15)


def test_a_lean_that_no_plausible_drag_explains_is_wind():
    rest, _ = apart_from_own_motion(still(0.7, 8.0), DragLearning(), MODEL)
    assert rest > 4.0
    assert math.isfinite(rest)
