"""Download of the fence that was uploaded to the autopilot, by the mission protocol. No I/O.

MISSION_REQUEST_LIST, MISSION_COUNT, then each item by MISSION_REQUEST_INT, MISSION_ACK at the end;
all of MAV_MISSION_TYPE_FENCE. The download repeats: neither autopilot reports a new upload on
every link. Source: https://mavlink.io/en/services/mission.html.
"""

from __future__ import annotations

import math

from .dialect import Message, create, mavlink
from .telemetry import FenceItem

_ANSWER_TIMEOUT_S = 1.0
"""Both autopilots answer within 20 ms; a slow radio takes some tenths of a second."""
_MAX_REQUESTS = 5
"""Requests of one message before the download fails."""
_PERIOD_S = 10.0
"""Time between two downloads: a fence of 20 items takes 44 packets."""
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
    """Download of the fence, with one request at a time."""

    def __init__(self) -> None:
        self.items: tuple[FenceItem, ...] | None = None
        """Last completely downloaded fence; None before the first."""
        self.silent = False
        """True if the last download got no answer. False while the autopilot has reported a count
        of items and no download is complete."""
        self._counted = False
        """True once the autopilot has reported a number of items."""
        self._due_s = -math.inf
        """Time of the next request: of the list, or of the same message again."""
        self._asked = 0
        """Number of requests of the present message."""
        self._count: int | None = None
        """Number of items in the present download; None between two downloads."""
        self._read: list[FenceItem] = []

    def restart(self) -> None:
        """Starts a new download at once, after a restart of the autopilot."""
        self._end(-math.inf)

    def handle(self, message: Message, target: tuple[int, int], now_s: float) -> Message | None:
        """Takes an answer of the autopilot; returns the MISSION_ACK after the last item, or None.

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
            # An upload is in progress, or the autopilot has no fence list.
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
        """Returns the request that is due now; at most one per call."""
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
