"""Delays of positions by their arrivals and stamps: the simulator's, or this computer's."""

from __future__ import annotations

import pytest

from .stalls import HOST, SILENCE, SIMULATOR, Stall, around, slowest, stalls

PERIOD_S = 0.02
BEGIN_S, BOOT_S = 5000.0, 100.0


def sent(seconds, *, speed=1.0, stopped=()):
    """Times and stamps at which a simulator sends. stopped: (time, duration) of its stalls."""
    samples, time_s, stamp_s = [], BEGIN_S, BOOT_S
    left = sorted(stopped, reverse=True)
    while time_s < BEGIN_S + seconds:
        samples.append((time_s, stamp_s))
        time_s += PERIOD_S / speed
        stamp_s += PERIOD_S
        if left and time_s - BEGIN_S >= left[-1][0]:
            time_s += left.pop()[1]
    return samples


def delivered(samples, at_s, length_s):
    """The same, if nothing is read for a while and then everything at once."""
    end_s = BEGIN_S + at_s + length_s
    return [
        (max(time_s, end_s) if time_s >= BEGIN_S + at_s else time_s, stamp_s)
        for time_s, stamp_s in samples
    ]


def without(samples, at_s, length_s):
    """The same without the messages of a while."""
    first_s, last_s = BEGIN_S + at_s, BEGIN_S + at_s + length_s
    return [item for item in samples if not first_s < item[0] < last_s]


def rounded(found):
    return [(round(stall.length_s, 1), stall.cause) for stall in found]


def test_punctual_messages_have_no_delay():
    assert stalls(sent(30.0)) == []
    assert stalls([]) == []


@pytest.mark.parametrize("length_s", [0.3, 0.7, 4.0])
def test_a_clock_that_stood_still_is_the_simulators_stall(length_s):
    (stall,) = stalls(sent(30.0, stopped=[(10.0, length_s)]))
    assert stall.cause == SIMULATOR
    assert stall.length_s == pytest.approx(length_s, abs=0.03)
    assert stall.time_s == pytest.approx(BEGIN_S + 10.0 + length_s, abs=0.05)


@pytest.mark.parametrize("length_s", [0.3, 0.7, 4.0])
def test_messages_that_arrive_late_and_at_once_are_the_hosts_delay(length_s):
    assert rounded(stalls(delivered(sent(30.0), 10.0, length_s))) == [(length_s, HOST)]


def test_a_clock_that_ran_while_nothing_was_sent_is_a_silence():
    assert rounded(stalls(without(sent(30.0), 10.0, 0.7))) == [(0.7, SILENCE)]


def test_a_stall_of_both_has_two_parts():
    found = stalls(delivered(sent(30.0, stopped=[(10.0, 0.4)]), 10.3, 0.6))
    assert {cause for _, cause in rounded(found)} == {SIMULATOR, HOST}
    assert sum(stall.length_s for stall in found) == pytest.approx(0.9, abs=0.05)


def test_two_stalls_close_together_are_found():
    found = stalls(sent(30.0, stopped=[(10.0, 0.5), (13.0, 0.3)]))
    assert rounded(found) == [(0.5, SIMULATOR), (0.3, SIMULATOR)]


def test_a_simulator_that_catches_up_by_a_tenth_of_a_second_still_stood():
    """ArduPilot's SITL makes up for at most 0.1 s."""
    samples = sent(30.0, stopped=[(10.0, 0.6)])
    caught_up = [
        (time_s - 0.1 * min(1.0, max(0.0, (time_s - BEGIN_S - 10.6) / 0.5)), stamp_s)
        for time_s, stamp_s in samples
    ]
    assert rounded(stalls(caught_up)) == [(0.5, SIMULATOR)]


def test_a_clock_that_runs_one_percent_slow_is_no_stall():
    samples = sent(300.0, speed=0.99)
    assert stalls(samples) == []
    assert slowest(samples) == pytest.approx(0.99, abs=0.005)


def test_the_slowest_ten_seconds_are_found():
    steps = [(10.0 + 0.1 * number, 0.06) for number in range(100)]
    assert slowest(sent(60.0, stopped=steps)) == pytest.approx(0.4, abs=0.05)
    assert slowest(sent(5.0)) is None


def test_a_restart_of_the_autopilot_is_no_stall():
    again = [(time_s + 40.0, stamp_s) for time_s, stamp_s in sent(20.0)]
    assert stalls([*sent(30.0), *again]) == []


def test_a_delay_counts_for_what_happened_while_it_lasted_and_shortly_after():
    stall = Stall(10.0, 0.6, SIMULATOR)
    assert [around([stall], time_s) for time_s in (9.3, 9.5, 10.9, 11.1)] == [
        [],
        [stall],
        [stall],
        [],
    ]


RECORDED = [
    *((0.00, 0.000), (0.03, 0.024), (0.05, 0.056), (2.66, 0.072), (2.67, 0.104), (2.67, 0.128)),
    *((2.67, 0.152), (2.67, 0.176), (2.67, 0.200), (2.67, 0.224), (2.67, 0.248), (2.67, 0.280)),
    *((2.68, 0.296), (2.68, 0.328), (2.68, 0.352), (2.68, 0.400), (2.68, 0.448), (2.68, 0.496)),
    *((2.68, 0.552), (2.68, 0.600), (2.69, 2.576), (2.73, 2.600), (2.75, 2.632)),
]
"""Real PX4 beside fifteen busy processes, the wire without priority; its buffer overflowed, too."""


def test_a_recorded_burst_is_the_hosts_though_its_first_stamp_advanced_by_a_moment():
    """2.6 s late after 0.016 s by the stamps: the first message alone does not decide."""
    assert rounded(stalls(RECORDED)) == [(2.5, HOST)]
    cut = [item for item in RECORDED if item[0] < 2.665]
    assert [cause for _, cause in rounded(stalls(cut))] == [SIMULATOR]
