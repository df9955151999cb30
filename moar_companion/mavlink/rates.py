"""Which messages are wanted how often, and asking for those that come too seldom. No I/O.

PX4 sends most of it by itself; ArduPilot sends heartbeats only, and forgets what was requested
when it restarts. MAV_CMD_SET_MESSAGE_INTERVAL's acknowledgement does not name the message, so one
request is under way at a time.
"""

from __future__ import annotations

from collections.abc import Mapping

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
        CURRENT_MODE_ID: 10.0,
    },
    AutopilotKind.ARDUPILOT: {
        **_COMMON_RATES_HZ,
        mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 1.0,
        mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: 2.0,
        mavlink.MAVLINK_MSG_ID_WIND: 2.0,
        mavlink.MAVLINK_MSG_ID_RAW_IMU: 2.0,
        mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: 0.2,
        mavlink.MAVLINK_MSG_ID_HEARTBEAT: 5.0,
    },
    AutopilotKind.UNKNOWN: _COMMON_RATES_HZ,
}
"""By autopilot, then by message id. PX4's own rates where those do, so that nothing is asked of a
slow link; what an autopilot is known to deny is left out. The mode is asked for more often than
the 1 Hz at which both tell it: a takeover is to show within 0.2 s, though packets are lost. PX4
refuses another rate of its heartbeat, and accepts one of CURRENT_MODE."""

_ENOUGH = 0.8
"""Of the wanted rate: an autopilot's scheduler rounds, and a window cuts."""
_MIN_WINDOW_S = 2.0
_WINDOW_PERIODS = 2.5
"""A rate is judged over so many of its wanted periods, at least."""
_ACK_TIMEOUT_S = 0.5
"""Both autopilots acknowledge within 10 ms, a link may delay each way by 0.2 s."""
_SPACING_S = 0.02
"""Between requests: at most five in 100 ms."""
_MAX_REQUESTS = 3
_AGAIN_S = 10.0
"""A link may have lost so many requests, or their answers: one in seven loses them all three where
it loses 30 % each way. Then another round begins."""


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
        self.requested_s = 0.0
        self.settled = False
        self.denied = False

    def judge(self, now_s: float) -> None:
        """At the end of a window: whether the message comes often enough."""
        if now_s < self.window_end_s:
            return
        self.low = self.count < _ENOUGH * self.rate_hz * self.window_s
        stopped = self.flowing and self.count == 0
        unanswered = self.requests == _MAX_REQUESTS and not self.settled
        lost = unanswered and now_s >= self.requested_s + _AGAIN_S
        if not self.low or stopped or lost:
            self.requests = 0
            self.settled = False
        self.flowing = self.count > 0
        self.count = 0
        self.window_end_s = now_s + self.window_s

    @property
    def wanting(self) -> bool:
        """Whether another request may help."""
        return self.low and not (self.settled or self.denied) and self.requests < _MAX_REQUESTS


class RateRequests:
    """Requests each wanted message until it flows, is acknowledged or denied.

    Three times in a row, and then again after a pause. A message that flowed and stops is asked
    for again; denials hold until the autopilot restarts.
    """

    def __init__(self) -> None:
        self._streams: dict[int, _Stream] = {}
        self._under_way: int | None = None
        self._sent_s = -1.0

    def start(self, rates_hz: Mapping[int, float], *, silent: bool, now_s: float) -> None:
        """An autopilot was found or restarted; silent: it sends nothing unasked, so ask at once."""
        first_window_s = 0.0 if silent else float("inf")
        self._streams = {
            message_id: _Stream(rate_hz, first_window_s, now_s)
            for message_id, rate_hz in rates_hz.items()
            if rate_hz > 0.0
        }
        self._under_way = None
        self._sent_s = now_s - _SPACING_S

    def hear(self, message_id: int) -> None:
        """Counts a message of the autopilot."""
        stream = self._streams.get(message_id)
        if stream is not None:
            stream.count += 1

    def answered(self, result: int) -> None:
        """Takes the result of COMMAND_ACK for MAV_CMD_SET_MESSAGE_INTERVAL."""
        if self._under_way is None:
            return
        stream = self._streams[self._under_way]
        self._under_way = None
        if result == CommandResult.ACCEPTED:
            # PX4 accepts what it has no data for, too; more requests would not change that.
            stream.settled = True
        elif result not in {CommandResult.TEMPORARILY_REJECTED, CommandResult.IN_PROGRESS}:
            stream.denied = True

    def next_request(self, now_s: float) -> tuple[int, float] | None:
        """The message to ask for now and its interval in µs; at most one per call."""
        for stream in self._streams.values():
            stream.judge(now_s)
        waited_s = now_s - self._sent_s
        if waited_s < (_SPACING_S if self._under_way is None else _ACK_TIMEOUT_S):
            return None
        self._under_way = None
        wanting = [item for item in self._streams.items() if item[1].wanting]
        if not wanting:
            return None
        # Those asked least often first, so that a lost answer holds up nothing else.
        message_id, stream = min(wanting, key=lambda item: item[1].requests)
        stream.requests += 1
        stream.requested_s = now_s
        self._under_way = message_id
        self._sent_s = now_s
        return message_id, round(1e6 / stream.rate_hz)
