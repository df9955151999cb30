"""Every orderly end of the stream: the last setpoint is at the previous one, at rest.

Other ends, when the autopilot has taken control or no packet is permitted, are immediate.
"""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import all as mavlink

from moar_companion.companion import cycle_stages
from moar_companion.companion.mission_states import STREAMING, MissionState
from moar_companion.companion.safety.condition_types import Action
from moar_companion.companion.safety.conditions import CONDITIONS
from moar_companion.settings.config import Authority

from ..mavlink.peer import Peer
from .desk import EXIT, INSPECTION, RELEASE, Desk
from .scripted_autopilot import ACTIVE, AUTO_HOLD, CRITICAL, POSCTL

PX4, ARDUPILOT = mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
LAND = 0x06040000
LONG_S = {"mode_unconfirmed": 3.5}
"""Longer than each of these ends takes; the others take at most 2.2 s."""


def second_autopilot(desk):
    desk.handle(Peer(7, 1).heartbeat(autopilot=desk.kind))


def released(desk):
    desk.order(RELEASE)


def shut_down(desk):
    """Shutdown: no cycle follows."""
    desk.companion.shut_down(desk.now_s)
    desk.take_what_is_sent()
    desk.step = lambda *_: desk


def muted(message):
    def mute(desk):
        desk.set(mute={message})

    return mute


ORDERLY = {
    "a release that is ordered": released,
    "the service is ordered to end": shut_down,
    # Conditions of the supervisor, by their names.
    "autopilot_identity": second_autopilot,
    "mode_unconfirmed": muted("HEARTBEAT"),
    "position": muted("LOCAL_POSITION_NED"),
    "attitude": muted("ATTITUDE"),
}
AT_ONCE = {
    "loop_stall": lambda desk: desk.step(1.5),
    "autopilot_reboot": lambda desk: desk.set(boot_s=1.0),
    "failsafe_took_mode": lambda desk: desk.send_heartbeat(AUTO_HOLD, CRITICAL),
    "ground": lambda desk: desk.set(landed_state=1),
    "pilot": lambda desk: desk.send_heartbeat(POSCTL),
}
ELSEWHERE = {
    "autopilot_link_lost": "of an autopilot that falls silent the position is stale long before",
    "origin": "once known, only a restart makes it unknown",
    "setpoint_rejected": "the last setpoint stands when the supervisor hears of it: see below",
    "landing": "at rest already when the landing is asked for: see below",
}


def speed_mps(setpoint):
    return math.hypot(setpoint.vx, setpoint.vy, setpoint.vz)


def place(setpoint):
    return setpoint.x, setpoint.y, setpoint.z


def silent(desk, way=None):
    """The setpoints until the stream has ended for good."""
    desk.run(LONG_S.get(way, 2.2))
    count = len(desk.setpoints())
    desk.run(0.5)
    assert len(desk.setpoints()) == count
    return desk.setpoints()


def ends_at_rest(desk, way):
    *_, before, last = silent(desk, way)
    assert speed_mps(last) == 0.0
    assert math.dist(place(last), place(before)) < 1e-6


def test_every_release_of_the_supervisor_is_listed_here():
    rows = {row.name: row.last_setpoint for row in CONDITIONS if row.action is Action.RELEASE}
    assert rows.keys() <= {*ORDERLY, *AT_ONCE, *ELSEWHERE}
    assert {name for name in ORDERLY if name in rows and not rows[name]} == set()
    assert {name for name in AT_ONCE if rows[name]} == set()


@pytest.mark.parametrize("way", ORDERLY)
@settings(max_examples=3)
@given(
    kind=st.sampled_from([PX4, ARDUPILOT]),
    mission=st.sampled_from([INSPECTION, EXIT]),
    after_s=st.floats(0.5, 4.0),
)
def test_whenever_a_flight_ends_in_order_its_last_setpoint_stands(way, kind, mission, after_s):
    desk = Desk(autopilot=kind).come_to("flying", mission).run(after_s)
    assert speed_mps(desk.setpoints()[-1]) > 0.0
    ORDERLY[way](desk)
    ends_at_rest(desk, way)


@pytest.mark.parametrize("way", ORDERLY)
@pytest.mark.parametrize("state", sorted(STREAMING - {MissionState.FLYING}))
def test_a_flight_that_ends_in_order_in_another_state_has_a_last_setpoint_at_rest(state, way):
    if state is MissionState.HOLDING:
        desk = Desk().come_to("flying", then_s=3.0).pause().run(0.1)
    else:
        mission = EXIT if state is MissionState.LANDING_LEG else INSPECTION
        desk = Desk().come_to(state.value, mission, then_s=0.5)
    assert desk.state == state.value
    ORDERLY[way](desk)
    ends_at_rest(desk, way)


