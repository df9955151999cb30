"""Obstacles of the sensor: they join those of the site file, and new maps are requested.

Maps for changed settings are requested here, too: they have the same obstacles.
Inputs: reports of the perception, answers with maps, poses, settings. Outputs: map jobs, notes of
poses for the perception, texts for operators. A seen conductor near a conductor of the site file
counts as the same one at another place: both places are avoided.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace
from typing import NamedTuple

from ..mavlink.session import Severity
from ..mavlink.telemetry import Proximity, Telemetry
from ..perception.perception_report import (
    LineOffset,
    PerceptionReport,
    SeenConductor,
    SensorHealth,
)
from ..perception.pose_notes import AttitudeNote, PointsNote, PoseNote, PositionNote
from ..planner.site import Conductor, Margin, Obstacle, Site
from ..settings.perception_config import Perception, Sensor
from ..settings.vehicle import Vehicle
from ..texts import pilot_texts
from ..texts.text_format import coordinate, distance
from .estimation.pose import Jump
from .estimation.pose_tracker import PoseTracker
from .planning.map_jobs import MapAnswer, MapJob, SettingsJob
from .planning.site_maps import SiteMaps
from .reports import Reports

_APART_M, _SAME_PLACE_M = 0.25, 0.15
"""Distances of a seen conductor from its place in the file. Above the first one it becomes an
obstacle of its own, below the second one it ceases to be one. The margin covers smaller ones."""
_MOVED_M = 0.15
"""Least move of a conductor that changes its place on the maps: the accuracy of its place."""
_RADIUS_M = 0.02
"""Radius of a seen conductor; the keep-out is far greater."""
_NO_LINE = LineOffset()
"""Line without a sensor, or before its first report."""
_MOST_NOTES = 200
"""Maximum number of kept notes: two seconds of poses."""


class NewMaps(NamedTuple):
    """Maps of an answer; None: the planner has failed.

    vehicle: with the settings that they were made for; None: those of the maps before.
    """

    site_maps: SiteMaps | None
    vehicle: Vehicle | None


class SeenObstacles:
    """Keeps the newest report, and the obstacles of the present maps."""

    def __init__(self, settings: Perception, reports: Reports) -> None:
        self.settings = settings
        self._site: Site | None = None
        """Site of the file, as flown; None without a site."""
        self._reports = reports
        self.report: PerceptionReport | None = None
        """The newest report; None before the first."""
        self._mapped_report: PerceptionReport | None = None
        self._seen: tuple[Obstacle, ...] | None = ()
        """Obstacles of the last job, in the form of a site file; None after its failure."""
        self._current: tuple[Obstacle, ...] = ()
        """Those of them that the present process of the perception has reported."""
        self._before: tuple[Obstacle, ...] = ()
        """Obstacles of processes that have ended; kept until the aircraft is on the ground."""
        self._job_id = 0
        self._asked_s: float | None = None
        """Time of the pending job; None without one."""
        self._taken_s: float | None = None
        """Time of the last answer that was taken."""
        self._newer_s: float | None = None
        """Time of the first report that the pending job lacks an obstacle of."""
        self._unmapped_s: float | None = None
        """Time since which the maps lack an obstacle; None if they have all."""
        self._wanted: Vehicle | None = None
        """Vehicle with changed settings, for which maps are to be requested."""
        self._wanted_margin = Margin()
        self._rebuilt: SettingsJob | None = None
        """The pending job, if it is for changed settings."""
        self._report_first = False
        """True after a job for changed settings: a waiting report goes before the next one."""
        self._jobs: list[MapJob] = []
        self._answer: MapAnswer | None = None
        self._texts: list[tuple[Severity, str]] = []
        """Texts about the obstacles of the job, sent when the maps have them."""
        self._notes: deque[PoseNote] = deque(maxlen=_MOST_NOTES)
        self._noted: tuple[float | None, float | None] = (None, None)
        """Boot times of the last position and attitude that were noted."""
        self._proximity: Proximity | None = None
        self._reported_m: dict[tuple[str, str], float] = {}
        """Last reported distance, by names in the file and as seen; 0 for an unknown conductor."""

    def take_site(self, site: Site) -> None:
        """Takes the site, as flown."""
        self._site = site

    def want(self, vehicle: Vehicle | None, margin: Margin) -> None:
        """Requests maps for changed settings, in a later cycle; None: the present maps suffice."""
        self._wanted, self._wanted_margin = vehicle, margin

    @property
    def health(self) -> SensorHealth:
        """State of the sensor."""
        return SensorHealth() if self.report is None else self.report.health

    @property
    def line(self) -> LineOffset:
        """Offset of the line's frame; unknown without a sensor."""
        return _NO_LINE if self.report is None else self.report.line

    def take(self, report: PerceptionReport) -> None:
        """Takes a report, for the next cycle."""
        self.report = report

    def answered(self, answer: MapAnswer) -> None:
        """Takes the answer to a map job, for the next cycle; one no longer awaited is dropped."""
        if answer.job_id == self._job_id:
            self._answer = answer

    def jobs(self) -> list[MapJob]:
        """Returns the map jobs since the last call."""
        jobs, self._jobs = self._jobs, []
        return jobs

    def pose_notes(self) -> list[PoseNote]:
        """Returns the notes for the perception since the last call."""
        notes = list(self._notes)
        self._notes.clear()
        return notes

    def note_pose(self, telemetry: Telemetry, tracker: PoseTracker, jump: Jump | None) -> None:
        """Notes a new position and attitude, each at its own time, and a jump of the estimate."""
        if self.settings.sensor is None:
            return
        if jump is not None:
            self.shift(jump)
        position, attitude = telemetry.local_position, telemetry.attitude
        position_boot_s, attitude_boot_s = self._noted
        estimate = tracker.estimate
        if estimate is not None and position is not None and position.boot_s != position_boot_s:
            time_s = tracker.received_s(position.boot_s)
            if time_s is not None:
                self._notes.append(
                    PositionNote(
                        time_s=time_s,
                        position_m=estimate.position_m,
                        jumped_m=tracker.jumped_by_m,
                        offset_m=tracker.offset_m,
                    )
                )
            position_boot_s = position.boot_s
        if attitude is not None and attitude.boot_s not in {None, attitude_boot_s}:
            assert attitude.boot_s is not None
            time_s = tracker.received_s(attitude.boot_s)
            if time_s is not None:
                self._notes.append(
                    AttitudeNote(
                        time_s=time_s,
                        roll_rad=attitude.roll_rad,
                        pitch_rad=attitude.pitch_rad,
                        yaw_rad=attitude.yaw_rad,
                    )
                )
            attitude_boot_s = attitude.boot_s
        self._noted = (position_boot_s, attitude_boot_s)
        proximity, before = telemetry.proximity, self._proximity
        if self.settings.sensor is Sensor.MAVLINK and proximity is not None:
            self._proximity = proximity
            if proximity is not before:
                self._notes.append(
                    PointsNote(time_s=proximity.received_s, points_m=proximity.points_m)
                )

    def shift(self, jump: Jump) -> None:
        """Moves the obstacles of ended processes with a jump of the pose."""
        right_m, _, up_m = jump.step_m
        self._before = tuple(item.moved(right_m, up_m) for item in self._before)

    def unmapped_s(self, now_s: float) -> float | None:
        """Time for which the maps have lacked an obstacle; None if they have all.

        Maps for changed settings lack what is reported while they are made.
        """
        missing_s = [self._unmapped_s, None if self._rebuilt is None else self._newer_s]
        return max((now_s - since_s for since_s in missing_s if since_s is not None), default=None)

    @property
    def for_settings(self) -> NewMaps | None:
        """Maps for changed settings that `taken` returns next; None: no such maps."""
        if self._answer is None or self._answer.site_maps is None or self._rebuilt is None:
            return None
        return NewMaps(self._answer.site_maps, self._rebuilt.vehicle)

    @property
    def settings_asked(self) -> bool:
        """True from the request of maps for changed settings until they are taken or refused."""
        return self._rebuilt is not None

    def refuse(self, vehicle: Vehicle, margin: Margin) -> None:
        """Drops the maps `for_settings`; requests those of the settings in force before any other.

        The planner has the dropped ones, and would make maps of obstacles with their settings.
        """
        self._answer = self._rebuilt = self._asked_s = None
        self._report_first = False
        self.want(vehicle, margin)

    def taken(self, now_s: float) -> NewMaps | None:
        """Returns the maps of an answer, once; reports their obstacles."""
        answer, self._answer = self._answer, None
        if answer is None:
            return None
        self._asked_s, self._taken_s = None, now_s
        rebuilt, self._rebuilt = self._rebuilt, None
        if answer.site_maps is None:
            self._seen = None
            return NewMaps(None, None if rebuilt is None else rebuilt.vehicle)
        self._unmapped_s = None
        if rebuilt is not None and self._site is not None:
            self._site = self._site.flown_with(rebuilt.site.margin)
        for severity, text in self._texts:
            self._reports.send_text(severity, text, now_s, action="avoided")
        self._texts.clear()
        return NewMaps(answer.site_maps, None if rebuilt is None else rebuilt.vehicle)

    def update(self, now_s: float, *, on_ground: bool) -> None:
        """Requests maps when settings or obstacles differ from those of the last request.

        Both take turns, where both wait; plans have the cycle in which maps were taken.
        """
        waits = self._report_first and self._newer_s is not None
        idle = self._asked_s is None and not waits and now_s != self._taken_s
        if self._wanted is not None and self._site is not None and idle:
            self._ask_for_settings(self._wanted, self._site.flown_with(self._wanted_margin), now_s)
            return
        report, before = self.report, self._mapped_report
        if report is None or self._site is None or report is before:
            return
        kept, current = self._obstacles_of(report, on_ground=on_ground)
        seen = (*kept, *current)
        if self._asked_s is not None:
            missing_s = now_s if self._newer_s is None else self._newer_s
            self._newer_s = None if seen == self._seen else missing_s
            return
        newer_s, self._newer_s, self._report_first = self._newer_s, None, False
        self._mapped_report = report
        if before is not None and report.began_s != before.began_s:
            self._reported_m.clear()
        self._before, self._current = kept, current
        if report.health.scan_s is None:
            return
        self._note_places(report)
        if seen == self._seen:
            self._texts.clear()  # of a kept obstacle, which was reported then
            return
        self._seen = seen
        self._job_id += 1
        self._asked_s = now_s
        if self._unmapped_s is None:
            self._unmapped_s = now_s if newer_s is None else newer_s
        self._jobs.append(
            MapJob(
                job_id=self._job_id,
                site=self._site.with_more_obstacles(seen),
                slack_m=self.settings.target_slack_m,
            )
        )
        self._reports.record(
            "seen",
            now_s,
            conductors=[
                {"name": each.name, "x_m": each.position_m[0], "z_m": each.position_m[1]}
                for each in report.conductors
            ],
            solids=[
                {"name": each.name, "vertices_m": [list(vertex) for vertex in each.vertices_m]}
                for each in report.solids
            ],
        )

    def _ask_for_settings(self, vehicle: Vehicle, site: Site, now_s: float) -> None:
        self._wanted, self._asked_s, self._report_first = None, now_s, True
        self._job_id += 1
        self._rebuilt = SettingsJob(
            job_id=self._job_id,
            site=site.with_more_obstacles((*self._before, *self._current)),
            slack_m=self.settings.target_slack_m,
            vehicle=vehicle,
        )
        self._jobs.append(self._rebuilt)

    def _obstacles_of(
        self, report: PerceptionReport, *, on_ground: bool
    ) -> tuple[tuple[Obstacle, ...], tuple[Obstacle, ...]]:
        """Obstacles of ended processes, and those of a report."""
        mapped = self._mapped_report
        kept, current = self._before, self._current
        if mapped is not None and report.began_s != mapped.began_s:
            kept, current = (*kept, *current), ()
        if on_ground:
            kept = ()
        if report.health.scan_s is None:
            # The process has no scan yet: earlier obstacles stay.
            return kept, current
        new = (
            *(item for each in report.conductors for item in self._placed(each, current)),
            *(replace(solid, keep_out_m=self.settings.keep_out_m) for solid in report.solids),
        )
        return kept, tuple(item for item in new if not _is_kept(item, kept))

    def _known(self, seen: SeenConductor) -> tuple[Conductor | None, float]:
        """Conductor of the site file for which a seen one counts, and its distance from there."""
        assert self._site is not None
        known = min(
            self._site.conductors,
            key=lambda item: math.dist(item.position_m, seen.position_m),
            default=None,
        )
        off_m = math.inf if known is None else math.dist(known.position_m, seen.position_m)
        return (known, off_m) if off_m <= self.settings.gate_m else (None, math.inf)

    def _placed(self, seen: SeenConductor, current: tuple[Obstacle, ...]) -> tuple[Obstacle, ...]:
        """Obstacle of a seen conductor; it keeps its place on the maps until it has moved."""
        assert self._site is not None
        mapped = next(
            (item for item in current if item.name == seen.name and isinstance(item, Conductor)),
            None,
        )
        known, off_m = self._known(seen)
        if known is None:
            keep_out_m = self.settings.keep_out_m
        else:
            keep_out_m = known.keep_out_m - self._site.margin.total_m
            if off_m < (_APART_M if mapped is None else _SAME_PLACE_M):
                return ()
        if mapped is not None:
            # A keep-out never shrinks in flight, even if the conductor crosses a limit.
            keep_out_m = max(keep_out_m, mapped.keep_out_m)
            still = math.dist(mapped.position_m, seen.position_m) < _MOVED_M
            if still and mapped.keep_out_m == keep_out_m:
                return (mapped,)
        return (
            Conductor(
                name=seen.name,
                position_m=seen.position_m,
                radius_m=_RADIUS_M,
                keep_out_m=keep_out_m,
            ),
        )

    def _note_places(self, report: PerceptionReport) -> None:
        """Notes texts about conductors that are in no site file, or moved."""
        for seen in report.conductors:
            known, off_m = self._known(seen)
            if known is None:
                self._note_unknown(seen)
            else:
                self._note_moved(known.name, seen.name, off_m)

    def _note_unknown(self, seen: SeenConductor) -> None:
        if ("", seen.name) in self._reported_m:
            return
        self._reported_m["", seen.name] = 0.0
        x_m, z_m = seen.position_m
        number = seen.name.rpartition("-")[2]
        text = pilot_texts.CONDUCTOR_SEEN(wire=number, x_m=coordinate(x_m), z_m=coordinate(z_m))
        self._texts.append((Severity.NOTICE, text))

    def _note_moved(self, name: str, seen: str, off_m: float) -> None:
        reported_m = self._reported_m.get((name, seen))
        if reported_m is None and off_m <= self.settings.moved_m:
            return
        if reported_m is not None and abs(off_m - reported_m) <= self.settings.moved_m:
            return
        self._reported_m[name, seen] = off_m
        text = pilot_texts.CONDUCTOR_MOVED(m=distance(off_m), conductor=name)
        self._texts.append((Severity.WARNING, text))


def _is_kept(item: Obstacle, before: tuple[Obstacle, ...]) -> bool:
    """True if an obstacle of an ended process is at the same place, as wide or wider."""
    return any(
        kept.keep_out_m >= item.keep_out_m
        and (
            math.dist(kept.position_m, item.position_m) < _SAME_PLACE_M
            if isinstance(kept, Conductor) and isinstance(item, Conductor)
            else kept == replace(item, name=kept.name)
        )
        for kept in before
    )
