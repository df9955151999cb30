"""The demonstration's operator: the text that it shows with a refusal is about that answer."""

from __future__ import annotations

import contextlib
import socket
import threading

import pytest
from pymavlink.dialects.v20 import all as mavlink

from sitl.demonstration.manners import MANNERS
from sitl.demonstration.operator import Operator, OperatorError
from sitl.demonstration.processes import free_ports

RELEASED = "MOAR: control loop stalled 3.0 s, released"
NOTHING = "MOAR: nothing is held, rejected"


@contextlib.contextmanager
def operator_of(answers):
    """An operator that has received a text, of a companion that answers a command so."""
    (port,) = free_ports(1)
    operator = Operator(port, MANNERS["px4"], speed=1.0, meanwhile=lambda: None)
    companion = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    companion.settimeout(10.0)
    codec = mavlink.MAVLink(None, srcSystem=1, srcComponent=195)

    def send(message):
        companion.sendto(message.pack(codec), ("127.0.0.1", port))

    def answer():
        while True:
            for message in codec.parse_buffer(companion.recv(65536)) or []:
                if message.get_type() == "COMMAND_LONG":
                    for each in answers:
                        send(each)
                    return

    thread = threading.Thread(target=answer)
    try:
        send(mavlink.MAVLink_statustext_message(4, RELEASED.encode()))
        operator.wait_for("the text", lambda: operator.texts, 5.0)
        thread.start()
        yield operator
        thread.join()
    finally:
        operator.close()
        companion.close()


def acknowledged(command):
    return mavlink.MAVLink_command_ack_message(command, mavlink.MAV_RESULT_TEMPORARILY_REJECTED)


def test_a_refusal_is_shown_with_the_text_that_follows_it_and_not_with_an_older_one():
    reason = mavlink.MAVLink_statustext_message(4, NOTHING.encode())
    with (
        operator_of([acknowledged(193), reason]) as operator,
        pytest.raises(OperatorError) as refused,
    ):
        operator.command("continue", 193, 1, component=195)
    assert str(refused.value) == f"continue: TEMPORARILY_REJECTED ({NOTHING})"


def test_a_refusal_of_the_autopilot_is_shown_without_a_text_of_the_companion():
    with operator_of([acknowledged(176)]) as operator, pytest.raises(OperatorError) as refused:
        operator.command("OFFBOARD", 176, 1, 6)
    assert str(refused.value) == "OFFBOARD: TEMPORARILY_REJECTED"


@pytest.mark.parametrize(
    ("rate", "stalled_s", "late"),
    [(1.0, 0.0, False), (0.987, 0.0, False), (1.0, 6.0, True), (0.95, 0.0, True)],
    ids=["as ours", "PX4's simulator", "stalled once", "too slow a machine"],
)
def test_a_clock_that_is_a_little_slow_is_no_delay_of_the_simulator(
    monkeypatch, rate, stalled_s, late
):
    (port,) = free_ports(1)
    operator = Operator(port, MANNERS["px4"], speed=1.0, meanwhile=lambda: None)
    codec = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    try:
        for now_s, boot_s in ((1000.0, 30.0), (1200.0 + stalled_s, 30.0 + 200.0 * rate)):
            monkeypatch.setattr(operator, "_now_s", lambda now_s=now_s: now_s)
            zeros = (0,) * 8
            position = mavlink.MAVLink_global_position_int_message(round(1e3 * boot_s), *zeros)
            position.pack(codec)
            operator._take(position)
        assert (operator.lag_s > 2.0) is late
    finally:
        operator.close()
