"""What waits to be sent on our links, with our heartbeat before all else. No I/O."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from .dialect import Message
from .translate_outgoing import SystemStatus, heartbeat_message

_HEARTBEAT_PERIOD_S = 1.0


class Outbox:
    """Messages in the order in which they are sent, and a heartbeat a second on every link."""

    def __init__(self, links: Iterable[str]) -> None:
        self._links = tuple(links)
        self._waiting: list[tuple[str, Message]] = []
        self._heartbeat_due_s: float | None = None

    def send(self, link: str, message: Message) -> None:
        """On one link."""
        self._waiting.append((link, message))

    def send_to_all(self, message: Message) -> None:
        """On every link."""
        self._waiting += [(link, message) for link in self._links]

    def send_heartbeat_if_due(
        self, now_s: float, system_status: SystemStatus, custom_mode: int
    ) -> None:
        """On every link, before what waits already; what was missed is not made up for."""
        due_s = self._heartbeat_due_s
        if due_s is not None and now_s < due_s:
            return
        heartbeat = heartbeat_message(system_status, custom_mode)
        self._waiting[:0] = [(link, heartbeat) for link in self._links]
        late = due_s is None or now_s - due_s >= _HEARTBEAT_PERIOD_S
        self._heartbeat_due_s = (now_s if late or due_s is None else due_s) + _HEARTBEAT_PERIOD_S

    def hurry_heartbeat(self, now_s: float) -> None:
        """Makes the next heartbeat due at once."""
        if self._heartbeat_due_s is not None:
            self._heartbeat_due_s = now_s

    def take(self, wanted: Callable[[Message], bool] = lambda _: True) -> list[tuple[str, Message]]:
        """What waits and is wanted, with its link; nothing before the first heartbeat.

        Both autopilots route to a component only what follows its first packet.
        """
        if self._heartbeat_due_s is None:
            return []
        taken = [item for item in self._waiting if wanted(item[1])]
        self._waiting = [item for item in self._waiting if not wanted(item[1])]
        return taken
