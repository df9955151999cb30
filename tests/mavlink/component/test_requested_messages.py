"""Commands about the companion's messages: requests, intervals, versions."""

from __future__ import annotations

import math
from collections import Counter

import pytest

from moar_companion.mavlink.codec import Codec
from moar_companion.mavlink.commands import DeniedCommand
from moar_companion.mavlink.component.link_budget import size_bytes
from moar_companion.mavlink.component.named_values import NAMED_VALUES, NamedValues
from moar_companion.mavlink.component.published import PUBLISHED
from moar_companion.mavlink.component.services import ComponentServices
from moar_companion.mavlink.dialect import id_of, mavlink
from moar_companion.mavlink.session import Session, SystemStatus
from moar_companion.mavlink.translate_outgoing import trajectory_messages
from moar_companion.settings.config import Commands, shipped_configs
from moar_companion.settings.link_config import LinkRole

from ..peer import Peer
from ..story import Story, types

GET_INTERVAL, SET_INTERVAL, REQUEST = 510, 511, 512
ACCEPTED, REJECTED, DENIED, UNSUPPORTED = 0, 1, 2, 3
FLOAT, INT = id_of("NAMED_VALUE_FLOAT"), id_of("NAMED_VALUE_INT")
COMPUTER, AHEAD = id_of("ONBOARD_COMPUTER_STATUS"), id_of("TRAJECTORY_REPRESENTATION_WAYPOINTS")
VERSION, PROTOCOL = id_of("AUTOPILOT_VERSION"), id_of("PROTOCOL_VERSION")
MESSAGE_INTERVAL = 244
ALL = (1, 0)


@pytest.fixture
def met(story, autopilot):
    story.meet(autopilot)
    story.session.services.values.take({"RISK_WIND": 0.25, "TO_GO": 12.0, "M_STATE": 3})
    return story


def answered(story, data, *, link="network", seconds=0.3):
    """What follows a packet: results of commands, and the other messages on its link."""
    story.handle(data, link=link)
    sent = [message for _, on, message in story.run(seconds) if on == link]
    results = [message.result for message in sent if message.get_type() == "COMMAND_ACK"]
    return results, [message for message in sent if message.get_type() != "COMMAND_ACK"]


def asked(story, number, *parameters, sender=None, target=(1, 195), **options):
    data = (sender or Peer(255, 190)).command(number, *parameters, target=target)
    results, messages = answered(story, data, **options)
    streams = {"HEARTBEAT", "TIMESYNC", "NAMED_VALUE_FLOAT", "NAMED_VALUE_INT"}
    return results, [message for message in messages if message.get_type() not in streams]


# Requests


def test_the_version_tells_the_capabilities_that_the_component_has(met):
    results, (version,) = asked(met, REQUEST, VERSION)
    assert results == [ACCEPTED]
    assert version.capabilities & mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    assert version.capabilities & mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    assert not version.capabilities & mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
    assert version.flight_sw_version >> 24 < 100
    assert (version.uid, version.get_srcComponent()) == (0, 195)


@pytest.mark.parametrize(("number", "message"), [(519, PROTOCOL), (520, VERSION)])
def test_the_older_commands_request_the_same_messages(met, number, message):
    results, (answer,) = asked(met, number, 1)
    assert (results, answer.get_msgId()) == ([ACCEPTED], message)
    assert asked(met, number, 0) == ([DENIED], [])


def test_the_protocol_version_is_that_of_mavlink_2(met):
    _, (version,) = asked(met, REQUEST, PROTOCOL)
    assert (version.version, version.min_version, version.max_version) == (200, 100, 200)


def test_the_metadata_of_the_component_is_named_on_request(met):
    for name in ("COMPONENT_METADATA", "COMPONENT_INFORMATION"):
        results, (message,) = asked(met, REQUEST, id_of(name))
        assert (results, message.get_type()) == ([ACCEPTED], name)


def test_values_to_plot_are_sent_at_once_on_request_where_they_are_switched_off(met):
    asked(met, SET_INTERVAL, FLOAT, -1)
    assert {on for _, on, m in met.run(2.0) if m.get_msgId() == FLOAT} == {"serial"}
    _, messages = answered(met, Peer(255, 190).command(REQUEST, FLOAT))
    assert [m.value for m in messages if m.get_msgId() == FLOAT] == [0.25, 12.0]


def test_the_heartbeat_is_sent_on_request(met):
    met.run(0.3)
    _, messages = answered(met, Peer(255, 190).command(REQUEST, id_of("HEARTBEAT")))
    assert types([(m,) for m in messages]).count("HEARTBEAT") == 1


