"""The inspector: carries out the capture of views with camera and gimbal, and records pictures.

Inputs each cycle: mission status, pose, telemetry, and the progress of the session's camera and
gimbal. Outputs: what these are asked for, rows of the record, and the outcome of the view for the
mission machine. As soon as the flight leaves a view, for whatever reason, its capture ends; as soon
as no view follows, the gimbal is given back.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

from ..mavlink.gimbal import Control
from ..mavlink.session import Session
from ..planner.site import Conductor, Site, Target
from ..risk import RiskEstimate
from ..settings.config import Inspection
from ..status_values import InspectionSection
from ..types import Vector
from .estimation.plane_to_local import PlaneToLocal
from .estimation.pose import Pose
from .inspection.aim import Direction, angle_rad, camera_axis, direction_to
from .inspection.picture_record import Shot, picture_row
from .inspection.view_capture import Ask, Observed, Phase, ViewCapture, step
from .mission.values import MissionStatus
from .mission_states import ENGAGED, MissionState
from .reports import Reports

_ATTITUDE_MAX_AGE_S = 0.5
"""Age of ATTITUDE above which the turn rate is unknown: it comes at 10 Hz or more."""
_LEAST_PICTURE_RAD = math.radians(50.0)
"""Angle of a picture whose camera does not tell its lens: the height of most."""
_LATE_S = 5.0
"""Time in which a picture may still be confirmed whose view has failed or was left."""
_MIDDLE = 0.1
"""Part of the picture from its middle to the edge of its middle fifth."""
_USUAL = 0.5
"""Usual error of the position, as a part of the greatest that was measured with the autopilot: in
true pictures of a real PX4 the aim was 0.7 m off, with a reported accuracy of 0.3 m."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewOutcome:
    """Outcome of the present view, for the mission machine.

    pending: it is not captured so far. failed: reason; None without a failure. others: stops of the
    same target. missing: stops of this inspection that are not done: failed, or left out.
    """

    pending: bool = False
    failed: str | None = None
    others: tuple[str, ...] = ()
    missing: int = 0


