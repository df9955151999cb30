"""Greatest wind that can be held, by lean, motors and drag; and its check."""

from __future__ import annotations

import math

import pytest

from moar_companion.companion.preflight.findings import Level
from moar_companion.companion.preflight.risks import held_wind_finding
from moar_companion.mavlink import autopilots
from moar_companion.mavlink.autopilots.parameter_names import Parameters
from moar_companion.mavlink.telemetry import Attitude, Telemetry
from moar_companion.risk.holding import held_wind_mps, is_saturated, tilt_limit
from moar_companion.settings.config import Supervision
from moar_companion.settings.risk_model import RiskModel
from moar_companion.types import ARDUPILOT, PX4
from tests.vehicles import named_vehicle

from .conftest import HEALTHY

MODEL = RiskModel()


@pytest.mark.parametrize(
    ("kind", "parameters", "degrees", "source"),
    [
        (PX4, {"MPC_TILTMAX_AIR": 45.0}, 45.0, "MPC_TILTMAX_AIR"),
        (ARDUPILOT, {"ATC_ANGLE_MAX": 30.0}, 30.0, "ATC_ANGLE_MAX"),
        (
            ARDUPILOT,
            {"ATC_ANGLE_MAX": 30.0, "PSC_ANGLE_MAX": 20.0},
            20.0,
            "PSC_ANGLE_MAX",
        ),
        (
            ARDUPILOT,
            {"ATC_ANGLE_MAX": 30.0, "PSC_ANGLE_MAX": 0.0},
            30.0,
            "ATC_ANGLE_MAX",
        ),
        (PX4, {}, math.degrees(0.52), "risk.tilt_deg"),
        (PX4, {"MPC_TILTMAX_AIR": None}, 20.0, "MPC_TILTMAX_AIR"),
        (
            PX4,
            {"MPC_TILTMAX_AIR": 45.0, "MPC_THR_HOVER": 0.8},
            math.degrees(math.acos(0.8 / 0.9)),
            "MPC_THR_HOVER",
        ),
    ],
)
def test_the_lean_is_limited_by_a_parameter_the_motors_or_the_vehicle_file(
    kind, parameters, degrees, source
):
    limit_rad, found = tilt_limit(kind, Parameters(parameters), MODEL)
    assert (math.degrees(limit_rad), found) == (pytest.approx(degrees), source)
    assert set(parameters) <= set(autopilots.profile(kind).holding_parameters)


def test_the_greatest_wind_that_can_be_held_leans_the_aircraft_to_its_limit():
    model = RiskModel(drag_per_s=1.0, drag_per_m=0.0)
    assert held_wind_mps(model, math.radians(45.0)) == pytest.approx(9.80665)


def test_the_check_names_the_limiting_wind_the_key_and_the_parameter():
    parameters = Parameters({"ATC_ANGLE_MAX": 20.0})
    vehicle = named_vehicle("linedrone_uniform")
    finding = held_wind_finding(ARDUPILOT, parameters, vehicle, Supervision())
    assert finding.level is Level.NOTE
    for word in ("ATC_ANGLE_MAX", "risk.drag_per_s", "supervision.wind_limit_mps"):
        assert word in finding.text


def saturated(motor_output, **lean):
    attitude = Attitude(
        received_s=0.0, **{"roll_rad": 0.0, "pitch_rad": 0.0, "yaw_rad": 0.0, **lean}
    )
    telemetry = Telemetry(autopilot=HEALTHY["autopilot"](0.0), attitude=attitude)
    return is_saturated(telemetry, motor_output, 0.5, MODEL)


def test_motors_at_their_limit_are_saturated_at_any_lean():
    most = MODEL.motor_fraction.high
    assert saturated(most)
    assert not saturated(most - 0.01)
    assert not saturated(None)


def test_a_lean_at_its_limit_is_saturated_at_any_motor_output():
    assert saturated(None, roll_rad=0.5)
    assert saturated(0.5, pitch_rad=-0.5)
    assert not saturated(0.5, pitch_rad=-0.4)
