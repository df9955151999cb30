"""The supervisor's table: every condition against a flight, and its action.

For each: its start, the time that its cause lasts before it acts, how it clears, and who may
override it; a pilot always may, by taking the mode. `supervisor` applies the table,
`conditions_doc` shows it.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, replace

from ..config import Supervision
from ..mission_states import MissionState
from ..types import Mission


class Action(enum.IntEnum):
    """Effect of a condition on the flight; the greater takes precedence."""

    CONTINUE = 0
    """The flight continues."""
    SLOW = 1
    HOLD = 2
    EXIT = 3
    EVACUATION = 4
    RELEASE = 5
    """The stream ends: the autopilot or the pilot flies."""


class Override(enum.Enum):
    """Orders that are carried out although a condition acts."""

    NOBODY = "nobody"
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
    obstacle: str | None = None
    off_plane: str | None = None
    not_hovering: str | None = None
    offboard_loss_unknown: str | None = None
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
    """

    name: str
    starts: str
    action: Action
    after_s: float = 0.0
    over_s: float = 0.0
    latched: bool = False
    override: Override = Override.NOBODY
    last_setpoint: bool = True
    rest: MissionState = MissionState.RELEASED

    def objects_to(self, mission: Mission) -> bool:
        """True if this mission must not be ordered while the condition lasts."""
        if self.override is Override.SAFER:
            return mission is Mission.INSPECTION
        return self.override is Override.NOBODY


