"""Flights with ArduPilot's own features: GUIDED on request, time-outs, texts."""

from __future__ import annotations

import itertools
import math

import pytest
from pymavlink.dialects.v20 import all as mavlink

from moar_companion.settings.config import Authority

from ..copies import flown_once
from ..flights.aircraft import STEP_S
from ..flights.judging import (
    assert_nothing_was_touched,
    assert_setpoints_keep_to_free_space,
    setpoint_places,
    true_places,
)
from ..flights.lockstep import Lockstep, hovering
from ..flights.operator import EXIT, INSPECTION, RELEASE, TEMPORARILY_REJECTED, Manner

DO_SET_MODE = 176
ENGAGE_FIRST = [Authority.ENGAGE, pytest.param(Authority.STREAM, marks=pytest.mark.slow)]
"""The greatest authority in every run, the other one in slow runs."""


STOPS_WITHIN_S = 1.5
"""Times its speed, ArduPilot flies on in GUIDED or LOITER until it stands, at about 2 m/s."""


@flown_once
def in_flight(seconds=3.0, **options):
    flight = hovering(vehicle="x500", manner=Manner.ARDUPILOT, **options)
    flight.begin(INSPECTION)
    flight.run(seconds)
    assert flight.state == "flying"
    return flight


def speed_of(flight):
    return math.hypot(*flight.truth.velocity_ned_mps)


def mode_requests(flight):
    """Mode requests of the companion."""
    codec = mavlink.MAVLink(None)
    return [
        (time_s, message.param2)
        for time_s, data in flight.to_autopilot
        for message in codec.parse_buffer(data) or []
        if message.get_type() == "COMMAND_LONG" and message.command == DO_SET_MODE
    ]


def moved_m(flight, since_s):
    """Distance of the aircraft from its place at a time."""
    steps = true_places(flight)
    times = [truth.time_s for truth in flight.truths if not truth.on_ground]
    first = next(index for index, time_s in enumerate(times) if time_s >= since_s)
    return max(math.dist(steps[first], place) for place in steps[first:])


def test_nothing_is_streamed_before_the_aircraft_is_in_the_air_so_the_take_off_continues():
    flight = Lockstep(vehicle="x500", manner=Manner.ARDUPILOT)
    while not flight.operator.has_received("EKF3 IMU0 is using GPS"):
        flight.move()
    flight.run(4.0)
    flight.operator.mode("ours")
    flight.run(0.1)
    flight.operator.arm()
    flight.run(2.5)
    flight.operator.take_off(3.0)
    while flight.truth.landed_state != 2:
        flight.operator.mission(INSPECTION)
        flight.run(0.3)
    assert set(flight.operator.answers()) == {TEMPORARILY_REJECTED}
    assert not flight.setpoints
    flight.run_until(lambda: flight.truth.position_ned_m[2] < -2.7, 8.0)
    flight.run(2.0)
    assert flight.truth.position_ned_m[2] == pytest.approx(-3.0, abs=0.5)


def test_an_aircraft_already_in_guided_flies_as_soon_as_it_is_ordered():
    flight = hovering(vehicle="x500", manner=Manner.ARDUPILOT)
    assert flight.operator.in_mode("ours")
    flight.operator.mission(INSPECTION)
    flight.run(0.5)
    assert flight.state == "flying"
    assert mode_requests(flight) == []


@pytest.mark.slow
def test_the_wind_is_reported_with_drag_fusion_only():
    blind = in_flight()
    blind.run_in_wind(6.0, 300.0, 40.0)
    assert blind.companion.telemetry.wind is None
    drag = {"EK3_DRAG_BCOEF_X": 30.0, "EK3_DRAG_BCOEF_Y": 30.0, "EK3_DRAG_MCOEF": 0.2}
    flight = in_flight(options={"parameters": drag})
    flight.autopilot.conditions.wind_mps, flight.autopilot.conditions.wind_from_deg = 6.0, 300.0
    flight.run(40.0)
    wind = flight.companion.telemetry.wind
    assert wind is not None
    north, east, _ = wind.velocity_ned_mps
    assert math.hypot(north, east) == pytest.approx(6.0, abs=1.0)
    towards_deg = math.degrees(math.atan2(east, north)) % 360.0
    assert towards_deg == pytest.approx(120.0, abs=15.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("action", "state"), [(1, "released"), (2, "idle")], ids=["land", "return"]
)
@pytest.mark.parametrize("authority", ENGAGE_FIRST)
def test_a_battery_failsafe_is_left_to_the_autopilot_even_if_guided_is_available(
    authority, action, state
):
    """During a landing an order is refused; during a return the aircraft leaves the offered hold.

    The return leaves late: above home the autopilot waits for RTL_LOIT_TIME before it descends.
    """
    actions = {"BATT_LOW_VOLT": 11.4, "BATT_CRT_VOLT": 0.0, "BATT_FS_LOW_ACT": action}
    flight = in_flight(authority=authority, options={"parameters": actions})
    asked = len(mode_requests(flight))
    flight.autopilot.conditions.battery_percent = 40.0
    flight.run_until_state("released", 30.0)
    assert not flight.operator.in_mode("ours")
    flight.run(5.0)
    ordered_s = flight.now_s
    flight.operator.mission(EXIT)
    flight.run(10.0)
    assert flight.state == state
    offered = [item for item in flight.setpoints if item.time_s > ordered_s]
    assert bool(offered) is (state == "idle")
    if offered:
        (hold,) = setpoint_places(flight, offered[-1:])
        left_m = [math.dist(hold, place) for place in true_places(flight)]
        steps = round((flight.now_s - offered[-1].time_s) / STEP_S)
        most_m = flight.vehicle.guidance.tracking_hold_m
        assert left_m[-1 - steps] <= most_m + 0.3  # within the position error
        assert min(left_m[-steps:]) >= most_m - 0.3
    assert not flight.operator.in_mode("ours")
    assert len(mode_requests(flight)) == asked


