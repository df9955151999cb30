from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from moar_companion.companion.contingency.route_cost import least_in_wind_s
from moar_companion.risk.drag import deceleration_mps2
from moar_companion.settings.config import shipped_configs
from moar_companion.settings.risk_model import Range, RiskModel
from moar_companion.settings.vehicle import Vehicle

X500 = Vehicle.load(shipped_configs() / "vehicles" / "x500.yaml")
GRAVITY_MPS2 = 9.80665
coordinates = st.floats(-20.0, 20.0)
winds = st.tuples(coordinates, coordinates)
steps = st.tuples(coordinates, coordinates, coordinates)
models = st.builds(
    RiskModel,
    drag_per_s=st.floats(0.05, 1.0),
    drag_per_m=st.floats(0.0, 0.1),
    tilt_rad=st.builds(Range, low=st.just(0.1), high=st.floats(0.2, 0.8)),
)


def taken_s(step_m, wind_mps, model):
    return float(least_in_wind_s(np.array([step_m]), wind_mps, replace(X500, risk=model))[0])


def lean_mps2(step_m, seconds, wind_mps, model):
    """Lean required to fly along a step in a time."""
    air = tuple(length / seconds - wind for length, wind in zip(step_m[:2], wind_mps, strict=True))
    return math.hypot(*deceleration_mps2(air, model))


def test_ten_metres_against_the_wind_agree_with_a_calculation_by_hand():
    # Leaning by 30 deg, (0.2 + 0.03 u) u = 5.66 m/s^2 at u = 10.8 m/s: 2.8 m/s against 8 m/s.
    model = RiskModel(drag_per_s=0.2, drag_per_m=0.03, tilt_rad=Range(low=0.1, high=math.pi / 6))
    assert taken_s((10.0, 0.0, 0.0), (-8.0, 0.0), model) == pytest.approx(10.0 / 2.8, rel=0.01)
    assert taken_s((10.0, 0.0, 0.0), (8.0, 0.0), model) == pytest.approx(10.0 / 18.8, rel=0.01)
    # Across the wind, 7.3 m/s are left of 10.8 m/s.
    assert taken_s((0.0, 10.0, 0.0), (8.0, 0.0), model) == pytest.approx(10.0 / 7.3, rel=0.01)


@given(step_m=steps, wind_mps=winds, model=models)
def test_the_duration_is_the_least_within_the_lean_limit(step_m, wind_mps, model):
    seconds = taken_s(step_m, wind_mps, model)
    slowest_s = math.hypot(*step_m) / X500.speed.min_mps * (1.0 + 1e-9)
    limit_mps2 = GRAVITY_MPS2 * math.tan(model.tilt_rad.high)
    assert 0.0 <= seconds <= slowest_s
    if 1e-3 < seconds < 0.999 * slowest_s:
        leans_mps2 = lean_mps2(step_m, seconds, wind_mps, model)
        assert leans_mps2 == pytest.approx(limit_mps2, rel=1e-6)
        assert lean_mps2(step_m, 0.99 * seconds, wind_mps, model) > limit_mps2


@given(step_m=steps, pair=st.tuples(st.floats(0.0, 40.0), st.floats(0.0, 40.0)), model=models)
def test_more_headwind_never_takes_less_time(step_m, pair, model):
    length_m = math.hypot(*step_m[:2]) or 1.0
    lighter_s, stronger_s = (
        taken_s(step_m, tuple(-wind / length_m * part for part in step_m[:2]), model)
        for wind in sorted(pair)
    )
    assert lighter_s <= stronger_s * (1.0 + 1e-9)


def test_a_headwind_beyond_the_lean_limit_is_flown_at_the_least_speed():
    against_s = taken_s((10.0, 0.0, 0.0), (-60.0, 0.0), RiskModel())
    assert against_s == pytest.approx(10.0 / X500.speed.min_mps)


def test_wind_does_not_slow_a_climb():
    assert taken_s((0.0, 0.0, 10.0), (8.0, 0.0), RiskModel()) == 0.0
