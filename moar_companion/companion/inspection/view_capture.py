"""Capture of one view: aim, settle, capture, confirmed; a pure step machine.

    aiming -> settling -> capturing -> settling ... -> recording -> done
    from each of them, by a fault or its time-out:                  -> failed

Inputs of a step: what was observed of aircraft, camera and gimbal. Outputs: the next state, and
what is asked of the camera. `inspector` observes, and carries it out.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, replace

from ...mavlink.camera import Capture
from ...mavlink.gimbal import Control
from ...settings.config import Inspection
from ...texts import pilot_texts
from ...texts.text_format import exceeds, limit_text

_UNSTEADY_TRIES = 3
"""Pictures that are taken for one that was steady; the last of them counts, and is marked."""
_TAKEN_BY_GIMBAL = 4.0
"""Multiple of the turn rate that a gimbal permits in roll and pitch, of which it leaves a
twentieth: PX4's own simulator hovers with up to 20 degrees a second."""


class Phase(str, enum.Enum):
    """Progress of a view."""

    AIMING = "aiming"
    SETTLING = "settling"
    CAPTURING = "capturing"
    RECORDING = "recording"
    DONE = "done"
    FAILED = "failed"


class Ask(enum.Enum):
    """What is asked of the camera."""

    PICTURE = "a picture"
    START_VIDEO = "the start of a video"
    STOP_VIDEO = "the end of the video"


@dataclass(frozen=True, slots=True, kw_only=True)
class Observed:
    """Aircraft, gimbal and camera at one instant.

    aim_error_rad: from the camera's axis to the aim point; None while unknown. position_error_m:
    from the setpoint. turn_rate_radps, of all axes, and yaw_rate_radps: None while unknown.
    failure: reason of the camera.
    """

    gimbal: Control
    holder: tuple[int, int] | None = None
    camera_known: bool
    aim_error_rad: float | None
    position_error_m: float
    speed_mps: float
    turn_rate_radps: float | None
    yaw_rate_radps: float | None
    picture: Capture = Capture.NONE
    video: Capture = Capture.NONE
    failure: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewCapture:
    """State of a view's capture. since_s: start of the phase. left: pictures still to confirm."""

    left: int
    video_s: float
    """Length of the video still to take; 0: none."""
    phase: Phase = Phase.AIMING
    since_s: float
    steady_s: float | None = None
    """Time since when all limits hold; None while one does not."""
    moved: str = ""
    """Limit that was exceeded since the picture was asked for; empty: none."""
    tries: int = 0
    """Pictures of the present one that were not steady."""
    reason: str = ""
    """Reason of the failure."""

    @property
    def ended(self) -> bool:
        """True once the view is done, or has failed."""
        return self.phase in {Phase.DONE, Phase.FAILED}


Step = tuple[ViewCapture, tuple[Ask, ...]]


def step(capture: ViewCapture, seen: Observed, limits: Inspection, now_s: float) -> Step:
    """Runs one cycle of a view that has not ended."""
    fault = _fault(seen)
    if fault:
        return _failed(capture, fault, now_s)
    unsteady = _unsteady(seen, limits)
    if unsteady:
        capture = replace(capture, steady_s=None)
    elif capture.steady_s is None:
        capture = replace(capture, steady_s=now_s)
    match capture.phase:
        case Phase.AIMING:
            return _aim(capture, seen, limits, now_s)
        case Phase.SETTLING:
            return _settle(capture, unsteady, limits, now_s)
        case Phase.CAPTURING:
            return _take(replace(capture, moved=capture.moved or unsteady), seen, now_s)
        case Phase.RECORDING:
            return _record(replace(capture, moved=capture.moved or unsteady), seen, now_s)
        case _:
            return capture, ()


def _aim(capture: ViewCapture, seen: Observed, limits: Inspection, now_s: float) -> Step:
    ready = seen.camera_known and seen.gimbal in {Control.OURS, Control.NO_GIMBAL}
    error_rad = seen.aim_error_rad
    if ready and error_rad is not None and error_rad <= math.radians(limits.aim_deg):
        return replace(capture, phase=Phase.SETTLING, since_s=now_s), ()
    if now_s < capture.since_s + limits.timeout_s:
        return capture, ()
    if not seen.camera_known:
        return _failed(capture, pilot_texts.CAMERA_SILENT(), now_s)
    if not ready or error_rad is None:
        return _failed(capture, pilot_texts.GIMBAL_SILENT(), now_s)
    return _failed(capture, _off_aim(error_rad, limits), now_s)