def test_what_is_not_known_yet_is_rejected_for_now(met):
    assert asked(met, REQUEST, COMPUTER) == ([REJECTED], [])


def test_a_message_that_is_not_published_is_unsupported(met):
    for number in (REQUEST, SET_INTERVAL):
        assert asked(met, number, id_of("ATTITUDE"), 100_000.0) == ([UNSUPPORTED], [])


@pytest.mark.parametrize("number", [-1, 0.5, math.nan, math.inf, 1e30])
@pytest.mark.parametrize("command", [GET_INTERVAL, SET_INTERVAL, REQUEST])
def test_a_number_that_is_no_messages_is_denied(met, command, number):
    assert asked(met, command, number) == ([DENIED], [])


def test_of_requests_to_all_components_those_that_mean_the_autopilot_get_no_answer(met):
    attitude = id_of("ATTITUDE")
    for command in (
        (REQUEST, VERSION),
        (REQUEST, PROTOCOL),
        (519, 1),
        (519, 0),
        (520, 1),
        (520, 0),
        (REQUEST, attitude),
        (REQUEST, MESSAGE_INTERVAL, attitude),
        (REQUEST, MESSAGE_INTERVAL, math.nan),
        (GET_INTERVAL, attitude),
        (SET_INTERVAL, attitude),
        (SET_INTERVAL, MESSAGE_INTERVAL, 1e6),
    ):
        for sender in (Peer(255, 190), Peer(42, 1)):  # one that may command, one that may not
            assert asked(met, *command, sender=sender, target=ALL) == ([], []), command
    assert met.events() == []


def test_of_requests_to_all_components_those_of_the_companions_messages_get_an_answer(met):
    for command in (
        (REQUEST, FLOAT),
        (REQUEST, MESSAGE_INTERVAL, FLOAT),
        (GET_INTERVAL, FLOAT),
        (SET_INTERVAL, FLOAT, 1e6),
    ):
        assert asked(met, *command, target=ALL)[0] == [ACCEPTED], command


def test_broadcasts_that_mean_the_autopilot_leave_the_answers_to_requests(met):
    sender = Peer(255, 190)
    for second in range(200):
        met.handle(sender.command(SET_INTERVAL, id_of("ATTITUDE"), second, target=ALL))
    assert asked(met, REQUEST, VERSION, sender=sender, link="serial")[0] == [ACCEPTED]


def test_a_request_is_answered_in_both_forms_of_a_command_and_its_copy_is_not(met):
    for data in (
        Peer(255, 190).command(REQUEST, VERSION),
        Peer(254, 190).command_int(REQUEST, VERSION),
    ):
        met.handle(data, link="network")
        met.handle(data, link="network")
    assert types(met.run(0.2)).count("COMMAND_ACK") == 2


def test_a_flood_of_requests_gets_the_answers_of_a_sender_and_no_more(met):
    sender = Peer(255, 190)
    for _ in range(1000):
        met.handle(sender.command(REQUEST, FLOAT), link="network")
    sent = [m for _, on, m in met.run(1.0) if on == "network"]
    assert types([(m,) for m in sent]).count("COMMAND_ACK") == 20
    assert types([(m,) for m in sent]).count("NAMED_VALUE_FLOAT") <= 20 * 2 + 3 * 2


# Intervals


def rate_hz(story, name, link="network", seconds=10.0):
    sent = [m for _, on, m in story.run(seconds) if on == link and m.get_type() == name]
    return len(sent) / seconds


def test_values_are_sent_twice_a_second_by_default(met):
    assert rate_hz(met, "NAMED_VALUE_FLOAT") == pytest.approx(2 * 2, abs=0.3)
    assert rate_hz(met, "NAMED_VALUE_INT") == pytest.approx(2 * 1, abs=0.2)


def test_an_interval_holds_for_its_link_until_the_default_is_set_again(met):
    assert asked(met, SET_INTERVAL, INT, 2e6)[0] == [ACCEPTED]
    assert rate_hz(met, "NAMED_VALUE_INT") == pytest.approx(0.5, abs=0.1)
    assert rate_hz(met, "NAMED_VALUE_INT", "serial") == pytest.approx(2.0, abs=0.2)
    assert asked(met, SET_INTERVAL, INT, -1)[0] == [ACCEPTED]
    assert rate_hz(met, "NAMED_VALUE_INT") == 0.0
    assert asked(met, SET_INTERVAL, INT, 0)[0] == [ACCEPTED]
    assert rate_hz(met, "NAMED_VALUE_INT") == pytest.approx(2.0, abs=0.2)


