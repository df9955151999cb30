"""A site: workspace, obstacles, start, targets and landing points in one vertical plane.

`Site.load(path)` reads a YAML file, described in `configs/reference.md`; positions are `(x, z)` in
metres in the plane.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from os import PathLike, fspath
from typing import Annotated, Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import AfterValidator, Field

from ..errors import InputError
from ..settings import yaml_file
from ..settings.yaml_file import FileFinding
from ..settings.yaml_schema import Coordinate, FileModel, Interval, Length, Name, PositiveLength
from ..types import GeodeticPoint, Mission
from . import ground_profile
from .site_frame import SiteFrame

PlanePoint = tuple[float, float]

DEFAULT_DWELL_S = 5.0
"""Default dwell of a target without views: time for a few pictures of a splice."""
_AIM_S, _PICTURE_S = 4.0, 2.0
"""Expected times until camera and aircraft are at rest, and from a picture to its confirmation."""
MAX_CELLS = 4_000_000
"""Most cells of a plane: limits the memory of the precomputed maps on a companion computer."""
_COUNTLESS = 1e18
"""Keeps the number of cells of a resolution near zero an integer."""
GROUND = "ground"
"""Name of the ground in texts, as that of an obstacle."""
MAX_VERTICES = 2_000
"""Vertices of one polygon: its outline is checked pair by pair."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Workspace:
    """The rectangle of plans: lower and upper corner, cell size, least altitude, ground."""

    lower_m: PlanePoint
    upper_m: PlanePoint
    resolution_m: float
    min_altitude_m: float | None = None
    """Least height of planned paths above the ground; None: the workspace alone limits them."""
    ground_m: tuple[PlanePoint, ...] = ()
    """Profile of the ground, x rising, all along the workspace; empty: level, at z = 0."""

    def floor_m(self, x_m: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Least z of planned paths at x (...); -inf without a minimum altitude.

        Above a profile it keeps the minimum altitude to the side, too.
        """
        if self.min_altitude_m is None:
            return np.full(np.shape(x_m), -np.inf)
        if not self.ground_m:
            return np.full(np.shape(x_m), self.min_altitude_m)
        return ground_profile.floor_m(self.ground_m, self.min_altitude_m, x_m)

    def floor_at_m(self, x_m: float) -> float | None:
        """Least z of planned paths at one x; None without a minimum altitude."""
        return None if self.min_altitude_m is None else float(self.floor_m(x_m))

    def ground_at_m(self, x_m: float) -> float:
        """Height of the ground at one x."""
        return float(ground_profile.height_m(self.ground_m, x_m)) if self.ground_m else 0.0

    @property
    def shape(self) -> tuple[int, int]:
        """Cells along x and z; a remainder that holds no whole cell is not workspace."""
        return (
            _cells(self.upper_m[0] - self.lower_m[0], self.resolution_m),
            _cells(self.upper_m[1] - self.lower_m[1], self.resolution_m),
        )

    def outside_m(self, point_m: PlanePoint) -> float:
        """Distance of a point outside; 0 inside."""
        ends = zip(point_m, self.lower_m, self.upper_m, strict=True)
        return math.hypot(*(max(low - at, at - high, 0.0) for at, low, high in ends))


@dataclass(frozen=True, slots=True, kw_only=True)
class Conductor:
    """A conductor that crosses the plane: a disc."""

    name: str
    position_m: PlanePoint
    radius_m: float
    keep_out_m: float = 0.0

    @property
    def outline_m(self) -> tuple[PlanePoint, ...]:
        """The centre: its surface is radius_m around the outline."""
        return (self.position_m,)

    def moved(self, x_m: float, z_m: float) -> Conductor:
        """The same conductor elsewhere."""
        return replace(self, position_m=(self.position_m[0] + x_m, self.position_m[1] + z_m))


@dataclass(frozen=True, slots=True, kw_only=True)
class Polygon:
    """A filled shape in the plane: at least three vertices, simple outline."""

    name: str
    vertices_m: tuple[PlanePoint, ...]
    keep_out_m: float = 0.0

    @property
    def outline_m(self) -> tuple[PlanePoint, ...]:
        """The vertices, of which the outline is the loop."""
        return self.vertices_m

    @property
    def radius_m(self) -> float:
        """0: its surface is the outline itself."""
        return 0.0

    def moved(self, x_m: float, z_m: float) -> Polygon:
        """The same shape elsewhere."""
        return replace(self, vertices_m=tuple((x + x_m, z + z_m) for x, z in self.vertices_m))


Obstacle = Conductor | Polygon


@dataclass(frozen=True, slots=True, kw_only=True)
class TargetView:
    """Pictures or video of a target from one place.

    target: name of the target. number: of the view among the target's, from 1. aim_m: the point
    that the camera aims at. zoom_percent: of the camera's range; None: as it is.
    """

    target: str
    number: int
    aim_m: PlanePoint
    pictures: int
    video_s: float
    zoom_percent: float | None = None

    @property
    def duration_s(self) -> float:
        """Expected duration: to aim and to settle, of each picture, and of the video."""
        return _AIM_S + self.pictures * _PICTURE_S + self.video_s


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """A place of inspection: a target without views, or one view of a target.

    look_at_m: the point that the vehicle faces, if known; of a view, its aim.
    """

    name: str
    """Of the target; of a view with its number, as `splice-1/2`."""
    position_m: PlanePoint
    dwell_s: float
    """Least time at the place."""
    yaw_deg: float | None = None
    look_at_m: PlanePoint | None = None
    view: TargetView | None = None

    @property
    def target_name(self) -> str:
        """Name of the target in the site file."""
        return self.name if self.view is None else self.view.target

    @property
    def hold_s(self) -> float:
        """Expected time at the place."""
        return self.dwell_s if self.view is None else max(self.dwell_s, self.view.duration_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class Margin:
    """Errors of an aircraft's position and of its tracking.

    position_m: from the true position to the reported one. tracking_m: from there to the setpoint.
    """

    position_m: float = 0.0
    tracking_m: float = 0.0

    @property
    def total_m(self) -> float:
        """From the true position to the setpoint. The same wind causes both: they add up."""
        return self.position_m + self.tracking_m

    def __str__(self) -> str:
        return f"position error {self.position_m:g} m, tracking error {self.tracking_m:g} m"


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameShift:
    """A displacement of a site's frame in the world, which its origin contains already."""

    north_m: float = 0.0
    east_m: float = 0.0
    up_m: float = 0.0
    reason: str
    date: str
    """ISO 8601, as 2026-05-31."""

    def __str__(self) -> str:
        parts = ((self.north_m, "NS"), (self.east_m, "EW"), (self.up_m, ("up", "down")))
        moved = ", ".join(
            f"{abs(value_m):g} m {words[value_m < 0.0]}" for value_m, words in parts if value_m
        )
        return f"{moved} on {self.date}: {self.reason}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Site:
    """A site as planned and flown; arrays of it are built by the planner."""

    name: str
    frame: SiteFrame
    workspace: Workspace
    obstacles: tuple[Obstacle, ...]
    start_m: PlanePoint
    targets: tuple[Target, ...]
    """Places of the targets and of their views, in file order."""
    landing_m: Mapping[Mission, tuple[PlanePoint, ...]]
    """Landing points of the exit and of the evacuation; a mission without any is absent."""
    margin: Margin = Margin()
    """Part of its keep-outs beyond those of the file; zero where the site is only planned."""
    shifts: tuple[FrameShift, ...] = ()
    """Displacements of its frame so far: a record, the frame has them already."""

    @property
    def conductors(self) -> tuple[Conductor, ...]:
        """Its conductors, without the other obstacles."""
        return tuple(item for item in self.obstacles if isinstance(item, Conductor))

    @property
    def target_names(self) -> tuple[str, ...]:
        """Names of the targets, in file order: orders count them from 0."""
        return tuple(dict.fromkeys(target.target_name for target in self.targets))

    def stops_of(self, name: str) -> tuple[str, ...]:
        """Names of the places of one target, in file order."""
        return tuple(item.name for item in self.targets if item.target_name == name)

    @property
    def ground(self) -> Polygon | None:
        """The ground as a filled shape, where it has a profile; its keep-out: minimum altitude."""
        space = self.workspace
        if not space.ground_m or space.min_altitude_m is None:
            return None
        outline_m = ground_profile.outline_m(space.ground_m)
        return Polygon(name=GROUND, vertices_m=outline_m, keep_out_m=space.min_altitude_m)

    @property
    def barriers(self) -> tuple[Obstacle, ...]:
        """Its obstacles, and the ground as the last where it has a profile."""
        ground = self.ground
        return self.obstacles if ground is None else (*self.obstacles, ground)

    def target(self, name: str | int | None) -> Target:
        """The place of this name; of a target with views the first. None: the site's first.

        Raises InputError without it.
        """
        for target in self.targets:
            if name is None or name in (target.name, target.target_name):
                return target
        known = ", ".join(target.name for target in self.targets) or "none"
        raise InputError(self.name, "targets", f"no target {name!r}; the site has: {known}")

    def flown_with(self, margin: Margin) -> Site:
        """The site as it is flown: every keep-out has this margin, in place of the one before."""
        more_m = margin.total_m - self.margin.total_m
        obstacles = (replace(item, keep_out_m=item.keep_out_m + more_m) for item in self.obstacles)
        return replace(self, margin=margin, obstacles=tuple(obstacles))

    def with_obstacles(self, obstacles: tuple[Obstacle, ...]) -> Site:
        """The site with other obstacles, as a file has them: the margin is added to each."""
        return replace(self, obstacles=self._kept_clear(obstacles))

    def with_more_obstacles(self, obstacles: tuple[Obstacle, ...]) -> Site:
        """The site with further obstacles, as a file has them: the margin is added to those."""
        return replace(self, obstacles=(*self.obstacles, *self._kept_clear(obstacles)))

    def _kept_clear(self, obstacles: tuple[Obstacle, ...]) -> tuple[Obstacle, ...]:
        return tuple(
            replace(item, keep_out_m=item.keep_out_m + self.margin.total_m) for item in obstacles
        )

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Site:
        """The site in a YAML file; raises InputError with one line when it cannot be used."""
        return cls.of_text(yaml_file.text_of(path), fspath(path))

    @classmethod
    def of_text(cls, text: str, source: str) -> Site:
        """The site in the text of a YAML file; raises InputError as `load`."""
        return cls.of_file(yaml_file.parsed(text, source, SiteFile, _findings))

    @classmethod
    def of_document(cls, document: Any, source: str) -> Site:
        """The site of a file's content as a mapping; raises InputError as `load`."""
        return cls.of_file(yaml_file.accepted(document, source, SiteFile, _findings))

    @classmethod
    def of_file(cls, file: SiteFile) -> Site:
        """The site that a file describes."""
        origin = file.frame.origin
        workspace = file.workspace
        obstacles = tuple(
            shape.obstacle() for entry in file.obstacles for shape in entry.shapes().values()
        )
        conductors = {item.name: item for item in obstacles if isinstance(item, Conductor)}
        landing = {
            Mission.EXIT: file.landing.exit,
            Mission.EVACUATION: file.landing.evacuation,
        }
        return cls(
            name=file.name,
            frame=SiteFrame(
                origin=GeodeticPoint(
                    latitude_deg=origin.latitude_deg,
                    longitude_deg=origin.longitude_deg,
                    altitude_amsl_m=origin.altitude_amsl_m,
                ),
                azimuth_deg=file.frame.azimuth_deg,
            ),
            workspace=Workspace(
                lower_m=(workspace.x_m[0], workspace.z_m[0]),
                upper_m=(workspace.x_m[1], workspace.z_m[1]),
                resolution_m=workspace.resolution_m,
                min_altitude_m=workspace.min_altitude_m,
                ground_m=tuple((x_m, z_m) for x_m, z_m in file.ground or ()),
            ),
            obstacles=obstacles,
            start_m=file.start.position_m,
            targets=tuple(
                place
                for name, target in file.targets.items()
                for place in target.places(name, conductors)
            ),
            landing_m={
                mission: tuple(point.position_m for point in points)
                for mission, points in landing.items()
                if points
            },
            shifts=tuple(FrameShift(**shift.model_dump()) for shift in file.frame.shifts),
        )


MAX_SHIFT_M = 100.0
"""Greatest displacement of a shift along each axis: a base station stands near its site."""
_Shift = Annotated[float, Field(ge=-MAX_SHIFT_M, le=MAX_SHIFT_M)]


def _cells(extent_m: float, resolution_m: float) -> int:
    return max(1, math.floor(min(extent_m / resolution_m + 1e-9, _COUNTLESS)))


class _PointFile(FileModel):
    x_m: Coordinate
    """Along the azimuth."""
    z_m: Coordinate
    """Up."""

    @property
    def position_m(self) -> PlanePoint:
        return self.x_m, self.z_m


class _OriginFile(FileModel):
    latitude_deg: Annotated[float, Field(ge=-90.0, le=90.0)]
    """WGS84, where x = 0, z = 0."""
    longitude_deg: Annotated[float, Field(ge=-180.0, le=180.0)]
    """WGS84, there."""
    altitude_amsl_m: Annotated[float, Field(ge=-1_000.0, le=10_000.0)]
    """Height above mean sea level of z = 0."""


def _day(text: str) -> str:
    if not re.fullmatch(r"\d{4}-(0[1-9]|1[0-2])-(0[1-9]|[12]\d|3[01])", text, re.ASCII):
        raise ValueError("must be a day, as 2026-05-31")
    return text


class _ShiftFile(FileModel):
    north_m: _Shift = 0.0
    """Displacement to the north."""
    east_m: _Shift = 0.0
    """Displacement to the east."""
    up_m: _Shift = 0.0
    """Displacement up."""
    reason: Name
    """Reason of the shift, for people."""
    date: Annotated[Name, AfterValidator(_day)]
    """Day of the shift, as 2026-05-31."""


class _FrameFile(FileModel):
    origin: _OriginFile
    azimuth_deg: Annotated[float, Field(ge=0.0, le=360.0)]
    """Compass direction of +x."""
    shifts: list[_ShiftFile] = Field(default_factory=list)
    """Record of the shifts by `site shift`; the origin contains them already."""


class _WorkspaceFile(FileModel):
    x_m: Interval
    """`[low, high]` of the area of plans along the azimuth, low < high."""
    z_m: Interval
    """The same, up."""
    resolution_m: PositiveLength
    """Edge of a cell: 4,000,000 cells at most."""
    min_altitude_m: Coordinate | None = None
    """Least height of a plan above the ground: above z = 0, or above the profile `ground`, to the
    side of it, too; none: the lower edge of the workspace."""


class _ConductorFile(FileModel):
    name: Name
    """Its name, which no other obstacle has."""
    x_m: Coordinate
    """Its centre, along the azimuth."""
    z_m: Coordinate
    """Its centre, up."""
    radius_m: PositiveLength
    """Radius of the conductor."""
    keep_out_m: Length = 0.0
    """Further distance to keep: approach distance, sway, sag; the flight's own errors are the
    margin's."""

    def obstacle(self) -> Conductor:
        return Conductor(
            name=self.name,
            position_m=(self.x_m, self.z_m),
            radius_m=self.radius_m,
            keep_out_m=self.keep_out_m,
        )


class _PolygonFile(FileModel):
    name: Name
    """Its name, which no other obstacle has."""
    vertices_m: Annotated[list[Interval], Field(min_length=3, max_length=MAX_VERTICES)]
    """Corners `[x, z]` of a simple outline, filled, not closed by a repeated corner."""
    keep_out_m: Length = 0.0
    """Further distance to keep, as of a conductor."""

    def obstacle(self) -> Polygon:
        return Polygon(
            name=self.name,
            vertices_m=tuple((x_m, z_m) for x_m, z_m in self.vertices_m),
            keep_out_m=self.keep_out_m,
        )


class _ObstacleFile(FileModel):
    """Either a conductor or a polygon."""

    conductor: _ConductorFile | None = None
    polygon: _PolygonFile | None = None

    def shapes(self) -> dict[str, _ConductorFile | _PolygonFile]:
        both = {"conductor": self.conductor, "polygon": self.polygon}
        return {key: shape for key, shape in both.items() if shape is not None}


_Side = Literal["left", "right", "above", "below"]


class _ViewFile(FileModel):
    """Coordinates, or a distance and a side of the target's conductor or point, or of another."""

    x_m: Coordinate | None = None
    """Place of the view, along the azimuth; or the keys of a place beside the target."""
    z_m: Coordinate | None = None
    """Place of the view, up."""
    conductor: Name | None = None
    """Name of the conductor; none: the target's conductor, or its point."""
    standoff_m: PositiveLength | None = None
    """Distance from its surface, or from the point."""
    side: _Side | None = None
    """Side of it; left is towards -x."""
    aim: _PointFile | None = None
    """Point in the plane that the camera aims at; none: the conductor or point."""
    pictures: Annotated[int, Field(ge=0, le=1_000)] | None = None
    """Number of pictures; none: 1, with `video_s` 0."""
    video_s: Annotated[float, Field(ge=0.0, le=3_600.0)] = 0.0
    """Duration of a video; 0: none."""
    zoom_percent: Annotated[float, Field(ge=0.0, le=100.0)] | None = None
    """Zoom in its range, 0 is wide; none: as the camera stands."""

    @property
    def count(self) -> int:
        """Number of pictures."""
        return int(not self.video_s) if self.pictures is None else self.pictures


class _TargetFile(FileModel):
    """Coordinates, or a conductor with a distance from its surface and a side; or views."""

    x_m: Coordinate | None = None
    """Place of the inspection, along the azimuth; or the keys of a place beside a conductor. With
    views the point that they show."""
    z_m: Coordinate | None = None
    """Place of the inspection, or that point, up."""
    conductor: Name | None = None
    """Name of the inspected conductor."""
    standoff_m: PositiveLength | None = None
    """Distance from its surface; with views, each has its own."""
    side: _Side | None = None
    """Side of it; left is towards -x. With views, each has its own."""
    dwell_s: Annotated[float, Field(ge=0.0, le=86_400.0)] | None = None
    """Least hold time there; none: 5, with views until each view is captured."""
    yaw_deg: Annotated[float, Field(ge=-180.0, le=360.0)] | None = None
    """Compass heading there; none: by the vehicle's `guidance.yaw_mode`."""
    views: Annotated[list[_ViewFile], Field(min_length=1, max_length=100)] | None = None
    """Views of the target, each a place with what is captured there; the place of a target with
    views is `conductor`, or `x_m` and `z_m`. None: the aircraft holds at the target."""

    def places(self, name: str, conductors: Mapping[str, Conductor]) -> Iterator[Target]:
        """The target, or each of its views; the keys are checked."""
        inspected = None if self.conductor is None else conductors[self.conductor]
        if self.views is None:
            dwell_s = DEFAULT_DWELL_S if self.dwell_s is None else self.dwell_s
            yield Target(
                name=name,
                position_m=_place(self, inspected),
                dwell_s=dwell_s,
                yaw_deg=self.yaw_deg,
                look_at_m=None if inspected is None else inspected.position_m,
            )
            return
        inspected = inspected or Conductor(name=name, position_m=_point(self), radius_m=0.0)
        for number, view in enumerate(self.views, start=1):
            centre = inspected if view.conductor is None else conductors[view.conductor]
            aim_m = centre.position_m if view.aim is None else view.aim.position_m
            yield Target(
                name=view_name(name, number),
                position_m=_place(view, centre),
                dwell_s=self.dwell_s or 0.0,
                yaw_deg=self.yaw_deg,
                look_at_m=aim_m,
                view=TargetView(
                    target=name,
                    number=number,
                    aim_m=aim_m,
                    pictures=view.count,
                    video_s=view.video_s,
                    zoom_percent=view.zoom_percent,
                ),
            )


def view_name(target: str, number: int) -> str:
    """Name of the place of a view."""
    return f"{target}/{number}"


def _place(keys: _TargetFile | _ViewFile, beside: Conductor | None) -> PlanePoint:
    """The place that keys give, by coordinates or beside a conductor."""
    if keys.x_m is not None:
        return _point(keys)
    assert beside is not None
    assert keys.standoff_m is not None
    assert keys.side is not None
    distance_m = beside.radius_m + keys.standoff_m
    (x_m, z_m), (towards_x, towards_z) = beside.position_m, _SIDES[keys.side]
    return x_m + towards_x * distance_m, z_m + towards_z * distance_m


def _point(keys: _TargetFile | _ViewFile) -> PlanePoint:
    assert keys.x_m is not None
    assert keys.z_m is not None
    return keys.x_m, keys.z_m


_SIDES = {"left": (-1.0, 0.0), "right": (1.0, 0.0), "above": (0.0, 1.0), "below": (0.0, -1.0)}


class _LandingFile(FileModel):
    exit: list[_PointFile] = Field(default_factory=list)
    """Landing points of an exit, any of which may serve; without one there is no exit."""
    evacuation: list[_PointFile] = Field(default_factory=list)
    """Landing points of an evacuation, in the same way."""


class SiteFile(FileModel):
    """A site file."""

    name: Name
    """Name of the site, for texts."""
    frame: _FrameFile
    workspace: _WorkspaceFile
    ground: Annotated[list[Interval], Field(min_length=2, max_length=MAX_VERTICES)] | None = None
    """Ground that is not flat: points `[x, z]` of its profile in the plane, x rising, from end to
    end of the workspace; beyond them it goes on level. It needs `workspace.min_altitude_m`, which
    is kept above it. None: level, at z = 0."""
    obstacles: list[_ObstacleFile]
    """Obstacles, each one `conductor` or one `polygon`; `[]` for none."""
    start: _PointFile
    """Start of `plan`; in flight the vehicle's own position."""
    targets: dict[Name, _TargetFile] = Field(default_factory=dict)
    """Targets by name, visited in this order with `inspection.order: file`."""
    landing: _LandingFile = Field(default_factory=_LandingFile)


def site_document(text: str, source: str) -> dict[str, Any]:
    """Content of a site file's text as a mapping, without defaults; InputError as `Site.load`."""
    file = yaml_file.parsed(text, source, SiteFile, _findings)
    return file.model_dump(mode="json", exclude_unset=True)


def _findings(file: SiteFile) -> Iterator[FileFinding]:
    yield from _workspace_findings(file.workspace)
    yield from _ground_findings(file)
    yield from _obstacle_findings(file.obstacles)
    conductors = [entry.conductor.name for entry in file.obstacles if entry.conductor]
    for name, target in file.targets.items():
        key: yaml_file.Key = ("targets", name)
        if target.views is None:
            yield from _place_findings(key, target, conductors)
        else:
            yield from _viewed_findings(key, target, conductors)
            for index, view in enumerate(target.views):
                yield from _view_findings((*key, "views", index), view, conductors)
                if (other := view_name(name, index + 1)) in file.targets:
                    yield FileFinding(("targets", other), f"is the name of a view of {name}")


def _workspace_findings(workspace: _WorkspaceFile) -> Iterator[FileFinding]:
    extents_m = []
    for name in ("x_m", "z_m"):
        low, high = getattr(workspace, name)
        if low >= high:
            problem = f"is [{low:g}, {high:g}], the first must be less than the second"
            yield FileFinding(("workspace", name), problem)
        extents_m.append(high - low)
    if min(extents_m) <= 0.0:
        return
    count = math.prod(_cells(extent_m, workspace.resolution_m) for extent_m in extents_m)
    if count > MAX_CELLS:
        # Each axis has at most extent / r cells, or one.
        enough_m = max(
            math.sqrt(extents_m[0] * extents_m[1] / MAX_CELLS), max(extents_m) / MAX_CELLS
        )
        yield FileFinding(
            ("workspace", "resolution_m"),
            f"is {workspace.resolution_m:g}, which makes {count:.7g} cells where {MAX_CELLS} are "
            f"allowed: must be at least {_rounded_up(enough_m):g}, or the workspace smaller",
        )


def _ground_findings(file: SiteFile) -> Iterator[FileFinding]:
    if file.ground is None:
        return
    if file.workspace.min_altitude_m is None:
        problem = "is missing: the height that plans keep above the profile of `ground`"
        yield FileFinding(("workspace", "min_altitude_m"), problem)
    for index, ((before_m, _), (x_m, _)) in enumerate(itertools.pairwise(file.ground), 1):
        if x_m <= before_m:
            problem = f"has x {x_m:g} after {before_m:g}, x must rise"
            yield FileFinding(("ground", index), problem)
    (low_m, high_m), first_m, last_m = file.workspace.x_m, file.ground[0][0], file.ground[-1][0]
    if first_m > low_m or last_m < high_m:
        problem = (
            f"reaches from x = {first_m:g} to {last_m:g}, must reach from {low_m:g} to {high_m:g}"
        )
        yield FileFinding(("ground",), problem)


def _rounded_up(value: float) -> float:
    """The value rounded up to three significant digits."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 2)
    return math.ceil(value / unit) * unit


def _obstacle_findings(obstacles: list[_ObstacleFile]) -> Iterator[FileFinding]:
    seen: dict[str, int] = {}
    for index, entry in enumerate(obstacles):
        key: yaml_file.Key = ("obstacles", index)
        shapes = entry.shapes()
        if len(shapes) != 1:
            yield FileFinding(key, "must have one key, conductor or polygon")
        for kind, shape in shapes.items():
            if shape.name in seen:
                problem = f"is {shape.name!r} like obstacles[{seen[shape.name]}], must be unique"
                yield FileFinding((*key, kind, "name"), problem)
            seen.setdefault(shape.name, index)
            if isinstance(shape, _PolygonFile):
                problem_of_outline = outline_problem(np.array(shape.vertices_m))
                if problem_of_outline:
                    yield FileFinding((*key, kind, "vertices_m"), problem_of_outline)


def _place_findings(
    key: yaml_file.Key, target: _TargetFile, conductors: list[str]
) -> Iterator[FileFinding]:
    """Checks the place of a target without views: by coordinates, or beside a conductor."""
    allowed = "x_m and z_m, or conductor, standoff_m and side"
    yield from _one_form(
        key, target, ("x_m", "z_m"), ("conductor", "standoff_m", "side"), f"must have {allowed}"
    )
    yield from _conductor_findings(key, target, conductors)


def _viewed_findings(
    key: yaml_file.Key, target: _TargetFile, conductors: list[str]
) -> Iterator[FileFinding]:
    """Checks the conductor or point of a target with views."""
    for name in ("standoff_m", "side"):
        if getattr(target, name) is not None:
            yield FileFinding((*key, name), "is given beside views, must be a key of each view")
    yield from _one_form(
        key, target, ("x_m", "z_m"), ("conductor",), "must have conductor, or x_m and z_m"
    )
    yield from _conductor_findings(key, target, conductors)


def _view_findings(
    key: yaml_file.Key, view: _ViewFile, conductors: list[str]
) -> Iterator[FileFinding]:
    """Checks the place of a view, and that it captures something."""
    allowed = "must have x_m and z_m, or standoff_m and side"
    yield from _one_form(key, view, ("x_m", "z_m"), ("standoff_m", "side"), allowed)
    if view.x_m is not None and view.conductor is not None:
        yield FileFinding((*key, "conductor"), "is given beside x_m and z_m, use aim instead")
    yield from _conductor_findings(key, view, conductors)
    if view.aim is not None and view.aim.position_m == (view.x_m, view.z_m):
        yield FileFinding((*key, "aim"), "is the view's own place, must be another point")
    if not view.count and not view.video_s:
        yield FileFinding((*key, "pictures"), "is 0, must be at least 1 without video_s")


def _one_form(
    key: yaml_file.Key,
    keys: _TargetFile | _ViewFile,
    place: tuple[str, ...],
    relative: tuple[str, ...],
    allowed: str,
) -> Iterator[FileFinding]:
    """Checks that all keys of one form are given, and none of the other. allowed: the forms."""
    given = [name for name in (*place, *relative) if getattr(keys, name) is not None]
    both = any(name in place for name in given) and any(name in relative for name in given)
    if both or not given:
        problem = f"has {' and '.join(given)}, " if both else ""
        yield FileFinding(key, f"{problem}{allowed}")
        return
    for name in place if given[0] in place else relative:
        if name not in given:
            yield FileFinding((*key, name), "is missing")


def _conductor_findings(
    key: yaml_file.Key, keys: _TargetFile | _ViewFile, conductors: list[str]
) -> Iterator[FileFinding]:
    if keys.conductor is not None and keys.conductor not in conductors:
        known = yaml_file.nearest(keys.conductor, conductors) or (
            f", must be one of {', '.join(conductors)}" if conductors else ", there are none"
        )
        problem = f"is {keys.conductor!r}, no conductor of this site{known}"
        yield FileFinding((*key, "conductor"), problem)


def outline_problem(vertices_m: npt.NDArray[np.float64]) -> str | None:
    """Reason why vertices, shape (n, 2), are no outline of a filled shape; None if they are."""
    points = vertices_m - vertices_m[0]
    count = len(points)
    following = np.roll(points, -1, axis=0)
    edges = following - points
    scale = float(np.abs(points).max())
    tolerance = 1e-12 * scale * scale
    lengths = np.hypot(edges[:, 0], edges[:, 1])
    repeated = np.flatnonzero(lengths <= 1e-12 * scale)
    if repeated.size:
        first = int(repeated[0])
        return f"has the same vertex at [{first}] and [{(first + 1) % count}], must differ"
    farthest = points[np.argmax(np.hypot(points[:, 0], points[:, 1]))]
    if np.all(np.abs(_cross(farthest, points)) <= tolerance):
        return "encloses no area, must not lie on a line"
    for first, second in itertools.pairwise([*range(count), 0]):
        if (
            abs(_cross(edges[first], edges[second])) <= tolerance
            and float(edges[first] @ edges[second]) < 0.0
        ):
            return f"folds back on itself at [{second}], must be a simple outline"
    for first in range(count - 2):
        # Against all later edges that share no vertex with it.
        others = np.arange(first + 2, count - 1 if first == 0 else count)
        crossing = _touching(
            points[first], following[first], points[others], following[others], tolerance
        )
        if crossing.any():
            second = int(others[np.flatnonzero(crossing)[0]])
            return (
                f"crosses itself (edge [{first}]-[{first + 1}] and edge "
                f"[{second}]-[{(second + 1) % count}]), must be a simple outline"
            )
    return None


def _touching(
    start: npt.NDArray[np.float64],
    end: npt.NDArray[np.float64],
    starts: npt.NDArray[np.float64],
    ends: npt.NDArray[np.float64],
    tolerance: float,
) -> npt.NDArray[np.bool_]:
    """Mask of the n segments, shape (n, 2) each, that share a point with one segment."""

    def side(values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        return np.where(np.abs(values) <= tolerance, 0.0, np.sign(values))

    apart = side(_cross(end - start, starts - start)) * side(_cross(end - start, ends - start))
    across = side(_cross(ends - starts, start - starts)) * side(_cross(ends - starts, end - starts))
    overlapping = np.all(
        (np.maximum(starts, ends) >= np.minimum(start, end))
        & (np.maximum(start, end) >= np.minimum(starts, ends)),
        axis=1,
    )
    touching: npt.NDArray[np.bool_] = (apart <= 0.0) & (across <= 0.0) & overlapping
    return touching


def _cross(first: npt.NDArray[np.float64], second: npt.NDArray[np.float64]) -> Any:
    return first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
