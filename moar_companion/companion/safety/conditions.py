"""The supervisor's table: every condition against a flight, and its action.

For each: how its cause is found, the time that this lasts before it acts, its end, the orders that
override it, and its texts. A pilot always may override it, by taking the mode. `supervisor` applies
the table, `moar-companion docs` shows it.
"""

from __future__ import annotations

from dataclasses import replace

from ...risk.receivers import trouble
from ...settings.config import Supervision
from ...texts.text_format import exceeds
from ...types import Mission
from ..estimation.landed_state import grounded
from ..mission_states import MissionState
from . import checks, energy_checks, link_age, position_checks
from .autopilot_failsafe import battery_failsafe, holding_failsafe, taken_mode
from .condition_types import BATTERY_MISREAD, Action, Condition, Look, Override

_GATE = (
    "setpoint not finite",
    "setpoint {2.4|99999} m from the plane",
    "setpoint too close to an obstacle",
    "setpoint near an obstacle, or low",
    "setpoint outside the workspace",
    "sp outside {GF_MAX_HOR_DIST 100 m|GF_MAX_HOR_DIST 10000 m}",
    "setpoint leaves drifting aircraft",
    "setpoint at {12.1|99999} m/s > {10.5|99999}",
    "setpoint jumps by {1.2|99999} m",
    "setpoint speed jump {3.1|99999} m/s",
    "NED setpoint at {12.1|99999} m/s > {10.5|99999}",
    "NED setpoint jumps by {1.2|99999} m",
    "NED setpoint speed jump {3.1|99999} m/s",
)

