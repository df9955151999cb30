"""ArduPilot's estimator by its messages: origin, position, home, flags, wind.

Inputs: the world's estimate and the time since the start. Outputs: the local frame about the EKF
origin, and the known values over time. Times as measured on ArduCopter 4.6.3; those of the start
are shortened in proportion by SIM_BOOT_S.
"""

import math
from typing import Final

from sitl.ardupilot import texts
from sitl.ardupilot.parameters import USES_GPS_AFTER_S
from sitl.conditions import GPS_JAMMED
from sitl.geodesy import FlatProjection
from sitl.parameters import Parameters
from sitl.position_estimate import Estimator
from sitl.world import TICK_S, World

_SETTLED_AFTER_S: Final = 18.0
_ORIGIN_AFTER_S: Final = 20.0
_START_FLAGS: Final = ((5.5, 0x0400), (5.9, 0x0000))
"""Time after the start with these flags: not initialised, not aligned."""
_BEFORE_GPS_FLAGS: Final = 0x00A7
_GOOD_FLAGS: Final = 0x033F
_COASTING_FLAGS: Final = 0x0025
_JAMMED_FLAGS: Final = 0x8027
_COAST_S: Final = 7.9
"""Time from the last fix to flags 0x25; the failsafe acts a moment later."""
_JAMMED_S: Final = 5.9
_DEAD_RECKONING_S: Final = 10.0
"""EKF3's posRetryTimeUseVel_ms: drag aids the velocity."""
_DEAD_RECKONING_FLAGS: Final = 0x012F
"""A relative position, and no absolute one."""
_NO_AIDING_S: Final = 15.1
_WIND_TIME_S: Final = 4.0
_WIND_STUCK_S: Final = 20.0
_WIND_ERROR_NE_MPS: Final = (0.08, -0.10)
"""Error of the estimate in calm, as recorded; 0 would mean unknown."""
_ALIGNS_ABOVE_M: Final = 2.5


