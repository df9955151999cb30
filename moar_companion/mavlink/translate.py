"""Where MAVLink's fields and ours meet: messages to `Telemetry`, setpoints to messages. Pure.

Each message has one function in the table at the end; MAVLink's many ways to say "unknown" become
`None` here and nowhere else. Sources: the message definitions, and for what they leave open PX4
v1.17/v1.18 and ArduCopter 4.6.3 as recorded.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from ..types import (
    Attitude,
    AutopilotKind,
    AutopilotStatus,
    Battery,
    Estimator,
    GeodeticPoint,
    GlobalPosition,
    Gnss,
    Heard,
    Home,
    LandedState,
    LocalOrigin,
    LocalPosition,
    MotorOutputs,
    Radio,
    RemoteControl,
    Telemetry,
    Vector,
    Wind,
)
from . import modes
from .dialect import Message, mavlink

POSITION_VELOCITY_YAW = 0x9C0
"""POSITION_TARGET_TYPEMASK: accelerations and yaw rate ignored; the mask both autopilots obey."""

_KINDS = {
    int(mavlink.MAV_AUTOPILOT_PX4): AutopilotKind.PX4,
    int(mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA): AutopilotKind.ARDUPILOT,
}
_NO_AIRCRAFT = {
    int(mavlink.MAV_TYPE_ANTENNA_TRACKER),
    int(mavlink.MAV_TYPE_GCS),
    int(mavlink.MAV_TYPE_ONBOARD_CONTROLLER),
    int(mavlink.MAV_TYPE_GIMBAL),
    int(mavlink.MAV_TYPE_ADSB),
    int(mavlink.MAV_TYPE_CAMERA),
    int(mavlink.MAV_TYPE_CHARGING_STATION),
    int(mavlink.MAV_TYPE_FLARM),
    int(mavlink.MAV_TYPE_SERVO),
    int(mavlink.MAV_TYPE_ODID),
    int(mavlink.MAV_TYPE_BATTERY),
    int(mavlink.MAV_TYPE_LOG),
    int(mavlink.MAV_TYPE_OSD),
    int(mavlink.MAV_TYPE_IMU),
    int(mavlink.MAV_TYPE_GPS),
    int(mavlink.MAV_TYPE_WINCH),
}
_LANDED_STATES = {state.value: state for state in LandedState}

_UNKNOWN_DOP = 9999
"""ArduPilot says 9999, PX4 10000, the definition 65535: 100 DOP from here on is unknown."""
_UNKNOWN_U8 = 255
_UNKNOWN_U16 = 65535
_UNKNOWN_U32 = 4294967295
_MAX_RSSI = 254
_IDLE_PULSE_US = 900
"""PX4 gives outputs without a function, and all while disarmed, 900 µs; ArduPilot gives 0."""
_BATTERY_STATUS_TIMEOUT_S = 5.0
"""PX4 sends BATTERY_STATUS at 0.5 Hz: after two missed ones SYS_STATUS speaks for battery 0."""
_MAX_FLOAT = 3.4028234663852886e38
_HORIZONTAL_POSITION = 0x10
"""Absolute horizontal position, in ESTIMATOR_STATUS and EKF_STATUS_REPORT alike."""
_PX4_GPS_GLITCH = 0x400
_ARDUPILOT_GPS_GLITCH = 0x8000


def update(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    """The telemetry with what this message says; unchanged by messages of no interest.

    Ids are not looked at: the caller passes messages of the autopilot, heartbeats of ground
    stations and RADIO_STATUS. Never raises on a decoded message.
    """
    translator = _TRANSLATORS.get(message.get_msgId())
    return telemetry if translator is None else translator(telemetry, message, now_s)


def autopilot_kind(message: Message) -> AutopilotKind | None:
    """Whose autopilot a HEARTBEAT comes from; None when it is not an aircraft's autopilot's."""
    if message.autopilot == mavlink.MAV_AUTOPILOT_INVALID or message.type in _NO_AIRCRAFT:
        return None
    return _KINDS.get(message.autopilot, AutopilotKind.UNKNOWN)


def is_ground_station(message: Message) -> bool:
    """Whether a HEARTBEAT is a ground station's (MAV_TYPE_GCS)."""
    return bool(message.type == mavlink.MAV_TYPE_GCS)


