"""Message rates: the wanted rates, and requests of messages that come too seldom. No I/O.

PX4 sends most of them unrequested; ArduPilot sends only heartbeats, and loses its intervals at a
restart. MAV_CMD_SET_MESSAGE_INTERVAL's acknowledgement does not name the message. So one request is
open at a time, and an answer counts only if it can belong to no other request. A missing stream is
requested again after a pause, after any answer.

The companion lowers messages that it does not read to 1 Hz: a real PX4 sends 412 messages a second
on an onboard link, a quarter of them unused. Both autopilots keep intervals by link, so that only
other readers of this link could miss them. A serial port has no other reader. On a network, any
other sender received on the link may be another reader, behind a router. Then the companion lowers
nothing, and restores the rates that it lowered. Senders that the autopilot forwards from another
link cannot be distinguished, and count, too.

A slow line is a serial port on which the wanted rates do not fit (`on_line`). There PX4 lowers the
rates of all messages by one factor, also of those that it sends unrequested: at 57600 baud ATTITUDE
at 100 Hz leaves 12 Hz for the position, and one report of the battery in 7 s. So the companion
requests each wanted message there at its rate, also one that comes too often, and unread ones at
0.1 Hz.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from ..types import AutopilotKind
from .autopilots import profile
from .commands import CommandResult
from .dialect import CURRENT_MODE_ID, id_of, mavlink

_MODE_IDS = frozenset({mavlink.MAVLINK_MSG_ID_HEARTBEAT, CURRENT_MODE_ID})

_COMMON_RATES_HZ: dict[int, float] = {
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 40.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 20.0,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 5.0,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: 5.0,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 5.0,
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: 5.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 2.0,
    mavlink.MAVLINK_MSG_ID_GPS2_RAW: 2.0,
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS: 2.0,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 0.5,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: 0.5,
}
"""Positions: PX4's default is 30 Hz. On a link that loses 30 % and takes 0.2 s, one flight of 200 s
in eight then ends for a gap over the remaining 0.3 s. At 40 Hz it is one in 250."""


def wanted_rates_hz(kind: AutopilotKind) -> Mapping[int, float]:
    """Returns the wanted rates of an autopilot by message id.

    Without messages that it denies; on links of unknown rate and fast ones all of them.
    """
    own = {id_of(name): rate_hz for name, rate_hz in profile(kind).rates_hz.items()}
    return {**_COMMON_RATES_HZ, **own}


_MODE_ON_NETWORK_HZ = 50.0
"""Wanted rate of the mode on a link that is no serial port, since radios and networks lose and
delay packets. With 30 % loss and delays of 0.05 to 0.2 s, 50 Hz shows 98 % of ArduPilot's takeovers
within 0.2 s, 20 Hz 85 %. PX4 looks for a new mode at this rate, and reports a change once, then
twice a second (CURRENT_MODE.hpp): where that report is lost, the takeover shows half a second
later. It ignores the stream meanwhile."""


_OBSTACLES_HZ = 5.0
"""Wanted rate of OBSTACLE_DISTANCE, in which PX4 sends what its distance sensors measure. Its
900 B/s do not fit a serial port at 57600 baud beside the others."""


def on_network(rates_hz: Mapping[int, float], *, obstacles: bool = False) -> Mapping[int, float]:
    """Returns the wanted rates for a link that is no serial port.

    obstacles: True if OBSTACLE_DISTANCE is wanted of the autopilot, too.
    """
    wanted = {
        message_id: _MODE_ON_NETWORK_HZ if message_id in _MODE_IDS else rate_hz
        for message_id, rate_hz in rates_hz.items()
    }
    return wanted | ({mavlink.MAVLINK_MSG_ID_OBSTACLE_DISTANCE: _OBSTACLES_HZ} if obstacles else {})


_LEAST_HZ: dict[int, float] = {
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 20.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 10.0,
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: 2.0,
    **dict.fromkeys(_MODE_IDS, 10.0),
}
"""Least rates on a slow line: the position for `supervision.position_timeout_s`, the mode so that
a takeover shows within 0.1 s, motors twice in the second for which they count."""
_LEAST_OF_OTHERS_HZ = 1.0
"""Three times within the shortest age for which a risk counts them, 3 s."""
_OTHER_BYTES_PER_S = 500.0
"""Room for all else: TIMESYNC (PX4 at 10 Hz: 280 B/s), answers, texts, packets of other senders."""
_FRAME_BYTES, _SIGNATURE_BYTES = 12, 13


def on_line(
    rates_hz: Mapping[int, float], bytes_per_s: float, *, signed: bool = False
) -> Mapping[int, float]:
    """Returns the wanted rates for a serial line on which the autopilot sends `bytes_per_s`.

    If they do not fit, one factor lowers all of them, none below its least rate. The factor is the
    greatest in steps of a tenth with which they fit; with none the least rates are wanted.
    """
    frame_bytes = _FRAME_BYTES + (_SIGNATURE_BYTES if signed else 0)
    for tenths in range(10, -1, -1):
        lowered = {
            message_id: max(tenths / 10 * rate_hz, min(rate_hz, _least_hz(message_id)))
            for message_id, rate_hz in rates_hz.items()
        }
        if _bytes_per_s(lowered, frame_bytes) + _OTHER_BYTES_PER_S <= bytes_per_s:
            break
    return lowered


def _least_hz(message_id: int) -> float:
    return _LEAST_HZ.get(message_id, _LEAST_OF_OTHERS_HZ)


def _bytes_per_s(rates_hz: Mapping[int, float], frame_bytes: int) -> float:
    """Upper limit of the bytes a second of these messages, without trailing zeros cut."""
    total_bytes_per_s = 0.0
    for message_id, rate_hz in rates_hz.items():
        payload_bytes: int = mavlink.mavlink_map[message_id].unpacker.size
        total_bytes_per_s += rate_hz * (payload_bytes + frame_bytes)
    return total_bytes_per_s


_ENOUGH = 0.8
"""Sufficient share of the wanted rate: the autopilot's scheduler rounds, and a window cuts."""
_MIN_WINDOW_S = 2.0
_WINDOW_PERIODS = 2.5
"""Least window of a rate, in wanted periods."""
_ACK_TIMEOUT_S = 0.5
"""Time for an answer: both autopilots take 10 ms, a link may add 0.2 s each way."""
_ANSWER_MAX_AGE_S = 5.0
"""Greatest age of a request that may still be acknowledged."""
_SPACING_S = 0.02
"""Least time between requests: at most five in 100 ms."""
_MAX_REQUESTS = 3
_AGAIN_S = 10.0
"""Pause after three requests without success. A link that loses 30 % each way loses all three
requests or answers one time in seven."""
_DENIED_AGAIN_S = 60.0
"""Pause after a denial, which may have been for another sender or a copy of an earlier one."""

