"""States of a mission, by the names that status, recordings and MQTT show."""

from __future__ import annotations

import enum


class MissionState(str, enum.Enum):
    """State of the companion's mission."""

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
        """Text for operators."""
        return self.value.replace("_", " ")

    @property
    def number(self) -> int:
        """Number of the state, from 0, in this order: custom_mode of our heartbeat."""
        return tuple(MissionState).index(self)


IN_CONTROL = frozenset(
    {
        MissionState.FLYING,
        MissionState.AT_TARGET,
        MissionState.LANDING_LEG,
        MissionState.HOLDING,
    }
)
"""States in which the autopilot follows our setpoints."""

STREAMING = IN_CONTROL | {MissionState.READY}
"""States in which setpoints are sent."""
ENGAGED = STREAMING | {MissionState.PLANNING}
"""States in which a task or a hold is flown or offered, or a task is planned."""
