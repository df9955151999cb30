"""Packets that overtake one another: a late packet does not replace newer telemetry."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from moar_companion.mavlink.dialect import create, mavlink
from moar_companion.mavlink.identity import AutopilotConflict
from moar_companion.mavlink.packet_order import PacketOrder
from moar_companion.mavlink.source_clock import SourceClock
from moar_companion.mavlink.telemetry import Failsafe
from moar_companion.mavlink.telemetry_receiver import TelemetryReceiver
from moar_companion.settings.link_config import LinkRole

HEARTBEAT, CURRENT_MODE, ATTITUDE = 0, 436, 30
HOLD, OFFBOARD = 0x03040000, 0x00060000


def packet(message_id, sequence):
    return SimpleNamespace(get_msgId=lambda: message_id, get_seq=lambda: sequence % 256)


def order_of(same):
    return PacketOrder(same=same, boot_clock=SourceClock())


def late(order, *arrivals):
    """Lateness of each (time, message, sequence)."""
    return [order.is_late(packet(message_id, seq), now_s) for now_s, message_id, seq in arrivals]


def test_only_a_message_overtaken_by_its_successor_is_late():
    order = order_of({CURRENT_MODE: HEARTBEAT})
    assert late(
        order,
        (0.00, HEARTBEAT, 10),
        (0.01, ATTITUDE, 14),
        (0.02, CURRENT_MODE, 13),
        (0.03, HEARTBEAT, 12),
        (0.04, ATTITUDE, 11),
        (0.05, CURRENT_MODE, 15),
    ) == [False, False, False, True, True, False]


def test_a_packet_late_by_most_of_a_sequence_round_is_late_not_ahead():
    order = order_of({})
    arrivals = [(count * 0.005, ATTITUDE, count) for count in range(200)]
    assert not any(late(order, *arrivals))
    assert late(order, (1.0, HEARTBEAT, 200), (1.002, HEARTBEAT, 0), (1.005, HEARTBEAT, 201)) == [
        False,
        True,
        False,
    ]
    assert order.late == 1


def test_the_time_stamp_of_a_packet_goes_before_its_sequence_number():
    listener = TelemetryReceiver()
    received(listener, heartbeat(HOLD), 0, 0.0)
    for count in range(100):
        received(listener, attitude(50.0 + count * 0.01, roll=0.1), count, count * 0.01)
    received(listener, attitude(50.6, roll=0.9), 100, 1.0)
    assert listener.telemetry.attitude.roll_rad == pytest.approx(0.1)
    received(listener, attitude(51.0, roll=0.2), 3, 1.0)
    assert listener.telemetry.attitude.roll_rad == pytest.approx(0.2)


def test_an_origin_is_never_late_by_the_time_at_which_it_was_set():
    listener = TelemetryReceiver()
    received(listener, heartbeat(HOLD), 0, 0.0)

    def origin(latitude_e7, time_usec):
        return mavlink.MAVLink_gps_global_origin_message(latitude_e7, 1, 1, time_usec)

    received(listener, origin(10_000_000, 90_000_000), 1, 0.1)
    received(listener, origin(20_000_000, 3_000_000), 2, 0.2)
    assert listener.telemetry.local_origin.point.latitude_deg == pytest.approx(2.0)


def test_late_packets_do_not_extend_the_lifetime_of_a_link():
    listener = TelemetryReceiver()
    received(listener, heartbeat(HOLD), 0, 0.0)
    received(listener, attitude(50.0), 1, 0.1)
    received(listener, attitude(49.0), 2, 2.0)
    assert listener.identity.received_s == 0.1


def test_a_restarted_autopilot_is_received_when_its_clock_has_run_on():
    listener = TelemetryReceiver()
    received(listener, heartbeat(HOLD), 0, 0.0)
    received(listener, attitude(50.0), 1, 0.1)
    events = [
        received(listener, attitude(0.3 + 0.1 * n, roll=0.1 * n), 2 + n, 1.0 + 0.1 * n)
        for n in range(5)
    ]
    assert [type(event).__name__ for event in events] == [
        *["NoneType"] * 3,
        "AutopilotRestarted",
        "NoneType",
    ]
    assert listener.telemetry.attitude.roll_rad == pytest.approx(0.4)


def positions_accepted(listener, *arrivals):
    """Acceptance of each position, given as (time, time since boot)."""
    accepted = []
    for number, (now_s, boot_s) in enumerate(arrivals, start=1):
        received(listener, position(boot_s, north_m=boot_s), number, now_s)
        local = listener.telemetry.local_position
        accepted.append(local is not None and local.position_ned_m[0] == boot_s)
    return accepted


def test_a_step_of_the_clock_counts_once_for_all_messages():
    listener = TelemetryReceiver()
    received(listener, heartbeat(HOLD), 0, 0.0)
    for count in range(10):
        received(listener, attitude(50.0 + 0.1 * count), count, 0.1 * count)
    assert positions_accepted(listener, (0.95, 50.95)) == [True]
    step_s, delay_s = 5.02, 0.05
    for count in range(10, 15):
        received(listener, attitude(50.0 + step_s + 0.1 * count), count, 0.1 * count + delay_s)
    steps = [1.5 + 0.1 * n for n in range(20)]
    assert all(positions_accepted(listener, *[(now_s, 50.0 + step_s + now_s) for now_s in steps]))


def test_a_packet_from_before_a_restart_does_not_block_later_packets():
    listener = TelemetryReceiver()
    received(listener, heartbeat(HOLD), 0, 0.0)
    received(listener, attitude(1000.0), 1, 0.1)
    for count in range(5):
        received(listener, attitude(0.3 + 0.1 * count), 2 + count, 1.0 + 0.1 * count)
    arrivals = [(1.5, 1000.5), *[(1.6 + 0.1 * n, 0.9 + 0.1 * n) for n in range(20)]]
    assert positions_accepted(listener, *arrivals) == [False, *[True] * 20]


def test_positions_of_a_second_clock_that_runs_behind_are_late():
    listener = TelemetryReceiver()
    received(listener, heartbeat(HOLD), 0, 0.0)
    assert positions_accepted(listener, (0.1, 50.1)) == [True]
    for count in range(50):
        now_s = 0.2 + 0.02 * count
        received(listener, attitude(50.0 + now_s), count, now_s)
        assert positions_accepted(listener, (now_s, 49.0 + 0.02 * count)) == [False]


def test_a_system_time_far_ahead_is_a_conflict_and_does_not_block_later_packets():
    listener = TelemetryReceiver()
    received(listener, heartbeat(HOLD), 0, 0.0)
    received(listener, attitude(50.0), 1, 0.1)
    event = received(listener, mavlink.MAVLink_system_time_message(0, 4_000_000), 2, 0.2)
    assert isinstance(event, AutopilotConflict)
    assert listener.identity.conflict == "two clocks, autopilot id 1"
    assert received(listener, attitude(50.2, roll=0.3), 3, 0.3) is None
    assert listener.telemetry.attitude.roll_rad == pytest.approx(0.3)
    listener.identity.forget_silent(10.3)
    assert listener.identity.conflict is None


@pytest.mark.parametrize("begins", range(0, 256, 15))
def test_sequence_numbers_wrap_around(begins):
    order = order_of({})
    for count in range(600):
        assert late(order, (count * 0.01, ATTITUDE, begins + count)) == [False]
    assert late(order, (6.0, ATTITUDE, begins + 540)) == [True]


def test_a_sequence_number_that_never_changes_is_never_late():
    order = order_of({})
    assert not any(late(order, *[(0.01 * count, ATTITUDE, 7) for count in range(50)]))


@pytest.mark.parametrize("lost", [50, 130, 200, 255])
def test_after_a_silence_no_packet_is_late_however_many_were_lost(lost):
    order = order_of({})
    assert late(order, (0.0, ATTITUDE, 3), (0.5, ATTITUDE, 3 + lost)) == [False, False]


def received(listener, message, sequence, now_s):
    header = message.get_header()
    header.srcSystem, header.srcComponent, header.seq = 1, 1, sequence
    return listener.handle(message, link="a", role=LinkRole.AUTOPILOT, now_s=now_s)


def heartbeat(mode, status=4):
    return mavlink.MAVLink_heartbeat_message(2, 12, 209, mode, status, 3)


def attitude(boot_s, roll=0.0):
    return mavlink.MAVLink_attitude_message(round(boot_s * 1000), roll, 0, 0, 0, 0, 0)


def position(boot_s, north_m):
    return mavlink.MAVLink_local_position_ned_message(round(boot_s * 1000), north_m, *[0.0] * 5)


def current_mode(mode, intended=None):
    intended = mode if intended is None else intended
    return create("CURRENT_MODE", custom_mode=mode, intended_custom_mode=intended, standard_mode=0)


def test_an_overtaken_heartbeat_does_not_restore_a_mode():
    listener = TelemetryReceiver()
    received(listener, heartbeat(OFFBOARD), 1, 0.0)
    left = received(listener, current_mode(HOLD), 9, 0.10)
    received(listener, heartbeat(OFFBOARD), 7, 0.12)
    autopilot = listener.telemetry.autopilot
    assert (left.mode, autopilot.mode, autopilot.ours) == ("HOLD", "HOLD", False)
    assert autopilot.received_s == 0.10


def test_a_mode_that_was_not_requested_is_a_failsafe():
    listener = TelemetryReceiver()
    received(listener, heartbeat(OFFBOARD), 1, 0.0)
    received(listener, current_mode(HOLD, intended=OFFBOARD), 2, 0.1)
    assert listener.telemetry.autopilot.failsafe
    received(listener, current_mode(HOLD), 3, 0.2)
    assert listener.telemetry.autopilot.failsafe  # the heartbeat ends it
    received(listener, heartbeat(HOLD), 4, 0.3)
    assert not listener.telemetry.autopilot.failsafe


def test_events_and_states_of_other_instances_are_never_late():
    def parameter(name, value):
        return mavlink.MAVLink_param_value_message(name, value, 9, 1, 0)

    def battery(number, percent):
        cells = [16000, *[65535] * 9]
        return mavlink.MAVLink_battery_status_message(
            number, 0, 0, 0, cells, 100, -1, -1, percent, 0, 1
        )

    def text(content):
        return mavlink.MAVLink_statustext_message(4, content)

    listener = TelemetryReceiver()
    received(listener, mavlink.MAVLink_heartbeat_message(2, 3, 217, 4, 4, 3), 1, 0.0)
    for message, sequence in (
        (parameter(b"MOT_PWM_MAX", 2000.0), 3),
        (parameter(b"MOT_PWM_MIN", 1000.0), 2),
        (text(b"hello"), 5),
        (text(b"GCS Failsafe"), 4),
        (battery(1, 80), 8),
        (battery(0, 20), 6),
        (battery(1, 81), 7),
    ):
        received(listener, message, sequence, 0.1)
    telemetry = listener.telemetry
    assert (telemetry.motor_min_us, telemetry.motor_max_us) == (1000.0, 2000.0)
    assert Failsafe.GROUND_STATION in telemetry.failsafes_reported
    assert {number: item.remaining for number, item in telemetry.batteries.items()} == {
        0: pytest.approx(0.2),
        1: pytest.approx(0.8),
    }
