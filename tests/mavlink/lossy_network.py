"""A network that loses, delays, doubles and reorders packets, in lockstep time."""

from __future__ import annotations

import heapq
from random import Random


class LossyNetwork:
    """One direction of a network.

    loss, doubled: probabilities of a packet. delay_s: greatest delay; each copy has its own, so
    that packets overtake each other.
    """

    def __init__(self, seed, *, loss=0.3, doubled=0.1, delay_s=0.3):
        self._pick = Random(seed)
        self.loss, self.doubled, self.delay_s = loss, doubled, delay_s
        self._under_way = []
        self._count = 0

    def send(self, packet, now_s):
        for _ in range(1 + (self._pick.random() < self.doubled)):
            delay_s = self._pick.uniform(0.0, self.delay_s)
            if self._pick.random() >= self.loss:
                self._count += 1
                heapq.heappush(self._under_way, (now_s + delay_s, self._count, packet))

    def arrived(self, now_s):
        """Packets that arrive until now, in their order."""
        while self._under_way and self._under_way[0][0] <= now_s:
            yield heapq.heappop(self._under_way)[2]
