"""Obstacles that the sensor sees: they join those of the site file, and new maps are asked for.

Inputs: reports of the perception, answers with maps, poses. Outputs: map jobs, notes of poses for
the perception, texts for operators. A seen conductor near one of the site file is that one, at
another place: both places are avoided.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

from .. import pilot_texts
from ..estimation.pose import Jump
from ..estimation.pose_tracker import PoseTracker, SiteMaps
from ..mavlink.session import Severity
from ..perception.perception_report import PerceptionReport, SeenConductor, SensorHealth
from ..perception.pose_notes import AttitudeNote, PointsNote, PoseNote, PositionNote, ShiftNote
from ..perception_config import Perception, Sensor
from ..planning.map_jobs import MapAnswer, MapJob
from ..site import Conductor, Obstacle, Site
from ..telemetry import Proximity, Telemetry
from ..text_format import distance
from .reports import Reports

_SAME_PLACE_M = 0.25
"""A seen conductor that is nearer to its place in the file adds nothing: the margin covers it."""
_MOVED_M = 0.15
"""A conductor that moves less keeps its place on the maps: as far as its place is known."""
_RADIUS_M = 0.02
"""Radius of a seen conductor; the keep-out is far greater."""
_ANSWER_TIMEOUT_S = 2.0
_MOST_NOTES = 200
"""Notes that are kept while nobody takes them: two seconds of poses."""


class SeenObstacles:
    """Keeps the newest report, and the obstacles of the present maps.

    site: of the file, as flown; None without a site.
    """

    def __init__(self, settings: Perception, site: Site | None, reports: Reports) -> None:
        self.settings = settings
        self._site = site
        self._reports = reports
        self.report: PerceptionReport | None = None
        """The newest report; None before the first."""
        self._looked_at: PerceptionReport | None = None
        self._seen: tuple[Obstacle, ...] = ()
        """Seen obstacles that were asked for last, as a file would have them."""
        self._job_id = 0
        self._awaited_s: float | None = None
        """Time of the job that is to be answered; None: no job is."""
        self._jobs: list[MapJob] = []
        self._answer: MapAnswer | None = None
        self._notes: deque[PoseNote] = deque(maxlen=_MOST_NOTES)
        self._noted: tuple[float | None, float | None] = (None, None)
        """Boot times of the last position and attitude that were noted."""
        self._proximity: Proximity | None = None
        self._told_m: dict[str, float] = {}
        """Distance that was told last, by conductor; of an unknown one 0."""

    @property
    def health(self) -> SensorHealth:
        """How the sensor works."""
        return SensorHealth() if self.report is None else self.report.health

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
            self._notes.append(ShiftNote(step_m=jump.step_m))
        position, attitude = telemetry.local_position, telemetry.attitude
        position_boot_s, attitude_boot_s = self._noted
        if tracker.pose is not None and position is not None and position.boot_s != position_boot_s:
            time_s = tracker.received_s(position.boot_s)
            if time_s is not None:
                self._notes.append(PositionNote(time_s=time_s, position_m=tracker.pose.position_m))
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

    def taken(self) -> SiteMaps | None:
        """Returns the maps of an answer, once."""
        answer, self._answer = self._answer, None
        if answer is None:
            return None
        self._awaited_s = None
        if answer.site_maps is None:
            self._seen = ()  # asked for again with the next report
        return answer.site_maps

    def look(self, now_s: float) -> None:
        """Tells what is new, and asks for maps where the obstacles are others."""
        report = self.report
        if self._awaited_s is not None and now_s - self._awaited_s > _ANSWER_TIMEOUT_S:
            self._awaited_s = None
            self._seen = ()
        if report is None or self._site is None or report is self._looked_at:
            return
        if self._awaited_s is not None:
            return
        self._looked_at = report
        seen = (
            *(item for each in report.conductors for item in self._placed(each, now_s)),
            *(replace(solid, keep_out_m=self.settings.keep_out_m) for solid in report.solids),
        )
        if seen == self._seen:
            return
        self._seen = seen
        self._job_id += 1
        self._awaited_s = now_s
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

    def _placed(self, seen: SeenConductor, now_s: float) -> tuple[Obstacle, ...]:
        """The obstacle of a seen conductor, at the place of the maps until it has moved from it."""
        assert self._site is not None
        known = min(
            (item for item in self._site.obstacles if isinstance(item, Conductor)),
            key=lambda item: math.dist(item.position_m, seen.position_m),
            default=None,
        )
        off_m = math.inf if known is None else math.dist(known.position_m, seen.position_m)
        if known is None or off_m > self.settings.gate_m:
            keep_out_m = self.settings.keep_out_m
            self._tell_unknown(seen, now_s)
        else:
            keep_out_m = known.keep_out_m - self._site.margin.total_m
            self._tell_moved(known.name, off_m, now_s)
            if off_m < _SAME_PLACE_M:
                return ()
        for before in self._seen:
            if before.name == seen.name and isinstance(before, Conductor):
                still = math.dist(before.position_m, seen.position_m) < _MOVED_M
                if still and before.keep_out_m == keep_out_m:
                    return (before,)
        return (
            Conductor(
                name=seen.name,
                position_m=seen.position_m,
                radius_m=_RADIUS_M,
                keep_out_m=keep_out_m,
            ),
        )

    def _tell_unknown(self, seen: SeenConductor, now_s: float) -> None:
        if seen.name in self._told_m:
            return
        self._told_m[seen.name] = 0.0
        x_m, z_m = seen.position_m
        number = seen.name.rpartition("-")[2]
        text = pilot_texts.CONDUCTOR_SEEN(wire=number, x_m=f"{x_m:.1f}", z_m=f"{z_m:.1f}")
        self._reports.say(Severity.NOTICE, text, now_s, action="avoided")

    def _tell_moved(self, name: str, off_m: float, now_s: float) -> None:
        before_m = self._told_m.get(name)
        if before_m is None and off_m <= self.settings.moved_m:
            return
        if before_m is not None and abs(off_m - before_m) <= self.settings.moved_m:
            return
        self._told_m[name] = off_m
        text = pilot_texts.CONDUCTOR_MOVED(m=distance(off_m), obstacle=name)
        self._reports.say(Severity.WARNING, text, now_s, action="avoided")
