"""How the aircraft fares: batteries, receiver, estimator, radios and motors to `Telemetry`. Pure.

Part of `translate`, which names the sources.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from ..types import (
    Battery,
    Estimator,
    Gnss,
    MotorOutputs,
    Radio,
    RemoteControl,
    Telemetry,
)
from .dialect import Message, mavlink

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
_HORIZONTAL_POSITION = 0x10
"""Absolute horizontal position, in ESTIMATOR_STATUS and EKF_STATUS_REPORT alike."""
_PX4_GPS_GLITCH = 0x400
_ARDUPILOT_GPS_GLITCH = 0x8000


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


TRANSLATORS: dict[int, Callable[[Telemetry, Message, float], Telemetry]] = {
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: _battery_status,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: _sys_status,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: _gnss,
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: _estimator_status,
    mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: _ekf_status_report,
    mavlink.MAVLINK_MSG_ID_RADIO_STATUS: _radio_status,
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS: _rc_channels,
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: _servo_output_raw,
}
