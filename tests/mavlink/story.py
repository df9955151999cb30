"""A session on an autopilot link and an operator link, whose clock is moved."""

from __future__ import annotations

from moar_companion.mavlink.codec import Codec
from moar_companion.mavlink.session import Session, SystemStatus
from moar_companion.settings.link_config import LinkRole


class Story:
    """A session with its received and sent packets."""

    def __init__(self, **options):
        self.session = Session(
            links={"serial": LinkRole.AUTOPILOT, "network": LinkRole.OPERATOR}, **options
        )
        self.now_s = 100.0
        self._readers = {name: Codec(system_id=9, component_id=9) for name in ("serial", "network")}

    def handle(self, data, *, link="serial"):
        self.session.receive(link, data, self.now_s)

    def tick(self, status=SystemStatus.ACTIVE):
        self.session.tick(self.now_s, status)

    def sent(self):
        """Everything sent since the last call, as (link, message)."""
        return [
            (link, message)
            for link, data in self.session.data_to_send()
            for message in self._readers[link].receive(data)
        ]

    def run(self, duration_s):
        """Cycles at 50 Hz for a while; returns what is sent, with its time."""
        sent = []
        for _ in range(round(duration_s * 50)):
            self.now_s += 0.02
            self.tick()
            sent += [(self.now_s, link, message) for link, message in self.sent()]
        return sent

    def events(self):
        return self.session.events_received()

    def meet(self, sender, **options):
        self.tick()
        self.handle(sender.heartbeat(**options))
        self.sent()
        self.events()


def types(sent):
    return [message.get_type() for *_, message in sent]


def of_type(sent, name):
    return [message for *_, message in sent if message.get_type() == name]


def commands(sent, number):
    return [m for m in of_type(sent, "COMMAND_LONG") if m.command == number]
