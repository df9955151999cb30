"""The offboard stream: masks, frames, feed-forward, loss and return, as on PX4 v1.17.0."""

import math

import pytest

from .conftest import fly_square

NAN = math.nan


def _mode_after(flight, seconds=4.0):
    flight.run(seconds)
    return flight.truth.mode


@pytest.mark.parametrize(
    ("title", "options"),
    [
        ("position, velocity, yaw", {"mask": 0x9C0}),
        ("no yaw", {"mask": 0xDC0}),
        ("yaw rate", {"mask": 0x5C0, "yaw_rate": 0.3}),
        ("position only", {"mask": 0xDF8}),
        ("velocity only", {"mask": 0xDC7}),
        ("velocity xy, position z", {"mask": 0xDE3}),
        ("everything", {"mask": 0}),
        ("to component 0", {"component": 0}),
        ("to everyone", {"system": 0, "component": 0}),
        ("velocity in the body frame", {"mask": 0xDC7, "frame": 8}),
        ("position and velocity in the body frame", {"mask": 0xDC0, "frame": 8}),
    ],
)
def test_this_setpoint_keeps_offboard(airborne, title, options):
    airborne.hold_at(1.0, 0.0, -10.0, v=(0.2, 0.0, 0.0), **options)
    assert _mode_after(airborne) == "OFFBOARD", title


@pytest.mark.parametrize(
    ("title", "options"),
    [
        ("nothing asked for", {"mask": 0xDFF}),
        ("force bit", {"mask": 0x9C0 | 0x200}),
        ("position only in the body frame", {"mask": 0xDF8, "frame": 8}),
        ("local offset frame", {"frame": 7}),
        ("body offset frame", {"frame": 9}),
        ("body FRD frame", {"frame": 12}),
        ("local FRD frame", {"frame": 20}),
    ],
)
def test_this_setpoint_is_refused_with_a_text_and_ends_in_the_failsafe(airborne, title, options):
    start_s = airborne.now_s
    airborne.hold_at(1.0, 0.0, -10.0, **options)
    assert _mode_after(airborne, 1.3) == "AUTO.RTL", title
    refused = [t for t in airborne.gcs.texts(start_s) if t.startswith("SET_POSITION_TARGET")]
    assert len(refused) > 10, title


def test_all_nan_is_refused(airborne):
    airborne.hold_at(NAN, NAN, NAN, v=(NAN, NAN, NAN))
    assert _mode_after(airborne, 1.3) == "AUTO.RTL"


def test_a_setpoint_to_another_component_is_ignored_silently(airborne):
    start_s = airborne.now_s
    airborne.hold_at(component=195)
    assert _mode_after(airborne, 1.3) == "AUTO.RTL"
    assert not any("SET_POSITION" in text for text in airborne.gcs.texts(start_s))


def test_nan_in_one_position_axis_loses_the_position_without_a_text(airborne):
    airborne.hold_at(NAN, 5.0, -10.0)
    assert _mode_after(airborne) == "OFFBOARD"
    speed_mps = math.hypot(*airborne.truth.velocity_ned_mps)
    assert speed_mps < 0.5
    assert abs(airborne.truth.position_ned_m[1]) < 1.5


def test_velocity_is_feed_forward_without_a_speed_limit(airborne):
    airborne.hold_at(60.0, 0.0, -10.0, v=(0.7, 0.0, 0.0))
    fastest_mps = 0.0
    for _ in range(60):
        airborne.run(0.2)
        fastest_mps = max(fastest_mps, airborne.truth.velocity_ned_mps[0])
    assert fastest_mps > 8.0


@pytest.mark.slow
def test_a_moving_point_is_followed_within_half_a_metre(airborne):
    """PX4 itself: 0.46 m on average, 0.98 m at most, the noise of its receiver included."""
    errors = fly_square(airborne, 20)
    assert sum(errors) / len(errors) == pytest.approx(0.15, abs=0.02)
    assert max(errors) == pytest.approx(0.59, abs=0.06)


