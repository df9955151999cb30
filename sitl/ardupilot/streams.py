"""Rates of the messages on one link: only requested messages are sent.

As measured on ArduCopter 4.6.3: SET_MESSAGE_INTERVAL is accepted for every message it can stream,
with or without such data; for the others it is denied. Rates were exact from 0.5 to 200 Hz there;
here the clock ticks at 100 Hz, and no message is sent more often.
"""

from typing import Final

from sitl.wire import layout
from sitl.world import TICK_US

ACCEPTED: Final = 0
DENIED: Final = 2
OFF: Final = -1
_HEARTBEAT_US: Final = 1_000_000
_TIMESYNC_US: Final = 10_000_000
_OWN: Final = {"HEARTBEAT": _HEARTBEAT_US, "TIMESYNC": _TIMESYNC_US}
FIRST_PACKETS_US: Final = 1_040_000
"""Time from a start to the first heartbeat."""
_FIRST_TIMESYNC_US: Final = 10_000_000
STREAMS: Final[dict[int, tuple[str, ...]]] = {
    1: ("RAW_IMU", "SCALED_IMU2", "SCALED_IMU3", "SCALED_PRESSURE", "SCALED_PRESSURE2"),
    2: ("SYS_STATUS", "POWER_STATUS", "MEMINFO", "MISSION_CURRENT", "GPS_RAW_INT", "GPS2_RAW",
        "NAV_CONTROLLER_OUTPUT", "FENCE_STATUS", "POSITION_TARGET_GLOBAL_INT"),
    3: ("SERVO_OUTPUT_RAW", "RC_CHANNELS"),
    6: ("GLOBAL_POSITION_INT", "LOCAL_POSITION_NED"),
    10: ("ATTITUDE", "SIMSTATE", "AHRS2"),
    11: ("VFR_HUD",),
    12: ("AHRS", "SYSTEM_TIME", "WIND", "TERRAIN_REPORT", "BATTERY_STATUS", "EKF_STATUS_REPORT",
         "VIBRATION", "ESC_TELEMETRY_1_TO_4", "GENERATOR_STATUS"),
}  # fmt: skip
"""REQUEST_DATA_STREAM's groups (MAV_DATA_STREAM); 0 means all of them."""
_SLOWER: Final = ((20, 60_000), (50, 20_000))
_FASTER: Final = ((95, 40_000), (90, 20_000))
_SLOWEST_US: Final = 2_000_000
"""Per RADIO_STATUS: change of the interval below or above a percentage of free buffer."""
_BY_INTERVAL_ONLY: Final = (
    "HEARTBEAT", "ATTITUDE_QUATERNION", "ATTITUDE_TARGET", "AUTOPILOT_VERSION",
    "EXTENDED_SYS_STATE", "GPS_GLOBAL_ORIGIN", "HIGH_LATENCY2", "HOME_POSITION",
    "POSITION_TARGET_LOCAL_NED", "RC_CHANNELS_SCALED",
)  # fmt: skip
IDS: Final = {
    layout(name).msgid: name for names in (*STREAMS.values(), _BY_INTERVAL_ONLY) for name in names
}


class Schedule:
    """The due times of one link."""

    def __init__(self, boot_us: int) -> None:
        """Start with the heartbeat, and the request for the peer's time."""
        self._intervals = dict(_OWN)
        self.slowdown_us = 0
        """Addition to every requested interval, for a radio with a full buffer."""
        self._due = {
            "HEARTBEAT": boot_us + FIRST_PACKETS_US,
            "TIMESYNC": boot_us + _FIRST_TIMESYNC_US,
        }

    def set(self, msgid: int, interval_us: int, now_us: int) -> int:
        """Set an interval (0 the default, below 0 off); return the MAV_RESULT."""
        name = IDS.get(msgid)
        if name is None:
            return DENIED
        if interval_us == 0 and name == "HEARTBEAT":
            interval_us = _HEARTBEAT_US
        self._set(name, interval_us, now_us)
        return ACCEPTED

    def interval_us(self, msgid: int) -> int:
        """Return the value of MESSAGE_INTERVAL: -1 not sent now, 0 never sent."""
        name = IDS.get(msgid)
        return 0 if name is None else self._intervals.get(name, OFF)

    def set_stream(self, stream_id: int, rate_hz: int, now_us: int) -> None:
        """Set the rate of a group of messages, 0 off; unknown groups are ignored."""
        chosen = STREAMS if stream_id == 0 else {stream_id} & STREAMS.keys()
        interval_us = round(1e6 / rate_hz) if rate_hz > 0 else OFF
        for group in chosen:
            for name in STREAMS[group]:
                self._set(name, interval_us, now_us)

    def handle_radio(self, txbuf_percent: int) -> None:
        """Slow down or speed up by the free buffer of a radio."""
        for below, change_us in _SLOWER:
            if txbuf_percent < below:
                self.slowdown_us = min(_SLOWEST_US, self.slowdown_us + change_us)
                return
        for above, change_us in _FASTER:
            if txbuf_percent > above:
                self.slowdown_us = max(0, self.slowdown_us - change_us)
                return

    def due(self, now_us: int) -> list[str]:
        """Return the names that are due, and plan their next time."""
        names = [name for name, at in self._due.items() if at <= now_us]
        for name in names:
            interval_us = self._intervals[name] + (0 if name in _OWN else self.slowdown_us)
            following = self._due[name] + max(interval_us, TICK_US)
            self._due[name] = following if following > now_us else now_us + TICK_US
        return names

    def _set(self, name: str, interval_us: int, now_us: int) -> None:
        if interval_us > 0:
            self._intervals[name] = interval_us
            self._due[name] = now_us + interval_us
        else:
            self._intervals.pop(name, None)
            self._due.pop(name, None)
