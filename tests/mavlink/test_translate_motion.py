from __future__ import annotations

import math

import pytest

from moar_companion.mavlink.telemetry import LandedState

from .messages import updated

NAN = math.nan


def test_a_local_position_has_the_autopilots_clock():
    telemetry = updated(
        "LOCAL_POSITION_NED", time_boot_ms=2500, x=1.0, y=2.0, z=-3.0, vx=4.0, vy=5.0, vz=6.0
    )
    position = telemetry.local_position
    assert position.boot_s == 2.5
    assert position.position_ned_m == (1.0, 2.0, -3.0)
    assert position.velocity_ned_mps == (4.0, 5.0, 6.0)


@pytest.mark.parametrize("field", ["x", "y", "z", "vx", "vy", "vz"])
@pytest.mark.parametrize("value", [NAN, math.inf, -math.inf])
def test_a_position_that_is_not_finite_is_dropped(field, value):
    before = updated("LOCAL_POSITION_NED", x=1.0)
    after = updated("LOCAL_POSITION_NED", before, now_s=11.0, **{field: value})
    assert after is before


def covariance(x_m2, y_m2, z_m2=4.0):
    """Covariance as PX4 fills it: variances on the diagonal, the rest unknown."""
    triangle = [NAN] * 21
    triangle[0], triangle[6], triangle[11] = x_m2, y_m2, z_m2
    return triangle


def test_odometry_gives_resets_and_the_accuracy_of_the_position():
    odometry = updated(
        "ODOMETRY", frame_id=1, reset_counter=255, pose_covariance=covariance(0.09, 0.16)
    ).odometry
    assert odometry.reset_counter == 255
    assert odometry.horizontal_accuracy_m == pytest.approx(0.5)
    assert odometry.vertical_accuracy_m == pytest.approx(2.0)
    assert odometry.received_s == 10.0


@pytest.mark.parametrize(("x_m2", "y_m2"), [(NAN, 0.1), (0.1, NAN), (0.0, 0.0), (-1.0, 0.5)])
def test_an_odometry_without_a_variance_still_gives_resets(x_m2, y_m2):
    odometry = updated(
        "ODOMETRY", frame_id=1, reset_counter=3, pose_covariance=covariance(x_m2, y_m2)
    ).odometry
    assert (odometry.reset_counter, odometry.horizontal_accuracy_m) == (3, None)
    assert odometry.vertical_accuracy_m == 2.0


@pytest.mark.parametrize("z_m2", [NAN, 0.0, -1.0])
def test_an_odometry_without_a_height_accuracy_has_a_horizontal_accuracy(z_m2):
    odometry = updated(
        "ODOMETRY", frame_id=1, pose_covariance=covariance(0.09, 0.16, z_m2)
    ).odometry
    assert odometry.horizontal_accuracy_m == pytest.approx(0.5)
    assert odometry.vertical_accuracy_m is None


@pytest.mark.parametrize(
    ("case", "fields"),
    [
        ("the odometry has failed", {"frame_id": 1, "quality": -1}),
        ("the pose is in the body's frame", {"frame_id": 12}),
    ],
)
def test_an_odometry_in_another_frame_is_unknown(case, fields):
    known = updated("ODOMETRY", frame_id=20, reset_counter=3)
    assert known.odometry is not None
    assert updated("ODOMETRY", known, **fields).odometry is None, case


def test_an_attitude_that_is_not_finite_is_dropped():
    assert updated("ATTITUDE", yaw=NAN).attitude is None
    assert updated("ATTITUDE", roll=0.5).attitude.roll_rad == 0.5


def test_home_and_origin_become_degrees_and_metres():
    telemetry = updated(
        "GPS_GLOBAL_ORIGIN", latitude=453780000, longitude=-719290000, altitude=200100
    )
    point = telemetry.local_origin.point
    assert point.latitude_deg == pytest.approx(45.378)
    assert point.longitude_deg == pytest.approx(-71.929)
    assert point.altitude_amsl_m == pytest.approx(200.1)
    telemetry = updated("GLOBAL_POSITION_INT", lat=453780000, lon=-719290000, alt=210000)
    assert telemetry.global_position.point.altitude_amsl_m == pytest.approx(210.0)
    telemetry = updated("HOME_POSITION", latitude=1, longitude=2, altitude=3, x=1.0, y=2.0, z=3.0)
    assert telemetry.home.position_ned_m == (1.0, 2.0, 3.0)


def test_zero_coordinates_of_ardupilot_are_no_position():
    assert updated("GLOBAL_POSITION_INT", alt=1).global_position is None
    assert updated("GPS_GLOBAL_ORIGIN").local_origin is None
    assert updated("HOME_POSITION").home is None
    assert updated("HOME_POSITION", latitude=1, longitude=1, x=NAN).home is None


def test_the_landed_state_may_be_unknown():
    telemetry = updated("EXTENDED_SYS_STATE", landed_state=2)
    assert telemetry.landed.state is LandedState.IN_AIR
    assert updated("EXTENDED_SYS_STATE", telemetry, landed_state=0).landed is None
    assert updated("EXTENDED_SYS_STATE", telemetry, landed_state=77).landed is None


def test_px4s_wind_points_downwind():
    wind = updated("WIND_COV", wind_x=-5.0, wind_y=1.0, wind_z=NAN).wind
    assert wind.velocity_ned_mps == (-5.0, 1.0, 0.0)


@pytest.mark.parametrize(
    ("var_horiz", "deviation_mps"),
    [(0.32, 0.4), (0.0, None), (NAN, None), (math.inf, None), (-1.0, None)],
)
def test_px4s_variance_is_the_sum_of_two(var_horiz, deviation_mps):
    wind = updated("WIND_COV", wind_x=1.0, var_horiz=var_horiz).wind
    assert wind.deviation_mps == pytest.approx(deviation_mps)


@pytest.mark.parametrize("var_horiz", [0.0, NAN])
def test_px4s_zero_wind_without_a_variance_is_unknown(var_horiz):
    known = updated("WIND_COV", wind_x=1.0, var_horiz=0.1)
    assert updated("WIND_COV", known, var_horiz=var_horiz).wind is None
    assert updated("WIND_COV", known, var_horiz=0.1).wind.velocity_ned_mps == (0.0, 0.0, 0.0)


def test_ardupilots_wind_direction_points_upwind():
    wind = updated("WIND", direction=90.0, speed=5.0, speed_z=0.5).wind
    assert wind.velocity_ned_mps == pytest.approx((0.0, -5.0, 0.5))


def test_ardupilots_wind_of_0_from_minus_180_is_unknown():
    known = updated("WIND", direction=90.0, speed=5.0)
    assert updated("WIND", known, direction=-180.0, speed=0.0).wind is None
    assert updated("WIND", direction=20.0, speed=0.0).wind.velocity_ned_mps == (0.0, 0.0, 0.0)


def test_a_wind_that_is_not_a_number_is_unknown():
    known = updated("WIND_COV", wind_x=1.0)
    assert updated("WIND_COV", known, wind_x=NAN).wind is None
    assert updated("WIND", known, speed=NAN).wind is None
