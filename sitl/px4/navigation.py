"""PX4's local frame: its map projection of the estimated position about the EKF's origin."""

import math
from typing import Final

from sitl.geodesy import SphereProjection
from sitl.position_estimate import Estimator
from sitl.world import World

_BOOT_FLAGS: Final = ((2.0, 0x00A4), (3.9, 0x00E5))
_GOOD_FLAGS: Final = 0x037F
_COASTING_FLAGS: Final = 0x0365
_NO_AIDING_FLAGS: Final = 0x0065
_COAST_S: Final = 5.0
"""Measured on PX4 v1.17.0: position is invalid 5 s after GPS is lost, all aiding ends after 7 s."""
_NO_AIDING_S: Final = 7.1
_VALID_AFTER_BOOT_S: Final = 4.0
_VALID_AFTER_LOSS_S: Final = 0.9
"""Time from aiding to a valid position; a reset of an estimate that is aided leaves it valid."""


class Navigation:
    """Local position x, y, z (north, east, down of the origin) by PX4's estimate, and health."""

    def __init__(self, world: World, boot_us: int) -> None:
        """Take the estimate at boot as the origin."""
        self._world = world
        self._boot_us = boot_us
        estimator = world.estimator
        estimator.step(world.now_s, world.quad, world.conditions)
        self.origin = SphereProjection(estimator.latitude_deg, estimator.longitude_deg)
        self.origin_altitude_m = estimator.altitude_m
        self.x = self.y = self.z = 0.0
        self._lost = False
        self._regained_us = boot_us
        self.home_latitude_deg = estimator.latitude_deg
        self.home_longitude_deg = estimator.longitude_deg
        self.home_altitude_m = estimator.altitude_m
        self.home_x = self.home_y = self.home_z = 0.0
        self.home_yaw = world.quad.yaw
        self.update()

    @property
    def estimator(self) -> Estimator:
        """The estimate in degrees and metres."""
        return self._world.estimator

    def update(self) -> None:
        """Project the newest estimate; once per tick."""
        estimator = self._world.estimator
        self.x, self.y = self.origin.project(estimator.latitude_deg, estimator.longitude_deg)
        self.z = self.origin_altitude_m - estimator.altitude_m
        if self._lost and estimator.lost_s < _COAST_S:
            self._regained_us = self._world.now_us
        self._lost = estimator.lost_s >= _COAST_S

    def set_home(self) -> None:
        """Make the present position home, as PX4 does at arming."""
        estimator = self._world.estimator
        self.home_latitude_deg = estimator.latitude_deg
        self.home_longitude_deg = estimator.longitude_deg
        self.home_altitude_m = estimator.altitude_m
        self.home_x, self.home_y, self.home_z = self.x, self.y, self.z
        self.home_yaw = self._world.quad.yaw

    @property
    def since_boot_s(self) -> float:
        """Time since the autopilot started."""
        return (self._world.now_us - self._boot_us) / 1e6

    @property
    def position_valid(self) -> bool:
        """True when modes that need a position may run."""
        return (
            self.since_boot_s >= _VALID_AFTER_BOOT_S
            and self._world.estimator.lost_s < _COAST_S
            and (
                self._regained_us == self._boot_us
                or self._world.now_us - self._regained_us >= _VALID_AFTER_LOSS_S * 1e6
            )
        )

    @property
    def gps_fused(self) -> bool:
        """True if SYS_STATUS reports GPS as present."""
        return self.since_boot_s >= _VALID_AFTER_BOOT_S and self.estimator.lost_s < _NO_AIDING_S

    @property
    def flags(self) -> int:
        """ESTIMATOR_STATUS.flags."""
        for until_s, flags in _BOOT_FLAGS:
            if self.since_boot_s < until_s:
                return flags
        lost_s = self._world.estimator.lost_s
        if lost_s < _COAST_S:
            return _GOOD_FLAGS
        return _COASTING_FLAGS if lost_s < _NO_AIDING_S else _NO_AIDING_FLAGS

    def distance_to_home_m(self) -> float:
        """Horizontal distance in the local frame."""
        return math.hypot(self.x - self.home_x, self.y - self.home_y)