_TOO_MUCH = 1.5
"""Multiple of the wanted rate that is lowered on a slow line; a window counts one message more."""

_UNUSED_HZ, _UNUSED_ON_SLOW_LINE_HZ = 1.0, 0.1
"""Rate of an unread message, kept for recordings."""
_UNUSED_MOST = 2.0
"""Multiple of this rate up to which an unread message needs no request."""
_UNUSED_WINDOW_PERIODS = 3.0
_UNUSED_WINDOW_S = 10.0
"""Window of an unread message: ten heartbeats of another reader, of which one survives 30 %
loss."""


class _Stream:
    """One wanted message: its count, and the state of its requests."""

    __slots__ = (
        "count",
        "denied",
        "exact",
        "flowing",
        "rate_hz",
        "requested_s",
        "requests",
        "settled",
        "window_end_s",
        "window_s",
        "wrong",
    )

    def __init__(
        self, rate_hz: float, first_window_s: float, now_s: float, *, exact: bool = False
    ) -> None:
        """exact: True if a higher rate than the wanted one is lowered."""
        self.rate_hz = rate_hz
        self.exact = exact
        self.window_s = max(_MIN_WINDOW_S, _WINDOW_PERIODS / rate_hz)
        self.count = 0
        self.window_end_s = now_s + min(first_window_s, self.window_s)
        self.wrong = first_window_s == 0.0
        self.flowing = False
        self.requests = 0
        self.requested_s = -math.inf
        self.settled = False
        self.denied = False

    def judge(self, now_s: float) -> None:
        """Updates `wrong` and the state of requests at the end of a window."""
        if now_s < self.window_end_s:
            return
        too_few = self.count < _ENOUGH * self.rate_hz * self.window_s
        too_many = self.exact and self.count > _TOO_MUCH * self.rate_hz * self.window_s
        self.wrong = too_few or too_many
        stopped = self.flowing and self.count == 0
        paused = now_s >= self.requested_s + (_DENIED_AGAIN_S if self.denied else _AGAIN_S)
        silent = self.count == 0 and self.requests > 0
        unanswered = self.requests == _MAX_REQUESTS and not self.settled
        if not self.wrong or (stopped and not self.denied) or (paused and (silent or unanswered)):
            self.requests = 0
            self.settled = self.denied = False
        self.flowing = self.count > 0
        self.count = 0
        self.window_end_s = now_s + self.window_s

    @property
    def needs_request(self) -> bool:
        """True while another request may help."""
        return self.wrong and not (self.settled or self.denied) and self.requests < _MAX_REQUESTS


