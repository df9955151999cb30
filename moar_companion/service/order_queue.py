"""Orders that arrive outside MAVLink, between the thread or process that checks them and the loop.

The control loop has them as packets of a link, judged as those of a ground station, and answers on
the same link.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from ..mavlink.order_link import OrderAnswer, OrderLink
from ..mavlink.peers import Address

_MOST_WAITING = 8
"""Maximum number of orders for the next cycle: more than an operator gives in 20 ms."""


class OrderQueue:
    """A link of the control loop; `give` may be called in another thread."""

    def __init__(self, component_id: int) -> None:
        self._link = OrderLink(component_id)
        self._waiting: deque[tuple[str, str, int | None]] = deque()
        self._packets: list[bytes] = []

    def give(self, order_id: str, word: str, target: int | None) -> bool:
        """Takes an order for the next cycle; False if too many wait. word: as in `OrderLink`."""
        if len(self._waiting) >= _MOST_WAITING:
            return False
        self._waiting.append((order_id, word, target))
        return True

    def take(self) -> list[bytes]:
        """Packets of the orders since the last call."""
        packets = []
        while self._waiting:
            packets.append(self._link.packet(*self._waiting.popleft()))
        return packets

    def send(self, data: bytes, _longest_wait_s: float, _peers: Sequence[Address]) -> None:
        """Takes a packet of the companion, as a link does."""
        self._packets.append(data)

    def answers(self) -> list[OrderAnswer]:
        """Answers in the packets since the last call."""
        packets, self._packets = self._packets, []
        return self._link.answers(packets)
