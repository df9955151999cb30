"""GUIDED: setpoints, masks, frames, silence and override, as measured on ArduCopter 4.6.3."""

import math

import pytest
from pymavlink.dialects.v20 import all as mavlink

from .conftest import Peer, fly_square

NAN = math.nan
GUIDED, LOITER, ALT_HOLD = 4, 5, 2
POSITION_VELOCITY, POSITION_ONLY, VELOCITY_ONLY = 0xDC0, 0xDF8, 0xDC7


@pytest.mark.slow
def test_a_moving_point_is_followed_within_seven_centimetres_on_average(hovering):
    errors = fly_square(hovering, 20, mask=POSITION_VELOCITY)
    assert sum(errors) / len(errors) == pytest.approx(0.07, abs=0.01)
    assert max(errors) == pytest.approx(0.51, abs=0.05)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rate_hz", "mean_m", "largest_m"), [(5, 0.08, 0.63), (2, 0.09, 0.86), (1, 0.11, 1.13)]
)
def test_with_fewer_setpoints_a_second_ardupilot_strays_farther_in_the_corners(
    hovering, rate_hz, mean_m, largest_m
):
    errors = fly_square(hovering, rate_hz, mask=POSITION_VELOCITY)
    assert sum(errors) / len(errors) == pytest.approx(mean_m, abs=0.01)
    assert max(errors) == pytest.approx(largest_m, abs=0.05)


@pytest.mark.parametrize("mask", [0xDC0, 0xC00, 0x9C0, 0x5C0, 0x000, 0xFC0])
def test_a_setpoint_with_these_masks_is_flown_as_position_and_velocity(hovering, mask):
    hovering.stream = lambda f: f.companion.setpoint(2.0, 0.0, -10.0, v=(0.5, 0, 0), mask=mask)
    hovering.run(12.0)
    target = hovering.vehicle.manner.guided_target
    assert target.position_ned_m is not None
    assert target.velocity_ned_mps == (0.5, 0.0, 0.0)
    assert hovering.local_m[0] == pytest.approx(2.5, abs=0.2)


def test_a_constant_position_with_a_velocity_settles_one_second_beyond_the_position(hovering):
    hovering.stream = lambda f: f.companion.setpoint(5.0, 0.0, -10.0, v=(0.8, 0.0, 0.0))
    hovering.run(20.0)
    assert hovering.local_m[0] - 5.0 == pytest.approx(0.8, abs=0.2)


def test_velocity_only_and_position_only(hovering):
    hovering.stream = lambda f: f.companion.setpoint(
        99.0, 99.0, -99.0, v=(0.7, 0, 0), mask=VELOCITY_ONLY
    )
    hovering.run(5.0)
    assert hovering.truth.velocity_ned_mps[0] == pytest.approx(0.7, abs=0.15)
    assert hovering.vehicle.manner.guided_target.position_ned_m is None
    hovering.stream = lambda f: f.companion.setpoint(
        2.0, 0.0, -10.0, v=(9, 9, 9), mask=POSITION_ONLY
    )
    hovering.run(12.0)
    assert math.dist(hovering.local_m, (2.0, 0.0, -10.0)) < 0.25


@pytest.mark.parametrize(
    ("title", "options"),
    [
        ("position and acceleration", {"mask": 0xC38}),
        ("nothing", {"mask": 0xDFF}),
        ("one axis of velocity", {"mask": 0xDE3}),
        ("frame 0", {"frame": 0}),
        ("frame 12", {"frame": 12}),
        ("frame 20", {"frame": 20}),
        ("NaN velocity", {"v": (NAN, 0.0, 0.0)}),
    ],
)
def test_a_setpoint_that_cannot_be_flown_stops_the_vehicle(hovering, title, options):
    hovering.along(0.7)
    hovering.run(5.0)
    hovering.stream = lambda f: f.companion.setpoint(50.0, **options)
    hovering.run(4.0)
    assert hovering.vehicle.manner.guided_target.velocity_ned_mps == (0.0, 0.0, 0.0), title
    assert math.hypot(*hovering.truth.velocity_ned_mps) < 0.2
    assert hovering.truth.mode == "GUIDED"


