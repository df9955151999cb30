"""Landed state: in the air or on the ground, by arming and EXTENDED_SYS_STATE."""

from __future__ import annotations

from ...mavlink.telemetry import LandedState, Telemetry

LANDED_TIMEOUT_S = 5.0
"""EXTENDED_SYS_STATE comes at 5 Hz; on a slow link at less than 1 Hz."""


def airborne(telemetry: Telemetry, now_s: float) -> bool:
    """True if armed and known to be in the air; False in take-off and landing.

    Setpoints between the acknowledgement of a take-off and lift-off cancel ArduPilot's take-off;
    a stream during a landing makes PX4 resume OFFBOARD. A landing counts in a landing mode only:
    EXTENDED_SYS_STATE still reports the landing that a new mode has just ended (measured on
    ArduCopter 4.6.3: for 40 to 110 ms, and up to 200 ms at its rate).
    """
    autopilot, landed = telemetry.autopilot, telemetry.landed
    if autopilot is None or not autopilot.armed or landed is None:
        return False
    ended = landed.state is LandedState.LANDING and not autopilot.homeward
    in_air = landed.state is LandedState.IN_AIR or ended
    return in_air and now_s - landed.received_s <= LANDED_TIMEOUT_S


def grounded(telemetry: Telemetry) -> bool:
    """True if disarmed, or known to be on the ground; False if both are unknown."""
    autopilot, landed = telemetry.autopilot, telemetry.landed
    if autopilot is not None and not autopilot.armed:
        return True
    return landed is not None and landed.state is LandedState.ON_GROUND
