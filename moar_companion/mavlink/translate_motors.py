"""Motor outputs and motor speeds: messages to `Telemetry`. Pure.

Part of `translate`, which names the sources.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace

from ..types import AutopilotKind
from .autopilots import profile_of
from .dialect import ESC_STATUS_ID, Message, mavlink
from .parameters import parameter_value
from .telemetry import MotorOutputs, MotorSpeeds, Telemetry

_MOST_MOTORS = 32
_UNKNOWN_U16 = 65535


def motor_parameter(telemetry: Telemetry, message: Message) -> Telemetry:
    """Telemetry with the limit of the range of the outputs in a PARAM_VALUE."""
    autopilot = profile_of(telemetry)
    names = autopilot.motor_range
    if names is None or message.param_id not in names:
        return telemetry
    pulse_us = _pulse_us(message, autopilot.kind)
    if message.param_id == names[0]:
        return replace(telemetry, motor_min_us=pulse_us)
    return replace(telemetry, motor_max_us=pulse_us)


def _pulse_us(message: Message, kind: AutopilotKind) -> float | None:
    """Pulse width; None for ArduPilot's 0, which means "as the transmitter's throttle"."""
    value = parameter_value(message, kind)
    return value if value is not None and value > 0.0 else None


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
    return motor_outputs(telemetry, (pulse for pulse in pulses if pulse != _UNKNOWN_U16), now_s)


def _actuator_output_status(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    # `active` is ambiguous: a bit mask by its definition, a count in PX4. Only the outputs count.
    return motor_outputs(telemetry, filter(math.isfinite, message.actuator), now_s)


def motor_outputs(telemetry: Telemetry, pulses_us: Iterable[float], now_s: float) -> Telemetry:
    """Telemetry with the motor outputs: autopilots put motors before other actuators."""
    unused_us = profile_of(telemetry).unused_pulse_us
    count = None if telemetry.autopilot is None else telemetry.autopilot.motors
    in_use = tuple(pulse for pulse in pulses_us if pulse > 0 and pulse != unused_us)[:count]
    before = None if telemetry.motors is None else telemetry.motors.least_us
    reported = in_use if before is None else (before, *in_use)
    motors = MotorOutputs(received_s=now_s, pulse_us=in_use, least_us=min(reported, default=None))
    return replace(telemetry, motors=motors)


def _esc_status(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    first, reported = message.index, tuple(abs(rpm) for rpm in message.rpm)
    if first % len(reported) or first >= _MOST_MOTORS:
        return telemetry
    known = () if telemetry.motor_speeds is None else telemetry.motor_speeds.rpm
    before = (*known[:first], *[0] * (first - len(known)))
    speeds = MotorSpeeds(
        received_s=now_s, rpm=(*before, *reported, *known[first + len(reported) :])
    )
    return replace(telemetry, motor_speeds=speeds)


TRANSLATORS: dict[int, Callable[[Telemetry, Message, float], Telemetry]] = {
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: _servo_output_raw,
    mavlink.MAVLINK_MSG_ID_ACTUATOR_OUTPUT_STATUS: _actuator_output_status,
    ESC_STATUS_ID: _esc_status,
}
