"""A second sender with the companion's own ids, told from copies of the companion's packets.

Two companions with one component id both answer orders and both send setpoints. A router that
loops returns the companion's own packets: those are equal byte by byte, and no second sender's.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from .codec import Codec
from .dialect import Message, mavlink

_KEPT = 32
"""Own heartbeats that are kept: those of 16 s on two links."""
_HEARTBEATS = 3
_WITHIN_S = 10.0
"""Foreign heartbeats that show a second sender, and the time for them: after a restart of the
process a link may still return one of the process before."""
_REPORT_PERIOD_S = 60.0
_HEARTBEAT = int(mavlink.MAVLINK_MSG_ID_HEARTBEAT)


@dataclass(frozen=True, slots=True, kw_only=True)
class ComponentConflict:
    """Another sender has the companion's system and component id."""

    system_id: int
    component_id: int


class OwnIds:
    """Heartbeats with the companion's ids: sent, returned and foreign ones."""

    def __init__(self) -> None:
        self._sent: deque[bytes] = deque(maxlen=_KEPT)
        self._foreign_s: deque[float] = deque(maxlen=_HEARTBEATS)
        self._due_s = -math.inf

    def encoded(self, message: Message, codec: Codec) -> bytes:
        """Packet of a message of the companion."""
        packet = codec.encode(message)
        if message.get_msgId() == _HEARTBEAT:
            self._sent.append(packet)
        return packet

    def receive(self, message: Message, now_s: float) -> tuple[ComponentConflict, ...]:
        """Takes a message with the companion's ids; returns a conflict that is to be reported."""
        if message.get_msgId() != _HEARTBEAT or bytes(message.get_msgbuf()) in self._sent:
            return ()
        self._foreign_s.append(now_s)
        several = len(self._foreign_s) == _HEARTBEATS and now_s - self._foreign_s[0] <= _WITHIN_S
        if not several or now_s < self._due_s:
            return ()
        self._due_s = now_s + _REPORT_PERIOD_S
        ids = {"system_id": message.get_srcSystem(), "component_id": message.get_srcComponent()}
        return (ComponentConflict(**ids),)
