"""Reading the fence that was uploaded to the autopilot, by the mission protocol. No I/O.

MISSION_REQUEST_LIST, MISSION_COUNT, then each item by MISSION_REQUEST_INT, MISSION_ACK at the end;
all of MAV_MISSION_TYPE_FENCE. It is read again and again: neither autopilot tells on every link
that somebody has uploaded another one. Source: https://mavlink.io/en/services/mission.html.
"""

from __future__ import annotations

import math

from ..types import FenceItem
from .dialect import Message, create, mavlink

_ANSWER_TIMEOUT_S = 1.0
"""Both autopilots answer within 20 ms; a slow radio takes some tenths of a second."""
_MAX_REQUESTS = 5
"""Of one message, before the reading is given up."""
_PERIOD_S = 10.0
"""Between two readings: a fence of 20 items is 44 packets."""
_FENCE = int(mavlink.MAV_MISSION_TYPE_FENCE)
_UNSUPPORTED = int(mavlink.MAV_MISSION_UNSUPPORTED)
_DEGREES = 1e-7
MESSAGE_IDS = frozenset(
    {
        int(mavlink.MAVLINK_MSG_ID_MISSION_COUNT),
        int(mavlink.MAVLINK_MSG_ID_MISSION_ITEM_INT),
        int(mavlink.MAVLINK_MSG_ID_MISSION_ACK),
    }
)


class FenceDownload:
    """Asks for one message at a time."""

    def __init__(self) -> None:
        self.items: tuple[FenceItem, ...] | None = None
        """As last read as a whole; None before the first time."""
        self.silent = False
        """Whether it has not answered, when it was last asked; not while areas are known of that
        were never read."""
        self._counted = False
        """Whether it has ever told how many items there are."""
        self._due_s = -math.inf
        """When to ask next: for the list, or for the same once more."""
        self._asked = 0
        """How often the present message was asked for."""
        self._count: int | None = None
        """Of items in the list that is read; None between two readings."""
        self._read: list[FenceItem] = []

    def restart(self) -> None:
        """The autopilot restarted: its list is read anew at once."""
        self._end(-math.inf)

    def hear(self, message: Message, target: tuple[int, int], now_s: float) -> Message | None:
        """Take what the autopilot answers. Returns what ends the reading, when this was the last.

        target: the autopilot's system and component.
        """
        if message.mission_type != _FENCE or not self._asked:
            return None
        name = message.get_type()
        if name == "MISSION_COUNT" and self._count is None:
            self._count, self._read, self._counted = int(message.count), [], True
        elif name == "MISSION_ITEM_INT" and self._count and message.seq == len(self._read):
            self._read.append(
                FenceItem(
                    command=int(message.command),
                    parameter=float(message.param1),
                    latitude_deg=message.x * _DEGREES,
                    longitude_deg=message.y * _DEGREES,
                )
            )
        elif name == "MISSION_ACK" and message.type != mavlink.MAV_MISSION_ACCEPTED:
            # Somebody uploads just now, or there is no such list.
            if message.type == _UNSUPPORTED:
                self.items = ()
            self._end(now_s + (_PERIOD_S if message.type == _UNSUPPORTED else _ANSWER_TIMEOUT_S))
            return None
        else:
            return None
        self._asked, self._due_s, self.silent = 0, -math.inf, False
        if len(self._read) < (self._count or 0):
            return None
        self.items = tuple(self._read)
        self._end(now_s + _PERIOD_S)
        return create("MISSION_ACK", **_to(target), type=mavlink.MAV_MISSION_ACCEPTED)

    def next_request(self, target: tuple[int, int], now_s: float) -> Message | None:
        """What to ask for now; at most one per call."""
        if now_s < self._due_s:
            return None
        if self._asked == _MAX_REQUESTS:
            self.silent = self.items is not None or not self._counted
            self._end(now_s + _PERIOD_S)
            return None
        self._asked += 1
        self._due_s = now_s + _ANSWER_TIMEOUT_S
        if self._count is None:
            return create("MISSION_REQUEST_LIST", **_to(target))
        return create("MISSION_REQUEST_INT", **_to(target), seq=len(self._read))

    def _end(self, due_s: float) -> None:
        self._asked, self._count, self._read, self._due_s = 0, None, [], due_s


def _to(target: tuple[int, int]) -> dict[str, int]:
    return {
        "target_system": target[0],
        "target_component": target[1],
        "mission_type": _FENCE,
    }