class _UnusedStream(_Stream):
    """One unread message: lowered once, and restored once if the link has another reader."""

    __slots__ = ("received_hz", "restored")

    def __init__(self, rate_hz: float, now_s: float, *, alone: bool) -> None:
        """alone: True if the companion is the link's only reader."""
        super().__init__(rate_hz, float("inf"), now_s)
        self.window_s = _MIN_WINDOW_S if alone else _UNUSED_WINDOW_S
        self.window_end_s = now_s + self.window_s
        self.received_hz = 0.0
        self.restored = False

    def judge(self, now_s: float) -> None:
        """Updates `wrong` at the end of a window."""
        if now_s < self.window_end_s:
            return
        received_hz = self.count / self.window_s
        if not self.lowering_requested:
            self.received_hz = received_hz
        if self.restored:
            self.wrong = received_hz < _ENOUGH * self.rate_hz
        else:
            self.wrong = self.count > 1 and received_hz > _UNUSED_MOST * self.rate_hz
        if self.requests and not self.wrong:
            # Success, although the answer was lost; a later change by another component stays.
            self.settled = True
        if self.requests == _MAX_REQUESTS and now_s >= self.requested_s + _AGAIN_S:
            self.requests = 0
        self.count = 0
        self.window_s = max(_UNUSED_WINDOW_S, _UNUSED_WINDOW_PERIODS / self.rate_hz)
        self.window_end_s = now_s + self.window_s

    @property
    def lowering_requested(self) -> bool:
        """True once the lower rate was requested."""
        return self.requested_s > -math.inf

    def restore(self) -> None:
        """Restores the rate before lowering, if the message was lowered."""
        if self.lowering_requested and not self.restored:
            self.restored = self.wrong = True
            self.rate_hz = self.received_hz
            self.requests = 0
            self.settled = False


class _Asked(NamedTuple):
    """One sent request. rate_hz: the requested rate; the stream's may have changed since."""

    sent_s: float
    stream: _Stream
    rate_hz: float


