"""Requests of some of the autopilot's parameters by name. No I/O.

Each parameter is requested until the autopilot reports it; after enough requests without an answer
it counts as missing, and is requested now and then. Unrequested values, set by another component,
count as well. Names and units of the firmware are translated here: all other code knows the keys
and units of `autopilots/parameter_names`.

PX4 puts the bytes of an integer into PARAM_VALUE's float unchanged, ArduPilot its number; reals are
floats in both. Source: https://mavlink.io/en/services/parameter.html.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Collection, Iterator
from operator import itemgetter

from ..types import AutopilotKind
from .autopilots import profile
from .autopilots.parameter_names import Name, Parameters, ParameterTable, Release
from .autopilots.profile import Profile
from .dialect import Message, mavlink

_ANSWER_TIMEOUT_S = 0.5
"""Time for an answer: both autopilots take 10 ms, a slow radio some tenths of a second."""
_MAX_REQUESTS = 6
"""Requests of one parameter by each of its names. A link that loses every fifth packet each way
makes one parameter in 450 look missing."""
_MAX_UNDER_WAY = 4
"""Limit of open requests, for the small buffers of a telemetry radio."""
_AGAIN_AFTER_S = 3.0
"""Period of requests of changing parameters: PX4 reports a set value only to its setter."""
_MISSING_S = 1.0
"""Time between two requests of missing parameters: a bad link may become better."""
_VERSION_S = 0.3
"""Wait for the firmware's version, before a parameter with several names is requested."""
_INTEGERS = frozenset(range(mavlink.MAV_PARAM_TYPE_UINT8, mavlink.MAV_PARAM_TYPE_INT32 + 1))
"""MAV_PARAM_TYPEs of integers of up to four bytes; PARAM_VALUE carries no longer ones."""
PAYLOAD_STARTS = {0xFD: 10, 0xFE: 6}
"""Start of the payload by the packet's first byte; in PARAM_VALUE and PARAM_SET param_value is the
first field."""


