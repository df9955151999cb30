"""Telemetry by an autopilot's heartbeat."""

from __future__ import annotations

from moar_companion.mavlink.telemetry import AutopilotStatus
from moar_companion.types import PX4

OFFBOARD = 0x00060000


def px4_status(received_s, **changes):
    """Status of an armed PX4 multirotor that follows the companion's setpoints, with changes."""
    usual = {
        "system_id": 1,
        "component_id": 1,
        "kind": PX4,
        "armed": True,
        "custom_mode": OFFBOARD,
        "mode": "OFFBOARD",
        "ours": True,
        "homeward": False,
        "multirotor": True,
        "failsafe": False,
    }
    return AutopilotStatus(received_s=received_s, **usual | changes)
