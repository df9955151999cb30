"""The states of a mission, in the words of the contract."""

from __future__ import annotations

import enum


class MissionState(str, enum.Enum):
    """What the companion is doing."""

    IDLE = "idle"
    PLANNING = "planning"
    READY = "ready"
    FLYING = "flying"
    AT_TARGET = "at_target"
    LANDING_LEG = "landing_leg"
    HOLDING = "holding"
    OVERRIDDEN = "overridden"
    RELEASED = "released"

    @property
    def words(self) -> str:
        """For people."""
        return self.value.replace("_", " ")

    @property
    def number(self) -> int:
        """Its place in the contract's table, from 0: custom_mode of our heartbeat."""
        return tuple(MissionState).index(self)


IN_CONTROL = frozenset(
    {
        MissionState.FLYING,
        MissionState.AT_TARGET,
        MissionState.LANDING_LEG,
        MissionState.HOLDING,
    }
)
"""The autopilot follows our setpoints."""

STREAMING = IN_CONTROL | {MissionState.READY}
"""Setpoints are sent."""
