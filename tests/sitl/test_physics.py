"""Quadrotor, battery, wind, sensors and geodesy on their own."""

import math
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sitl.autopilot import FakeAutopilot, Options
from sitl.battery import Battery, BatteryOptions
from sitl.conditions import Conditions, Wind
from sitl.geodesy import FlatProjection, Geodetic, SphereProjection, TrueFrame
from sitl.quadrotor import GRAVITY_MPS2, Airframe, Quadrotor

DT = 0.01


def _flying(**demand):
    quad = Quadrotor(Airframe(), 0.0)
    quad.demand.spinning = True
    quad.d = -50.0
    quad.on_ground = False
    quad.thrust = 0.5
    quad.demand.thrust = 0.5
    for name, value in demand.items():
        setattr(quad.demand, name, value)
    return quad


def test_at_hover_thrust_the_vehicle_keeps_its_position():
    quad = _flying()
    for _ in range(1000):
        quad.step(DT, 0.0, 0.0, 0.0)
    assert math.dist((quad.n, quad.e, quad.d), (0.0, 0.0, -50.0)) < 0.01


def test_terminal_speed_at_a_tilt_is_g_tan_tilt_over_drag():
    quad = _flying(pitch_rad=-0.3)
    quad.demand.thrust = 0.5 / math.cos(0.3)
    for _ in range(4000):
        quad.step(DT, 0.0, 0.0, 0.0)
    assert quad.vn == pytest.approx(GRAVITY_MPS2 * math.tan(0.3) / 0.3, rel=0.01)
    assert quad.vd == pytest.approx(0.0, abs=0.01)


def test_without_thrust_the_vehicle_drifts_with_the_wind_and_falls():
    quad = _flying(thrust=0.0)
    for _ in range(3000):
        quad.d = -50.0
        quad.step(DT, 4.0, -3.0, 0.0)
    assert (quad.vn, quad.ve) == (pytest.approx(4.0, abs=0.01), pytest.approx(-3.0, abs=0.01))
    assert quad.vd > 20.0


def test_roll_to_the_right_goes_east_when_heading_north_and_south_when_heading_east():
    quad = _flying(roll_rad=0.2)
    for _ in range(200):
        quad.step(DT, 0.0, 0.0, 0.0)
    assert quad.e > 0.5
    assert abs(quad.n) < 0.01
    quad = _flying(roll_rad=0.2, yaw_rad=math.pi / 2)
    quad.yaw = math.pi / 2
    for _ in range(200):
        quad.step(DT, 0.0, 0.0, 0.0)
    assert quad.n < -0.5


def test_the_ground_holds_the_vehicle_and_thrust_lifts_it():
    quad = Quadrotor(Airframe(), 0.0)
    quad.demand.spinning = True
    for _ in range(200):
        quad.step(DT, 8.0, 0.0, 0.0)
    assert (quad.n, quad.d, quad.on_ground) == (0.0, 0.0, True)
    quad.demand.thrust = 0.6
    for _ in range(100):
        quad.step(DT, 0.0, 0.0, 0.0)
    assert quad.d < -0.3
    quad.demand.thrust = 0.4
    for _ in range(1000):
        quad.step(DT, 0.0, 0.0, 0.0)
        assert quad.d <= 0.0
    assert quad.on_ground


@given(
    st.floats(-0.7, 0.7), st.floats(-0.7, 0.7), st.floats(0.0, 1.0), st.floats(-15.0, 15.0)
)  # fmt: skip
def test_whatever_is_demanded_the_state_stays_finite_above_ground_and_outputs_in_range(
    roll, pitch, thrust, wind
):
    quad = _flying(roll_rad=roll, pitch_rad=pitch, thrust=thrust)
    for _ in range(100):
        quad.step(DT, wind, -wind, 0.0)
        assert all(0.0 <= output <= 1.0 for output in quad.motor_outputs())
    assert math.isfinite(quad.n + quad.e + quad.vd)
    assert quad.d <= 0.0


def test_motors_are_at_zero_when_stopped_and_near_half_in_hover():
    quad = Quadrotor(Airframe(), 0.0)
    assert quad.motor_outputs() == (0.0, 0.0, 0.0, 0.0)
    assert _flying().motor_outputs() == pytest.approx((0.5,) * 4)


def test_power_rises_with_thrust_to_the_power_of_one_and_a_half():
    quad = _flying()
    hover_w = quad.power_w() - 12.0
    quad.thrust = 1.0
    assert quad.power_w() - 12.0 == pytest.approx(hover_w * 2.0**1.5)


def test_the_battery_of_90_wh_gives_90_w_for_an_hour():
    battery = Battery(BatteryOptions(capacity_wh=90.0))
    for _ in range(3600):
        battery.step(1.0, 45.0, 1.0, armed=True)
    assert battery.fraction == pytest.approx(0.5)
    battery.step(1.0, 45.0, 3600.0, armed=True)
    assert battery.fraction == 0.0
    assert battery.open_circuit_v == pytest.approx(14.4)


