"""Live perception: packets and poses in, a report of conductors and obstacles out.

Inputs: data packets of a lidar or measured points, positions and attitudes, each with its time.
Output: `PerceptionReport`. No clock, no I/O: the same inputs give the same reports.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from typing import Protocol

import numpy as np
import numpy.typing as npt

from ..planner.site import PlanePoint, Site
from ..settings.perception_config import Perception, Sensor, SensorMount
from ..types import Vector
from .conductor_tracks import ConductorTracks
from .ground import ground_height_m
from .lidar_scan import PacketFault, Scan
from .line_offset import LineTracker
from .occupancy import Occupancy
from .ouster import OusterStream
from .perception_report import PerceptionReport, SensorHealth
from .plane_rays import PlaneRays
from .scan_conductors import narrow_echoes, sightings
from .scan_frame import PoseHistory, attitude_in_site, points_in_site
from .velodyne import VelodyneStream

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

_LATE_S = 0.3
"""Longest wait of a scan for its poses; after it the scan is dropped."""
_LONGEST_SCAN_S, _AHEAD_S = 0.5, 0.1
"""Greatest duration of a scan, and greatest time of its last point after its arrival. Beyond them
the sensor's clock has stepped."""
_MOST_SCANS = 16
"""Greatest number of scans that wait for poses; the oldest is dropped."""
_SILENT_S = 0.5
"""Time without a packet that was taken, or refused, after which there are none."""
_REPORT_S = 0.2
"""Longest time between reports, which carry the sensor's health."""
_HULL_M = 1.0
"""Least range; nearer echoes are of the hull, or of a cover."""
_SCAN_SECTORS, _POINT_SECTORS = 720, 72
"""Directions of 0.5° for a scan, and of 5° for points, as in OBSTACLE_DISTANCE."""
_SET_S = 0.1
"""Time over which single points are collected to one set."""
_REACH_M = 40.0
"""Greatest range of an obstacle; few points are farther, on the ground too."""
_GROUND_CLEAR_M = 0.7
"""Height above the ground up to which a point is of the ground, or lies on it."""
_GROUND_COLUMNS, _COLUMN_M = 8, 2.0
"""Least number of columns with lowest points that are ground; a beam in the air is shorter."""
_RELEASED_M = 0.3
_MOVED_M = 0.3
"""Change of the offset from match to match that no drift between two scans explains."""
_OFTEN = 30
"""Number of sightings after which the place of a wire is learned: three seconds, in which the error
of the attitude after a turn passes. A real PX4's was 3 degrees."""
_AIRCRAFT = SensorMount(roll_pitch_yaw_deg=(0.0, 0.0, 0.0))
_ACROSS = np.array([0.0, 1.0, 0.0])


class PacketStream(Protocol):
    """Packets of one sensor, in order of arrival."""

    packets: int
    refused: Counter[PacketFault]
    """Number of packets that were left out, by reason."""

    def receive(self, packet: bytes, now_s: float) -> Scan | None:
        """Takes a packet; returns the scan that it completes, if any."""


def packet_stream(settings: Perception, description: str) -> PacketStream | None:
    """Stream of the configured sensor; None if the sensor sends no packets of its own.

    description: content of the sensor's metadata file.
    """
    if settings.sensor is Sensor.VELODYNE:
        return VelodyneStream()
    if settings.sensor is Sensor.OUSTER:
        return OusterStream(description)
    return None