def test_a_force_bit_with_acceleration_is_ignored(hovering):
    hovering.along(0.7)
    hovering.run(5.0)
    before = hovering.vehicle.manner.guided_target
    hovering.stream = None
    hovering.companion.setpoint(50.0, mask=0xE00)
    hovering.run(0.1)
    assert hovering.vehicle.manner.guided_target.velocity_ned_mps == before.velocity_ned_mps


@pytest.mark.parametrize(("frame", "turned"), [(7, False), (8, True), (9, True)])
def test_relative_frames_are_applied_again_with_every_packet(hovering, frame, turned):
    hovering.stream = lambda f: f.companion.setpoint(0.0, 0.0, -10.0, yaw=math.pi / 2)
    hovering.run(4.0)
    hovering.stream = lambda f: f.companion.setpoint(1.0, 0.0, 0.0, mask=0xDC0, frame=frame)
    x_m, y_m, _ = hovering.local_m
    hovering.run(8.0)
    ahead_m, aside_m = hovering.local_m[0] - x_m, hovering.local_m[1] - y_m
    if turned:
        ahead_m, aside_m = aside_m, ahead_m
    assert ahead_m > 4.0
    assert abs(aside_m) < 1.0


def test_body_velocities_are_turned_by_the_heading(hovering):
    hovering.stream = lambda f: f.companion.setpoint(0.0, 0.0, -10.0, yaw=math.pi / 2)
    hovering.run(4.0)
    hovering.stream = lambda f: f.companion.setpoint(v=(0.7, 0, 0), mask=VELOCITY_ONLY, frame=8)
    hovering.run(4.0)
    assert hovering.vehicle.manner.guided_target.velocity_ned_mps[1] == pytest.approx(0.7, abs=0.05)


def test_nan_in_a_position_stops_the_autopilot_permanently(hovering):
    hovering.companion.setpoint(NAN, 0.0, -10.0)
    start_s = hovering.now_s
    hovering.run(6.0)
    heartbeats = hovering.companion.of("HEARTBEAT", since=start_s + 0.1)
    assert not [m for m in heartbeats if m.get_srcSystem() == 1]
    assert (hovering.truth.mode, hovering.truth.armed) == ("PROCESS ENDED", False)
    assert hovering.truth.on_ground
    assert hovering.mode(hovering.gcs, LOITER) == []
    hovering.vehicle.reboot()
    hovering.run(3.0)
    assert hovering.truth.mode == "STABILIZE"


def test_nan_in_an_ignored_field_has_no_effect(hovering):
    hovering.stream = lambda f: f.companion.setpoint(
        2.0, 0.0, -10.0, yaw=NAN, yaw_rate=NAN, mask=POSITION_VELOCITY
    )
    hovering.run(10.0)
    assert hovering.local_m[0] == pytest.approx(2.0, abs=0.2)


@pytest.mark.parametrize(
    ("system", "component", "obeyed"),
    [(0, 0, True), (1, 0, True), (1, 195, True), (1, 77, True), (2, 1, False)],
)
def test_only_setpoints_to_the_autopilot_are_obeyed(hovering, system, component, obeyed):
    hovering.stream = lambda f: f.companion.setpoint(
        3.0, 0.0, -10.0, system=system, component=component
    )
    hovering.run(10.0)
    assert (hovering.local_m[0] > 2.0) is obeyed


def test_setpoints_cause_no_acknowledgement_and_no_text(hovering):
    start_s = hovering.now_s
    hovering.along(0.5)
    hovering.run(3.0)
    hovering.companion.setpoint(1.0, mask=0xDFF)
    hovering.run(1.0)
    assert not hovering.companion.of("COMMAND_ACK", since=start_s + 1e-9)
    assert not hovering.companion.texts(since=start_s + 1e-9)


@pytest.mark.parametrize(("timeout_s", "further_m"), [(3.0, 2.06), (0.5, 0.31)])
def test_when_the_stream_ends_the_target_goes_on_for_guid_timeout(
    make_ardupilot, timeout_s, further_m
):
    flight = make_ardupilot(parameters={"GUID_TIMEOUT": timeout_s})
    flight.take_off()
    flight.along(0.7)
    flight.run(10.0)
    flight.stream = None
    x_m = flight.local_m[0]
    start_s = flight.now_s
    flight.run(12.0)
    assert flight.local_m[0] - x_m == pytest.approx(further_m, abs=0.05)
    assert flight.truth.mode == "GUIDED"
    assert not flight.companion.texts(since=start_s + 1e-9)