def boot_time_s(message: Message) -> float | None:
    """The autopilot's own clock in a message that carries it, else None.

    Both autopilots' TIMESYNC requests carry the time since boot too; ArduPilot without requested
    streams sends nothing else that does.
    """
    message_id = message.get_msgId()
    if message_id in _WITH_BOOT_TIME:
        return float(message.time_boot_ms) * 1e-3
    if message_id == mavlink.MAVLINK_MSG_ID_TIMESYNC and message.tc1 == 0:
        return float(message.ts1) * 1e-9
    return None


def setpoint_message(
    *,
    target_system: int,
    target_component: int,
    position_ned_m: Vector,
    velocity_ned_mps: Vector,
    yaw_rad: float,
    now_s: float,
) -> Message:
    """SET_POSITION_TARGET_LOCAL_NED: position, feed-forward velocity, yaw; MAV_FRAME_LOCAL_NED.

    Raises ValueError when a value is not finite: ArduPilot's process dies of a NaN position, PX4
    drops the position without a word.
    """
    values = (*position_ned_m, *velocity_ned_mps, yaw_rad)
    if not all(is_sendable(value) for value in values):
        raise ValueError(f"a setpoint must be finite: {values}")
    return mavlink.MAVLink_set_position_target_local_ned_message(
        milliseconds(now_s),
        target_system,
        target_component,
        mavlink.MAV_FRAME_LOCAL_NED,
        POSITION_VELOCITY_YAW,
        *position_ned_m,
        *velocity_ned_mps,
        0.0,
        0.0,
        0.0,
        yaw_rad,
        0.0,
    )


def is_sendable(value: float) -> bool:
    """Whether a value is finite as MAVLink's float (single precision)."""
    return abs(value) <= _MAX_FLOAT


def milliseconds(now_s: float) -> int:
    """Our clock as MAVLink's time_boot_ms, which wraps after 49 days."""
    return int(now_s * 1000.0) & 0xFFFFFFFF


def _heartbeat(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    if is_ground_station(message):
        heard = Heard(received_s=now_s, system_id=message.get_srcSystem())
        return replace(telemetry, ground_station=heard)
    kind = autopilot_kind(message)
    if kind is None:
        return telemetry
    return replace(
        telemetry,
        autopilot=AutopilotStatus(
            received_s=now_s,
            system_id=message.get_srcSystem(),
            component_id=message.get_srcComponent(),
            kind=kind,
            armed=bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED),
            custom_mode=message.custom_mode,
            mode=modes.mode_name(kind, message.custom_mode),
            ours=modes.is_ours(kind, message.custom_mode),
            failsafe=modes.is_failsafe(message.system_status),
        ),
    )


