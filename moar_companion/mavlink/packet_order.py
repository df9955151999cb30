"""Order of an autopilot's packets by the sequence numbers of their headers. No I/O.

A link that delays each packet by another time delivers some after their successors. What such a
packet says is older than what is known, and must not replace it: the mode above all, for neither
HEARTBEAT nor CURRENT_MODE carries a time. Only a state is replaced by its successor, and only that
of the same instance: events count whenever they arrive.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from .dialect import ESC_STATUS_ID, Message, mavlink

_ROUND = 256
"""Sequence numbers have 8 bits."""
_SILENT_S = 0.2
"""After a longer silence nobody knows how many packets were lost (PX4 sends half a round in
0.3 s): the first packet then begins a new order."""
_EVENTS = {
    int(mavlink.MAVLINK_MSG_ID_STATUSTEXT),
    int(mavlink.MAVLINK_MSG_ID_PARAM_VALUE),
}
_INSTANCES = {
    int(mavlink.MAVLINK_MSG_ID_BATTERY_STATUS): "id",
    int(mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW): "port",
    int(mavlink.MAVLINK_MSG_ID_HIGHRES_IMU): "id",
    ESC_STATUS_ID: "index",
}
"""The field that says of which battery, port, sensor or motors a message tells the state."""


class PacketOrder:
    """Positions of one source's packets, and the latest of each message.

    same: by message id, another message that tells the same and is ordered with it.
    """

    def __init__(self, *, same: Mapping[int, int]) -> None:
        self._same = dict(same)
        self._newest = 0
        self._received_s = -math.inf
        self._latest: dict[tuple[int, int], int] = {}

    def restart(self) -> None:
        """The source has restarted: nothing before counts."""
        self._received_s = -math.inf

    def is_late(self, message: Message, now_s: float) -> bool:
        """Whether a later packet of the same message and instance was taken before this one."""
        ahead = (message.get_seq() - self._newest) % _ROUND
        if now_s - self._received_s > _SILENT_S:
            self._newest += _ROUND + ahead
            place = self._newest
        else:
            place = self._newest + (ahead if ahead < _ROUND // 2 else ahead - _ROUND)
            self._newest = max(self._newest, place)
        self._received_s = now_s
        message_id = message.get_msgId()
        if message_id in _EVENTS:
            return False
        field = _INSTANCES.get(message_id)
        instance = 0 if field is None else getattr(message, field)
        kind = self._same.get(message_id, message_id), instance
        if place < self._latest.get(kind, place):
            return True
        self._latest[kind] = place
        return False