def interval_us(story, message, number=GET_INTERVAL, **options):
    parameters = (message,) if number == GET_INTERVAL else (MESSAGE_INTERVAL, message)
    results, (answer,) = asked(story, number, *parameters, **options)
    assert (results, answer.message_id) == ([ACCEPTED], message)
    return answer.interval_us


def test_of_more_values_than_a_slow_line_carries_each_comes_and_the_mission_state_each_second():
    line = "serial:/dev/ttyTHS1:9600"
    services = ComponentServices({line: LinkRole.AUTOPILOT}, component_id=195)
    services.values.take(dict.fromkeys(NAMED_VALUES, 1.0))
    sent = [
        message.name for cycle in range(1000) for _, message in services.due(100.0 + cycle * 0.02)
    ]
    counts = Counter(sent)
    assert {counts[name] for name in ("M_STATE", "CONDITION", "M_TARGET")} <= {19, 20}
    floats = [counts[name] for name, value in NAMED_VALUES.items() if not value.whole]
    assert min(floats) >= max(floats) - 1 > 3


@pytest.mark.parametrize("number", [GET_INTERVAL, REQUEST])
def test_the_interval_is_reported_as_it_is_sent(met, number):
    assert interval_us(met, INT, number) == 500_000
    asked(met, SET_INTERVAL, INT, 2e6)
    assert interval_us(met, INT, number) == 2_000_000
    asked(met, SET_INTERVAL, INT, 1.0)  # faster than the values are made
    assert interval_us(met, INT, number) == 500_000
    longest = 2.0**31 - 128  # as MAVLink's float
    asked(met, SET_INTERVAL, INT, longest)
    assert interval_us(met, INT, number) == longest
    asked(met, SET_INTERVAL, INT, -1)
    assert interval_us(met, INT, number) == -1
    assert interval_us(met, VERSION, number) == -1
    assert interval_us(met, id_of("ATTITUDE"), number) == 0


@pytest.mark.parametrize("interval", [-2, -0.5, math.nan, -math.inf, math.inf, 2.0**31, 3e38])
def test_an_interval_that_is_none_is_denied(met, interval):
    assert asked(met, SET_INTERVAL, INT, interval)[0] == [DENIED]
    assert interval_us(met, INT) == 500_000


def test_the_heartbeats_interval_is_fixed(met):
    for interval in (-1, 0, 1e5, 1e7):
        assert asked(met, SET_INTERVAL, id_of("HEARTBEAT"), interval)[0] == [DENIED]
    assert interval_us(met, id_of("HEARTBEAT")) == 1_000_000


def test_a_system_that_may_not_command_sets_no_interval_and_gets_no_messages(met):
    stranger = Peer(42, 1)
    assert answered(met, stranger.command(SET_INTERVAL, INT, -1))[0] == [DENIED]
    (denied,) = [event for event in met.events() if isinstance(event, DeniedCommand)]
    assert "system 42 may not command" in denied.reason
    for command, number in ((GET_INTERVAL, INT), (REQUEST, VERSION)):
        assert asked(met, command, number, sender=stranger) == ([], [])


def test_requests_of_strangers_use_up_no_answers_of_a_link(met):
    for number in range(500):
        met.handle(Peer(42, 1 + number % 180).command(REQUEST, VERSION), link="network")
    assert asked(met, REQUEST, VERSION)[0] == [ACCEPTED]


def test_a_component_that_may_not_command_sets_no_interval_but_may_ask(autopilot):
    story = Story(commands=Commands(components=(190,)))
    story.meet(autopilot)
    other = Peer(255, 191)
    assert answered(story, other.command(SET_INTERVAL, INT, -1))[0] == [DENIED]
    assert answered(story, other.command(GET_INTERVAL, INT))[0] == [ACCEPTED]


