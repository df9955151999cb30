from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from moar_companion.mavlink.autopilot_control import commands_motion
from moar_companion.mavlink.codec import Codec
from moar_companion.mavlink.dialect import create
from moar_companion.mavlink.outbox import Outbox
from moar_companion.mavlink.statustext import Severity, StatusTexts
from moar_companion.mavlink.translate_outgoing import (
    SystemStatus,
    named_value_message,
    setpoint_message,
)

SLOW, FAST, NETWORK = "serial:/dev/ttyS0:57600", "serial:/dev/ttyS0:921600", "udp:127.0.0.1:14550"
CYCLE_S = 0.02


def setpoint():
    return setpoint_message(
        target=(1, 1),
        position_ned_m=(1.1, 2.2, -3.3),
        velocity_ned_mps=(0.4, 0.5, 0.6),
        yaw_rad=0.7,
        now_s=1.0,
    )


def value(number=1.0):
    return named_value_message("RISK_WIND", number, 1.0)


def text():
    return StatusTexts().messages(Severity.INFO, "t" * 50, 1.0)[0]


def timesync():
    return create("TIMESYNC", tc1=0, ts1=1, target_system=1, target_component=1)


def acknowledgement():
    return create("COMMAND_ACK", command=31010, result=0)


class Sender:
    """An outbox as the session uses it, and when its line would carry each packet."""

    def __init__(self, link):
        self.link = link
        self.outbox = Outbox([link], commands_motion)
        self._codec = Codec(system_id=1, component_id=195)
        self._idle_s = self.now_s = 100.0
        self.waits_s = []
        """Time that each setpoint waited for earlier packets."""

    def cycle(self, *messages, setpoints=True):
        """One cycle with these messages; returns the names of what is sent."""
        self.now_s += CYCLE_S
        for message in messages:
            self.outbox.send(self.link, message)
        if setpoints:
            self.outbox.send(self.link, setpoint())
        self.outbox.send_heartbeat_if_due(self.now_s, SystemStatus.ACTIVE, 0)
        return [
            self._carry(message)
            for source in (self.outbox.take_control(), self.outbox.take(self.now_s))
            for _, message in source
        ]

    def _carry(self, message):
        size = len(self._codec.encode(message))
        self.outbox.sent(self.link, size, self.now_s)
        begin_s = max(self._idle_s, self.now_s)
        self._idle_s = begin_s + size * 10 / float(self.link.rpartition(":")[2])
        if commands_motion(message):
            self.waits_s.append(begin_s - self.now_s)
        return message.get_type()


def test_on_a_network_all_messages_leave_at_once_in_their_order():
    outbox = Outbox([NETWORK], commands_motion)
    sent = [value(), timesync(), text(), setpoint(), acknowledgement()]
    for message in sent:
        outbox.send(NETWORK, message)
    outbox.send_heartbeat_if_due(1.0, SystemStatus.ACTIVE, 0)
    names = [message.get_type() for _, message in outbox.take(1.0)]
    assert names == ["HEARTBEAT", *[message.get_type() for message in sent]]


def test_on_a_slow_line_values_leave_one_by_one_beside_the_setpoints():
    sender = Sender(SLOW)
    sender.cycle()
    sent = [sender.cycle(*(value() for _ in range(7))), *(sender.cycle() for _ in range(9))]
    assert all(names[0] == "SET_POSITION_TARGET_LOCAL_NED" for names in sent)
    assert max(names.count("NAMED_VALUE_FLOAT") for names in sent) == 1
    assert sum(names.count("NAMED_VALUE_FLOAT") for names in sent) == 7


def test_on_a_fast_line_the_same_values_leave_in_one_cycle():
    sender = Sender(FAST)
    assert sender.cycle(*(value() for _ in range(7))).count("NAMED_VALUE_FLOAT") == 7


