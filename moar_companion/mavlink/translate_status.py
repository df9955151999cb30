"""Health of the aircraft: batteries, receivers, estimator, links to `Telemetry`. Pure.

Part of `translate`, which names the sources.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

from .autopilots import profile_of
from .dialect import LINK_NODE_STATUS_ID, Message, mavlink
from .telemetry import (
    Battery,
    Estimator,
    Firmware,
    Gnss,
    LinkNode,
    MagneticField,
    Readiness,
    RemoteControl,
    Telemetry,
)
from .translate_motors import motor_parameter

_UNKNOWN_DOP = 9999
"""Least value of 100 DOP that means unknown: ArduPilot 9999, PX4 10000, the definition 65535."""
_UNKNOWN_U8 = 255
_MOST_CELL_MV = 5000
"""Greatest voltage of a lithium cell."""
_UNKNOWN_U16 = 65535
_UNKNOWN_U32 = 4294967295
_NOT_FLOWN_WITH = {
    int(mavlink.MAV_BATTERY_FUNCTION_AVIONICS),
    int(mavlink.MAV_BATTERY_FUNCTION_PAYLOAD),
}
_BATTERY_STATUS_TIMEOUT_S = 5.0
"""Age of BATTERY_STATUS from which SYS_STATUS describes battery 0: PX4 sends at 0.5 Hz, so two
messages are missing."""
_HORIZONTAL_POSITION = 0x10
"""Absolute horizontal position, in ESTIMATOR_STATUS and EKF_STATUS_REPORT alike."""
ESTIMATOR_GPS_GLITCH = 0x400
"""In ESTIMATOR_STATUS."""
_EKF_GPS_GLITCH = 0x8000
"""In EKF_STATUS_REPORT."""
_MAGNETOMETER_UPDATED = 0x1C0
"""The three axes in HIGHRES_IMU.fields_updated; other values are repeats."""
_PREARM_CHECK = int(mavlink.MAV_SYS_STATUS_PREARM_CHECK)
_GEOFENCE = int(mavlink.MAV_SYS_STATUS_GEOFENCE)
_RC_RECEIVER = int(mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER)
_SENSOR_NAMES = {
    1 << bit: mavlink.enums["MAV_SYS_STATUS_SENSOR"][1 << bit]
    .name.removeprefix("MAV_SYS_STATUS_")
    .removeprefix("SENSOR_")
    .replace("_", " ")
    .lower()
    for bit in range(31)
    if 1 << bit != _PREARM_CHECK
}
_RELEASES = ((255, ""), (192, "rc"), (128, "beta"), (64, "alpha"), (0, "dev"))
"""FIRMWARE_VERSION_TYPE: the least value of each type, the greatest first."""


def _battery_status(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    if message.battery_function in _NOT_FLOWN_WITH:
        return telemetry
    # One entry for the whole pack (both autopilots), or one per cell; a pack above 65 V takes two
    # entries.
    entries_mv = [
        value
        for value in (*message.voltages, *message.voltages_ext)
        if value not in {0, _UNKNOWN_U16}
    ]
    voltage_mv = sum(entries_mv)
    reports_cells = len(entries_mv) > 1 and max(entries_mv) <= _MOST_CELL_MV
    battery = Battery(
        received_s=now_s,
        remaining=_percent(message.battery_remaining),
        voltage_v=voltage_mv * 1e-3 if voltage_mv else None,
        current_a=_current_a(message.current_battery),
        charge_state=message.charge_state or None,
        cells=len(entries_mv) if reports_cells else None,
    )
    if message.id not in telemetry.batteries and _is_not_connected(telemetry, battery):
        return telemetry
    batteries = {**telemetry.batteries, message.id: battery}
    zero = batteries.get(0)
    # A charge state comes only from battery 0's own message.
    only_summed_up = zero is not None and zero.summary and zero.charge_state is None
    if only_summed_up and _summary_is_of_any(telemetry, batteries):
        del batteries[0]
    return replace(telemetry, batteries=batteries)


def _is_not_connected(telemetry: Telemetry, battery: Battery) -> bool:
    """Returns True for a battery that PX4 reports and that is not connected: a voltage at most.

    PX4 estimates the charge of each one that is. ArduPilot reports some by their voltage alone.
    """
    reported = (battery.remaining, battery.current_a, battery.charge_state)
    return reported == (None, None, None) and not profile_of(telemetry).summary_is_battery_0


def _sys_status(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    # PX4 sets the pre-arm check's bit in health alone, ArduPilot in all three.
    health = message.onboard_control_sensors_health
    unhealthy = message.onboard_control_sensors_enabled & ~health
    readiness = Readiness(
        received_s=now_s,
        ready=bool(health & _PREARM_CHECK),
        unhealthy=tuple(name for bit, name in _SENSOR_NAMES.items() if unhealthy & bit),
        remote_control_ok=_remote_control_ok(telemetry, message),
        fence_enabled=bool(message.onboard_control_sensors_enabled & _GEOFENCE),
    )
    return _battery_summary(replace(telemetry, readiness=readiness), message, now_s)


def _remote_control_ok(telemetry: Telemetry, message: Message) -> bool | None:
    """State of the remote control; None until it was good once.

    PX4 reports a receiver without signal as not present.
    """
    ok = bool(
        message.onboard_control_sensors_present
        & message.onboard_control_sensors_enabled
        & message.onboard_control_sensors_health
        & _RC_RECEIVER
    )
    before = telemetry.readiness
    known = before is not None and before.remote_control_ok is not None
    return ok if ok or known else None


def _battery_summary(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    known = telemetry.batteries.get(0)
    if _summary_is_of_any(telemetry, telemetry.batteries) or (
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
        # SYS_STATUS has no charge state: the last one of BATTERY_STATUS stays valid.
        charge_state=None if known is None else known.charge_state,
        summary=True,
    )
    if battery.voltage_v is None and battery.remaining is None:
        # ArduPilot has no battery monitor.
        return telemetry
    return replace(telemetry, batteries={**telemetry.batteries, 0: battery})


def _summary_is_of_any(telemetry: Telemetry, batteries: Mapping[int, Battery]) -> bool:
    """Returns True if SYS_STATUS may describe another battery than 0, as PX4's the emptiest."""
    elsewhere = any(number != 0 for number in batteries)
    return elsewhere and not profile_of(telemetry).summary_is_battery_0


