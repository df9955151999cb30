"""Operator's actions that differ between PX4 and ArduPilot; all other actions are the same."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from pymavlink.dialects.v20 import all as mavlink


@dataclass(frozen=True, slots=True, kw_only=True)
class Manner:
    """One autopilot, from the operator's side."""

    given_mode: str
    """The mode in which the autopilot follows the companion."""
    given: tuple[int, ...]
    """Its parameters of DO_SET_MODE, after the flag; `land`: those of the LAND mode."""
    given_custom_mode: int
    """Its custom_mode in the heartbeat."""
    land: tuple[int, ...]
    takes_off_in_given_mode: bool
    """True: armed in it, the aircraft climbs to a height above home; otherwise above the sea."""
    ready_timeout_s: float
    """Time from its start until it may be armed."""
    cells: int
    """Cells of its simulated battery."""
    parameters: tuple[str, ...]
    """Parameters that the manual requires before a flight: without them the return leads through
    conductors."""
    parameters_bytewise: bool
    """Integers travel as the bytes of a float."""
    requested: tuple[int, ...]
    """Messages that a ground station gets on request only."""
    scenario: str
    """Scenario unless another is named."""


MANNERS: Final = {
    "px4": Manner(
        given_mode="OFFBOARD",
        given=(6, 0),
        given_custom_mode=6 << 16,
        land=(4, 6),
        takes_off_in_given_mode=False,
        ready_timeout_s=30.0,
        cells=4,
        parameters=("COM_OBL_RC_ACT=5",),
        parameters_bytewise=True,
        requested=(),
        scenario="wind_then_battery.yaml",
    ),
    "ardupilot": Manner(
        given_mode="GUIDED",
        given=(4, 0),
        given_custom_mode=4,
        land=(9, 0),
        takes_off_in_given_mode=True,
        ready_timeout_s=90.0,
        cells=3,
        parameters=("GUID_TIMEOUT=0.5",),
        parameters_bytewise=False,
        requested=(
            int(mavlink.MAVLINK_MSG_ID_SYS_STATUS),
            int(mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT),
            int(mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE),
            int(mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT),
        ),
        scenario="moderate_wind_then_battery.yaml",
    ),
}
"""By the name on the command line. ArduPilot has its position 41 s after its start."""