def test_clock_messages_pass_others_and_heartbeats_and_answers_wait_for_nothing():
    sender = Sender(SLOW)
    names = sender.cycle(text(), text(), value(), timesync(), acknowledgement())
    assert names[1:] == ["HEARTBEAT", "COMMAND_ACK"]
    later = [name for _ in range(10) for name in sender.cycle(setpoints=False)]
    assert later == ["TIMESYNC", "STATUSTEXT", "STATUSTEXT", "NAMED_VALUE_FLOAT"]


def test_of_more_than_a_line_carries_the_oldest_are_dropped():
    sender = Sender(SLOW)
    sender.cycle(*(value(float(number)) for number in range(1000)))
    sender.outbox.send(SLOW, text())
    names = [name for _ in range(600) for name in sender.cycle()]
    assert 0 < names.count("NAMED_VALUE_FLOAT") <= 200
    assert "STATUSTEXT" in names


def test_a_backlog_on_a_line_drops_nothing_that_is_prompt_and_nothing_of_another_link():
    outbox = Outbox([SLOW, NETWORK], commands_motion)
    for number in range(1000):
        outbox.send(SLOW, value(float(number)))
    outbox.sent(SLOW, 10_000, 1.0)  # the line is busy for 1.7 s
    for link in (SLOW, NETWORK):
        outbox.send(link, acknowledgement())
    outbox.send(SLOW, setpoint())
    outbox.send(NETWORK, text())
    outbox.send_heartbeat_if_due(1.0, SystemStatus.ACTIVE, 0)
    left = {(link, message.get_type()) for link, message in outbox.take(1.0)}
    assert left == {
        *((link, name) for link in (SLOW, NETWORK) for name in ("HEARTBEAT", "COMMAND_ACK")),
        (SLOW, "SET_POSITION_TARGET_LOCAL_NED"),
        (NETWORK, "STATUSTEXT"),
    }
    outbox.sent(SLOW, 0, 5.0)
    later = [message.value for _, message in outbox.take(5.0)]
    assert later == [float(number) for number in range(800, 1000)]


def test_clock_messages_outlast_a_backlog_of_others():
    outbox = Outbox([SLOW], commands_motion)
    outbox.send(SLOW, timesync())
    for _ in range(1000):
        outbox.send(SLOW, value())
    outbox.sent(SLOW, 10_000, 1.0)
    outbox.send_heartbeat_if_due(1.0, SystemStatus.ACTIVE, 0)
    list(outbox.take(1.0))
    assert next(outbox.take(5.0))[1].get_type() == "TIMESYNC"


def test_a_line_is_behind_while_more_waits_for_it_than_a_cycle_sends():
    outbox = Outbox([SLOW, NETWORK], commands_motion)
    outbox.send_heartbeat_if_due(1.0, SystemStatus.ACTIVE, 0)
    list(outbox.take(1.0))
    outbox.sent(SLOW, 10_000, 1.0)
    for _ in range(9):
        outbox.send_to_all(value())
    assert (outbox.is_behind(SLOW), outbox.is_behind(NETWORK)) == (True, False)
    assert len(list(outbox.take(5.0))) == 18
    assert not outbox.is_behind(SLOW)


MESSAGES = {"text": text, "value": value, "clock": timesync}


@given(
    st.lists(st.lists(st.sampled_from(list(MESSAGES)), max_size=6), min_size=5, max_size=30),
    st.sampled_from([(57600, 0.0108), (115200, 0.0), (921600, 0.0)]),
)
def test_a_setpoint_waits_for_the_packet_on_its_way_alone(cycles, line):
    """At 57600 baud 90 bytes with room, a text of 66 and a heartbeat of 21, less a cycle."""
    baud, longest_s = line
    sender = Sender(f"serial:/dev/ttyS0:{baud}")
    for names in cycles:
        sender.cycle(*(MESSAGES[name]() for name in names))
    assert max(sender.waits_s) <= longest_s