@pytest.mark.slow
def test_after_an_orderly_end_the_aircraft_stays_at_its_place():
    flight = in_flight()
    released, speed_mps = flight.now_s, speed_of(flight)
    flight.operator.mission(RELEASE)
    flight.run(10.0)
    assert flight.operator.in_mode("ours")  # GUIDED holds without setpoints
    last = flight.setpoints[-1].message
    assert (last.vx, last.vy, last.vz) == (0.0, 0.0, 0.0)
    assert moved_m(flight, released) < STOPS_WITHIN_S * speed_mps
    assert_nothing_was_touched(flight)


@pytest.mark.slow
@pytest.mark.parametrize(("timeout_s", "farthest"), [(0.5, 1.0), (3.0, 3.0)])
def test_after_a_companion_failure_the_aircraft_flies_on_for_guid_timeout(timeout_s, farthest):
    """GUID_TIMEOUT times the speed, plus the stopping distance."""
    flight = in_flight(1.5, options={"parameters": {"GUID_TIMEOUT": timeout_s}})
    message = flight.setpoints[-1].message
    speed_mps = math.hypot(message.vx, message.vy, message.vz)
    assert speed_mps > 0.3
    died = flight.now_s
    flight.cut = True
    flight.run(10.0)
    gone_m = moved_m(flight, died)
    assert gone_m < farthest * speed_mps + 1.0
    if timeout_s == 3.0:
        assert gone_m > 2.0 * speed_mps
    assert flight.operator.in_mode("ours")
    assert flight.truth.armed
    assert_setpoints_keep_to_free_space(flight)


@pytest.mark.slow
def test_the_pilots_mode_switch_takes_over_while_mode_reports_to_the_companion_are_lost():
    """The autopilot drops setpoints in another mode; GUIDED given back starts nothing."""
    flight = in_flight()
    flight.deaf = True
    flight.operator.mode("hold")
    flight.run(0.3)
    took, speed_mps = true_places(flight)[-1], speed_of(flight)
    flight.run(3.0)
    assert math.dist(took, true_places(flight)[-1]) < STOPS_WITHIN_S * speed_mps
    flight.deaf = False
    flight.operator.mode("ours")
    flight.run(15.0)
    assert flight.state == "released"
    assert not [s for s in flight.setpoints if s.time_s > flight.now_s - 10.0]


def test_an_order_is_answered_once_though_the_autopilot_broadcasts_it_too():
    """For component 0 the autopilot answers UNSUPPORTED, and the companion with its own result."""
    flight = hovering(vehicle="x500", manner=Manner.ARDUPILOT)
    flight.operator.command(31010, INSPECTION, -1, component=0)
    flight.run(1.0)
    results = [
        (message.get_srcComponent(), message.result)
        for message in flight.operator.received
        if message.get_type() == "COMMAND_ACK" and message.command == 31010
    ]
    assert sorted(results) == [(1, mavlink.MAV_RESULT_UNSUPPORTED), (195, 0)]
    assert flight.state == "flying"


def test_the_heading_stays_on_the_inspected_target():
    """Without a yaw ArduPilot turns the nose into the direction of flight."""
    flight = in_flight()
    yaws = [setpoint.message.yaw for setpoint in flight.setpoints]
    flown = [truth.attitude_rad[2] for truth in flight.truths][-len(yaws) :]
    for wanted, real in itertools.islice(zip(yaws, flown, strict=True), 50, None, 25):
        assert abs(math.remainder(wanted - real, math.tau)) < math.radians(25.0)


@pytest.mark.parametrize("authority", ENGAGE_FIRST)
@pytest.mark.parametrize(
    "action",
    [
        pytest.param(1, id="return"),
        pytest.param(2, id="land", marks=pytest.mark.slow),
        pytest.param(4, id="brake", marks=pytest.mark.slow),
    ],
)
def test_a_fence_breach_with_status_active_ends_control_like_a_takeover(authority, action):
    fence = {"FENCE_ENABLE": 1, "FENCE_ACTION": action}
    flight = in_flight(authority=authority, options={"parameters": fence})
    asked = len(mode_requests(flight))
    flight.autopilot.set_parameter("FENCE_ALT_MAX", 1.0)
    flight.run_until(lambda: not flight.operator.in_mode("ours"), 1.0)
    breached_s = flight.now_s
    flight.run(8.0)
    assert "Max Alt fence breached" in flight.operator.texts()
    assert flight.state == "overridden"
    assert flight.last_setpoint_s < breached_s + 1.5
    assert len(mode_requests(flight)) == asked
    assert not flight.operator.in_mode("ours")
    statuses = {m.system_status for m in flight.operator.received if m.get_type() == "HEARTBEAT"}
    assert mavlink.MAV_STATE_CRITICAL not in statuses
