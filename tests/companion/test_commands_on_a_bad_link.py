"""Orders over a link that loses three packets in ten, takes 0.3 to 0.6 s, doubles and reorders."""

from __future__ import annotations

import random

import pytest

from tests.thorough import sampled

from .commands import LINKS, OPERATOR_LINK, carried_out
from .desk import (
    ACCEPTED,
    EVACUATION,
    EXIT,
    IN_PROGRESS,
    INSPECTION,
    PAUSE_CONTINUE,
    STEP_S,
    USER_1,
    Desk,
)

LOSS, DOUBLED = 0.3, 0.2
DELAY_S, JITTER_S = 0.3, 0.3
RETRY_S, TRIES = 1.0, 12
ORDERS = (
    (USER_1, INSPECTION, 0),
    (USER_1, EXIT, -1),
    (USER_1, INSPECTION, 1),
    (USER_1, EVACUATION, -1),
    (PAUSE_CONTINUE, 0),
)
CARRIED_OUT = ["inspection", "exit", "inspection", "evacuation"]


class BadLink:
    """One direction of a link: each packet is lost, or arrives once or twice, in any order."""

    def __init__(self, seed):
        self._random = random.Random(seed)
        self._under_way = []

    def send(self, packet, now_s):
        if self._random.random() < LOSS:
            return
        for _ in range(2 if self._random.random() < DOUBLED else 1):
            due_s = now_s + DELAY_S + self._random.uniform(0.0, JITTER_S)
            self._under_way.append((due_s, packet))

    def arrived(self, now_s):
        arrived = sorted((item for item in self._under_way if item[0] <= now_s), key=lambda i: i[0])
        self._under_way = [item for item in self._under_way if item[0] > now_s]
        return [packet for _, packet in arrived]


class Station:
    """A ground station that repeats a command, with its confirmation, until the final answer."""

    def __init__(self, desk, seed):
        self.desk = desk
        self.up, self.down = BadLink(2 * seed), BadLink(2 * seed + 1)
        self._taken = len(desk.sent)
        self._results = []

    def order(self, command, *parameters):
        """Result of a command."""
        self._results.clear()
        for confirmation in range(TRIES):
            packet = self.desk.operator.command(command, *parameters, confirmation=confirmation)
            self.up.send(packet, self.desk.now_s)
            patience_s = self.desk.now_s + RETRY_S
            while self.desk.now_s < patience_s:
                self.step()
                for number, result in self._results:
                    if number == command and result != IN_PROGRESS:
                        return result
        raise AssertionError(f"no answer to {command} {parameters}: {self.desk.texts()}")

    def run(self, seconds):
        for _ in range(round(seconds / STEP_S)):
            self.step()

    def step(self):
        for packet in self.up.arrived(self.desk.now_s):
            self.desk.handle(packet, OPERATOR_LINK)
        self.desk.step()
        for time_s, link, message in self.desk.sent[self._taken :]:
            if link == OPERATOR_LINK and message.get_type() == "COMMAND_ACK":
                self.down.send((message.command, message.result), time_s)
        self._taken = len(self.desk.sent)
        self._results += self.down.arrived(self.desk.now_s)


@pytest.mark.slow
@pytest.mark.parametrize("seed", sampled(range(2), range(200)))
def test_every_order_is_carried_out_once_and_answered(seed):
    """A pause may be carried out again, since each of its copies stops.

    An answer names the command's number alone. So the operator waits until no copy is under way.
    """
    desk = Desk(links=LINKS).come_to("flying", then_s=2.1)
    desk.decisions.clear()
    station = Station(desk, seed)
    for order in ORDERS:
        assert station.order(*order) == ACCEPTED
        station.run(2.0 * (DELAY_S + JITTER_S))
    assert [words.split()[0] for words in carried_out(desk) if words != "hold"] == CARRIED_OUT
    assert desk.state == "holding"