def test_yaw_is_followed_and_without_yaw_the_heading_drifts(airborne):
    airborne.hold_at(yaw=1.0)
    airborne.run(4.0)
    assert airborne.truth.attitude_rad[2] == pytest.approx(1.0, abs=0.03)
    airborne.hold_at(mask=0xDC0)
    airborne.run(4.0)
    drift_deg = abs(math.degrees(airborne.truth.attitude_rad[2] - 1.0))
    assert drift_deg == pytest.approx(4.2, abs=0.2)


@pytest.mark.parametrize("timeout_s", [0.5, 1.0, 2.0])
def test_the_failsafe_comes_com_of_loss_t_after_the_last_setpoint(airborne, timeout_s):
    airborne.vehicle.set_parameter("COM_OF_LOSS_T", timeout_s)
    airborne.stream = None
    start_s = airborne.now_s
    assert airborne.run(5.0, until=lambda f: f.truth.mode != "OFFBOARD")
    assert timeout_s <= airborne.now_s - start_s <= timeout_s + 0.15
    assert airborne.heartbeat().system_status == 5


@pytest.mark.parametrize(
    ("value", "mode"),
    [(0, "AUTO.RTL"), (1, "AUTO.RTL"), (3, "AUTO.RTL"), (4, "AUTO.LAND"), (5, "AUTO.LOITER")],
)
def test_com_obl_rc_act_chooses_the_offboard_loss_action_without_a_pilot(airborne, value, mode):
    airborne.vehicle.set_parameter("COM_OBL_RC_ACT", value)
    airborne.stream = None
    airborne.run(1.5)
    assert airborne.truth.mode == mode
    assert "Failsafe activated\t" in airborne.gcs.texts()
    airborne.hold_at()
    airborne.run(0.2)
    assert airborne.truth.mode == "OFFBOARD"  # by itself, when the stream comes back
    assert airborne.heartbeat().system_status == 4


@pytest.mark.parametrize(("value", "mode"), [(1, "AUTO.LOITER"), (2, "AUTO.RTL"), (3, "AUTO.LAND")])
def test_where_com_obl_rc_act_is_a_mode_of_the_sticks_nav_rcl_act_decides(airborne, value, mode):
    airborne.vehicle.set_parameter("COM_OBL_RC_ACT", 0)
    airborne.vehicle.set_parameter("NAV_RCL_ACT", value)
    airborne.stream = None
    airborne.run(1.5)
    assert airborne.truth.mode == mode


def test_with_sticks_the_loss_ends_in_position_mode(airborne):
    airborne.vehicle.move_sticks()
    airborne.stream = None
    airborne.run(1.5)
    assert airborne.truth.mode == "POSCTL"
    assert airborne.heartbeat().system_status == 5


def test_the_slowest_stream_that_holds_is_about_one_hertz(airborne):
    def slow(period_s):
        state = {"next": 0.0}

        def send(flight):
            if flight.now_s >= state["next"]:
                state["next"] = flight.now_s + period_s
                flight.companion.setpoint()

        return send

    airborne.stream = slow(0.96)
    seen = set()
    for _ in range(100):
        airborne.run(0.1)
        seen.add(airborne.truth.mode)
    assert seen == {"OFFBOARD"}
    airborne.stream = slow(1.3)
    for _ in range(50):
        airborne.run(0.1)
        seen.add(airborne.truth.mode)
    assert "AUTO.RTL" in seen


def test_a_companion_that_fails_at_speed_flies_on_for_com_of_loss_t(airborne):
    start_s = airborne.now_s
    airborne.stream = lambda f: f.companion.setpoint(
        3.0 * (f.now_s - start_s), 0.0, -10.0, v=(3.0, 0.0, 0.0)
    )
    airborne.run(6.0)
    airborne.vehicle.set_parameter("COM_OBL_RC_ACT", 5)
    x_m = airborne.truth.position_ned_m[0]
    airborne.stream = None
    airborne.run(6.0)
    assert airborne.truth.position_ned_m[0] - x_m > 2.5


