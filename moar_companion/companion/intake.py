"""Selection of received data, limited to the reading time of one cycle. Pure.

Inputs: datagrams and portions of streams, their senders, the time. Outputs: data to read, and texts
about dropped data. All data from the autopilot's address, or on a stream (serial, TCP), is read.
All other addresses share one budget: any sender that reaches a port may flood it. The budget is
larger after a pause, because an operator's order may wait behind all that arrived meanwhile.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from operator import itemgetter

from ..mavlink.peers import Address, Precedence
from ..texts import service_texts
from ..texts.text_format import plural

Arrival = tuple[float, str, bytes, Address | None]
"""Arrival time in seconds, link, bytes, and on a listening link the sender."""

BUDGET_BYTES = 2048
"""Budget of a cycle for all addresses except the autopilot's: 5 ms of the 20 ms of a cycle at the
default rate. A byte that can begin a packet costs up to 2.3 us (0xFE: a checksum of 254 bytes).
Ground stations send some 100 bytes in a cycle."""
RATE_BYTES_PS = 64_000
"""Budget of a longer cycle or a pause, per second: a thousand small datagrams. A flood at this rate
takes 15 % of the time."""
LONGEST_S = 0.5
"""Maximum pause that counts: 32 kB take 74 ms to read, and a cycle is too late after 100 ms."""
LEAST_BYTES = 64
"""Minimum cost of a datagram, which has an overhead."""
_PERIOD_S = 30.0
"""Minimum time between two texts."""


class Intake:
    """Drops and counts data beyond the budget."""

    def __init__(self) -> None:
        self.dropped: Counter[str] = Counter()
        """Dropped datagrams by link, since the last text."""
        self._reported_s = -math.inf
        self._read_s = math.inf
        """Time of the last cycle that read; infinite before the first one."""

    def selected(
        self,
        arrived: Sequence[Arrival],
        precedence: Callable[[str, Address | None], Precedence],
        now_s: float,
    ) -> list[Arrival]:
        """Returns the data to read in this cycle, in the order of arrival.

        Peers have precedence over unknown senders; within each, addresses that have sent less come
        first. A flooding sender therefore takes nothing from the others.
        """
        kept: list[Arrival] = []
        others: list[tuple[Precedence, tuple[str, Address | None], Arrival]] = []
        sent_bytes: Counter[tuple[str, Address | None]] = Counter()
        for item in sorted(arrived, key=itemgetter(0)):
            _, link, data, address = item
            rank = precedence(link, address)
            if rank is Precedence.AUTOPILOT:
                kept.append(item)
            else:
                others.append((rank, (link, address), item))
                sent_bytes[link, address] += _cost_bytes(data)
        others.sort(key=lambda other: (other[0], sent_bytes[other[1]]))
        left_bytes = self._budget_bytes(now_s)
        for _, (link, _), item in others:
            cost_bytes = _cost_bytes(item[2])
            if cost_bytes <= left_bytes:
                left_bytes -= cost_bytes
                kept.append(item)
            else:
                self.dropped[link] += 1
        kept.sort(key=itemgetter(0))
        return kept

    def _budget_bytes(self, now_s: float) -> float:
        """The budget of a cycle, which grows with the time since the last one."""
        since_s, self._read_s = now_s - self._read_s, now_s
        return max(BUDGET_BYTES, RATE_BYTES_PS * min(since_s, LONGEST_S))

    def texts(self, now_s: float) -> list[str]:
        """Texts to report now, all links in one: `812 datagrams too many (udp:...)`."""
        if not self.dropped or now_s - self._reported_s < _PERIOD_S:
            return []
        count, links = sum(self.dropped.values()), ", ".join(sorted(self.dropped))
        self.dropped.clear()
        self._reported_s = now_s
        return [
            service_texts.DATAGRAMS_DROPPED(large_count=count, plural=plural(count), detail=links)
        ]


def _cost_bytes(data: bytes) -> int:
    return max(len(data), LEAST_BYTES)
