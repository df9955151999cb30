"""ArduPilot's telemetry of motion: attitude, position, sensors, outputs, targets, wind.

Field values, sentinels included, follow recordings of ArduCopter 4.6.3 in its own simulator.
"""

import math
from typing import Final

from sitl.ardupilot.receiver import Receiver
from sitl.ardupilot.state import GuidedTarget, State
from sitl.builders import Builder, Builders
from sitl.instruments import (
    Vector,
    body_acceleration,
    heading_cdeg,
    pressure_hpa,
    quaternion,
    to_body,
)
from sitl.quadrotor import GRAVITY_MPS2
from sitl.world import World

_HOVER_THRUST: Final = 0.365
_NO_THRUST: Final = -6e-8
"""ArduPilot's value for no thrust at all."""
_RATE_NOISE_RADPS: Final = 2e-4
_SPIN_MIN, _SPIN_MAX, _THRUST_EXPO = 0.15, 0.95, 0.65
"""MOT_SPIN_MIN, MOT_SPIN_MAX, MOT_THST_EXPO: a hover at about 1575 microseconds."""
_NO_POSITION, _NO_VELOCITY, _NO_ACCELERATION, _NO_YAW = 0x007, 0x038, 0x1C0, 0xC00
_WAYPOINT_MASK: Final = 0xFDF8
_EARTH_FIELD_MGAUSS: Vector = (184.0, -47.0, 492.0)
_BAROMETER_COLD_DEG, _BAROMETER_WARMING_DEG, _BAROMETER_TIME_S = 25.0, 8.6, 29.0
_IMU_COLD_DEG, _IMU_WARMING_DEG, _IMU_TIME_S = 25.0, 20.0, 300.0
Place = tuple[float, float, float]
"""Degrees north and east, metres above mean sea level."""


