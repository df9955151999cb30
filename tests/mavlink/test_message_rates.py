from __future__ import annotations

import itertools

import pytest

from moar_companion.mavlink import autopilots
from moar_companion.mavlink.dialect import mavlink
from moar_companion.mavlink.message_rates import MessageRates, on_line, on_network, wanted_rates_hz
from moar_companion.types import ARDUPILOT, PX4, UNKNOWN

ATTITUDE = 30
POSITION = 32
ACCEPTED = 0
TEMPORARILY_REJECTED = 1
DENIED = 2


class Machine:
    """Requests, a clock in steps of 20 ms, and streams that flow at given rates."""

    def __init__(self, rates_hz, *, silent, slow_line=False):
        self.requests = MessageRates()
        self.intervals_us = []
        self.now_s = 100.0
        self.flowing_hz = {}
        self.unused_hz = {}
        self.shared = False
        self.flows_when_accepted = {}
        self.delay_s = 0.0
        self.lost = []
        self._due_s = {}
        self._answers = []
        self.requests.start(rates_hz, silent=silent, slow_line=slow_line, now_s=self.now_s)

    def run(self, duration_s, *, answer=ACCEPTED):
        """Requests made within a time as (time, id); answers go back after `delay_s`.

        answer: a result, or a function of the message id; None: none. lost: ids whose next request
        is lost. Streams in `flows_when_accepted` flow once accepted.
        """
        made = []
        for _ in range(round(duration_s / 0.02)):
            self.now_s += 0.02
            for message_id in self._due(self.flowing_hz):
                self.requests.count(message_id)
            for message_id in self._due(self.unused_hz):
                self.requests.count_unused(message_id, "serial", self.now_s)
            request = self.requests.next_request(self.now_s, "serial", shared=self.shared)
            if request is not None:
                made.append((round(self.now_s - 100.0, 2), request[0]))
                self.intervals_us.append(request[1])
                self._answer(request[0], answer)
            while self._answers and self._answers[0][0] <= self.now_s:
                self.requests.answered(self._answers.pop(0)[1])
        return made

    def _answer(self, message_id, answer):
        if message_id in self.lost:
            self.lost.remove(message_id)
            return
        result = answer(message_id) if callable(answer) else answer
        if result == ACCEPTED and message_id in self.flows_when_accepted:
            self.flowing_hz[message_id] = self.flows_when_accepted[message_id]
        if result is not None:
            self._answers.append((self.now_s + self.delay_s, result))

    def _due(self, rates_hz):
        for message_id, rate_hz in rates_hz.items():
            due_s = self._due_s.setdefault(message_id, self.now_s)
            if self.now_s >= due_s:
                self._due_s[message_id] = due_s + 1 / rate_hz
                yield message_id


def test_all_messages_are_requested_of_a_silent_autopilot_at_once():
    machine = Machine({ATTITUDE: 20.0, POSITION: 10.0}, silent=True)
    assert [message_id for _, message_id in machine.run(0.1)] == [ATTITUDE, POSITION]
    machine.flowing_hz = {ATTITUDE: 20.0, POSITION: 10.0}
    assert machine.run(60.0) == []


def test_the_requested_interval_is_in_microseconds():
    requests = MessageRates()
    requests.start({ATTITUDE: 30.0}, silent=True, now_s=0.0)
    assert requests.next_request(0.1) == (ATTITUDE, 33333)


def test_a_stream_that_flows_by_itself_is_not_requested():
    machine = Machine({ATTITUDE: 20.0, POSITION: 10.0}, silent=False)
    machine.flowing_hz = {ATTITUDE: 99.0, POSITION: 9.9}
    assert machine.run(60.0) == []


def test_a_stream_that_is_too_slow_is_requested_after_its_rate_was_measured():
    machine = Machine({ATTITUDE: 20.0, POSITION: 10.0}, silent=False)
    machine.flowing_hz = {ATTITUDE: 10.0, POSITION: 10.0}
    made = machine.run(60.0)
    assert made == [(2.02, ATTITUDE)]


def test_at_most_five_requests_are_sent_in_100_ms():
    rates = dict.fromkeys(range(1000, 1020), 1.0)
    made = Machine(rates, silent=True).run(10.0)
    assert len(made) == 20
    times = [time_s for time_s, _ in made]
    assert all(b - a >= 0.019 for a, b in itertools.pairwise(times))


