"""PX4's forwarding between links, as measured on PX4 v1.17.0, and broken bytes."""

from itertools import pairwise

import pytest
from pymavlink.dialects.v20 import all as mavlink

from .conftest import HOLD, LAND


@pytest.fixture
def both(flight):
    flight.run(3.0)
    return flight


def test_heartbeats_reach_the_other_link(both):
    systems = {(m.get_srcSystem(), m.get_srcComponent()) for m in both.companion.of("HEARTBEAT")}
    assert systems == {(1, 1), (255, 190)}
    systems = {(m.get_srcSystem(), m.get_srcComponent()) for m in both.gcs.of("HEARTBEAT")}
    assert systems == {(1, 1), (1, 195)}


def test_a_command_to_the_companion_arrives_there_and_its_ack_comes_back(both):
    both.gcs.command(31010, 1, component=195)
    both.run(0.1)
    assert both.companion.last("COMMAND_LONG").command == 31010
    ack = mavlink.MAVLink_command_ack_message(31010, 0, 0, 0, 255, 190)
    both.companion.send(ack)
    both.run(0.1)
    assert both.gcs.last("COMMAND_ACK").get_srcComponent() == 195


def test_an_ack_to_an_unseen_system_goes_nowhere_and_one_to_everyone_arrives(both):
    both.companion.send(mavlink.MAVLink_command_ack_message(31010, 0, 0, 0, 254, 190))
    both.run(0.1)
    assert not both.gcs.of("COMMAND_ACK")
    both.companion.send(mavlink.MAVLink_command_ack_message(31010, 0, 0, 0, 0, 0))
    both.run(0.1)
    assert both.gcs.of("COMMAND_ACK")


def test_nothing_is_routed_to_a_companion_that_never_sent(make_flight):
    flight = make_flight()
    flight.companion_alive = False
    flight.run(4.0)
    flight.gcs.command(31010, 1, component=195)
    flight.run(0.5)
    assert not flight.companion.of("COMMAND_LONG")
    assert all(m.get_srcSystem() == 1 for m in flight.companion.of("HEARTBEAT"))


def test_a_command_to_all_components_goes_to_both(both):
    assert both.ask(both.gcs, 31010, 1, component=0) == [3]
    assert both.companion.of("COMMAND_LONG")


def test_a_command_to_an_unseen_component_goes_nowhere(both):
    assert both.ask(both.gcs, 31010, 1, component=196) == []
    assert not both.companion.of("COMMAND_LONG")


@pytest.mark.parametrize(
    "message",
    [
        mavlink.MAVLink_named_value_float_message(0, b"RISK_WIND", 0.5),
        mavlink.MAVLink_statustext_message(4, b"hello from companion"),
        mavlink.MAVLink_param_value_message(b"RISK_W", 1.5, 9, 3, 0),
        mavlink.MAVLink_radio_status_message(150, 140, 90, 40, 38, 0, 0),
        mavlink.MAVLink_system_time_message(1, 1),
    ],
    ids=lambda message: message.get_type(),
)
def test_packets_of_the_companion_arrive_at_the_ground_station(both, message):
    both.companion.send(message)
    both.run(0.1)
    found = both.gcs.last(message.get_type())
    assert found is not None
    assert found.get_srcComponent() == 195


def test_setpoints_to_the_autopilot_are_not_forwarded(both):
    both.companion.setpoint()
    both.run(0.1)
    assert not both.gcs.of("SET_POSITION_TARGET_LOCAL_NED")


def test_parameter_requests_to_the_companion_arrive(both):
    both.gcs.send(mavlink.MAVLink_param_request_list_message(1, 195))
    both.run(0.1)
    assert both.companion.of("PARAM_REQUEST_LIST")
    assert not both.gcs.of("PARAM_VALUE")


def test_mav_1_forward_0_cuts_the_companion_off_as_on_telem2(make_flight):
    flight = make_flight(parameters={"MAV_1_FORWARD": 0})
    flight.run(5.0)
    flight.gcs.command(31010, 1, component=195)
    flight.run(0.2)
    assert not flight.companion.of("COMMAND_LONG")
    assert all(m.get_srcComponent() == 1 for m in flight.gcs.of("HEARTBEAT"))


def test_unknown_messages_are_forwarded_unopened(both):
    raw = bytes.fromhex("fd1400005701017c01006a000000ffffffffffffffffffffffffffffffff0d4d")
    both.vehicle.receive("companion", raw)
    both.run(0.1)
    assert any(
        m.get_type() == "UNKNOWN_380" and m.get_msgbuf() == raw for _, m in both.gcs.received
    )


def test_commands_survive_being_split_at_every_byte(both):
    message = mavlink.MAVLink_command_long_message(1, 1, 400, 0, 0, 0, 0, 0, 0, 0, 0)
    raw = message.pack(both.gcs.mav)
    both.ground_station_alive = False
    for cut in range(1, len(raw)):
        start_s = both.now_s
        both.vehicle.receive("gcs", raw[:cut])
        both.run(0.02)
        both.vehicle.receive("gcs", raw[cut:])
        both.run(0.06)
        assert len(both.gcs.of("COMMAND_ACK", since=start_s + 1e-9)) == 1, cut


def test_noise_and_a_broken_check_do_not_stop_the_next_command(both):
    message = mavlink.MAVLink_command_long_message(1, 1, 400, 0, 0, 0, 0, 0, 0, 0, 0)
    good = message.pack(both.gcs.mav)
    broken = bytearray(good)
    broken[15] ^= 0xFF
    both.vehicle.receive("gcs", b"\x00\x55noise" + bytes(broken) + good)
    both.run(0.2)
    assert len(both.gcs.of("COMMAND_ACK")) == 1


def test_a_fading_link_loses_packets_as_gaps_in_the_sequence(flight):
    flight.vehicle.conditions.link_loss_percent = 20.0
    flight.run(10.0)
    own = [m.get_seq() for _, m in flight.companion.received if m.get_srcSystem() == 1]
    lost = sum((b - a - 1) % 256 for a, b in pairwise(own))
    assert lost / (lost + len(own)) == pytest.approx(0.2, abs=0.05)


@pytest.mark.parametrize("first", ["companion", "ground station"])
def test_of_two_orders_in_one_tick_the_later_one_counts_on_any_link(flight, first):
    flight.run(6.0)
    orders = [(flight.companion, LAND), (flight.gcs, HOLD)]
    for peer, mode in orders if first == "companion" else reversed(orders):
        peer.command(176, 1, *mode)
    flight.run(0.5)
    assert flight.truth.mode == ("AUTO.LOITER" if first == "companion" else "AUTO.LAND")


def test_an_unknown_link_is_a_key_error(flight):
    with pytest.raises(KeyError):
        flight.vehicle.receive("nobody", b"x")


def test_a_link_with_jitter_delays_and_reorders_both_ways(flight):
    flight.run(3.0)
    conditions = flight.vehicle.conditions
    conditions.link_delay_ms, conditions.link_jitter_ms = 100.0, 100.0
    flight.run(0.5)
    flight.companion.received.clear()
    flight.companion.send(mavlink.MAVLink_timesync_message(0, 7))
    asked_s = flight.now_s
    flight.run(1.0)
    answered_s = next(
        t for t, m in flight.companion.received if m.get_type() == "TIMESYNC" and m.ts1 == 7
    )
    assert 0.2 <= answered_s - asked_s <= 0.45
    stamps = [m.time_boot_ms for m in flight.companion.of("ATTITUDE")]
    assert stamps != sorted(stamps)