class MotionMessages(Builders):
    """The builders of this group; `place` is the place that the vehicle reports."""

    def __init__(self, world: World, state: State, receiver: Receiver, boot_us: int) -> None:
        """Start without a place."""
        super().__init__(world, boot_us)
        self._state = state
        self.receiver = receiver
        self.place: Place = (0.0, 0.0, 0.0)
        self._was_known = False

    def table(self) -> dict[str, Builder]:
        """Return the builders by message name."""
        return {
            "AHRS": self._ahrs,
            "AHRS2": self._ahrs2,
            "ATTITUDE": self._attitude,
            "ATTITUDE_QUATERNION": self._quaternion,
            "ATTITUDE_TARGET": self._attitude_target,
            "EKF_STATUS_REPORT": self._estimator,
            "GLOBAL_POSITION_INT": self._global,
            "GPS_RAW_INT": self._gps,
            "LOCAL_POSITION_NED": self._local,
            "NAV_CONTROLLER_OUTPUT": self._navigation,
            "POSITION_TARGET_GLOBAL_INT": self._waypoint,
            "POSITION_TARGET_LOCAL_NED": self._position_target,
            "RAW_IMU": self._raw_imu,
            "SCALED_IMU2": self._imu2,
            "SCALED_IMU3": self._imu3,
            "SCALED_PRESSURE": lambda: self._pressure("SCALED_PRESSURE", 0.0),
            "SCALED_PRESSURE2": lambda: self._pressure("SCALED_PRESSURE2", 0.01),
            "SERVO_OUTPUT_RAW": self._servos,
            "SIMSTATE": self._truth,
            "TERRAIN_REPORT": self._terrain,
            "VFR_HUD": self._vfr_hud,
            "VIBRATION": self._vibration,
            "WIND": self._wind,
        }

    def step(self) -> None:
        """Follow the estimate; before the first one the receiver; keep the place after a loss."""
        e, shown = self._world.estimator, self.receiver.shown
        if self._state.position_known:
            self._was_known = True
            self.place = (e.latitude_deg, e.longitude_deg, e.altitude_m)
        elif shown is not None and not self._was_known:
            self.place = (shown.latitude_deg, shown.longitude_deg, shown.altitude_m)

    # Values of several messages

    @property
    def thrust(self) -> float:
        """The throttle output, 0 to 1."""
        quad = self._world.quad
        if not quad.demand.spinning:
            return 0.0
        return min(1.0, quad.demand.thrust / quad.airframe.hover_thrust * _HOVER_THRUST)

    @property
    def airspeed_mps(self) -> float:
        """The speed through the air, which is taken as still where the wind is unknown."""
        if not self._state.position_known:
            return 0.0
        e = self._world.estimator
        speed_mps, from_deg = self._state.wind_from or (0.0, 0.0)
        to_rad = math.radians(from_deg) + math.pi
        n, east = e.vn - speed_mps * math.cos(to_rad), e.ve - speed_mps * math.sin(to_rad)
        return math.sqrt(n * n + east * east + e.vd * e.vd)

    def to_target(self) -> Vector:
        """Return metres north, east and down to GUIDED's target position; zeros without one."""
        target = self._state.guided_target
        if target is None or target.position_ned_m is None:
            return 0.0, 0.0, 0.0
        here = self._state.position_ned_m
        (n, e, d) = (t - h for t, h in zip(target.position_ned_m, here, strict=True))
        return n, e, d

    # Attitude

    def _rates(self) -> dict[str, float]:
        quad = self._world.quad
        rates = {
            "rollspeed": quad.roll_rate, "pitchspeed": quad.pitch_rate, "yawspeed": quad.yaw_rate,
        }  # fmt: skip
        return {name: rate + self._noise(0.0, _RATE_NOISE_RADPS) for name, rate in rates.items()}

    def _attitude(self) -> bytes:
        quad = self._world.quad
        return self._pack(
            "ATTITUDE", time_boot_ms=self._ms, roll=quad.roll, pitch=quad.pitch, yaw=quad.yaw,
            **self._rates(),
        )  # fmt: skip

    def _quaternion(self) -> bytes:
        quad = self._world.quad
        w, x, y, z = quaternion(quad.roll, quad.pitch, quad.yaw)
        return self._pack(
            "ATTITUDE_QUATERNION", time_boot_ms=self._ms, q1=w, q2=x, q3=y, q4=z,
            repr_offset_q=(0.0, 0.0, 0.0, 0.0), **self._rates(),
        )  # fmt: skip

    def _attitude_target(self) -> bytes:
        quad = self._world.quad
        roll, pitch, yaw = self._state.desired_attitude_rad
        gain = quad.airframe.attitude_gain_per_s if self._state.armed else 0.0
        return self._pack(
            "ATTITUDE_TARGET", time_boot_ms=self._ms, type_mask=0,
            q=quaternion(roll, pitch, yaw), body_roll_rate=gain * (roll - quad.roll),
            body_pitch_rate=gain * (pitch - quad.pitch), body_yaw_rate=quad.yaw_rate,
            thrust=self.thrust or _NO_THRUST,
        )  # fmt: skip

    def _ahrs(self) -> bytes:
        return self._pack(
            "AHRS", omegaIx=self._noise(0.0, 1e-3), omegaIy=self._noise(0.0, 1e-3),
            omegaIz=self._noise(0.0, 1e-3), accel_weight=0.0, renorm_val=0.0,
            error_rp=abs(self._noise(0.003, 0.002)), error_yaw=abs(self._noise(0.005, 0.005)),
        )  # fmt: skip

    def _ahrs2(self) -> bytes:
        quad, shown = self._world.quad, self.receiver.shown
        latitude, longitude, altitude = (
            (0.0, 0.0, 0.0)
            if shown is None
            else (shown.latitude_deg, shown.longitude_deg, shown.altitude_m)
        )
        return self._pack(
            "AHRS2", roll=quad.roll + self._noise(0.0, 1e-3),
            pitch=quad.pitch + self._noise(0.0, 1e-3), yaw=quad.yaw + self._noise(0.0, 1e-2),
            altitude=altitude, lat=round(latitude * 1e7), lng=round(longitude * 1e7),
        )  # fmt: skip

    # Position

    def _local(self) -> bytes | None:
        if not self._state.position_known:
            return None
        e = self._world.estimator
        x, y, z = self._state.position_ned_m
        return self._pack(
            "LOCAL_POSITION_NED", time_boot_ms=self._ms, x=x, y=y, z=z, vx=e.vn, vy=e.ve, vz=e.vd
        )

    def _global(self) -> bytes:
        e, home = self._world.estimator, self._state.home
        latitude, longitude, altitude = self.place
        return self._pack(
            "GLOBAL_POSITION_INT", time_boot_ms=self._ms, lat=round(latitude * 1e7),
            lon=round(longitude * 1e7), alt=round(altitude * 100) * 10,
            relative_alt=0 if home is None else round((e.altitude_m - home[2]) * 1000),
            vx=int(e.vn * 100), vy=int(e.ve * 100), vz=int(e.vd * 100),
            hdg=heading_cdeg(self._world.quad.yaw),
        )  # fmt: skip

    def _gps(self) -> bytes:
        receiver = self.receiver
        shown = receiver.shown
        if shown is None or not receiver.reports:
            return self._pack(
                "GPS_RAW_INT", time_usec=receiver.fix_us, fix_type=int(receiver.detected), lat=0,
                lon=0, alt=0, eph=65535, epv=65535, vel=0, cog=0, satellites_visible=0,
                alt_ellipsoid=0, h_acc=0, v_acc=0, vel_acc=0, hdg_acc=0, yaw=0,
            )  # fmt: skip
        vn, ve, _ = shown.velocity_ned_mps
        altitude_mm = round(shown.altitude_m * 100) * 10
        return self._pack(
            "GPS_RAW_INT", time_usec=receiver.fix_us, fix_type=6 if shown.fix_type else 1,
            lat=round(shown.latitude_deg * 1e7), lon=round(shown.longitude_deg * 1e7),
            alt=altitude_mm, eph=round((shown.hdop or 0.0) * 100),
            epv=round((shown.vdop or 0.0) * 100),
            vel=min(65534, round(math.hypot(vn, ve) * 100)), cog=heading_cdeg(math.atan2(ve, vn)),
            satellites_visible=shown.satellites or 0, alt_ellipsoid=altitude_mm,
            h_acc=round(shown.h_acc_m * 1000), v_acc=round(shown.v_acc_m * 1000), vel_acc=0,
            hdg_acc=0, yaw=0,
        )  # fmt: skip

    def _estimator(self) -> bytes:
        fused = self._state.position_known
        return self._pack(
            "EKF_STATUS_REPORT", flags=self._state.ekf_flags,
            velocity_variance=abs(self._noise(0.006, 0.004)) if fused else 0.0,
            pos_horiz_variance=abs(self._noise(0.004, 0.002)),
            pos_vert_variance=abs(self._noise(0.002, 0.002)),
            compass_variance=abs(self._noise(0.012, 0.005)), terrain_alt_variance=0.0,
            airspeed_variance=0.0,
        )  # fmt: skip

    def _vfr_hud(self) -> bytes:
        e = self._world.estimator
        return self._pack(
            "VFR_HUD", airspeed=self.airspeed_mps, groundspeed=math.hypot(e.vn, e.ve),
            heading=heading_cdeg(self._world.quad.yaw) // 100, throttle=int(self.thrust * 100),
            alt=round(self.place[2], 2), climb=-e.vd,
        )  # fmt: skip

    def _terrain(self) -> bytes:
        latitude, longitude, altitude = self.place
        return self._pack(
            "TERRAIN_REPORT", lat=round(latitude * 1e7), lon=round(longitude * 1e7), spacing=0,
            terrain_height=0.0, current_height=round(altitude, 2), pending=336, loaded=0,
        )  # fmt: skip

    def _truth(self) -> bytes:
        quad = self._world.quad
        place = self._world.frame.geodetic(quad.n, quad.e, quad.d)
        x, y, z = body_acceleration(quad)
        return self._pack(
            "SIMSTATE", roll=quad.roll, pitch=quad.pitch, yaw=quad.true_yaw, xacc=x, yacc=y, zacc=z,
            xgyro=quad.roll_rate, ygyro=quad.pitch_rate, zgyro=quad.yaw_rate,
            lat=round(place.latitude_deg * 1e7), lng=round(place.longitude_deg * 1e7),
        )  # fmt: skip

    # Targets

    def _position_target(self) -> bytes | None:
        target = self._state.guided_target
        if target is None:
            return None
        x, y, z = target.position_ned_m or (0.0, 0.0, 0.0)
        vx, vy, vz = target.velocity_ned_mps or (0.0, 0.0, 0.0)
        return self._pack(
            "POSITION_TARGET_LOCAL_NED", time_boot_ms=self._ms, coordinate_frame=1,
            type_mask=_shown_mask(target), x=x, y=y, z=z, vx=vx, vy=vy, vz=vz, afx=0.0, afy=0.0,
            afz=0.0, yaw=0.0, yaw_rate=0.0,
        )  # fmt: skip

    def _waypoint(self) -> bytes | None:
        place = self._state.return_place
        if place is None:
            return None
        latitude, longitude, altitude = place
        return self._pack(
            "POSITION_TARGET_GLOBAL_INT", time_boot_ms=self._ms, coordinate_frame=0,
            type_mask=_WAYPOINT_MASK, lat_int=round(latitude * 1e7),
            lon_int=round(longitude * 1e7), alt=round(altitude, 2), vx=0.0, vy=0.0, vz=0.0,
            afx=0.0, afy=0.0, afz=0.0, yaw=0.0, yaw_rate=0.0,
        )  # fmt: skip

    def _navigation(self) -> bytes:
        roll, pitch, yaw = self._state.desired_attitude_rad
        n, e, d = self.to_target()
        target = self._state.guided_target
        vn, ve, _ = (target and target.velocity_ned_mps) or (0.0, 0.0, 0.0)
        speed, away = math.hypot(vn, ve), math.hypot(n, e)
        return self._pack(
            "NAV_CONTROLLER_OUTPUT", nav_roll=math.degrees(roll), nav_pitch=math.degrees(pitch),
            nav_bearing=int(math.degrees(yaw)),
            target_bearing=int(math.degrees(math.atan2(e, n)) % 360.0),
            wp_dist=min(65535, int(away)), alt_error=-d, aspd_error=0.0,
            xtrack_error=abs(vn * e - ve * n) / speed if speed else away,
        )  # fmt: skip

    # Sensors and outputs

    def _inertial(self) -> dict[str, int]:
        """Return accelerometers (mg), gyros (mrad/s), compass (mGauss), temperature (cdegC)."""
        quad = self._world.quad
        x, y, z = (
            int(a / GRAVITY_MPS2 * 1000 + self._noise(0.0, 1.0)) for a in body_acceleration(quad)
        )
        warm_deg = _IMU_COLD_DEG + _IMU_WARMING_DEG * self._warmth(_IMU_TIME_S)
        return {
            "xacc": x, "yacc": y, "zacc": z, "xgyro": int(quad.roll_rate * 1000),
            "ygyro": int(quad.pitch_rate * 1000), "zgyro": int(quad.yaw_rate * 1000),
            "temperature": int(warm_deg * 100), **self._compass(),
        }  # fmt: skip

    def _compass(self) -> dict[str, int]:
        x, y, z = to_body(self._world.quad, *_EARTH_FIELD_MGAUSS)
        return {"xmag": int(x), "ymag": int(y), "zmag": int(z)}

    def _warmth(self, time_s: float) -> float:
        return 1.0 - math.exp(-self._us / 1e6 / time_s)

    def _raw_imu(self) -> bytes:
        return self._pack("RAW_IMU", time_usec=self._us, id=0, **self._inertial())

    def _imu2(self) -> bytes:
        return self._pack("SCALED_IMU2", time_boot_ms=self._ms, **self._inertial())

    def _imu3(self) -> bytes:
        return self._pack(
            "SCALED_IMU3", time_boot_ms=self._ms, xacc=0, yacc=0, zacc=0, xgyro=0, ygyro=0,
            zgyro=0, temperature=0, **self._compass(),
        )  # fmt: skip

    def _pressure(self, name: str, noise_hpa: float) -> bytes:
        height = self._world.options.altitude_amsl_m + self._world.quad.height_m
        warm = _BAROMETER_COLD_DEG + _BAROMETER_WARMING_DEG * self._warmth(_BAROMETER_TIME_S)
        return self._pack(
            name, time_boot_ms=self._ms,
            press_abs=pressure_hpa(height) + self._noise(0.0, noise_hpa), press_diff=0.0,
            temperature=int(warm * 100), temperature_press_diff=0,
        )  # fmt: skip

    def _servos(self) -> bytes:
        quad = self._world.quad
        values = {f"servo{i}_raw": 0 for i in range(1, 17)}
        for i, output in enumerate(quad.motor_outputs(), 1):
            thrust = output / quad.airframe.hover_thrust * _HOVER_THRUST
            values[f"servo{i}_raw"] = _motor_us(thrust) if quad.demand.spinning else 1000
        return self._pack("SERVO_OUTPUT_RAW", time_usec=self._us & 0xFFFFFFFF, port=0, **values)

    def _vibration(self) -> bytes:
        shaken = 0.003 if self._world.quad.on_ground else 0.02
        x, y, z = (abs(self._noise(shaken, shaken / 4)) for _ in range(3))
        return self._pack(
            "VIBRATION", time_usec=self._us, vibration_x=x, vibration_y=y, vibration_z=z,
            clipping_0=0, clipping_1=0, clipping_2=0,
        )  # fmt: skip

    def _wind(self) -> bytes | None:
        if not self._state.position_known:
            return None
        speed_mps, from_deg = self._state.wind_from or (0.0, -180.0)
        direction = math.remainder(from_deg, 360.0)
        return self._pack("WIND", direction=direction, speed=speed_mps, speed_z=0.0)


def _shown_mask(target: GuidedTarget) -> int:
    """Return the type mask of the target; velocity alone without a target: a stop."""
    if target.position_ned_m is None:
        return _NO_POSITION | _NO_YAW
    if target.velocity_ned_mps is None:
        return _NO_VELOCITY | _NO_ACCELERATION | _NO_YAW
    return _NO_YAW


def _motor_us(thrust: float) -> int:
    """Return a motor's output: the thrust curve, between the spin limits."""
    share = max(0.0, min(1.0, thrust))
    linear = 1.0 - _THRUST_EXPO
    curve = (math.sqrt(linear**2 + 4.0 * _THRUST_EXPO * share) - linear) / (2.0 * _THRUST_EXPO)
    return 1000 + round(1000.0 * (_SPIN_MIN + (_SPIN_MAX - _SPIN_MIN) * curve))
