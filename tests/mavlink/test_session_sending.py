"""Sent packets of a session: heartbeats, requests, answers, modes, setpoints, texts, time."""

from __future__ import annotations

import math
from collections import Counter
from functools import partial

import pytest

from moar_companion.mavlink.codec import Codec
from moar_companion.mavlink.commands import CommandCancelled, CommandResult, MissionCommand
from moar_companion.mavlink.component.named_values import NAMED_VALUES
from moar_companion.mavlink.dialect import mavlink
from moar_companion.mavlink.session import CommandAnswered, Session, Severity, SystemStatus
from moar_companion.settings.link_config import LinkRole

from .peer import Peer
from .story import Story, commands, of_type, types

USER_1 = 31010
SET_MESSAGE_INTERVAL = 511
REQUEST_MESSAGE, AUTOPILOT_VERSION = 512, 148
DO_SET_MODE = 176
UDP, SERIAL = "udp:127.0.0.1:14540", "serial:/dev/ttyTHS1:57600"
ARDUPILOT = mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA


# Heartbeat


def test_a_heartbeat_is_the_first_packet_sent(story, autopilot, ground_station):
    story.handle(autopilot.heartbeat())
    story.handle(ground_station.command(401))
    story.handle(autopilot.send("TIMESYNC", tc1=0, ts1=1, target_system=0, target_component=0))
    story.session.send_text(Severity.INFO, "hello", story.now_s)
    assert story.session.data_to_send() == []
    story.tick(SystemStatus.STANDBY)
    sent = story.sent()
    assert types(sent)[:2] == ["HEARTBEAT", "HEARTBEAT"]
    assert {link for link, _ in sent[:2]} == {"serial", "network"}
    assert "STATUSTEXT" in types(sent)


def test_the_heartbeat_is_an_onboard_controllers(story):
    story.tick(SystemStatus.CRITICAL)
    for _, message in story.sent():
        assert (message.type, message.autopilot) == (18, 8)
        assert (message.base_mode, message.system_status) == (0, 5)
        assert (message.get_srcSystem(), message.get_srcComponent()) == (1, 195)


def test_the_heartbeat_comes_once_a_second_on_each_link(story):
    sent = [item for item in story.run(10.0) if item[2].get_type() == "HEARTBEAT"]
    assert len(sent) == 20
    times = sorted({time_s for time_s, _, _ in sent})
    assert times == pytest.approx([100.02 + index for index in range(10)], abs=0.021)


def test_a_companion_without_cycles_for_a_while_does_not_catch_up(story):
    story.run(1.0)
    story.now_s += 30.0
    assert len(of_type(story.run(0.5), "HEARTBEAT")) == 2


LOADS = {
    "values to plot": (38400, 50, 45, 0),
    "texts": (57600, 50, 12, 50),
    "more setpoints than it carries": (57600, 100, 10, 0),
}
"""Rate of the line, of the setpoints; seconds; texts a second."""