def test_the_voltage_sags_by_current_times_resistance():
    battery = Battery(BatteryOptions(resistance_ohm=0.01))
    assert battery.voltage_v == pytest.approx(16.2)
    battery.step(0.1, 324.0, 1.0, armed=True)
    assert battery.current_a == pytest.approx(20.0)
    assert battery.open_circuit_v - battery.voltage_v == pytest.approx(0.2)


def test_wind_from_the_west_blows_to_the_east():
    wind = Wind(random.Random(1))
    wind.step(0.0, Conditions(wind_mps=7.0, wind_from_deg=270.0))
    assert wind.ned_mps == pytest.approx((0.0, 7.0, 0.0), abs=1e-9)


def test_gusts_have_the_asked_spread_about_the_mean():
    wind = Wind(random.Random(1))
    conditions = Conditions(wind_mps=8.0, wind_from_deg=180.0, gust_mps=1.5)
    along = []
    for i in range(40_000):
        wind.step(i * 0.05, conditions)
        along.append(wind.ned_mps[0])
    mean = sum(along) / len(along)
    spread = math.sqrt(sum((v - mean) ** 2 for v in along) / len(along))
    assert mean == pytest.approx(8.0, abs=0.2)
    assert spread == pytest.approx(1.5, rel=0.1)


ZURICH = Geodetic(latitude_deg=47.397742, longitude_deg=8.545594, altitude_amsl_m=489.4)


def test_a_degree_of_latitude_at_45_degrees_is_111132_m():
    frame = TrueFrame(Geodetic(latitude_deg=45.0, longitude_deg=0.0, altitude_amsl_m=0.0))
    assert 1.0 / frame.deg_per_m_north == pytest.approx(111_132.0, abs=5.0)
    assert 1.0 / frame.deg_per_m_east == pytest.approx(78_847.0, abs=5.0)


@given(st.floats(-3000, 3000), st.floats(-3000, 3000), st.floats(-200, 10))
def test_true_frame_there_and_back(north_m, east_m, down_m):
    frame = TrueFrame(ZURICH)
    back = frame.ned(frame.geodetic(north_m, east_m, down_m))
    assert back == pytest.approx((north_m, east_m, down_m), abs=1e-6)


@pytest.mark.parametrize("kind", [SphereProjection, FlatProjection])
@given(st.floats(-3000, 3000), st.floats(-3000, 3000))
def test_an_autopilots_projection_there_and_back(kind, north_m, east_m):
    projection = kind(ZURICH.latitude_deg, ZURICH.longitude_deg)
    back = projection.project(*projection.reproject(north_m, east_m))
    assert back == pytest.approx((north_m, east_m), abs=1e-3)


def test_px4s_map_and_the_ellipsoid_differ_by_metres_per_kilometre():
    frame = TrueFrame(ZURICH)
    place = frame.geodetic(1000.0, 1000.0, 0.0)
    projection = SphereProjection(ZURICH.latitude_deg, ZURICH.longitude_deg)
    north_m, east_m = projection.project(place.latitude_deg, place.longitude_deg)
    assert 0.1 < abs(north_m - 1000.0) < 3.0
    assert 1.0 < abs(east_m - 1000.0) < 5.0


def test_ardupilots_map_scales_degrees_by_one_radius_and_the_middle_latitude():
    flat = FlatProjection(60.0, 10.0)
    north_m, east_m = flat.project(60.001, 10.001)
    assert north_m == pytest.approx(111.3189, abs=0.001)
    assert east_m == pytest.approx(111.3189 * math.cos(math.radians(60.0005)), abs=0.001)
    assert flat.project(60.0, 10.0) == (0.0, 0.0)


def test_quadratic_drag_leans_as_ardupilots_simulation_does():
    quad = _flying(pitch_rad=-math.radians(30.0))
    quad.airframe = Airframe(drag_per_s=0.265, drag_per_m=0.030)
    quad.demand.thrust = 0.5 / math.cos(math.radians(30.0))
    for _ in range(4000):
        quad.step(DT, 0.0, 0.0, 0.0)
    assert quad.vn == pytest.approx(10.0, abs=0.2)


def test_a_false_heading_turns_the_thrust_and_not_the_aircraft():
    quad = _flying(pitch_rad=-0.1)
    quad.mislead(math.radians(90.0))
    quad.demand.yaw_rad = quad.yaw
    for _ in range(300):
        quad.step(DT, 0.0, 0.0, 0.0)
    assert quad.yaw == pytest.approx(math.radians(90.0))
    assert quad.true_yaw == pytest.approx(0.0)
    assert quad.vn > 1.0
    assert quad.ve == pytest.approx(0.0, abs=1e-6)
    quad.mislead(0.0)
    assert quad.yaw == pytest.approx(0.0)


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_an_autopilot_with_a_false_heading_reports_what_it_believes(autopilot):
    fake = FakeAutopilot(Options(autopilot=autopilot))
    fake.step(1.0)
    fake.conditions.heading_error_deg = 20.0
    fake.step(2.0)
    assert math.degrees(fake.truth.attitude_rad[2]) == pytest.approx(0.0, abs=0.1)
    assert math.degrees(fake._world.quad.yaw) == pytest.approx(20.0, abs=0.1)
