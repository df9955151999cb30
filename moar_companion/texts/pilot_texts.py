"""Texts for pilots that belong to no condition: `Other texts` of configs/reference.md.

Each text is a value that is called with its variable fields and returns the reason; the sender adds
the action. Texts of the service itself: `service_texts`; of conditions: `safety/conditions`.
"""

from __future__ import annotations

from collections.abc import Mapping

from . import service_texts
from .text_patterns import PilotText

_DENIED, _REJECTED = ("denied",), ("rejected",)
_STAYS = ("denied", "holding", "path kept")
_NO_ESCAPE = ("denied", "holding", "path kept", "no exit", "no evacuation")

# Settings in flight

PARAMETER_REFUSED = PilotText(
    pattern="{refused}",
    meaning="a parameter of the companion was not set: its value, and what is allowed",
    remedy="set another value; [parameters](#parameters-of-the-companion)",
)
NO_NEW_MAPS = PilotText(
    pattern="no maps at {parameter}",
    actions=("set back",),
    meaning="the planner has failed; the last settings with maps stay in force, and the parameter, "
    "with those that were set with it, has its value there again",
    remedy="set the parameter again",
)

# The mission

STATE = PilotText(
    pattern="{state}",
    meaning="the mission's state",
)
STATE_OF_MISSION = PilotText(
    pattern="{state} {mission}",
    meaning="the mission's state, and the mission",
)
READY = PilotText(
    pattern="ready for {mission}",
    meaning="the plan is found and setpoints are sent",
    remedy="select OFFBOARD or GUIDED, unless the companion does (`engage`)",
)
FLYING_TO_TARGET = PilotText(
    pattern="flying {mission} to {target}",
    meaning="the path to this target is flown",
)
AT_TARGET = PilotText(
    pattern="at target {target}",
    meaning="the aircraft is at this target, for its dwell time",
)
LANDING_LEG = PilotText(
    pattern="landing leg of the {escape}",
    meaning="the last, straight leg to the landing point is flown",
)
PLANNING = PilotText(
    pattern="planning {mission}",
    meaning="an order was received, its plan is computed",
)
READY_TO_HOLD = PilotText(
    pattern="ready to hold",
    meaning="a hold was ordered while ready: given the mode, the aircraft holds",
    remedy="order a mission, or `continue`",
)
RESUMING = PilotText(
    pattern="resuming {mission}",
    meaning="the condition that held the flight is over",
)
EVERY_TARGET_DONE = PilotText(
    pattern="every target is done",
    actions=("holding",),
    meaning="the inspection has ended",
    remedy="order the exit, or take over",
)
STOPS_MISSING = PilotText(
    pattern="stops not done: {count}",
    actions=("holding",),
    meaning="the inspection has ended; the record says why",
    remedy="order the inspection again, or take over",
)
NO_ENERGY_FOR = PilotText(
    pattern="no energy for {target}",
    actions=("left out",),
    meaning="the battery does not suffice for this last stop of the inspection and the way out",
    remedy="order the target again with a full battery",
)
NO_ENERGY_FOR_MORE = PilotText(
    pattern="no energy for {target}, {count} more",
    actions=("left out",),
    meaning="the same of the last stops of the inspection",
    remedy="order the targets again with a full battery",
)
ABOVE_LANDING_POINT = PilotText(
    pattern="above the landing point",
    actions=("holding",),
    meaning="the exit or evacuation has ended",
    remedy="land; under `engage` the companion requests LAND",
)
ON_COMMAND = PilotText(
    pattern="{order} on command",
    actions=("released", "idle"),
    meaning="an order has ended the setpoint stream",
)
MODE_NOT_GIVEN = PilotText(
    pattern="mode not given in {limit} s",
    actions=("idle",),
    meaning="the pilot did not select OFFBOARD or GUIDED within `ready_timeout_s`",
    remedy="order `continue`, then select the mode",
)
PLACE_LEFT = PilotText(
    pattern="the aircraft has left its place",
    actions=("rejected", "idle"),
    meaning="the aircraft is no longer where its plan begins",
    remedy="hover, and order again",
)

NO_REFUGE = PilotText(
    pattern="{m} m uncertain, no place is clear of it",
    meaning="no leg leads to a place where a position error of that size reaches no obstacle",
    remedy="take over, and fly away from the line by sight",
)
NO_BLIND_REFUGE = PilotText(
    pattern="no fix: no place near is clear to land",
    meaning="no short leg leads to a place from where the autopilot's landing without a position "
    "hits nothing",
    remedy="take over, and fly away from the line by sight",
)