CONDITIONS = (
    Condition(
        name="loop_stall",
        starts="the control loop stalled for so long that its input is old",
        action=Action.RELEASE,
        last_setpoint=False,
    ),
    Condition(
        name="autopilot_reboot",
        starts="the autopilot restarted",
        action=Action.RELEASE,
        last_setpoint=False,
    ),
    Condition(
        name="setpoint_rejected",
        starts="the gate lets neither the setpoint pass nor a hold in its place",
        action=Action.RELEASE,
        last_setpoint=False,
    ),
    Condition(
        name="autopilot_identity",
        starts="not exactly one autopilot of a multirotor is received: none, two, another, or one "
        "that the vehicle file does not name",
        action=Action.RELEASE,
    ),
    Condition(
        name="autopilot_link_lost",
        starts="no packet of the autopilot was received for `heartbeat_timeout_s`",
        action=Action.RELEASE,
    ),
    Condition(
        name="mode_unconfirmed",
        starts="neither HEARTBEAT nor CURRENT_MODE has reported the mode for `mode_timeout_s`, "
        "or HEARTBEAT the armed state for `armed_timeout_s`",
        action=Action.RELEASE,
    ),
    Condition(
        name="position",
        starts="no position is received, or its clock stands still, for `position_timeout_s`, "
        "or it comes so late (by TIMESYNC)",
        action=Action.RELEASE,
    ),
    Condition(
        name="attitude", starts="the attitude is unknown or older than 1 s", action=Action.RELEASE
    ),
    Condition(name="origin", starts="the local frame's origin is unknown", action=Action.RELEASE),
    Condition(
        name="failsafe_took_mode",
        starts="the autopilot is in failsafe (system status critical or worse), and flies a mode "
        "of its own",
        action=Action.RELEASE,
        override=Override.ORDER,
        last_setpoint=False,
    ),
    Condition(
        name="ground",
        starts="the aircraft is disarmed or on the ground",
        action=Action.RELEASE,
        override=Override.ORDER,
        last_setpoint=False,
        rest=MissionState.IDLE,
    ),
    Condition(
        name="landing",
        starts="the autopilot has begun the landing that the companion asked for",
        action=Action.RELEASE,
        override=Override.ORDER,
        last_setpoint=False,
        rest=MissionState.IDLE,
    ),
    Condition(
        name="pilot",
        starts="the pilot, or another, has taken the mode",
        action=Action.RELEASE,
        override=Override.ORDER,
        last_setpoint=False,
        rest=MissionState.OVERRIDDEN,
    ),
    Condition(
        name="battery_critical",
        starts="the autopilot calls a battery critical or worse",
        action=Action.EVACUATION,
        after_s=1.0,
        over_s=10.0,
        override=Override.SAFER,
    ),
    Condition(
        name="battery_failsafe",
        starts="the autopilot is in failsafe for its battery, and has not taken the mode",
        action=Action.EXIT,
        over_s=10.0,
        override=Override.SAFER,
    ),
    Condition(
        name="battery_reserve",
        starts="a battery has no more left than `battery_reserve`",
        action=Action.EXIT,
        after_s=3.0,
        over_s=10.0,
        override=Override.SAFER,
    ),
    Condition(
        name="energy_evacuation",
        starts="after an evacuation, which takes less energy than an exit, no more than the "
        "vehicle's `reserve_s` of flight would be left; or after the exit that is flown, and an "
        "evacuation takes clearly less",
        action=Action.EVACUATION,
        after_s=2.0,
        over_s=10.0,
        override=Override.SAFER,
    ),
    Condition(
        name="energy_exit",
        starts="the same after an exit, where that takes less",
        action=Action.EXIT,
        after_s=2.0,
        over_s=10.0,
        override=Override.SAFER,
    ),
    Condition(
        name="failsafe_exposure",
        starts="where a failsafe of the autopilot would hit an obstacle: a battery's comes before "
        "the escape route has left such places and `exposure_reserve_s` is over; or it has been "
        "there for `exposure_limit_s` beyond the target's dwell",
        action=Action.EXIT,
        after_s=1.0,
        over_s=10.0,
        override=Override.ORDER,
    ),
    Condition(
        name="memory",
        starts="the computer's memory is below `memory_free_mb`: the system would end the process",
        action=Action.EXIT,
        after_s=5.0,
        over_s=10.0,
        override=Override.SAFER,
    ),
    Condition(
        name="failsafe_reported",
        starts="the autopilot is in failsafe for anything else (remote control, ground station, "
        "estimator, dead reckoning, fence, unknown), and has not taken the mode; an exit or "
        "evacuation goes on unless the position is in doubt",
        action=Action.HOLD,
        after_s=1.0,
        over_s=2.0,
        override=Override.SAFER,
    ),
    Condition(
        name="setpoint_held",
        starts="the gate has refused a setpoint, and holds at the last good one",
        action=Action.HOLD,
        latched=True,
        override=Override.ORDER,
    ),
    Condition(
        name="offboard_loss_collision",
        starts="after an offboard loss it would hit something, by what has changed since it was "
        "planned: the autopilot's parameters, its home, how well the position is known",
        action=Action.HOLD,
        over_s=1.0,
        override=Override.ORDER,
    ),
    Condition(
        name="position_jump",
        starts="the position has jumped within 10 s by more than `jump_limit_m`, or than the "
        "margin's position error and what is free beyond the margin",
        action=Action.HOLD,
        latched=True,
        override=Override.ORDER,
    ),
    Condition(
        name="origin_moved",
        starts="the local frame's origin has moved since the flight began, or since an order was "
        "given over that, by more than `jump_limit_m`, or than the margin's position error and "
        "what is free beyond the margin",
        action=Action.HOLD,
        latched=True,
        override=Override.ORDER,
    ),
    Condition(
        name="position_disagreement",
        starts="the local position, by its origin, is more than 0.5 m from the global position; "
        "or home is that far from itself (ArduPilot)",
        action=Action.HOLD,
        after_s=0.5,
        over_s=5.0,
        override=Override.SAFER,
    ),
    Condition(
        name="uncertainty",
        starts="the position's uncertainty, level or in height, is above "
        "`position_uncertainty_limit_m`",
        action=Action.HOLD,
        after_s=0.5,
        over_s=5.0,
    ),
    Condition(
        name="no_clearance",
        starts="as uncertain as the position is, or with the margin, there is no room where the "
        "setpoint would be, or no way on",
        action=Action.HOLD,
        over_s=1.0,
        override=Override.ORDER,
    ),
    Condition(
        name="gnss",
        starts="the receiver has no 3D fix, is silent, or repeats its last message",
        action=Action.HOLD,
        after_s=1.0,
        over_s=5.0,
        override=Override.SAFER,
    ),
    Condition(
        name="localization",
        starts="the localization risk is above `localization_limit`",
        action=Action.HOLD,
        after_s=1.0,
        over_s=5.0,
        override=Override.SAFER,
    ),
    Condition(
        name="control_saturated",
        starts="the wind is too strong to hold: the aircraft takes its setpoint along (`leash_m`), "
        "or is 1.5 m off with its lean or its motors at their limits",
        action=Action.HOLD,
        after_s=1.0,
        over_s=5.0,
        override=Override.SAFER,
    ),
    Condition(
        name="wind",
        starts="the measured wind is above `wind_limit_mps`, or above 0.8 times what the aircraft "
        "can hold by its lean and drag",
        action=Action.HOLD,
        after_s=3.0,
        over_s=5.0,
        override=Override.SAFER,
    ),
    Condition(
        name="ground_link",
        starts="no ground station is received for `ground_link_lost_s`, after it was received once "
        "(`ground_link_action` says what then)",
        action=Action.HOLD,
        over_s=2.0,
        override=Override.ORDER,
    ),
    Condition(
        name="autopilot_fence",
        starts="the path ahead leaves the autopilot's fence less `fence_margin_m`, which has "
        "changed; or the aircraft is outside the fence",
        action=Action.HOLD,
        over_s=1.0,
        override=Override.ORDER,
    ),
    Condition(
        name="outside_workspace",
        starts="the aircraft is outside the workspace by more than the vehicle's "
        "`tracking_hold_m`, too low, or farther from the plane than `leash_m`, and beside its "
        "checked legs; or on its way back from there",
        action=Action.HOLD,
        after_s=1.0,
        over_s=1.0,
        override=Override.ORDER,
    ),
    Condition(
        name="off_path",
        starts="the aircraft is farther from its setpoint than the vehicle's `off_path_m`",
        action=Action.HOLD,
        after_s=5.0,
        over_s=1.0,
        override=Override.ORDER,
    ),
    Condition(
        name="planner",
        starts="in an inspection a new plan is awaited for `plan_stale_s`",
        action=Action.HOLD,
        latched=True,
        override=Override.ORDER,
    ),
    Condition(
        name="planner_late",
        starts="in an inspection a new plan is awaited for half of that",
        action=Action.SLOW,
        override=Override.ORDER,
    ),
    Condition(
        name="obstacle",
        starts="the hull is nearer to an obstacle than its keep-out and the uncertainty allow",
        action=Action.SLOW,
        over_s=1.0,
        override=Override.ORDER,
    ),
    Condition(
        name="off_plane",
        starts="the aircraft is farther from the plane than `plane_tolerance_m`",
        action=Action.CONTINUE,
    ),
    Condition(
        name="not_hovering",
        starts="before the companion has control, the aircraft does not hover",
        action=Action.CONTINUE,
    ),
    Condition(
        name="offboard_loss_unknown",
        starts="it is not known yet what the autopilot would do without the companion, or where "
        "its fence is",
        action=Action.CONTINUE,
    ),
    Condition(
        name="energy_low_soon",
        starts="after the better escape route at most a minute above `reserve_s` would be left",
        action=Action.CONTINUE,
        after_s=2.0,
        over_s=10.0,
        override=Override.ORDER,
    ),
    Condition(
        name="no_progress",
        starts="the setpoint stands on its way: the aircraft does not follow, or no plan leads on",
        action=Action.CONTINUE,
        after_s=10.0,
        over_s=1.0,
        override=Override.ORDER,
    ),
    Condition(
        name="battery_silent",
        starts="a battery that has reported its charge has not done so for 15 s, or reports it no "
        "more",
        action=Action.CONTINUE,
        override=Override.SAFER,
    ),
    Condition(
        name="disk",
        starts="less than `disk_free_mb` is free where flights are recorded",
        action=Action.CONTINUE,
        override=Override.SAFER,
    ),
    Condition(
        name="not_flying",
        starts="it is not known that the aircraft is in the air",
        action=Action.CONTINUE,
    ),
    Condition(
        name="unmonitored",
        starts="in the air, wind, battery, the position's accuracy, the uploaded fence or a "
        "ground station are not reported, or no escape route is known that was planned within 15 s",
        action=Action.CONTINUE,
        after_s=10.0,
        override=Override.ORDER,
    ),
)
"""In the order in which their reasons are reported; of equal actions the first one leads."""


def conditions(limits: Supervision) -> tuple[Condition, ...]:
    """The table with the action that is configured for a lost ground station."""
    lost = Action[limits.ground_link_action.name]
    return tuple(
        replace(row, action=lost) if row.name == "ground_link" else row for row in CONDITIONS
    )
