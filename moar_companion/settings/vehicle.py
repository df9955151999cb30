"""A vehicle: its size, safety distances, speeds, weights, and guidance.

`Vehicle.load(path)` reads a YAML file, described in `configs/reference.md`. Angles in files are
degrees, inside radians.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from os import PathLike
from typing import Annotated, Literal

from pydantic import Field, PlainValidator
from pydantic_core import PydanticCustomError

from ..types import AUTOPILOTS, AutopilotKind, Mission, Weights
from . import yaml_file
from .risk_model import RiskModel, risk_findings
from .yaml_file import FileFinding
from .yaml_schema import FileModel, Name, Section

_Positive = Field(gt=0.0, le=1e6)
_Distance = Field(ge=0.01, le=100.0)


_EXPOSURE = 0.2
"""Safety cost of a place from which an autopilot's failsafe would hit an obstacle. A fifth of the
cost of the worst place: a path avoids such places where the detour is short."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SafetyShape:
    """Eq. 2 and 3: distances of C(d), and k_a, k_b, k_c normalised to sum 1."""

    d_min_m: float
    d_max_m: float
    collision: float
    insertion: float
    damage: float
    exposure: float = _EXPOSURE
    """Added to SC where an action of the autopilot's own would hit an obstacle."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SpeedLimits:
    """Eq. 5: cruising speeds by direction of flight, all positive."""

    min_mps: float
    """v_MIN, not above any of the cruising speeds."""
    horizontal_mps: float
    up_mps: float
    down_mps: float
    diagonal_up_mps: float
    diagonal_down_mps: float
    max_mps: float
    """v_MAX: the greatest cruising speed unless configured."""


class AdaptationKind(str, enum.Enum):
    """Rule by which risks shift the weights."""

    PAPER = "paper"
    """Eq. 9 as printed."""
    CALIBRATED = "calibrated"


class YawMode(str, enum.Enum):
    """Direction of the nose in flight."""

    TARGET = "target"
    PATH = "path"
    FIXED = "fixed"


@dataclass(frozen=True, slots=True, kw_only=True)
class Guidance:
    """Conversion of a plan to setpoints (all optional in the file; limits in its units)."""

    acceleration_mps2: Annotated[float, Field(gt=0.0, le=20.0)] = 1.0
    """Acceleration of the setpoint along the path and in its corners. Setpoints carry none: PX4 is
    off by 0.58 m for each m/s² with its default gains (1 / (MPC_XY_P · MPC_XY_VEL_P_ACC))."""
    yaw_rate_radps: Annotated[float, Field(ge=1.0, le=360.0)] = math.radians(45.0)
    """Greatest rate at which the nose turns."""
    yaw_mode: YawMode = YawMode.TARGET
    """Direction of the nose."""
    fixed_yaw_rad: Annotated[float, Field(ge=-180.0, le=360.0)] = 0.0
    """The heading of `fixed`."""
    tracking_slow_m: Annotated[float, _Distance] = 0.5
    """Tracking error from which the reference slows down to wait for the aircraft, less than
    `tracking_hold_m`. The aircraft is at the path's end within this, or after 5 s there within
    `tracking_hold_m`."""
    tracking_hold_m: Annotated[float, _Distance] = 1.5
    """Tracking error at which the reference stands still, at most `off_path_m`."""
    off_path_m: Annotated[float, _Distance] = 2.0
    """Tracking error at which the path is left and planned again from the aircraft's place."""
    leash_m: Annotated[float, _Distance] = 3.0
    """Tracking error, not below `off_path_m`, from which the setpoint follows an aircraft that the
    wind displaces: autopilots fly to a far point at about its distance a second (MPC_XY_P,
    PSC_POSXY_P). In calm air PX4 deviates by up to 1.15 m."""
    tracking_margin_m: Annotated[float | None, Field(ge=0.0, le=100.0)] = None
    """Tracking error that distances from obstacles allow for; none: the error measured with the
    autopilot."""
    recovery_m: Annotated[float, Field(ge=0.1, le=500.0)] = 60.0
    """Greatest distance outside the workspace or beside the plane of a recovery leg; farther out an
    order is refused. A wind of 13 m/s moved a quadrotor by 41 m in 14 s, and the site does not
    describe its surroundings."""
    landing_height_m: Annotated[float, Field(ge=0.0, le=20.0)] = 2.0
    """Height above the landing point at which a landing leg ends."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Power:
    """Power consumption of flight, until it is measured (all optional in the file)."""

    hover_w: Annotated[float, _Positive] = 400.0
    """Power of hovering, here of a quadrotor of 2 to 3 kg. Without `capacity_wh` only the ratios of
    the powers count."""
    cruise_w: Annotated[float | None, _Positive] = None
    """Power of level flight at `speed.horizontal_mps`; none: as hovering, since at the speeds of an
    inspection the drag takes what the rotors gain by the moving air."""
    climb_w: Annotated[float | None, _Positive] = None
    """Power of climbing at `speed.up_mps`; none: by momentum theory, at 1.5 m/s 1.13 times
    hovering."""
    descent_w: Annotated[float | None, _Positive] = None
    """Power of descending at `speed.down_mps`; none: as hovering."""
    capacity_wh: Annotated[float | None, _Positive] = None
    """Capacity of all flight batteries together; none: by `risk.endurance_s`, and consumption is
    measured by the autopilot's percentage, not by the current."""
    reserve_s: Annotated[float, Field(ge=0.0, le=3_600.0)] = 60.0
    """Flight time that must be left after the landing of an escape route: enough for a second
    one."""
    cell_resistance_ohm: Annotated[float, Field(ge=0.0, le=1.0)] = 0.005
    """Voltage drop of a cell for each ampere; PX4's own figure (BAT1_R_INTERNAL)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Vehicle:
    """Properties of a vehicle for planning, risk and guidance."""

    name: str
    autopilot: AutopilotKind | None
    """None: taken from its heartbeat."""
    radius_m: float
    safety: SafetyShape
    speed: SpeedLimits
    weights: Mapping[Mission, Weights]
    """k_{S,0}, k_{T,0}, k_{E,0} per mission, normalised."""
    adaptation: AdaptationKind = AdaptationKind.PAPER
    """Rule by which risks shift the weights."""
    guidance: Guidance = field(default_factory=Guidance)
    power: Power = field(default_factory=Power)
    risk: RiskModel = field(default_factory=RiskModel)

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Vehicle:
        """The vehicle in a YAML file; raises InputError with one line when it cannot be used."""
        return cls.of(VehicleFile.load(path))

    @classmethod
    def of(cls, file: VehicleFile) -> Vehicle:
        """The vehicle that a file describes."""
        shape, speed = file.safety, file.speed
        total = sum(shape.weights.values)
        return cls(
            name=file.name,
            autopilot=file.autopilot,
            radius_m=file.geometry.radius_m,
            safety=SafetyShape(
                d_min_m=shape.d_min_m,
                d_max_m=shape.d_max_m,
                collision=shape.weights.collision / total,
                insertion=shape.weights.insertion / total,
                damage=shape.weights.damage / total,
                exposure=shape.exposure,
            ),
            speed=SpeedLimits(
                min_mps=speed.min_mps,
                horizontal_mps=speed.horizontal_mps,
                up_mps=speed.up_mps,
                down_mps=speed.down_mps,
                diagonal_up_mps=speed.diagonal_up_mps,
                diagonal_down_mps=speed.diagonal_down_mps,
                max_mps=max(speed.cruising) if speed.max_mps is None else speed.max_mps,
            ),
            weights={
                mission: Weights.normalised(*getattr(file.weights, mission.value).values)
                for mission in Mission
            },
            adaptation=AdaptationKind(file.adaptation),
            guidance=file.guidance,
            power=file.power,
            risk=file.risk,
        )


_Speed = Annotated[float, Field(ge=0.05, le=100.0)]
_Share = Annotated[float, Field(ge=0.0, le=1e6)]


class _GeometryFile(FileModel):
    radius_m: Annotated[float, Field(ge=0.0, le=100.0)]
    """Radius of the hull: cells nearer than this to an obstacle are occupied."""


class _SafetyWeightsFile(FileModel):
    collision: _Share
    """Weight of collision, k_a (Eq. 2); the three are normalised, at least one is positive."""
    insertion: _Share
    """Weight of insertion, k_b."""
    damage: _Share
    """Weight of damage, k_c."""

    @property
    def values(self) -> tuple[float, float, float]:
        return self.collision, self.insertion, self.damage


class _SafetyFile(FileModel):
    d_min_m: Annotated[float, _Distance]
    """Distance of the full safety cost (Eq. 3)."""
    d_max_m: Annotated[float, _Distance]
    """Distance of its end, more than `d_min_m`."""
    weights: _SafetyWeightsFile
    exposure: Annotated[float, Field(ge=0.0, le=10.0)] = _EXPOSURE
    """Added to the safety cost where a failsafe of the autopilot (at low battery, RC, GCS, GPS or
    companion loss) would hit an obstacle; by the parameters that it reports in flight, so that
    `plan` without an autopilot has none."""


class _SpeedFile(FileModel):
    min_mps: _Speed
    """Least speed, v_MIN (Eq. 5), not above any of the next."""
    horizontal_mps: _Speed
    """Cruising speed in level flight."""
    up_mps: _Speed
    """Cruising speed upwards."""
    down_mps: _Speed
    """Cruising speed downwards."""
    diagonal_up_mps: _Speed
    """Cruising speed upwards at 45 degrees."""
    diagonal_down_mps: _Speed
    """Cruising speed downwards at 45 degrees."""
    max_mps: _Speed | None = None
    """Greatest speed, v_MAX, at least `min_mps`; none: the greatest of the cruising speeds."""

    @property
    def cruising(self) -> tuple[float, ...]:
        return tuple(getattr(self, name) for name in _CRUISING)


_CRUISING = ("horizontal_mps", "up_mps", "down_mps", "diagonal_up_mps", "diagonal_down_mps")


class _MissionWeightsFile(FileModel):
    safety: _Share
    """Weight of safety, k_{S,0} (Eq. 9); the three are normalised, at least one is positive."""
    time: _Share
    """Weight of time, k_{T,0}."""
    energy: _Share
    """Weight of energy, k_{E,0}."""

    @property
    def values(self) -> tuple[float, float, float]:
        return self.safety, self.time, self.energy


class _WeightsFile(FileModel):
    inspection: _MissionWeightsFile
    exit: _MissionWeightsFile
    evacuation: _MissionWeightsFile


def _known_autopilot(value: object) -> AutopilotKind | None:
    for kind in AUTOPILOTS:
        if value == kind:
            return kind
    if value is None:
        return None
    expected = " or ".join(repr(kind) for kind in AUTOPILOTS)
    raise PydanticCustomError("literal_error", "must be {expected}", {"expected": expected})


class VehicleFile(FileModel):
    """A vehicle file."""

    name: Name
    """Name of the vehicle, for texts."""
    autopilot: Annotated[
        AutopilotKind | None,
        PlainValidator(_known_autopilot),
        Field(json_schema_extra={"enum": [*AUTOPILOTS, None]}),
    ] = None
    """Kind of its autopilot; none: taken from its heartbeat."""
    geometry: _GeometryFile
    safety: _SafetyFile
    speed: _SpeedFile
    weights: _WeightsFile
    adaptation: Literal["paper", "calibrated"] = "paper"
    """Rule by which risks shift the weights: Eq. 9 as printed, or calibrated on the exact front
    (guides/vehicle.md); of `plan` also `--adaptation`."""
    guidance: Annotated[Guidance, Section(Guidance)] = Field(default_factory=Guidance)
    power: Annotated[Power, Section(Power)] = Field(default_factory=Power)
    risk: Annotated[RiskModel, Section(RiskModel)] = Field(default_factory=RiskModel)

    @classmethod
    def load(cls, path: str | PathLike[str]) -> VehicleFile:
        """The content of a YAML file; raises InputError with one line when it cannot be used."""
        return yaml_file.read(path, cls, vehicle_findings)


def vehicle_findings(file: VehicleFile) -> Iterator[FileFinding]:
    """Yields the faults across the keys of a vehicle file."""
    safety, speed = file.safety, file.speed
    if safety.d_min_m >= safety.d_max_m:
        problem = f"is {safety.d_min_m:g}, must be less than d_max_m ({safety.d_max_m:g})"
        yield FileFinding(("safety", "d_min_m"), problem)
    if sum(safety.weights.values) <= 0.0:
        yield FileFinding(("safety", "weights"), "are all 0, must have a positive sum")
    for name in (*_CRUISING, "max_mps"):
        limit = getattr(speed, name)
        if limit is not None and limit < speed.min_mps:
            problem = f"is {limit:g}, must be at least min_mps ({speed.min_mps:g})"
            yield FileFinding(("speed", name), problem)
    for mission in Mission:
        if sum(getattr(file.weights, mission.value).values) <= 0.0:
            yield FileFinding(("weights", mission.value), "are all 0, must have a positive sum")
    yield from _guidance_findings(file.guidance)
    yield from risk_findings(file.risk)


def _guidance_findings(guidance: Guidance) -> Iterator[FileFinding]:
    slow, hold, off = guidance.tracking_slow_m, guidance.tracking_hold_m, guidance.off_path_m
    if slow >= hold:
        problem = f"is {slow:g}, must be less than tracking_hold_m ({hold:g})"
        yield FileFinding(("guidance", "tracking_slow_m"), problem)
    if hold > off:
        problem = f"is {hold:g}, must be at most off_path_m ({off:g})"
        yield FileFinding(("guidance", "tracking_hold_m"), problem)