# Answers to orders

REPLACED = PilotText(
    pattern="replaced by a newer order",
    actions=("cancelled",),
    meaning="another order came before this one's plan was found",
)
NOTHING_HELD = PilotText(
    pattern="nothing is held",
    actions=_REJECTED,
    meaning="`continue` without an interrupted mission",
    remedy="order a mission",
)
LANDING_ENDED = PilotText(
    pattern="the landing ended the mission",
    actions=_REJECTED,
    meaning="`continue` after a landing: a mission does not outlast it",
    remedy="order a mission",
)
NOTHING_LEFT = PilotText(
    pattern="nothing is left to fly",
    actions=_REJECTED,
    meaning="`continue` after a mission's end",
    remedy="order a mission",
)
NOTHING_FLOWN = PilotText(
    pattern="nothing is flown",
    actions=_REJECTED,
    meaning="a hold while nothing is planned or flown",
)
JUST_RELEASED = PilotText(
    pattern="control has just ended",
    actions=_REJECTED,
    meaning="the order was sent before the end of control was reported to the operator",
    remedy="order again",
)
NO_SITE = PilotText(
    pattern="no site is loaded",
    actions=_DENIED,
    meaning="the service runs without a site file: no path is planned",
    remedy="give it a site file",
)
OBSERVE = PilotText(
    pattern="the authority is observe",
    actions=_DENIED,
    meaning="the configuration allows no flight",
    remedy="set `authority`",
)
NO_TARGET = PilotText(
    pattern="no target {index} of {number}",
    actions=_DENIED,
    meaning="the order's param2 names no target of the site; they count from 0",
    remedy="order another",
)
NO_LANDING_POINT = PilotText(
    pattern="no landing point {index} of {number}",
    actions=_DENIED,
    meaning="the order's param2 names no landing point of the mission; they count from 0",
    remedy="order another",
)
NO_MISSION = PilotText(
    pattern="param1 {value} is not a mission",
    actions=_DENIED,
    meaning="the command's param1 is not 0 to 4",
    remedy="send 0 to 4",
)
NO_INDEX = PilotText(
    pattern="param2 {value} is not an index",
    actions=_DENIED,
    meaning="the command's param2 is neither -1 (any) nor a whole number from 0 on",
    remedy="send -1, or the target's number from 0 on",
)
NO_PAUSE = PilotText(
    pattern="param1 {value} is neither 0 nor 1",
    actions=_DENIED,
    meaning="of DO_PAUSE_CONTINUE: 0 pauses, 1 continues",
    remedy="send 0 or 1",
)
FOR_AUTOPILOT = PilotText(
    pattern="{kind} commands go to component 1",
    actions=_DENIED,
    meaning="a command that flies the aircraft (mode, arming, …) was sent to the companion; it "
    "belongs to the autopilot, component 1",
    remedy="in MAVProxy `set target_component 1`; take over by the transmitter meanwhile",
)
LINK_MAY_NOT = PilotText(
    pattern="this link may not command",
    actions=_DENIED,
    meaning="the command's link is not in `commands.links`",
    remedy="command over another link",
)
SYSTEM_MAY_NOT = PilotText(
    pattern="system {id} may not command",
    actions=("denied", "not served"),
    meaning="the sender's system id is not in `commands.systems`",
    remedy="set the id in the ground station, or allow it",
)
COMPONENT_MAY_NOT = PilotText(
    pattern="component {id} may not command",
    actions=_DENIED,
    meaning="the sender's component id is not in `commands.components`",
    remedy="command from another component, or allow it",
)
UNSIGNED = PilotText(
    pattern="commands must be signed",
    actions=_DENIED,
    meaning="`commands.signed_only` is set",
    remedy="sign with the vehicle's key",
)

# No path

