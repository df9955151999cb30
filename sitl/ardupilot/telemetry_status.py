"""ArduPilot's telemetry of state: health, battery, mode, home, time, identification.

Field values, sentinels included, follow recordings of ArduCopter 4.6.3 in its own simulator.
"""

import math
from typing import Final

from sitl.ardupilot.modes import Mode
from sitl.ardupilot.state import State
from sitl.ardupilot.telemetry_motion import MotionMessages, Place
from sitl.builders import Builder, Builders
from sitl.geodesy import FlatProjection
from sitl.parameters import Parameters, version_number
from sitl.world import EPOCH_US, World

_BOOT: Final = 1
_ON_GROUND: Final = 1
_POSITION_MODES: Final = frozenset(
    mode.number
    for mode in (Mode.AUTO, Mode.GUIDED, Mode.LOITER, Mode.RTL, Mode.BRAKE, Mode.SMART_RTL)
)
_HORIZONTAL_POSITION: Final = 0x10
"""Bit of EKF_STATUS_REPORT.flags."""

_CUSTOM, _GUIDED, _STABILIZED, _MANUAL, _ARMED = 1, 8, 16, 64, 128
"""Bits of base_mode."""

_PRESENT: Final = 0x5371FC0F
_GPS: Final = 0x20
_ALTITUDE_CONTROL, _POSITION_CONTROL, _REMOTE_CONTROL = 0x2000, 0x4000, 0x10000
_GEOFENCE, _AHRS, _LOGGING, _BATTERY = 0x100000, 0x200000, 0x1000000, 0x2000000
_PROXIMITY, _PRE_ARM = 0x4000000, 0x10000000
"""Bits of SYS_STATUS's sensors."""
_LOGS_AFTER_DISARMING_S: Final = 15.0
_ALIGNED_AFTER_ORIGIN_S: Final = 2.2

_NOT_ALIGNED, _NO_AIRSPEED_SENSOR = 4096, 2
"""Bits of HIGH_LATENCY2.failure_flags."""
_HJ_PER_WH: Final = 36.0
_MOST_CA: Final = 32767
_NAN4: Final = (math.nan,) * 4


