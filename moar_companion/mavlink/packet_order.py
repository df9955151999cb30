"""Order of an autopilot's packets by the times in them, and by their sequence numbers. No I/O.

A link that delays each packet by another time delivers some after their successors. What such a
packet says is older than what is known, and must not replace it. Of a message that carries the
autopilot's time (`time_boot_ms`, `time_usec`) the time decides, however late it is. `time_boot_ms`
is of one clock, which is judged in one place; `time_usec` may be of a receiver or of an odometry
that restarts by itself, so that each message has a clock of its own. Of others the
sequence number of the header does: of the mode above all, as neither HEARTBEAT nor CURRENT_MODE
carries a time. Only a state is replaced by its successor, and only that of the same instance:
events count whenever they arrive.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from .dialect import ESC_STATUS_ID, Message, mavlink
from .source_clock import Reading, SourceClock

_ROUND = 256
"""Sequence numbers have 8 bits."""
_SILENT_S = 0.2
"""After a longer silence nobody knows how many packets were lost (PX4 sends half a round in
0.3 s): the first packet then begins a new order."""
_AT_ONCE = 32
_MOST_HZ = 1000.0
"""A number that is farther ahead than this, and than so many packets a second since the last, is of
a packet that is late by most of a round: PX4 sends one in 0.6 s. On a link that delays packets by
up to 0.15 s more than others, one of 230 a second is up to 20 ahead."""
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
_OF_A_PLACE = {
    int(mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN),
    int(mavlink.MAVLINK_MSG_ID_HOME_POSITION),
}
"""PX4 stamps these with the time at which the place was set, ArduPilot with that of the packet: a
place that was told with a later time would hide the true one for good."""
_ROUND_32_BITS_S = 2**32 * 1e-6
"""`time_usec` of 32 bits begins anew."""


class PacketOrder:
    """Positions of one source's packets, and the latest of each message.

    same: by message id, another message that tells the same and is ordered with it. boot_clock:
    the source's clock, whose steps whoever reads it judges; for all messages with `time_boot_ms`.
    """

    def __init__(self, *, same: Mapping[int, int], boot_clock: SourceClock) -> None:
        self._same = dict(same)
        self._boot_clock = boot_clock
        self._newest = 0
        self._received_s = -math.inf
        self._latest: dict[tuple[int, int], int] = {}
        self._boot_s: dict[tuple[int, int], float] = {}
        """The latest `time_boot_ms` of each message, in seconds."""
        self._clocks: dict[tuple[int, int], SourceClock] = {}
        """Of messages with `time_usec`."""
        self.late = 0
        """How many packets were late, or ahead of the autopilot's clock."""

    def restart(self) -> None:
        """The source has restarted: nothing before counts."""
        self._received_s = -math.inf
        self._boot_s.clear()
        self._clocks.clear()

    def is_late(self, message: Message, now_s: float) -> bool:
        """Whether a later packet of the same message and instance was taken before this one.

        Also when its time is ahead of what the autopilot's clock can tell by now. Such packets are
        counted in `late`.
        """
        message_id = message.get_msgId()
        field = _INSTANCES.get(message_id)
        instance = 0 if field is None else getattr(message, field)
        timed = None if message_id in _OF_A_PLACE else self._is_older(message, instance, now_s)
        if timed is not None:
            late = timed
            if not late:
                self._place_of(message, now_s, timed=True)
        else:
            kind = self._same.get(message_id, message_id), instance
            place = self._place_of(message, now_s, timed=False)
            late = message_id not in _EVENTS and self._is_overtaken(kind, place)
        self.late += late
        return late

    def _is_older(self, message: Message, instance: int, now_s: float) -> bool | None:
        """Whether it is late by the time in it; None where it carries none."""
        kind = message.get_msgId(), instance
        if hasattr(message, "time_boot_ms"):
            boot_s, clock = message.time_boot_ms * 1e-3, self._boot_clock
            older = clock.passed_s(self._boot_s.get(kind, boot_s), boot_s) < 0.0
            if older or clock.is_ahead(boot_s, now_s):
                return True
            self._boot_s[kind] = boot_s
            return False
        # 0 is how PX4 tells that a receiver is silent.
        time_usec = getattr(message, "time_usec", 0)
        if not time_usec:
            return None
        if kind not in self._clocks:
            short = message.fieldtypes[message.fieldnames.index("time_usec")] == "uint32_t"
            self._clocks[kind] = SourceClock(round_s=_ROUND_32_BITS_S if short else math.inf)
        return self._clocks[kind].read(time_usec * 1e-6, now_s) in {Reading.LATE, Reading.FOREIGN}

    def _is_overtaken(self, kind: tuple[int, int], place: int | None) -> bool:
        """Whether it is late by its sequence number."""
        if place is None or place < self._latest.get(kind, place):
            return True
        self._latest[kind] = place
        return False

    def _place_of(self, message: Message, now_s: float, *, timed: bool) -> int | None:
        """The position of a packet among all; None of one that is too far ahead.

        timed: whether it is known to be in time by the time in it.
        """
        ahead = (int(message.get_seq()) - self._newest) % _ROUND
        silent_s = now_s - self._received_s
        if silent_s > _SILENT_S:
            place = self._newest + _ROUND + ahead
        elif ahead >= _ROUND // 2:
            place = self._newest + ahead - _ROUND
        elif not timed and ahead > _AT_ONCE + _MOST_HZ * silent_s:
            return None
        else:
            place = self._newest + ahead
        self._newest, self._received_s = max(self._newest, place), now_s
        return place
