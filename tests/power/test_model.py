"""The power model: powers by phase, and the energy of paths."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from moar_companion.risk.power import PowerModel, landing_s
from moar_companion.settings.risk_model import RiskModel
from moar_companion.settings.vehicle import Power
from moar_companion.types import ARDUPILOT, PX4, UNKNOWN

from .aircraft import X500, model_of


def test_the_power_is_linear_between_flight_phases():
    model = model_of()
    speeds_mps = [(0, 0), (5, 0), (2.5, 0), (0, 3), (0, -1.5), (0, 1.5), (50, 0)]
    powers_w = [model.power_w(*speed_mps) for speed_mps in speeds_mps]
    assert powers_w == pytest.approx([300, 240, 270, 390, 270, 345, 240])


def test_the_energy_of_a_path_is_the_sum_of_its_phases():
    # 10 m level in 2 s, 6 m up in 2 s, a wait of 3 s.
    points = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [10.0, 0.0, 6.0], [10.0, 0.0, 6.0]])
    used_wh = model_of().path_wh(points, np.array([2.0, 2.0, 3.0]))
    assert used_wh == pytest.approx((2 * 240 + 2 * 390 + 3 * 300) / 3600.0)
    stop = model_of().path_wh(points[[0, 0]], np.array([0.0]))
    assert stop == 0.0


def test_missing_powers_follow_from_hover_power_and_endurance():
    model = PowerModel.of(replace(X500, power=Power(hover_w=200.0)))
    # Climbing at 3 m/s through air that sinks at 6 m/s: x + sqrt(1 + x^2), x = 3 / 12.
    assert (model.cruise_w, model.climb_w, model.descent_w) == pytest.approx(
        (200, 256.2, 200), 1e-3
    )
    assert model.capacity_wh == pytest.approx(200.0 * 900.0 / 3600.0)
    assert not model.capacity_known


def test_the_duration_of_a_landing_depends_on_the_autopilot():
    # 2.1 m at 0.7 m/s and 5 s on the ground; at 0.5 m/s and 1 s.
    assert landing_s(2.1, PX4) == pytest.approx(8.0)
    assert landing_s(2.1, ARDUPILOT) == pytest.approx(5.2)
    assert landing_s(2.1, UNKNOWN) == pytest.approx(9.2)
    assert model_of().landing_wh(2.1, PX4) == pytest.approx(8.0 * 300.0 / 3600.0)


def test_the_sections_of_a_vehicle_file_make_the_power_model():
    model = PowerModel.made(Power(capacity_wh=77.0), RiskModel(cells=6), 4.0, 2.0, 1.0)
    assert (model.capacity_wh, model.capacity_known, model.cells) == (77.0, True, 6)
    assert (model.cruise_mps, model.climb_mps, model.descent_mps) == (4.0, 2.0, 1.0)
