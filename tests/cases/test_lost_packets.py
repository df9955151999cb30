"""Bursts of lost packets, and copies of packets, on the autopilot's link."""

from __future__ import annotations

from functools import cache

import pytest

from .flown import AUTOPILOT, Packets, gps, hover

_RATE_HZ = 40
GAPS_S = (0.3, 0.45, 0.5, 0.55, 0.6, 0.65, 0.8, 1.2)
_PACKETS = 9
"""Of each step: 360 packets a second, as many as PX4 sends."""
_ONCE_A_SECOND = 3
"""Heartbeat, landed state and GPS, at each whole second: the gap of 1.2 s has one."""


def _flown(gap_s: float, begin_s: float) -> Packets:
    return hover(
        duration_s=begin_s + gap_s + 4.0,
        rate_hz=_RATE_HZ,
        unread=_PACKETS - 3,
        first=lambda t: (gps(t),),
        copies=lambda t: int(not begin_s <= t < begin_s + gap_s),
    )


@cache
def _counted(gap_s: float, begin_s: float = 5.1) -> tuple[int, float]:
    replay, listener = _flown(gap_s, begin_s).played()
    worst = replay.measures["communication"]["packet loss"].greatest_risk
    return listener.sources[AUTOPILOT].lost, worst or 0.0


@pytest.mark.parametrize("gap_s", GAPS_S)
def test_a_burst_of_lost_packets_counts_as_long_as_it_was(gap_s):
    whole_seconds = int(5.1 + gap_s) - 5
    lost = round(gap_s * _RATE_HZ) * _PACKETS + whole_seconds * _ONCE_A_SECOND
    assert _counted(gap_s)[0] == lost


def test_a_longer_burst_is_no_lesser_risk():
    risks = [_counted(gap_s)[1] for gap_s in GAPS_S]
    assert risks == sorted(risks)
    assert risks[1] > 0.4


def test_a_heartbeat_first_after_the_burst_counts_as_received():
    # The heartbeat has no time, and follows a loss of whole and parts of rounds of its number.
    assert _counted(0.5, begin_s=5.5)[0] == 20 * _PACKETS
    assert _counted(0.75, begin_s=5.25)[0] == 30 * _PACKETS


def test_copies_of_packets_are_no_loss_and_no_less_data():
    replay, listener = hover(
        duration_s=28.0, unread=4, copies=lambda t: 2 if t >= 22.0 else 1
    ).played()
    assert listener.sources[AUTOPILOT][:2] == (280 * 7 + 28 * 4, 0)
    assert replay.samples[-1].risk["communication"] < 0.01
    assert replay.measures["communication"]["data rate"].greatest_risk == 0.0
    assert listener.inputs["gps"].messages == 28
