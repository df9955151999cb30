"""Messages that the companion publishes, and their intervals on each link. No I/O.

In: the contents, as functions of the time; intervals that ground stations set. Out: messages that
are due. An interval is kept by link, as both autopilots do, and until the process ends.

A message whose packet takes a serial line longer than one cycle is not sent there, since a setpoint
behind it would come a cycle late. Values to plot come twice a second, on a slow line once.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from ...settings.link_config import LinkRole
from ..dialect import Message, id_of, mavlink
from .link_budget import OVERHEAD_BYTES, LinkBudget, size_bytes

Content = Callable[[float], list[Message]]
"""Messages of one kind now, by the time in seconds; none while nothing is known."""

_SLOW_BYTES_PER_S = 4_000.0
"""Budget below which a line counts as slow: that of 160,000 baud."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Published:
    """One kind of message that is published."""

    name: str
    """Its name in MAVLink."""
    about: str
    period_s: float | None
    """Default interval; None: on request only."""
    slow_period_s: float | None = None
    """Default interval on a slow line; None: as on others."""
    shortest_s: float = 1.0
    """Shortest interval that can be set."""
    settable: bool = True
    """False where the interval is fixed."""
    to_autopilot: bool = True
    """False where it is not sent on a link to the autopilot, which would act on it."""
    asked_of_all: bool = True
    """False where a request to all components means the autopilot's own."""


PUBLISHED: Mapping[str, Published] = {
    row.name: row
    for row in (
        Published(
            name="HEARTBEAT",
            about="STANDBY: no setpoints are sent; ACTIVE: they are; CRITICAL: a condition holds "
            "the flight, or ends it by an escape; EMERGENCY: a condition has released the aircraft "
            "in the air, until a pilot takes the mode or an operator orders a release, or it "
            "leaves a place where it would hit something; custom_mode: the mission state",
            period_s=1.0,
            settable=False,
            asked_of_all=False,
        ),
        Published(
            name="NAMED_VALUE_FLOAT",
            about="risk indices, weights, reserve, distances",
            period_s=0.5,
            slow_period_s=1.0,
            shortest_s=0.5,
        ),
        Published(
            name="NAMED_VALUE_INT",
            about="mission state, target, condition",
            period_s=0.5,
            slow_period_s=1.0,
            shortest_s=0.5,
        ),
        Published(
            name="TRAJECTORY_REPRESENTATION_WAYPOINTS",
            about="the next five corners of the path, in the autopilot's local NED frame; on "
            "links of operators alone, since PX4 before v1.16 can be set to follow it",
            period_s=1.0,
            to_autopilot=False,
        ),
        Published(
            name="ONBOARD_COMPUTER_STATUS",
            about="free memory and disk of the computer",
            period_s=1.0,
        ),
        Published(
            name="AUTOPILOT_VERSION",
            about="capabilities of the component, version of the program",
            period_s=None,
            asked_of_all=False,
        ),
        Published(
            name="PROTOCOL_VERSION",
            about="MAVLink 2 alone is sent, both are read",
            period_s=None,
            asked_of_all=False,
        ),
        Published(
            name="COMPONENT_METADATA",
            about="place and checksum of the files that describe parameters and orders",
            period_s=None,
        ),
        Published(
            name="COMPONENT_INFORMATION",
            about="the same for older ground stations",
            period_s=None,
        ),
    )
}
"""All of them, by name."""

_BY_ID = {id_of(name): row for name, row in PUBLISHED.items()}


def published(message_id: int) -> Published | None:
    """The row of a message; None if the companion does not publish it."""
    return _BY_ID.get(message_id)


