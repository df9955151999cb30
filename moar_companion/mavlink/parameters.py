"""Reading some of the autopilot's parameters by their names. No I/O.

Each is asked for until it is told; one that is never told is known to be missing. Values that the
autopilot tells unasked, because somebody else has set them, count as well.

PX4 puts the bytes of an integer into PARAM_VALUE's float as they are, ArduPilot its number; reals
are floats in both. Source: https://mavlink.io/en/services/parameter.html.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Iterator, Mapping
from operator import itemgetter
from types import MappingProxyType

from ..types import AutopilotKind
from .dialect import Message, mavlink

_ANSWER_TIMEOUT_S = 0.5
"""Both autopilots answer within 10 ms; a slow radio takes some tenths of a second."""
_MAX_REQUESTS = 6
"""A link that loses every fifth packet each way makes one parameter in 450 look missing."""
_MAX_UNDER_WAY = 4
"""Few enough for the narrow buffers of a telemetry radio."""
_AGAIN_AFTER_S = 3.0
"""PX4 tells a value that is set to who has set it, and nobody else."""
_INTEGERS = frozenset(range(mavlink.MAV_PARAM_TYPE_UINT8, mavlink.MAV_PARAM_TYPE_INT32 + 1))
"""MAV_PARAM_TYPEs of up to four bytes: no other integer travels in a PARAM_VALUE."""
_PAYLOAD_STARTS = {0xFD: 10, 0xFE: 6}
"""By the packet's first byte; param_value is the first field."""


class ParameterRequests:
    """Asks for parameters by name, a few at a time."""

    def __init__(self) -> None:
        self._values: dict[str, float | None] = {}
        self._asked: dict[str, tuple[int, float]] = {}
        """By name of what is not known yet: how often it was asked for, and when last."""
        self._rank: dict[str, int] = {}
        """By name: the number of the call of `want` that named it first. Lower ranks go first."""
        self._changing: dict[str, float] = {}
        """By name of what is asked for again and again: when last."""

    @property
    def values(self) -> Mapping[str, float | None]:
        """By name; None: was asked for often enough, and never told. Absent: not known yet."""
        return MappingProxyType(self._values)

    def want(self, names: Iterable[str], *, changing: bool = False) -> None:
        """From now on these are wanted, after all before; what is changing, again and again."""
        rank = 1 + max(self._rank.values(), default=0)
        for name in names:
            self._rank.setdefault(name, rank)
            if changing:
                self._changing.setdefault(name, -math.inf)
            if name not in self._values:
                self._asked.setdefault(name, (0, -math.inf))

    def restart(self) -> None:
        """The autopilot restarted: all of it is asked for again."""
        self._asked = dict.fromkeys([*self._values, *self._asked], (0, -math.inf))
        self._values = {}

    def hear(self, message: Message, kind: AutopilotKind) -> None:
        """Takes a PARAM_VALUE of the autopilot; one that is not wanted is ignored."""
        name = message.param_id
        if name in self._asked or name in self._values:
            self._asked.pop(name, None)
            self._values[name] = parameter_value(message, kind)

    def requests(self, now_s: float) -> Iterator[str]:
        """The names to ask for now: of those not known yet all that may be under way."""
        while (name := self.next_request(now_s)) is not None:
            yield name
            if name in self._values:  # asked for again: there is time
                return

    def next_request(self, now_s: float) -> str | None:
        """The name to ask for now; at most one per call."""
        due = []
        for name, (count, asked_s) in list(self._asked.items()):
            if now_s - asked_s < _ANSWER_TIMEOUT_S:
                continue
            if count == _MAX_REQUESTS:
                del self._asked[name]
                self._values[name] = None
            else:
                due.append((self._rank[name], count, name))
        under_way = sum(now_s - asked_s < _ANSWER_TIMEOUT_S for _, asked_s in self._asked.values())
        if under_way >= _MAX_UNDER_WAY:
            return None
        if not due:
            return self._next_again(now_s)
        # Of a rank those asked least often first, so that a missing one holds up nothing else.
        _, count, name = min(due, key=itemgetter(0, 1))
        self._asked[name] = (count + 1, now_s)
        return name

    def _next_again(self, now_s: float) -> str | None:
        """What is known, and long ago was asked for."""
        known = [name for name in self._changing if name in self._values]
        if not known:
            return None
        name = min(known, key=lambda name: self._changing[name])
        if self._changing[name] == -math.inf:
            self._changing.update(dict.fromkeys(known, now_s))  # it has just been told
        if now_s - self._changing[name] < _AGAIN_AFTER_S:
            return None
        self._changing[name] = now_s
        return name


def parameter_value(message: Message, kind: AutopilotKind) -> float | None:
    """The value of a PARAM_VALUE as its owner means it; None when it is not finite."""
    if kind is AutopilotKind.PX4 and message.param_type in _INTEGERS:
        # From the packet: a float's way through the processor changes some patterns of bytes.
        packet = message.get_msgbuf()
        (integer,) = struct.unpack_from("<i", packet, _PAYLOAD_STARTS[packet[0]])
        return float(integer)
    value = float(message.param_value)
    return value if math.isfinite(value) else None
