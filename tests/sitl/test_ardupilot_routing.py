"""ArduPilot's routing between links, as measured on ArduCopter 4.6.3."""

import pytest
from pymavlink.dialects.v20 import all as mavlink

USER_1, ARM, SET_MODE = 31010, 400, 176
ACCEPTED, UNSUPPORTED, FAILED = 0, 3, 4


@pytest.fixture
def both(ardupilot):
    ardupilot.ready()
    return ardupilot


def _received(flight, peer, kind, send):
    """Return the messages of a kind that a peer received within 0.1 s of sending."""
    start_s = flight.now_s
    send()
    flight.run(0.1)
    return peer.of(kind, since=start_s + 1e-9)


def test_heartbeats_go_both_ways(both):
    ids = {(m.get_srcSystem(), m.get_srcComponent()) for m in both.companion.of("HEARTBEAT")}
    assert ids == {(1, 1), (255, 190)}
    ids = {(m.get_srcSystem(), m.get_srcComponent()) for m in both.gcs.of("HEARTBEAT")}
    assert ids == {(1, 1), (1, 195)}


def test_a_heartbeat_reaches_a_link_on_which_no_system_was_received(make_ardupilot):
    flight = make_ardupilot()
    flight.companion_alive = False
    flight.run(4.0)
    systems = {m.get_srcSystem() for m in flight.companion.of("HEARTBEAT")}
    assert systems == {1, 255}


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("COMMAND_LONG", mavlink.MAVLink_command_long_message(1, 195, USER_1, 0, *[1.0] * 7)),
        ("COMMAND_INT", mavlink.MAVLink_command_int_message(
            1, 195, 0, USER_1, 0, 0, 1, 0, 0, 0, 0, 0, 0)),
        ("PARAM_REQUEST_LIST", mavlink.MAVLink_param_request_list_message(1, 195)),
        ("PARAM_SET", mavlink.MAVLink_param_set_message(1, 195, b"GUID_TIMEOUT", 9.0, 9)),
        ("MISSION_REQUEST_LIST", mavlink.MAVLink_mission_request_list_message(1, 195)),
    ],
)  # fmt: skip
def test_a_command_for_the_companion_reaches_only_the_companion(both, kind, message):
    start_s = both.now_s
    assert len(_received(both, both.companion, kind, lambda: both.gcs.send(message))) == 1
    both.run(0.5)
    answers = {"COMMAND_ACK", "PARAM_VALUE", "MISSION_COUNT"}
    assert not [m for t, m in both.gcs.received if t > start_s and m.get_type() in answers]
    assert both.vehicle.parameter("GUID_TIMEOUT") == 3.0


@pytest.mark.parametrize("system", [0, 1])
def test_a_broadcast_command_reaches_both_and_the_autopilot_answers_unsupported(both, system):
    received = _received(
        both,
        both.companion,
        "COMMAND_LONG",
        lambda: both.gcs.command(USER_1, 1, component=0, system=system),
    )
    assert [m.command for m in received] == [USER_1]
    assert both.gcs.last("COMMAND_ACK").result == UNSUPPORTED


def test_a_command_for_the_autopilot_goes_nowhere_else(both):
    assert not _received(both, both.companion, "COMMAND_LONG", lambda: both.gcs.command(USER_1, 1))


def test_the_autopilot_executes_a_command_for_an_unseen_component(both):
    assert both.ask(both.gcs, SET_MODE, 1, 4, component=191) == [ACCEPTED]
    assert both.truth.mode == "GUIDED"
    assert both.ask(both.gcs, ARM, 1, component=191) == [ACCEPTED]
    assert both.truth.armed


def test_after_its_first_packet_the_companions_commands_are_no_longer_the_autopilots(
    make_ardupilot,
):
    flight = make_ardupilot()
    flight.companion_alive = False
    flight.ready()
    assert flight.ask(flight.gcs, SET_MODE, 1, 4, component=195) == [ACCEPTED]
    flight.companion_alive = True
    flight.run(1.5)
    assert flight.ask(flight.gcs, SET_MODE, 1, 5, component=195) == []
    assert flight.truth.mode == "GUIDED"


def test_another_systems_commands_are_not_the_autopilots(both):
    assert both.ask(both.gcs, USER_1, 1, system=2, component=195) == []
    assert both.ask(both.gcs, ARM, 1, system=2, component=1) == []


@pytest.mark.parametrize(
    ("system", "component", "delivered"), [(255, 190, 1), (0, 0, 1), (254, 190, 0)]
)
def test_an_answer_is_delivered_only_to_systems_that_were_received(
    both, system, component, delivered
):
    ack = mavlink.MAVLink_command_ack_message(USER_1, 0, 0, 0, system, component)
    received = _received(both, both.gcs, "COMMAND_ACK", lambda: both.companion.send(ack))
    assert len(received) == delivered


@pytest.mark.parametrize(
    "message",
    [
        mavlink.MAVLink_named_value_float_message(1, b"RISK_WIND", 0.5),
        mavlink.MAVLink_statustext_message(6, b"hello"),
        mavlink.MAVLink_debug_vect_message(b"v", 0, 1.0, 2.0, 3.0),
        mavlink.MAVLink_param_value_message(b"X", 1.0, 9, 1, 0),
    ],
)
def test_a_broadcast_of_the_companion_reaches_the_ground_station(both, message):
    kind = message.get_type()
    received = _received(both, both.gcs, kind, lambda: both.companion.send(message))
    assert [m.get_srcComponent() for m in received] == [195]


