"""PX4's telemetry of motion: attitude, position, sensors, outputs, setpoints, wind.

Field values, sentinels included, follow recordings of PX4 v1.17.0.
"""

import math
from typing import Final

from sitl.builders import Builder
from sitl.instruments import body_acceleration, heading_cdeg, pressure_hpa, quaternion
from sitl.px4.builders import Builders, Sources
from sitl.px4.modes import AUTO_MODES
from sitl.px4.offboard import NAN
from sitl.quadrotor import GRAVITY_MPS2
from sitl.world import World

_PWM_OFF: Final = 900
_PWM_MIN: Final = 1000
_WIND_TIME_S: Final = 17.0
_WIND_FIRST_S: Final = 0.8
"""Time constants as recorded: two thirds of the wind 2 s after the start, but half of it 11 s after
it stopped."""
_IMU: Final = 0x03F
_MAGNETOMETER: Final = 0x1C0
"""Bits of HIGHRES_IMU.fields_updated: the field is new in every fourth message, as recorded."""
_AT_REST: Final = 0x0080
"""Bit of ESTIMATOR_STATUS.flags: position and velocity count as constant."""
_ODOMETRY_NAN: Final = (NAN,) * 21


class WindEstimate:
    """EKF2's wind from drag: quick at first, then slow; direction it blows to, as in PX4."""

    __slots__ = ("_age_s", "e", "n", "started")

    def __init__(self) -> None:
        """Start without an estimate."""
        self.n = self.e = self._age_s = 0.0
        self.started = False

    def step(self, dt: float, world: World, *, fused: bool) -> None:
        """Move towards the true wind; clear the estimate when drag fusion is off."""
        if not fused:
            self.n = self.e = self._age_s = 0.0
            self.started = False
            return
        self.started = True
        wind_n, wind_e, _ = world.wind.ned_mps
        self._age_s += dt
        share = dt / min(_WIND_TIME_S, _WIND_FIRST_S + self._age_s)
        self.n += (wind_n - self.n) * share
        self.e += (wind_e - self.e) * share