def test_velocity_without_position_stops_after_the_timeout_too(hovering):
    hovering.stream = lambda f: f.companion.setpoint(v=(0.7, 0, 0), mask=VELOCITY_ONLY)
    hovering.run(5.0)
    hovering.stream = None
    hovering.run(2.5)
    assert hovering.truth.velocity_ned_mps[0] > 0.5
    hovering.run(4.0)
    assert abs(hovering.truth.velocity_ned_mps[0]) < 0.15


def test_a_position_only_setpoint_never_times_out(hovering):
    hovering.companion.setpoint(40.0, 0.0, -10.0, mask=POSITION_ONLY)
    hovering.run(25.0)
    assert hovering.local_m[0] == pytest.approx(40.0, abs=0.5)


def test_a_last_setpoint_without_velocity_holds_its_position(hovering):
    hovering.along(0.7)
    hovering.run(6.0)
    hovering.stream = None
    x_m = hovering.local_m[0]
    hovering.companion.setpoint(x_m, 0.0, -10.0)
    hovering.run(8.0)
    assert hovering.local_m[0] == pytest.approx(x_m, abs=0.2)


def test_setpoints_before_lift_off_cancel_the_take_off_without_a_text(ardupilot):
    ardupilot.launch()
    start_s = ardupilot.now_s
    ardupilot.stream = lambda f: f.companion.setpoint(0.0, 0.0, -10.0)
    assert ardupilot.run(15.0, until=lambda f: not f.truth.armed)
    assert ardupilot.truth.on_ground
    assert ardupilot.truth.position_ned_m[2] == 0.0
    assert ardupilot.companion.texts(since=start_s + 0.1) == ["Disarming motors"]


def test_setpoints_do_not_lift_the_vehicle_from_the_ground(ardupilot):
    ardupilot.ready()
    ardupilot.mode(ardupilot.companion, GUIDED)
    ardupilot.ask(ardupilot.companion, 400, 1)
    ardupilot.stream = lambda f: f.companion.setpoint(0.0, 0.0, -10.0)
    ardupilot.run(9.0)
    assert ardupilot.truth.on_ground
    assert ardupilot.truth.armed


def test_a_setpoint_below_the_ground_lands_without_disarming_at_once(hovering):
    hovering.stream = lambda f: f.companion.setpoint(0.0, 0.0, 5.0)
    assert hovering.run(20.0, until=lambda f: f.truth.on_ground)
    hovering.run(4.0)
    assert hovering.truth.landed_state == 1
    assert hovering.truth.armed
    assert hovering.heartbeat().system_status == 3


def test_a_jump_of_thirty_metres_is_flown_fast_and_leaning(hovering):
    hovering.stream = lambda f: f.companion.setpoint(30.0, 0.0, -10.0)
    seen = hovering.watch(12.0, lambda f: (math.hypot(*f.truth.velocity_ned_mps[:2]), f.tilt_deg))
    assert max(speed for speed, _ in seen) == pytest.approx(6.8, abs=0.1)
    assert max(tilt for _, tilt in seen) == pytest.approx(28.0, abs=1.0)


def test_a_setpoint_that_was_left_behind_is_flown_back_to_fast(hovering):
    """As the real one, which came back 29 m at 8.2 m/s, and 0.5 m too far."""
    hovering.stream = lambda f: f.companion.setpoint(0.0, 0.0, -10.0)
    conditions = hovering.vehicle.conditions
    conditions.wind_mps, conditions.wind_from_deg = 13.0, 180.0
    hovering.run(11.0)
    away_m = math.hypot(*hovering.local_m[:2])
    conditions.wind_mps = 0.0
    back = hovering.watch(15.0, lambda f: (f.local_m[0], *f.truth.velocity_ned_mps[:2]))
    assert away_m == pytest.approx(30.0, abs=6.0)
    assert 7.0 < max(math.hypot(*velocity) for _, *velocity in back) < 8.8
    assert min(north_m for north_m, *_ in back) > -0.9
    assert math.hypot(*hovering.local_m[:2]) < 2.0


def test_without_a_yaw_the_nose_turns_into_the_direction_of_travel(hovering):
    start_s = hovering.now_s
    hovering.stream = lambda f: f.companion.setpoint(
        0.0, 0.7 * (f.now_s - start_s), -10.0, v=(0.0, 0.7, 0.0), mask=POSITION_VELOCITY
    )
    hovering.run(8.0)
    assert hovering.truth.attitude_rad[2] == pytest.approx(math.pi / 2, abs=0.2)