def test_answers_and_streams_stay_on_the_link_that_asked(both):
    start_s = both.now_s
    both.companion.command(511, 30, 50_000)
    both.companion.command(512, 148)
    both.run(1.0)
    assert both.companion.of("ATTITUDE")
    assert both.companion.of("AUTOPILOT_VERSION")
    assert not both.gcs.of("ATTITUDE")
    assert not both.gcs.of("AUTOPILOT_VERSION")
    assert not both.gcs.of("COMMAND_ACK", since=start_s)


def test_a_denied_interval_is_reported_on_all_links(both):
    assert both.ask(both.companion, 511, 231, 50_000) == [2]
    for peer in (both.companion, both.gcs):
        assert "No ap_message for mavlink id (231)" in peer.texts()


def test_a_message_is_sent_on_request_or_fails(both):
    assert both.ask(both.companion, 512, 242) == [ACCEPTED]
    assert both.companion.last("HOME_POSITION") is not None
    assert both.ask(both.companion, 512, 231) == [FAILED]


def test_an_interval_reads_back_or_fails(both):
    both.companion.command(511, 30, 50_000)
    assert both.ask(both.companion, 510, 30) == [ACCEPTED]
    assert both.companion.last("MESSAGE_INTERVAL").interval_us == 50_000
    assert both.ask(both.companion, 510, 109) == [FAILED]
    unknown = both.companion.last("MESSAGE_INTERVAL")
    assert (unknown.message_id, unknown.interval_us) == (109, 0)


def test_radio_status_is_never_passed_on_and_never_sent_by_the_autopilot(both):
    status = mavlink.MAVLink_radio_status_message(180, 170, 100, 40, 45, 0, 0)
    assert not _received(both, both.gcs, "RADIO_STATUS", lambda: both.companion.send(status))
    both.vehicle.conditions.radio_rssi = 190.0
    both.run(1.5)
    radio = both.companion.last("RADIO_STATUS")
    assert (radio.get_srcSystem(), radio.get_srcComponent(), radio.rssi) == (51, 68, 190)


def test_packets_under_the_autopilots_own_id_are_dropped(both):
    both.companion.mav.srcComponent = 1
    text = mavlink.MAVLink_statustext_message(6, b"I am you")
    assert not _received(both, both.gcs, "STATUSTEXT", lambda: both.companion.send(text))
    assert both.ask(both.companion, SET_MODE, 1, 4) == []


def test_time_requests_are_answered_in_the_next_tick_and_passed_on(both):
    both.companion.send(mavlink.MAVLink_timesync_message(0, 123_456_789))
    both.tick()
    answer = both.companion.last("TIMESYNC")
    assert answer.ts1 == 123_456_789
    assert answer.tc1 == pytest.approx(both.now_s * 1e9, abs=0.1e9)
    assert both.gcs.last("TIMESYNC").ts1 == 123_456_789


def test_commands_are_acknowledged_in_the_next_tick(both):
    both.companion.command(USER_1, 1)
    both.tick()
    assert both.companion.last("COMMAND_ACK").command == USER_1


def test_an_empty_mission_is_reported(both):
    both.gcs.send(mavlink.MAVLink_mission_request_list_message(1, 1))
    both.run(0.1)
    assert both.gcs.last("MISSION_COUNT").count == 0


def test_rc_strength_is_unknown_or_the_last_value_of_the_radio(both):
    both.companion.command(511, 65, 100_000)
    both.run(0.5)
    assert both.companion.last("RC_CHANNELS").rssi == 255
    both.vehicle.set_parameter("RSSI_TYPE", 5)
    both.companion.send(mavlink.MAVLink_radio_status_message(180, 170, 100, 40, 45, 0, 0))
    both.run(0.5)
    assert both.companion.last("RC_CHANNELS").rssi == 180
    both.run(7.5)
    assert both.companion.last("RC_CHANNELS").rssi == 0


@pytest.mark.parametrize(("txbuf", "times", "rate_hz"), [(40, 3, 9.0), (15, 5, 2.7)])
def test_a_radio_with_a_full_buffer_slows_the_streams_of_its_link(both, txbuf, times, rate_hz):
    for peer in (both.companion, both.gcs):
        peer.command(511, 30, 50_000)
    for _ in range(times):
        both.companion.send(mavlink.MAVLink_radio_status_message(180, 170, txbuf, 40, 45, 0, 0))
    both.run(0.5)
    start_s = both.now_s
    both.run(10.0)
    assert len(both.companion.of("ATTITUDE", since=start_s)) / 10.0 == pytest.approx(
        rate_hz, rel=0.15
    )
    assert len(both.gcs.of("ATTITUDE", since=start_s)) / 10.0 == pytest.approx(20.0, rel=0.02)
    for _ in range(20):
        both.companion.send(mavlink.MAVLink_radio_status_message(180, 170, 100, 40, 45, 0, 0))
    both.run(2.0)
    start_s = both.now_s
    both.run(5.0)
    assert len(both.companion.of("ATTITUDE", since=start_s)) / 5.0 == pytest.approx(20.0, rel=0.03)
