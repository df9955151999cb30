"""What arrived on the links, down to what one cycle has time to read. Pure.

Inputs: datagrams and portions of streams, whose they are, the time. Outputs: those to read, and
texts about those dropped. All that comes from the autopilot's address, or on a stream (serial,
TCP), is read. All other addresses share one budget: whoever reaches a port may send there without
end. After a pause it is larger: an operator's order may wait behind what has arrived meanwhile.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from operator import itemgetter

from ..mavlink.peers import Address, Precedence

Arrival = tuple[float, str, bytes, Address | None]
"""When it arrived in seconds, its link, its bytes, and on a listening link who sent it."""

BUDGET_BYTES = 2048
"""A cycle's for all addresses but the autopilot's. A byte that looks like the beginning of a packet
costs up to 2.3 us (0xFE: a checksum of 254 bytes), so this is 5 ms of the 50 ms of a cycle. Ground
stations send some 100 bytes in a cycle."""
RATE_BYTES_PS = 64_000
"""A longer cycle's, or a pause's, by the second: a thousand small datagrams. A flood of so many
bytes takes 15 % of the time."""
LONGEST_S = 0.5
"""Of a pause no more counts: 32 kB take 74 ms to read, and after 100 ms a thought is too late."""
LEAST_BYTES = 64
"""A datagram counts for no less: it has costs of its own."""
_PERIOD_S = 30.0
"""Between two texts."""


class Intake:
    """Drops what is beyond the budget, and counts it."""

    def __init__(self) -> None:
        self.dropped: Counter[str] = Counter()
        """Datagrams by link, since the last text."""
        self._told_s = -math.inf
        self._read_s = math.inf
        """When the last cycle read; infinite before the first one."""

    def selected(
        self,
        arrived: Sequence[Arrival],
        precedence: Callable[[str, Address | None], Precedence],
        now_s: float,
    ) -> list[Arrival]:
        """What is to be read in this cycle, in the order of arrival.

        Peers come before strangers, and of each an address that has sent little before one that
        has sent much: who floods a link takes nothing from the others.
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
        """What is to be told now, of all links in one text: `812 datagrams too many (udp:...)`."""
        if not self.dropped or now_s - self._told_s < _PERIOD_S:
            return []
        count, links = sum(self.dropped.values()), ", ".join(sorted(self.dropped))
        self.dropped.clear()
        self._told_s = now_s
        return [f"{count} datagram{'' if count == 1 else 's'} too many ({links})"]


def _cost_bytes(data: bytes) -> int:
    return max(len(data), LEAST_BYTES)