class StatusMessages(Builders):
    """The builders of this group."""

    def __init__(
        self,
        world: World,
        state: State,
        parameters: Parameters,
        motion: MotionMessages,
        boot_us: int,
    ) -> None:
        """Start as a booting vehicle."""
        super().__init__(world, boot_us)
        self._state = state
        self._parameters = parameters
        self._motion = motion
        self._controlled_position = True
        self._logs_for_s = 0.0
        self._origin_for_s = 0.0

    def table(self) -> dict[str, Builder]:
        """Return the builders by message name."""
        return {
            "AUTOPILOT_VERSION": self._version,
            "BATTERY_STATUS": self._battery,
            "ESC_TELEMETRY_1_TO_4": self._motors,
            "EXTENDED_SYS_STATE": self._extended_state,
            "GPS_GLOBAL_ORIGIN": self._origin,
            "HEARTBEAT": self._heartbeat,
            "HIGH_LATENCY2": self._high_latency,
            "HOME_POSITION": self._home,
            "MEMINFO": self._memory,
            "MISSION_CURRENT": self._mission_current,
            "POWER_STATUS": self._power,
            "RC_CHANNELS": self._channels,
            "SYSTEM_TIME": self._system_time,
            "SYS_STATUS": self._sys_status,
            "TIMESYNC": self._timesync,
        }

    def step(self, dt_s: float) -> None:
        """Advance the parts that have a memory."""
        state = self._state
        self._logs_for_s = _LOGS_AFTER_DISARMING_S if state.armed else self._logs_for_s - dt_s
        if state.origin is not None:
            self._origin_for_s += dt_s
        self._controlled_position = self._controls_position

    @property
    def _aligned(self) -> bool:
        return self._origin_for_s >= _ALIGNED_AFTER_ORIGIN_S

    @property
    def _controls_position(self) -> bool:
        """True if the position control runs; a booting vehicle reports so."""
        state = self._state
        if state.system_status == _BOOT or state.custom_mode in _POSITION_MODES:
            return True
        knows = bool(state.ekf_flags & _HORIZONTAL_POSITION)
        return state.custom_mode == Mode.LAND.number and (knows or state.landed_state == _ON_GROUND)

    @property
    def _base_mode(self) -> int:
        """Return base_mode; the heartbeat that announces a mode keeps the last one's guided bit.

        ArduPilot sends it before the new mode has run for the first time.
        """
        mode = _CUSTOM | _STABILIZED | _MANUAL
        if self._controls_position or self._controlled_position:
            mode |= _GUIDED
        return mode | _ARMED if self._state.armed else mode

    def _heartbeat(self) -> bytes:
        return self._pack(
            "HEARTBEAT", type=2, autopilot=3, base_mode=self._base_mode,
            custom_mode=self._state.custom_mode, system_status=self._state.system_status,
            mavlink_version=3,
        )  # fmt: skip

    def _sys_status(self) -> bytes:
        state, receiver, monitored = self._state, self._motion.receiver, self._monitored
        present = _PRESENT | (_GPS if receiver.shown is not None else 0)
        idle = 0  # neither enabled nor healthy
        if state.custom_mode == Mode.STABILIZE.number:
            idle |= _ALTITUDE_CONTROL
        if not self._controls_position:
            idle |= _POSITION_CONTROL
        if not self._aligned:
            idle |= _AHRS
        disabled = 0 if state.fence_enabled else _GEOFENCE
        if self._logs_for_s <= 0.0:
            disabled |= _LOGGING
        if not monitored:
            disabled |= _BATTERY
        ill = 0
        if not (state.armed or (self._aligned and state.ready_to_arm)):
            ill |= _PRE_ARM
        if state.remote_control_lost:
            ill |= _REMOTE_CONTROL
        if monitored and state.battery_charge_state > 1:
            ill |= _BATTERY
        if not receiver.healthy:
            ill |= _GPS
        if state.fence_breached:
            ill |= _GEOFENCE
        battery = self._world.battery
        return self._pack(
            "SYS_STATUS", onboard_control_sensors_present=present,
            onboard_control_sensors_enabled=present & ~(idle | disabled),
            onboard_control_sensors_health=(present | _PROXIMITY) & ~(idle | ill),
            load=0, voltage_battery=round(battery.voltage_v * 1000) if monitored else 0,
            current_battery=self._current_ca() if monitored else -1,
            battery_remaining=self._remaining() if monitored else -1,
            drop_rate_comm=0, errors_comm=0, errors_count1=0, errors_count2=0, errors_count3=0,
            errors_count4=0, onboard_control_sensors_present_extended=0,
            onboard_control_sensors_enabled_extended=0, onboard_control_sensors_health_extended=0,
        )  # fmt: skip

    # Battery

    @property
    def _monitored(self) -> bool:
        return self._parameters.value("BATT_MONITOR") != 0

    def _current_ca(self) -> int:
        return min(_MOST_CA, round(self._world.battery.current_a * 100))

    def _remaining(self) -> int:
        capacity_mah = self._parameters.value("BATT_CAPACITY")
        left = 1.0 - self._state.battery_consumed_mah / capacity_mah if capacity_mah else 0.0
        return max(0, int(left * 100.0))

    def _battery(self) -> bytes | None:
        if not self._monitored:
            return None
        battery = self._world.battery
        return self._pack(
            "BATTERY_STATUS", id=0, battery_function=0, type=0, temperature=32767,
            voltages=(round(battery.voltage_v * 1000), *(65535,) * 9),
            current_battery=self._current_ca(),
            current_consumed=int(self._state.battery_consumed_mah),
            energy_consumed=int(self._state.battery_consumed_wh * _HJ_PER_WH),
            battery_remaining=self._remaining(),
            time_remaining=0, charge_state=self._state.battery_charge_state,
            voltages_ext=(0, 0, 0, 0), mode=0, fault_bitmask=0,
        )  # fmt: skip

    def _motors(self) -> bytes:
        """ESC_TELEMETRY_1_TO_4 of the simulator: constants, and a counter of packets."""
        count = max(0, self._us - 6_000_000) // 2500 & 0xFFFF
        return self._pack(
            "ESC_TELEMETRY_1_TO_4", temperature=b"\x20" * 4, voltage=(1679,) * 4,
            current=(80,) * 4, totalcurrent=(1,) * 4, rpm=(0,) * 4, count=(count,) * 4,
        )  # fmt: skip

    def _power(self) -> bytes:
        return self._pack("POWER_STATUS", Vcc=5000, Vservo=0, flags=0)

    # Place and time

    def _origin(self) -> bytes | None:
        origin = self._state.origin
        if origin is None:
            return None
        latitude, longitude, altitude = _integers(origin)
        return self._pack(
            "GPS_GLOBAL_ORIGIN", latitude=latitude, longitude=longitude, altitude=altitude,
            time_usec=self._us,
        )  # fmt: skip

    def _home(self) -> bytes | None:
        home, origin = self._state.home, self._state.origin
        if home is None or origin is None:
            return None
        latitude, longitude, altitude = _integers(home)
        x, y = FlatProjection(origin[0], origin[1]).project(home[0], home[1])
        return self._pack(
            "HOME_POSITION", latitude=latitude, longitude=longitude, altitude=altitude,
            x=x, y=y, z=origin[2] - home[2], q=_NAN4, approach_x=0.0, approach_y=0.0,
            approach_z=0.0, time_usec=self._us,
        )  # fmt: skip

    def _system_time(self) -> bytes:
        known = self._motion.receiver.shown is not None
        return self._pack(
            "SYSTEM_TIME", time_unix_usec=EPOCH_US + self._world.now_us if known else 0,
            time_boot_ms=self._ms,
        )  # fmt: skip

    def _timesync(self) -> bytes:
        return self._pack("TIMESYNC", tc1=0, ts1=self._us * 1000 + 1)

    # Other reports

    def _extended_state(self) -> bytes:
        return self._pack("EXTENDED_SYS_STATE", vtol_state=3, landed_state=self._state.landed_state)

    def _channels(self) -> bytes:
        channels = self._state.channels_us
        values = {f"chan{i}_raw": us for i, us in enumerate(channels, 1)}
        values |= {f"chan{i}_raw": 0 for i in range(len(channels) + 1, 19)}
        return self._pack(
            "RC_CHANNELS", time_boot_ms=self._ms, chancount=len(channels),
            rssi=self._state.rssi, **values,
        )  # fmt: skip

    def _mission_current(self) -> bytes:
        return self._pack("MISSION_CURRENT", seq=0, total=0, mission_state=1, mission_mode=0)

    def _memory(self) -> bytes:
        return self._pack("MEMINFO", brkval=0, freemem=65535, freemem32=524288)

    def _version(self) -> bytes:
        return self._pack(
            "AUTOPILOT_VERSION", capabilities=64495,
            flight_sw_version=version_number(self._parameters.firmware),
            middleware_sw_version=0, os_sw_version=0, board_version=0,
            flight_custom_version=tuple(b"92b0cd78"), middleware_custom_version=(0,) * 8,
            os_custom_version=(0,) * 8, vendor_id=0, product_id=0, uid=0,
            uid2=tuple(b"3d1219c7c4c5404aa\0"),
        )  # fmt: skip

    def _high_latency(self) -> bytes:
        motion, state = self._motion, self._state
        e = self._world.estimator
        latitude, longitude, altitude = motion.place
        north, east, down = motion.to_target()
        wind_mps, wind_from_deg = state.wind_from or (0.0, -180.0)
        airspeed = min(255, int(motion.airspeed_mps * 5))
        return self._pack(
            "HIGH_LATENCY2", timestamp=self._ms, type=2, autopilot=3,
            custom_mode=state.custom_mode, latitude=round(latitude * 1e7),
            longitude=round(longitude * 1e7), altitude=int(altitude),
            target_altitude=int(altitude - down),
            heading=int(math.degrees(self._world.quad.yaw) % 360.0 / 2),
            target_heading=int(math.degrees(math.atan2(east, north)) % 360.0 / 2),
            target_distance=min(65535, int(math.hypot(north, east) / 10)),
            throttle=int(motion.thrust * 100), airspeed=airspeed, airspeed_sp=airspeed,
            groundspeed=min(255, int(math.hypot(e.vn, e.ve) * 5)),
            windspeed=min(255, int(wind_mps * 5)),
            wind_heading=int(wind_from_deg % 360.0 / 2) if state.position_known else 0,
            eph=0, epv=0, temperature_air=-128, climb_rate=0, battery=self._remaining(),
            wp_num=0, custom0=(self._base_mode + 128) % 256 - 128, custom1=0, custom2=0,
            failure_flags=_NO_AIRSPEED_SENSOR | (0 if self._aligned else _NOT_ALIGNED),
        )  # fmt: skip


def _integers(place: Place) -> tuple[int, int, int]:
    """Return 1e-7 degrees and millimetres; ArduPilot's altitude has centimetres."""
    latitude, longitude, altitude = place
    return round(latitude * 1e7), round(longitude * 1e7), round(altitude * 100) * 10