def test_requested_messages_that_wait_on_a_slow_line_leave_room_for_the_services(autopilot):
    line, read = "serial:/dev/ttyTHS1:9600", Codec(system_id=9, component_id=9)
    session = Session(links={line: LinkRole.AUTOPILOT})
    session.receive(line, autopilot.heartbeat(), 100.0)
    sent = Counter()
    for cycle in range(3000):
        now_s = 100.0 + cycle * 0.02
        if cycle % 5 == 0:
            station = Peer(255, 2 + cycle % 180)
            session.receive(line, station.command(REQUEST, MESSAGE_INTERVAL, cycle), now_s)
        if cycle % 250 == 249:
            wanted = {"target_system": 1, "target_component": 195, "mission_type": 0}
            session.receive(line, Peer(255, 190).send("MISSION_REQUEST_LIST", **wanted), now_s)
        session.tick(now_s, SystemStatus.ACTIVE)
        for _, data in session.data_to_send():
            sent.update(message.get_type() for message in read.receive(data))
        if cycle % 250 == 199:
            assert sent["MISSION_COUNT"] == cycle // 250
    assert sent["MESSAGE_INTERVAL"] > 100


def path_ahead(now_s):
    return trajectory_messages([(1.0, 2.0, -3.0)], now_s)


def test_the_path_ahead_is_never_sent_on_a_link_to_the_autopilot(met):
    met.session.services.published.offer("TRAJECTORY_REPRESENTATION_WAYPOINTS", path_ahead)
    for command in (SET_INTERVAL, REQUEST):
        results, messages = asked(met, command, AHEAD, 1e6, link="serial")
        assert results == [DENIED]
        assert AHEAD not in {message.get_msgId() for message in messages}
    assert asked(met, SET_INTERVAL, AHEAD, 1e6)[0] == [ACCEPTED]
    assert asked(met, REQUEST, AHEAD)[0] == [ACCEPTED]


def test_a_message_that_delays_setpoints_is_not_sent_on_a_slow_line():
    link = "serial:/dev/ttyTHS1:57600"
    messages = ComponentServices({link: LinkRole.OPERATOR}, 195).published
    for name in ("TRAJECTORY_REPRESENTATION_WAYPOINTS", "ONBOARD_COMPUTER_STATUS"):
        messages.offer(name, path_ahead)
        assert messages.requested(link, PUBLISHED[name], 0.0) is None
    for name in ("AUTOPILOT_VERSION", "COMPONENT_METADATA", "COMPONENT_INFORMATION"):
        assert messages.requested(link, PUBLISHED[name], 0.0)


@pytest.mark.parametrize(("baud", "seconds"), [(57_600, None), (921_600, 1.0)])
def test_a_message_that_delays_setpoints_is_not_repeated_on_a_slow_line(baud, seconds):
    link = f"serial:/dev/ttyTHS1:{baud}"
    messages = ComponentServices({link: LinkRole.OPERATOR}, 195).published
    assert messages.set_interval(link, "ONBOARD_COMPUTER_STATUS", 0.0) == (seconds is not None)
    assert messages.interval_s(link, "ONBOARD_COMPUTER_STATUS") == seconds
    assert messages.interval_s(link, "NAMED_VALUE_FLOAT") == (0.5 if seconds else 1.0)


# Commands of the autopilot


@pytest.mark.parametrize(
    ("number", "words"),
    [(176, "mode commands go to component 1"), (400, "arming commands go to component 1")],
)
def test_a_command_of_the_autopilot_is_denied_with_a_text_that_names_its_receiver(
    met, number, words
):
    assert answered(met, Peer(255, 190).command(number, 1))[0] == [DENIED]
    (denied,) = [event for event in met.events() if isinstance(event, DeniedCommand)]
    assert words in denied.reason


def test_a_command_of_the_autopilot_to_it_or_to_all_is_none_of_ours(met):
    for number in (176, 400):
        for target in ((1, 1), ALL):
            assert answered(met, Peer(255, 190).command(number, 1, target=target))[0] == []


# The tables


def test_each_value_has_a_name_that_mavlink_carries():
    assert all(0 < len(name) <= 10 and name.isascii() for name in NAMED_VALUES)


def test_each_published_message_exists():
    assert all(id_of(name) >= 0 for name in PUBLISHED)


def test_the_guide_to_slow_lines_has_the_bytes_of_the_values_signed_and_unsigned():
    values = NamedValues()
    values.take({name: 3 if value.whole else 0.3 for name, value in NAMED_VALUES.items()})
    messages = [*values.floats(1.0), *values.integers(1.0)]
    signed = sum(map(size_bytes, messages))
    unsigned = sum(len(Peer(1, 195).pack(message)) for message in messages)
    page = (shipped_configs() / "guides" / "links.md").read_text()
    row = f"; signed {round(signed, -1)} | {round(unsigned, -1)} | {round(unsigned, -1)} |"
    assert f"| values to plot, each second{row}\n" in page
