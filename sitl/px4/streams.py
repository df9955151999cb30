"""Rates of the messages on each link.

Intervals in microseconds, as measured on PX4 v1.17.0: the onboard profile for companions, the
normal profile for ground stations. SET_MESSAGE_INTERVAL is accepted for every name in `KNOWN`, even
where there is no data to send, and fails for the others. A slow link stretches all intervals except
the heartbeat's, those of requested messages, too.
"""

from typing import Final

from sitl.wire import Layout, layout
from sitl.world import TICK_US

_HZ: Final = 1_000_000
OFF: Final = -1
ONBOARD: Final[dict[str, int]] = {
    "HEARTBEAT": _HZ, "SYS_STATUS": 200_000, "SYSTEM_TIME": _HZ, "PING": _HZ,
    "LINK_NODE_STATUS": _HZ, "SCALED_PRESSURE": _HZ, "ATTITUDE": 10_000,
    "ATTITUDE_QUATERNION": 20_000, "LOCAL_POSITION_NED": 33_333, "GLOBAL_POSITION_INT": 20_000,
    "SERVO_OUTPUT_RAW": 100_000, "MISSION_CURRENT": _HZ, "VFR_HUD": 100_000,
    "ATTITUDE_TARGET": 100_000, "POSITION_TARGET_GLOBAL_INT": 100_000,
    "POSITION_TARGET_LOCAL_NED": 100_000, "HIGHRES_IMU": 20_000,
    "TIMESYNC": 100_000, "DISTANCE_SENSOR": 100_000, "ALTITUDE": 100_000,
    "BATTERY_STATUS": 2_000_000, "ESTIMATOR_STATUS": _HZ, "VIBRATION": 2_000_000,
    "HOME_POSITION": 2_000_000, "EXTENDED_SYS_STATE": 200_000, "ODOMETRY": 33_333,
    "TIME_ESTIMATE_TO_TARGET": 2_000_000, "CURRENT_EVENT_SEQUENCE": 3_000_000,
    "CURRENT_MODE": 2_000_000, "GNSS_INTEGRITY": _HZ, "OPEN_DRONE_ID_LOCATION": _HZ,
    "OPEN_DRONE_ID_SYSTEM": _HZ, "WIND_COV": 100_000, "RC_CHANNELS": 50_000,
    "ESC_STATUS": 100_000, "RAW_RPM": 200_000, "STATUSTEXT": 50_000,
}  # fmt: skip
NORMAL: Final[dict[str, int]] = {
    "HEARTBEAT": _HZ, "SYS_STATUS": _HZ, "PING": 10 * _HZ, "LINK_NODE_STATUS": _HZ,
    "GPS_RAW_INT": 200_000, "SCALED_PRESSURE": _HZ, "ATTITUDE": 20_000,
    "ATTITUDE_QUATERNION": 20_000, "LOCAL_POSITION_NED": 20_000, "GLOBAL_POSITION_INT": 20_000,
    "SERVO_OUTPUT_RAW": 22_000, "MISSION_CURRENT": _HZ, "VFR_HUD": 250_000,
    "ATTITUDE_TARGET": 22_000, "POSITION_TARGET_GLOBAL_INT": _HZ,
    "POSITION_TARGET_LOCAL_NED": 22_000,
    "DISTANCE_SENSOR": 2_000_000, "ALTITUDE": _HZ, "BATTERY_STATUS": 2_000_000,
    "ESTIMATOR_STATUS": 2_000_000, "VIBRATION": 10 * _HZ, "HOME_POSITION": 2_000_000,
    "EXTENDED_SYS_STATE": _HZ, "TIME_ESTIMATE_TO_TARGET": 2_000_000,
    "CURRENT_EVENT_SEQUENCE": 3_000_000, "CURRENT_MODE": 2_000_000, "GNSS_INTEGRITY": _HZ,
    "OPEN_DRONE_ID_LOCATION": _HZ, "OPEN_DRONE_ID_SYSTEM": _HZ, "WIND_COV": _HZ,
    "RC_CHANNELS": 200_000, "ESC_STATUS": _HZ, "RAW_RPM": _HZ, "STATUSTEXT": 50_000,
}  # fmt: skip
PROFILES: Final = {"onboard": ONBOARD, "normal": NORMAL}
ON_REQUEST: Final = ("GPS_RAW_INT", "ACTUATOR_OUTPUT_STATUS", "AUTOPILOT_VERSION", "SCALED_IMU")
UNLIMITED: Final = {"onboard": ("GPS_RAW_INT",), "normal": ()}
"""Sent with every new datum unless an interval is set; their interval reads -1."""
_FIXED: Final = frozenset({"HEARTBEAT", "PING", "CURRENT_EVENT_SEQUENCE"})
KNOWN: Final = frozenset({*ONBOARD, *NORMAL, *ON_REQUEST}) - _FIXED
_FRAME_BYTES: Final = 12
_LEAST_SHARE: Final = 0.05
"""Least share of the rates, for any slow link."""
_ESC_STATUS_ID: Final = 291
_RAW_RPM_ID: Final = 339
IDS: Final = {layout(name).msgid: name for name in (KNOWN | _FIXED) - {"ESC_STATUS", "RAW_RPM"}} | {
    _ESC_STATUS_ID: "ESC_STATUS",
    _RAW_RPM_ID: "RAW_RPM",
}
START_US: Final[dict[str, int]] = {
    "HEARTBEAT": 900_000, "SYSTEM_TIME": 900_000, "PING": 900_000,
    "LINK_NODE_STATUS": 900_000, "SCALED_PRESSURE": 900_000, "ESTIMATOR_STATUS": 900_000,
    "GNSS_INTEGRITY": 900_000, "OPEN_DRONE_ID_LOCATION": 900_000,
    "OPEN_DRONE_ID_SYSTEM": 900_000, "MISSION_CURRENT": 1_000_000, "ATTITUDE": 1_590_000,
    "ATTITUDE_QUATERNION": 1_590_000, "BATTERY_STATUS": 2_200_000, "VIBRATION": 2_200_000,
    "HOME_POSITION": 2_200_000, "CURRENT_MODE": 2_200_000, "TIME_ESTIMATE_TO_TARGET": 2_000_000,
    "GLOBAL_POSITION_INT": 2_700_000,
}  # fmt: skip
"""Time after boot at which a message first appears; the others at the first packets."""
FIRST_PACKETS_US: Final = 300_000
_PHASE_US: Final = {"onboard": 0, "normal": 400_000}
"""Delay of a profile's first heartbeat: those of two links are out of phase."""


