"""Ends of the stream; only a new command starts it again."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import all as mavlink

from moar_companion.planner.planner import Planner
from moar_companion.settings.config import Supervision

from ..copies import flown_once
from ..mavlink.peer import Peer
from .desk import (
    ACCEPTED,
    DENIED,
    EVACUATION,
    INSPECTION,
    STEP_S,
    TEMPORARILY_REJECTED,
    Desk,
    usual_planner,
)
from .scripted_autopilot import AUTO_HOLD, CRITICAL, OFFBOARD, POSCTL


@pytest.mark.parametrize("vehicle_type", [1, 20])
def test_a_mission_for_a_vehicle_that_is_no_multirotor_is_rejected(vehicle_type):
    """Such a vehicle cannot hold a setpoint at rest."""
    desk = Desk()
    desk.vehicle_type = vehicle_type
    desk.run(1.2).order(INSPECTION).run(1.0)
    assert (desk.state, desk.answers()) == ("idle", [TEMPORARILY_REJECTED])
    assert desk.said("the vehicle is no multirotor")
    assert not desk.setpoints()


def test_the_first_thing_ever_sent_is_a_heartbeat():
    desk = Desk()
    desk.companion.receive("udp:127.0.0.1:14540", desk.autopilot.heartbeat(), 50.0)
    assert desk.companion.data_to_send() == []
    desk.run(3.0)
    kinds = [message.get_type() for _, _, message in desk.sent]
    assert kinds[0] == "HEARTBEAT"
    beats = desk.messages("HEARTBEAT")
    assert 3 <= len(beats) <= 4
    for beat in beats:
        assert (beat.type, beat.autopilot, beat.base_mode) == (18, 8, 0)
        assert (beat.get_srcSystem(), beat.get_srcComponent()) == (1, 195)


def test_the_heartbeat_is_active_while_the_companion_streams_and_standby_otherwise():
    desk = Desk().run(2.0)
    assert desk.messages("HEARTBEAT")[-1].system_status == 3
    desk.order(INSPECTION).run(2.0)
    assert desk.messages("HEARTBEAT")[-1].system_status == 4
    desk.send_heartbeat(OFFBOARD).run(1.2).send_heartbeat(POSCTL).run(2.0)
    assert desk.messages("HEARTBEAT")[-1].system_status == 3


@pytest.mark.slow
@pytest.mark.parametrize("state", ["ready", "flying", "at_target", "holding"])
@pytest.mark.parametrize(
    ("case", "mute", "limit_s", "words"),
    [
        ("no position", {"LOCAL_POSITION_NED"}, 0.5, "position age 0.5"),
        ("no mode", {"HEARTBEAT"}, 3.0, "mode unknown for 3."),
        (
            "nothing at all",
            {"HEARTBEAT", "LOCAL_POSITION_NED", "ATTITUDE"},
            0.5,
            "position age 0.5",
        ),
    ],
)
def test_stale_telemetry_ends_the_stream_and_its_return_starts_nothing(
    state, case, mute, limit_s, words
):
    desk = Desk()
    desk.come_to(state)
    desk.send_heartbeat(desk.mode).step()
    desk.mute = mute
    began = desk.now_s
    desk.run(limit_s - 0.1)
    assert desk.state == state
    desk.run(0.3)
    assert desk.state == "released"
    assert desk.said(words)
    assert not desk.setpoints(began + limit_s + 0.1)
    if state != "ready":  # a last setpoint, at rest
        before, last = desk.setpoints()[-2:]
        assert (last.vx, last.vy, last.vz) == (0.0, 0.0, 0.0)
        assert (last.x, last.y, last.z) == (before.x, before.y, before.z)
    silent = desk.now_s
    desk.mute = set()
    desk.run(3.0)
    assert desk.state == "released"
    assert not desk.setpoints(silent)
    desk.order(INSPECTION).run(0.5)
    assert desk.answers()[-1] == ACCEPTED
    assert desk.setpoints(silent)


def test_a_position_gap_shorter_than_the_limit_is_flown_through():
    desk = Desk().come_to("flying")
    for _ in range(5):
        desk.mute = {"LOCAL_POSITION_NED"}
        desk.run(0.4)
        desk.mute = set()
        desk.run(0.4)
    assert desk.state == "flying"


def test_a_mode_change_by_the_pilot_ends_the_stream_at_once():
    desk = Desk().come_to("flying", then_s=3.0)
    desk.send_heartbeat(POSCTL)
    took = desk.now_s
    desk.run(4.0)
    assert desk.state == "overridden"
    assert not desk.setpoints(took)
    desk.send_heartbeat(OFFBOARD).run(4.0)  # mode given back: a new command is needed
    assert desk.state == "overridden"
    assert not desk.setpoints(took)
    desk.order(EVACUATION).run(1.0)
    assert desk.state == "flying"
    assert desk.setpoints(took)


def test_with_resume_the_flight_continues_from_the_aircrafts_place_when_the_mode_returns():
    desk = Desk(resume=True).come_to("flying", then_s=5.0)
    desk.send_heartbeat(POSCTL).run(2.0)
    north, east, down = desk.position_ned_m
    desk.position_ned_m = (north, east - 0.5, down - 0.5)  # the pilot moves it
    place = desk.position_ned_m
    took = desk.now_s
    desk.run(2.0)
    assert not desk.setpoints(took)
    desk.send_heartbeat(OFFBOARD).run(0.5)
    first = desk.setpoints(took)[0]
    assert math.dist((first.x, first.y, first.z), place) < 0.01
    assert desk.state == "flying"


@pytest.mark.parametrize(
    "state", ["ready", "flying", pytest.param("at_target", marks=pytest.mark.slow)]
)
def test_an_autopilot_failsafe_ends_the_stream_and_its_end_restarts_nothing(state):
    desk = Desk().come_to(state)
    desk.send_heartbeat(AUTO_HOLD, CRITICAL)
    began = desk.now_s
    desk.run(2.5)
    assert desk.state == "released"
    assert desk.said("failsafe chose HOLD")
    assert not desk.setpoints(began)
    desk.send_heartbeat(OFFBOARD).run(3.0)  # PX4 resumes OFFBOARD by itself
    assert desk.state == "released"
    assert not desk.setpoints(began)


def test_a_failsafe_received_in_the_cycle_of_the_plan_streams_nothing():
    desk = Desk(plan_delay_s=None).run(1.2).order(INSPECTION).step()
    desk.send_heartbeat(AUTO_HOLD, CRITICAL).answer_plan()
    desk.system_status = CRITICAL
    desk.run(2.0)
    assert desk.state == "released"
    assert not desk.setpoints()


def test_an_autopilot_restart_releases():
    desk = Desk().come_to("flying", then_s=2.0)
    desk.run_to_position().boot_s = 1.0
    desk.run(0.36)  # until the new clock has advanced
    began = desk.now_s
    assert desk.state == "released"
    assert desk.said("the autopilot restarted")
    desk.run(6.0)
    assert desk.state == "released"
    assert not desk.setpoints(began)


def test_two_autopilots_refuse_control_and_are_both_named():
    desk = Desk().run(1.2)
    other = Peer(2, 1)
    desk.handle(other.heartbeat()).step()
    desk.order(INSPECTION).run(0.2)
    assert desk.answers() == [TEMPORARILY_REJECTED]
    assert desk.said("two autopilots are received")
    named = next(text for text in desk.texts() if text.startswith("MOAR: two autopilots"))
    assert "ids 1 and 2" in named
    assert not desk.setpoints()


def test_a_second_autopilot_in_flight_ends_the_stream():
    desk = Desk().come_to("flying", then_s=1.0)
    began = desk.now_s
    desk.handle(Peer(2, 1).heartbeat()).run(2.0)
    assert desk.state == "released"
    last = desk.setpoints(began)  # a setpoint at rest, to the flown autopilot
    assert {(m.target_system, m.vx, m.vy, m.vz) for m in last} == {(1, 0.0, 0.0, 0.0)}
    assert not desk.setpoints(began + 0.1)


def test_a_ground_station_and_a_camera_do_not_count_as_autopilots():
    desk = Desk().come_to("flying")
    for system, component, kind in ((255, 190, 6), (1, 100, 30), (1, 195, 18)):
        peer = Peer(system, component)
        desk.handle(peer.pack(mavlink.MAVLink_heartbeat_message(kind, 8, 0, 0, 4, 3)))
    desk.run(2.0)
    assert desk.state == "flying"


@pytest.mark.slow
def test_the_hold_is_offered_for_thirty_seconds():
    desk = Desk().come_to("ready")
    began = desk.now_s
    desk.run(29.5)
    assert desk.state == "ready"
    assert len(desk.setpoints(began)) == pytest.approx(29.5 * 50, abs=2)
    assert {(m.vx, m.vy, m.vz) for m in desk.setpoints(began)} == {(0.0, 0.0, 0.0)}
    desk.run(1.6)  # until the next heartbeat, which has the mode
    assert desk.state == "idle"
    ended = desk.now_s
    desk.run(5.0)
    assert not desk.setpoints(ended)
    assert desk.said("mode not given in 30 s, idle")


@pytest.mark.slow
def test_the_hold_is_not_withdrawn_before_the_mode_at_the_deadline_is_received():
    desk = Desk().come_to("ready")
    began = desk.now_s
    desk.run(29.0).run_to_heartbeat()
    desk.mode = OFFBOARD  # just in time
    while desk.now_s < began + 31.2:
        desk.step()
        assert desk.state in {"ready", "flying"}
    assert desk.state == "flying"
    assert len(desk.setpoints(began)) == pytest.approx(31.2 * 50, abs=2)


def test_the_hold_is_withdrawn_when_the_pilot_flies_away_from_it():
    """With OFFBOARD then, the aircraft would fly back to the hold."""
    desk = Desk().come_to("ready")
    desk.drift(0.0, 1.0, 0.0).run(1.0)
    assert desk.state == "ready"
    desk.drift(0.0, 1.0, 0.0).run(0.1)
    assert desk.state == "idle"
    ended = desk.now_s
    desk.send_heartbeat(OFFBOARD).run(5.0)
    assert not desk.setpoints(ended)
    assert desk.said("the aircraft has left its place")


@pytest.mark.parametrize("kind", [mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA])
@pytest.mark.parametrize(
    ("north_m", "east_m", "up_m", "answer", "words"),
    [
        (22.3, 0.0, 3.0, TEMPORARILY_REJECTED, "22.3 m N of plane > 2, rejected"),
        (-150.0, 0.0, 3.0, TEMPORARILY_REJECTED, "150 m S of plane > 2, rejected"),
        (0.0, 103.0, 3.0, DENIED, "100 m off workspace > 60, E, denied"),
        (0.0, 0.0, 120.0, DENIED, "100 m off workspace > 60, denied"),
    ],
)
def test_an_aircraft_that_is_not_where_the_site_says_is_not_flown(
    kind, north_m, east_m, up_m, answer, words
):
    desk = Desk(autopilot=kind)
    desk.position_ned_m = (north_m, east_m, -up_m)  # of the site's start; the plane runs east
    desk.run(1.2).order(INSPECTION).run(1.0)
    assert desk.answers()[-1] == answer
    assert desk.said(words)
    desk.send_heartbeat(desk.ours).run(1.0)
    assert desk.setpoints() == []


@pytest.mark.parametrize(("north_m", "state"), [(5.0, "flying"), (0.0, "idle")])
def test_on_a_shifted_site_the_aircraft_is_flown_where_the_plane_is_now(north_m, state):
    """The base of the RTK receiver got coordinates 5 m to the north, and so have all positions."""
    usual = usual_planner()
    frame = usual.site.frame.moved(5.0, 0.0, 0.0)
    desk = Desk(planner=Planner(replace(usual.site, frame=frame), usual.vehicle))
    origin = usual.site.frame.to_geodetic((usual.site.start_m[0], 0.0, 0.0))
    desk.origin = (origin.latitude_deg, origin.longitude_deg, origin.altitude_amsl_m)
    desk.position_ned_m = (north_m, 0.0, -3.0)
    desk.run(1.2).order(INSPECTION).run(1.0).send_heartbeat(desk.ours).run(1.0)
    assert desk.state == state
    assert desk.said("5.0 m S of plane > 2, rejected") == (state == "idle")


def test_an_aircraft_slightly_beside_the_plane_flies_from_there_into_the_plane():
    desk = Desk()
    desk.position_ned_m = (1.5, 0.0, -3.0)
    desk.come_to("flying")
    first = desk.setpoints()[0]
    assert (first.x, first.y, first.z) == pytest.approx((1.5, 0.0, -3.0), abs=0.01)
    desk.run(10.0)
    assert desk.position_ned_m[0] == pytest.approx(0.0, abs=0.02)


def test_on_the_ground_the_stream_ends():
    desk = Desk().come_to("flying")
    desk.landed_state = 1
    desk.run(0.3)
    began = desk.now_s
    assert desk.state == "idle"
    desk.landed_state = 2
    desk.run(4.0)
    assert not desk.setpoints(began)


@pytest.mark.parametrize("case", ["unknown", "silent"])
def test_while_the_landed_state_is_unknown_the_flight_goes_on_and_the_escape_route_stays_open(case):
    desk = Desk().come_to("flying", then_s=2.0)
    if case == "unknown":
        desk.landed_state = 0
    else:
        desk.mute = {"EXTENDED_SYS_STATE"}
    desk.run(6.0)
    assert desk.state == "flying"
    desk.order(EVACUATION).run(0.5)
    assert desk.answers()[-1] == ACCEPTED
    assert desk.state == "flying"


def test_blown_off_the_plane_the_escape_route_stays_open():
    desk = Desk().come_to("flying", then_s=2.0)
    desk.fall_behind(2.5, 0.0, 0.0)
    desk.order(EVACUATION).run(0.5)
    assert (desk.state, desk.answers()[-1]) == ("flying", ACCEPTED)


def test_a_pilot_who_lands_and_takes_off_again_is_not_resumed():
    desk = Desk(resume=True).come_to("flying", then_s=4.0)
    desk.send_heartbeat(POSCTL).run(2.0)
    desk.landed_state = 1
    desk.run(1.0)
    assert desk.state == "idle"
    took = desk.now_s
    desk.landed_state = 2
    desk.run(1.0).send_heartbeat(OFFBOARD).run(5.0)
    assert desk.state == "idle"
    assert not desk.setpoints(took)


@pytest.mark.parametrize("mission", [INSPECTION, EVACUATION])
def test_a_mode_that_is_left_and_returns_between_two_cycles_ends_control(mission):
    desk = Desk().come_to("flying", mission, then_s=4.0)
    left = desk.now_s
    desk.send_heartbeat(POSCTL).send_heartbeat(OFFBOARD).run(2.0)
    assert desk.state == "overridden"
    assert desk.said("MOAR: autopilot was in POSCTL")
    assert not desk.setpoints(left)


def test_nothing_is_resumed_after_the_autopilots_restart_in_the_air():
    desk = Desk(resume=True).come_to("flying", then_s=4.0)
    desk.send_heartbeat(POSCTL).run(2.0)
    desk.boot_s = 0.5
    desk.run(1.0)
    assert desk.state == "released"
    restarted = desk.now_s
    desk.send_heartbeat(OFFBOARD).run(5.0)
    assert desk.state == "released"
    assert not desk.setpoints(restarted)


def test_a_held_mission_is_not_resumed_after_a_takeover():
    desk = Desk(resume=True).come_to("flying", then_s=4.0).pause().run(2.0)
    desk.send_heartbeat(POSCTL).run(2.0)
    took = desk.now_s
    desk.send_heartbeat(OFFBOARD).run(5.0)
    assert desk.state == "overridden"
    assert not desk.setpoints(took)


@pytest.mark.slow
def test_a_completed_mission_is_not_resumed_after_a_takeover():
    desk = Desk(resume=True).come_to("holding")
    desk.send_heartbeat(POSCTL).run(2.0).send_heartbeat(OFFBOARD).run(5.0)
    assert desk.state == "overridden"


def test_a_failsafe_while_the_pilot_flies_releases():
    desk = Desk(resume=True).come_to("flying", then_s=4.0)
    desk.send_heartbeat(POSCTL).run(1.0).send_heartbeat(AUTO_HOLD, CRITICAL).run(0.1)
    assert desk.state == "released"


@flown_once
def at_the_end(behind_m):
    """At the end of the path to a target, with the aircraft `behind_m` away from it."""
    desk = Desk().come_to("flying")
    desk.fall_behind(0.0, behind_m, 0.0)
    while not desk.companion.state.routes.flight.arrived:
        desk.step()
    return desk


@pytest.mark.slow
def test_the_target_is_reached_only_when_the_aircraft_reaches_it():
    desk = at_the_end(0.8).run(2.0)
    assert desk.state == "flying"
    desk.fall_behind(0.0, 0.3, 0.0)
    assert desk.state == "at_target"


@pytest.mark.slow
def test_the_target_is_reached_when_the_aircraft_stays_slightly_beside_its_setpoint():
    desk = at_the_end(0.8).run(4.9)
    assert desk.state == "flying"
    desk.run(0.2)
    assert desk.state == "at_target"


@pytest.mark.slow
def test_the_target_is_not_reached_when_the_aircraft_stays_far_from_its_setpoint():
    desk = at_the_end(0.8).fall_behind(0.0, 1.6, 0.0).run(20.0)
    assert not desk.said("MOAR: at target")
    assert desk.said("MOAR: no progress, 1.6 m from setpoint")


def test_the_nose_does_not_turn_before_the_aircraft_follows():
    desk = Desk().come_to("ready", then_s=5.0)
    assert [m.yaw for m in desk.setpoints()] == pytest.approx([0.3] * len(desk.setpoints()))
    desk.send_heartbeat(OFFBOARD).run(5.0)
    yaws = [0.3, *(m.yaw for m in desk.setpoints())]
    assert abs(yaws[-1] - 0.3) > 0.5
    turned = [math.remainder(new - old, math.tau) for old, new in itertools.pairwise(yaws)]
    assert max(map(abs, turned)) <= desk.vehicle.guidance.yaw_rate_radps * 0.02 + 1e-6


def test_a_pilot_who_turns_before_giving_the_mode_causes_no_turn_at_engagement():
    desk = Desk().come_to("ready").set(yaw_rate_radps=0.3)
    for _ in range(400):
        desk.set(yaw_rad=desk.yaw_rad + 0.3 * STEP_S).step()
    desk.set(yaw_rate_radps=0.0).run(0.1)
    desk.send_heartbeat(OFFBOARD).step()
    assert desk.state == "flying"
    fastest_rad = desk.vehicle.guidance.yaw_rate_radps * STEP_S
    assert desk.setpoints()[-1].yaw == pytest.approx(desk.yaw_rad, abs=fastest_rad + 1e-3)


def test_a_shorter_position_timeout_is_kept():
    desk = Desk(supervision=Supervision(position_timeout_s=0.2)).come_to("flying")
    desk.mute = {"LOCAL_POSITION_NED"}
    desk.run(0.3)
    assert desk.state == "released"


def test_a_heading_that_is_no_number_is_held_and_never_sent():
    desk = Desk().come_to("flying", then_s=2.0)
    desk.companion.state.routes.flight._yaw_rad = math.nan
    began = desk.now_s
    desk.run(0.5)
    assert desk.state == "holding"
    assert desk.said("MOAR: setpoint not finite, holding")
    setpoints = desk.setpoints(began)
    assert len(setpoints) == 25
    assert all(math.isfinite(m.yaw) and not any((m.vx, m.vy, m.vz)) for m in setpoints)


def test_conditions_that_begin_or_end_together_are_recorded_in_the_order_of_the_ruling():
    """The order is the same in each process, whatever the hashes of strings."""
    desk = Desk()
    desk.companion.tick(desk.now_s)
    acting = [item.condition.name for item in desk.companion.ruling.conditions]
    assert len(acting) > 5
    began = [item.data["name"] for item in desk.companion.decisions() if item.kind == "condition"]
    assert began == acting
    desk.step()
    ended = [item["name"] for item in desk.decided("condition") if not item["began"]]
    assert len(ended) > 4
    assert ended == sorted(ended, key=acting.index)