def _settle(capture: ViewCapture, unsteady: str, limits: Inspection, now_s: float) -> Step:
    if capture.steady_s is not None and now_s >= capture.steady_s + limits.settle_s:
        begun = replace(capture, since_s=now_s, moved="")
        if capture.left:
            return replace(begun, phase=Phase.CAPTURING), (Ask.PICTURE,)
        return replace(begun, phase=Phase.RECORDING), (Ask.START_VIDEO,)
    if unsteady and now_s >= capture.since_s + limits.timeout_s:
        return _failed(capture, unsteady, now_s)
    return capture, ()


def _take(capture: ViewCapture, seen: Observed, now_s: float) -> Step:
    if seen.picture is Capture.FAILED:
        return _failed(capture, seen.failure, now_s)
    if seen.picture is not Capture.DONE:
        return capture, ()
    if capture.moved and capture.tries + 1 < _UNSTEADY_TRIES:
        again = replace(capture, phase=Phase.SETTLING, since_s=now_s, tries=capture.tries + 1)
        return again, ()
    taken = replace(capture, left=capture.left - 1, tries=0, since_s=now_s)
    if taken.left or taken.video_s:
        # The next one shows something else, and ArduPilot's servo has let go of the shutter.
        return replace(taken, phase=Phase.SETTLING, steady_s=now_s), ()
    return replace(taken, phase=Phase.DONE), ()


def _record(capture: ViewCapture, seen: Observed, now_s: float) -> Step:
    if seen.video is Capture.FAILED:
        return _failed(capture, seen.failure, now_s)
    if seen.video is not Capture.DONE:
        return replace(capture, since_s=now_s), ()
    if now_s < capture.since_s + capture.video_s:
        return capture, ()
    return replace(capture, phase=Phase.DONE, video_s=0.0, since_s=now_s), (Ask.STOP_VIDEO,)


def _failed(capture: ViewCapture, reason: str, now_s: float) -> Step:
    stop = (Ask.STOP_VIDEO,) if capture.phase is Phase.RECORDING else ()
    return replace(capture, phase=Phase.FAILED, since_s=now_s, reason=reason), stop


def _fault(seen: Observed) -> str:
    """Reason to end the view at once; empty without one."""
    if seen.gimbal is not Control.OTHERS or seen.holder is None:
        return ""
    system_id, component_id = seen.holder
    return pilot_texts.GIMBAL_HELD(id=system_id, other_id=component_id)


def _off_aim(error_rad: float, limits: Inspection) -> str:
    limit = limit_text(limits.aim_deg)
    return pilot_texts.OFF_AIM(degrees=f"{math.degrees(error_rad):.1f}", limit=limit)


def _unsteady(seen: Observed, limits: Inspection) -> str:
    """The first limit that is exceeded, as text; empty: none. Unknown is not steady."""
    if not seen.camera_known:
        return pilot_texts.CAMERA_SILENT()
    if seen.aim_error_rad is None:
        return pilot_texts.GIMBAL_SILENT()
    if math.degrees(seen.aim_error_rad) > limits.aim_deg:
        return _off_aim(seen.aim_error_rad, limits)
    turn_dps, yaw_dps = (
        math.inf if rate_radps is None else math.degrees(abs(rate_radps))
        for rate_radps in (seen.turn_rate_radps, seen.yaw_rate_radps)
    )
    # The gimbal's yaw follows the nose.
    gimbals = seen.gimbal is not Control.NO_GIMBAL
    rate_dps = max(yaw_dps, turn_dps / _TAKEN_BY_GIMBAL) if gimbals else turn_dps
    exceeded = (
        exceeds("", seen.position_error_m, limits.position_m, "m")
        or exceeds("", seen.speed_mps, limits.speed_mps, "m/s")
        or exceeds("", rate_dps, limits.turn_rate_dps, "dps")
    )
    return "" if exceeded is None else pilot_texts.UNSTEADY(quantity=exceeded)