def test_without_an_answer_a_stream_is_requested_three_times_and_after_a_pause():
    """A link that loses 30 % each way loses all three answers of one message in seven."""
    machine = Machine({ATTITUDE: 20.0, POSITION: 10.0}, silent=True)
    made = machine.run(10.0, answer=None)
    assert [message_id for _, message_id in made] == [ATTITUDE, POSITION] * 3
    times = [time_s for time_s, _ in made]
    assert all(b - a >= 0.49 for a, b in itertools.pairwise(times))
    again = [message_id for _, message_id in machine.run(8.0, answer=None)]
    assert sorted(again) == [ATTITUDE] * 3 + [POSITION] * 3


def test_a_stream_that_flows_without_an_answer_is_not_requested_again():
    machine = Machine({ATTITUDE: 20.0}, silent=True)
    assert len(machine.run(0.5, answer=None)) == 1
    machine.flowing_hz = {ATTITUDE: 20.0}
    machine.run(3.0, answer=None)
    assert machine.run(60.0, answer=None) == []


def test_a_denied_stream_is_requested_again_after_a_minute_or_a_restart():
    machine = Machine({ATTITUDE: 20.0}, silent=True)
    assert len(machine.run(60.0, answer=DENIED)) == 1
    assert len(machine.run(60.0, answer=DENIED)) == 1
    machine.requests.start({ATTITUDE: 20.0}, silent=True, now_s=machine.now_s)
    machine.flows_when_accepted = {ATTITUDE: 20.0}
    assert len(machine.run(60.0)) == 1


def test_a_stream_acknowledged_but_absent_is_requested_again_after_a_pause():
    machine = Machine({ATTITUDE: 20.0}, silent=True)
    times = [time_s for time_s, _ in machine.run(35.0)]
    assert len(times) == 4
    assert all(b - a >= 10.0 for a, b in itertools.pairwise(times))


def test_a_late_answer_does_not_settle_the_next_request():
    machine = Machine({ATTITUDE: 20.0, POSITION: 10.0}, silent=True)
    machine.delay_s = 0.6
    machine.lost = [POSITION]
    machine.flows_when_accepted = {ATTITUDE: 20.0, POSITION: 10.0}
    machine.run(10.0)
    assert machine.flowing_hz == {ATTITUDE: 20.0, POSITION: 10.0}


def test_a_late_denial_does_not_deny_the_next_request():
    machine = Machine({ATTITUDE: 20.0, POSITION: 10.0}, silent=True)
    machine.delay_s = 0.6
    machine.lost = [POSITION]
    machine.flows_when_accepted = {POSITION: 10.0}
    machine.run(10.0, answer=lambda message_id: DENIED if message_id == ATTITUDE else ACCEPTED)
    assert machine.flowing_hz == {POSITION: 10.0}


def test_a_temporarily_rejected_stream_is_requested_again():
    made = Machine({ATTITUDE: 20.0}, silent=True).run(10.0, answer=TEMPORARILY_REJECTED)
    assert len(made) == 3


def test_a_stream_that_stops_is_requested_again():
    machine = Machine({ATTITUDE: 20.0}, silent=True)
    machine.run(0.1)
    machine.flowing_hz = {ATTITUDE: 20.0}
    assert machine.run(10.0) == []
    machine.flowing_hz = {}
    machine.flows_when_accepted = {ATTITUDE: 20.0}
    assert len(machine.run(10.0)) == 1
    assert machine.run(60.0) == []


def test_an_answer_without_a_request_is_ignored():
    requests = MessageRates()
    requests.answered(DENIED)
    requests.start({ATTITUDE: 20.0}, silent=True, now_s=0.0)
    requests.answered(DENIED)
    assert requests.next_request(0.1) is not None


@pytest.mark.parametrize("kind", [*autopilots.PROFILES, UNKNOWN])
def test_streams_for_telemetry_are_requested_of_every_autopilot(kind):
    assert {1, 24, 30, 32, 147, 242, 245} <= set(wanted_rates_hz(kind))


