"""Delay of the autopilot's packets, by its answers to TIMESYNC."""

from __future__ import annotations

import pytest

from moar_companion.mavlink.autopilot_requests import TimesyncRtt
from moar_companion.mavlink.dialect import create
from moar_companion.mavlink.translate_outgoing import SystemStatus, heartbeat_message

TICK_S = 0.05
AUTOPILOT = (1, 1)


def answer_to(stamp):
    return create("TIMESYNC", tc1=5, ts1=stamp, target_system=1, target_component=195)


def answered(trips, *late_s, from_s=100.0):
    """Answers each request after its delay; returns the least delay."""
    now_s, under_way = from_s, []
    late = iter(late_s)
    while True:
        for due_s, answer in [item for item in under_way if item[0] <= now_s]:
            trips.handle(answer, due_s)
        under_way = [item for item in under_way if item[0] > now_s]
        question = trips.next_request(AUTOPILOT, now_s)
        if question is not None:
            seconds = next(late, None)
            if seconds is None:
                for due_s, answer in under_way:
                    trips.handle(answer, due_s)
                return trips.least_s(now_s)
            answer = answer_to(question.ts1)
            under_way.append((now_s + seconds, answer))
        now_s += TICK_S


def test_the_delay_is_unknown_before_two_answers():
    assert answered(TimesyncRtt()) is None
    assert answered(TimesyncRtt(), 0.02) is None


@pytest.mark.parametrize(
    ("late_s", "least_s"),
    [
        ((0.02, 0.03), 0.02),
        ((0.02, 0.9), 0.02),  # one late answer
        ((0.02, 0.9, 0.8), 0.8),
        ((4.0, 4.0, 4.0), 4.0),
        ((0.9, 0.8, 0.6), 0.6),
    ],
)
def test_the_shorter_of_the_last_two_delays_counts(late_s, least_s):
    assert answered(TimesyncRtt(), *late_s) == pytest.approx(least_s)


def test_answers_to_other_requests_and_requests_do_not_count():
    trips = TimesyncRtt()
    question = trips.next_request(AUTOPILOT, 100.0)
    assert (question.target_system, question.target_component) == AUTOPILOT
    heartbeat = heartbeat_message(SystemStatus.ACTIVE, 0)
    for message in (question, answer_to(question.ts1 + 1), heartbeat):
        trips.handle(message, 100.1)
    answer = answer_to(question.ts1)
    for _ in range(3):  # a repeated answer does not count
        trips.handle(answer, 100.1)
    assert trips.least_s(100.1) is None


def test_timesync_requests_are_sent_eight_times_a_second():
    trips = TimesyncRtt()
    asked = [trips.next_request(AUTOPILOT, 100.0 + 0.02 * tick) for tick in range(500)]
    assert 68 <= sum(message is not None for message in asked) <= 81


def test_when_answers_cease_the_delay_grows_with_the_wait():
    trips = TimesyncRtt()
    assert answered(trips, 0.02, 0.02, 0.02) == pytest.approx(0.02)
    for tick in range(100):
        trips.next_request(AUTOPILOT, 101.0 + TICK_S * tick)
    assert trips.least_s(103.0) == pytest.approx(0.02)  # they may have been lost
    assert trips.least_s(106.0) == pytest.approx(5.5, abs=0.3)


def test_without_any_answer_the_delay_stays_unknown():
    trips = TimesyncRtt()
    for tick in range(200):
        trips.next_request(AUTOPILOT, 100.0 + TICK_S * tick)
    assert trips.least_s(110.0) is None
