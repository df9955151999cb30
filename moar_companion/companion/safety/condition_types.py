"""A condition against a flight: its action, its override, and the causes that start it. Values.

`conditions` is the table of all of them.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass

from ...types import Mission
from ..mission_states import MissionState


class Action(enum.IntEnum):
    """Effect of a condition on the flight; the greater takes precedence."""

    CONTINUE = 0
    """The flight continues."""
    SLOW = 1
    HOLD = 2
    EXIT = 3
    EVACUATION = 4
    LEAVE = 5
    """Flies a checked leg to the nearest place where what threatens hits nothing, and holds."""
    RELEASE = 6
    """The stream ends: the autopilot or the pilot flies."""

    @property
    def words(self) -> str:
        """Text for operators; empty where the flight continues."""
        return _WORDS.get(self, "")


_WORDS = {
    Action.SLOW: "slowing",
    Action.HOLD: "holding",
    Action.EXIT: "exiting",
    Action.EVACUATION: "evacuating",
    Action.LEAVE: "leaving",
    Action.RELEASE: "released",
}


class Override(enum.Enum):
    """Orders that are carried out although a condition acts."""

    NONE = "no order"
    SAFER = "a hold, an exit or an evacuation that is ordered"
    ORDER = "any new order"


@dataclass(frozen=True, slots=True, kw_only=True)
class Causes:
    """Reason why each condition starts, as text with the number; None is healthy.

    A required measurement that is missing is a cause. The fields are the names in CONDITIONS.
    """

    loop_stall: str | None = None
    autopilot_reboot: str | None = None
    setpoint_rejected: str | None = None
    autopilot_identity: str | None = None
    autopilot_link_lost: str | None = None
    mode_unconfirmed: str | None = None
    position: str | None = None
    attitude: str | None = None
    origin: str | None = None
    failsafe_took_mode: str | None = None
    ground: str | None = None
    landing: str | None = None
    pilot: str | None = None
    battery_critical: str | None = None
    battery_failsafe: str | None = None
    failsafe_reported: str | None = None
    battery_reserve: str | None = None
    energy_evacuation: str | None = None
    energy_exit: str | None = None
    energy_low_soon: str | None = None
    failsafe_exposure: str | None = None
    memory: str | None = None
    setpoint_held: str | None = None
    offboard_loss_collision: str | None = None
    position_jump: str | None = None
    origin_moved: str | None = None
    position_disagreement: str | None = None
    uncertainty: str | None = None
    uncertainty_grows: str | None = None
    error_reach: str | None = None
    blind_landing: str | None = None
    battery_landing: str | None = None
    no_clearance: str | None = None
    gnss: str | None = None
    localization: str | None = None
    control_saturated: str | None = None
    wind: str | None = None
    ground_link: str | None = None
    autopilot_fence: str | None = None
    outside_workspace: str | None = None
    off_path: str | None = None
    no_progress: str | None = None
    planner: str | None = None
    planner_late: str | None = None
    path_barred: str | None = None
    perception: str | None = None
    obstacle: str | None = None
    off_plane: str | None = None
    not_hovering: str | None = None
    offboard_loss_unknown: str | None = None
    parameter_unknown: str | None = None
    battery_silent: str | None = None
    disk: str | None = None
    not_flying: str | None = None
    unmonitored: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition:
    """A row of the table.

    name: a field of Causes. starts: the cause that starts it. after_s: time that its cause lasts
    before it acts, including breaks shorter than that and over_s. over_s: time that the cause
    must be over before it clears. latched: it then still needs a new order to clear.
    last_setpoint: one at rest is useful when the stream ends. rest: the mission's state after that.
    passing: late or missing data alone end the stream, and may come again: the rest of the mission
    is kept for a `continue`. All other causes are a fault, or a decision of the autopilot.
    """

    name: str
    starts: str
    action: Action
    after_s: float = 0.0
    over_s: float = 0.0
    latched: bool = False
    override: Override = Override.NONE
    last_setpoint: bool = True
    rest: MissionState = MissionState.RELEASED
    passing: bool = False

    def objects_to(self, mission: Mission) -> bool:
        """True if this mission must not be ordered while the condition lasts."""
        if self.override is Override.SAFER:
            return mission is Mission.INSPECTION
        return self.override is Override.NONE