class MessageRates:
    """Requests each wanted message until it arrives, is acknowledged or denied.

    Three times in a row, then again after a pause. A missing message is requested again after any
    answer, less often after a denial.
    """

    def __init__(self) -> None:
        self._streams: dict[int, _Stream] = {}
        self._unused: dict[tuple[str, int], _UnusedStream] = {}
        """Unread messages by link and message id."""
        self._slow_line = False
        self._under_way = False
        self._asked: list[_Asked] = []
        """Requests whose answer may still come, the oldest first."""
        self._sent_s = -1.0

    def start(
        self, rates_hz: Mapping[int, float], *, silent: bool, now_s: float, slow_line: bool = False
    ) -> None:
        """Starts after an autopilot is found or restarts.

        silent: it needs requests at once. slow_line: its line does not carry more than these rates.
        """
        first_window_s = 0.0 if silent or slow_line else float("inf")
        self._slow_line = slow_line
        self._streams = {
            message_id: _Stream(rate_hz, first_window_s, now_s, exact=slow_line)
            for message_id, rate_hz in rates_hz.items()
            if rate_hz > 0.0
        }
        self._unused = {}
        self._under_way = False
        self._asked = []
        self._sent_s = now_s - _SPACING_S

    def add(self, message_id: int, rate_hz: float, now_s: float) -> None:
        """Requests one more message, at once."""
        self._streams[message_id] = _Stream(rate_hz, 0.0, now_s, exact=self._slow_line)

    def count(self, message_id: int) -> None:
        """Counts a message of the autopilot."""
        stream = self._streams.get(message_id)
        if stream is not None:
            stream.count += 1

    def count_unused(self, message_id: int, link: str, now_s: float) -> None:
        """Counts an unread message of the autopilot on its link."""
        stream = self._unused.get((link, message_id))
        if stream is None:
            rate_hz = _UNUSED_ON_SLOW_LINE_HZ if self._slow_line else _UNUSED_HZ
            stream = _UnusedStream(rate_hz, now_s, alone=self._slow_line)
            self._unused[link, message_id] = stream
        stream.count += 1

    def answered(self, result: int) -> None:
        """Takes the result of COMMAND_ACK for MAV_CMD_SET_MESSAGE_INTERVAL.

        The result does not name its request: if it may belong to several, it counts for none.
        """
        self._under_way = False
        if len({(id(asked.stream), asked.rate_hz) for asked in self._asked}) != 1:
            return
        asked = self._asked.pop(0)
        stream = asked.stream
        if asked.rate_hz != stream.rate_hz:
            return
        if result == CommandResult.ACCEPTED:
            # PX4 also accepts messages without data; more requests would not change that.
            stream.settled = True
        elif result not in {CommandResult.TEMPORARILY_REJECTED, CommandResult.IN_PROGRESS}:
            stream.denied = True

    def next_request(
        self, now_s: float, link: str = "", *, shared: bool = True
    ) -> tuple[int, float] | None:
        """Message to request now and its interval in µs; at most one per call.

        link: the autopilot's. shared: True if the link may have another reader.
        """
        streams: dict[int, _Stream] = {**self._streams}
        for (received_on, message_id), unused in self._unused.items():
            if received_on == link and message_id not in streams:
                if shared:
                    unused.restore()
                if unused.restored or not shared:
                    streams[message_id] = unused
        for stream in streams.values():
            stream.judge(now_s)
        waited_s = now_s - self._sent_s
        if waited_s < (_ACK_TIMEOUT_S if self._under_way else _SPACING_S):
            return None
        self._under_way = False
        self._asked = [a for a in self._asked if now_s < a.sent_s + _ANSWER_MAX_AGE_S]
        wrong = [item for item in streams.items() if item[1].needs_request]
        if not wrong:
            return None
        # The least requested first, so that a lost answer delays no other.
        message_id, stream = min(wrong, key=lambda item: item[1].requests)
        stream.requests += 1
        stream.requested_s = now_s
        self._under_way = True
        self._asked.append(_Asked(sent_s=now_s, stream=stream, rate_hz=stream.rate_hz))
        self._sent_s = now_s
        return message_id, round(1e6 / stream.rate_hz)