def _attitude(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    roll, pitch, yaw = message.roll, message.pitch, message.yaw
    if not math.isfinite(roll + pitch + yaw):
        return telemetry
    attitude = Attitude(received_s=now_s, roll_rad=roll, pitch_rad=pitch, yaw_rad=yaw)
    return replace(telemetry, attitude=attitude)


def _local_position(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    position = (message.x, message.y, message.z)
    velocity = (message.vx, message.vy, message.vz)
    if not math.isfinite(sum(position) + sum(velocity)):
        return telemetry
    return replace(
        telemetry,
        local_position=LocalPosition(
            received_s=now_s,
            boot_s=message.time_boot_ms * 1e-3,
            position_ned_m=position,
            velocity_ned_mps=velocity,
        ),
    )


def _local_origin(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    point = _point(message.latitude, message.longitude, message.altitude)
    if point is None:
        return telemetry
    return replace(telemetry, local_origin=LocalOrigin(received_s=now_s, point=point))


def _home(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    point = _point(message.latitude, message.longitude, message.altitude)
    position = (message.x, message.y, message.z)
    if point is None or not math.isfinite(sum(position)):
        return telemetry
    home = Home(received_s=now_s, point=point, position_ned_m=position)
    return replace(telemetry, home=home)


def _global_position(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    point = _point(message.lat, message.lon, message.alt)
    if point is None:
        return telemetry
    return replace(telemetry, global_position=GlobalPosition(received_s=now_s, point=point))


def _point(latitude_e7: int, longitude_e7: int, altitude_mm: int) -> GeodeticPoint | None:
    """A point; ArduPilot sends 0, 0 until it has one."""
    if (latitude_e7 == 0 and longitude_e7 == 0) or abs(latitude_e7) > 900_000_000:
        return None
    return GeodeticPoint(
        latitude_deg=latitude_e7 * 1e-7,
        longitude_deg=longitude_e7 * 1e-7,
        altitude_amsl_m=altitude_mm * 1e-3,
    )


def _landed_state(telemetry: Telemetry, message: Message, _now_s: float) -> Telemetry:
    landed_state = _LANDED_STATES.get(message.landed_state)
    if landed_state is telemetry.landed_state:
        return telemetry
    return replace(telemetry, landed_state=landed_state)


def _battery_status(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    # One entry is the whole pack (both autopilots' way), or there is one per cell.
    voltage_mv = sum(value for value in message.voltages if value != _UNKNOWN_U16) + sum(
        value for value in message.voltages_ext if value != _UNKNOWN_U16
    )
    battery = Battery(
        received_s=now_s,
        remaining=_percent(message.battery_remaining),
        voltage_v=voltage_mv * 1e-3 if voltage_mv else None,
        current_a=_current_a(message.current_battery),
        charge_state=message.charge_state or None,
    )
    return replace(telemetry, batteries={**telemetry.batteries, message.id: battery})


def _sys_status(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    known = telemetry.batteries.get(0)
    if (
        known is not None
        and not known.summary
        and now_s - known.received_s <= _BATTERY_STATUS_TIMEOUT_S
    ):
        return telemetry
    voltage_mv = message.voltage_battery
    battery = Battery(
        received_s=now_s,
        remaining=_percent(message.battery_remaining),
        voltage_v=None if voltage_mv in {0, _UNKNOWN_U16} else voltage_mv * 1e-3,
        current_a=_current_a(message.current_battery),
        charge_state=None,
        summary=True,
    )
    if battery.voltage_v is None and battery.remaining is None:
        # ArduPilot without a battery monitor.
        return telemetry
    return replace(telemetry, batteries={**telemetry.batteries, 0: battery})


def _percent(value: int) -> float | None:
    """battery_remaining: -1 is unknown."""
    return value * 0.01 if 0 <= value <= 100 else None


def _current_a(value_ca: int) -> float | None:
    """current_battery in cA: unknown is -1 in ArduPilot and in the definition, -100 in PX4."""
    return value_ca * 0.01 if value_ca >= 0 else None


def _gnss(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    satellites = message.satellites_visible
    return replace(
        telemetry,
        gnss=Gnss(
            received_s=now_s,
            receiver_s=message.time_usec * 1e-6 if message.time_usec else None,
            fix_type=message.fix_type,
            satellites=None if satellites == _UNKNOWN_U8 else satellites,
            hdop=_dilution(message.eph),
            vdop=_dilution(message.epv),
            horizontal_accuracy_m=_accuracy_m(message.h_acc),
            vertical_accuracy_m=_accuracy_m(message.v_acc),
        ),
    )


def _dilution(value: int) -> float | None:
    """eph, epv: 100 times the dilution of precision; no receiver has a dilution of 0."""
    return value * 0.01 if 0 < value < _UNKNOWN_DOP else None


def _accuracy_m(value_mm: int) -> float | None:
    """h_acc, v_acc in mm: extensions, so 0 where they are not sent."""
    return None if value_mm in {0, _UNKNOWN_U32} else value_mm * 1e-3


def _estimator_status(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    accuracy_m = message.pos_horiz_accuracy
    return replace(
        telemetry,
        estimator=Estimator(
            received_s=now_s,
            flags=message.flags,
            horizontal_position_ok=_horizontal_position_ok(message.flags, _PX4_GPS_GLITCH),
            horizontal_accuracy_m=accuracy_m if math.isfinite(accuracy_m) else None,
        ),
    )


def _ekf_status_report(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    # Its variances are innovation test ratios, not metres.
    return replace(
        telemetry,
        estimator=Estimator(
            received_s=now_s,
            flags=message.flags,
            horizontal_position_ok=_horizontal_position_ok(message.flags, _ARDUPILOT_GPS_GLITCH),
            horizontal_accuracy_m=None,
        ),
    )


def _horizontal_position_ok(flags: int, glitch: int) -> bool:
    """Absolute position claimed, and not while GPS is being refused.

    "Constant position" (0x80) is no objection: PX4 sets it while standing, beside a good position.
    """
    return bool(flags & _HORIZONTAL_POSITION) and not flags & glitch


def _wind_cov(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    north, east, down = message.wind_x, message.wind_y, message.wind_z
    if not math.isfinite(north + east):
        return replace(telemetry, wind=None)
    # Multirotor estimators know no vertical wind.
    velocity = (north, east, down if math.isfinite(down) else 0.0)
    return replace(telemetry, wind=Wind(received_s=now_s, velocity_ned_mps=velocity))


def _wind(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    speed, direction_deg, down = message.speed, message.direction, message.speed_z
    unknown = speed == 0.0 and abs(direction_deg) >= 179.99
    if unknown or not math.isfinite(speed + direction_deg):
        return replace(telemetry, wind=None)
    # The direction is where the wind comes from.
    towards_rad = math.radians(direction_deg) + math.pi
    velocity = (
        speed * math.cos(towards_rad),
        speed * math.sin(towards_rad),
        down if math.isfinite(down) else 0.0,
    )
    return replace(telemetry, wind=Wind(received_s=now_s, velocity_ned_mps=velocity))


def _radio_status(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    free_percent = message.txbuf
    return replace(
        telemetry,
        radio=Radio(
            received_s=now_s,
            rssi=_signal(message.rssi),
            remote_rssi=_signal(message.remrssi),
            noise=_signal(message.noise),
            remote_noise=_signal(message.remnoise),
            receive_errors=message.rxerrors,
            transmit_buffer_percent=free_percent if free_percent <= 100 else None,
        ),
    )


def _signal(value: int) -> int | None:
    return None if value == _UNKNOWN_U8 else value


def _rc_channels(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    rssi = None if message.rssi == _UNKNOWN_U8 else message.rssi / _MAX_RSSI
    return replace(telemetry, remote_control=RemoteControl(received_s=now_s, rssi=rssi))


def _servo_output_raw(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    if message.port != 0:
        return telemetry
    pulses = (
        message.servo1_raw,
        message.servo2_raw,
        message.servo3_raw,
        message.servo4_raw,
        message.servo5_raw,
        message.servo6_raw,
        message.servo7_raw,
        message.servo8_raw,
        message.servo9_raw,
        message.servo10_raw,
        message.servo11_raw,
        message.servo12_raw,
        message.servo13_raw,
        message.servo14_raw,
        message.servo15_raw,
        message.servo16_raw,
    )
    in_use = tuple(pulse for pulse in pulses if _IDLE_PULSE_US < pulse != _UNKNOWN_U16)
    return replace(telemetry, motors=MotorOutputs(received_s=now_s, pulse_us=in_use))


_TRANSLATORS: dict[int, Callable[[Telemetry, Message, float], Telemetry]] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: _heartbeat,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: _sys_status,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: _gnss,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: _attitude,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: _local_position,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: _global_position,
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: _servo_output_raw,
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: _local_origin,
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS: _rc_channels,
    mavlink.MAVLINK_MSG_ID_RADIO_STATUS: _radio_status,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: _battery_status,
    mavlink.MAVLINK_MSG_ID_WIND: _wind,
    mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: _ekf_status_report,
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: _estimator_status,
    mavlink.MAVLINK_MSG_ID_WIND_COV: _wind_cov,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: _home,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: _landed_state,
}

_WITH_BOOT_TIME = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_SYSTEM_TIME,
        mavlink.MAVLINK_MSG_ID_ATTITUDE,
        mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
        mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
    }
)

MESSAGE_IDS: frozenset[int] = frozenset(_TRANSLATORS)
"""The messages that change telemetry."""
