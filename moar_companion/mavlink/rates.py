"""Which messages are wanted how often, and asking for those that come too seldom. No I/O.

PX4 sends most of it by itself; ArduPilot sends heartbeats only, and forgets what was requested
when it restarts. MAV_CMD_SET_MESSAGE_INTERVAL's acknowledgement does not name the message, so one
request is under way at a time, and an answer counts only where it can be no other request's. A
stream that does not flow is asked for again after a pause, whatever was answered.

Messages that the companion does not read are asked down to 1 Hz: a real PX4 sends 412 messages a
second on an onboard link, a quarter of them for nothing. Both autopilots keep intervals by link,
so that only what shares this one could miss them. A serial port has no other reader. On a network
anybody but the autopilot who was ever heard on the link may share it, behind a router: then nothing
is asked down, and what was is asked for again as it came before. Whom the autopilot forwards from
another link cannot be told apart there, and counts, too.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from ..types import AutopilotKind
from .commands import CommandResult
from .dialect import CURRENT_MODE_ID, LINK_NODE_STATUS_ID, mavlink

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

"""PX4 sends 30 positions a second. On a link that loses 30 % and takes 0.2 s, one flight of 200 s
in eight would then end, for none has come for the 0.3 s that are left; of 40 one in 250."""

DEFAULT_RATES_HZ: Mapping[AutopilotKind, Mapping[int, float]] = {
    AutopilotKind.PX4: {
        **_COMMON_RATES_HZ,
        mavlink.MAVLINK_MSG_ID_ODOMETRY: 5.0,
        mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 1.0,
        mavlink.MAVLINK_MSG_ID_WIND_COV: 2.0,
        mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: 2.0,
        LINK_NODE_STATUS_ID: 1.0,
        CURRENT_MODE_ID: 20.0,
    },
    AutopilotKind.ARDUPILOT: {
        **_COMMON_RATES_HZ,
        mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 1.0,
        mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: 2.0,
        mavlink.MAVLINK_MSG_ID_WIND: 2.0,
        mavlink.MAVLINK_MSG_ID_RAW_IMU: 2.0,
        mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: 0.2,
        mavlink.MAVLINK_MSG_ID_HEARTBEAT: 20.0,
    },
    AutopilotKind.UNKNOWN: _COMMON_RATES_HZ,
}
"""By autopilot, then by message id. PX4's own rates where those do, so that nothing is asked of a
slow link; what an autopilot is known to deny is left out. The mode is asked for more often than
the 1 Hz at which both tell it: a takeover is to show within 0.2 s, though packets are lost. Where
30 % is lost and each packet takes 0.05 to 0.2 s, 20 Hz shows 83 % (PX4) and 95 % (ArduPilot) of
takeovers within 0.2 s and all of 60 within 0.4 s; 10 Hz 55 % and 85 %. PX4 refuses another rate of
its heartbeat, and accepts one of CURRENT_MODE."""

_ENOUGH = 0.8
"""Of the wanted rate: an autopilot's scheduler rounds, and a window cuts."""
_MIN_WINDOW_S = 2.0
_WINDOW_PERIODS = 2.5
"""A rate is judged over so many of its wanted periods, at least."""
_ACK_TIMEOUT_S = 0.5
"""Both autopilots acknowledge within 10 ms, a link may delay each way by 0.2 s."""
_ANSWER_MAX_AGE_S = 5.0
"""An acknowledgement may still come so long after its request."""
_SPACING_S = 0.02
"""Between requests: at most five in 100 ms."""
_MAX_REQUESTS = 3
_AGAIN_S = 10.0
"""A link may have lost so many requests, or their answers: one in seven loses them all three where
it loses 30 % each way. Then another round begins."""
_DENIED_AGAIN_S = 60.0
"""A denial may have been the answer to somebody else, or a copy of an earlier one."""

_UNUSED_HZ = 1.0
"""What is left of a message that is not read: a recording still shows it."""
_UNUSED_MOST_HZ = 2.0
"""Less often than this it is not worth a request."""
_UNUSED_WINDOW_S = 10.0
"""Ten heartbeats of anybody who shares the link: at a loss of 30 % one is heard."""


class _Stream:
    """One wanted message: how often it came, and what was done about it."""

    __slots__ = (
        "count",
        "denied",
        "flowing",
        "low",
        "rate_hz",
        "requested_s",
        "requests",
        "settled",
        "window_end_s",
        "window_s",
    )

    def __init__(self, rate_hz: float, first_window_s: float, now_s: float) -> None:
        self.rate_hz = rate_hz
        self.window_s = max(_MIN_WINDOW_S, _WINDOW_PERIODS / rate_hz)
        self.count = 0
        self.window_end_s = now_s + min(first_window_s, self.window_s)
        self.low = first_window_s == 0.0
        self.flowing = False
        self.requests = 0
        self.requested_s = -math.inf
        self.settled = False
        self.denied = False

    def judge(self, now_s: float) -> None:
        """At the end of a window: whether the message comes often enough."""
        if now_s < self.window_end_s:
            return
        self.low = self.count < _ENOUGH * self.rate_hz * self.window_s
        stopped = self.flowing and self.count == 0
        paused = now_s >= self.requested_s + (_DENIED_AGAIN_S if self.denied else _AGAIN_S)
        silent = self.count == 0 and self.requests > 0
        unanswered = self.requests == _MAX_REQUESTS and not self.settled
        if not self.low or (stopped and not self.denied) or (paused and (silent or unanswered)):
            self.requests = 0
            self.settled = self.denied = False
        self.flowing = self.count > 0
        self.count = 0
        self.window_end_s = now_s + self.window_s

    @property
    def wanting(self) -> bool:
        """Whether another request may help."""
        return self.low and not (self.settled or self.denied) and self.requests < _MAX_REQUESTS