def _percent(value: int) -> float | None:
    """Fraction from battery_remaining; None for -1."""
    return value * 0.01 if 0 <= value <= 100 else None


def _current_a(value_ca: int) -> float | None:
    """Current from current_battery in cA; None for unknown (-1; in PX4 -100)."""
    return value_ca * 0.01 if value_ca >= 0 else None


def _autopilot_version(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    version = message.flight_sw_version
    if version == 0:
        return telemetry
    major, minor, patch, release = version.to_bytes(4, "big")
    firmware = Firmware(
        received_s=now_s,
        version=(major, minor, patch),
        release=next(name for least, name in _RELEASES if release >= least),
    )
    return replace(telemetry, firmware=firmware)


def _gps_raw_int(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    return replace(telemetry, gnss=_gnss(message, now_s))


def _gps2_raw(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    always = profile_of(telemetry).better_gnss_taken
    return replace(
        telemetry,
        second_gnss=_gnss(message, now_s),
        better_gnss_taken=always or telemetry.better_gnss_taken,
    )


def _gnss(message: Message, now_s: float) -> Gnss:
    satellites = message.satellites_visible
    return Gnss(
        received_s=now_s,
        receiver_s=message.time_usec * 1e-6 if message.time_usec else None,
        fix_type=message.fix_type,
        satellites=None if satellites == _UNKNOWN_U8 else satellites,
        hdop=_dilution(message.eph),
        vdop=_dilution(message.epv),
        horizontal_accuracy_m=_accuracy_m(message.h_acc),
        vertical_accuracy_m=_accuracy_m(message.v_acc),
    )


def _dilution(value: int) -> float | None:
    """Dilution of precision from eph or epv (100 times); None for 0, which no receiver has."""
    return value * 0.01 if 0 < value < _UNKNOWN_DOP else None


def _accuracy_m(value_mm: int) -> float | None:
    """Accuracy from h_acc or v_acc in mm; None for 0: the extension fields are not sent."""
    return None if value_mm in {0, _UNKNOWN_U32} else value_mm * 1e-3


def _parameter(telemetry: Telemetry, message: Message, _now_s: float) -> Telemetry:
    name, value, autopilot = message.param_id, message.param_value, profile_of(telemetry)
    if name == autopilot.gnss_switch:
        return replace(telemetry, better_gnss_taken=value in autopilot.gnss_switch_better)
    if name == autopilot.gnss_primary:
        return replace(telemetry, second_gnss_first=value == 1.0)
    return motor_parameter(telemetry, message)


def _estimator_status(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    return replace(
        telemetry,
        estimator=Estimator(
            received_s=now_s,
            flags=message.flags,
            horizontal_position_ok=horizontal_position_ok(message.flags, ESTIMATOR_GPS_GLITCH),
            horizontal_accuracy_m=_finite(message.pos_horiz_accuracy),
            vertical_accuracy_m=_finite(message.pos_vert_accuracy),
            velocity_innovation=innovation(message.vel_ratio),
            position_innovation=innovation(message.pos_horiz_ratio),
            height_innovation=innovation(message.pos_vert_ratio),
            compass_innovation=innovation(message.mag_ratio),
        ),
    )


def _ekf_status_report(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    # EKF_STATUS_REPORT's variances are innovations as fractions of the accepted ones, not metres.
    return replace(
        telemetry,
        estimator=Estimator(
            received_s=now_s,
            flags=message.flags,
            horizontal_position_ok=horizontal_position_ok(message.flags, _EKF_GPS_GLITCH),
            horizontal_accuracy_m=None,
            velocity_innovation=innovation(message.velocity_variance),
            position_innovation=innovation(message.pos_horiz_variance),
            height_innovation=innovation(message.pos_vert_variance),
            compass_innovation=innovation(message.compass_variance),
        ),
    )


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def innovation(value: float) -> float | None:
    """Innovation; None for exactly 0 or NaN, both autopilots' values for an unused source."""
    return value if 0.0 < value < math.inf else None


def _highres_imu(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    if not message.fields_updated & _MAGNETOMETER_UPDATED:
        return telemetry
    return _magnetic_field(telemetry, message, 1.0, now_s)


def _raw_imu(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    # Despite its name ArduPilot sends the calibrated field, in milligauss.
    return _magnetic_field(telemetry, message, 1e-3, now_s)


def _magnetic_field(
    telemetry: Telemetry, message: Message, unit_gauss: float, now_s: float
) -> Telemetry:
    strength_gauss = unit_gauss * math.hypot(message.xmag, message.ymag, message.zmag)
    if not 0.0 < strength_gauss < math.inf:
        return telemetry
    field = MagneticField(received_s=now_s, strength_gauss=strength_gauss)
    return replace(telemetry, magnetic_field=field)


def horizontal_position_ok(flags: int, glitch: int) -> bool:
    """Returns True if the estimator reports an absolute position and does not reject GPS.

    "Constant position" (0x80) is ignored: PX4 sets it at rest, beside a good position.
    """
    return bool(flags & _HORIZONTAL_POSITION) and not flags & glitch


def _link_node_status(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    node = LinkNode(
        received_s=now_s,
        packets_received=message.messages_received,
        packets_lost=message.messages_lost,
    )
    return replace(telemetry, link_node=node)


def _rc_channels(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    reported = telemetry.remote_control is not None and telemetry.remote_control.ever_reported
    rssi_max = profile_of(telemetry).rssi_max
    rssi: float | None = message.rssi / rssi_max
    if message.rssi > rssi_max:
        rssi = None
    elif message.rssi in {0, _UNKNOWN_U8} and not reported:
        # Autopilots without a signal strength report one of these. Only after another value do
        # they mean no or full signal.
        rssi = None
    known = reported or rssi is not None
    received = RemoteControl(received_s=now_s, rssi=rssi, ever_reported=known)
    return replace(telemetry, remote_control=received)


TRANSLATORS: dict[int, Callable[[Telemetry, Message, float], Telemetry]] = {
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: _battery_status,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: _sys_status,
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: _autopilot_version,
    mavlink.MAVLINK_MSG_ID_PARAM_VALUE: _parameter,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: _gps_raw_int,
    mavlink.MAVLINK_MSG_ID_GPS2_RAW: _gps2_raw,
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: _estimator_status,
    mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: _ekf_status_report,
    mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: _highres_imu,
    mavlink.MAVLINK_MSG_ID_RAW_IMU: _raw_imu,
    LINK_NODE_STATUS_ID: _link_node_status,
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS: _rc_channels,
}
