"""Drag that is learnt in flight, and the own motion that is not taken for wind meanwhile."""

from __future__ import annotations

import math
import random

import pytest

from moar_companion.risk.braking import Braking
from moar_companion.risk.drag_learning import DragLearning, apart_from_own_motion
from moar_companion.risk_model import RiskModel

MODEL = RiskModel(drag_per_m=0.0)


def windows(drag_per_s, speed_mps, wind_mps=0.0, gust_mps=0.0, count=60):
    """There and back along north, hovering between; wind from south is positive."""
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
def test_a_flight_there_and_back_tells_the_drag_in_calm_and_in_steady_wind(drag_per_s, wind_mps):
    learning = learnt(drag_per_s=drag_per_s, speed_mps=3.0, wind_mps=wind_mps)
    assert learning.drag_per_s(MODEL) == pytest.approx(drag_per_s, abs=0.03)
    assert abs(learning.drag_per_s(MODEL) - drag_per_s) < 3.0 * learning.error_per_s


def test_a_hover_tells_nothing_of_the_drag_and_the_file_stays():
    learning = learnt(drag_per_s=1.0, speed_mps=0.0, wind_mps=5.0)
    assert not learning.known(MODEL)
    assert learning.used(MODEL) == MODEL


def test_gusts_make_the_drag_less_sure():
    calm = learnt(drag_per_s=0.3, speed_mps=1.0)
    gusty = learnt(drag_per_s=0.3, speed_mps=1.0, gust_mps=3.0)
    assert gusty.error_per_s > 2.0 * calm.error_per_s


def test_the_drag_that_is_used_is_the_lesser_end_so_that_more_wind_is_told():
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
def test_what_the_own_motion_explains_is_not_told_as_wind(drag_per_s):
    rest, _ = apart_from_own_motion(still(0.7, drag_per_s), DragLearning(), MODEL)
    assert rest == pytest.approx(MODEL.drag_per_s * 0.7)


def test_a_hover_in_wind_and_a_lean_across_the_way_are_told_in_full():
    hover = Braking(time_s=0.0, velocity_ne_mps=(0.0, 0.0), deceleration_ne_mps2=(2.0, 0.0))
    assert apart_from_own_motion(hover, DragLearning(), MODEL) == (2.0, 0.0)
    across = Braking(time_s=0.0, velocity_ne_mps=(0.7, 0.0), deceleration_ne_mps2=(0.14, 2.0))
    _, east = apart_from_own_motion(across, DragLearning(), MODEL)
    assert east == pytest.approx(2.0)


@pytest.mark.parametrize("speed_mps", [2.0, -2.0])
def test_the_wind_that_a_hover_has_told_stays_on_a_leg_along_it(speed_mps):
    """It rises after 20 s of calm, and is hovered in for 5 s; the drag is the file's."""
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
