"""Estimates of the aircraft: the GPS receiver and the position estimate.

Inputs: the true state and the conditions. Outputs: the last GPS fix, and an estimate of position
and velocity with the random error of an estimator. Numbers are those of PX4 v1.17.0 with its
built-in simulation, unless stated otherwise.
"""

import math
import random
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from sitl.conditions import GPS_JAMMED, GPS_SILENT, Conditions
from sitl.geodesy import TrueFrame, around_deg
from sitl.quadrotor import Quadrotor

GPS_PERIOD_S: Final = 0.125
_SILENT_PERIOD_S: Final = 1.0
_H_ACC_PER_HDOP_M: Final = 0.9 / 0.7
_V_ACC_PER_VDOP_M: Final = 1.78 / 1.1
_ESTIMATE_PERIOD_S: Final = 0.02
_RECOVERY_S: Final = 1.2
"""Time from the first good fix to the reset of the estimate onto it."""
_ERROR_M, _ERROR_TIME_S = 0.15, 6.0
_HEIGHT_ERROR_M, _HEIGHT_ERROR_TIME_S = 0.12, 10.0
_VELOCITY_ERROR_MPS, _VELOCITY_ERROR_TIME_S = 0.05, 1.0
_DRIFT_MPS_PER_SQRT_S: Final = 0.35
"""Random walk of the velocity error without GPS: some 40 m in 20 s, as measured."""
_JAMMED_AFTER_S: Final = 6.0
_JAMMED_FACTOR: Final = 20.0
"""A jammed receiver moves the estimate by hundreds of metres (ArduCopter 4.6.3)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GpsFix:
    """One output of the receiver; None where it reports nothing."""

    time_s: float
    alive: bool
    fix_type: int
    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    velocity_ned_mps: tuple[float, float, float]
    satellites: int | None
    hdop: float | None
    vdop: float | None
    h_acc_m: float
    v_acc_m: float
    s_acc_mps: float


class Estimator:
    """GPS receiver and position estimate together; `step` at any rate, `fix` and fields to read.

    lost_s is the time since GPS was last fused (0 while it is), resets counts the jumps.
    """

    __slots__ = (
        "_drift_e",
        "_drift_n",
        "_err_d",
        "_err_e",
        "_err_n",
        "_fix_since_s",
        "_frame",
        "_next_estimate_s",
        "_next_gps_s",
        "_noise",
        "_off_e",
        "_off_n",
        "_random",
        "_stepped_s",
        "_verr_d",
        "_verr_e",
        "_verr_n",
        "altitude_m",
        "fix",
        "fix_number",
        "latitude_deg",
        "longitude_deg",
        "lost_s",
        "resets",
        "vd",
        "ve",
        "vn",
    )

    def __init__(self, frame: TrueFrame, generator: random.Random, noise: float = 1.0) -> None:
        """Start at home with a small error; `noise` scales the errors of the estimate."""
        self._frame = frame
        self._noise = noise
        self._random = generator
        gauss = generator.gauss
        self._err_n, self._err_e = gauss(0.0, 0.05), gauss(0.0, 0.05)
        self._err_d = gauss(0.0, 0.05)
        self._verr_n = self._verr_e = self._verr_d = 0.0
        self._drift_n = self._drift_e = 0.0
        self._off_n = self._off_e = 0.0
        self._next_gps_s = 0.2
        self._next_estimate_s = self._stepped_s = 0.0
        self._fix_since_s: float | None = 0.0
        self.fix: GpsFix | None = None
        self.fix_number = 0
        self.lost_s = 0.0
        self.resets = 12
        self.latitude_deg = self.longitude_deg = self.altitude_m = 0.0
        self.vn = self.ve = self.vd = 0.0

    @property
    def horizontal_accuracy_m(self) -> float:
        """Estimated accuracy: 0.3 m, growing with the square of the time without GPS."""
        return 0.3 + 0.036 * self.lost_s**2

    @property
    def vertical_accuracy_m(self) -> float:
        """Estimated accuracy of the height, which the barometer keeps."""
        return min(0.6, 0.25 + 0.05 * self.lost_s)

    def step(self, now_s: float, true: Quadrotor, conditions: Conditions) -> None:
        """Take a fix and move the estimate if they are due."""
        if now_s >= self._next_gps_s:
            self._take_fix(now_s, true, conditions)
        if now_s >= self._next_estimate_s:
            self._wander(now_s, conditions)
            self._next_estimate_s = now_s + _ESTIMATE_PERIOD_S
            self._stepped_s = now_s
        frame = self._frame
        self.latitude_deg = frame.home.latitude_deg + (
            (true.n + self._err_n + self._off_n) * frame.deg_per_m_north
        )
        self.longitude_deg = around_deg(
            frame.home.longitude_deg + (true.e + self._err_e + self._off_e) * frame.deg_per_m_east
        )
        self.altitude_m = frame.home.altitude_amsl_m - true.d - self._err_d
        self.vn = true.vn + self._verr_n + self._drift_n
        self.ve = true.ve + self._verr_e + self._drift_e
        self.vd = true.vd + self._verr_d

    def jump(self, north_m: float, east_m: float) -> None:
        """Reset the estimate: it moves at once, and keeps the offset."""
        self._off_n += north_m
        self._off_e += east_m
        self._count_reset()

    def _take_fix(self, now_s: float, true: Quadrotor, conditions: Conditions) -> None:
        gauss = self._random.gauss
        frame = self._frame
        if conditions.gps_mode == GPS_SILENT:
            self._next_gps_s = now_s + _SILENT_PERIOD_S
            self.fix = GpsFix(
                time_s=0.0, alive=False, fix_type=0, latitude_deg=0.0, longitude_deg=0.0,
                altitude_m=0.0, velocity_ned_mps=(0.0, 0.0, 0.0), satellites=None, hdop=None,
                vdop=None, h_acc_m=0.0, v_acc_m=0.0, s_acc_mps=0.0,
            )  # fmt: skip
            self.fix_number += 1
            return
        self._next_gps_s = now_s + GPS_PERIOD_S
        good = conditions.has_fix()
        scale = conditions.gps_noise_factor * conditions.hdop / 0.7
        place = frame.geodetic(
            true.n + gauss(0.0, 0.2 * scale),
            true.e + gauss(0.0, 0.2 * scale),
            true.d + gauss(0.0, 0.48 * scale),
        )
        velocity = (
            true.vn + gauss(0.0, 0.06 * scale),
            true.ve + gauss(0.0, 0.06 * scale),
            true.vd + gauss(0.0, 0.1 * scale),
        )
        self.fix = GpsFix(
            time_s=now_s,
            alive=True,
            fix_type=3 if good else 0,
            latitude_deg=place.latitude_deg,
            longitude_deg=place.longitude_deg,
            altitude_m=place.altitude_amsl_m,
            velocity_ned_mps=velocity,
            satellites=conditions.satellites if good else min(conditions.satellites, 3),
            hdop=conditions.hdop if good else 100.0,
            vdop=conditions.vdop if good else 100.0,
            h_acc_m=conditions.hdop * _H_ACC_PER_HDOP_M if good else 100.0,
            v_acc_m=conditions.vdop * _V_ACC_PER_VDOP_M if good else 100.0,
            s_acc_mps=0.4 if good else 100.0,
        )
        self.fix_number += 1

    def _wander(self, now_s: float, conditions: Conditions) -> None:
        dt = _ESTIMATE_PERIOD_S
        gauss = self._random.gauss
        if conditions.has_fix():
            if self._fix_since_s is None:
                self._fix_since_s = now_s
            if self.lost_s > 0.0 and now_s - self._fix_since_s >= _RECOVERY_S:
                self._reset()
        else:
            self._fix_since_s = None
        speed = _VELOCITY_ERROR_MPS * self._noise
        self._verr_n = _markov(self._verr_n, gauss, dt, speed, _VELOCITY_ERROR_TIME_S)
        self._verr_e = _markov(self._verr_e, gauss, dt, speed, _VELOCITY_ERROR_TIME_S)
        self._verr_d = _markov(self._verr_d, gauss, dt, speed, _VELOCITY_ERROR_TIME_S)
        height = _HEIGHT_ERROR_M * self._noise * conditions.gps_noise_factor
        self._err_d = _markov(self._err_d, gauss, dt, height, _HEIGHT_ERROR_TIME_S)
        if self._fix_since_s is None or self.lost_s > 0.0:
            self.lost_s += now_s - self._stepped_s
            walk = _DRIFT_MPS_PER_SQRT_S * self._noise * math.sqrt(dt)
            if conditions.gps_mode == GPS_JAMMED and self.lost_s > _JAMMED_AFTER_S:
                walk *= _JAMMED_FACTOR
            self._drift_n += gauss(0.0, walk)
            self._drift_e += gauss(0.0, walk)
            self._err_n += (self._drift_n + self._verr_n) * dt
            self._err_e += (self._drift_e + self._verr_e) * dt
            return
        scale = _ERROR_M * self._noise * conditions.gps_noise_factor * conditions.hdop / 0.7
        self._err_n = _markov(self._err_n, gauss, dt, scale, _ERROR_TIME_S)
        self._err_e = _markov(self._err_e, gauss, dt, scale, _ERROR_TIME_S)

    def _reset(self) -> None:
        self.lost_s = 0.0
        self._drift_n = self._drift_e = 0.0
        self._err_n = self._random.gauss(0.0, _ERROR_M * self._noise)
        self._err_e = self._random.gauss(0.0, _ERROR_M * self._noise)
        self._count_reset()

    def _count_reset(self) -> None:
        self.resets = (self.resets + 1) % 256


def _markov(
    value: float, gauss: Callable[[float, float], float], dt: float, sigma: float, time_s: float
) -> float:
    """One step of a first-order Gauss-Markov process of standard deviation `sigma`."""
    rate = dt / time_s
    return value * (1.0 - rate) + gauss(0.0, sigma * math.sqrt(2.0 * rate))
