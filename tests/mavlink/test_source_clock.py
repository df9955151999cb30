"""A sender's clock: late stamps, stamps ahead of it, and detection of a second clock."""

from __future__ import annotations

import pytest

from moar_companion.mavlink.codec import Codec
from moar_companion.mavlink.packet_order import PacketOrder
from moar_companion.mavlink.source_clock import Reading, SourceClock
from moar_companion.mavlink.telemetry_receiver import MESSAGE_IDS
from moar_companion.mavlink.translate import boot_time_s

CURRENT, LATE, FOREIGN, RESTARTED = Reading
ROUND_S = 2**32 * 1e-3


def readings(clock, *arrivals):
    """Results of (time of arrival, stamp)."""
    return [clock.read(stamp_s, now_s) for now_s, stamp_s in arrivals]


def ran_for(seconds=10.0, period_s=0.1, stamp_s=100.0, **options):
    """A clock that read 100 s at 0 s, and has run since."""
    clock = SourceClock(**options)
    for count in range(round(seconds / period_s) + 1):
        assert clock.read(stamp_s + count * period_s, count * period_s) is CURRENT
    return clock


@pytest.mark.parametrize("late_s", [0.001, 0.3, 0.9, 60.0])
def test_a_stamp_older_than_the_last_is_late_and_changes_nothing(late_s):
    clock = ran_for()
    assert readings(clock, (10.05, 110.0 - late_s), (10.1, 110.1)) == [LATE, CURRENT]


def test_the_same_stamp_again_is_not_late():
    assert readings(ran_for(), (10.1, 110.0), (20.0, 110.0)) == [CURRENT, CURRENT]


def test_a_clock_on_a_link_with_varying_delay_is_one_clock():
    clock = ran_for()
    behind = [(10.0 + 3.0 * count, 110.0 + count) for count in range(5)]
    at_once = [(22.1, 114.0 + count) for count in range(9)]
    assert set(readings(clock, *behind, *at_once)) == {CURRENT}


def test_a_silence_is_no_restart():
    assert readings(ran_for(), (70.0, 170.0), (70.1, 170.1)) == [CURRENT, CURRENT]


@pytest.mark.parametrize(("ahead_s", "reading"), [(0.7, LATE), (4.0, LATE), (3600.0, FOREIGN)])
def test_one_packet_ahead_of_the_clock_does_not_block_later_packets(ahead_s, reading):
    clock = ran_for()
    assert readings(clock, (10.05, 110.05 + ahead_s), (10.1, 110.1)) == [reading, CURRENT]


def test_two_clocks_under_one_id_are_distinguished_indefinitely():
    clock = ran_for()
    for count in range(100):
        now_s = 10.0 + 0.1 * count
        pair = readings(clock, (now_s, 100.0 + now_s), (now_s + 0.05, 5000.0 + now_s))
        assert pair == [CURRENT, FOREIGN]


@pytest.mark.parametrize("apart_s", [50.0, -50.0])
def test_a_second_clock_that_runs_beside_the_first_is_another_autopilots(apart_s):
    clock, seen = SourceClock(round_s=ROUND_S, behind_s=1.0), []
    for step in range(200):
        now_s = 0.02 * step
        assert clock.read(100.0 + now_s, now_s) is CURRENT
        seen.append(clock.read(100.0 + apart_s + now_s, now_s + 0.01))
    assert set(seen[110:]) == {FOREIGN}


def test_a_repeated_old_stamp_is_no_second_clock():
    clock = ran_for()
    for step in range(500):
        now_s = 10.0 + 0.02 * step
        assert readings(clock, (now_s, 100.0 + now_s), (now_s + 0.01, 80.0)) == [CURRENT, LATE]


def test_a_restarted_clock_is_accepted_once_it_has_run_on_by_itself():
    arrivals = [(11.3 + 0.1 * count, 0.3 + 0.1 * count) for count in range(6)]
    assert readings(ran_for(), *arrivals) == [LATE, LATE, LATE, RESTARTED, CURRENT, CURRENT]


