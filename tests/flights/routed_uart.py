"""A flight in lockstep with one UART, which a router shares between companion and ground station.

The router has the rules of mavlink-router (`Endpoint::accept_msg`): a packet goes to every endpoint
on which its target was received, without a target to all, and never to one on which its sender was
received. `tests/peers/test_mavlink_router.py` flies with the real one.
"""

from __future__ import annotations

from collections import Counter

from pymavlink.dialects.v20 import all as mavlink

from sitl.wire import packet_header, packets

from ..packets import decoded
from .aircraft import STEP_S
from .lockstep import Lockstep

_TARGETED_IDS = {
    message_id
    for message_id, kind in mavlink.mavlink_map.items()
    if "target_system" in kind.fieldnames
}
UART, COMPANION, GROUND = "uart", "companion", "ground"


class Router:
    """Endpoints, and the ids that each has received."""

    def __init__(self):
        self._ids = {UART: set(), COMPANION: set(), GROUND: set()}
        self.delivered = Counter()
        """Packets by endpoint, message id and sender."""

    def route(self, source, packet):
        """Names of the endpoints to which a packet from an endpoint goes."""
        message_id, *ids = packet_header(packet)
        sender = tuple(ids)
        self._ids[source].add(sender)
        target = (0, 0)
        if message_id in _TARGETED_IDS:
            message = decoded(packet)
            target = message.target_system, getattr(message, "target_component", 0)
        accepting = [
            name
            for name, known in self._ids.items()
            if sender not in known and self._has(known, *target)
        ]
        self.delivered.update((name, message_id, sender) for name in accepting)
        return accepting

    def _has(self, known, system_id, component_id):
        if system_id == 0:
            return True
        if component_id == 0:
            return any(system_id == system for system, _ in known)
        return (system_id, component_id) in known


class _Port:
    """The autopilot as the ground station reaches it: by the router."""

    def __init__(self, flight):
        self._flight = flight

    def __getattr__(self, name):
        return getattr(self._flight.autopilot, name)

    def receive(self, _link, data):
        self._flight.carry(GROUND, data)


class RoutedUart(Lockstep):
    """The autopilot's companion port is its only one."""

    def __init__(self, **options):
        super().__init__(**options)
        self.router = Router()
        self._for_companion = []

    def start_in_the_air(self, height_m=3.0):
        super().start_in_the_air(height_m)
        self.operator.silent = False
        self.operator.autopilot = _Port(self)
        self.run(1.2)  # until the router has received each of them

    def carry(self, source, data):
        """Carries packets from an endpoint to those that get them."""
        for packet in packets(data):
            for name in self.router.route(source, packet):
                if name == UART:
                    self.autopilot.receive("companion", packet)
                elif name == GROUND:
                    self.operator.receive(packet)
                else:
                    self._for_companion.append(packet)

    def move(self):
        if self.operator.autopilot is self.autopilot:
            return super().move()
        self.now_s += STEP_S
        self.operator.tick(self.now_s)
        self.autopilot.step(self.now_s)
        for link, data in self.autopilot.data_to_send():
            if link == "companion":
                self.carry(UART, data)
        received, self._for_companion = self._for_companion, []
        return received

    def report(self, data):
        if self.operator.autopilot is self.autopilot:
            super().report(data)
        else:
            self.carry(COMPANION, data)