class ParameterRequests:
    """Requests parameters by name, a few at a time."""

    def __init__(self) -> None:
        self._table = ParameterTable()
        self._assumed: Release = (0, 0, 0)
        self._release: Release | None = None
        """As the autopilot reports it; else by the names that it answers."""
        self._reported = False
        """True if the autopilot has reported its release. A name that it answers shows the
        spelling alone: the oldest release with that name."""
        self._began_s = -math.inf
        self._values: dict[str, float | None] = {}
        self._names: dict[str, Name] = {}
        """Name of each parameter in the connected firmware, by key."""
        self.values = Parameters(self._values, self._names)
        """By key; None: never reported after all requests. Absent: not known yet."""
        self._asked: dict[str, tuple[int, float]] = {}
        """Number of requests and time of the last, by key of an unknown parameter."""
        self._rank: dict[str, int] = {}
        """Number of the first call of `want` for a key, by key. Lower ranks go first."""
        self._changing: set[str] = set()
        """Keys of the periodically requested parameters."""
        self._again: dict[str, tuple[int, float]] = {}
        """Number and time of the last request of a known or missing parameter, by key."""

    def want(self, keys: Collection[str], *, changing: bool = False) -> None:
        """Adds parameters to request, after all earlier ones; changing: periodically."""
        new = [key for key in keys if key not in self._rank]
        if changing:
            self._changing.update(keys)
        if new:
            rank = 1 + max(self._rank.values(), default=0)
            self._rank.update(dict.fromkeys(new, rank))
            self._asked.update(dict.fromkeys(new, (0, -math.inf)))
            self._apply_release()

    def start(self, known: Profile, now_s: float) -> None:
        """Requests all parameters of a found or restarted autopilot, by the names of its kind."""
        self._table, self._assumed = known.parameters, known.assumed_release
        self._release, self._reported, self._began_s = None, False, now_s
        self._asked = dict.fromkeys([*self._values, *self._asked], (0, -math.inf))
        self._values.clear()
        self._names.clear()
        self._again.clear()
        self._apply_release()

    def learn_release(self, release: Release) -> None:
        """Takes the version that the firmware reports."""
        if not self._reported or release != self._release:
            self._release, self._reported = release, True
            self._apply_release()

    def _apply_release(self) -> None:
        """Names the parameters as the release does.

        Those that a reported release does not have are not requested.
        """
        for key in self._rank:
            if self._values.get(key) is None:
                self._names[key] = self._candidates(key)[0]
                reported = self._release if self._reported else None
                absent = None if reported is None else self._table.absent(key, reported)
                if absent is not None:
                    self._asked.pop(key, None)
                    self._values[key] = absent

    def _candidates(self, key: str) -> tuple[Name, ...]:
        return self._table.names(key, self._release or self._assumed)

    def handle(self, message: Message, kind: AutopilotKind) -> None:
        """Takes a PARAM_VALUE of the autopilot; ignores parameters that were not requested.

        Of two names of one parameter the first that is answered counts.
        """
        key, name = self._table.ours(message.param_id)
        if key not in self._rank or (
            self._values.get(key) is not None and name != self._names.get(key)
        ):
            return
        self._asked.pop(key, None)
        value = parameter_value(message, kind)
        self._values[key] = None if value is None else value * name.scale
        self._names[key] = name
        if self._release is None and len(self._candidates(key)) > 1:
            self._release = name.since
            self._apply_release()

    def requests(self, now_s: float) -> Iterator[str]:
        """Names to request now: as many unknown ones as may be open, or one known one."""
        while (name := self.next_request(now_s)) is not None:
            yield name
            if self._table.ours(name)[0] in self._values:  # a periodic request: one per call
                return

    def next_request(self, now_s: float) -> str | None:
        """Name to request now; at most one per call."""
        due = []
        unversioned = self._release is None and now_s < self._began_s + _VERSION_S
        for key, (count, asked_s) in list(self._asked.items()):
            names = len(self._candidates(key))
            if now_s - asked_s < _ANSWER_TIMEOUT_S or (unversioned and names > 1):
                continue
            if count == _MAX_REQUESTS * names:
                del self._asked[key]
                self._values[key] = None
            else:
                due.append((self._rank[key], count, key))
        under_way = sum(now_s - asked_s < _ANSWER_TIMEOUT_S for _, asked_s in self._asked.values())
        if under_way >= _MAX_UNDER_WAY:
            return None
        if not due:
            return self._next_again(now_s)
        # Within a rank the least requested first, so that a missing one delays no other.
        _, count, key = min(due, key=itemgetter(0, 1))
        self._asked[key] = (count + 1, now_s)
        return self._name(key, count)

    def _name(self, key: str, count: int) -> str:
        """Name for the next request: each of its names in turn."""
        names = self._candidates(key)
        return names[count % len(names)].name

    def _next_again(self, now_s: float) -> str | None:
        """Name of the known or missing parameter whose periodic request is due."""
        missing = [key for key, value in self._values.items() if value is None]
        known = [key for key in self._changing if self._values.get(key) is not None]
        due = []
        for keys, period_s in ((missing, _MISSING_S * len(missing)), (known, _AGAIN_AFTER_S)):
            for key in keys:
                count, asked_s = self._again.setdefault(key, (0, now_s))  # it is fresh
                if now_s - asked_s >= max(period_s, _AGAIN_AFTER_S):
                    due.append((asked_s, count, key))
        if not due:
            return None
        _, count, key = min(due)
        self._again[key] = (count + 1, now_s)
        return self._name(key, count) if self._values[key] is None else self._names[key].name


def parameter_value(message: Message, kind: AutopilotKind | None) -> float | None:
    """Value of a PARAM_VALUE or PARAM_SET in the encoding of a kind; None if not finite."""
    if profile(kind).integers_bytewise and message.param_type in _INTEGERS:
        # From the packet: a conversion to float changes some byte patterns.
        packet = message.get_msgbuf()
        (integer,) = struct.unpack_from("<i", packet, PAYLOAD_STARTS[packet[0]])
        return float(integer)
    value = float(message.param_value)
    return value if math.isfinite(value) else None
