"""Texts of all conditions, as pilots read them: `Texts of conditions` in configs/reference.md.

A text appears without its details in parentheses, which pilots do not receive. Braces hold an
example of what varies, and after a bar the longest value. Names are cut to the available room:
their longest value fills it.
"""

from __future__ import annotations

import re

from ...texts.text_format import pilot_text
from .condition_types import Action, Condition, Override

_FIELD = re.compile(r"\{([^{}]*)\}")
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
_BATTERY_MISREAD = "battery {0|255}: {16.0 V|655.3 V}, not {12|100}S"
"""Texts before control only: the answer to an order."""

TEXTS: dict[str, tuple[str, ...]] = {
    "loop_stall": ("control loop stalled {0.6|9999} s",),
    "autopilot_reboot": ("the autopilot restarted",),
    "setpoint_rejected": _GATE,
    "autopilot_identity": (
        "no autopilot is received",
        "two autopilots are received",
        "two clocks, autopilot id {1|255}",
        "autopilot {ardupilot|ardupilot}, file {px4|unknown}",
        "the vehicle is no multirotor",
    ),
    "autopilot_link_lost": ("no heartbeat is received", "autopilot silent for {3.1|99999} s"),
    "mode_unconfirmed": ("mode unknown for {3.1|99999} s", "armed state unknown for {15.1|9999} s"),
    "position": (
        "no local position is received",
        "position age {0.6|99999} s > {0.5|0.123}",
        "position age over {0.5|0.123} s",
        "position read late {0.6|9999} s > {0.5|0.123}",
        "position read late over {0.5|0.123} s",
    ),
    "attitude": ("the attitude is unknown",),
    "origin": ("local origin unknown",),
    "failsafe_took_mode": (
        "failsafe chose {LAND|LOITER_ALT_QLAND}",
        "autopilot in {LAND|LOITER_ALT_QLAND}",
    ),
    "ground": ("on the ground",),
    "landing": ("autopilot in {LAND|LOITER_ALT_QLAND}",),
    "pilot": (
        "autopilot in {POSCTL|LOITER_ALT_QLAND}",
        "autopilot was in {POSCTL|ALTITUDE_CRUISE}",
    ),
    "battery_critical": ("battery {0|255} is critical",),
    "battery_failsafe": ("autopilot battery failsafe",),
    "battery_reserve": ("battery {0|255} at {20%|100%} <= {20%|100%}",),
    "energy_evacuation": (
        "evacuation leaves {25|9999} s <= {30|9999}",
        "evacuation leaves no flight time",
        "exit leaves {25|9999} s",
        "exit leaves no flight time",
        _BATTERY_MISREAD,
    ),
    "energy_exit": (
        "exit leaves {25|9999} s <= {30|9999}",
        "exit leaves no flight time",
        _BATTERY_MISREAD,
    ),
    "failsafe_exposure": (
        "{RC loss|companion loss} hits {tower|MM..}: {121|9999} s",
        "failsafe hits obstacle: {121|9999} s",
        "{return|motor stop} in {121|9999} s hits {right-middle|MM..}",
        "battery {return|motor stop} {40|9999} s < {45|9999}",
    ),
    "memory": ("memory {99|99999} MB < {100|99999}",),
    "failsafe_reported": (
        "autopilot failsafe, cause unknown",
        "failsafe: {EKF, GCS|EKF, dead reckoning}",
        "failsafe: {EKF, GCS|RC} and {2} more",
    ),
    "setpoint_held": _GATE,
    "offboard_loss_collision": (
        "PX4 would hit {tower|MMMMMMMMMMMMMM..}",
        "PX4 would return, route unknown",
        "PX4 would stop its motors",
        "GUID_TIMEOUT {9.0|99999} s > {5}",
        "GUID_TIMEOUT over {5} s",
        "ArduPilot brakes {0.5|0.123} < {1|19.9} m/s2",
    ),
    "position_jump": (
        "the position jumped {3.1|99999} m > {3|99.9}",
        "the position jumped over {3|99.9} m",
    ),
    "origin_moved": (
        "the origin moved {1.2|99999} m > {0.9|99.9}",
        "the origin moved over {0.9|99.9} m",
    ),
    "position_disagreement": (
        "global position off {0.6|99999} m > {0.5}",
        "global position off over {0.5} m",
        "home position off {3.0|99999} m > {0.5}",
        "home position off over {0.5} m",
    ),
    "error_reach": ("{3.3|99999} m error would hit {right-middle|MM..}",),
    "blind_landing": ("no fix: {descent|motor stop} hits {right-middle|MM..}",),
    "battery_landing": ("{landing|motor stop} {27|9999} s < {41|9999} to leave",),
    "uncertainty": ("uncertainty {2.4|99999} m > {2|99999}", "uncertainty over {2|99999} m"),
    "uncertainty_grows": ("uncertainty grows: {3.3|99999} m in {8} s",),
    "no_clearance": (
        "no room here, uncertainty {1.4|99999} m",
        "no room here, margin {0.8|99999} m",
        "no room here, an obstacle is seen",
        "no path, uncertainty {1.9|99999} m",
        "no path with tracking error",
    ),
    "gnss": (
        "GNSS receiver has no 3D fix",
        "GNSS receiver silent for {2.1|9999.9} s",
        "GNSS receiver stopped {2.1|9999.9} s ago",
    ),
    "localization": (
        "localization risk {0.93|1.00} > {0.9|0.123}",
        "localization risk over {0.9|0.123}",
    ),
    "control_saturated": (
        "wind too strong, drifting {4|9999} m",
        "wind too strong, {1.8|99999} m off path",
    ),
    "wind": (
        "wind {reported} {21.4|99999} m/s > {15|99.9}",
        "wind {reported} over {15|99.9} m/s",
        "wind {17.9|100.0} m/s, drag not measured",
    ),
    "ground_link": ("no ground station for {12|9999} s",),
    "autopilot_fence": (
        "outside {FENCE_RADIUS 50 m|GF_MAX_HOR_DIST 10000 m}",
        "path past {FENCE_RADIUS 50 m|GF_MAX_HOR_DIST 10000 m}",
    ),
    "outside_workspace": (
        "altitude {1.2|99999} m < {2|99999}",
        "{1.6|99999} m outside the workspace",
        "{3.4|99999} m from the plane",
    ),
    "off_path": ("off the path {2.3|99999} m > {2|99999}", "off the path over {2|99999} m"),
    "no_progress": ("no progress", "no progress, {0.8|99999} m from setpoint"),
    "planner": ("no new plan for {12.1|99999} s > {12|9999}", "no new plan for over {12|9999} s"),
    "planner_late": ("no new plan for {6.1|99999} s > {6|9999}", "no new plan for over {6|9999} s"),
    "path_barred": ("no path round {seen-solid-1|MM..}",),
    "perception": (
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
    "obstacle": ("{0.4|9999} m too close to an obstacle",),
    "off_plane": (
        "{22.3|99999} m {N|right} of plane > {2|99999}",
        "over {2|99999} m {N|right} of plane",
    ),
    "not_hovering": (
        "moving at {1.1|99999} m/s > {1}, hover",
        "moving at over {1} m/s, hover",
    ),
    "offboard_loss_unknown": (
        "autopilot parameters not read yet",
        "autopilot's fence not read yet",
        "fence about home, home unknown",
    ),
    "parameter_unknown": (
        "unread: {GUID_TIMEOUT|RTL_CLIMB_MIN_M}",
        "unread: {GUID_TIMEOUT|COM_OBL_RC_ACT} and {3|12} more",
    ),
    "battery_silent": (
        "battery {0|255} is silent for {16|9999} s",
        "battery {0|255} reports no charge",
    ),
    "energy_low_soon": (
        "{exit|evacuation} leaves {80|9999} s, due at {30|9999}",
        "{exit|evacuation} leaves no flight time",
    ),
    "disk": ("disk {199|99999} MB < {200|99999}",),
    "not_flying": ("not in the air", "landing", "taking off"),
    "unmonitored": (
        "unknown: {wind, battery|battery, position accuracy}",
        "unknown: {wind, battery|position accuracy} and {3} more",
    ),
}
"""By the name of the condition."""


def action_words(row: Condition, text: str) -> str:
    """The action in a text of a condition; empty where the flight continues."""
    if text == _BATTERY_MISREAD:
        return "rejected"
    if row.action is Action.RELEASE:
        return row.rest.words
    if row.action is Action.CONTINUE and row.override is Override.NONE:
        return "rejected"
    return row.action.words


def filled(text: str, *, longest: bool = False) -> str:
    """A text with its example values, or with the longest ones."""
    return _FIELD.sub(lambda field: field[1].split("|")[-1 if longest else 0], text)


def examples(row: Condition) -> list[str]:
    """Returns the condition's texts as they are sent, with example values."""
    return [pilot_text(filled(text), action_words(row, text)) for text in TEXTS[row.name]]