class Inspector:
    """Captures the views of an inspection, one at a time."""

    def __init__(self, session: Session, reports: Reports, limits: Inspection) -> None:
        self._session = session
        self._reports = reports
        self._limits = limits
        self._target: Target | None = None
        """The view that is captured; None away from views."""
        self._capture: ViewCapture | None = None
        self._taken: Counter[str] = Counter()
        """Confirmed pictures of the present inspection, by stop."""
        self._filmed: set[str] = set()
        self._failed: set[str] = set()
        self._left_out: set[str] = set()
        self._shot: Shot | None = None
        """The picture that was asked for and is not confirmed."""
        self._shot_until_s = math.inf
        """Time until which its confirmation may come, once it is no longer awaited."""
        self._video: Shot | None = None
        """The video that runs."""
        self._zoomed: float | None = None
        self._usual_m = 0.0
        """Usual error of the position."""
        self._gives_back = False
        """True while the gimbal's control may be ours."""

    def begin(self) -> None:
        """Begins an inspection that was ordered anew: all its views are captured again."""
        self._taken.clear()
        self._filmed.clear()
        self._failed.clear()
        self._left_out.clear()

    def leave_out(self, stops: tuple[str, ...]) -> None:
        """Notes stops that the inspection leaves out."""
        self._left_out.update(stops)

    def outcome(self, status: MissionStatus, site: Site | None) -> ViewOutcome:
        """Outcome of the view at which the flight is."""
        target = _view_of(status, site)
        missing = len(self._failed | self._left_out)
        if target is None or site is None:
            return ViewOutcome(missing=missing)
        others = site.stops_of(target.target_name)
        capture = self._capture
        if self._target is None or self._target.name != target.name or capture is None:
            return ViewOutcome(pending=True, others=others, missing=missing)
        failed = capture.reason if capture.phase is Phase.FAILED else None
        return ViewOutcome(pending=not capture.ended, failed=failed, others=others, missing=missing)

    def act(
        self,
        status: MissionStatus,
        site: Site | None,
        pose: Pose | None,
        plane: PlaneToLocal | None,
        error_m: float | None,
        risk: RiskEstimate,
        now_s: float,
        *,
        position_error_m: float,
    ) -> None:
        """Runs one cycle. error_m: from the setpoint to the aircraft; None while none is sent.

        position_error_m: greatest error of the position, which distances allow for.
        """
        self._usual_m = _USUAL * position_error_m
        if site is None or not _has_views(status, site):
            self.leave(now_s)
            return
        self._session.want_payload(now_s)
        target = _view_of(status, site)
        if self._target is not None and (target is None or target.name != self._target.name):
            self._interrupt(now_s)
        if target is not None and pose is not None and plane is not None and error_m is not None:
            self._target = target
            self._step(target, site, pose, plane, error_m, risk, now_s)
        self._take_images(now_s)

    def leave(self, now_s: float) -> None:
        """Ends the capture, and gives the gimbal back."""
        self._interrupt(now_s)
        if self._gives_back:
            self._gives_back = False
            self._session.gimbal.give_back()
        self._take_images(now_s)

    def _interrupt(self, now_s: float) -> None:
        """Ends the capture of the present view."""
        target, capture = self._target, self._capture
        self._target = self._capture = None
        self._session.gimbal.rest()
        if target is None or capture is None or capture.ended:
            return
        camera = self._session.camera
        self._shot_until_s = now_s + _LATE_S
        camera.forget_picture()
        camera.stop_video()
        self._record_view(target, "interrupted", capture.phase.value, now_s)

    def _step(
        self,
        target: Target,
        site: Site,
        pose: Pose,
        plane: PlaneToLocal,
        error_m: float,
        risk: RiskEstimate,
        now_s: float,
    ) -> None:
        camera, view = self._session.camera, target.view
        assert view is not None
        if self._capture is None:
            self._capture = self._begun(target, now_s)
        before = self._capture
        aim = direction_to(view.aim_m, pose.position_m, plane)
        control = self._point(aim, pose, now_s)
        axis = self._camera_axis(aim, pose, now_s)
        if before.ended:
            return
        if camera.camera is not None and view.zoom_percent not in {None, self._zoomed}:
            self._zoomed = view.zoom_percent
            camera.set_zoom(self._zoomed or 0.0)
        aim_error_rad = _aim_error_rad(aim, pose, axis, control)
        seen = self._observed(control, aim_error_rad, pose, error_m, now_s)
        after, asks = step(before, seen, self._limits, now_s)
        self._capture = after
        if after.left < before.left:
            self._taken[target.name] += 1
        for ask in asks:
            match ask:
                case Ask.PICTURE:
                    self._shot_until_s = math.inf
                    self._shot = self._shot_of(
                        target, site, pose, aim, axis, aim_error_rad, risk, now_s
                    )
                    camera.take_picture()
                case Ask.START_VIDEO:
                    self._video = self._shot_of(
                        target, site, pose, aim, axis, aim_error_rad, risk, now_s
                    )
                    camera.start_video()
                case Ask.STOP_VIDEO:
                    camera.stop_video()
        if after.phase is Phase.DONE and before.phase is Phase.RECORDING:
            self._record_video(target, after, now_s)
        if after.phase is Phase.DONE:
            self._failed.discard(target.name)
            self._record_view(target, "done", "", now_s)
        elif after.phase is Phase.FAILED:
            self._failed.add(target.name)
            self._shot_until_s = now_s + _LATE_S
            self._record_view(target, "failed", after.reason, now_s)

    def _begun(self, target: Target, now_s: float) -> ViewCapture:
        """The capture of what is missing of a view."""
        view = target.view
        assert view is not None
        left = max(0, view.pictures - self._taken[target.name])
        video_s = 0.0 if target.name in self._filmed else view.video_s
        phase = Phase.AIMING if left or video_s else Phase.DONE
        return ViewCapture(left=left, video_s=video_s, phase=phase, since_s=now_s)

    def _point(self, aim: Direction, pose: Pose, now_s: float) -> Control:
        """Points the gimbal, whose control is taken if nobody has it; returns its holder."""
        gimbal = self._session.gimbal
        control = gimbal.control(self._session.ids, now_s)
        if control is Control.FREE:
            self._gives_back = True
            gimbal.take()
        if self._capture is not None and self._capture.phase is Phase.CAPTURING:
            gimbal.rest()  # one that moves would blur the picture
            return control
        heading = pose.yaw_rad if aim.heading_rad is None else aim.heading_rad
        gimbal.point(aim.elevation_rad, math.remainder(heading - pose.yaw_rad, math.tau))
        return control

    def _camera_axis(self, aim: Direction, pose: Pose, now_s: float) -> tuple[float, float] | None:
        """Elevation and heading of the camera's axis; None while it is not reported."""
        attitude = self._session.gimbal.attitude(now_s)
        return None if attitude is None else camera_axis(aim, attitude, self._body_rad(pose))

    def _body_rad(self, pose: Pose) -> Vector:
        """Roll, pitch and heading of the aircraft."""
        body = self._session.telemetry.attitude
        if body is None:
            return 0.0, 0.0, pose.yaw_rad
        return body.roll_rad, body.pitch_rad, pose.yaw_rad

    def _observed(
        self,
        control: Control,
        aim_error_rad: float | None,
        pose: Pose,
        error_m: float,
        now_s: float,
    ) -> Observed:
        camera, gimbal = self._session.camera, self._session.gimbal
        attitude = self._session.telemetry.attitude
        fresh = attitude is not None and now_s - attitude.received_s <= _ATTITUDE_MAX_AGE_S
        return Observed(
            gimbal=control,
            holder=gimbal.holder,
            camera_known=camera.camera is not None,
            aim_error_rad=aim_error_rad,
            position_error_m=error_m,
            speed_mps=math.hypot(*pose.velocity_mps),
            turn_rate_radps=attitude.turn_rate_radps if attitude is not None and fresh else None,
            yaw_rate_radps=attitude.yaw_rate_radps if attitude is not None and fresh else None,
            picture=camera.picture,
            video=camera.video,
            failure=camera.failure,
        )

    # Record

    def _shot_of(
        self,
        target: Target,
        site: Site,
        pose: Pose,
        aim: Direction,
        axis: tuple[float, float] | None,
        aim_error_rad: float | None,
        risk: RiskEstimate,
        now_s: float,
    ) -> Shot:
        view = target.view
        assert view is not None
        conductor = _nearest(site.conductors, view.aim_m)
        spread = risk.wind.spread
        return Shot(
            time_s=now_s,
            target=view.target,
            view=view.number,
            stop=target.name,
            aim_m=view.aim_m,
            place=site.frame.to_geodetic(pose.position_m),
            position_m=pose.position_m,
            attitude_rad=self._body_rad(pose),
            camera_pitch_rad=None if axis is None else axis[0],
            camera_heading_rad=None if axis is None else axis[1],
            aim_error_rad=aim_error_rad,
            distance_m=aim.distance_m,
            conductor=None if conductor is None else conductor.name,
            conductor_m=None if conductor is None else _distance_m(conductor, pose.position_m),
            accuracy_m=risk.position_uncertainty_m,
            risk=risk.indices,
            wind_ne_mps=None if spread is None else spread.mean_ne_mps,
        )

    def _take_images(self, now_s: float) -> None:
        """Records the camera's confirmed pictures; the first is the one that was asked for."""
        if now_s > self._shot_until_s:
            self._shot = None
        for image in self._session.camera.take_images():
            shot, self._shot = self._shot, None
            if shot is None:
                row = picture_row(None, image, count=0, marks=["not asked for"])
            else:
                row = picture_row(shot, image, count=self._count(shot), marks=self._marks(shot))
            self._reports.record("picture", now_s, **row)

    def _count(self, shot: Shot) -> int:
        """Pictures of the shot's view with this one; 0 if it is taken again."""
        capture, target = self._capture, self._target
        if target is None or capture is None or target.name != shot.stop:
            self._taken[shot.stop] += 1  # confirmed after the flight has left the view
        elif capture.phase is Phase.SETTLING and capture.tries:
            return 0
        return self._taken[shot.stop]

    def _marks(self, shot: Shot) -> list[str]:
        capture = self._capture
        marks = [capture.moved] if capture is not None and capture.moved else []
        if shot.accuracy_m is None:
            return [*marks, "position accuracy unknown"]
        camera = self._session.camera.camera
        known = None if camera is None else camera.field_of_view_rad
        least_rad = _LEAST_PICTURE_RAD if known is None else min(known)
        error_m = max(shot.accuracy_m, self._usual_m)
        off_rad = math.atan2(error_m, shot.distance_m) + (shot.aim_error_rad or 0.0)
        middle_rad = math.atan(2.0 * _MIDDLE * math.tan(least_rad / 2.0))
        return [*marks, "aim uncertain"] if off_rad > middle_rad else marks

    def _record_video(self, target: Target, capture: ViewCapture, now_s: float) -> None:
        self._filmed.add(target.name)
        shot, self._video = self._video, None
        if shot is not None:
            marks = [capture.moved] if capture.moved else []
            video_s = round(now_s - shot.time_s, 2)
            self._reports.record("video", now_s, video_s=video_s, marks=marks, **shot.row())

    def _record_view(self, target: Target, outcome: str, reason: str, now_s: float) -> None:
        view = target.view
        assert view is not None
        self._reports.record(
            "view",
            now_s,
            target=view.target,
            view=view.number,
            stop=target.name,
            outcome=outcome,
            reason=reason,
            pictures=self._taken[target.name],
            of=view.pictures,
            filmed=target.name in self._filmed,
        )

    def section(self, site: Site | None, now_s: float) -> InspectionSection | None:
        """Progress for displays; None without a site that has views."""
        views = () if site is None else tuple(item for item in site.targets if item.view)
        if not views:
            return None
        camera, capture = self._session.camera.camera, self._capture
        target = self._target
        control = self._session.gimbal.control(self._session.ids, now_s)
        return InspectionSection(
            view=None if target is None else target.name,
            phase=None if capture is None else capture.phase.value,
            reason=None if capture is None or not capture.reason else capture.reason,
            pictures=sum(self._taken.values()),
            of=sum(item.view.pictures for item in views if item.view is not None),
            failed=tuple(sorted(self._failed)),
            camera=None if camera is None else camera.name,
            gimbal=control.value,
        )


