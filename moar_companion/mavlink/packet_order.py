"""Order of an autopilot's packets by their time stamps and their sequence numbers. No I/O.

A link with varying delay delivers some packets after their successors. Such a late packet must not
replace newer data. For a message with the autopilot's time (`time_boot_ms`, `time_usec`) that time
decides. `time_boot_ms` has one clock, tracked in one place. `time_usec` may come from a receiver or
an odometry that restarts by itself, so each message has its own clock. For others the sequence
number of the header decides: above all for the mode, as neither HEARTBEAT nor CURRENT_MODE carries
a time. Only states of the same instance are ordered; events count at any time of arrival.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from .dialect import ESC_STATUS_ID, Message, mavlink
from .source_clock import Reading, SourceClock

_ROUND = 256
"""Wrap of the sequence numbers: 8 bits."""
_SILENT_S = 0.2
"""Longest silence with a known number of lost packets (PX4 sends half a wrap in 0.3 s). After a
longer one the first packet starts a new order."""
_AT_ONCE = 32
_MOST_HZ = 1000.0
"""Limits of a jump ahead: _AT_ONCE and _MOST_HZ packets a second since the last. A number farther
ahead belongs to a packet late by most of a wrap, which PX4 sends in 0.6 s. Measured jump: up to 20,
on a link with 230 packets a second and up to 0.15 s of varying delay."""
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
"""Field with the instance: the battery, port, sensor or motors of a message."""
_OF_A_PLACE = {
    int(mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN),
    int(mavlink.MAVLINK_MSG_ID_HOME_POSITION),
}
"""Messages ordered by sequence number despite a time. PX4 stamps them with the time of setting,
ArduPilot with that of sending: one wrong later stamp would block the true place for good."""
_ROUND_32_BITS_S = 2**32 * 1e-6
"""Wrap of a `time_usec` of 32 bits."""


class PacketOrder:
    """Positions of one source's packets, and the latest of each message.

    same: by message id, another message with the same content, ordered together with it.
    boot_clock: the source's clock for all messages with `time_boot_ms`; the caller updates it.
    """

    def __init__(self, *, same: Mapping[int, int], boot_clock: SourceClock) -> None:
        self._same = dict(same)
        self._boot_clock = boot_clock
        self._newest = 0
        self._received_s = -math.inf
        self._latest: dict[tuple[int, int], int] = {}
        self._boot_s: dict[tuple[int, int], float] = {}
        """Latest `time_boot_ms` of each message, in seconds."""
        self._clocks: dict[tuple[int, int], SourceClock] = {}
        """Clocks of messages with `time_usec`."""
        self.late = 0
        """Count of packets that were late, or ahead of the autopilot's clock."""

    def restart(self) -> None:
        """Resets the order after a restart of the source."""
        self._received_s = -math.inf
        self._boot_s.clear()
        self._clocks.clear()

    def is_late(self, message: Message, now_s: float) -> bool:
        """Returns True if a later packet of the same message and instance was accepted before.

        Also True if its time is ahead of the autopilot's clock. Counts both in `late`.
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
        """Returns True if the packet is late by its time stamp; None without one."""
        kind = message.get_msgId(), instance
        if hasattr(message, "time_boot_ms"):
            boot_s, clock = message.time_boot_ms * 1e-3, self._boot_clock
            older = clock.passed_s(self._boot_s.get(kind, boot_s), boot_s) < 0.0
            if older or clock.is_ahead(boot_s, now_s):
                return True
            self._boot_s[kind] = boot_s
            return False
        # PX4 reports 0 for a silent receiver.
        time_usec = getattr(message, "time_usec", 0)
        if not time_usec:
            return None
        if kind not in self._clocks:
            short = message.fieldtypes[message.fieldnames.index("time_usec")] == "uint32_t"
            self._clocks[kind] = SourceClock(round_s=_ROUND_32_BITS_S if short else math.inf)
        return self._clocks[kind].read(time_usec * 1e-6, now_s) in {Reading.LATE, Reading.FOREIGN}

    def _is_overtaken(self, kind: tuple[int, int], place: int | None) -> bool:
        """Returns True if the packet is late by its sequence number."""
        if place is None or place < self._latest.get(kind, place):
            return True
        self._latest[kind] = place
        return False

    def _place_of(self, message: Message, now_s: float, *, timed: bool) -> int | None:
        """Position of a packet among all; None for a number too far ahead.

        timed: True if its time stamp shows that it is not late.
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