@pytest.mark.uncounted
@pytest.mark.parametrize("load", LOADS)
def test_no_load_of_a_line_stops_heartbeats_and_acknowledgements_of_any_link(
    load, autopilot, ground_station
):
    baud, setpoint_hz, duration_s, texts_hz = LOADS[load]
    line, network = f"serial:/dev/ttyTHS1:{baud}", "udp:0.0.0.0:14550"
    reader = Codec(system_id=9, component_id=9)
    session = Session(links={line: LinkRole.AUTOPILOT, network: LinkRole.OPERATOR})
    session.services.values.take(dict.fromkeys(NAMED_VALUES, 1.0))
    sent = Counter()
    for cycle in range(duration_s * setpoint_hz):
        now_s = 100.0 + cycle / setpoint_hz
        if cycle % setpoint_hz == 0:
            session.receive(line, autopilot.heartbeat(), now_s)
            for link in (line, network):
                session.receive(link, ground_station.command(401), now_s)
        for number in range(texts_hz // setpoint_hz):
            session.send_text(Severity.INFO, f"{cycle} {number}".rjust(50), now_s)
        session.tick(now_s, SystemStatus.ACTIVE)
        session.send_setpoint((0.0, 0.0, -10.0), (1.0, 0.0, 0.0), 0.0, now_s)
        for link, data in [*session.control_to_send(), *session.data_to_send(control=False)]:
            sent.update((link, message.get_type()) for message in reader.receive(data))
    for name in ("HEARTBEAT", "COMMAND_ACK"):
        assert {sent[link, name] for link in (line, network)} == {duration_s}


# Requests


def test_a_heartbeat_is_requested_once_a_second_of_an_autopilot_without_one(story, autopilot):
    requests = []
    for _ in range(25):
        story.handle(autopilot.attitude(1.0))
        requests += commands(story.run(0.1), REQUEST_MESSAGE)
    asked = [(item.target_system, item.target_component, item.param1) for item in requests]
    assert asked == 3 * [(1, 1, mavlink.MAVLINK_MSG_ID_HEARTBEAT)]
    story.handle(autopilot.heartbeat())
    later = {item.param1 for item in commands(story.run(3.0), REQUEST_MESSAGE)}
    assert mavlink.MAVLINK_MSG_ID_HEARTBEAT not in later


@pytest.mark.parametrize(("link", "component_id"), [("network", 1), ("serial", 191)])
def test_a_heartbeat_is_requested_of_no_other_component(story, peer, link, component_id):
    story.handle(peer(1, component_id).attitude(1.0), link=link)
    assert commands(story.run(3.0), REQUEST_MESSAGE) == []


def test_only_streams_that_px4_does_not_send_are_requested(story, autopilot):
    story.meet(autopilot)
    asked = []
    for step in range(500):
        if step % 50 == 0:
            story.handle(autopilot.heartbeat())
        story.handle(autopilot.attitude(1.0 + step * 0.02))
        sent = story.run(0.02)
        asked += commands(sent, SET_MESSAGE_INTERVAL)
        for _ in commands(sent, SET_MESSAGE_INTERVAL):
            story.handle(autopilot.acknowledge(SET_MESSAGE_INTERVAL, 0))
    wanted = {int(m.param1): m.param2 for m in asked}
    assert mavlink.MAVLINK_MSG_ID_ATTITUDE not in wanted
    assert wanted[mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED] == 25000
    assert len(asked) == len(wanted)
    assert {(m.target_system, m.target_component) for m in asked} == {(1, 1)}


def test_the_requested_rates_are_configurable(autopilot):
    story = Story(message_rates_hz={74: 4.0})
    story.meet(autopilot, autopilot=ARDUPILOT)
    (request,) = commands(story.run(0.5), SET_MESSAGE_INTERVAL)
    assert (request.param1, request.param2) == (74, 250000)


@pytest.mark.parametrize(("first", "then", "mode_hz"), [(UDP, SERIAL, 20), (SERIAL, UDP, 50)])
def test_an_autopilot_on_another_link_is_requested_the_rates_of_that_link(
    autopilot, first, then, mode_hz
):
    """More than 20 Hz of the mode does not fit a serial port; fewer report a takeover late."""
    reader = Codec(system_id=9, component_id=9)
    session = Session(
        links=dict.fromkeys((UDP, SERIAL), LinkRole.AUTOPILOT),
        message_rates_hz={mavlink.MAVLINK_MSG_ID_HEARTBEAT: 20.0},
    )
    now_s, asked = 100.0, {}
    for cycle in range(600):
        now_s += 0.02
        link = first if cycle < 100 else then
        if cycle % 10 == 0:
            session.receive(link, autopilot.heartbeat(autopilot=ARDUPILOT), now_s)
        session.tick(now_s, SystemStatus.ACTIVE)
        for on, data in session.data_to_send():
            for message in reader.receive(data):
                if message.get_type() == "COMMAND_LONG" and message.command == SET_MESSAGE_INTERVAL:
                    asked[on] = message.param2
    assert asked == {first: 1e6 / (70 - mode_hz), then: 1e6 / mode_hz}


def test_no_request_is_sent_to_a_silent_autopilot(story, autopilot):
    story.meet(autopilot)
    story.run(3.0)
    assert set(types(story.run(60.0))) == {"HEARTBEAT"}


def test_origin_and_home_are_requested_until_received_and_the_origin_always(story, autopilot):
    story.meet(autopilot)

    def asked(duration_s):
        numbers = []
        for _ in range(duration_s):
            story.handle(autopilot.heartbeat())
            numbers += [int(m.param1) for m in commands(story.run(1.0), REQUEST_MESSAGE)]
        return [number for number in numbers if number != AUTOPILOT_VERSION]

    assert sorted(asked(10)) == [49] * 5 + [242] * 5
    story.handle(
        autopilot.send("GPS_GLOBAL_ORIGIN", latitude=1, longitude=2, altitude=3, time_usec=0)
    )
    story.handle(
        autopilot.send(
            "HOME_POSITION",
            latitude=1,
            longitude=2,
            altitude=3,
            x=0.0,
            y=0.0,
            z=0.0,
            q=[1.0, 0.0, 0.0, 0.0],
            approach_x=0.0,
            approach_y=0.0,
            approach_z=0.0,
            time_usec=0,
        )
    )
    assert asked(20) == [49] * 3
    assert story.session.telemetry.home is not None


# Commands


def test_a_mission_command_reaches_the_service_and_its_answer_the_sender(
    story, autopilot, ground_station
):
    story.meet(autopilot)
    story.handle(ground_station.command(USER_1, 3, math.nan), link="network")
    (command,) = story.session.commands.waiting
    assert isinstance(command, MissionCommand)
    assert command.sender.link == "network"
    assert story.session.answer(command, CommandResult.IN_PROGRESS, story.now_s, progress=50)
    assert story.session.answer(command, CommandResult.ACCEPTED, story.now_s)
    assert not story.session.answer(command, CommandResult.FAILED, story.now_s)
    sent = story.sent()
    assert [link for link, _ in sent] == ["network", "network"]
    acknowledged = of_type(sent, "COMMAND_ACK")
    assert [(m.result, m.progress) for m in acknowledged] == [(5, 50), (0, 0)]
    for message in acknowledged:
        assert (message.get_srcSystem(), message.get_srcComponent()) == (1, 195)
        assert (message.target_system, message.target_component) == (255, 190)


def test_an_unknown_command_is_answered_at_once_and_a_broadcast_one_is_not(
    story, autopilot, ground_station
):
    story.meet(autopilot)
    story.handle(ground_station.command(401, target=(1, 195)))
    story.handle(autopilot.command(1000, math.nan, target=(1, 0)))
    story.handle(autopilot.command(1001, target=(1, 0)))
    (acknowledged,) = of_type(story.sent(), "COMMAND_ACK")
    assert (acknowledged.command, acknowledged.result) == (401, 3)


def test_a_repeat_is_answered_on_the_link_it_came_from(story, autopilot, ground_station):
    story.meet(autopilot)
    story.handle(ground_station.command(USER_1, 1))
    story.handle(ground_station.command(USER_1, 1), link="network")
    assert len(story.session.commands.waiting) == 1
    ((link, message),) = story.sent()
    assert (link, message.result) == ("network", 5)


def test_a_cancel_is_reported_to_the_service_and_to_the_sender(story, autopilot, ground_station):
    story.meet(autopilot)
    story.handle(ground_station.command(USER_1, 1))
    (command,) = story.session.commands.waiting
    story.handle(ground_station.cancel(USER_1))
    assert story.events() == [CommandCancelled(command=command)]
    assert story.session.commands.waiting == []
    ((_, message),) = story.sent()
    assert message.result == CommandResult.CANCELLED


# Modes


@pytest.mark.parametrize(
    ("kind", "base_mode", "own", "land"),
    [
        (mavlink.MAV_AUTOPILOT_PX4, 29, [1, 6, 0], [1, 4, 6]),
        (mavlink.MAV_AUTOPILOT_PX4, 157, [129, 6, 0], [129, 4, 6]),
        (ARDUPILOT, 217, [1, 4, 0], [1, 9, 0]),
    ],
)
def test_a_mode_is_requested_once_in_the_autopilots_form(
    story, autopilot, kind, base_mode, own, land
):
    story.meet(autopilot, autopilot=kind, base_mode=base_mode)
    assert story.session.request_own_mode(story.now_s)
    assert story.session.request_land(story.now_s)
    sent = story.sent()
    assert {link for link, _ in sent} == {"serial"}
    asked = [[m.param1, m.param2, m.param3] for m in commands(sent, DO_SET_MODE)]
    assert asked == [own, land]
    assert commands(story.run(10.0), DO_SET_MODE) == []


def test_no_mode_is_requested_of_an_unknown_autopilot(story, autopilot):
    story.meet(autopilot, autopilot=mavlink.MAV_AUTOPILOT_GENERIC)
    assert not story.session.request_own_mode(story.now_s)
    assert not Story().session.request_land(1.0)


def test_an_answer_to_a_mode_request_is_an_event_even_if_broadcast(
    story, autopilot, ground_station
):
    story.meet(autopilot)
    story.handle(autopilot.acknowledge(DO_SET_MODE, 4, target=(0, 0)))  # of another system
    story.session.request_own_mode(story.now_s)
    story.handle(autopilot.acknowledge(DO_SET_MODE, 0))
    story.handle(autopilot.acknowledge(DO_SET_MODE, 5))  # in progress
    story.handle(autopilot.acknowledge(DO_SET_MODE, 1, target=(0, 0)))
    story.handle(autopilot.acknowledge(DO_SET_MODE, 4, target=(255, 190)))
    story.handle(ground_station.acknowledge(DO_SET_MODE, 4))
    assert story.events() == [
        CommandAnswered(command=DO_SET_MODE, result=0),
        CommandAnswered(command=DO_SET_MODE, result=1),
    ]


def test_the_answer_to_a_mode_request_after_a_stall_is_an_event(story, autopilot):
    story.meet(autopilot)
    story.now_s += 4.0  # the control loop stalls; the request is made in the cycle after it
    story.session.request_own_mode(story.now_s)
    story.handle(autopilot.acknowledge(DO_SET_MODE, 0))
    assert story.events() == [CommandAnswered(command=DO_SET_MODE, result=0)]
    assert not story.session.mode_unanswered


# Setpoints, values, texts


def test_a_setpoint_goes_to_the_autopilot_on_its_link(story, peer):
    story.meet(peer(7, 1))
    assert story.session.send_setpoint((1.0, 2.0, -3.0), (0.5, 0.0, 0.0), 0.25, story.now_s)
    ((link, message),) = story.sent()
    assert link == "serial"
    assert (message.target_system, message.target_component) == (7, 1)
    assert (message.type_mask, message.x, message.vx, message.yaw) == (0x9C0, 1.0, 0.5, 0.25)


def test_no_setpoint_is_sent_without_an_autopilot(story):
    story.tick()
    story.sent()
    assert not story.session.send_setpoint((0, 0, 0), (0, 0, 0), 0.0, story.now_s)
    assert story.sent() == []


def test_a_setpoint_that_is_not_finite_is_refused(story, autopilot):
    story.meet(autopilot)
    with pytest.raises(ValueError, match="finite"):
        story.session.send_setpoint((math.nan, 0, 0), (0, 0, 0), 0.0, story.now_s)
    assert story.sent() == []


def test_values_and_texts_go_to_all_links(story, autopilot):
    story.meet(autopilot)
    story.session.services.values.take({"RISK_WIND": 0.25, "RISK_COMM": math.nan, "TO_GO": None})
    story.session.send_text(Severity.WARNING, "w" * 60, story.now_s)
    story.session.send_text(Severity.WARNING, "w" * 60, story.now_s + 9.0)
    sent = story.sent()
    assert [(link, m.get_type()) for link, m in sent] == [
        ("serial", "STATUSTEXT"),
        ("network", "STATUSTEXT"),
        ("serial", "STATUSTEXT"),
        ("network", "STATUSTEXT"),
    ]
    plotted = [(on, m) for _, on, m in story.run(0.4) if m.get_type() == "NAMED_VALUE_FLOAT"]
    assert [(on, m.value) for on, m in plotted] == [("serial", 0.25), ("network", 0.25)]


def test_each_link_has_a_sequence_of_its_own(story, autopilot):
    story.meet(autopilot)
    story.run(5.0)
    for reader in story._readers.values():
        assert reader.statistics(1, 195).lost == 0
    assert story._readers["serial"].statistics(1, 195).received > 5


# Time


def timesync(sender, *, tc1=0, target=(0, 0)):
    return sender.send(
        "TIMESYNC", tc1=tc1, ts1=-5, target_system=target[0], target_component=target[1]
    )


def test_time_requests_of_the_autopilot_are_answered_with_the_companions_clock(story, autopilot):
    story.meet(autopilot)
    story.handle(timesync(autopilot))
    ((link, message),) = story.sent()
    assert (link, message.tc1, message.ts1) == ("serial", 100_000_000_000, -5)
    assert (message.target_system, message.target_component) == (1, 1)


def test_other_time_requests_are_answered_only_when_addressed_to_the_companion(
    story, autopilot, ground_station
):
    story.meet(autopilot)
    story.handle(timesync(ground_station))
    story.handle(timesync(ground_station, target=(1, 1)))
    story.handle(timesync(autopilot, tc1=7))
    assert story.sent() == []
    story.handle(timesync(ground_station, target=(1, 195)))
    assert types(story.sent()) == ["TIMESYNC"]


def ping(sender):
    return sender.send("PING", time_usec=5, seq=6, target_system=0, target_component=0)


@pytest.mark.parametrize("request_of", [ping, partial(timesync, target=(1, 195))])
def test_answers_are_limited_to_five_a_second_per_sender_and_twenty_per_link(
    story, autopilot, ground_station, request_of
):
    story.meet(autopilot)
    for _ in range(200):
        story.handle(request_of(ground_station), link="network")
    assert len(story.sent()) == 5
    for component_id in range(1, 200):
        story.handle(request_of(Peer(254, component_id)), link="network")
    assert len(story.sent()) == 15
    story.handle(request_of(ground_station))
    assert [link for link, _ in story.sent()] == ["serial"]
    story.now_s += 1.0
    for _ in range(200):
        story.handle(request_of(ground_station), link="network")
    assert len(story.sent()) == 5


def test_the_autopilots_time_requests_are_all_answered(story, autopilot):
    story.meet(autopilot)
    for _ in range(200):
        story.handle(timesync(autopilot))
    assert len(story.sent()) == 200


def test_a_system_that_is_not_allowed_as_a_peer_is_not_answered(story, autopilot):
    story.meet(autopilot)
    stranger = Peer(42, 1)
    story.handle(ping(stranger))
    story.handle(timesync(stranger, target=(1, 195)))
    assert story.sent() == []


def test_a_ping_is_answered_and_a_pong_is_not(story, ground_station):
    story.tick()
    story.sent()
    ping = {"time_usec": 5, "seq": 6}
    story.handle(ground_station.send("PING", **ping, target_system=0, target_component=0))
    story.handle(ground_station.send("PING", **ping, target_system=1, target_component=195))
    ((_, message),) = story.sent()
    assert (message.time_usec, message.seq) == (5, 6)
    assert (message.target_system, message.target_component) == (255, 190)
