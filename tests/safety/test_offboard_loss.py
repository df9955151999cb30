"""Offboard loss: action by parameters, stopping distance, and refused actions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import all as mavlink
from shapely.geometry import LineString, Point

from moar_companion.companion.safety.failsafe_paths import first_hit, loss_objection
from moar_companion.mavlink.autopilots import profile
from moar_companion.mavlink.autopilots.failsafe_actions import AutopilotAction
from moar_companion.mavlink.autopilots.parameter_names import Parameters
from moar_companion.planner.free_distance import FreeDistance
from moar_companion.types import ARDUPILOT, PX4, UNKNOWN
from sitl.autopilot import FakeAutopilot, Options
from tests.thorough import sampled

from ..copies import copy_of
from ..flights.operator import Manner, Operator
from ..planner.problems import conductor, make_site

DEFAULTS = {kind: profile(kind).parameters.defaults for kind in (PX4, ARDUPILOT)}


def loss(kind, **parameters):
    assert parameters.keys() <= DEFAULTS[kind].keys()
    return profile(kind).offboard_loss(Parameters({**DEFAULTS[kind], **parameters}))


# Parameters -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "action"),
    [
        (0, AutopilotAction.RETURN),
        (1, AutopilotAction.RETURN),
        (2, AutopilotAction.RETURN),
        (3, AutopilotAction.RETURN),
        (4, AutopilotAction.LAND),
        (5, AutopilotAction.HOLD),
        (6, AutopilotAction.FALL),
        (7, AutopilotAction.FALL),
        (99, AutopilotAction.RETURN),
    ],
)
def test_com_obl_rc_act_sets_the_action_of_px4(value, action):
    assert loss(PX4, COM_OBL_RC_ACT=float(value)).action is action


def test_ardupilot_holds_for_any_parameters():
    assert loss(ARDUPILOT, GUID_TIMEOUT=0.5).action is AutopilotAction.HOLD


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
def test_the_action_is_unknown_before_all_parameters_are_requested(kind):
    for name in profile(kind).loss_parameters:
        others = {key: value for key, value in DEFAULTS[kind].items() if key != name}
        assert profile(kind).offboard_loss(Parameters(others)) is None
    assert profile(UNKNOWN).offboard_loss(Parameters({})) is None


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
def test_a_parameter_never_reported_never_shortens_the_stop_and_is_named(kind):
    usual = loss(kind)
    for name in profile(kind).loss_parameters:
        cautious = loss(kind, **{name: None})
        assert cautious.stopping_m(2.0) >= usual.stopping_m(2.0)
        assert (cautious.follows_mps2 or 0.0) <= (usual.follows_mps2 or 0.0)
        silent = Parameters({**DEFAULTS[kind], name: None})
        unreported = profile(kind).unreported(silent)
        assert unreported.names == (name,)
        row = profile(kind).parameters.row(name)
        assert unreported.denying == ((name,) if row.denies else ())


# Stopping distance ------------------------------------------------------------------------------


@given(st.floats(0.0, 15.0), st.floats(0.0, 5.0))
def test_the_greatest_speed_for_a_free_distance_stops_within_it(free_m, timeout_s):
    for found in (loss(PX4), loss(ARDUPILOT, GUID_TIMEOUT=timeout_s)):
        speed = found.speed_mps(np.array([free_m]))
        assert speed[0] >= 0.0
        assert found.stopping_m(speed) == pytest.approx([free_m], abs=1e-9)


@given(st.floats(0.1, 10.0), st.floats(0.0, 5.0), st.floats(0.01, 1.0))
def test_a_longer_time_on_the_last_setpoint_never_allows_more_speed(free_m, timeout_s, more_s):
    free = np.array([free_m])
    short = loss(ARDUPILOT, GUID_TIMEOUT=timeout_s).speed_mps(free)
    assert loss(ARDUPILOT, GUID_TIMEOUT=timeout_s + more_s).speed_mps(free) < short
    assert loss(ARDUPILOT, GUID_TIMEOUT=-1.0).speed_mps(free) >= short


TIMEOUT = {Manner.PX4: "COM_OF_LOSS_T", Manner.ARDUPILOT: "GUID_TIMEOUT"}
STRAIGHT = {
    "level": (1.0, 0.0, 0.0),
    "back": (-1.0, 0.0, 0.0),
    "up": (0.0, 0.0, -1.0),
    "down": (0.0, 0.0, 1.0),
    "slant": (math.sqrt(0.5), 0.0, -math.sqrt(0.5)),
}
GREATEST_MPS = {"level": 5.0, "back": 5.0, "up": 2.0, "down": 1.0, "slant": 2.0}
STEP_S = 0.02
HEIGHT_M = 15.0
PARAMETERS = {
    Manner.PX4: {"COM_OBL_RC_ACT": 5, "MIS_TAKEOFF_ALT": HEIGHT_M},
    Manner.ARDUPILOT: {"SIM_BOOT_S": 8.0},
}


class Alone:
    """A fake autopilot that hovers high, and straight flights that end by a companion failure."""

    def __init__(self, manner, wind_mps):
        self.manner = manner
        self.autopilot = FakeAutopilot(
            Options(autopilot=manner.value, parameters=PARAMETERS[manner])
        )
        self.autopilot.conditions.gps_noise_factor = 0.0
        self.operator = Operator(self.autopilot, manner)
        self.codec = mavlink.MAVLink(None, srcSystem=1, srcComponent=195)
        self.now_s = 0.0
        self.run(9.0)
        self.operator.mode("hold" if _px4(manner) else "ours")
        self.run(0.1)
        if _px4(manner):
            self.operator.take_off(HEIGHT_M)
            self.run(0.1)
        self.operator.arm()
        if not _px4(manner):
            self.run(2.5)
            self.operator.take_off(HEIGHT_M)
        self.run(14.0)
        self.autopilot.conditions.wind_mps = wind_mps
        self.run(8.0)
        assert -self.autopilot.truth.position_ned_m[2] > HEIGHT_M - 1.0

    def run(self, seconds):
        for _ in range(round(seconds / STEP_S)):
            self.now_s += STEP_S
            self.operator.tick(self.now_s)
            self.autopilot.step(self.now_s)
            for link, data in self.autopilot.data_to_send():
                if link == "gcs":
                    self.operator.receive(data)

    def send(self, message):
        self.autopilot.receive("companion", bytes(message.pack(self.codec)))

    def fly(self, direction, speed_mps, parameters):
        """Flies straight; returns the position of the last setpoint."""
        for name, value in parameters.items():
            self.autopilot.set_parameter(name, value)
        self.send(self.codec.heartbeat_encode(18, 8, 0, 0, 4))
        place, flown_mps = list(self.autopilot.truth.position_ned_m), 0.0
        for step in range(round((7.0 + speed_mps) / STEP_S)):
            if step == 75:
                self.operator.mode("ours")
            if step > 125:
                flown_mps = min(speed_mps, flown_mps + STEP_S)
            place = [
                at + flown_mps * part * STEP_S for at, part in zip(place, direction, strict=True)
            ]
            velocity = [flown_mps * part for part in direction]
            self.send(
                self.codec.set_position_target_local_ned_encode(
                    0, 1, 1, 1, 0x9C0, *place, *velocity, 0, 0, 0, 0, 0
                )
            )
            self.run(STEP_S)
        assert self.operator.in_mode("ours")
        return place

    def stopping_m(self, place, direction, timeout_s):
        """Distance flown beyond the last setpoint, from the error before."""
        self.autopilot.set_parameter(TIMEOUT[self.manner], timeout_s)
        before = self._beyond_m(place, direction)
        farthest = -math.inf
        for _ in range(round((timeout_s + 6.0) / STEP_S)):
            self.run(STEP_S)
            farthest = max(farthest, self._beyond_m(place, direction))
        return farthest - before

    def _beyond_m(self, place, direction):
        here = self.autopilot.truth.position_ned_m
        return sum(
            (at - wanted) * part for at, wanted, part in zip(here, place, direction, strict=True)
        )


def _px4(manner):
    return manner is Manner.PX4


def _ours(kind, parameters):
    """Parameters of the fake by their keys and in our units."""
    rows = [(*profile(kind).parameters.ours(name), value) for name, value in parameters.items()]
    return {key: value * name.scale for key, name, value in rows}


def assert_stops_within_bound(manner, wind_mps, flights, **parameters):
    hovering = Alone(manner, wind_mps)
    kind = PX4 if _px4(manner) else ARDUPILOT
    for name, speed_mps, *timeouts_s in flights:
        flown = copy_of(hovering)
        place = flown.fly(STRAIGHT[name], speed_mps, parameters)
        for timeout_s in timeouts_s:
            timeout = {} if _px4(manner) else {"GUID_TIMEOUT": timeout_s}
            found = loss(kind, **_ours(kind, parameters), **timeout)
            stopping_m = copy_of(flown).stopping_m(place, STRAIGHT[name], timeout_s)
            bound_m = float(found.stopping_m(np.array(speed_mps)))
            least_m = 0.0 if parameters else 0.3 * bound_m
            assert least_m < stopping_m <= bound_m + NOISE_M, (name, speed_mps, timeout_s)


NOISE_M = 0.1
"""Position error of the receiver while the aircraft stops."""


@pytest.mark.parametrize("manner", Manner)
def test_the_fake_autopilots_stop_within_the_bound(manner):
    assert_stops_within_bound(manner, 0.0, [("slant", 1.0, 0.5)])


SOFT = [
    (Manner.PX4, {"MPC_ACC_HOR": 2.0}),
    (Manner.PX4, {"MPC_ACC_HOR": 1.0}),
    (Manner.ARDUPILOT, {"WPNAV_ACCEL": 100.0, "WPNAV_ACCEL_Z": 100.0}),
    (Manner.ARDUPILOT, {"WPNAV_ACCEL": 250.0, "WPNAV_ACCEL_Z": 200.0}),
    (Manner.ARDUPILOT, {"WPNAV_ACCEL": 500.0, "WPNAV_ACCEL_Z": 100.0}),
    (Manner.ARDUPILOT, {"PSC_JERK_XY": 1.0, "PSC_JERK_Z": 1.0}),
]


@pytest.mark.parametrize(("manner", "parameters"), [SOFT[1], SOFT[2], SOFT[5]])
def test_fake_autopilots_that_brake_softly_stop_within_the_bound(manner, parameters):
    flights = [("level", 3.0, 0.1 if _px4(manner) else 0.5)]
    assert_stops_within_bound(manner, 0.0, flights, **parameters)


def test_a_fake_autopilot_with_slow_height_control_stops_within_the_bound():
    assert_stops_within_bound(Manner.PX4, 0.0, [("up", 2.0, 3.0)], MPC_Z_P=0.5)


@pytest.mark.slow
@pytest.mark.parametrize(("manner", "parameters"), SOFT)
def test_fake_autopilots_that_brake_softly_in_wind_stop_within_the_bound(manner, parameters):
    timeouts_s = (0.1, 0.5) if _px4(manner) else (0.5,)
    flights = [
        (name, speed_mps, *timeouts_s)
        for name, speed_mps in (("level", 1.0), ("level", 5.0), ("up", 2.0))
    ]
    assert_stops_within_bound(manner, 6.0, flights, **parameters)


@pytest.mark.slow
@pytest.mark.parametrize("wind_mps", sampled([6.0], [0.0, 6.0]))
@pytest.mark.parametrize("manner", Manner)
def test_the_fake_autopilots_stop_within_the_bound_in_every_direction(manner, wind_mps):
    assert_stops_within_bound(
        manner,
        wind_mps,
        [
            (name, speed_mps, *sampled((0.5, 3.0), (0.5, 1.0, 2.0, 3.0)))
            for name, greatest_mps in GREATEST_MPS.items()
            for speed_mps in sampled((0.7, greatest_mps), (0.7, 1.0, 2.0, 3.0, 5.0))
            if speed_mps <= greatest_mps
        ],
    )


# Refused actions --------------------------------------------------------------------------------


REACH = FreeDistance.over(
    make_site(conductor(5.5, 4.5, name="wire"), size=(20.0, 10.0)), radius_m=0.1
)


def objection(found, *places, home=(15.5, 0.0, 0.0)):
    return loss_objection(found, REACH, np.array(places), home)


def test_a_hold_is_allowed_anywhere():
    assert objection(loss(PX4, COM_OBL_RC_ACT=5.0), (5.5, 5.5), (5.5, 3.5)) is None
    assert objection(loss(ARDUPILOT, GUID_TIMEOUT=0.5), (5.5, 5.5)) is None


def test_a_landing_is_allowed_where_no_obstacle_is_below():
    lands = loss(PX4, COM_OBL_RC_ACT=4.0)
    assert objection(lands, (5.5, 3.5), (8.5, 5.5)) is None
    expected = "PX4 would hit wire (it would land on offboard loss; set COM_OBL_RC_ACT 5)"
    assert objection(lands, (8.5, 5.5), (5.5, 7.5)) == expected


def test_a_return_climbs_flies_level_and_descends_at_home():
    returns = loss(PX4)
    expected = "PX4 would hit wire (it would return on offboard loss; set COM_OBL_RC_ACT 5)"
    assert objection(returns, (8.5, 5.5), (5.5, 5.5)) is None
    assert objection(returns, (5.5, 1.5)) == expected  # climbs
    assert objection(returns, (8.5, 8.5), home=(5.5, 0.0, 0.0)) == expected  # comes down
    low = loss(PX4, RTL_RETURN_ALT=4.5)
    assert objection(low, (3.5, 1.5)) == expected  # flies level
    assert objection(low, (8.5, 1.5)) is None
    steep = loss(PX4, RTL_MIN_DIST=15.0, RTL_CONE_ANG=69.4)  # 12 m from home it climbs to 4.5 m
    assert objection(steep, (3.5, 1.5)) == expected
    assert objection(loss(PX4, RTL_MIN_DIST=11.0, RTL_CONE_ANG=69.4), (3.5, 1.5)) is None


@pytest.mark.parametrize(
    ("parameters", "distance_m", "height_m", "level_m"),
    [
        ({}, 100.0, 5.0, 30.0),
        ({}, 10.1, 5.0, 30.0),  # the cone counts within RTL_MIN_DIST alone
        ({}, 9.9, 5.0, 9.9),
        ({}, 3.0, 1.0, 4.0),  # twice NAV_ACC_RAD
        ({}, 1.5, 1.0, 3.0),
        ({}, 9.9, 40.0, 40.0),
        ({"RTL_CONE_ANG": 90.0}, 9.9, 1.0, 4.0),
        ({"RTL_CONE_ANG": 25.0, "RTL_RETURN_ALT": 15.0}, 9.9, 1.0, 15.0),
        ({"RTL_CONE_ANG": 0.0}, 1.5, 1.0, 30.0),  # no cone
    ],
)
def test_the_height_of_a_return_is_that_of_px4(parameters, distance_m, height_m, level_m):
    home = loss(PX4, **parameters).home
    assert home.height_m(height_m, distance_m) == pytest.approx(level_m)


@pytest.mark.parametrize("value", [1.0, 2.0, 3.0])
def test_a_return_by_an_unknown_route_is_refused_anywhere(value):
    expected = (
        "PX4 would return, route unknown "
        "(on offboard loss; RTL_TYPE is not 0; set COM_OBL_RC_ACT 5)"
    )
    assert objection(loss(PX4, RTL_TYPE=value), (9.5, 9.5)) == expected
    assert objection(loss(PX4, RTL_TYPE=value, COM_OBL_RC_ACT=5.0), (9.5, 9.5)) is None


def test_next_to_home_a_return_does_not_climb():
    assert objection(loss(PX4), (5.5, 1.5), home=(5.5, 1.0, 0.0)) is None


def test_without_a_home_only_the_climb_of_a_return_is_checked():
    assert objection(loss(PX4), (3.5, 1.5), home=None) is None
    assert "hit wire" in objection(loss(PX4), (5.5, 1.5), home=None)


def test_a_return_to_a_far_home_is_checked_on_the_site_alone():
    """A check cell by cell all along the route would take minutes."""
    assert objection(loss(PX4), (8.5, 5.5), home=(-6e6, 2e6, -3e5)) is None
    low = loss(PX4, RTL_RETURN_ALT=4.5, RTL_MIN_DIST=0.0)
    assert "hit wire" in objection(low, (8.5, 1.5), home=(-6e6, 0.0, 0.0))
    assert objection(low, (8.5, 1.5), home=(6e6, 0.0, 0.0)) is None


@given(st.data())
def test_a_collision_is_found_wherever_the_grid_ends(data):
    # In millimetres: shapely divides by the length of a line.
    places = st.tuples(st.integers(-30_000, 50_000), st.integers(-30_000, 40_000))
    start, end = (tuple(1e-3 * value for value in data.draw(places)) for _ in range(2))
    line = LineString([start, end])
    wire = Point(5.5, 4.5)
    hit = first_hit(REACH, [(np.array([start]), np.array([end]))])
    if line.distance(wire) > 0.1 + 1.6:
        assert hit is None
    elif line.distance(wire) < 0.1 and min(wire.distance(Point(at)) for at in (start, end)) > 2.0:
        assert hit is not None
        assert hit.obstacle == "wire"


def test_a_stop_of_the_motors_is_refused_anywhere():
    assert "would stop its motors (on offboard loss; set" in objection(
        loss(PX4, COM_OBL_RC_ACT=7.0), (9.5, 9.5)
    )


def test_a_time_on_the_last_setpoint_that_allows_no_speed_is_refused_anywhere():
    why = "(ArduPilot would fly on so long on offboard loss; set GUID_TIMEOUT 0.5)"
    for timeout_s, words in ((60.0, "60.0 s > 5"), (5.001, "over 5 s"), (1e6, "99999 s > 5")):
        expected = f"GUID_TIMEOUT {words} {why}"
        assert objection(loss(ARDUPILOT, GUID_TIMEOUT=timeout_s), (9.5, 9.5)) == expected


# Lag behind setpoints ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("parameters", "lags"),
    [
        ({}, False),
        ({"WP_ACC": 1.0}, False),
        ({"WP_ACC": 0.99}, True),
        ({"WP_ACC_Z": 0.99}, True),
    ],
)
def test_an_autopilot_that_accelerates_less_than_its_setpoints_cannot_follow(parameters, lags):
    lag = loss(ARDUPILOT, **parameters).lag(1.0)
    assert (lag is not None) is lags
    if lag is not None:
        assert lag == (
            "ArduPilot brakes 0.99 < 1 m/s2 (guidance.acceleration_mps2; set WP_ACC and WP_ACC_Z 1)"
        )


def test_a_low_px4_acceleration_is_no_lag():
    assert loss(PX4, MPC_ACC_HOR=0.5).lag(5.0) is None
