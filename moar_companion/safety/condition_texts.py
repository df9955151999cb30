"""Texts of all conditions, as pilots read them: the second table of configs/README.md.

A text stands without its details in parentheses, which pilots do not receive. Braces hold an
example of a number or a name that varies.
"""

from __future__ import annotations

import re

from ..mavlink.statustext import pilot_text
from .condition_types import Action, Condition, Override

_GATE = (
    "setpoint not finite",
    "setpoint {2.4} m from the plane",
    "setpoint too close to an obstacle",
    "setpoint near an obstacle, or low",
    "setpoint outside the workspace",
    "aims outside {GF_MAX_HOR_DIST 100 m}",
    "setpoint leaves drifting aircraft",
    "setpoint at {12.1} m/s > {10.5}",
    "setpoint jumps by {1.20} m",
    "setpoint speed jump {3.1} m/s",
    "local setpoint at {12.1} m/s > {10.5}",
    "local setpoint jumps by {1.20} m",
    "local setpoint speed jump {3.1} m/s",
)
_BATTERY_MISREAD = "battery {0} of {16.0} V, not {12} cells"
"""Made before control only: the answer to an order."""

TEXTS: dict[str, tuple[str, ...]] = {
    "loop_stall": ("control loop stalled {0.6} s",),
    "autopilot_reboot": ("the autopilot restarted",),
    "setpoint_rejected": _GATE,
    "autopilot_identity": (
        "no autopilot is heard",
        "two autopilots are heard",
        "two clocks under autopilot id {1}",
        "vehicle file {px4}, heard {ardupilot}",
        "the vehicle is no multirotor",
    ),
    "autopilot_link_lost": ("no heartbeat is heard", "autopilot silent for {3.1} s"),
    "mode_unconfirmed": ("mode not told for {3.1} s", "armed state not told for {15.1} s"),
    "position": (
        "no local position is heard",
        "position age {0.6} s > {0.5}",
        "position age over {0.5} s",
        "position read late {0.6} s > {0.5}",
        "position read late over {0.5} s",
    ),
    "attitude": ("the attitude is unknown",),
    "origin": ("local origin unknown",),
    "failsafe_took_mode": (
        "autopilot failsafe chose {LAND}",
        "the autopilot is in {LAND}",
    ),
    "ground": ("on the ground",),
    "landing": ("the autopilot is in {LAND}",),
    "pilot": ("the autopilot is in {POSCTL}", "the autopilot was in {POSCTL}"),
    "battery_critical": ("battery {0} is critical",),
    "battery_failsafe": ("autopilot battery failsafe",),
    "battery_reserve": ("battery {0} at {20%}, reserve {20%}",),
    "energy_evacuation": (
        "evacuation leaves {25} s <= {30}",
        "evacuation leaves no flight time",
        "exit leaves {25} s",
        "exit leaves no flight time",
        _BATTERY_MISREAD,
    ),
    "energy_exit": (
        "exit leaves {25} s <= {30}",
        "exit leaves no flight time",
        _BATTERY_MISREAD,
    ),
    "failsafe_exposure": (
        "{RC loss} hits {tower}: {121} s",
        "a failsafe hits an obstacle: {121} s",
        "{return} in {121} s hits {right-middle}",
        "battery {return} in {40} s, need {35} s",
    ),
    "memory": ("memory {99} MB < {100}",),
    "failsafe_reported": ("autopilot failsafe, cause unknown", "failsafe: {GCS, RC}"),
    "setpoint_held": _GATE,
    "offboard_loss_collision": (
        "PX4 would hit {tower}",
        "PX4 would {return by an unknown way}",
        "PX4 would stop its motors",
        "it would fly on for {9} s",
        "ArduPilot brakes at {0.5} < {1} m/s2",
    ),
    "position_jump": ("the position jumped {3.1} m > {3}", "the position jumped over {3} m"),
    "origin_moved": ("the origin moved {1.2} m > {0.9}", "the origin moved over {0.9} m"),
    "position_disagreement": (
        "global position off {0.6} m > {0.5}",
        "global position off over {0.5} m",
        "home position off {3.0} m > {0.5}",
        "home position off over {0.5} m",
    ),
    "uncertainty": ("position uncertainty {2.4} m > {2}", "position uncertainty over {2} m"),
    "no_clearance": (
        "no room here, uncertainty {1.4} m",
        "no room here, margin {0.8} m",
        "no way with uncertainty {1.9} m",
        "no way with this tracking error",
    ),
    "gnss": (
        "the receiver has no 3D fix",
        "the receiver is silent for {2.1} s",
        "the receiver stopped {2.1} s ago",
    ),
    "localization": ("localization risk {0.93} > {0.9}", "localization risk over {0.9}"),
    "control_saturated": (
        "wind too strong, drifting {4} m",
        "wind too strong, {1.8} m off the path",
    ),
    "wind": ("wind {reported} {21.4} m/s > {15}", "wind {reported} over {15} m/s"),
    "ground_link": ("no ground station for {12} s",),
    "autopilot_fence": ("outside fence {FENCE_RADIUS 50 m}", "path leaves {FENCE_RADIUS 50 m}"),
    "outside_workspace": (
        "altitude {1.2} m < {2}",
        "{1.6} m outside the workspace",
        "{3.4} m from the plane",
    ),
    "off_path": ("off the path {2.3} m > {2}", "off the path over {2} m"),
    "no_progress": ("no progress", "no progress, {0.8} m from setpoint"),
    "planner": ("no new plan for {12.1} s > {12}", "no new plan for over {12} s"),
    "planner_late": ("no new plan for {6.1} s > {6}", "no new plan for over {6} s"),
    "obstacle": ("{0.4} m too close to an obstacle",),
    "off_plane": ("{22.3} m {north} of plane > {2}", "over {2} m {north} of plane"),
    "not_hovering": (
        "moving at {1.1} m/s > {1}, hover first",
        "moving at over {1} m/s, hover first",
    ),
    "offboard_loss_unknown": (
        "autopilot parameters not read yet",
        "autopilot's fence not read yet",
        "fence about home, home unknown",
    ),
    "battery_silent": ("battery {0} is silent for {16} s", "battery {0} tells no charge"),
    "energy_low_soon": (
        "{exit} leaves {80} s, at {30} s it begins",
        "{exit} leaves no flight time, at {0} s it begins",
    ),
    "disk": ("disk {199} MB < {200}",),
    "not_flying": ("not in the air",),
    "unmonitored": (
        "unknown: {battery}",
        "unknown: {position accuracy}, {ground station}",
        "unknown: {battery} and {3} more",
    ),
}
"""By the name of the condition."""


def action_words(row: Condition, text: str) -> str:
    """The action in a text of a condition; empty where the flight goes on."""
    if text == _BATTERY_MISREAD:
        return "rejected"
    if row.action is Action.RELEASE:
        return row.rest.words
    if row.action is Action.CONTINUE and row.override is Override.NOBODY:
        return "rejected"
    return row.action.words


def examples(row: Condition) -> list[str]:
    """Returns the condition's texts as they are sent, with example values."""
    return [
        pilot_text(re.sub("[{}]", "", text), action_words(row, text)) for text in TEXTS[row.name]
    ]