def test_streams_that_ardupilot_denies_are_not_requested():
    assert not {231, 230, 109, 111, 331, 253} & set(wanted_rates_hz(ARDUPILOT))


# Slow lines


def bytes_per_s(rates_hz, frame_bytes=12):
    return sum(
        rate_hz * (mavlink.mavlink_map[message_id].unpacker.size + frame_bytes)
        for message_id, rate_hz in rates_hz.items()
    )


@pytest.mark.parametrize("kind", [*autopilots.PROFILES, UNKNOWN])
def test_the_rates_for_a_serial_line_fit_it_with_room_for_all_else(kind):
    share, wanted_hz = autopilots.profile(kind).line_share, wanted_rates_hz(kind)
    before_hz = dict.fromkeys(wanted_hz, 0.0)
    for baud in (57600, 76800, 115200, 230400, 921600):
        rates_hz = on_line(wanted_hz, share * baud / 10)
        assert bytes_per_s(rates_hz) <= share * baud / 10 - 500
        assert all(before_hz[key] <= rates_hz[key] <= wanted_hz[key] for key in wanted_hz)
        before_hz = rates_hz
    assert rates_hz == wanted_hz


def test_the_rates_for_a_signed_line_have_room_for_the_signatures():
    rates_hz = on_line(wanted_rates_hz(ARDUPILOT), 4608.0, signed=True)
    assert bytes_per_s(rates_hz, 12 + 13) <= 4608.0 - 500


@pytest.mark.parametrize("kind", [*autopilots.PROFILES, UNKNOWN])
@pytest.mark.parametrize("baud", [9600, 57600])
def test_no_line_lowers_a_message_below_its_least_rate(kind, baud):
    wanted_hz = wanted_rates_hz(kind)
    rates_hz = on_line(wanted_hz, baud / 20)
    mode_id = 0 if kind is ARDUPILOT else 436
    least_hz = {POSITION: 20.0, ATTITUDE: 10.0, 36: 2.0, mode_id: 10.0}
    for message_id, rate_hz in rates_hz.items():
        assert rate_hz >= min(wanted_hz[message_id], least_hz.get(message_id, 1.0))
    battery, gps = mavlink.MAVLINK_MSG_ID_BATTERY_STATUS, mavlink.MAVLINK_MSG_ID_GPS_RAW_INT
    assert rates_hz[battery] >= 0.5
    assert rates_hz[gps] >= 1.0


def test_on_a_slow_line_a_stream_that_comes_too_often_is_requested_until_it_does_not():
    machine = Machine({ATTITUDE: 10.0, POSITION: 20.0}, silent=False, slow_line=True)
    machine.flowing_hz = {ATTITUDE: 100.0, POSITION: 20.0}
    machine.lost = [ATTITUDE] * 4
    asked = [message_id for _, message_id in machine.run(20.0)]
    assert asked.count(ATTITUDE) == 5
    machine.flowing_hz = {ATTITUDE: 10.0, POSITION: 20.0}
    assert machine.run(60.0) == []


def test_on_a_slow_line_all_streams_are_requested_at_once():
    machine = Machine({ATTITUDE: 10.0, POSITION: 20.0}, silent=False, slow_line=True)
    assert [message_id for _, message_id in machine.run(0.1)] == [ATTITUDE, POSITION]


def test_on_a_slow_line_an_unread_stream_is_lowered_to_a_tenth_after_two_seconds():
    machine = Machine({}, silent=False, slow_line=True)
    machine.unused_hz = {QUATERNION: 5.0, PRESSURE: 0.1}
    made = machine.run(3.0)
    assert made == [(pytest.approx(2.0, abs=0.05), QUATERNION)]
    assert machine.intervals_us == [10_000_000]
    machine.unused_hz = {QUATERNION: 0.1, PRESSURE: 0.1}
    assert machine.run(120.0) == []


# Unused streams

QUATERNION = 31
PRESSURE = 29


def with_unused():
    machine = Machine({}, silent=False)
    machine.unused_hz = {QUATERNION: 40.0, PRESSURE: 1.0}
    return machine


def test_an_unused_frequent_stream_is_slowed_down_once():
    machine = with_unused()
    assert machine.run(10.0) == []
    assert [message_id for _, message_id in machine.run(1.0)] == [QUATERNION]
    assert machine.run(60.0) == []  # another system keeps the stream fast


