"""Messages that wait to be sent on the companion's links, its heartbeat first. No I/O."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from .dialect import Message
from .identity import Autopilot
from .translate_outgoing import SystemStatus, command_message, heartbeat_message

_HEARTBEAT_PERIOD_S = 1.0


class Outbox:
    """Queue of messages in the order of sending, and a heartbeat at 1 Hz on every link."""

    def __init__(self, links: Iterable[str]) -> None:
        self._links = tuple(links)
        self._waiting: list[tuple[str, Message]] = []
        self._heartbeat_due_s: float | None = None

    def send(self, link: str, message: Message) -> None:
        """Queues a message on one link."""
        self._waiting.append((link, message))

    def send_to_all(self, message: Message) -> None:
        """Queues a message on every link."""
        self._waiting += [(link, message) for link in self._links]

    def send_command(self, autopilot: Autopilot, command: int, *parameters: float) -> None:
        """Queues a COMMAND_LONG to the autopilot; parameters not given are 0."""
        message = command_message(target=autopilot.ids, command=command, parameters=parameters)
        self.send(autopilot.link, message)

    def send_heartbeat_if_due(
        self, now_s: float, system_status: SystemStatus, custom_mode: int
    ) -> None:
        """Queues a due heartbeat on every link, before all others; skips missed heartbeats."""
        due_s = self._heartbeat_due_s
        if due_s is not None and now_s < due_s:
            return
        heartbeat = heartbeat_message(system_status, custom_mode)
        self._waiting[:0] = [(link, heartbeat) for link in self._links]
        late = due_s is None or now_s - due_s >= _HEARTBEAT_PERIOD_S
        self._heartbeat_due_s = (now_s if late or due_s is None else due_s) + _HEARTBEAT_PERIOD_S

    def make_heartbeat_due(self, now_s: float) -> None:
        """Makes the next heartbeat due at once."""
        if self._heartbeat_due_s is not None:
            self._heartbeat_due_s = now_s

    def take(self, wanted: Callable[[Message], bool] = lambda _: True) -> list[tuple[str, Message]]:
        """Removes and returns the wanted messages with their links; none before a heartbeat.

        Both autopilots route to a component only after its first packet.
        """
        if self._heartbeat_due_s is None:
            return []
        taken = [item for item in self._waiting if wanted(item[1])]
        self._waiting = [item for item in self._waiting if not wanted(item[1])]
        return taken
