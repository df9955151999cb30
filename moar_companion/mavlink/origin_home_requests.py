"""Requests of the autopilot's local origin and home until it reports them. No I/O."""

from __future__ import annotations

import math

from .dialect import mavlink
from .telemetry import Telemetry

_ORIGIN = int(mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN)
_HOME = int(mavlink.MAVLINK_MSG_ID_HOME_POSITION)

_ORIGIN_PERIOD_S = 5.0
"""Period of origin requests: estimators may move it in flight; PX4 reports it unasked only once."""
_UNKNOWN_PERIOD_S = 2.0
"""Period of requests of an origin or a home that the autopilot has not reported."""


class OriginHomeRequests:
    """Requests the origin continuously, and home until it is known; from the first call on."""

    def __init__(self) -> None:
        self._origin_requested_s = -math.inf
        self._home_requested_s = -math.inf

    def next_request(self, telemetry: Telemetry, now_s: float) -> int | None:
        """Message to request now with MAV_CMD_REQUEST_MESSAGE; at most one per call."""
        origin = telemetry.local_origin
        if origin is None:
            origin_due_s = self._origin_requested_s + _UNKNOWN_PERIOD_S
        else:
            origin_due_s = max(self._origin_requested_s, origin.received_s) + _ORIGIN_PERIOD_S
        if now_s >= origin_due_s:
            self._origin_requested_s = now_s
            return _ORIGIN
        if telemetry.home is None and now_s >= self._home_requested_s + _UNKNOWN_PERIOD_S:
            self._home_requested_s = now_s
            return _HOME
        return None
