"""The GPS receiver as ArduPilot shows it, five times a second.

The receiver's data come from the world's estimator. Measured on ArduCopter 4.6.3 in its own
simulator: the receiver is found 9.8 s after the start. Without a fix, accuracy and time stay at
their last good values while the position changes. A silent receiver's last data are repeated for 4
s, and its health is lost after 8 s. Under jamming satellites and accuracy jump while the dilution
stays.
"""

from dataclasses import replace
from typing import Final

from sitl.ardupilot.parameters import USES_GPS_AFTER_S
from sitl.conditions import GPS_JAMMED, MIN_SATELLITES_FOR_FIX
from sitl.position_estimate import GpsFix
from sitl.world import World

_DETECTED_S: Final = 9.8
_FIRST_FIX_S: Final = 9.95
"""In a start of the usual length, SIM_BOOT_S."""
_PERIOD_US: Final = 200_000
_REPEATS_S: Final = 4.0
_HEALTHY_S: Final = 8.0
_SATELLITES_WITHOUT_FIX: Final = 3
_BEST_HDOP, _BEST_VDOP, _BEST_ACCURACY_M = 1.21, 2.0, 0.3
_JAMMED_ACCURACY_M: Final = 20.0


class Receiver:
    """Keeps the last data of the receiver, and the time of the last fix."""

    __slots__ = (
        "_boot_us",
        "_detected_us",
        "_next_us",
        "_received_us",
        "_world",
        "fix_us",
        "shown",
    )

    def __init__(self, world: World, boot_us: int, boot_s: float) -> None:
        """Start without data; `boot_s` is the time of this start until GPS is used."""
        pace = boot_s / USES_GPS_AFTER_S
        self._world = world
        self._boot_us = boot_us
        self._detected_us = boot_us + round(pace * _DETECTED_S * 1e6)
        self._next_us = boot_us + round(pace * _FIRST_FIX_S * 1e6)
        self._received_us: int | None = None
        self.shown: GpsFix | None = None
        """The last data; `fix_type` 0 where there is no fix."""
        self.fix_us = 0
        """Time of the last fix, since the start; 0 before the first."""

    def step(self) -> None:
        """Read the receiver, if it is time."""
        now_us, latest = self._world.now_us, self._world.estimator.fix
        if now_us < self._next_us:
            return
        self._next_us = now_us + _PERIOD_US
        if latest is None or not latest.alive:
            return
        self._received_us = now_us
        if self.shown is not None and self._world.conditions.gps_mode == GPS_JAMMED:
            self.shown = self._jammed(self.shown)
        elif self.shown is not None and not latest.fix_type:
            self.shown = replace(
                self.shown,
                fix_type=0,
                satellites=min(latest.satellites or 0, _SATELLITES_WITHOUT_FIX),
                latitude_deg=latest.latitude_deg,
                longitude_deg=latest.longitude_deg,
                altitude_m=latest.altitude_m,
                velocity_ned_mps=latest.velocity_ned_mps,
            )
        else:
            self.shown = _graded(latest)
        if self.shown.fix_type:
            self.fix_us = (now_us - self._boot_us) // 1000 * 1000

    def _jammed(self, shown: GpsFix) -> GpsFix:
        generator = self._world.random
        satellites = generator.randint(0, 12)
        return replace(
            shown,
            fix_type=3 if satellites >= MIN_SATELLITES_FOR_FIX else 0,
            satellites=satellites,
            h_acc_m=generator.uniform(_BEST_ACCURACY_M, _JAMMED_ACCURACY_M),
        )

    @property
    def detected(self) -> bool:
        """True once there is a receiver."""
        return self._world.now_us >= self._detected_us

    @property
    def reports(self) -> bool:
        """True while its last data still count."""
        return self._silence_s < _REPEATS_S

    @property
    def healthy(self) -> bool:
        """True while SYS_STATUS reports it healthy; a receiver without a fix is healthy."""
        return self._silence_s < _HEALTHY_S

    @property
    def _silence_s(self) -> float:
        if self._received_us is None:
            return _HEALTHY_S
        return (self._world.now_us - self._received_us) / 1e6


def _graded(latest: GpsFix) -> GpsFix:
    """Return the fix with the grades of ArduPilot's simulated receiver, never better than its."""
    hdop, vdop = max(latest.hdop or 0.0, _BEST_HDOP), max(latest.vdop or 0.0, _BEST_VDOP)
    return replace(
        latest,
        hdop=hdop,
        vdop=vdop,
        h_acc_m=_BEST_ACCURACY_M * hdop / _BEST_HDOP,
        v_acc_m=_BEST_ACCURACY_M * vdop / _BEST_VDOP,
    )
