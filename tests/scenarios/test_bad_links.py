"""Missions over links that lose, delay and reorder packets, and takeovers beside them."""

from __future__ import annotations

import pytest

from sitl.wire import packet_header, packets

from ..copies import copy_of, flown_once
from ..flights.judging import (
    assert_nothing_was_touched,
    assert_setpoints_keep_to_free_space,
    assert_setpoints_never_jump,
)
from ..flights.lockstep import hovering
from ..flights.operator import EXIT, INSPECTION, Manner
from ..thorough import sampled
from .marks import BOTH

NUMBERS = {"HEARTBEAT": 0, "CURRENT_MODE": 436}
NOTICED_S = 0.2
"""Longest time of a takeover until the stream ends, on a link without loss."""
NOTICED_ON_A_BAD_LINK_S = 0.3
"""Longest time with 30 % loss and delays of 0.05 to 0.2 s: 0.2 s under way, and five losses
in a row of mode reports, which come fifty times a second."""


def worsen_link(flight, loss_percent=30.0, delay_ms=50.0, jitter_ms=150.0):
    conditions = flight.autopilot.conditions
    conditions.link_loss_percent = loss_percent
    conditions.link_delay_ms, conditions.link_jitter_ms = delay_ms, jitter_ms


def insist(flight, mission, states, index=-1):
    """An operator who repeats the order until it is carried out: orders are lost, too."""
    for _ in range(10):
        flight.operator.mission(mission, index)
        flight.run(1.5)
        if flight.state in states:
            return
    raise AssertionError(f"never {states}: {flight.state}, {flight.operator.texts()[-5:]}")


@flown_once
def in_flight(manner, seconds=3.0):
    flight = hovering(vehicle="x500", manner=manner)
    flight.begin(INSPECTION)
    flight.run(seconds)
    assert flight.state == "flying"
    return flight


REORDERED_MS, LATE_MS = (50.0, 150.0), (200.0, 0.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("manner", "delay_ms", "jitter_ms"),
    sampled(
        [(Manner.ARDUPILOT, *REORDERED_MS), (Manner.PX4, *LATE_MS)],
        [(manner, *times) for manner in Manner for times in (REORDERED_MS, LATE_MS)],
    ),
)
def test_a_whole_mission_is_flown_though_three_packets_in_ten_are_lost(manner, delay_ms, jitter_ms):
    flight = hovering(vehicle="x500", manner=manner)
    worsen_link(flight, delay_ms=delay_ms, jitter_ms=jitter_ms)
    insist(flight, INSPECTION, {"ready", "flying"}, index=0)
    if not flight.operator.in_mode("ours"):
        flight.operator.mode("ours")
    flight.run_until_state("flying", 5.0)
    flight.run_until(lambda: flight.companion.status.task.done, 200.0)
    insist(flight, EXIT, {"flying", "landing_leg"})
    flight.run_until_state("holding", 120.0)
    states = {state for time_s, state in flight.states}
    assert not states & {"released", "overridden"}
    assert_nothing_was_touched(flight)
    assert_setpoints_never_jump(flight)
    assert_setpoints_keep_to_free_space(flight)


@BOTH
@pytest.mark.parametrize("later_s", [0.0, 0.33, 0.66])
def test_a_takeover_is_detected_within_a_fifth_of_a_second(manner, later_s):
    flight = in_flight(manner)
    flight.run(later_s)
    took_s = flight.now_s
    flight.operator.mode("hold")
    flight.run(2.0)
    assert flight.state == "overridden"
    assert flight.last_setpoint_s <= took_s + NOTICED_S


@pytest.mark.slow
@pytest.mark.parametrize(
    ("manner", "soon", "latest_s"),
    [(Manner.ARDUPILOT, 14, NOTICED_ON_A_BAD_LINK_S), (Manner.PX4, 8, 2.2)],
)
def test_a_takeover_is_detected_on_a_link_that_loses_three_packets_in_ten(manner, soon, latest_s):
    """Of 15 takeovers at different times, `soon` end the stream within 0.2 s.

    PX4 reports a change once, and then its mode twice a second.
    """
    before = in_flight(manner)
    worsen_link(before)
    before.run(1.0)
    noticed_s = []
    for _ in range(15):
        flight = copy_of(before)
        took_s = flight.now_s
        flight.operator.mode("hold")
        flight.run(2.5)
        assert flight.state == "overridden"
        noticed_s.append(flight.last_setpoint_s - took_s)
        before.run(0.14)
    assert max(noticed_s) <= latest_s
    assert sorted(noticed_s)[soon - 1] <= NOTICED_S + 1e-6


@BOTH
def test_missing_mode_reports_end_control_while_other_packets_arrive(manner):
    """Mode reports are lost; the position still arrives."""
    flight = in_flight(manner)
    handle = flight.handle
    mode_messages = {"HEARTBEAT", "CURRENT_MODE"}
    flight.handle = lambda data: handle(without(data, mode_messages))
    silent_s = flight.now_s
    flight.run(5.0)
    assert flight.state == "released"
    assert flight.operator.has_received("mode unknown for 3.0 s")
    limit_s = flight.config.supervision.mode_timeout_s
    assert flight.last_setpoint_s == pytest.approx(silent_s + limit_s, abs=0.3)
    last = flight.setpoints[-1].message
    assert (last.vx, last.vy, last.vz) == (0.0, 0.0, 0.0)


@pytest.mark.slow
def test_missing_armed_state_reports_end_control_while_the_mode_is_reported():
    """PX4 reports the mode by CURRENT_MODE, too; only HEARTBEAT has the armed state."""
    flight = in_flight(Manner.PX4)
    handle = flight.handle
    flight.handle = lambda data: handle(without(data, {"HEARTBEAT"}))
    silent_s = flight.now_s
    flight.run(17.0)
    assert flight.state == "released"
    assert flight.operator.has_received("armed state unknown for 15")
    limit_s = flight.config.supervision.armed_timeout_s
    assert flight.last_setpoint_s == pytest.approx(silent_s + limit_s, abs=1.1)


def without(data, names):
    """Bytes of whole packets without those of some messages."""
    ids = {NUMBERS[name] for name in names}
    return b"".join(item for item in packets(data) if packet_header(item)[0] not in ids)