NO_PATH_TO_TARGET = PilotText(
    pattern="no free path to {target}",
    actions=_STAYS,
    meaning="obstacles or the minimum altitude cut the target off",
    remedy="order another target; see the site file",
)
NO_PATH = PilotText(
    pattern="no free path",
    actions=_NO_ESCAPE,
    meaning="obstacles cut all landing points off from here",
    remedy="take over, and fly it out",
)
TARGET_OUTSIDE = PilotText(
    pattern="{target} outside the workspace",
    actions=_STAYS,
    meaning="the target is not in the site's workspace",
    remedy="correct the site file",
)
TARGET_CLOSE = PilotText(
    pattern="{target} too near obstacles",
    actions=_STAYS,
    meaning="at the target the keep-out of an obstacle, with the margin, is entered",
    remedy="correct the site file; a smaller `guidance.tracking_margin_m`",
)
NO_LANDING_IN_SIGHT = PilotText(
    pattern="no landing point in sight",
    actions=_NO_ESCAPE,
    meaning="no landing point is reached by a straight free leg",
    remedy="take over, and land; correct the site file",
)
MARGIN_BLOCKS = PilotText(
    pattern="no path with margin {m} m",
    actions=_STAYS,
    meaning="there is a path without the margin, or without a part of it; the record names it",
    remedy="see configs/guides/margin.md",
)
UNCERTAINTY_BLOCKS = PilotText(
    pattern="no path, uncertainty {m} m",
    actions=_NO_ESCAPE,
    meaning="obstacles that are inflated by the position's uncertainty block every path",
    remedy="wait for a better position, or take over",
)
TRACKING_BLOCKS = PilotText(
    pattern="no path with tracking error",
    actions=_NO_ESCAPE,
    meaning="obstacles that are inflated by the present tracking error block every path",
    remedy="wait for less wind, or take over",
)
TARGET_FENCED = PilotText(
    pattern="{target} past {fence}",
    actions=_STAYS,
    meaning="the target is outside this limit of the autopilot's fence, less `fence_margin_m`",
    remedy="order another target, or change the fence",
)
FENCED = PilotText(
    pattern="fence {fence}",
    actions=_NO_ESCAPE,
    meaning="only this limit of the autopilot's fence, less `fence_margin_m`, blocks the path",
    remedy="take over, or change the fence",
)
FAR_BESIDE = PilotText(
    pattern="{far_m} m off workspace > {most_m}, {side}",
    actions=_NO_ESCAPE,
    meaning="the aircraft is farther beside it than `guidance.recovery_m`, on this side of it",
    remedy="fly it back to the workspace, and order again; or correct the site's frame",
)
FAR_OUTSIDE = PilotText(
    pattern="{far_m} m off workspace > {most_m}",
    actions=_NO_ESCAPE,
    meaning="the aircraft is farther above or below it than `guidance.recovery_m`",
    remedy="fly it back to the workspace, and order again; or correct the site's frame",
)
OUTSIDE = PilotText(
    pattern="{far_m} m off workspace: {way}",
    actions=_NO_ESCAPE,
    meaning="no recovery leg leads from the aircraft to the workspace",
    remedy="take over, and fly that way",
)
LOW = PilotText(
    pattern="height {low_m} m < {least_m}: climb",
    actions=_NO_ESCAPE,
    meaning="the aircraft is below `workspace.min_altitude_m`, and no leg leads up",
    remedy="take over, and climb",
)
CLOSE = PilotText(
    pattern="too near {obstacle}: {way}",
    actions=_NO_ESCAPE,
    meaning="the aircraft is inside this obstacle's keep-out, and no leg leads out",
    remedy="take over, and fly that way",
)
PLANNER_SILENT = PilotText(
    pattern="no plan in {s} s",
    actions=_NO_ESCAPE,
    meaning="the planner gave no plan for the present maps in this time",
    remedy="order again; else see the log",
)
PLANNER_FAILED = PilotText(
    pattern="the planner failed",
    actions=_NO_ESCAPE,
    meaning="a fault of the planner, which the log has",
    remedy="order again; else take over",
)
FAILSAFE_HITS = PilotText(
    pattern="{link}: {reaction} hits {obstacle}",
    actions=("", "denied", "holding"),
    meaning="on this path the autopilot's action after a link loss, or the loss of GPS, would hit "
    "this obstacle",
    remedy="set the failsafe parameters (`check` names them)",
)

# In flight

