"""Requests of some of the autopilot's parameters by name. No I/O.

Each parameter is requested until the autopilot reports it; after enough requests without an answer
it counts as missing. Unrequested values, set by another component, count as well.

PX4 puts the bytes of an integer into PARAM_VALUE's float unchanged, ArduPilot its number; reals are
floats in both. Source: https://mavlink.io/en/services/parameter.html.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Iterator, Mapping
from operator import itemgetter
from types import MappingProxyType

from ..autopilots import profile
from ..types import AutopilotKind
from .dialect import Message, mavlink

_ANSWER_TIMEOUT_S = 0.5
"""Time for an answer: both autopilots take 10 ms, a slow radio some tenths of a second."""
_MAX_REQUESTS = 6
"""Requests of one parameter. A link that loses every fifth packet each way makes one parameter in
450 look missing."""
_MAX_UNDER_WAY = 4
"""Limit of open requests, for the small buffers of a telemetry radio."""
_AGAIN_AFTER_S = 3.0
"""Period of requests of changing parameters: PX4 reports a set value only to its setter."""
_INTEGERS = frozenset(range(mavlink.MAV_PARAM_TYPE_UINT8, mavlink.MAV_PARAM_TYPE_INT32 + 1))
"""MAV_PARAM_TYPEs of integers of up to four bytes; PARAM_VALUE carries no longer ones."""
_PAYLOAD_STARTS = {0xFD: 10, 0xFE: 6}
"""Start of the payload by the packet's first byte; param_value is the first field."""


class ParameterRequests:
    """Requests parameters by name, a few at a time."""

    def __init__(self) -> None:
        self._values: dict[str, float | None] = {}
        self._asked: dict[str, tuple[int, float]] = {}
        """Number of requests and time of the last, by name of an unknown parameter."""
        self._rank: dict[str, int] = {}
        """Number of the first call of `want` for a name, by name. Lower ranks go first."""
        self._changing: dict[str, float] = {}
        """Time of the last request of a periodically requested parameter, by name."""

    @property
    def values(self) -> Mapping[str, float | None]:
        """Values by name; None: never reported after all requests. Absent: not known yet."""
        return MappingProxyType(self._values)

    def want(self, names: Iterable[str], *, changing: bool = False) -> None:
        """Adds parameters to request, after all earlier ones; changing: periodically."""
        rank = 1 + max(self._rank.values(), default=0)
        for name in names:
            self._rank.setdefault(name, rank)
            if changing:
                self._changing.setdefault(name, -math.inf)
            if name not in self._values:
                self._asked.setdefault(name, (0, -math.inf))

    def restart(self) -> None:
        """Requests all parameters again, after a restart of the autopilot."""
        self._asked = dict.fromkeys([*self._values, *self._asked], (0, -math.inf))
        self._values = {}

    def handle(self, message: Message, kind: AutopilotKind) -> None:
        """Takes a PARAM_VALUE of the autopilot; ignores parameters that were not requested."""
        name = message.param_id
        if name in self._asked or name in self._values:
            self._asked.pop(name, None)
            self._values[name] = parameter_value(message, kind)

    def requests(self, now_s: float) -> Iterator[str]:
        """Names to request now: as many unknown ones as may be open, or one known one."""
        while (name := self.next_request(now_s)) is not None:
            yield name
            if name in self._values:  # a periodic request: one per call
                return

    def next_request(self, now_s: float) -> str | None:
        """Name to request now; at most one per call."""
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
        # Within a rank the least requested first, so that a missing one delays no other.
        _, count, name = min(due, key=itemgetter(0, 1))
        self._asked[name] = (count + 1, now_s)
        return name

    def _next_again(self, now_s: float) -> str | None:
        """Name of the known parameter whose periodic request is due."""
        known = [name for name in self._changing if name in self._values]
        if not known:
            return None
        name = min(known, key=lambda name: self._changing[name])
        if self._changing[name] == -math.inf:
            self._changing.update(dict.fromkeys(known, now_s))  # they are fresh
        if now_s - self._changing[name] < _AGAIN_AFTER_S:
            return None
        self._changing[name] = now_s
        return name


def parameter_value(message: Message, kind: AutopilotKind) -> float | None:
    """Value of a PARAM_VALUE in its sender's encoding; None if not finite."""
    if profile(kind).integers_bytewise and message.param_type in _INTEGERS:
        # From the packet: a conversion to float changes some byte patterns.
        packet = message.get_msgbuf()
        (integer,) = struct.unpack_from("<i", packet, _PAYLOAD_STARTS[packet[0]])
        return float(integer)
    value = float(message.param_value)
    return value if math.isfinite(value) else None
