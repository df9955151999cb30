"""A take-off in calm air, with the motors near their limit."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as m

from .flown import ARDUPILOT, PX4, Packets, boot_ms, heartbeat


def _climb(autopilot: int, *, landed_reported: bool, up_mps: float) -> Packets:
    """Spools up for 1 s, accelerates upward at 3 m/s² to `up_mps`, climbs on at that speed."""
    packets = Packets()
    for step in range(100):
        time_s = step * 0.1
        ms = boot_ms(time_s)
        speed_mps = min(up_mps, 3.0 * max(0.0, time_s - 1.0))
        pulse_us = 1100 if time_s < 1.0 else 1960
        if step % 10 == 0:
            packets.put(time_s, heartbeat(autopilot))
            if landed_reported:
                state = m.MAV_LANDED_STATE_ON_GROUND if step == 0 else m.MAV_LANDED_STATE_IN_AIR
                packets.put(time_s, m.MAVLink_extended_sys_state_message(0, state))
        packets.put(
            time_s,
            m.MAVLink_attitude_message(ms, 0, 0, 0, 0, 0, 0),
            m.MAVLink_local_position_ned_message(ms, 0, 0, -speed_mps, 0, 0, -speed_mps),
            m.MAVLink_servo_output_raw_message(ms * 1000, 0, *(pulse_us,) * 4, *(0,) * 4),
        )
    return packets


@pytest.mark.parametrize("landed_reported", [False, True])
@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT])
def test_the_motors_of_a_take_off_are_no_wind(autopilot, landed_reported):
    replay, _ = _climb(autopilot, landed_reported=landed_reported, up_mps=3.0).played()
    assert max(sample.risk["wind"] or 0.0 for sample in replay.samples) < 0.75
    assert replay.samples[-1].risk["wind"] < 0.25
    assert replay.samples[-1].why["wind"] != "motor output"


def test_motors_at_their_limit_in_a_hover_are_wind():
    replay, _ = _climb(PX4, landed_reported=True, up_mps=0.2).played()
    assert replay.samples[-1].risk["wind"] > 0.9
    assert replay.samples[-1].why["wind"] == "motor output"
