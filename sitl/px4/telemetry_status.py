"""PX4's telemetry of state: health, battery, mode, home, time, identification.

Field values, sentinels included, follow recordings of PX4 v1.17.0.
"""

import math
from typing import Final

from sitl.builders import Builder
from sitl.instruments import quaternion
from sitl.px4.builders import Builders, Sources
from sitl.px4.modes import Mode
from sitl.world import EPOCH_US

_STICKS_BIT: Final = 1 << 16
_BATTERY_BIT: Final = 1 << 25
_PREARM_BIT: Final = 1 << 28
_CURRENT_UNKNOWN_CA: Final = -100
_SIM_CURRENT_MAH_PER_S: Final = 1.0 / 3.6


class StatusMessages(Builders):
    """The builders of this group."""

    def __init__(self, sources: Sources) -> None:
        """Start with the first PING."""
        super().__init__(sources)
        self._ping = 0

    def table(self) -> dict[str, Builder]:
        """Return the builders by message name."""
        return {
            "BATTERY_STATUS": self._battery,
            "CURRENT_EVENT_SEQUENCE": self._event_sequence,
            "CURRENT_MODE": self._current_mode,
            "EXTENDED_SYS_STATE": self._extended_state,
            "GNSS_INTEGRITY": self._gnss_integrity,
            "HEARTBEAT": self._heartbeat,
            "HOME_POSITION": self._home,
            "MISSION_CURRENT": self._mission_current,
            "OPEN_DRONE_ID_LOCATION": self._remote_id_location,
            "OPEN_DRONE_ID_SYSTEM": self._remote_id_system,
            "PING": self._ping_request,
            "RC_CHANNELS": self._channels,
            "SYSTEM_TIME": self._system_time,
            "SYS_STATUS": self._sys_status,
            "TIMESYNC": self._timesync,
            "TIME_ESTIMATE_TO_TARGET": self._time_estimate,
        }

    def _heartbeat(self) -> bytes:
        commander = self._s.commander
        return self._pack(
            "HEARTBEAT", type=2, autopilot=12, base_mode=commander.base_mode,
            custom_mode=commander.mode.custom_mode, system_status=commander.system_status,
            mavlink_version=3,
        )  # fmt: skip

    def _sys_status(self) -> bytes:
        s = self._s
        nav, commander = s.navigation, s.commander
        booting = nav.since_boot_s < 2.2
        if booting:
            present, enabled, health = 0, 0, 0x0321C83F
        else:
            present, enabled = 0x0300400F, 0x0301400F
            if nav.gps_fused:
                present |= 0x20
                enabled |= 0x20
            health = 0x0320C83F if nav.position_valid else 0x0320883F
            if commander.can_arm:
                health |= _PREARM_BIT
            if commander.sticks_present:
                present |= _STICKS_BIT
                health |= _STICKS_BIT
        if commander.charge > 1:
            health &= ~_BATTERY_BIT
        battery = s.world.battery
        load = 0 if nav.since_boot_s < 1.0 else 90 + int(abs(self._noise(0.0, 30.0)))
        return self._pack(
            "SYS_STATUS", onboard_control_sensors_present=present,
            onboard_control_sensors_enabled=enabled, onboard_control_sensors_health=health,
            load=load, voltage_battery=round(battery.voltage_v * 1000),
            current_battery=self._current_ca(), battery_remaining=self._remaining(),
            drop_rate_comm=0, errors_comm=0, errors_count1=0, errors_count2=0, errors_count3=0,
            errors_count4=0, onboard_control_sensors_present_extended=0,
            onboard_control_sensors_enabled_extended=0,
            onboard_control_sensors_health_extended=1,
        )  # fmt: skip

    def _current_ca(self) -> int:
        battery = self._s.world.battery
        if not battery.options.reports_current:
            return _CURRENT_UNKNOWN_CA
        return round(battery.current_a * 100)

    def _remaining(self) -> int:
        """Percent, cut off; a full pack reads 99 as PX4's does."""
        return min(99, int(self._s.world.battery.fraction * 100.0))

    def _battery(self) -> bytes:
        battery = self._s.world.battery
        return self._pack(
            "BATTERY_STATUS", id=0, battery_function=1, type=1, temperature=32767,
            voltages=(round(battery.voltage_v * 1000), *(65535,) * 9),
            current_battery=self._current_ca(),
            current_consumed=-int(self._us / 1e6 * _SIM_CURRENT_MAH_PER_S),
            energy_consumed=-1, battery_remaining=self._remaining(), time_remaining=0,
            charge_state=int(self._s.commander.charge), voltages_ext=(0, 0, 0, 0), mode=0,
            fault_bitmask=0,
        )  # fmt: skip

    def _extended_state(self) -> bytes:
        return self._pack(
            "EXTENDED_SYS_STATE", vtol_state=0, landed_state=self._s.commander.landed_state
        )

    def _current_mode(self) -> bytes:
        commander = self._s.commander
        standard = {Mode.POSCTL: 1, Mode.ALTCTL: 4, Mode.RTL: 5, Mode.LAND: 7, Mode.TAKEOFF: 8}
        return self._pack(
            "CURRENT_MODE", standard_mode=standard.get(commander.mode, 0),
            custom_mode=commander.mode.custom_mode,
            intended_custom_mode=commander.intended.custom_mode,
        )  # fmt: skip

    def _home(self) -> bytes | None:
        nav = self._s.navigation
        if nav.since_boot_s < 2.2:
            return None
        return self._pack(
            "HOME_POSITION", latitude=round(nav.home_latitude_deg * 1e7),
            longitude=round(nav.home_longitude_deg * 1e7),
            altitude=round(nav.home_altitude_m * 1000), x=nav.home_x, y=nav.home_y, z=nav.home_z,
            q=quaternion(0.0, 0.0, nav.home_yaw), approach_x=0.0, approach_y=0.0,
            approach_z=0.0, time_usec=self._us,
        )  # fmt: skip

    def _channels(self) -> bytes | None:
        sticks = self._s.sticks
        if not sticks.remote_control:
            return None
        values = {f"chan{i}_raw": us for i, us in enumerate(sticks.channels(), 1)}
        values |= {f"chan{i}_raw": 65535 for i in range(9, 19)}
        return self._pack("RC_CHANNELS", time_boot_ms=self._ms, chancount=8, rssi=100, **values)

    def _system_time(self) -> bytes:
        return self._pack(
            "SYSTEM_TIME", time_unix_usec=EPOCH_US + self._s.world.now_us, time_boot_ms=self._ms
        )

    def _timesync(self) -> bytes:
        return self._pack("TIMESYNC", tc1=0, ts1=self._us * 1000)

    def _ping_request(self) -> bytes:
        self._ping += 1
        return self._pack(
            "PING", time_usec=self._us, seq=self._ping - 1, target_system=0, target_component=0
        )

    def _mission_current(self) -> bytes:
        return self._pack("MISSION_CURRENT", seq=0, total=65535, mission_state=1, mission_mode=2)

    def _time_estimate(self) -> bytes:
        return self._pack(
            "TIME_ESTIMATE_TO_TARGET", safe_return=0 if not self._s.commander.armed else 106,
            land=-1, mission_next_item=-1, mission_end=-1, commanded_action=-1,
        )  # fmt: skip

    def _event_sequence(self) -> bytes:
        return self._pack("CURRENT_EVENT_SEQUENCE", sequence=self._s.text_sender.sequence, flags=0)

    def _gnss_integrity(self) -> bytes | None:
        fix = self._s.navigation.estimator.fix
        if fix is None or not fix.alive:
            return None
        return self._pack(
            "GNSS_INTEGRITY", id=4, system_errors=0, authentication_state=0, jamming_state=0,
            spoofing_state=0, raim_state=0, raim_hfom=65535, raim_vfom=65535,
            corrections_quality=255, system_status_summary=255, gnss_signal_quality=255,
            post_processing_quality=255,
        )  # fmt: skip

    def _remote_id_location(self) -> bytes | None:
        fix, e = self._s.navigation.estimator.fix, self._s.navigation.estimator
        if fix is None:
            return None
        return self._pack(
            "OPEN_DRONE_ID_LOCATION", target_system=0, target_component=0, id_or_mac=(0,) * 20,
            status=1 if self._s.commander.landed else 2,
            direction=int(math.degrees(math.atan2(e.ve, e.vn)) % 360.0) * 100,
            speed_horizontal=round(math.hypot(e.vn, e.ve) * 100),
            speed_vertical=round(-e.vd * 100), latitude=round(fix.latitude_deg * 1e7),
            longitude=round(fix.longitude_deg * 1e7), altitude_barometric=e.altitude_m,
            altitude_geodetic=float(round(fix.altitude_m)), height_reference=0,
            height=self._s.world.quad.height_m, horizontal_accuracy=12, vertical_accuracy=5,
            barometer_accuracy=0, speed_accuracy=3, timestamp=65535.0, timestamp_accuracy=0,
        )  # fmt: skip

    def _remote_id_system(self) -> bytes | None:
        nav = self._s.navigation
        fix = nav.estimator.fix
        if fix is None or not fix.fix_type:
            return None
        return self._pack(
            "OPEN_DRONE_ID_SYSTEM", target_system=0, target_component=0, id_or_mac=(0,) * 20,
            operator_location_type=0, classification_type=0,
            operator_latitude=round(nav.home_latitude_deg * 1e7),
            operator_longitude=round(nav.home_longitude_deg * 1e7), area_count=1, area_radius=0,
            area_ceiling=-1000.0, area_floor=-1000.0, category_eu=0, class_eu=0,
            operator_altitude_geo=nav.home_altitude_m, timestamp=2748666496,
        )  # fmt: skip
