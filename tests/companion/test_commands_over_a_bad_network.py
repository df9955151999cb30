"""Commands over a network that loses 30 %, delays, doubles and reorders packets."""

from __future__ import annotations

import pytest

from moar_companion.mavlink.dialect import create, id_of

from ..mavlink.lossy_network import LossyNetwork
from ..mavlink.peer import Peer
from ..packets import Packet
from ..thorough import sampled
from .commands import LINKS, OPERATOR_LINK
from .desk import (
    ACCEPTED,
    CANCELLED,
    EXIT,
    IN_PROGRESS,
    INSPECTION,
    PAUSE_CONTINUE,
    STEP_S,
    USER_1,
    Desk,
)

GET_INTERVAL, SET_INTERVAL, REQUEST = 510, 511, 512
FLOAT, VERSION = id_of("NAMED_VALUE_FLOAT"), id_of("AUTOPILOT_VERSION")
REPEAT_S = 0.7
MOST_REPEATS = 20


class GroundStation:
    """Repeats a command, with its confirmation counted up, until its final answer arrives."""

    def __init__(self, desk, seed, delay_s=0.3):
        self.desk, self.peer, self.delay_s = desk, Peer(255, 190), delay_s
        self.up = LossyNetwork(f"up {seed}", delay_s=delay_s)
        self.down = LossyNetwork(f"down {seed}", delay_s=delay_s)
        self.received, self._sent = [], len(desk.sent)

    def run(self, seconds):
        for _ in range(round(seconds / STEP_S)):
            for packet in self.up.arrived(self.desk.now_s):
                self.desk.handle(packet, OPERATOR_LINK)
            self.desk.step()
            for _, link, message in self.desk.sent[self._sent :]:
                if link == OPERATOR_LINK:
                    self.down.send(bytes(message.get_msgbuf()), self.desk.now_s)
            self._sent = len(self.desk.sent)
            self.received += map(Packet, self.down.arrived(self.desk.now_s))

    def command(self, number, *parameters):
        """The final result of a command."""
        heard = len(self.received)
        for confirmation in range(MOST_REPEATS):
            data = self.peer.command(number, *parameters, confirmation=confirmation)
            self.up.send(data, self.desk.now_s)
            self.run(REPEAT_S)
            results = [
                message.result
                for message in self.received[heard:]
                if message.get_type() == "COMMAND_ACK" and message.command == number
            ]
            final = [result for result in results if result != IN_PROGRESS]
            if final:
                return final[-1]
        raise AssertionError(f"no answer to {number}")

    def order(self, number, *parameters):
        """Gives an order anew where its repeats came after a stop, which cancels them."""
        for _ in range(MOST_REPEATS):
            self.run(self.delay_s + 0.1)  # copies of the last answer have arrived
            result = self.command(number, *parameters)
            if result == ACCEPTED:
                return
            assert result == CANCELLED
        raise AssertionError(f"{number} is always cancelled")

    def messages(self, kind):
        return [message for message in self.received if message.get_type() == kind]


@pytest.mark.parametrize("delay_s", [0.3, pytest.param(2.0 * REPEAT_S, marks=pytest.mark.slow)])
@pytest.mark.parametrize("seed", sampled(range(1), range(200)))
def test_orders_are_answered_and_none_is_carried_out_twice(seed, delay_s):
    desk = Desk(links=LINKS).come_to("idle")
    station = GroundStation(desk, seed, delay_s)
    station.order(USER_1, INSPECTION, -1)
    desk.send_heartbeat(desk.ours)
    station.run(1.0)
    station.order(PAUSE_CONTINUE, 0)
    assert desk.state == "holding"
    station.order(PAUSE_CONTINUE, 1)
    station.order(USER_1, EXIT, 0)
    station.run(1.0)
    moved = [order["order"] for order in desk.decided("order") if order["order"] != "hold"]
    assert moved == ["inspection splice-outer splice-inner", "continue", "exit"]
    assert desk.companion.status.task.mission.value == "exit"


@pytest.mark.parametrize("seed", sampled(range(1), range(40)))
def test_requests_and_intervals_are_answered_and_take_effect_once(seed):
    desk = Desk(links=LINKS).come_to("idle")
    station = GroundStation(desk, seed)
    assert station.command(REQUEST, VERSION) == ACCEPTED
    assert station.command(SET_INTERVAL, FLOAT, 2e6) == ACCEPTED
    while not station.messages("MESSAGE_INTERVAL"):
        assert station.command(GET_INTERVAL, FLOAT) == ACCEPTED
    assert {message.interval_us for message in station.messages("MESSAGE_INTERVAL")} == {2_000_000}
    published = desk.companion.state.session.services.published
    assert published.interval_s(OPERATOR_LINK, "NAMED_VALUE_FLOAT") == 2.0


def test_an_order_that_is_cancelled_over_the_network_is_not_carried_out():
    desk = Desk(links=LINKS, plan_delay_s=None).come_to("idle")
    station = GroundStation(desk, "cancelled")
    ids = {"target_system": 1, "target_component": 195}
    station.up.send(station.peer.command(USER_1, INSPECTION, -1), desk.now_s)
    station.run(0.5)
    for _ in range(10):
        cancel = create("COMMAND_CANCEL", command=USER_1, **ids)
        station.up.send(station.peer.pack(cancel), desk.now_s)
        station.run(0.3)
    assert desk.state == "idle"