@pytest.mark.parametrize("way", AT_ONCE)
def test_a_flight_that_does_not_end_in_order_sends_no_further_setpoint(way):
    desk = Desk().come_to("flying", then_s=3.0).run_to_heartbeat()
    assert speed_mps(desk.setpoints()[-1]) > 0.0
    before = len(desk.setpoints())
    AT_ONCE[way](desk)
    # Reported late: by messages that come a few times a second; by a clock 0.3 s ahead.
    late_cycles = {"ground": 10, "autopilot_reboot": 17}
    assert len(silent(desk)) <= before + late_cycles.get(way, 0)
    assert desk.state in {"released", "overridden", "idle"}


@pytest.mark.parametrize("jump_ned_m", [(0.0, 8.0, 0.0), (5.0, 0.0, 0.0), (0.0, 0.0, 8.0)])
@pytest.mark.parametrize("mission", [INSPECTION, EXIT])
def test_where_setpoints_are_no_longer_permitted_the_last_one_is_at_the_aircraft(
    mission, jump_ned_m
):
    desk = Desk().come_to("flying", mission, then_s=2.0).run_to_position()
    place, before = desk.position_ned_m, desk.setpoints()[-1]
    assert speed_mps(before) > 0.0
    desk.jump(*jump_ned_m)
    last = silent(desk)[-1]
    assert desk.state == "released"
    assert speed_mps(last) == 0.0
    carried = tuple(
        a + b for a, b in zip(desk.estimate_off_ned_m, desk.position_ned_m, strict=True)
    )
    assert math.dist(carried, tuple(map(sum, zip(place, jump_ned_m, strict=True)))) < 0.1


# Ends of an offer -------------------------------------------------------------------------------


OFFERS = {
    "the aircraft has left its place": lambda desk: desk.drift(0.0, 8.0, 0.0),
    "the supervisor would hold": lambda desk: desk.set(fix_type=1),
}


@pytest.mark.parametrize("way", OFFERS)
def test_an_offer_that_ends_has_sent_only_setpoints_at_rest(way):
    desk = Desk().come_to("ready", then_s=1.0)
    OFFERS[way](desk)
    assert {speed_mps(setpoint) for setpoint in silent(desk)} == {0.0}
    assert desk.state == "idle"


@pytest.mark.slow
def test_a_landing_by_the_autopilot_follows_a_setpoint_at_rest():
    desk = Desk(authority=Authority.ENGAGE).come_to("holding", EXIT, then_s=3.0)
    assert [request.param3 for request in desk.mode_requests()][-1] == 6
    desk.send_heartbeat(LAND)
    assert speed_mps(silent(desk)[-1]) == 0.0
    assert desk.state == "idle"


def test_the_last_setpoint_needs_no_new_forecast_and_no_new_risk(monkeypatch):
    desk = Desk().come_to("flying", then_s=3.0)
    desk.now_s += 0.2  # both are due
    for stage in ("_look_ahead", "_assess_risk"):
        monkeypatch.setattr(cycle_stages, stage, lambda *_: 1 / 0)
    monkeypatch.setattr(desk.companion.state.risk_monitor, "take_answers", lambda _volume: 1 / 0)
    shut_down(desk)
    assert speed_mps(desk.setpoints()[-1]) == 0.0


def test_shutting_down_sends_a_last_setpoint_at_rest():
    desk = Desk().come_to("flying", then_s=3.0)
    assert desk.setpoints()[-1].vz != 0.0 or desk.setpoints()[-1].vy != 0.0
    shut_down(desk)
    before, last = desk.setpoints()[-2:]
    assert (last.vx, last.vy, last.vz) == (0.0, 0.0, 0.0)
    assert math.dist((last.x, last.y, last.z), (before.x, before.y, before.z)) < 1e-6


def test_shutting_down_in_silence_sends_nothing():
    desk = Desk().come_to("flying").send_heartbeat(POSCTL).run(1.0)
    count = len(desk.sent)
    shut_down(desk)
    assert len(desk.sent) == count


@pytest.mark.parametrize(
    ("case", "mode", "status"),
    [
        ("a failsafe in the same cycle", AUTO_HOLD, CRITICAL),
        ("the pilot in the same cycle", POSCTL, ACTIVE),
    ],
)
def test_shutting_down_sends_no_last_setpoint_when_the_autopilot_has_left(case, mode, status):
    desk = Desk().come_to("flying", then_s=3.0)
    desk.plan_delay_s = None
    began = desk.now_s
    desk.send_heartbeat(mode, status).now_s += 0.01
    shut_down(desk)
    assert not desk.setpoints(began), case


def test_shutting_down_with_old_data_sends_no_last_setpoint():
    desk = Desk().come_to("flying", then_s=3.0)
    began = desk.now_s
    desk.now_s += 60.0
    shut_down(desk)
    assert not desk.setpoints(began)


def test_the_last_setpoint_is_at_the_previous_one_wherever_the_aircraft_is():
    desk = Desk().come_to("flying", then_s=3.0)
    desk.fall_behind(0.0, 0.4, 0.0)
    before = desk.setpoints()[-1]
    desk.order(RELEASE).step()
    last = desk.setpoints()[-1]
    assert (last.x, last.y, last.z, last.yaw) == (before.x, before.y, before.z, before.yaw)
    assert (last.vx, last.vy, last.vz) == (0.0, 0.0, 0.0)
