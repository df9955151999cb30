from __future__ import annotations

import math
import struct

import pytest

from moar_companion.mavlink import translate
from moar_companion.mavlink.codec import Codec
from moar_companion.mavlink.dialect import mavlink
from moar_companion.mavlink.telemetry import Telemetry

from .conftest import Peer
from .messages import updated

ARDUPILOT, PX4 = mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, mavlink.MAV_AUTOPILOT_PX4
INT16, INT32, REAL32 = 4, 6, 9


def flying(autopilot=PX4, vehicle=mavlink.MAV_TYPE_QUADROTOR):
    return updated("HEARTBEAT", autopilot=autopilot, type=vehicle)


def parameter(telemetry, name, value, kind):
    data = Peer(1, 1).pack(mavlink.MAVLink_param_value_message(name.encode(), value, kind, 900, 7))
    (message,) = Codec(system_id=1, component_id=195).receive(data)
    return translate.update(telemetry, message, 10.0)


def as_float(number):
    """Value as PX4 sends an integer: its bytes read as a float."""
    return struct.unpack("<f", struct.pack("<i", number))[0]


def test_outputs_without_a_motor_are_ignored():
    motors = updated(
        "SERVO_OUTPUT_RAW",
        servo1_raw=1500,
        servo2_raw=1400,
        servo3_raw=900,
        servo4_raw=65535,
        servo16_raw=1600,
    ).motors
    assert motors.pulse_us == (1500, 1400, 1600)
    assert updated("SERVO_OUTPUT_RAW", port=1, servo1_raw=1500).motors is None


@pytest.mark.parametrize(
    ("vehicle", "count"),
    [
        pytest.param(mavlink.MAV_TYPE_QUADROTOR, 4, id="quadrotor"),
        pytest.param(mavlink.MAV_TYPE_HEXAROTOR, 6, id="hexarotor"),
        pytest.param(mavlink.MAV_TYPE_OCTOROTOR, 8, id="octorotor"),
        pytest.param(mavlink.MAV_TYPE_GENERIC, 9, id="not reported: all of them"),
    ],
)
def test_an_output_after_the_last_motor_is_ignored(vehicle, count):
    outputs = {f"servo{number}_raw": 1500 for number in range(1, 9)}
    motors = updated("SERVO_OUTPUT_RAW", flying(vehicle=vehicle), **outputs, servo9_raw=1950).motors
    assert len(motors.pulse_us) == count


def test_float_actuator_outputs_become_motor_outputs():
    outputs = [1530.6, 1455.7, 1494.3, 1493.7] + [900.0] * 12 + [0.0] * 15 + [math.nan]
    motors = updated("ACTUATOR_OUTPUT_STATUS", flying(), active=16, actuator=outputs).motors
    assert motors.pulse_us == pytest.approx((1530.6, 1455.7, 1494.3, 1493.7))


def test_motor_speeds_are_positive_in_either_direction():
    speeds = updated("ESC_STATUS", rpm=[7054, -6987, 0, 7010]).motor_speeds
    assert speeds.rpm == (7054, 6987, 0, 7010)


def test_motor_speeds_of_several_messages_are_merged():
    first = updated("ESC_STATUS", rpm=[7000, 7000, 7000, 7000])
    both = updated("ESC_STATUS", first, index=4, rpm=[7100, -9000, 0, 0])
    assert both.motor_speeds.rpm == (7000, 7000, 7000, 7000, 7100, 9000, 0, 0)
    again = updated("ESC_STATUS", both, rpm=[1, 2, 3, 4])
    assert again.motor_speeds.rpm == (1, 2, 3, 4, 7100, 9000, 0, 0)
    alone = updated("ESC_STATUS", index=4, rpm=[7100, 7200, 0, 0])
    assert alone.motor_speeds.rpm == (0, 0, 0, 0, 7100, 7200, 0, 0)


@pytest.mark.parametrize("index", [3, 32, 252])
def test_a_message_with_an_invalid_motor_index_is_ignored(index):
    assert updated("ESC_STATUS", index=index, rpm=[1, 2, 3, 4]).motor_speeds is None


def test_the_least_output_is_remembered():
    # PX4 with DShot: the motors idle at a twentieth.
    idle = updated("SERVO_OUTPUT_RAW", flying(), servo1_raw=110, servo2_raw=110)
    assert idle.motors.pulse_us == (110, 110)
    full = updated("SERVO_OUTPUT_RAW", idle, servo1_raw=1750, servo2_raw=1200)
    assert (full.motors.pulse_us, full.motors.least_us) == ((1750, 1200), 110)
    assert updated("SERVO_OUTPUT_RAW", flying()).motors.least_us is None


@pytest.mark.parametrize(
    ("autopilot", "least", "greatest", "kind"),
    [
        pytest.param(
            PX4,
            ("PWM_MAIN_MIN1", as_float(1100)),
            ("PWM_MAIN_MAX1", as_float(1900)),
            INT32,
            id="PX4",
        ),
        pytest.param(
            ARDUPILOT, ("MOT_PWM_MIN", 1100.0), ("MOT_PWM_MAX", 1900.0), INT16, id="ArduPilot"
        ),
    ],
)
def test_parameters_give_the_range_of_motor_outputs(autopilot, least, greatest, kind):
    telemetry = parameter(parameter(flying(autopilot), *least, kind), *greatest, kind)
    assert (telemetry.motor_min_us, telemetry.motor_max_us) == (1100.0, 1900.0)


def test_a_zero_ardupilot_output_range_is_unknown():
    assert parameter(flying(ARDUPILOT), "MOT_PWM_MIN", 0.0, INT16).motor_min_us is None


@pytest.mark.parametrize("telemetry", [flying(PX4), Telemetry()], ids=["PX4's", "nobody's"])
def test_an_output_range_parameter_of_another_autopilot_is_ignored(telemetry):
    assert parameter(telemetry, "MOT_PWM_MIN", 1100.0, REAL32) is telemetry
