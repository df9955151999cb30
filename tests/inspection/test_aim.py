"""Geometry of an aim, by hand examples and by rotation matrices."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from moar_companion.companion.estimation.plane_to_local import PlaneToLocal
from moar_companion.companion.inspection.aim import angle_rad, camera_axis, direction_to
from moar_companion.mavlink.gimbal import GimbalAttitude
from moar_companion.planner.site_frame import SiteFrame
from moar_companion.types import PX4, GeodeticPoint
from sitl.payload import _axes

ORIGIN = GeodeticPoint(latitude_deg=45.0, longitude_deg=-71.0, altitude_amsl_m=200.0)
PLANE = PlaneToLocal.between(SiteFrame(origin=ORIGIN, azimuth_deg=90.0), ORIGIN, PX4)
ANGLE = st.floats(-0.6, 0.6)


def attitude(pitch_rad, yaw_rad, *, by_servos=True, from_north=False):
    return GimbalAttitude(
        received_s=0.0,
        pitch_rad=pitch_rad,
        yaw_rad=yaw_rad,
        from_north=from_north,
        by_servos=by_servos,
    )


def test_a_point_ahead_and_above_has_its_heading_and_elevation():
    aim = direction_to((13.0, 14.0), (10.0, 0.0, 11.0), PLANE)
    assert math.degrees(aim.heading_rad) == pytest.approx(90.0, abs=0.1)
    assert math.degrees(aim.elevation_rad) == pytest.approx(45.0, abs=0.1)
    assert aim.distance_m == pytest.approx(3.0 * math.sqrt(2.0), rel=0.01)


def test_a_point_straight_below_has_no_heading():
    aim = direction_to((10.0, 5.0), (10.0, 0.0, 11.0), PLANE)
    assert aim.heading_rad is None
    assert angle_rad(aim, -math.pi / 2.0, 1.0) == pytest.approx(0.0, abs=1e-6)


@given(pitch=ANGLE, yaw=ANGLE, body=st.tuples(ANGLE, ANGLE, st.floats(-3.0, 3.0)))
def test_angles_of_servos_are_turned_by_the_body(pitch, yaw, body):
    forward = _axes(0.0, pitch, yaw)[0] @ _axes(*body)
    elevation, heading = math.asin(-forward[2]), math.atan2(forward[1], forward[0])
    away_m = (4.0 * math.cos(elevation) * math.sin(heading), 4.0 * math.sin(elevation))
    across_m = -4.0 * math.cos(elevation) * math.cos(heading)
    aim = direction_to(away_m, (0.0, across_m, 0.0), PLANE)
    axis = camera_axis(aim, attitude(pitch, yaw), body)
    assert angle_rad(aim, *axis) < math.radians(0.5)


def test_the_angles_of_a_gimbal_of_its_own_are_from_the_horizon():
    aim = direction_to((13.0, 11.0), (10.0, 0.0, 11.0), PLANE)
    known = attitude(0.2, 0.1, by_servos=False)
    assert camera_axis(aim, known, (0.3, -0.2, 1.5)) == (0.2, pytest.approx(1.6))
    assert np.isclose(angle_rad(aim, 0.2, 1.6), 0.2, atol=0.01)