class Navigation:
    """Local position x, y, z (north, east, down of the EKF origin) as ArduPilot estimates it."""

    def __init__(
        self, world: World, parameters: Parameters, text_sender: texts.TextSender, boot_us: int
    ) -> None:
        """Start without an estimate."""
        self._world = world
        self._parameters = parameters
        self._text_sender = text_sender
        self._boot_us = boot_us
        self._boot_scale = parameters.value("SIM_BOOT_S") / USES_GPS_AFTER_S
        self._projection: FlatProjection | None = None
        self._origin_altitude_m = 0.0
        self.x = self.y = self.z = 0.0
        self.home: tuple[float, float, float] | None = None
        self.home_changed = False
        """True: home was set and is not reported yet."""
        self.position_known = False
        self._aligned_in_flight = False
        self._lost_s = 0.0
        self._wind_ne = (0.0, 0.0)
        self._wind_stuck_s = 0.0

    @property
    def estimator(self) -> Estimator:
        """The estimate in degrees and metres."""
        return self._world.estimator

    @property
    def since_boot_s(self) -> float:
        """Time since the autopilot started."""
        return (self._world.now_us - self._boot_us) / 1e6

    @property
    def origin(self) -> tuple[float, float, float] | None:
        """Latitude, longitude (degrees) and altitude (metres AMSL) of the EKF origin."""
        if self._projection is None:
            return None
        return (
            self._projection.latitude_deg,
            self._projection.longitude_deg,
            self._origin_altitude_m,
        )

    def update(self) -> None:
        """Take the newest estimate; once per tick."""
        estimator = self.estimator
        self._lost_s = self._lost_s + TICK_S if estimator.lost_s > 0.0 else 0.0
        if self._projection is None and self.since_boot_s >= _ORIGIN_AFTER_S * self._boot_scale:
            self._set_origin()
        known = self._uses_gps()
        if known and not self.position_known:
            for number in (0, 1):
                self._text_sender.send(texts.INFO, f"EKF3 IMU{number} is using GPS")
        elif self.position_known and not known:
            for number in (0, 1):
                self._text_sender.send(texts.WARNING, f"EKF3 IMU{number} stopped aiding")
        self.position_known = known
        if self._projection is not None:
            self.z = self._origin_altitude_m - estimator.altitude_m
            if known:
                self.x, self.y = self._projection.project(
                    estimator.latitude_deg, estimator.longitude_deg
                )
        self._align_in_flight()
        self._estimate_wind()

    def set_home(self) -> None:
        """Make the present position home, as at arming."""
        estimator = self.estimator
        self.home = (estimator.latitude_deg, estimator.longitude_deg, estimator.altitude_m)
        self.home_changed = True

    def home_ned_m(self) -> tuple[float, float, float]:
        """Return home in the local frame; the origin before it is set."""
        if self._projection is None or self.home is None:
            return 0.0, 0.0, 0.0
        latitude_deg, longitude_deg, altitude_m = self.home
        x, y = self._projection.project(latitude_deg, longitude_deg)
        return x, y, self._origin_altitude_m - altitude_m

    def from_home_m(self, place: tuple[float, float, float]) -> tuple[float, float]:
        """Return the height of a local place above home, and its horizontal distance from home."""
        x, y, z = place
        home_x, home_y, home_z = self.home_ned_m()
        return home_z - z, math.hypot(x - home_x, y - home_y)

    def on_map(self, place: tuple[float, float, float]) -> tuple[float, float]:
        """Return latitude and longitude (degrees) of a local place; the estimate's before that."""
        if self._projection is None:
            return self.estimator.latitude_deg, self.estimator.longitude_deg
        return self._projection.reproject(place[0], place[1])

    @property
    def settled(self) -> bool:
        """True when the inertial sensors agree with each other."""
        return self.since_boot_s >= _SETTLED_AFTER_S * self._boot_scale

    @property
    def position_ok(self) -> bool:
        """True when modes that need a position may run."""
        return self.position_known and not self._degraded

    @property
    def flags(self) -> int:
        """EKF_STATUS_REPORT.flags."""
        for until_s, flags in _START_FLAGS:
            if self.since_boot_s < until_s:
                return flags
        if not self.position_known:
            return _BEFORE_GPS_FLAGS
        if self.dead_reckoning:
            return _DEAD_RECKONING_FLAGS
        if not self._degraded:
            return _GOOD_FLAGS
        return _JAMMED_FLAGS if self._jammed else _COASTING_FLAGS

    @property
    def wind_from(self) -> tuple[float, float] | None:
        """Speed and the direction (degrees, -180 to 180) the wind comes from; None unknown."""
        if not self._fuses_drag or not self.position_known:
            return None
        north, east = self._wind_ne
        return math.hypot(north, east), math.degrees(math.atan2(-east, -north))

    @property
    def _fuses_drag(self) -> bool:
        value = self._parameters.value
        drag = value("EK3_DRAG_BCOEF_X") > 1.0 or value("EK3_DRAG_BCOEF_Y") > 1.0
        return drag or value("EK3_DRAG_MCOEF") > 0.001

    @property
    def dead_reckoning(self) -> bool:
        """True when the position follows from the wind estimate alone, which drag fusion yields."""
        return self._survives_by_drag and self._lost_s >= _DEAD_RECKONING_S

    @property
    def _survives_by_drag(self) -> bool:
        return self._fuses_drag and self.position_known and not self._jammed

    @property
    def _jammed(self) -> bool:
        return self._world.conditions.gps_mode == GPS_JAMMED

    @property
    def _degraded(self) -> bool:
        if self._survives_by_drag:
            timeout_s = self._parameters.value("FS_DR_TIMEOUT")
            return self._lost_s >= _DEAD_RECKONING_S + timeout_s
        return self._lost_s >= (_JAMMED_S if self._jammed else _COAST_S)

    def _uses_gps(self) -> bool:
        if self._projection is None:
            return False
        if not self.position_known:
            ready = self.since_boot_s >= USES_GPS_AFTER_S * self._boot_scale
            return ready and self._lost_s == 0.0
        return self._jammed or self._fuses_drag or self._lost_s < _NO_AIDING_S

    def _set_origin(self) -> None:
        estimator = self.estimator
        self._projection = FlatProjection(estimator.latitude_deg, estimator.longitude_deg)
        self._origin_altitude_m = estimator.altitude_m
        self.set_home()
        for number in (0, 1):
            self._text_sender.send(texts.INFO, f"EKF3 IMU{number} origin set")
        self._text_sender.send(texts.INFO, f"Field Elevation Set: {estimator.altitude_m:.0f}m")

    def _align_in_flight(self) -> None:
        """Report once per flight that the compass was aligned away from the ground."""
        if self._world.quad.on_ground:
            self._aligned_in_flight = False
        elif not self._aligned_in_flight and self.home_ned_m()[2] - self.z > _ALIGNS_ABOVE_M:
            self._aligned_in_flight = True
            for number in (0, 1):
                text = f"EKF3 IMU{number} MAG0 in-flight yaw alignment complete"
                self._text_sender.send(texts.INFO, text)

    def _estimate_wind(self) -> None:
        """Follow the true wind with a lag; freeze for a while with the tilt at its limit."""
        quad = self._world.quad
        if quad.on_ground:
            return
        limit_rad = math.radians(self._parameters.value("ANGLE_MAX") / 100.0)
        tilt_rad = math.hypot(quad.demand.roll_rad, quad.demand.pitch_rad)
        at_limit = tilt_rad > limit_rad - 0.01
        self._wind_stuck_s = self._wind_stuck_s + TICK_S if at_limit else 0.0
        if 0.0 < self._wind_stuck_s < _WIND_STUCK_S:
            return
        share = TICK_S / _WIND_TIME_S
        true_n, true_e, _ = self._world.wind.ned_mps
        error_n, error_e = _WIND_ERROR_NE_MPS
        north, east = self._wind_ne
        self._wind_ne = (
            north + (true_n + error_n - north) * share,
            east + (true_e + error_e - east) * share,
        )