class _Stream:
    """One kind of message on one link: its interval, and what of it waits to be sent.

    Of a kind of several messages an interval may end before all are sent. Then the next begins with
    the first that was not, so that each comes in turn.
    """

    def __init__(self, default_s: float | None, *, possible: bool) -> None:
        self.default_s = default_s
        self.interval_s = default_s
        """None: switched off."""
        self.possible = possible
        """False where it is never repeated on this link."""
        self.due_s = -math.inf
        self._waiting: deque[Message] = deque()
        self._sent = 0
        """Place in the last content up to which it was sent."""

    def set_interval(self, interval_s: float | None) -> None:
        """Begins an interval at once; None switches it off."""
        self.interval_s, self.due_s = interval_s, -math.inf
        self._waiting.clear()

    def is_behind(self, now_s: float) -> bool:
        """Returns True if an interval has ended before all of its messages were sent."""
        return bool(self._waiting) and now_s >= self.due_s

    def next_due(self, content: Content, now_s: float) -> Message | None:
        """Next message; None: none is due."""
        self._begin_if_due(content, now_s)
        if not self._waiting:
            return None
        self._sent += 1
        return self._waiting.popleft()

    def _begin_if_due(self, content: Content, now_s: float) -> None:
        """Makes the messages of the next interval; while there is none it does not begin."""
        if self.interval_s is None or now_s < self.due_s:
            return
        first = self._sent if self._waiting else 0
        self._waiting = deque(content(now_s))
        if self._waiting:
            self._sent = first % len(self._waiting)
            self._waiting.rotate(-self._sent)
            late = now_s - self.due_s >= self.interval_s
            self.due_s = (now_s if late else self.due_s) + self.interval_s


class PublishedMessages:
    """Contents of the published messages, and their streams on all links."""

    def __init__(self, links: Mapping[str, LinkRole], budgets: Mapping[str, LinkBudget]) -> None:
        self._links, self._budgets = links, budgets
        self._contents: dict[str, Content] = {}
        self._streams = {
            (link, row.name): self._stream(link, row)
            for link in links
            for row in PUBLISHED.values()
            if row.settable
        }
        self._names = {link: [name for on, name in self._streams if on == link] for link in links}
        """Kinds of messages by link, in the order of sending."""

    def _stream(self, link: str, row: Published) -> _Stream:
        budget = self._budgets[link]
        size = mavlink.mavlink_map[id_of(row.name)].unpacker.size + OVERHEAD_BYTES
        possible = size <= budget.largest_bytes and self._is_allowed(link, row)
        slow = budget.bytes_per_s < _SLOW_BYTES_PER_S and row.slow_period_s is not None
        default_s = row.slow_period_s if slow else row.period_s
        return _Stream(default_s if possible else None, possible=possible)

    def _is_allowed(self, link: str, row: Published) -> bool:
        return row.to_autopilot or self._links[link] is LinkRole.OPERATOR

    def offer(self, name: str, content: Content) -> None:
        """Takes the content of a message from now on."""
        self._contents[name] = content

    def requested(self, link: str, row: Published, now_s: float) -> list[Message] | None:
        """The messages of one kind now; None where they are not sent on this link."""
        content = self._contents.get(row.name)
        messages = [] if content is None else content(now_s)
        most_bytes = self._budgets[link].largest_bytes
        fit = all(size_bytes(message) <= most_bytes for message in messages)
        return messages if fit and self._is_allowed(link, row) else None

    def interval_s(self, link: str, name: str) -> float | None:
        """Interval of a message on a link; None: it is switched off."""
        row = PUBLISHED[name]
        return self._streams[link, name].interval_s if row.settable else row.period_s

    def set_interval(self, link: str, name: str, interval_s: float | None) -> bool:
        """Sets an interval, at least its shortest; returns False for a message never repeated here.

        interval_s: 0 for the default, None to switch it off.
        """
        stream = self._streams.get((link, name))
        if stream is None or not stream.possible:
            return False
        if interval_s == 0.0:
            interval_s = stream.default_s
        elif interval_s is not None:
            interval_s = max(interval_s, PUBLISHED[name].shortest_s)
        stream.set_interval(interval_s)
        return True

    def next_due(self, link: str, now_s: float) -> Message | None:
        """Next message that is due on a link; None: none is due.

        A kind whose interval ended before all of it was sent comes after the other kinds.
        """
        names = self._names[link]
        names.sort(key=lambda name: self._streams[link, name].is_behind(now_s))
        for name in names:
            content, stream = self._contents.get(name), self._streams[link, name]
            if content is None or not stream.possible:
                continue
            message = stream.next_due(content, now_s)
            if message is not None:
                return message
        return None