class LivePerception:
    """Perception of one sensor on one aircraft at one site.

    late: number of scans and sets that were dropped for lack of poses, or of possible times.
    """

    def __init__(self, settings: Perception, site: Site, description: str = "") -> None:
        """description: content of the sensor's metadata file."""
        self._settings = settings
        self._azimuth_deg = site.frame.azimuth_deg
        self._stream = packet_stream(settings, description)
        self._poses = PoseHistory()
        self._line = LineTracker(item.position_m for item in site.conductors)
        self._placed_m: PlanePoint = (0.0, 0.0)
        """Offset with which tracks and cells are placed."""
        self._matched_s = -math.inf
        """Time of the last scan that has shown the offset."""
        self._moved_m: PlanePoint = (0.0, 0.0)
        """Sum of the moves of tracks and cells since then, with an estimate that is followed."""
        self._tracks = ConductorTracks()
        self._occupancy = Occupancy(site)
        self._random = np.random.default_rng(0)
        self._scans: deque[Scan] = deque(maxlen=_MOST_SCANS)
        self._points: list[tuple[float, FloatArray]] = []
        self._received_s: float | None = None
        self._refused_s: float | None = None
        self._refused: Counter[PacketFault] = Counter()
        """Packets that were left out when the newest one was taken, by reason."""
        self._scan_s: float | None = None
        self._returns = 0.0
        self._reported_s = -math.inf
        self._began_s: float | None = None
        self._jumped_m: Vector | None = None
        self.late = 0

    def note_position(
        self,
        time_s: float,
        position_m: Vector,
        jumped_m: Vector = (0.0, 0.0, 0.0),
        offset_m: PlanePoint = (0.0, 0.0),
    ) -> None:
        """Position in the site's frame at a time. jumped_m: sum of the estimate's jumps so far.

        offset_m: of the line's frame as it is flown with.
        """
        if self._jumped_m is None:
            self._jumped_m = jumped_m
        if jumped_m != self._jumped_m:
            x_m, y_m, z_m = (
                now - before for now, before in zip(jumped_m, self._jumped_m, strict=True)
            )
            self._jumped_m = jumped_m
            self.shift((x_m, y_m, z_m))
        self._line.place(offset_m)
        self._poses.note_position(time_s, position_m)

    def note_attitude(
        self, time_s: float, roll_rad: float, pitch_rad: float, yaw_rad: float
    ) -> None:
        """Attitude of the body (forward, right, down) in north, east, down: MAVLink's ATTITUDE."""
        attitude = attitude_in_site(roll_rad, pitch_rad, yaw_rad, self._azimuth_deg)
        self._poses.note_attitude(time_s, attitude)

    def shift(self, step_m: Vector) -> None:
        """Takes a jump of the position estimate: what was seen keeps its distance.

        In the line's frame, while its offset is known, nothing moves.
        """
        self._poses.shift(step_m)
        if self._line.is_known:
            self._line.shift(step_m)
            self._placed_m = (self._placed_m[0] - step_m[0], self._placed_m[1] - step_m[2])
            step_m = (0.0, step_m[1], 0.0)
        self._move(step_m)

    def _move(self, step_m: Vector) -> None:
        """Moves tracks and cells with the estimate, while no line shows the offset."""
        self._moved_m = self._moved_m[0] + step_m[0], self._moved_m[1] + step_m[2]
        self._tracks.shift(step_m)
        self._occupancy.shift(step_m[0], step_m[2])

    def _to_line(self) -> FloatArray:
        """Step (3,) from places by the estimate to the line's frame.

        After a gap in which the estimate has drifted or jumped, what was seen in the gap moves with
        the offset. What was last seen before it returns to where the line had it.
        """
        (x_m, z_m), before_m = self._line.offset_m, self._placed_m
        step_m = x_m - before_m[0], 0.0, z_m - before_m[1]
        matched_s, gap_from_s = self._line.seen_s, self._matched_s
        if matched_s is None:
            if any(step_m):
                self._move(step_m)
        elif matched_s != gap_from_s:
            first = not math.isfinite(gap_from_s)
            if first or any(self._moved_m) or math.hypot(*step_m) > _MOVED_M:
                back_m = -self._moved_m[0], 0.0, -self._moved_m[1]
                self._tracks.shift(back_m, until_s=gap_from_s)
                self._tracks.shift(step_m, after_s=gap_from_s)
                self._tracks.join(until_s=gap_from_s)
                self._occupancy.shift(step_m[0], step_m[2])
            self._matched_s, self._moved_m = matched_s, (0.0, 0.0)
        self._placed_m = x_m, z_m
        return np.array([x_m, 0.0, z_m])

    def receive(self, packet: bytes, now_s: float) -> None:
        """Takes a data packet of the sensor."""
        if self._stream is None:
            return
        packets = self._stream.packets
        scan = self._stream.receive(packet, now_s)
        if self._stream.packets > packets:
            self._received_s = now_s
            self._refused = self._stream.refused.copy()
        else:
            self._refused_s = now_s
        if scan is None:
            return
        if not len(scan.points_m):
            self._scan_s, self._returns = now_s, 0.0
        elif np.ptp(scan.time_s) > _LONGEST_SCAN_S or scan.time_s.max() > now_s + _AHEAD_S:
            self.late += 1
        else:
            self.late += len(self._scans) == _MOST_SCANS
            self._scans.append(scan)

    def note_points(self, points_m: npt.ArrayLike, time_s: float) -> None:
        """Takes points (n, 3) on obstacles, in the aircraft's frame (x forward, y left, z up).

        A message without a distance within its range is an empty set.
        """
        self._points.append((time_s, np.asarray(points_m, float).reshape(-1, 3)))
        if self._settings.sensor is Sensor.MAVLINK:
            self._received_s = time_s

    def step(self, now_s: float) -> PerceptionReport | None:
        """Processes what is due; returns a report after a scan or set, or after 0.2 s."""
        processed = self._take_scans(now_s)
        processed = self._take_points(now_s) or processed
        if not processed and now_s - self._reported_s < _REPORT_S:
            return None
        self._reported_s = now_s
        if self._began_s is None:
            self._began_s = now_s
        return PerceptionReport(
            time_s=now_s,
            began_s=self._began_s,
            health=SensorHealth(
                scan_s=self._scan_s,
                received_s=self._received_s,
                returns=self._returns,
                refused=0 if self._stream is None else sum(self._stream.refused.values()),
                late=self.late,
                refusal=self._refusal(now_s),
            ),
            conductors=self._tracks.conductors,
            solids=self._occupancy.polygons,
            line=self._line.report(now_s, self._jumped_m or (0.0, 0.0, 0.0)),
        )

    def _refusal(self, now_s: float) -> PacketFault | None:
        """Most frequent reason of refused packets, if no others arrive."""
        if self._stream is None or self._refused_s is None or now_s - self._refused_s > _SILENT_S:
            return None
        if self._received_s is not None and now_s - self._received_s <= _SILENT_S:
            return None
        ((fault, _),) = (self._stream.refused - self._refused).most_common(1)
        return fault

    def _take_scans(self, now_s: float) -> bool:
        processed = False
        while self._scans:
            last_s = float(self._scans[0].time_s.max())
            if self._poses.until_s < last_s and now_s - last_s <= _LATE_S:
                break
            if self._take(self._scans.popleft(), last_s):
                processed = True
            else:
                self.late += 1
        return processed

    def _take(self, scan: Scan, time_s: float) -> bool:
        """Processes one scan, once poses reach its times."""
        placed = points_in_site(scan.points_m, scan.time_s, self._poses, self._settings.mount)
        if placed is None:
            return False
        points, sensors = placed
        sensor = sensors.mean(axis=0)
        distance = np.sqrt(np.einsum("ij,ij->i", scan.points_m, scan.points_m))
        outside = distance > _HULL_M
        near = outside & (distance < _REACH_M)
        self._scan_s = time_s
        self._returns = min(float(outside.sum()) / max(scan.beams, 1), 1.0)
        echoes, ring = narrow_echoes(points, sensors, scan.ring, scan.time_s)
        axis = self._line.axis if self._settings.fly_by_line else _ACROSS
        found = sightings(echoes, ring, sensor, axis, self._random)
        if self._settings.fly_by_line:
            self._line.step(found, sensor, time_s)
        step = self._to_line()
        points = self._line.placed(points, sensors)
        found = [self._line.placed_sighting(each, sensor) for each in found]
        rays = PlaneRays.of(points, sensor + step, _SCAN_SECTORS)
        known = {conductor.name for conductor in self._tracks.conductors}
        self._tracks.step(found, time_s, rays, scan.ring)
        new = [each.position_m for each in self._tracks.conductors if each.name not in known]
        # Earlier scans counted its first echoes as a solid obstacle.
        self._occupancy.release(new, _RELEASED_M)
        solid = near & ~_ground(points, distance) & ~self._tracks.own(points, time_s)
        self._occupancy.add(rays, points, solid, time_s, beams=scan.beams, echoes=2)
        often = [each for each in self._tracks.conductors if each.sightings >= _OFTEN]
        if often and self._settings.fly_by_line:
            self._line.learn((each.position_m for each in often), time_s)
        return True

    def _take_points(self, now_s: float) -> bool:
        if not self._points:
            return False
        first_s, last_s = self._points[0][0], self._points[-1][0]
        if now_s - first_s < _SET_S or (self._poses.until_s < last_s and now_s - last_s <= _LATE_S):
            return False
        points = np.concatenate([each for _, each in self._points])
        times = np.concatenate([np.full(len(each), time_s) for time_s, each in self._points])
        self._points = []
        if len(points) and not self._take_set(points, times):
            self.late += 1
            return False
        if self._settings.sensor is Sensor.MAVLINK:
            self._scan_s, self._returns = last_s, 1.0
        return True

    def _take_set(self, points_m: FloatArray, times_s: FloatArray) -> bool:
        """Processes one set of points in the aircraft's frame, once poses reach its times."""
        placed = points_in_site(points_m, times_s, self._poses, _AIRCRAFT)
        if placed is None:
            return False
        points, sensors = self._line.placed(*placed), placed[1] + self._to_line()
        distance = np.sqrt(((points - sensors) ** 2).sum(axis=1))
        near = (distance > _HULL_M) & (distance < _REACH_M)
        solid = near & ~_ground(points, distance) & ~self._tracks.own(points, math.nan)
        rays = PlaneRays.of(points, sensors.mean(axis=0), _POINT_SECTORS)
        self._occupancy.add(rays, points, solid, float(times_s.max()))
        return True


