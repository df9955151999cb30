"""Messages that wait to be sent on the companion's links, its heartbeat first. No I/O.

Bytes that a serial port was given cannot be overtaken: at 57600 baud seven values to plot would
delay the next setpoint by 36 ms. So on a serial line a message waits here until the line has
nothing else to carry but the cycle's setpoint. A setpoint then waits for one other packet at most.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator

from .dialect import Message, mavlink
from .identity import Autopilot
from .translate_outgoing import SystemStatus, command_message, heartbeat_message
from .urls import line_bytes_per_s

_HEARTBEAT_PERIOD_S = 1.0
_PROMPT_IDS = frozenset(
    {mavlink.MAVLINK_MSG_ID_HEARTBEAT, mavlink.MAVLINK_MSG_ID_COMMAND_ACK},
)
"""Messages that never wait, short and rare."""
_CLOCK_ID = int(mavlink.MAVLINK_MSG_ID_TIMESYNC)
"""Message that waits for no other but those: it measures the delay of the link."""
_AHEAD_BYTES = 90
"""Bytes on their way with which a line has room: a signed setpoint has 78."""
_AHEAD_S = 0.01
"""The same in time, for fast lines: half a cycle at 50 Hz."""
_MOST_WAITING = 200
"""Limit of messages that wait for a line; beyond it the oldest are dropped."""
_BEHIND = 8
"""Messages that wait for a line which is behind: a text of 50 characters is one, a cycle's others
are fewer."""


class _Line:
    """Serial line, which carries what it was given at its own rate."""

    def __init__(self, bytes_per_s: float) -> None:
        self._bytes_per_s = bytes_per_s
        self._ahead_s = max(_AHEAD_S, _AHEAD_BYTES / bytes_per_s)
        self._idle_s = 0.0
        """Time at which the line will have carried all of it."""

    def spend(self, size_bytes: int, now_s: float) -> None:
        self._idle_s = max(self._idle_s, now_s) + size_bytes / self._bytes_per_s

    def has_room(self, now_s: float) -> bool:
        return self._idle_s - now_s <= self._ahead_s


class Outbox:
    """Queue of messages in the order of sending, and a heartbeat at 1 Hz on every link.

    commands_motion: True for a message that commands motion; these never wait.
    """

    def __init__(self, links: Iterable[str], commands_motion: Callable[[Message], bool]) -> None:
        self._links = tuple(links)
        self._commands_motion = commands_motion
        self._waiting: list[tuple[str, Message]] = []
        rates = {link: line_bytes_per_s(link) for link in self._links}
        self._lines = {link: _Line(rate) for link, rate in rates.items() if rate is not None}
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

    def take_control(self) -> Iterator[tuple[str, Message]]:
        """Removes and yields the messages that command motion, with their links."""
        return self._take(lambda _, message: self._commands_motion(message))

    def take(self, now_s: float) -> Iterator[tuple[str, Message]]:
        """Removes and yields the messages that may be sent now, with their links.

        Each that is sent counts (`sent`) before the next is taken.
        """
        if self._lines:
            self._waiting.sort(key=self._order)
        yield from self._take(lambda link, message: self._may_leave(link, message, now_s))
        if len(self._waiting) > _MOST_WAITING:
            self._drop_oldest()

    def is_behind(self, link: str) -> bool:
        """Returns True if so much waits for a line that nothing should be added without need."""
        waiting = sum(name == link for name, _ in self._waiting)
        return link in self._lines and waiting > _BEHIND

    def sent(self, link: str, size_bytes: int, now_s: float) -> None:
        """Notes the size of a packet that was sent on a link."""
        if link in self._lines:
            self._lines[link].spend(size_bytes, now_s)

    def _take(self, wanted: Callable[[str, Message], bool]) -> Iterator[tuple[str, Message]]:
        """Yields nothing before a heartbeat: autopilots route to known components alone."""
        if self._heartbeat_due_s is None:
            return
        waiting, self._waiting = self._waiting, []
        for item in waiting:
            if wanted(*item):
                yield item
            else:
                self._waiting.append(item)

    def _drop_oldest(self) -> None:
        """Keeps the latest that wait for each line; clock messages and others count apart."""
        kept, counts = [], Counter[tuple[str, int]]()
        for item in reversed(self._waiting):
            order = self._order(item)
            counts[item[0], order] += 1
            if order == 0 or counts[item[0], order] <= _MOST_WAITING:
                kept.append(item)
        self._waiting = kept[::-1]

    def _order(self, item: tuple[str, Message]) -> int:
        """0 for what leaves at once, 1 for clock messages, 2 for the others."""
        link, message = item
        if link not in self._lines or self._is_prompt(message):
            return 0
        return 1 if message.get_msgId() == _CLOCK_ID else 2

    def _may_leave(self, link: str, message: Message, now_s: float) -> bool:
        line = self._lines.get(link)
        return line is None or self._is_prompt(message) or line.has_room(now_s)

    def _is_prompt(self, message: Message) -> bool:
        return message.get_msgId() in _PROMPT_IDS or self._commands_motion(message)
