"""Order of an autopilot's packets by the sequence numbers of their headers. No I/O.

A link that delays each packet by another time delivers some after their successors. What such a
packet says is older than what is known, and must not replace it: the mode above all, for neither
HEARTBEAT nor CURRENT_MODE carries a time.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from .dialect import Message

_ROUND = 256
"""Sequence numbers have 8 bits."""
_SILENT_S = 0.2
"""After a longer silence nobody knows how many packets were lost (PX4 sends half a round in
0.3 s): the first packet then begins a new order."""


class PacketOrder:
    """Positions of one source's packets, and the latest of each message.

    same: by message id, another message that tells the same and is ordered with it.
    """

    def __init__(self, *, same: Mapping[int, int]) -> None:
        self._same = dict(same)
        self._newest = 0
        self._received_s = -math.inf
        self._latest: dict[int, int] = {}

    def restart(self) -> None:
        """The source has restarted: nothing before counts."""
        self._received_s = -math.inf

    def is_late(self, message: Message, now_s: float) -> bool:
        """Whether a later packet of the same message was taken before this one."""
        ahead = (message.get_seq() - self._newest) % _ROUND
        if now_s - self._received_s > _SILENT_S:
            self._newest += _ROUND + ahead
            place = self._newest
        else:
            place = self._newest + (ahead if ahead < _ROUND // 2 else ahead - _ROUND)
            self._newest = max(self._newest, place)
        self._received_s = now_s
        message_id = message.get_msgId()
        kind = self._same.get(message_id, message_id)
        if place < self._latest.get(kind, place):
            return True
        self._latest[kind] = place
        return False