@pytest.mark.parametrize("count", [1, 2, 50])
def test_a_burst_of_old_packets_is_no_restart(count):
    clock = ran_for()
    burst = [(10.05, 90.0 + 0.1 * number) for number in range(count)]
    assert readings(clock, *burst, (10.1, 110.1)) == [*[LATE] * count, CURRENT]


def test_single_old_packets_among_current_ones_are_no_restart():
    clock = ran_for()
    for count in range(100):
        now_s, late_s = 10.0 + 1.5 * count, 10.0 + 7.0 * (count % 5)
        pair = (now_s, 100.0 + now_s), (now_s + 0.05, 100.0 + now_s - late_s)
        assert readings(clock, *pair) == [CURRENT, LATE]


def test_a_slow_drifting_clock_that_runs_behind_is_another_autopilots():
    """An ArduPilot without streams sends TIMESYNC every 10 s."""
    clock, seen = ran_for(), []
    for count in range(1200):
        now_s = 10.0 + 10.0 * count
        clock.read(100.0 + now_s, now_s)
        seen.append(clock.read(50.0 + 1.0005 * now_s, now_s + 0.05))
    assert set(seen[2:]) == {FOREIGN}


def test_one_repeated_packet_is_no_running_clock():
    clock = ran_for()
    assert set(readings(clock, *[(10.0 + count, 105.0) for count in range(1, 9)])) == {LATE}


def test_a_clock_that_began_with_a_late_packet_is_corrected():
    clock = SourceClock()
    arrivals = [(0.0, 100.0), *[(0.1 * n, 102.0 + 0.1 * n) for n in range(1, 7)]]
    assert readings(clock, *arrivals) == [CURRENT, LATE, LATE, LATE, CURRENT, CURRENT, CURRENT]


def test_modules_that_stamp_at_different_times_are_one_clock():
    clock = ran_for(behind_s=1.0)
    assert readings(clock, (10.1, 109.2), (10.2, 110.2), (10.3, 109.3)) == [CURRENT] * 3


@pytest.mark.parametrize("round_s", [ROUND_S, 2**32 * 1e-6])
def test_a_stamp_of_32_bits_wraps_around(round_s):
    clock = ran_for(stamp_s=round_s - 10.05, round_s=round_s)
    assert readings(clock, (10.1, 0.05), (10.15, round_s - 0.1), (10.2, 0.15)) == [
        CURRENT,
        LATE,
        CURRENT,
    ]


def test_a_restart_after_most_of_a_round_of_the_clock_is_detected():
    clock = ran_for(stamp_s=30.0 * 86400.0, round_s=ROUND_S, behind_s=1.0)
    assert readings(clock, *[(11.3 + 0.1 * n, 0.3 + 0.1 * n) for n in range(4)])[-1] is RESTARTED


@pytest.mark.uncounted
@pytest.mark.recordings
@pytest.mark.parametrize(
    ("name", "restarts"),
    [
        ("px4/k1_nogcs_autopilot_restart.companion.tlog", 1),
        ("px4/b1_battery_drain.companion.tlog", 0),
        ("px4/d3_gps_silent_v117.companion.tlog", 0),
        ("px4/h1_msg_intervals.companion.tlog", 0),
        ("ardupilot/a1_boot.companion.tlog", 0),
        ("ardupilot/d2_gps_loss.companion.tlog", 0),
        ("ardupilot/h2_signing.companion.tlog", 1),
    ],
)
def test_in_recordings_clocks_restart_only_with_autopilots_and_no_packet_is_late(
    recording, name, restarts
):
    codec = Codec(system_id=9, component_id=9, wanted=MESSAGE_IDS)
    clock, seen = SourceClock(round_s=ROUND_S, behind_s=1.0), 0
    order = PacketOrder(same={}, boot_clock=clock)
    late = []
    for now_s, packet in recording(name):
        for message in codec.receive(packet):
            if (message.get_srcSystem(), message.get_srcComponent()) != (1, 1):
                continue
            boot_s = boot_time_s(message)
            if boot_s is not None and clock.read(boot_s, now_s) is RESTARTED:
                seen += 1
                order.restart()
            if order.is_late(message, now_s):
                late.append((now_s, message.get_type()))
    assert seen == restarts
    # After a restart the old clock counts until the new one has run on.
    assert len(late) <= 100 * restarts, late[:10]
