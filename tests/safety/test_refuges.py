"""The leg at the loss of the fix, by its time."""

from __future__ import annotations

from dataclasses import replace

import pytest

from moar_companion.companion.safety.refuges import BLIND_LEG_M, blind_leg_m
from tests.vehicles import named_vehicle

VEHICLE = named_vehicle("linedrone_uniform")


def leg_m(speed_mps, acceleration_mps2):
    speed = replace(VEHICLE.speed, horizontal_mps=speed_mps, max_mps=speed_mps)
    guidance = replace(VEHICLE.guidance, acceleration_mps2=acceleration_mps2)
    return blind_leg_m(replace(VEHICLE, speed=speed, guidance=guidance))


def test_the_leg_ends_with_its_braking_before_the_autopilot_lands():
    assert leg_m(0.7, 1.0) == pytest.approx(0.7 * (5.0 - 1.5 - 0.7 - 0.7))
    assert leg_m(1.5, 1.0) == pytest.approx(0.25 * 2.0**2)


def test_the_leg_is_no_longer_than_the_estimate_is_good_for():
    assert leg_m(5.0, 20.0) == BLIND_LEG_M