def test_hold_from_the_ground_station_wins_at_once_and_stays(airborne):
    assert airborne.mode(airborne.gcs, (4, 3)) == [0, 0]
    airborne.run(5.0)
    assert airborne.truth.mode == "AUTO.LOITER"
    assert airborne.mode(airborne.companion, (6, 0)) == [0, 0]
    assert airborne.truth.mode == "OFFBOARD"


def test_return_to_offboard_flies_fast_to_the_setpoint_far_ahead(airborne):
    start_s = airborne.now_s
    airborne.stream = lambda f: f.companion.setpoint(0.7 * (f.now_s - start_s), v=(0.7, 0.0, 0.0))
    airborne.run(3.0)
    airborne.mode(airborne.gcs, (4, 3))
    airborne.run(20.0)
    airborne.mode(airborne.companion, (6, 0))
    speeds = airborne.watch(6.0, lambda f: f.truth.velocity_ned_mps[0])
    assert max(speeds) > 3.0


@pytest.mark.parametrize(("mode", "title"), [((2, 0), "ALTCTL"), ((1, 0), "MANUAL")])
def test_in_altitude_and_manual_mode_the_stick_leans_the_vehicle(airborne, mode, title):
    airborne.vehicle.move_sticks()
    airborne.run(0.2)
    assert airborne.mode(airborne.gcs, mode)[-1] == 0
    airborne.vehicle.move_sticks(pitch=0.6)
    airborne.run(1.5)
    assert airborne.truth.mode == title
    assert airborne.truth.attitude_rad[1] < -0.1
    assert airborne.truth.velocity_ned_mps[0] > 0.5


def test_position_mode_without_sticks_is_acked_and_then_refused(airborne):
    assert airborne.mode(airborne.gcs, (3, 0)) == [0, 1]
    assert "Switching to Position is currently not available\t" in airborne.gcs.texts()
    airborne.vehicle.move_sticks()
    airborne.run(0.2)
    assert airborne.mode(airborne.gcs, (3, 0)) == [0, 0]
    assert airborne.heartbeat().base_mode == 209


def test_sticks_have_no_effect_in_offboard_unless_com_rc_override_is_set(airborne):
    airborne.vehicle.move_sticks(roll=0.5)
    airborne.run(3.0)
    assert airborne.truth.mode == "OFFBOARD"
    airborne.vehicle.set_parameter("COM_RC_OVERRIDE", 3)
    airborne.run(1.0)
    assert airborne.truth.mode == "POSCTL"
    assert "Pilot took over using sticks\t" in airborne.gcs.texts()
    airborne.vehicle.move_sticks()
    airborne.run(3.0)
    assert airborne.truth.mode == "POSCTL"  # it stays the pilot's
    assert airborne.heartbeat().system_status == 4


def test_sticks_take_over_from_hold_by_default(airborne):
    airborne.vehicle.move_sticks()
    airborne.mode(airborne.gcs, (4, 3))
    airborne.vehicle.move_sticks(pitch=0.6)
    airborne.run(2.0)
    assert airborne.truth.mode == "POSCTL"
    assert airborne.truth.velocity_ned_mps[0] > 1.0


@pytest.mark.slow
def test_setpoints_are_followed_in_px4s_own_projection_not_on_the_ellipsoid(make_flight):
    flight = make_flight(latitude_deg=45.3781, longitude_deg=-71.9295, altitude_amsl_m=210.0)
    flight.take_off()
    start_s = flight.now_s

    def along(moving):
        y = min(400.0, 8.0 * (moving.now_s - start_s))
        moving.companion.setpoint(0.0, y, -10.0, v=(0.0, 8.0 if y < 400.0 else 0.0, 0.0))

    flight.stream = along
    flight.run(62.0)
    local = flight.companion.last("LOCAL_POSITION_NED")
    assert local.y == pytest.approx(400.0, abs=0.8)
    true_m = flight.truth.position_ned_m[1]
    assert true_m == pytest.approx(400.0 * (6_388_700.0 + 210.0) / 6_371_000.0, abs=0.8)
    assert true_m - local.y > 0.5