class _UnusedStream(_Stream):
    """One message that is not read: asked down once, and back once where somebody misses it."""

    __slots__ = ("given_back", "heard_hz")

    def __init__(self, now_s: float) -> None:
        super().__init__(_UNUSED_HZ, float("inf"), now_s)
        self.window_s = _UNUSED_WINDOW_S
        self.window_end_s = now_s + self.window_s
        self.heard_hz = 0.0
        self.given_back = False

    def judge(self, now_s: float) -> None:
        """At the end of a window: whether the message comes as often as it should."""
        if now_s < self.window_end_s:
            return
        heard_hz = self.count / self.window_s
        if not self.asked_down:
            self.heard_hz = heard_hz
        if self.given_back:
            self.low = heard_hz < _ENOUGH * self.rate_hz
        else:
            self.low = heard_hz > _UNUSED_MOST_HZ
        if self.requests and not self.low:
            # Done, though the answer was lost; whoever changes it after that has a reason.
            self.settled = True
        if self.requests == _MAX_REQUESTS and now_s >= self.requested_s + _AGAIN_S:
            self.requests = 0
        self.count = 0
        self.window_end_s = now_s + self.window_s

    @property
    def asked_down(self) -> bool:
        """Whether it was ever asked for at the lower rate."""
        return self.requested_s > -math.inf

    def give_back(self) -> None:
        """From now on it is wanted as it came before it was asked down, if it was."""
        if self.asked_down and not self.given_back:
            self.given_back = self.low = True
            self.rate_hz = self.heard_hz
            self.requests = 0
            self.settled = False


@dataclass(frozen=True, slots=True, kw_only=True)
class _Asked:
    """One request that was sent. rate_hz: what was asked for; the stream's may be another since."""

    sent_s: float
    stream: _Stream
    rate_hz: float


class RateRequests:
    """Requests each wanted message until it flows, is acknowledged or denied.

    Three times in a row, and then again after a pause. A message that does not flow is asked for
    again whatever was answered, after a denial seldom.
    """

    def __init__(self) -> None:
        self._streams: dict[int, _Stream] = {}
        self._unused: dict[tuple[str, int], _UnusedStream] = {}
        """By link and message id."""
        self._under_way = False
        self._asked: list[_Asked] = []
        """Whose answer may still come, the oldest first."""
        self._sent_s = -1.0

    def start(self, rates_hz: Mapping[int, float], *, silent: bool, now_s: float) -> None:
        """An autopilot was found or restarted; silent: it sends nothing unasked, so ask at once."""
        first_window_s = 0.0 if silent else float("inf")
        self._streams = {
            message_id: _Stream(rate_hz, first_window_s, now_s)
            for message_id, rate_hz in rates_hz.items()
            if rate_hz > 0.0
        }
        self._unused = {}
        self._under_way = False
        self._asked = []
        self._sent_s = now_s - _SPACING_S

    def hear(self, message_id: int) -> None:
        """Counts a message of the autopilot."""
        stream = self._streams.get(message_id)
        if stream is not None:
            stream.count += 1

    def hear_unused(self, message_id: int, link: str, now_s: float) -> None:
        """Counts a message of the autopilot that is not read, on the link on which it came."""
        stream = self._unused.get((link, message_id))
        if stream is None:
            stream = self._unused[link, message_id] = _UnusedStream(now_s)
        stream.count += 1

    def answered(self, result: int) -> None:
        """Takes the result of COMMAND_ACK for MAV_CMD_SET_MESSAGE_INTERVAL.

        It does not say what it answers: while it may be that of several requests, it counts for
        none.
        """
        self._under_way = False
        if len({(id(asked.stream), asked.rate_hz) for asked in self._asked}) != 1:
            return
        asked = self._asked.pop(0)
        stream = asked.stream
        if asked.rate_hz != stream.rate_hz:
            return
        if result == CommandResult.ACCEPTED:
            # PX4 accepts what it has no data for, too; more requests would not change that.
            stream.settled = True
        elif result not in {CommandResult.TEMPORARILY_REJECTED, CommandResult.IN_PROGRESS}:
            stream.denied = True

    def next_request(
        self, now_s: float, link: str = "", *, shared: bool = True
    ) -> tuple[int, float] | None:
        """The message to ask for now and its interval in µs; at most one per call.

        link: the autopilot's. shared: somebody else may read it, too.
        """
        streams: dict[int, _Stream] = {**self._streams}
        for (heard_on, message_id), unused in self._unused.items():
            if heard_on == link and message_id not in streams:
                if shared:
                    unused.give_back()
                if unused.given_back or not shared:
                    streams[message_id] = unused
        for stream in streams.values():
            stream.judge(now_s)
        waited_s = now_s - self._sent_s
        if waited_s < (_ACK_TIMEOUT_S if self._under_way else _SPACING_S):
            return None
        self._under_way = False
        self._asked = [a for a in self._asked if now_s < a.sent_s + _ANSWER_MAX_AGE_S]
        wanting = [item for item in streams.items() if item[1].wanting]
        if not wanting:
            return None
        # Those asked least often first, so that a lost answer holds up nothing else.
        message_id, stream = min(wanting, key=lambda item: item[1].requests)
        stream.requests += 1
        stream.requested_s = now_s
        self._under_way = True
        self._asked.append(_Asked(sent_s=now_s, stream=stream, rate_hz=stream.rate_hz))
        self._sent_s = now_s
        return message_id, round(1e6 / stream.rate_hz)