def _ground(points_m: FloatArray, distance_m: FloatArray) -> BoolArray:
    """Points (n, 3) of the ground; none where the lowest points are no ground.

    The aircraft's height error is too great for a comparison with the height of the site's ground.
    """
    ground = np.zeros(len(points_m), dtype=bool)
    near = np.flatnonzero(distance_m < _REACH_M)
    if not len(near):
        return ground
    points = points_m[near].copy()
    index = ((points[:, 0] - points[:, 0].min()) / _COLUMN_M).astype(np.intp)
    lowest = np.full(index.max() + 1, np.inf)
    np.minimum.at(lowest, index, points[:, 2])
    column = np.flatnonzero(np.isfinite(lowest))
    if len(column) < _GROUND_COLUMNS:
        return ground
    lowest = lowest[column]
    # The median slope between columns is used; a ground filter lowers the upper end of a slope.
    left, right = np.triu_indices(len(column), 1)
    slopes = (lowest[right] - lowest[left]) / (column[right] - column[left])
    points[:, 2] -= float(np.median(slopes)) / _COLUMN_M * points[:, 0]
    low = points[:, 2] - ground_height_m(points) < _GROUND_CLEAR_M
    ground[near[low]] = np.count_nonzero(np.bincount(index[low])) >= _GROUND_COLUMNS
    return ground
