"""Received packets of a session: autopilot, telemetry, restarts, invalid packets."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from moar_companion.mavlink.codec import checksum
from moar_companion.mavlink.commands import MissionCommand
from moar_companion.mavlink.dialect import create, mavlink
from moar_companion.mavlink.identity import AutopilotConflict, AutopilotFound, AutopilotRestarted
from moar_companion.mavlink.session import CommandAnswered, Session, SystemStatus
from moar_companion.mavlink.telemetry_receiver import ModeLeft
from moar_companion.settings.link_config import LinkRole
from moar_companion.types import ARDUPILOT, PX4

from .messages import message_of
from .story import Story, commands, of_type, types

USER_1 = 31010
SET_MESSAGE_INTERVAL = 511
MAV_ARDUPILOT = mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA


# Identity


def test_the_system_id_is_the_configured_one_until_an_autopilot_is_received(peer):
    story = Story(system_id=3)
    story.tick()
    assert {m.get_srcSystem() for _, m in story.sent()} == {3}
    story.handle(peer(7, 1).heartbeat())
    assert story.session.system_id == 7
    story.now_s += 0.02
    story.tick()
    sent = story.sent()
    # A heartbeat is sent at once, so that the autopilot routes to the new id.
    assert types(sent)[:2] == ["HEARTBEAT", "HEARTBEAT"]
    assert {m.get_srcSystem() for _, m in sent} == {7}
    (event,) = story.events()
    assert isinstance(event, AutopilotFound)
    assert event.autopilot.kind is PX4


def test_an_autopilot_on_an_operator_link_is_not_latched(story, autopilot):
    story.handle(autopilot.heartbeat(), link="network")
    assert story.session.autopilot is None
    assert story.session.telemetry.autopilot is None


def test_a_second_autopilot_ends_control_and_the_event_names_both(story, autopilot, peer):
    story.meet(autopilot)
    assert story.session.conflict is None
    other = peer(2, 1)
    story.handle(other.heartbeat(autopilot=MAV_ARDUPILOT))
    (event,) = story.events()
    assert isinstance(event, AutopilotConflict)
    assert (event.autopilot.system_id, event.other.system_id) == (1, 2)
    assert story.session.conflict is not None
    assert not story.session.send_setpoint((0, 0, 0), (0, 0, 0.1), 0.0, story.now_s)
    assert not story.session.request_own_mode(story.now_s)
    assert not story.session.request_land(story.now_s)
    for _ in range(11):  # the other falls silent
        story.handle(autopilot.heartbeat())
        story.run(1.0)
    assert story.session.conflict is None


def test_during_a_conflict_a_setpoint_at_rest_is_sent_to_the_flown_autopilot(
    story, autopilot, peer
):
    story.meet(autopilot)
    story.handle(peer(2, 1).heartbeat())
    story.sent()
    assert story.session.send_setpoint((4, 5, -6), (0, 0, 0), 0.0, story.now_s)
    ((link, message),) = story.sent()
    assert (link, message.target_system, message.target_component) == ("serial", 1, 1)
    assert (message.x, message.vx, message.vy, message.vz) == (4.0, 0.0, 0.0, 0.0)


def test_telemetry_comes_from_the_latched_autopilot_alone(story, autopilot, peer):
    story.handle(autopilot.attitude(1.0))
    assert story.session.telemetry.attitude is None
    story.meet(autopilot)
    story.handle(peer(2, 1).attitude(1.0, roll=0.7))
    story.handle(peer(1, 2).attitude(1.0, roll=0.7))
    story.handle(autopilot.attitude(1.0), link="network")
    assert story.session.telemetry.attitude is None
    story.handle(autopilot.attitude(1.0, roll=0.25))
    assert story.session.telemetry.attitude.roll_rad == 0.25
    assert story.session.telemetry.attitude.received_s == story.now_s


def test_a_radio_and_a_ground_station_are_received_besides_the_autopilot(
    story, peer, ground_station
):
    radio = peer(51, 68)
    story.handle(
        radio.send(
            "RADIO_STATUS",
            rssi=200,
            remrssi=190,
            txbuf=100,
            noise=40,
            remnoise=41,
            rxerrors=0,
            fixed=0,
        )
    )
    story.handle(ground_station.ground_heartbeat(), link="network")
    assert story.session.telemetry.radio.rssi == 200
    assert story.session.telemetry.ground_station.system_id == 255


@pytest.mark.parametrize(
    ("kind", "asked"), [(MAV_ARDUPILOT, True), (mavlink.MAV_AUTOPILOT_PX4, False)]
)
def test_the_receiver_choice_is_requested_of_ardupilot_with_two_receivers(
    story, autopilot, kind, asked
):
    story.meet(autopilot, autopilot=kind)
    assert not of_type(story.run(1.0), "PARAM_REQUEST_READ")
    story.handle(autopilot.pack(message_of("GPS2_RAW", fix_type=3)))
    names = {message.param_id for message in of_type(story.run(1.0), "PARAM_REQUEST_READ")}
    assert names == ({"GPS_AUTO_SWITCH", "GPS_PRIMARY"} if asked else set())


def test_only_the_autopilots_packets_count_for_the_link(story, autopilot, ground_station):
    story.meet(autopilot)
    for _ in range(9):
        autopilot.skip(1)
        story.handle(autopilot.heartbeat())
        ground_station.skip(5)
        story.handle(ground_station.ground_heartbeat())
    story.tick()
    link = story.session.telemetry.link
    assert (link.packets_received, link.packets_lost) == (10, 9)
    assert link.received_s == story.now_s


def test_echoes_of_the_companions_packets_are_ignored(story, autopilot, peer):
    story.meet(autopilot)
    echo = peer(1, 195)
    story.handle(echo.command(USER_1, 1))
    story.handle(echo.ground_heartbeat())
    assert story.events() == []
    assert story.session.telemetry.ground_station is None


def test_received_packets_of_all_links_are_kept_until_read(story, autopilot, ground_station):
    first = autopilot.heartbeat()
    second = ground_station.ground_heartbeat()
    story.handle(first[:7])
    story.now_s += 1.0
    story.handle(first[7:])
    story.handle(second, link="network")
    assert story.session.received_packets() == [(101.0, first), (101.0, second)]
    assert story.session.received_packets() == []


def test_unread_packets_are_limited_in_number(story, autopilot):
    for _ in range(5000):
        story.handle(autopilot.heartbeat())
    assert len(story.session.received_packets()) == 4096


def test_a_mode_left_and_restored_at_once_is_an_event(story, autopilot):
    for mode in (4, 5, 4, 4):
        story.handle(autopilot.heartbeat(autopilot=MAV_ARDUPILOT, custom_mode=mode))
    found, left = story.events()
    assert isinstance(found, AutopilotFound)
    assert left == ModeLeft(mode="LOITER")
    assert story.session.telemetry.autopilot.ours


# Restart


def test_after_an_autopilot_restart_all_messages_are_requested_again(story, autopilot):
    story.meet(autopilot, autopilot=MAV_ARDUPILOT, custom_mode=4)
    first = story.run(2.0)
    assert len(commands(first, SET_MESSAGE_INTERVAL)) > 0
    for _ in range(20):
        for request in commands(story.run(0.1), SET_MESSAGE_INTERVAL):
            assert request.target_system == 1
            story.handle(autopilot.acknowledge(SET_MESSAGE_INTERVAL, 0))
    story.handle(autopilot.heartbeat(autopilot=MAV_ARDUPILOT, custom_mode=4))
    story.handle(autopilot.attitude(500.0))
    assert story.session.telemetry.attitude is not None
    story.now_s += 1.2
    story.handle(autopilot.attitude(0.3))  # may be a late packet
    assert story.events() == []
    story.now_s += 0.1
    story.handle(autopilot.attitude(0.4))
    assert story.events() == []
    story.now_s += 0.25
    story.handle(autopilot.attitude(0.65))
    (event,) = story.events()
    assert isinstance(event, AutopilotRestarted)
    story.now_s += 0.02
    story.handle(autopilot.heartbeat(autopilot=MAV_ARDUPILOT))
    story.tick()
    sent = story.sent()
    assert types(sent)[0] == "HEARTBEAT"
    assert len(commands(sent, SET_MESSAGE_INTERVAL)) == 1


def test_an_autopilot_restart_clears_its_telemetry(story, autopilot):
    story.meet(autopilot)
    story.handle(
        autopilot.send("GPS_GLOBAL_ORIGIN", latitude=1, longitude=2, altitude=3, time_usec=0)
    )
    story.handle(autopilot.attitude(100.0))
    story.handle(autopilot.heartbeat(system_status=mavlink.MAV_STATE_BOOT))
    (event,) = story.events()
    assert isinstance(event, AutopilotRestarted)
    telemetry = story.session.telemetry
    assert telemetry.local_origin is None
    assert telemetry.attitude is None
    assert telemetry.autopilot is not None
    story.handle(autopilot.attitude(1.0))  # the clock starts again: no second restart
    story.handle(autopilot.attitude(1.1))
    assert story.events() == []


# Any packets


@given(
    st.lists(
        st.tuples(
            st.sampled_from(sorted(mavlink.mavlink_map)),
            st.binary(max_size=80),
            st.sampled_from([(1, 1), (1, 195), (255, 190), (51, 68), (2, 1)]),
        ),
        max_size=20,
    )
)
def test_no_message_raises_an_error(packets):
    session = Session(links={"serial": LinkRole.AUTOPILOT})
    session.tick(0.0, SystemStatus.BOOT)
    greeter = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    beat = create(
        "HEARTBEAT",
        type=2,
        autopilot=12,
        base_mode=0,
        custom_mode=0,
        system_status=3,
        mavlink_version=3,
    )
    session.receive("serial", bytes(beat.pack(greeter)), 0.0)
    for index, (message_id, payload, source) in enumerate(packets):
        header = bytes([len(payload), 0, 0, index, *source]) + message_id.to_bytes(3, "little")
        value = checksum(header + payload + bytes([mavlink.mavlink_map[message_id].crc_extra]))
        data = b"\xfd" + header + payload + value.to_bytes(2, "little")
        session.receive("serial", data, index * 0.1)
        session.tick(index * 0.1, SystemStatus.ACTIVE)
        session.data_to_send()
    session.events_received()


@given(st.binary(max_size=500))
def test_no_bytes_raise_an_error(data):
    session = Session(links={"serial": LinkRole.AUTOPILOT})
    session.receive("serial", data, 0.0)


# Recorded autopilots


def replayed(packets, *, component_id=195):
    session = Session(links={"serial": LinkRole.AUTOPILOT}, component_id=component_id)
    events = []
    next_s = 0.0
    for time_s, packet in packets:
        session.receive("serial", packet, time_s)
        if time_s >= next_s:
            session.tick(time_s, SystemStatus.ACTIVE)
            session.data_to_send()
            next_s = time_s + 0.02
        events += session.events_received()
    return session, events


@pytest.mark.recordings
@pytest.mark.parametrize(
    ("name", "kind", "restarts"),
    [
        ("px4/a1_boot_offboard_takeoff.companion.tlog", PX4, 0),
        ("px4/k1_nogcs_autopilot_restart.companion.tlog", PX4, 1),
        ("ardupilot/a2_square.companion.tlog", ARDUPILOT, 0),
        ("ardupilot/h2_signing.companion.tlog", ARDUPILOT, 1),
    ],
)
def test_a_recorded_autopilot_is_found_followed_and_its_restarts_detected(
    recording, name, kind, restarts
):
    session, events = replayed(recording(name))
    assert session.autopilot.kind is kind
    assert sum(isinstance(event, AutopilotFound) for event in events) == 1
    assert sum(isinstance(event, AutopilotRestarted) for event in events) == restarts
    assert not any(isinstance(event, AutopilotConflict) for event in events)
    assert session.telemetry.autopilot.system_id == 1
    assert session.telemetry.link.packets_lost == 0


@pytest.mark.recordings
def test_px4s_answers_to_mode_requests_of_others_are_ignored(recording):
    _, events = replayed(recording("px4/a1_boot_offboard_takeoff.companion.tlog"))
    assert not [event for event in events if isinstance(event, CommandAnswered)]


@pytest.mark.recordings
def test_commands_routed_by_ardupilot_are_understood(recording):
    session, _ = replayed(recording("ardupilot/g1_routing.companion.tlog"))
    missions = [item for item in session.commands.waiting if isinstance(item, MissionCommand)]
    assert missions
    assert missions[0].command == USER_1


# Obstacles

OBSTACLE_DISTANCE = 330


def test_obstacles_of_a_sensor_reach_the_telemetry(story, autopilot, peer):
    story.meet(autopilot)
    sensor = peer(1, mavlink.MAV_COMP_ID_OBSTACLE_AVOIDANCE)
    fields = {"distances": [65535] * 18 + [400] + [65535] * 53, "max_distance": 3000}
    message = message_of("OBSTACLE_DISTANCE", increment=5, frame=12, time_usec=1, **fields)
    story.handle(sensor.pack(message))
    assert story.session.telemetry.proximity.points_m == (pytest.approx((0.0, -4.0, 0.0)),)


@pytest.mark.parametrize("wanted", [False, True])
def test_obstacles_are_requested_of_the_autopilot_only_where_they_are_used(wanted, autopilot):
    story = Story(obstacles=wanted)
    story.meet(autopilot, autopilot=MAV_ARDUPILOT)
    sent = []
    for _ in range(15):  # without answers, one request each half second
        story.handle(autopilot.heartbeat(autopilot=MAV_ARDUPILOT))
        sent += story.run(1.0)
    requested = {each.param1: each.param2 for each in commands(sent, SET_MESSAGE_INTERVAL)}
    assert requested.get(OBSTACLE_DISTANCE) == (200_000 if wanted else None)