CONDITIONS = (
    Condition(
        name="loop_stall",
        starts="the control loop stalled for so long that its input is old",
        cause=lambda look: look.seen.faults.loop_stall,
        action=Action.RELEASE,
        passing=True,
        last_setpoint=False,
        texts=("control loop stalled {0.6|9999} s",),
    ),
    Condition(
        name="autopilot_reboot",
        starts="the autopilot restarted",
        cause=lambda look: look.seen.faults.autopilot_reboot,
        action=Action.RELEASE,
        last_setpoint=False,
        texts=("the autopilot restarted",),
    ),
    Condition(
        name="setpoint_rejected",
        starts="the gate refuses the setpoint, and a hold at the last one, too",
        cause=lambda look: look.seen.faults.setpoint_rejected,
        action=Action.RELEASE,
        last_setpoint=False,
        texts=_GATE,
    ),
    Condition(
        name="autopilot_identity",
        starts="not exactly one autopilot of a multirotor is received: none, two, another, or one "
        "that the vehicle file does not name",
        cause=lambda look: checks.autopilot_identity(look.seen),
        action=Action.RELEASE,
        texts=(
            "no autopilot is received",
            "two autopilots are received",
            "two clocks, autopilot id {1|255}",
            "autopilot {ardupilot|ardupilot}, file {px4|unknown}",
            "the vehicle is no multirotor",
        ),
    ),
    Condition(
        name="autopilot_link_lost",
        starts="no packet of the autopilot was received for `heartbeat_timeout_s`",
        cause=lambda look: link_age.silence(look.seen.telemetry, look.limits, look.now_s),
        action=Action.RELEASE,
        passing=True,
        texts=("no heartbeat is received", "autopilot silent for {3.1|99999} s"),
    ),
    Condition(
        name="mode_unconfirmed",
        starts="neither HEARTBEAT nor CURRENT_MODE has reported the mode for `mode_timeout_s`, "
        "or HEARTBEAT the armed state for `armed_timeout_s`",
        cause=lambda look: link_age.mode_unconfirmed(look.seen.telemetry, look.limits, look.now_s),
        action=Action.RELEASE,
        passing=True,
        texts=("mode unknown for {3.1|99999} s", "armed state unknown for {15.1|9999} s"),
    ),
    Condition(
        name="position",
        starts="no position is received, or its clock stands still, for `position_timeout_s`, "
        "or it comes so late (by TIMESYNC)",
        cause=lambda look: position_checks.position(look.seen, look.limits, look.now_s),
        action=Action.RELEASE,
        passing=True,
        texts=(
            "no local position is received",
            "position age {0.6|99999} s > {0.5|0.123}",
            "position age over {0.5|0.123} s",
            "position read late {0.6|9999} s > {0.5|0.123}",
            "position read late over {0.5|0.123} s",
        ),
    ),
    Condition(
        name="attitude",
        starts="the attitude is unknown or older than 1 s",
        cause=lambda look: position_checks.attitude(look.seen.telemetry, look.now_s),
        action=Action.RELEASE,
        passing=True,
        texts=("the attitude is unknown",),
    ),
    Condition(
        name="origin",
        starts="the local frame's origin is unknown",
        cause=lambda look: "local origin unknown" if look.seen.pose is None else None,
        action=Action.RELEASE,
        passing=True,
        texts=("local origin unknown",),
    ),
    Condition(
        name="failsafe_took_mode",
        starts="the autopilot is in failsafe (system status critical or worse), and flies a mode "
        "of its own",
        cause=lambda look: taken_mode(look.seen.telemetry),
        action=Action.RELEASE,
        override=Override.ORDER,
        last_setpoint=False,
        texts=(
            "failsafe chose {LAND|LOITER_ALT_QLAND}",
            "autopilot in {LAND|LOITER_ALT_QLAND}",
        ),
    ),
    Condition(
        name="ground",
        starts="the aircraft is disarmed or on the ground",
        cause=lambda look: "on the ground" if grounded(look.seen.telemetry) else None,
        action=Action.RELEASE,
        override=Override.ORDER,
        last_setpoint=False,
        rest=MissionState.IDLE,
        texts=("on the ground",),
    ),
    Condition(
        name="landing",
        starts="the autopilot has begun the landing that the companion requested",
        cause=lambda look: checks.mode_left(look.seen, landing=True),
        action=Action.RELEASE,
        override=Override.ORDER,
        last_setpoint=False,
        rest=MissionState.IDLE,
        texts=("autopilot in {LAND|LOITER_ALT_QLAND}",),
    ),
    Condition(
        name="pilot",
        starts="the pilot, or another, has taken the mode",
        cause=lambda look: checks.mode_left(look.seen, landing=False),
        action=Action.RELEASE,
        override=Override.ORDER,
        last_setpoint=False,
        rest=MissionState.OVERRIDDEN,
        texts=(
            "autopilot in {POSCTL|LOITER_ALT_QLAND}",
            "autopilot was in {POSCTL|ALTITUDE_CRUISE}",
        ),
    ),
    Condition(
        name="battery_critical",
        starts="the autopilot calls a battery critical or worse",
        cause=lambda look: energy_checks.battery_critical(look.seen),
        action=Action.EVACUATION,
        after_s=1.0,
        over_s=10.0,
        override=Override.SAFER,
        texts=("battery {0|255} is critical",),
    ),
    Condition(
        name="battery_failsafe",
        starts="the autopilot is in failsafe for its battery, and has not taken the mode",
        cause=lambda look: battery_failsafe(look.seen.telemetry),
        action=Action.EXIT,
        over_s=10.0,
        override=Override.SAFER,
        texts=("autopilot battery failsafe",),
    ),
    Condition(
        name="battery_reserve",
        starts="a battery has no more left than `battery_reserve`",
        cause=lambda look: energy_checks.battery_reserve(look.seen, look.limits.battery_reserve),
        action=Action.EXIT,
        after_s=3.0,
        over_s=10.0,
        override=Override.SAFER,
        texts=("battery {0|255} at {20%|100%} <= {20%|100%}",),
    ),
    Condition(
        name="energy_evacuation",
        starts="the evacuation is the escape route of less energy, and would leave at most the "
        "vehicle's `reserve_s` of flight; or the exit that is flown would, and an evacuation needs "
        "clearly less",
        cause=lambda look: energy_checks.energy_left(look.seen, Mission.EVACUATION),
        action=Action.EVACUATION,
        after_s=2.0,
        over_s=10.0,
        override=Override.SAFER,
        texts=(
            "evacuation leaves {25|9999} s <= {30|9999}",
            "evacuation leaves no flight time",
            "exit leaves {25|9999} s",
            "exit leaves no flight time",
            BATTERY_MISREAD,
        ),
    ),
    Condition(
        name="energy_exit",
        starts="the exit is flown, or the escape route of less energy, and would leave at most "
        "`reserve_s`",
        cause=lambda look: energy_checks.energy_left(look.seen, Mission.EXIT),
        action=Action.EXIT,
        after_s=2.0,
        over_s=10.0,
        override=Override.SAFER,
        texts=(
            "exit leaves {25|9999} s <= {30|9999}",
            "exit leaves no flight time",
            BATTERY_MISREAD,
        ),
    ),
    Condition(
        name="failsafe_exposure",
        starts="a failsafe of the autopilot would hit an obstacle: a battery's, from here or from "
        "the escape route, expected less than `exposure_reserve_s` after the route has left all "
        "such places; or another one from here, where the aircraft has stayed for "
        "`exposure_limit_s` beyond the target's dwell",
        cause=lambda look: look.seen.exposure if look.seen.in_control else None,
        action=Action.EXIT,
        after_s=1.0,
        over_s=10.0,
        override=Override.ORDER,
        texts=(
            "{RC loss|companion loss} hits {tower|MM..}: {121|9999} s",
            "failsafe hits obstacle: {121|9999} s",
            "{return|motor stop} in {121|9999} s hits {right-middle|MM..}",
            "battery {return|motor stop} {40|9999} s < {45|9999}",
        ),
    ),
    Condition(
        name="memory",
        starts="the computer's memory is below `memory_free_mb`: the system would end the process",
        cause=lambda look: checks.free(
            "memory", look.seen.host.memory_available, look.limits.memory_free_mb
        ),
        action=Action.EXIT,
        after_s=5.0,
        over_s=10.0,
        override=Override.SAFER,
        texts=("memory {99|99999} MB < {100|99999}",),
    ),
    Condition(
        name="failsafe_reported",
        starts="the autopilot is in failsafe for anything else (remote control, ground station, "
        "estimator, dead reckoning, fence, unknown), and has not taken the mode; an exit or "
        "evacuation goes on unless the position is in doubt",
        cause=lambda look: holding_failsafe(look.seen.telemetry, escaping=look.seen.escaping),
        action=Action.HOLD,
        after_s=1.0,
        over_s=2.0,
        override=Override.SAFER,
        texts=(
            "autopilot failsafe, cause unknown",
            "failsafe: {EKF, GCS|EKF, dead reckoning}",
            "failsafe: {EKF, GCS|RC} and {2} more",
        ),
    ),
    Condition(
        name="setpoint_held",
        starts="the gate has refused a setpoint, and holds at the last good one",
        cause=lambda look: look.seen.faults.setpoint_held,
        action=Action.HOLD,
        latched=True,
        override=Override.ORDER,
        texts=_GATE,
    ),
    Condition(
        name="settings_refused",
        starts="a parameter was set in flight with which the flight's place has no room; it is set "
        "back",
        cause=lambda look: look.seen.faults.settings_refused,
        action=Action.HOLD,
        latched=True,
        override=Override.ORDER,
        texts=("no room at {SAFE_RADIUS 8|GUID_LAND_HEIGHT 0.0125}",),
    ),
    Condition(
        name="offboard_loss_collision",
        starts="under `loss_action: refuse`: on an inspection, or on the next plan of one that no "
        "operator has ordered, the autopilot's action after an offboard loss would hit an obstacle "
        "(its parameters, its home, the maps or the position's uncertainty have changed); under "
        "`failsafe_action: refuse` on that plan its action after a link loss, too",
        cause=lambda look: look.seen.faults.offboard_loss_collision,
        action=Action.HOLD,
        over_s=1.0,
        override=Override.ORDER,
        texts=(
            "PX4 would hit {tower|MMMMMMMMMMMMMM..}",
            "PX4 would return, route unknown",
            "PX4 would stop its motors",
            "GUID_TIMEOUT {9.0|99999} s > {5}",
            "GUID_TIMEOUT over {5} s",
            "ArduPilot brakes {0.5|0.123} < {1|19.9} m/s2",
        ),
    ),
    Condition(
        name="position_jump",
        starts="the position has jumped within 10 s by more than `jump_limit_m`, or than the "
        "margin's position error and what is free beyond the margin",
        cause=lambda look: position_checks.position_jump(look.seen, look.limits),
        action=Action.HOLD,
        latched=True,
        override=Override.ORDER,
        texts=(
            "the position jumped {3.1|99999} m > {3|99.9}",
            "the position jumped over {3|99.9} m",
        ),
    ),
    Condition(
        name="origin_moved",
        starts="the local frame's origin has moved since the flight began, or since the last "
        "order that overrode this condition, by more than `jump_limit_m`, or than the margin's "
        "position error and what is free beyond the margin",
        cause=lambda look: position_checks.origin_moved(look.seen, look.limits),
        action=Action.HOLD,
        latched=True,
        override=Override.ORDER,
        texts=(
            "the origin moved {1.2|99999} m > {0.9|99.9}",
            "the origin moved over {0.9|99.9} m",
        ),
    ),
    Condition(
        name="position_disagreement",
        starts="the local position, by its origin, is more than 0.5 m from the global position; "
        "or home's local and geodetic coordinates differ by as much (ArduPilot)",
        cause=lambda look: position_checks.position_disagreement(look.seen),
        action=Action.HOLD,
        after_s=0.5,
        over_s=5.0,
        override=Override.SAFER,
        texts=(
            "global position off {0.6|99999} m > {0.5}",
            "global position off over {0.5} m",
            "home position off {3.0|99999} m > {0.5}",
            "home position off over {0.5} m",
        ),
    ),
    Condition(
        name="error_reach",
        starts="the position's uncertainty is above `position_uncertainty_limit_m`, or will be "
        "within 8 s at the growth of the last 3 s, and then reaches an obstacle from here; not on "
        "an escape route that was planned for an uncertainty above the margin's",
        cause=lambda look: position_checks.error_reach(look.seen),
        action=Action.LEAVE,
        after_s=0.5,
        over_s=5.0,
        override=Override.SAFER,
        texts=("{3.3|99999} m error would hit {right-middle|MM..}",),
    ),
    Condition(
        name="blind_landing",
        starts="the receiver has no fix (`gnss`), and the autopilot's action without a position, "
        "with its drift, would hit an obstacle from here; until one leg was flown or none was "
        "found, and only one that begins within 8 s of the loss",
        cause=lambda look: look.seen.blind_hit if look.seen.in_control else None,
        action=Action.LEAVE,
        after_s=1.0,
        over_s=2.0,
        override=Override.SAFER,
        texts=("no fix: {descent|motor stop} hits {right-middle|MM..}",),
    ),
    Condition(
        name="battery_landing",
        starts="a battery's action of the autopilot is expected before the escape route has left "
        "all places from where it hits an obstacle, and a nearer place is free of that",
        cause=lambda look: look.seen.battery_landing if look.seen.in_control else None,
        action=Action.LEAVE,
        after_s=1.0,
        over_s=2.0,
        override=Override.SAFER,
        texts=("{landing|motor stop} {27|9999} s < {41|9999} to leave",),
    ),
    Condition(
        name="uncertainty",
        starts="the position's uncertainty, level or in height, is above "
        "`position_uncertainty_limit_m`",
        cause=lambda look: position_checks.uncertainty(look.seen, look.limits),
        action=Action.HOLD,
        after_s=0.5,
        over_s=5.0,
        texts=("uncertainty {2.4|99999} m > {2|99999}", "uncertainty over {2|99999} m"),
    ),
    Condition(
        name="uncertainty_grows",
        starts="outside an escape route, the position's uncertainty will be above "
        "`position_uncertainty_limit_m` within 8 s, at the growth of the last 3 s",
        cause=lambda look: position_checks.uncertainty_grows(look.seen, look.limits),
        action=Action.HOLD,
        after_s=0.5,
        over_s=5.0,
        override=Override.SAFER,
        texts=("uncertainty grows: {3.3|99999} m in {8} s",),
    ),
    Condition(
        name="no_clearance",
        starts="the position's uncertainty, the margin or the tracking error leaves no room at the "
        "setpoint's place, or no path onward",
        cause=lambda look: look.seen.faults.no_clearance,
        action=Action.HOLD,
        over_s=1.0,
        override=Override.ORDER,
        texts=(
            "no room here, uncertainty {1.4|99999} m",
            "no room here, margin {0.8|99999} m",
            "no room here, an obstacle is seen",
            "no path, uncertainty {1.9|99999} m",
            "no path with tracking error",
        ),
    ),
    Condition(
        name="gnss",
        starts="the receiver has no 3D fix, is silent, or repeats its last message",
        cause=lambda look: trouble(
            look.seen.telemetry, look.seen.risk.localization.receivers, look.now_s
        ),
        action=Action.HOLD,
        after_s=1.0,
        over_s=5.0,
        override=Override.SAFER,
        texts=(
            "GNSS receiver has no 3D fix",
            "GNSS receiver silent for {2.1|9999.9} s",
            "GNSS receiver stopped {2.1|9999.9} s ago",
        ),
    ),
    Condition(
        name="localization",
        starts="the localization risk is above `localization_limit`",
        cause=lambda look: exceeds(
            "localization risk",
            look.seen.risk.indices.localization,
            look.limits.localization_limit,
            "",
        ),
        action=Action.HOLD,
        after_s=1.0,
        over_s=5.0,
        override=Override.SAFER,
        texts=(
            "localization risk {0.93|1.00} > {0.9|0.123}",
            "localization risk over {0.9|0.123}",
        ),
    ),
    Condition(
        name="control_saturated",
        starts="the wind is too strong to hold: the aircraft takes its setpoint along (`leash_m`), "
        "or is 1.5 m off with its lean or its motors at their limits",
        cause=lambda look: energy_checks.control_saturated(look.seen),
        action=Action.HOLD,
        after_s=1.0,
        over_s=5.0,
        override=Override.SAFER,
        texts=(
            "wind too strong, drifting {4|9999} m",
            "wind too strong, {1.8|99999} m off path",
        ),
    ),
    Condition(
        name="wind",
        starts="the measured wind is above `wind_limit_mps`, or above 0.8 times what the aircraft "
        "can hold by its lean and drag",
        cause=lambda look: energy_checks.wind(look.seen, look.limits.wind_limit_mps),
        action=Action.HOLD,
        after_s=3.0,
        over_s=5.0,
        override=Override.SAFER,
        texts=(
            "wind {reported} {21.4|99999} m/s > {15|99.9}",
            "wind {reported} over {15|99.9} m/s",
            "wind {17.9|100.0} m/s, drag not measured",
        ),
    ),
    Condition(
        name="ground_link",
        starts="no ground station is received for `ground_link_lost_s`, after it was received "
        "once; after an order of one that had been received for 10 s, it alone counts (action: "
        "`ground_link_action`)",
        cause=lambda look: checks.ground_link(look.seen.telemetry, look.limits, look.now_s),
        action=Action.HOLD,
        over_s=2.0,
        override=Override.ORDER,
        texts=("no ground station for {12|9999} s",),
    ),
    Condition(
        name="autopilot_fence",
        starts="the path ahead leaves the autopilot's fence less `fence_margin_m`, which has "
        "changed; or the aircraft is outside the fence",
        cause=lambda look: look.seen.faults.autopilot_fence if look.seen.in_control else None,
        action=Action.HOLD,
        over_s=1.0,
        override=Override.ORDER,
        texts=(
            "outside {FENCE_RADIUS 50 m|GF_MAX_HOR_DIST 10000 m}",
            "path past {FENCE_RADIUS 50 m|GF_MAX_HOR_DIST 10000 m}",
        ),
    ),
    Condition(
        name="outside_workspace",
        starts="the aircraft is outside the workspace by more than the vehicle's "
        "`tracking_hold_m`, too low, or farther from the plane than `leash_m`, and beside its "
        "checked legs; or on its way back from there",
        cause=lambda look: look.seen.excursion if look.seen.in_control else None,
        action=Action.HOLD,
        after_s=1.0,
        over_s=1.0,
        override=Override.ORDER,
        texts=(
            "altitude {1.2|99999} m < {2|99999}",
            "{1.6|99999} m outside the workspace",
            "{3.4|99999} m from the plane",
        ),
    ),
    Condition(
        name="off_path",
        starts="the aircraft is farther from its setpoint than the vehicle's `off_path_m`",
        cause=lambda look: position_checks.off_path(look.seen, look.off_path_m),
        action=Action.HOLD,
        after_s=5.0,
        over_s=1.0,
        override=Override.ORDER,
        texts=("off the path {2.3|99999} m > {2|99999}", "off the path over {2|99999} m"),
    ),
    Condition(
        name="planner",
        starts="in an inspection a new plan is awaited for `plan_stale_s`",
        cause=lambda look: checks.plan(look.seen, look.limits.plan_stale_s),
        action=Action.HOLD,
        latched=True,
        override=Override.ORDER,
        texts=("no new plan for {12.1|99999} s > {12|9999}", "no new plan for over {12|9999} s"),
    ),
    Condition(
        name="planner_late",
        starts="in an inspection a new plan is awaited for half of `plan_stale_s`",
        cause=lambda look: (
            checks.plan(look.seen, look.limits.plan_stale_s)
            or checks.plan(look.seen, 0.5 * look.limits.plan_stale_s)
        ),
        action=Action.SLOW,
        override=Override.ORDER,
        texts=("no new plan for {6.1|99999} s > {6|9999}", "no new plan for over {6|9999} s"),
    ),
    Condition(
        name="path_barred",
        starts="a seen obstacle bars the path ahead, and no plan avoids it",
        cause=lambda look: look.seen.faults.path_barred,
        action=Action.HOLD,
        override=Override.ORDER,
        texts=("no path round {seen-solid-1|MM..}",),
    ),
    Condition(
        name="perception",
        starts="the sensor that looks for obstacles is silent for `timeout_s`, its newest scan is "
        "older than `late_s`, or fewer of its beams return than `least_returns`; or the maps "
        "have lacked a seen obstacle for `timeout_s`",
        cause=lambda look: checks.perception(look.seen, look.now_s),
        action=Action.HOLD,
        over_s=2.0,
        override=Override.SAFER,
        texts=(
            "no data of the lidar is received",
            "lidar data {with a wrong checksum}",
            "lidar silent for {1.1|99999} s > {1|99999}",
            "lidar silent for over {1|99999} s",
            "lidar scan age {0.6|99999} s > {0.5|99999}",
            "lidar scan age over {0.5|99999} s",
            "lidar blinded, {2%|99%} returns < {5%|99%}",
            "obstacle unmapped for {1.1|9999} s > {1|99}",
            "obstacle unmapped for over {1|99} s",
        ),
    ),
    Condition(
        name="line",
        starts="the line is more than 6 m from its place by the autopilot, or for 2 s no wire that "
        "the sensor measures is where the others show the line",
        cause=lambda look: position_checks.line(look.seen, look.now_s),
        action=Action.HOLD,
        latched=True,
        override=Override.ORDER,
        texts=(
            "line off by {6.3|99999} m > 6",
            "wires off the line for {2.1|999} s > 2",
        ),
    ),
    Condition(
        name="obstacle",
        starts="the hull is nearer to an obstacle than its keep-out and the uncertainty allow",
        cause=lambda look: position_checks.obstacle(look.seen),
        action=Action.SLOW,
        over_s=1.0,
        override=Override.ORDER,
        texts=("{0.4|9999} m too close to an obstacle",),
    ),
    Condition(
        name="off_plane",
        starts="before the companion has control, the aircraft is farther from the plane than "
        "`plane_tolerance_m`",
        cause=lambda look: position_checks.off_plane(look.seen, look.limits),
        action=Action.CONTINUE,
        texts=(
            "{22.3|99999} m {N|right} of plane > {2|99999}",
            "over {2|99999} m {N|right} of plane",
        ),
    ),
    Condition(
        name="not_hovering",
        starts="before the companion has control, the aircraft does not hover",
        cause=lambda look: position_checks.not_hovering(look.seen),
        action=Action.CONTINUE,
        texts=(
            "moving at {1.1|99999} m/s > {1}, hover",
            "moving at over {1} m/s, hover",
        ),
    ),
    Condition(
        name="offboard_loss_unknown",
        starts="the autopilot's parameters for an offboard loss or for its failsafes, or its "
        "fence, are not known yet",
        cause=lambda look: look.seen.faults.offboard_loss_unknown,
        action=Action.CONTINUE,
        texts=(
            "autopilot parameters not read yet",
            "autopilot's fence not read yet",
            "fence about home, home unknown",
        ),
    ),
    Condition(
        name="parameter_unknown",
        starts="the autopilot does not report a parameter on which the flight depends, and no "
        "value of it is the most cautious one, or that one permits no inspection",
        cause=lambda look: checks.parameter_unknown(look.seen),
        action=Action.CONTINUE,
        override=Override.SAFER,
        texts=(
            "unread: {GUID_TIMEOUT|RTL_CLIMB_MIN_M}",
            "unread: {GUID_TIMEOUT|COM_OBL_RC_ACT} and {3|12} more",
        ),
    ),
    Condition(
        name="energy_low_soon",
        starts="the better escape route would leave at most a minute more than `reserve_s`",
        cause=lambda look: energy_checks.energy_low_soon(look.seen.escape_route),
        action=Action.CONTINUE,
        after_s=2.0,
        over_s=10.0,
        override=Override.ORDER,
        texts=(
            "{exit|evacuation} leaves {80|9999} s, due at {30|9999}",
            "{exit|evacuation} leaves no flight time",
        ),
    ),
    Condition(
        name="no_progress",
        starts="the setpoint does not move on: the aircraft does not follow, or there is no plan",
        cause=lambda look: position_checks.no_progress(look.seen),
        action=Action.CONTINUE,
        after_s=10.0,
        over_s=1.0,
        override=Override.ORDER,
        texts=("no progress", "no progress, {0.8|99999} m from setpoint"),
    ),
    Condition(
        name="battery_silent",
        starts="a battery that has reported its charge is silent for 15 s, or reports no charge",
        cause=lambda look: energy_checks.battery_silent(look.seen, look.now_s),
        action=Action.CONTINUE,
        override=Override.SAFER,
        texts=(
            "battery {0|255} is silent for {16|9999} s",
            "battery {0|255} reports no charge",
        ),
    ),
    Condition(
        name="disk",
        starts="less than `disk_free_mb` is free where flights are recorded",
        cause=lambda look: checks.free("disk", look.seen.host.disk_free, look.limits.disk_free_mb),
        action=Action.CONTINUE,
        override=Override.SAFER,
        texts=("disk {199|99999} MB < {200|99999}",),
    ),
    Condition(
        name="not_flying",
        starts="it is not known that the aircraft is in the air, or it takes off or lands",
        cause=lambda look: checks.not_flying(look.seen, look.now_s),
        action=Action.CONTINUE,
        texts=("not in the air", "landing", "taking off"),
    ),
    Condition(
        name="unmonitored",
        starts="in the air, wind, battery, the position's accuracy, the uploaded fence or a "
        "ground station are not reported, or no escape route is known that was planned within 15 s",
        cause=lambda look: checks.unmonitored(look.seen, look.now_s),
        action=Action.CONTINUE,
        after_s=10.0,
        override=Override.ORDER,
        texts=(
            "unknown: {wind, battery|battery, position accuracy}",
            "unknown: {wind, battery|position accuracy} and {3} more",
        ),
    ),
)
"""In the order in which their reasons are reported; of equal actions the first one leads."""


def causes(look: Look) -> dict[str, str]:
    """All present reasons against a flight, by the name of the condition, as texts with the value.

    A required measurement that is missing is a cause. A reported value counts until the next one,
    at any age: only a measurement ends a cause.
    """
    return {row.name: text for row in CONDITIONS if (text := row.cause(look)) is not None}


def conditions(limits: Supervision) -> tuple[Condition, ...]:
    """The table with the action that is configured for a lost ground station."""
    lost = Action[limits.ground_link_action.name]
    return tuple(
        replace(row, action=lost) if row.name == "ground_link" else row for row in CONDITIONS
    )