class MotionMessages(Builders):
    """The builders of this group."""

    def __init__(self, sources: Sources) -> None:
        """Start without a wind estimate."""
        super().__init__(sources)
        self.wind = WindEstimate()

    def table(self) -> dict[str, Builder]:
        """Return the builders by message name."""
        return {
            "ACTUATOR_OUTPUT_STATUS": self._actuators,
            "ALTITUDE": self._altitude,
            "ATTITUDE": self._attitude,
            "ATTITUDE_QUATERNION": self._quaternion,
            "ATTITUDE_TARGET": self._attitude_target,
            "DISTANCE_SENSOR": self._distance,
            "ESTIMATOR_STATUS": self._estimator,
            "GLOBAL_POSITION_INT": self._global,
            "GPS_GLOBAL_ORIGIN": self._origin,
            "GPS_RAW_INT": self._gps,
            "HIGHRES_IMU": self._imu,
            "LOCAL_POSITION_NED": self._local,
            "ODOMETRY": self._odometry,
            "POSITION_TARGET_GLOBAL_INT": self._waypoint,
            "POSITION_TARGET_LOCAL_NED": self._position_target,
            "SCALED_IMU": self._scaled_imu,
            "SCALED_PRESSURE": self._pressure,
            "SERVO_OUTPUT_RAW": self._servos,
            "VFR_HUD": self._vfr_hud,
            "VIBRATION": self._vibration,
            "WIND_COV": self._wind,
        }

    def step(self, dt: float) -> None:
        """Advance the parts that have a memory."""
        fused = self._s.parameters.value("EKF2_DRAG_CTRL") == 1
        self.wind.step(dt, self._s.world, fused=fused and self._s.commander.armed)

    def _attitude(self) -> bytes:
        quad = self._s.world.quad
        return self._pack(
            "ATTITUDE", time_boot_ms=self._ms, roll=quad.roll, pitch=quad.pitch, yaw=quad.yaw,
            rollspeed=quad.roll_rate, pitchspeed=quad.pitch_rate, yawspeed=quad.yaw_rate,
        )  # fmt: skip

    def _quaternion(self) -> bytes:
        quad = self._s.world.quad
        w, x, y, z = quaternion(quad.roll, quad.pitch, quad.yaw)
        return self._pack(
            "ATTITUDE_QUATERNION", time_boot_ms=self._ms, q1=w, q2=x, q3=y, q4=z,
            rollspeed=quad.roll_rate, pitchspeed=quad.pitch_rate, yawspeed=quad.yaw_rate,
            repr_offset_q=(0.0, 0.0, 0.0, 0.0),
        )  # fmt: skip

    def _attitude_target(self) -> bytes:
        demand = self._s.world.quad.demand
        yaw = self._s.control.yaw_wish
        return self._pack(
            "ATTITUDE_TARGET", time_boot_ms=self._ms, type_mask=0,
            q=quaternion(demand.roll_rad, demand.pitch_rad, yaw),
            body_roll_rate=self._s.world.quad.roll_rate,
            body_pitch_rate=self._s.world.quad.pitch_rate,
            body_yaw_rate=self._s.world.quad.yaw_rate, thrust=max(0.001, demand.thrust),
        )  # fmt: skip

    def _local(self) -> bytes:
        nav = self._s.navigation
        e = nav.estimator
        return self._pack(
            "LOCAL_POSITION_NED", time_boot_ms=self._ms, x=nav.x, y=nav.y, z=nav.z,
            vx=e.vn, vy=e.ve, vz=e.vd,
        )  # fmt: skip

    def _odometry(self) -> bytes:
        nav, quad = self._s.navigation, self._s.world.quad
        e = nav.estimator
        pose, velocity = list(_ODOMETRY_NAN), list(_ODOMETRY_NAN)
        variance = e.horizontal_accuracy_m**2 / 2.0
        pose[0], pose[6], pose[11] = variance, variance, e.vertical_accuracy_m**2 / 2.0
        pose[15], pose[18], pose[20] = 2.9e-4, 3.3e-4, 1.5e-2
        velocity[0] = velocity[6] = 0.0097 + 0.05 * e.lost_s
        velocity[11] = 0.005
        return self._pack(
            "ODOMETRY", time_usec=self._us, frame_id=1, child_frame_id=1, x=nav.x, y=nav.y,
            z=nav.z, q=quaternion(quad.roll, quad.pitch, quad.yaw), vx=e.vn, vy=e.ve, vz=e.vd,
            rollspeed=quad.roll_rate, pitchspeed=quad.pitch_rate, yawspeed=quad.yaw_rate,
            pose_covariance=pose, velocity_covariance=velocity, reset_counter=e.resets,
            estimator_type=8, quality=0,
        )  # fmt: skip

    def _global(self) -> bytes | None:
        nav = self._s.navigation
        e = nav.estimator
        return self._pack(
            "GLOBAL_POSITION_INT", time_boot_ms=self._ms, lat=round(e.latitude_deg * 1e7),
            lon=round(e.longitude_deg * 1e7), alt=round(e.altitude_m * 1000),
            relative_alt=round((e.altitude_m - nav.home_altitude_m) * 1000),
            vx=round(e.vn * 100), vy=round(e.ve * 100), vz=round(e.vd * 100),
            hdg=heading_cdeg(self._s.world.quad.yaw),
        )  # fmt: skip

    def _gps(self) -> bytes | None:
        fix = self._s.navigation.estimator.fix
        if fix is None:
            return None
        if not fix.alive:
            return self._pack(
                "GPS_RAW_INT", time_usec=0, fix_type=0, lat=0, lon=0, alt=0, eph=65535,
                epv=65535, vel=65535, cog=65535, satellites_visible=255, alt_ellipsoid=0,
                h_acc=0, v_acc=0, vel_acc=0, hdg_acc=0, yaw=0,
            )  # fmt: skip
        vn, ve, _ = fix.velocity_ned_mps
        return self._pack(
            "GPS_RAW_INT", time_usec=max(0, round(fix.time_s * 1e6) - self._s.boot_us),
            fix_type=fix.fix_type, lat=round(fix.latitude_deg * 1e7),
            lon=round(fix.longitude_deg * 1e7), alt=round(fix.altitude_m * 1000),
            eph=round((fix.hdop or 0.0) * 100), epv=round((fix.vdop or 0.0) * 100),
            vel=min(65534, round(math.hypot(vn, ve) * 100)),
            cog=heading_cdeg(math.atan2(ve, vn)),
            satellites_visible=fix.satellites or 0, alt_ellipsoid=round(fix.altitude_m * 1000),
            h_acc=round(fix.h_acc_m * 1000), v_acc=round(fix.v_acc_m * 1000),
            vel_acc=round(fix.s_acc_mps * 1000), hdg_acc=0, yaw=0,
        )  # fmt: skip

    def _estimator(self) -> bytes:
        nav = self._s.navigation
        e = nav.estimator
        gone = not nav.gps_fused
        flags = nav.flags if self._s.commander.armed else nav.flags | _AT_REST
        return self._pack(
            "ESTIMATOR_STATUS", time_usec=self._us, flags=flags,
            vel_ratio=NAN if gone else 0.1, pos_horiz_ratio=NAN if gone else 0.05,
            pos_vert_ratio=0.03, mag_ratio=0.065, hagl_ratio=0.005, tas_ratio=NAN,
            pos_horiz_accuracy=e.horizontal_accuracy_m, pos_vert_accuracy=e.vertical_accuracy_m,
        )  # fmt: skip

    def _vfr_hud(self) -> bytes:
        e, quad = self._s.navigation.estimator, self._s.world.quad
        return self._pack(
            "VFR_HUD", airspeed=NAN, groundspeed=math.hypot(e.vn, e.ve),
            heading=int(math.degrees(quad.yaw) % 360.0),
            throttle=round(max(0.0, quad.demand.thrust) * 100), alt=e.altitude_m, climb=-e.vd,
        )  # fmt: skip

    def _altitude(self) -> bytes:
        nav, height = self._s.navigation, self._s.world.quad.height_m
        e = nav.estimator
        return self._pack(
            "ALTITUDE", time_usec=self._us, altitude_monotonic=e.altitude_m + 0.6,
            altitude_amsl=e.altitude_m, altitude_local=-nav.z,
            altitude_relative=e.altitude_m - nav.home_altitude_m,
            altitude_terrain=-nav.z - height, bottom_clearance=height,
        )  # fmt: skip

    def _distance(self) -> bytes:
        return self._pack(
            "DISTANCE_SENSOR", time_boot_ms=self._ms, min_distance=0, max_distance=10000,
            current_distance=min(10000, round(self._s.world.quad.height_m * 100)), type=0, id=0,
            orientation=25, covariance=0, horizontal_fov=0.0, vertical_fov=0.0,
            quaternion=(0.0, 0.0, 0.0, 0.0), signal_quality=0,
        )  # fmt: skip

    def _imu(self) -> bytes:
        quad, noise = self._s.world.quad, self._noise
        x, y, z = body_acceleration(self._s.world.quad)
        height = self._s.world.options.altitude_amsl_m + quad.height_m
        return self._pack(
            "HIGHRES_IMU", time_usec=self._us, xacc=x + noise(0.0, 0.07),
            yacc=y + noise(0.0, 0.07), zacc=z + noise(0.0, 0.07),
            xgyro=quad.roll_rate, ygyro=quad.pitch_rate, zgyro=quad.yaw_rate,
            xmag=0.21 * math.cos(quad.yaw), ymag=-0.21 * math.sin(quad.yaw), zmag=0.43,
            abs_pressure=pressure_hpa(height), diff_pressure=0.0, pressure_alt=height,
            temperature=15.0, fields_updated=_IMU if self._ms // 20 % 4 else _IMU | _MAGNETOMETER,
            id=0,
        )  # fmt: skip

    def _scaled_imu(self) -> bytes:
        quad = self._s.world.quad
        x, y, z = (round(a / GRAVITY_MPS2 * 1000) for a in body_acceleration(self._s.world.quad))
        return self._pack(
            "SCALED_IMU", time_boot_ms=self._ms, xacc=x, yacc=y, zacc=z,
            xgyro=round(quad.roll_rate * 1000), ygyro=round(quad.pitch_rate * 1000),
            zgyro=round(quad.yaw_rate * 1000), xmag=210, ymag=0, zmag=430, temperature=0,
        )  # fmt: skip

    def _pressure(self) -> bytes:
        height = self._s.world.options.altitude_amsl_m + self._s.world.quad.height_m
        return self._pack(
            "SCALED_PRESSURE", time_boot_ms=self._ms, press_abs=pressure_hpa(height),
            press_diff=0.0, temperature=1177, temperature_press_diff=0,
        )  # fmt: skip

    def _outputs_us(self) -> list[float]:
        quad = self._s.world.quad
        if not quad.demand.spinning:
            return [_PWM_OFF] * 16
        return [_PWM_MIN + 1000.0 * o for o in quad.motor_outputs()] + [_PWM_OFF] * 12

    def _servos(self) -> bytes:
        values = {f"servo{i}_raw": round(us) for i, us in enumerate(self._outputs_us(), 1)}
        return self._pack("SERVO_OUTPUT_RAW", time_usec=self._us & 0xFFFFFFFF, port=0, **values)

    def _actuators(self) -> bytes:
        return self._pack(
            "ACTUATOR_OUTPUT_STATUS", time_usec=self._us, active=16,
            actuator=self._outputs_us() + [0.0] * 16,
        )  # fmt: skip

    def _position_target(self) -> bytes:
        c = self._s.control
        target = c.target
        if not self._s.commander.armed or self._s.commander.landed:
            return self._pack(
                "POSITION_TARGET_LOCAL_NED", time_boot_ms=self._ms, coordinate_frame=1,
                type_mask=63, x=NAN, y=NAN, z=NAN, vx=NAN, vy=NAN, vz=NAN, afx=0.0, afy=0.0,
                afz=100.0, yaw=self._s.world.quad.yaw, yaw_rate=0.0,
            )  # fmt: skip
        position, velocity = (target.x, target.y, target.z), (c.wish_vx, c.wish_vy, c.wish_vz)
        mask = sum(1 << i for i, v in enumerate((*position, *velocity)) if not math.isfinite(v))
        x, y, z = position
        vx, vy, vz = velocity
        return self._pack(
            "POSITION_TARGET_LOCAL_NED", time_boot_ms=self._ms, coordinate_frame=1,
            type_mask=mask, x=x, y=y, z=z, vx=vx, vy=vy, vz=vz, afx=c.wish_ax, afy=c.wish_ay,
            afz=c.wish_az, yaw=c.yaw_wish, yaw_rate=0.0,
        )  # fmt: skip

    def _waypoint(self) -> bytes | None:
        c, nav, commander = self._s.control, self._s.navigation, self._s.commander
        target = c.target
        flying = commander.armed and not commander.landed
        if not flying or commander.mode not in AUTO_MODES or not math.isfinite(target.x):
            return None
        latitude, longitude = nav.origin.reproject(target.x, target.y)
        return self._pack(
            "POSITION_TARGET_GLOBAL_INT", time_boot_ms=self._ms, coordinate_frame=5, type_mask=0,
            lat_int=round(latitude * 1e7), lon_int=round(longitude * 1e7),
            alt=nav.origin_altitude_m - target.z if math.isfinite(target.z) else 0.0,
            vx=c.wish_vx, vy=c.wish_vy, vz=c.wish_vz, afx=c.wish_ax, afy=c.wish_ay,
            afz=c.wish_az, yaw=c.yaw_wish, yaw_rate=0.0,
        )  # fmt: skip

    def _origin(self) -> bytes:
        nav = self._s.navigation
        return self._pack(
            "GPS_GLOBAL_ORIGIN", latitude=round(nav.origin.latitude_deg * 1e7),
            longitude=round(nav.origin.longitude_deg * 1e7),
            altitude=round(nav.origin_altitude_m * 1000), time_usec=self._us,
        )  # fmt: skip

    def _wind(self) -> bytes | None:
        if not self.wind.started:
            return None
        return self._pack(
            "WIND_COV", time_usec=self._us, wind_x=self.wind.n, wind_y=self.wind.e, wind_z=0.0,
            var_horiz=0.09, var_vert=0.0, wind_alt=self._s.navigation.estimator.altitude_m,
            horiz_accuracy=0.0, vert_accuracy=0.0,
        )  # fmt: skip

    def _vibration(self) -> bytes:
        flying = not self._s.world.quad.on_ground
        return self._pack(
            "VIBRATION", time_usec=self._us, vibration_x=0.0,
            vibration_y=0.095 if flying else 0.0, vibration_z=1.4 if flying else 0.2,
            clipping_0=0, clipping_1=0, clipping_2=0,
        )  # fmt: skip