class Schedule:
    """The due times of one link."""

    def __init__(self, profile: str, boot_us: int) -> None:
        """Use a profile's intervals."""
        self._default = PROFILES[profile]
        self._unlimited = UNLIMITED[profile]
        self.intervals = dict(self._default)
        self._sizes: dict[str, int] = {}
        self._due = {
            name: boot_us + max(FIRST_PACKETS_US, START_US.get(name, 0)) for name in self._default
        }
        self._due["HEARTBEAT"] += _PHASE_US[profile]

    def interval_us(self, msgid: int) -> int:
        """Return the answer to GET_MESSAGE_INTERVAL: -1 when there is none."""
        return self.intervals.get(IDS.get(msgid, ""), OFF)

    def set(self, msgid: int, interval_us: int, now_us: int) -> bool:
        """Set an interval (0 default, -1 off); False where PX4 fails."""
        name = IDS.get(msgid)
        if name is None or name not in KNOWN:
            return False
        if interval_us == 0:
            interval_us = self._default.get(name, OFF)
            if name in self._unlimited:
                self.intervals.pop(name, None)
                self._due.pop(name, None)
                return True
        if interval_us < 0:
            self.intervals[name] = OFF
            self._due.pop(name, None)
            return True
        self.intervals[name] = interval_us
        self._due[name] = now_us
        return True

    def unlimited(self, name: str) -> bool:
        """Return True if a message is sent with every new datum."""
        return name in self._unlimited and name not in self.intervals

    def sent(self, kind: Layout) -> None:
        """Note a message that has data."""
        self._sizes[kind.name] = kind.packer.size + _FRAME_BYTES

    def due(self, now_us: int, rate_bytes_per_s: float | None = None) -> list[str]:
        """Return the names that are due, and plan their next time, with all rates at their full.

        `rate_bytes_per_s`: capacity of the link; None: no limit.
        """
        share = 1.0 if rate_bytes_per_s is None else self._share(rate_bytes_per_s)
        names = [
            name for name, at in self._due.items() if at + self._delay_us(name, share) <= now_us
        ]
        for name in names:
            following = self._due[name] + max(
                self.intervals[name] + self._delay_us(name, share), TICK_US
            )
            self._due[name] = following if following > now_us else now_us + TICK_US
        return names

    def _delay_us(self, name: str, share: float) -> int:
        """Return the addition to an interval with the present factor of the rates."""
        if share == 1.0 or name == "HEARTBEAT":
            return 0
        return round(self.intervals[name] * (1.0 / share - 1.0))

    def _share(self, rate_bytes_per_s: float) -> float:
        """Return the factor by which PX4 lowers the rates, so that the link carries them."""
        wanted = {
            name: size * 1e6 / self.intervals[name]
            for name, size in self._sizes.items()
            if self.intervals.get(name, OFF) > 0
        }
        beats = wanted.pop("HEARTBEAT", 0.0)
        share = (rate_bytes_per_s - beats) / max(1.0, sum(wanted.values()))
        return min(1.0, max(_LEAST_SHARE, share))
