"""Present conditions of the world: wind, satellites, battery faults, radio.

One mutable object that scenarios, SIM_ parameters and tests write while the simulation runs.
"""

import math
import random
from dataclasses import dataclass
from typing import Final

GPS_NORMAL: Final = 0
GPS_NO_FIX: Final = 1
GPS_SILENT: Final = 2
GPS_JAMMED: Final = 3
GPS_MODES: Final = ("normal", "no_fix", "silent", "jammed")
MIN_SATELLITES_FOR_FIX: Final = 4
"""Number of satellites below which the receiver has no fix (measured on PX4 v1.17.0: 4 hold, 3 do
not)."""
_GUST_TIME_S: Final = 3.0
_GUST_PERIOD_S: Final = 0.05


@dataclass(slots=True, kw_only=True)
class Conditions:
    """The state of the world outside the aircraft.

    wind_from_deg: direction the wind comes from (compass); gust_mps: standard deviation of the
    gusts along the wind. gps_mode: GPS_NORMAL, GPS_NO_FIX, GPS_SILENT, GPS_JAMMED. radio_rssi is
    None on an IP link, which has no radio. battery_percent, once set, replaces the charge at the
    next step; battery_voltage_v replaces the voltage alone, until it is None again.
    heading_error_deg: of the autopilot's estimate, which controls by it.
    drag_per_s, once set, replaces the airframe's linear drag.
    Onboard links take link_delay_ms and for each packet up to link_jitter_ms more, each way: those
    that take less overtake. link_rate_bytes_per_s is the rate that PX4 assumes for its onboard
    links; None: no limit.
    """

    wind_mps: float = 0.0
    wind_from_deg: float = 0.0
    wind_up_mps: float = 0.0
    drag_per_s: float | None = None
    heading_error_deg: float = 0.0
    gust_mps: float = 0.0
    satellites: int = 10
    hdop: float = 0.7
    vdop: float = 1.1
    gps_mode: int = GPS_NORMAL
    gps_noise_factor: float = 1.0
    battery_percent: float | None = None
    battery_voltage_v: float | None = None
    drain_factor: float = 1.0
    radio_rssi: float | None = None
    radio_remote_rssi: float | None = None
    radio_noise: float = 45.0
    link_loss_percent: float = 0.0
    link_delay_ms: float = 0.0
    link_jitter_ms: float = 0.0
    link_rate_bytes_per_s: float | None = None

    def has_fix(self) -> bool:
        """Return True if the GPS receiver can compute a position."""
        return self.gps_mode == GPS_NORMAL and self.satellites >= MIN_SATELLITES_FOR_FIX


class Wind:
    """Mean wind plus gusts: a first-order Gauss-Markov process along, across and up."""

    __slots__ = ("_across", "_along", "_decay", "_next_s", "_random", "_spread", "_up", "ned_mps")

    def __init__(self, generator: random.Random) -> None:
        """Start in still air."""
        self._random = generator
        self._along = self._across = self._up = 0.0
        self._next_s = 0.0
        self._decay = math.exp(-_GUST_PERIOD_S / _GUST_TIME_S)
        self._spread = math.sqrt(1.0 - self._decay**2)
        self.ned_mps = (0.0, 0.0, 0.0)

    def step(self, now_s: float, conditions: Conditions) -> None:
        """Update the air's velocity (m/s north, east, down) 20 times a second."""
        if now_s < self._next_s:
            return
        self._next_s = now_s + _GUST_PERIOD_S
        gust = conditions.gust_mps * self._spread
        if gust > 0.0:
            gauss = self._random.gauss
            self._along = self._along * self._decay + gauss(0.0, gust)
            self._across = self._across * self._decay + gauss(0.0, 0.6 * gust)
            self._up = self._up * self._decay + gauss(0.0, 0.3 * gust)
        else:
            self._along *= self._decay
            self._across *= self._decay
            self._up *= self._decay
        to_rad = math.radians(conditions.wind_from_deg) + math.pi
        cos_to, sin_to = math.cos(to_rad), math.sin(to_rad)
        along = conditions.wind_mps + self._along
        self.ned_mps = (
            along * cos_to - self._across * sin_to,
            along * sin_to + self._across * cos_to,
            0.0 - conditions.wind_up_mps - self._up,
        )
