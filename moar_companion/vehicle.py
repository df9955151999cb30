"""A vehicle: its size, safety distances, speeds, weights, and how it is guided.

`Vehicle.load(path)` reads the YAML of the contract. Angles in files are degrees, inside radians.
"""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from os import PathLike
from typing import Annotated, Literal

from pydantic import Field

from . import yaml_file
from .types import AutopilotKind, Mission, Weights
from .yaml_file import Finding
from .yaml_schema import FileModel, Length, Name, PositiveLength, Section, file_key

_Positive = Field(gt=0.0, le=1e6)
_Fraction = Field(ge=0.0, le=1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class SafetyShape:
    """Eq. 2 and 3: distances of C(d), and k_a, k_b, k_c normalised to sum 1."""

    d_min_m: float
    d_max_m: float
    collision: float
    insertion: float
    damage: float


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


class YawMode(str, enum.Enum):
    """Where the nose points in flight."""

    TARGET = "target"
    PATH = "path"
    FIXED = "fixed"


@dataclass(frozen=True, slots=True, kw_only=True)
class Guidance:
    """How a plan becomes setpoints (all optional in the file; limits in its units)."""

    acceleration_mps2: Annotated[float, Field(gt=0.0, le=20.0)] = 1.0
    """Setpoints carry no acceleration: while it is a, PX4 is off by a / (MPC_XY_P 0.95 times
    MPC_XY_VEL_P_ACC 1.8), 0.58 m for each m/s^2."""
    yaw_rate_radps: Annotated[float, Field(gt=0.0, le=360.0)] = 0.785
    yaw_mode: YawMode = YawMode.TARGET
    fixed_yaw_rad: Annotated[float, Field(ge=-180.0, le=360.0)] = 0.0
    """The heading of `YawMode.FIXED`."""
    tracking_slow_m: Annotated[float, _Positive] = 0.5
    """Tracking error from which the reference slows down to wait for the aircraft."""
    tracking_hold_m: Annotated[float, _Positive] = 1.5
    """Tracking error at which the reference stands still."""
    off_path_m: Annotated[float, _Positive] = 2.0
    """Tracking error at which the path is left and planned again from where the aircraft is."""
    landing_height_m: float = 2.0
    """Height above the landing point at which a landing leg ends."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Range:
    """Where a risk input starts to count (`low`, risk 0) and where it is at its worst (`high`, 1).

    `low > high` is legal: the risk then grows as the input falls (satellites, battery).
    """

    low: float
    high: float

    def fraction(self, value: float) -> float:
        """The input's risk in [0, 1], linear between the two ends."""
        return min(1.0, max(0.0, (value - self.low) / (self.high - self.low)))


@dataclass(frozen=True, slots=True, kw_only=True)
class RiskModel:
    """Thresholds of the risk indices, each with its reason (all optional in the file)."""

    unknown: Annotated[float, _Fraction] = 0.5
    """An index none of whose inputs was ever known: pessimistic, in [0, 1]."""
    drag_per_s: Annotated[float, _Positive] = 0.3
    """Linear drag: deceleration per m/s of airspeed. PX4's simulated quadrotor: 6.5 deg of tilt at
    5 m/s, 16.5 deg at 9.4 m/s, 24 deg at 15 m/s give 0.22 to 0.31."""
    wind_mps: Range = field(default_factory=lambda: Range(low=3.0, high=12.0))
    """From a light breeze to the wind in which small inspection multirotors are grounded."""
    tilt_rad: Annotated[Range, Field(ge=0.0, le=90.0)] = field(
        default_factory=lambda: Range(low=0.17, high=0.52)
    )
    """From 10 deg to 30 deg of lean, the usual limit of the autopilots in position control."""
    motor_fraction: Annotated[Range, _Fraction] = field(
        default_factory=lambda: Range(low=0.75, high=0.95)
    )
    """Greatest motor output over its range: above 95 % no attitude authority is left."""
    motor_pulse_us: Range = field(default_factory=lambda: Range(low=1000.0, high=2000.0))
    """Pulse widths of no and full output."""
    radio_margin: Range = field(default_factory=lambda: Range(low=60.0, high=10.0))
    """RSSI above noise in SiK units (about half a decibel): below 10 packets are lost."""
    transmit_buffer_percent: Range = field(default_factory=lambda: Range(low=50.0, high=15.0))
    """Free space of the radio's transmit buffer: ArduPilot slows its streams below 50 % and at 15 %
    sends a seventh of them."""
    rc_rssi: Annotated[Range, _Fraction] = field(default_factory=lambda: Range(low=0.6, high=0.2))
    ground_station_age_s: Range = field(default_factory=lambda: Range(low=2.5, high=10.0))
    """Ground stations send one heartbeat a second; autopilots call the link lost after 10 s."""
    packet_loss: Annotated[Range, _Fraction] = field(
        default_factory=lambda: Range(low=0.02, high=0.3)
    )
    satellites: Range = field(default_factory=lambda: Range(low=10.0, high=5.0))
    """A fix needs 4; autopilots refuse to arm below 6."""
    hdop: Range = field(default_factory=lambda: Range(low=1.2, high=3.0))
    """Autopilots refuse to arm above 2.5 (PX4) or 1.4 (ArduPilot)."""
    horizontal_accuracy_m: Range = field(default_factory=lambda: Range(low=1.0, high=5.0))
    battery_remaining: Annotated[Range, _Fraction] = field(
        default_factory=lambda: Range(low=0.7, high=0.2)
    )
    """At 20 % the autopilot's own warnings are near (PX4: 15 %)."""
    cell_voltage_v: Range = field(default_factory=lambda: Range(low=3.75, high=3.4))
    """Lithium-polymer under load: 3.4 V is close to the knee."""
    cells: Annotated[int | None, Field(ge=1, le=100)] = None
    """Cells in series; without it voltage says nothing and is not used."""
    endurance_s: Annotated[float, _Positive] = 1200.0
    """Flight time of a full battery, for the way home."""
    home_margin_s: Range = field(default_factory=lambda: Range(low=300.0, high=60.0))
    """Flight time left on arrival at home: a minute is the reserve for one landing; five minutes of
    twenty is where pilots turn home."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Vehicle:
    """A vehicle as planned for, judged and guided."""

    name: str
    autopilot: AutopilotKind | None
    """None: taken from its heartbeat."""
    radius_m: float
    safety: SafetyShape
    speed: SpeedLimits
    weights: Mapping[Mission, Weights]
    """k_{S,0}, k_{T,0}, k_{E,0} per mission, normalised."""
    guidance: Guidance = field(default_factory=Guidance)
    risk: RiskModel = field(default_factory=RiskModel)

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Vehicle:
        """The vehicle in a YAML file; raises InputError with one line when it cannot be used."""
        file = yaml_file.read(path, _VehicleFile, _findings)
        shape, speed = file.safety, file.speed
        total = sum(shape.weights.values)
        return cls(
            name=file.name,
            autopilot=None if file.autopilot is None else AutopilotKind(file.autopilot),
            radius_m=file.geometry.radius_m,
            safety=SafetyShape(
                d_min_m=shape.d_min_m,
                d_max_m=shape.d_max_m,
                collision=shape.weights.collision / total,
                insertion=shape.weights.insertion / total,
                damage=shape.weights.damage / total,
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
            guidance=file.guidance,
            risk=file.risk,
        )


_Speed = Annotated[float, Field(gt=0.0, le=100.0)]
_Share = Annotated[float, Field(ge=0.0, le=1e6)]


class _GeometryFile(FileModel):
    radius_m: Length


class _SafetyWeightsFile(FileModel):
    collision: _Share
    insertion: _Share
    damage: _Share

    @property
    def values(self) -> tuple[float, float, float]:
        return self.collision, self.insertion, self.damage


class _SafetyFile(FileModel):
    d_min_m: PositiveLength
    d_max_m: PositiveLength
    weights: _SafetyWeightsFile


class _SpeedFile(FileModel):
    min_mps: _Speed
    horizontal_mps: _Speed
    up_mps: _Speed
    down_mps: _Speed
    diagonal_up_mps: _Speed
    diagonal_down_mps: _Speed
    max_mps: _Speed | None = None

    @property
    def cruising(self) -> tuple[float, ...]:
        return tuple(getattr(self, name) for name in _CRUISING)


_CRUISING = ("horizontal_mps", "up_mps", "down_mps", "diagonal_up_mps", "diagonal_down_mps")


class _MissionWeightsFile(FileModel):
    safety: _Share
    time: _Share
    energy: _Share

    @property
    def values(self) -> tuple[float, float, float]:
        return self.safety, self.time, self.energy


class _WeightsFile(FileModel):
    inspection: _MissionWeightsFile
    exit: _MissionWeightsFile
    evacuation: _MissionWeightsFile


class _VehicleFile(FileModel):
    name: Name
    autopilot: Literal["px4", "ardupilot"] | None = None
    geometry: _GeometryFile
    safety: _SafetyFile
    speed: _SpeedFile
    weights: _WeightsFile
    guidance: Annotated[Guidance, Section(Guidance)] = Field(default_factory=Guidance)
    risk: Annotated[RiskModel, Section(RiskModel)] = Field(default_factory=RiskModel)


def _findings(file: _VehicleFile) -> Iterator[Finding]:
    safety, speed = file.safety, file.speed
    if safety.d_min_m >= safety.d_max_m:
        problem = f"is {safety.d_min_m:g}, must be less than d_max_m ({safety.d_max_m:g})"
        yield Finding(("safety", "d_min_m"), problem)
    if sum(safety.weights.values) <= 0.0:
        yield Finding(("safety", "weights"), "are all 0, must have a positive sum")
    for name in (*_CRUISING, "max_mps"):
        limit = getattr(speed, name)
        if limit is not None and limit < speed.min_mps:
            problem = f"is {limit:g}, must be at least min_mps ({speed.min_mps:g})"
            yield Finding(("speed", name), problem)
    for mission in Mission:
        if sum(getattr(file.weights, mission.value).values) <= 0.0:
            yield Finding(("weights", mission.value), "are all 0, must have a positive sum")
    yield from _guidance_findings(file.guidance)
    for member in dataclasses.fields(file.risk):
        limits = getattr(file.risk, member.name)
        if isinstance(limits, Range) and limits.low == limits.high:
            key = ("risk", file_key(member.name))
            yield Finding(key, "has two equal values, must differ")


def _guidance_findings(guidance: Guidance) -> Iterator[Finding]:
    slow, hold, off = guidance.tracking_slow_m, guidance.tracking_hold_m, guidance.off_path_m
    if slow >= hold:
        problem = f"is {slow:g}, must be less than tracking_hold_m ({hold:g})"
        yield Finding(("guidance", "tracking_slow_m"), problem)
    if hold > off:
        problem = f"is {hold:g}, must be at most off_path_m ({off:g})"
        yield Finding(("guidance", "tracking_hold_m"), problem)