def test_an_unused_stream_is_slowed_down_to_1_hz():
    requests = MessageRates()
    for step in range(1100):
        requests.count_unused(QUATERNION, "serial", 0.01 * step)
    assert requests.next_request(11.0, "serial", shared=False) == (QUATERNION, 1_000_000)


def test_a_requested_stream_is_never_slowed_down():
    machine = Machine({QUATERNION: 20.0}, silent=False)
    machine.unused_hz = {QUATERNION: 40.0}
    machine.flowing_hz = {QUATERNION: 40.0}
    assert machine.run(60.0) == []


def test_without_an_answer_slowing_down_is_requested_until_the_stream_is_slow():
    machine = with_unused()
    assert len(machine.run(12.0, answer=None)) == 3
    assert len(machine.run(20.0, answer=None)) == 3
    machine.unused_hz = {QUATERNION: 1.0}
    machine.run(20.0, answer=None)
    assert machine.run(60.0, answer=None) == []
    machine.unused_hz = {QUATERNION: 40.0}
    assert machine.run(60.0, answer=None) == []


def test_a_stream_whose_slowing_down_is_denied_is_left():
    machine = with_unused()
    assert len(machine.run(60.0, answer=DENIED)) == 1


def test_on_a_shared_link_no_stream_is_slowed_down():
    machine = with_unused()
    machine.shared = True
    assert machine.run(60.0) == []


def test_a_slowed_stream_is_restored_once_when_the_link_becomes_shared():
    machine = with_unused()
    machine.run(12.0)
    machine.unused_hz = {QUATERNION: 1.0}
    machine.run(30.0)
    machine.shared = True
    intervals = []
    for _ in range(600):
        machine.now_s += 0.1
        request = machine.requests.next_request(machine.now_s, "serial", shared=True)
        if request is not None:
            intervals.append(request)
            machine.requests.answered(ACCEPTED)
    assert intervals == [(QUATERNION, pytest.approx(25_000, rel=0.02))]
    machine.shared = False
    machine.unused_hz = {QUATERNION: 40.0}
    assert machine.run(60.0) == []


def test_a_stream_slowed_on_one_link_is_not_restored_on_another():
    machine = with_unused()
    machine.run(12.0)
    assert machine.requests.next_request(machine.now_s + 1.0, "network", shared=True) is None


def test_after_an_autopilot_restart_an_unused_stream_is_slowed_down_again():
    machine = with_unused()
    machine.run(12.0)
    machine.requests.start({}, silent=False, now_s=machine.now_s)
    assert [message_id for _, message_id in machine.run(12.0)] == [QUATERNION]


def test_a_stream_slowed_without_an_answer_is_restored_to_its_former_rate():
    machine = with_unused()
    machine.run(11.0, answer=None)
    machine.unused_hz = {QUATERNION: 1.0}
    machine.run(60.0, answer=None)
    request = machine.requests.next_request(machine.now_s + 1.0, "serial", shared=True)
    assert request == (QUATERNION, pytest.approx(25_000, rel=0.02))


def test_a_late_answer_to_slowing_down_does_not_settle_the_restoring():
    machine = with_unused()
    assert len(machine.run(10.2, answer=None)) == 1
    machine.unused_hz = {QUATERNION: 1.0}
    machine.shared = True
    assert machine.run(0.1, answer=None) == []
    machine.requests.answered(ACCEPTED)
    assert len(machine.run(10.0, answer=None)) == 3


@pytest.mark.parametrize(("kind", "message_id"), [(PX4, 436), (ARDUPILOT, 0)])
def test_on_a_network_the_mode_is_requested_at_50_hz_and_nothing_else_changes(kind, message_id):
    wanted_hz = wanted_rates_hz(kind)
    assert on_network(wanted_hz) == {**wanted_hz, message_id: 50.0}


def test_on_a_network_obstacle_distances_are_requested_where_they_are_used():
    wanted_hz = wanted_rates_hz(PX4)
    assert on_network(wanted_hz, obstacles=True) == {**on_network(wanted_hz), 330: 5.0}
    assert 330 not in on_network(wanted_hz)