def test_a_given_yaw_is_kept_while_flying_elsewhere(hovering):
    start_s = hovering.now_s
    hovering.stream = lambda f: f.companion.setpoint(
        0.0, 0.7 * (f.now_s - start_s), -10.0, v=(0.0, 0.7, 0.0), yaw=-1.0
    )
    hovering.run(8.0)
    assert hovering.truth.attitude_rad[2] == pytest.approx(-1.0, abs=0.1)


def test_a_pilots_mode_ends_guided_at_once_and_setpoints_are_dropped_silently(hovering):
    hovering.along(0.5)
    hovering.run(4.0)
    start_s = hovering.now_s
    hovering.mode(hovering.gcs, LOITER)
    assert hovering.truth.mode == "LOITER"
    assert hovering.vehicle.manner.guided_target is None
    x_m = hovering.truth.position_ned_m[0]
    hovering.run(5.0)
    assert hovering.truth.position_ned_m[0] == pytest.approx(x_m, abs=0.8)
    assert not hovering.companion.texts(since=start_s + 1e-9)


def test_the_remote_controls_switch_takes_over_within_a_quarter_of_a_second(hovering):
    hovering.along(0.5)
    hovering.run(2.0)
    hovering.vehicle.flip_switch(5)
    start_s = hovering.now_s
    assert hovering.run(1.0, until=lambda f: f.truth.mode == "LOITER")
    assert hovering.now_s - start_s == pytest.approx(0.2, abs=0.05)
    assert hovering.mode(hovering.companion, GUIDED) == [0], "the switch does not hold it"
    hovering.run(2.0)
    assert hovering.truth.mode == "GUIDED"


def override_switch(flight, us, system=255):
    """A ground station's channel 5, the other channels left as they are."""
    sender = Peer(flight.vehicle, "gcs", system, 190)
    channels = [65535] * 4 + [us] + [65535] * 13
    sender.send(mavlink.MAVLink_rc_channels_override_message(1, 1, *channels))


def test_a_ground_stations_override_of_the_switch_takes_over_and_expires(hovering):
    hovering.vehicle.set_parameter("FLTMODE4", 5)  # LOITER
    override_switch(hovering, 1555, system=254)
    hovering.run(0.5)
    assert hovering.truth.mode == "GUIDED"  # of another than SYSID_MYGCS
    override_switch(hovering, 1555)
    hovering.run(0.16)
    assert hovering.truth.mode == "GUIDED"
    hovering.run(0.1)
    assert hovering.truth.mode == "LOITER"
    hovering.run(2.6)
    assert hovering.truth.mode == "LOITER"
    hovering.run(0.5)
    assert hovering.truth.mode == "STABILIZE"  # after RC_OVERRIDE_TIME, where the switch is


def test_an_override_that_is_given_back_leaves_the_switch(hovering):
    override_switch(hovering, 1555)
    hovering.run(0.1)
    override_switch(hovering, 0)
    hovering.run(1.0)
    assert hovering.truth.mode == "GUIDED"


@pytest.mark.parametrize("mode", [LOITER, ALT_HOLD])
def test_the_companion_can_take_guided_back_from_the_pilot_at_any_time(hovering, mode):
    hovering.mode(hovering.gcs, mode)
    hovering.run(1.0)
    assert hovering.mode(hovering.companion, GUIDED) == [0]
    assert hovering.truth.mode == "GUIDED"


def test_return_to_guided_with_a_stream_far_ahead_causes_a_fast_jump(hovering):
    hovering.along(0.5)
    hovering.run(6.0)
    hovering.mode(hovering.gcs, LOITER)
    hovering.run(6.0)
    hovering.mode(hovering.gcs, GUIDED)
    speeds = hovering.watch(4.0, lambda f: f.truth.velocity_ned_mps[0])
    assert max(speeds) == pytest.approx(2.4, abs=0.1)


def test_a_silent_companion_causes_no_reaction(hovering):
    hovering.companion_alive = False
    hovering.run(15.0)
    assert hovering.truth.mode == "GUIDED"
    assert hovering.heartbeat().system_status == 4
