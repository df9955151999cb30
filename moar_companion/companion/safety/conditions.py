"""The supervisor's table: every condition against a flight, and its action.

For each: its start, the time that its cause lasts before it acts, its end, and the orders that
override it. A pilot always may, by taking the mode. `supervisor` applies the table,
`conditions_doc` shows it.
"""

from __future__ import annotations

from dataclasses import replace

from ...settings.config import Supervision
from ..mission_states import MissionState
from .condition_types import Action, Condition, Override

CONDITIONS = (
    Condition(
        name="loop_stall",
        starts="the control loop stalled for so long that its input is old",
        action=Action.RELEASE,
        passing=True,
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
        starts="the gate refuses the setpoint, and a hold at the last one, too",
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
        passing=True,
    ),
    Condition(
        name="mode_unconfirmed",
        starts="neither HEARTBEAT nor CURRENT_MODE has reported the mode for `mode_timeout_s`, "
        "or HEARTBEAT the armed state for `armed_timeout_s`",
        action=Action.RELEASE,
        passing=True,
    ),
    Condition(
        name="position",
        starts="no position is received, or its clock stands still, for `position_timeout_s`, "
        "or it comes so late (by TIMESYNC)",
        action=Action.RELEASE,
        passing=True,
    ),
    Condition(
        name="attitude",
        starts="the attitude is unknown or older than 1 s",
        action=Action.RELEASE,
        passing=True,
    ),
    Condition(
        name="origin",
        starts="the local frame's origin is unknown",
        action=Action.RELEASE,
        passing=True,
    ),
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
        starts="the autopilot has begun the landing that the companion requested",
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
        starts="the evacuation is the escape route of less energy, and would leave at most the "
        "vehicle's `reserve_s` of flight; or the exit that is flown would, and an evacuation needs "
        "clearly less",
        action=Action.EVACUATION,
        after_s=2.0,
        over_s=10.0,
        override=Override.SAFER,
    ),
    Condition(
        name="energy_exit",
        starts="the exit is flown, or the escape route of less energy, and would leave at most "
        "`reserve_s`",
        action=Action.EXIT,
        after_s=2.0,
        over_s=10.0,
        override=Override.SAFER,
    ),
    Condition(
        name="failsafe_exposure",
        starts="a failsafe of the autopilot would hit an obstacle: a battery's, from here or from "
        "the escape route, expected less than `exposure_reserve_s` after the route has left all "
        "such places; or another one from here, where the aircraft has stayed for "
        "`exposure_limit_s` beyond the target's dwell",
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
        starts="under `loss_action: refuse`: on an inspection, or on the next plan of one that no "
        "operator has ordered, the autopilot's action after an offboard loss would hit an obstacle "
        "(its parameters, its home, the maps or the position's uncertainty have changed); under "
        "`failsafe_action: refuse` on that plan its action after a link loss, too",
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
        starts="the local frame's origin has moved since the flight began, or since the last "
        "order that overrode this condition, by more than `jump_limit_m`, or than the margin's "
        "position error and what is free beyond the margin",
        action=Action.HOLD,
        latched=True,
        override=Override.ORDER,
    ),
    Condition(
        name="position_disagreement",
        starts="the local position, by its origin, is more than 0.5 m from the global position; "
        "or home's local and geodetic coordinates differ by as much (ArduPilot)",
        action=Action.HOLD,
        after_s=0.5,
        over_s=5.0,
        override=Override.SAFER,
    ),
    Condition(
        name="error_reach",
        starts="the position's uncertainty is above `position_uncertainty_limit_m`, or will be "
        "within 8 s at the growth of the last 3 s, and then reaches an obstacle from here; not on "
        "an escape route that was planned for an uncertainty above the margin's",
        action=Action.LEAVE,
        after_s=0.5,
        over_s=5.0,
        override=Override.SAFER,
    ),
    Condition(
        name="blind_landing",
        starts="the receiver has no fix (`gnss`), and the autopilot's action without a position, "
        "with its drift, would hit an obstacle from here; until one leg was flown or none was "
        "found, and only one that begins within 8 s of the loss",
        action=Action.LEAVE,
        after_s=1.0,
        over_s=2.0,
        override=Override.SAFER,
    ),
    Condition(
        name="battery_landing",
        starts="a battery's action of the autopilot is expected before the escape route has left "
        "all places from where it hits an obstacle, and a nearer place is free of that",
        action=Action.LEAVE,
        after_s=1.0,
        over_s=2.0,
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
        name="uncertainty_grows",
        starts="outside an escape route, the position's uncertainty will be above "
        "`position_uncertainty_limit_m` within 8 s, at the growth of the last 3 s",
        action=Action.HOLD,
        after_s=0.5,
        over_s=5.0,
        override=Override.SAFER,
    ),
    Condition(
        name="no_clearance",
        starts="the position's uncertainty, the margin or the tracking error leaves no room at the "
        "setpoint's place, or no path onward",
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
        starts="no ground station is received for `ground_link_lost_s`, after it was received "
        "once; after an order of one that had been received for 10 s, it alone counts (action: "
        "`ground_link_action`)",
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
        starts="in an inspection a new plan is awaited for half of `plan_stale_s`",
        action=Action.SLOW,
        override=Override.ORDER,
    ),
    Condition(
        name="path_barred",
        starts="a seen obstacle bars the path ahead, and no plan avoids it",
        action=Action.HOLD,
        override=Override.ORDER,
    ),
    Condition(
        name="perception",
        starts="the sensor that looks for obstacles is silent for `timeout_s`, its newest scan is "
        "older than `late_s`, or fewer of its beams return than `least_returns`; or the maps "
        "have lacked a seen obstacle for `timeout_s`",
        action=Action.HOLD,
        over_s=2.0,
        override=Override.SAFER,
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
        starts="before the companion has control, the aircraft is farther from the plane than "
        "`plane_tolerance_m`",
        action=Action.CONTINUE,
    ),
    Condition(
        name="not_hovering",
        starts="before the companion has control, the aircraft does not hover",
        action=Action.CONTINUE,
    ),
    Condition(
        name="offboard_loss_unknown",
        starts="the autopilot's parameters for an offboard loss or for its failsafes, or its "
        "fence, are not known yet",
        action=Action.CONTINUE,
    ),
    Condition(
        name="parameter_unknown",
        starts="the autopilot does not report a parameter on which the flight depends, and no "
        "value of it is the most cautious one, or that one permits no inspection",
        action=Action.CONTINUE,
        override=Override.SAFER,
    ),
    Condition(
        name="energy_low_soon",
        starts="the better escape route would leave at most a minute more than `reserve_s`",
        action=Action.CONTINUE,
        after_s=2.0,
        over_s=10.0,
        override=Override.ORDER,
    ),
    Condition(
        name="no_progress",
        starts="the setpoint does not move on: the aircraft does not follow, or there is no plan",
        action=Action.CONTINUE,
        after_s=10.0,
        over_s=1.0,
        override=Override.ORDER,
    ),
    Condition(
        name="battery_silent",
        starts="a battery that has reported its charge is silent for 15 s, or reports no charge",
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
        starts="it is not known that the aircraft is in the air, or it takes off or lands",
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