PATH_MOVED = PilotText(
    pattern="{risk} risk {fraction}, {path}",
    meaning="a new plan, which this risk has moved most",
)
CONDUCTOR_SEEN = PilotText(
    pattern="wire {wire} at x {x_m}, z {z_m}",
    actions=("avoided",),
    meaning="the sensor sees a conductor there, in the plane, that the site file does not have",
    remedy="survey the site again; see `moar-companion view`",
)
CONDUCTOR_MOVED = PilotText(
    pattern="{conductor} {m} m off the file",
    actions=("avoided",),
    meaning="the sensor sees this conductor at this distance from its place in the site file; both "
    "places are avoided",
    remedy="check the position (GNSS, datum, height) before the site file",
)
NARROW = PilotText(
    pattern="{low_m} m to {obstacle} < {least_m}",
    actions=("exiting", "evacuating"),
    meaning="the only escape route keeps less than the margin from this obstacle",
    remedy="watch, or take over",
)
BLOWN_OFF = PilotText(
    pattern="wind too strong, drifting {outside_m} m",
    meaning="the drift has doubled since it was last reported",
    remedy="take over, if it comes near an obstacle",
)
RETURNING = PilotText(
    pattern="{m} m outside, wind is less",
    actions=("returning",),
    meaning="the aircraft, blown off, flies back to its path",
)
NO_PATH_BACK = PilotText(
    pattern="{m} m outside, no path back: take over",
    meaning="the aircraft was blown off, and no free leg leads back",
    remedy="take over, and fly it back",
)
EXPOSED = PilotText(
    pattern="{trigger} hits {obstacle}, exit in {s} s",
    meaning="from here this failsafe's action would hit this obstacle; the exit follows then",
    remedy="order the exit earlier, or set the failsafe parameters",
)
MODE_KEPT = PilotText(
    pattern="{mode} kept",
    actions=("waiting for OFFBOARD", "waiting for GUIDED"),
    meaning="the companion does not request its mode: the pilot or the autopilot flies",
    remedy="select OFFBOARD or GUIDED",
)
MODE_REFUSED = PilotText(
    pattern="mode request refused: {result}",
    meaning="the autopilot did not accept the requested mode; its MAV_RESULT",
    remedy="see the autopilot's own text",
)
NO_LANDING = PilotText(
    pattern="the landing has not begun, choose LAND",
    meaning="three LAND requests had no effect",
    remedy="select LAND",
)

# The autopilot's parameters

UNREPORTED = PilotText(
    pattern="{count} parameter{plural} unread, taken as worst",
    meaning="the autopilot never reported parameters on which the flight depends; the log names "
    "them. Each counts with its most cautious value; where none is, no inspection begins",
    remedy="see `check`",
)

# Pictures

_LEFT_OUT = ("holding", "target skipped", "view skipped")
_SEE_ACTION = "see `inspection.on_failure`; `continue` tries again"

CAMERA_SILENT = PilotText(
    pattern="camera does not answer",
    actions=_LEFT_OUT,
    meaning="no answer to a repeated command for a picture or a video",
    remedy=f"check the camera and its link; {_SEE_ACTION}",
)
PICTURE_UNCONFIRMED = PilotText(
    pattern="no picture confirmed",
    actions=_LEFT_OUT,
    meaning="the camera accepts commands, and confirms no picture, also not on request",
    remedy=f"check the camera's card; {_SEE_ACTION}",
)
CARD_FULL = PilotText(
    pattern="camera card full",
    actions=_LEFT_OUT,
    meaning="the camera refuses a picture and reports no room for it",
    remedy="land, and change the card",
)
PICTURE_REFUSED = PilotText(
    pattern="picture {result}",
    actions=_LEFT_OUT,
    meaning="the camera's answer to a command for a picture",
    remedy=f"check the camera's mode; {_SEE_ACTION}",
)
VIDEO_REFUSED = PilotText(
    pattern="video {result}",
    actions=_LEFT_OUT,
    meaning="the camera's answer to a command for a video",
    remedy=f"check the camera's mode; {_SEE_ACTION}",
)
GIMBAL_HELD = PilotText(
    pattern="gimbal held by {id}/{other_id}",
    actions=_LEFT_OUT,
    meaning="this system and component has control of the gimbal; control is taken from nobody",
    remedy="give it back there, then order `continue`",
)
GIMBAL_SILENT = PilotText(
    pattern="gimbal does not answer",
    actions=_LEFT_OUT,
    meaning="its manager does not report who has control, or its angles",
    remedy=f"check the gimbal and its link; {_SEE_ACTION}",
)
OFF_AIM = PilotText(
    pattern="aim {degrees} deg off > {limit}",
    actions=_LEFT_OUT,
    meaning="gimbal, or heading without one, did not reach the aim point in `inspection.timeout_s`",
    remedy=f"check the gimbal's range; {_SEE_ACTION}",
)
UNSTEADY = PilotText(
    pattern="unsteady: {quantity}",
    actions=_LEFT_OUT,
    meaning="a limit of the section `inspection` was exceeded for `inspection.timeout_s`",
    remedy=f"wait for less wind; {_SEE_ACTION}",
)

TEXTS: Mapping[str, PilotText] = {
    **{name: text for name, text in globals().items() if isinstance(text, PilotText)},
    **service_texts.TEXTS,
}
"""All of them by name, in this order, with those of the service."""