def _has_views(status: MissionStatus, site: Site) -> bool:
    """True while an inspection is flown or planned that leads to a view."""
    tasks = [task for task in (status.requested, status.task) if task is not None]
    return status.state in ENGAGED - {MissionState.HOLDING} and any(
        site.target(stop).view is not None
        for task in tasks
        if task.mission.visits_targets
        for stop in task.stops
    )


def _view_of(status: MissionStatus, site: Site | None) -> Target | None:
    """The view at which the flight is; None elsewhere."""
    task = status.task
    if status.state is not MissionState.AT_TARGET or site is None or task is None or task.done:
        return None
    if not task.mission.visits_targets:
        return None
    target = site.target(task.stops[0])
    return target if target.view is not None else None


def _aim_error_rad(
    aim: Direction, pose: Pose, axis: tuple[float, float] | None, control: Control
) -> float | None:
    """Angle from the camera's axis to the aim point; without a gimbal of the headings alone."""
    if control is Control.NO_GIMBAL:
        if aim.heading_rad is None:
            return 0.0
        return abs(math.remainder(aim.heading_rad - pose.yaw_rad, math.tau))
    return None if axis is None else angle_rad(aim, *axis)


def _nearest(conductors: tuple[Conductor, ...], aim_m: tuple[float, float]) -> Conductor | None:
    return min(conductors, key=lambda item: math.dist(item.position_m, aim_m), default=None)


def _distance_m(conductor: Conductor, position_m: Vector) -> float:
    """Distance from a place to the surface of a conductor, which crosses the plane."""
    place_m = (position_m[0], position_m[2])
    return math.dist(place_m, conductor.position_m) - conductor.radius_m
