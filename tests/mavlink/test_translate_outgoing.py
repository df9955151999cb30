from __future__ import annotations

import math

import pytest

from moar_companion.mavlink.translate_outgoing import setpoint_message


def setpoint(**fields):
    return setpoint_message(
        **{
            "target": (1, 1),
            "position_ned_m": (1.0, 2.0, -3.0),
            "velocity_ned_mps": (0.1, 0.2, 0.3),
            "yaw_rad": 0.5,
            "now_s": 12.5,
            **fields,
        }
    )


def test_a_setpoint_is_position_velocity_and_yaw_in_local_ned():
    message = setpoint()
    assert message.get_type() == "SET_POSITION_TARGET_LOCAL_NED"
    assert (message.coordinate_frame, message.type_mask) == (1, 0x9C0)
    assert (message.x, message.y, message.z, message.vx, message.vy, message.vz) == (
        1.0,
        2.0,
        -3.0,
        0.1,
        0.2,
        0.3,
    )
    assert (message.yaw, message.time_boot_ms) == (0.5, 12500)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e39])
@pytest.mark.parametrize(
    "place",
    [
        lambda bad: {"position_ned_m": (0.0, bad, 0.0)},
        lambda bad: {"velocity_ned_mps": (0.0, 0.0, bad)},
        lambda bad: {"yaw_rad": bad},
    ],
)
def test_a_setpoint_that_is_not_finite_is_refused(bad, place):
    with pytest.raises(ValueError, match="must be finite"):
        setpoint(**place(bad))
