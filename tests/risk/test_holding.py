"""Greatest wind that can be held, by lean, motors and drag; and its check."""

from __future__ import annotations

import math

import pytest

from moar_companion import autopilots
from moar_companion.config import Supervision
from moar_companion.preflight.findings import Level
from moar_companion.preflight.risks import held_wind_finding
from moar_companion.risk.holding import held_wind_mps, tilt_limit
from moar_companion.risk_model import RiskModel
from tests.vehicles import named_vehicle

MODEL = RiskModel()


@pytest.mark.parametrize(
    ("kind", "parameters", "degrees", "source"),
    [
        (autopilots.PX4, {"MPC_TILTMAX_AIR": 45.0}, 45.0, "MPC_TILTMAX_AIR"),
        (autopilots.ARDUPILOT, {"ANGLE_MAX": 3000.0}, 30.0, "ANGLE_MAX"),
        (
            autopilots.ARDUPILOT,
            {"ANGLE_MAX": 3000.0, "PSC_ANGLE_MAX": 20.0},
            20.0,
            "PSC_ANGLE_MAX",
        ),
        (autopilots.ARDUPILOT, {"ANGLE_MAX": 3000.0, "PSC_ANGLE_MAX": 0.0}, 30.0, "ANGLE_MAX"),
        (autopilots.PX4, {"MPC_TILTMAX_AIR": None}, math.degrees(0.52), "risk.tilt_deg"),
        (
            autopilots.PX4,
            {"MPC_TILTMAX_AIR": 45.0, "MPC_THR_HOVER": 0.8},
            math.degrees(math.acos(0.8 / 0.9)),
            "MPC_THR_HOVER",
        ),
    ],
)
def test_the_lean_is_limited_by_a_parameter_the_motors_or_the_vehicle_file(
    kind, parameters, degrees, source
):
    limit_rad, found = tilt_limit(kind, parameters, MODEL)
    assert (math.degrees(limit_rad), found) == (pytest.approx(degrees), source)
    assert set(parameters) <= set(autopilots.profile(kind).holding_parameters)


def test_the_greatest_wind_that_can_be_held_leans_the_aircraft_to_its_limit():
    model = RiskModel(drag_per_s=1.0, drag_per_m=0.0)
    assert held_wind_mps(model, math.radians(45.0)) == pytest.approx(9.80665)


def test_the_check_names_the_limiting_wind_the_key_and_the_parameter():
    parameters = {"ANGLE_MAX": 2000.0}
    vehicle = named_vehicle("linedrone_uniform")
    finding = held_wind_finding(autopilots.ARDUPILOT, parameters, vehicle, Supervision())
    assert finding.level is Level.NOTE
    for word in ("ANGLE_MAX", "risk.drag_per_s", "supervision.wind_limit_mps"):
        assert word in finding.text
