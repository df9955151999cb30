"""A vehicle: its size, safety distances, speeds, weights, and guidance.

`Vehicle.load(path)` reads the YAML of the contract. Angles in files are degrees, inside radians.
"""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from os import PathLike
from typing import Annotated, Literal

from pydantic import Field, PlainValidator
from pydantic_core import PydanticCustomError

from . import yaml_file
from .adaptation import Adaptation, AdaptationKind
from .autopilots import PROFILES
from .types import AutopilotKind, Mission, Weights
from .yaml_file import FileFinding
from .yaml_schema import FileModel, Length, Name, PositiveLength, Section, file_key

_Positive = Field(gt=0.0, le=1e6)
_Fraction = Field(ge=0.0, le=1.0)


_EXPOSURE = 0.2
"""Safety cost of a place from which an autopilot's failsafe would hit an obstacle: a fifth of the
cost of the worst place, so that a path bends round such places where that is short."""


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


class YawMode(str, enum.Enum):
    """Direction of the nose in flight."""

    TARGET = "target"
    PATH = "path"
    FIXED = "fixed"


@dataclass(frozen=True, slots=True, kw_only=True)
class Guidance:
    """Conversion of a plan to setpoints (all optional in the file; limits in its units)."""

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
    """Tracking error at which the path is left and planned again from the aircraft's place."""
    leash_m: Annotated[float, _Positive] = 3.0
    """Tracking error, not below `off_path_m`, from which the setpoint follows an aircraft that the
    wind displaces: autopilots fly to a far point at about its distance a second (MPC_XY_P,
    PSC_POSXY_P). In calm air PX4 strays by up to 1.15 m."""
    tracking_margin_m: Annotated[float | None, Field(ge=0.0, le=100.0)] = None
    """Tracking error that distances from obstacles allow for; None: the error measured with the
    autopilot (`autopilots`)."""
    recovery_m: Annotated[float, _Positive] = 60.0
    """Greatest distance outside the workspace that is flown: a wind of 13 m/s moved a quadrotor by
    41 m in 14 s, and the site does not describe its surroundings."""
    landing_height_m: float = 2.0
    """Height above the landing point at which a landing leg ends."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Range:
    """Values of a risk input at which its risk is 0 (`low`) and at which it is 1 (`high`).

    `low > high` is legal: the risk then grows as the input falls (satellites, battery).
    """

    low: float
    high: float

    def fraction(self, value: float) -> float:
        """The input's risk in [0, 1], linear between the two ends."""
        share = (value - self.low) / (self.high - self.low)
        return 0.0 if share <= 0.0 else min(1.0, share)

    def share(self, value: float) -> float:
        """Position of a value between the two ends: 0 at the first, 1 at the second."""
        return (value - self.low) / (self.high - self.low)


_USUAL_DRAG = (0.2, 0.005)
"""Linear drag per second, and quadratic drag per metre."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RiskModel:
    """Thresholds of the risk indices, each with its reason (all optional in the file)."""

    unknown: Annotated[float, _Fraction] = 0.5
    """Value of an index without any known input, and of the communication risk while no link to the
    ground is known: pessimistic, in [0, 1]."""
    drag_per_s: Annotated[float, _Positive] = _USUAL_DRAG[0]
    """Linear drag: deceleration per m/s of airspeed, by the propellers. With the next about the
    mean of two recorded quadrotors: 0.227 and 0, 0.209 and 0.008. `replay --fit-drag` fits it."""
    drag_per_m: Annotated[float, Field(ge=0.0, le=10.0)] = _USUAL_DRAG[1]
    """Quadratic drag: deceleration per (m/s)^2 of airspeed, by the body."""
    wind_mps: Range = field(default_factory=lambda: Range(low=3.0, high=12.0))
    """From a light breeze to the wind in which small inspection multirotors are grounded."""
    gust_mps: Range = field(default_factory=lambda: Range(low=2.0, high=5.0))
    """Standard deviation of the wind over half a minute: gusts are reported to pilots from 5 m/s
    above the mean, which is 2.5 times 2 m/s; with 5 m/s the gusts alone pass the greatest wind."""
    tilt_rad: Annotated[Range, Field(ge=0.0, le=90.0)] = field(
        default_factory=lambda: Range(low=0.17, high=0.52)
    )
    """Lean in hover against the wind: from 10 deg to 30 deg, the limit of ArduPilot in position
    control, and of PX4 less a third for manoeuvres. Flights against the wind are forecast no faster
    than the second allows."""
    motor_fraction: Annotated[Range, _Fraction] = field(
        default_factory=lambda: Range(low=0.75, high=0.95)
    )
    """Greatest motor output over its range: above 95 % no attitude authority is left."""
    motor_pulse_us: Range | None = None
    """Outputs of no and full thrust in their reported unit: of PX4 with DShot 1 and 1999. None:
    pulse widths, by the autopilot's parameters, 1000 to 2000 until these are received."""
    motor_rpm: Range | None = None
    """Speeds of no and full thrust; without it ESC_STATUS is not used."""
    tracking_error_m: Range = field(default_factory=lambda: Range(low=1.0, high=2.0))
    """Distance from the setpoint: in calm air PX4 strays by up to 0.98 m with the noise of its
    simulated receiver; at 2 m the path is left (`guidance.off_path_m`)."""
    radio_margin: Range = field(default_factory=lambda: Range(low=60.0, high=10.0))
    """RSSI above noise in SiK units (about half a decibel). In recorded flights next to no packet
    was broken above 60, one every two seconds between 10 and 30, and below 10 none came."""
    receive_errors_hz: Range = field(default_factory=lambda: Range(low=0.4, high=2.0))
    """Broken packets a second at the local radio, over 3 s: one is chance. In those flights 0.004
    above a margin of 60, and up to 5 at the edge of reception."""
    transmit_buffer_percent: Range = field(default_factory=lambda: Range(low=50.0, high=15.0))
    """Free space of the radio's transmit buffer: ArduPilot slows its streams below 50 % and at 15 %
    sends a seventh of them."""
    rc_rssi: Annotated[Range, _Fraction] = field(default_factory=lambda: Range(low=0.6, high=0.2))
    """Receivers report full signal over most of their range; a fifth of it is their edge."""
    remote_control_age_s: Range = field(default_factory=lambda: Range(low=2.5, high=6.0))
    """RC_CHANNELS is requested twice a second, and PX4 ends it when the transmitter is lost."""
    ground_station_age_s: Range = field(default_factory=lambda: Range(low=2.5, high=10.0))
    """Ground stations send one heartbeat a second; autopilots report a link loss after 10 s."""
    autopilot_age_s: Range = field(default_factory=lambda: Range(low=1.5, high=3.0))
    """Its slowest stream comes once a second; after 3 s the supervisor reports a link loss."""
    packet_loss: Annotated[Range, _Fraction] = field(
        default_factory=lambda: Range(low=0.02, high=0.3)
    )
    """A wire loses none; of commands sent 3 times with a loss of 0.3, one in 37 never arrives."""
    data_rate: Annotated[Range, _Fraction] = field(default_factory=lambda: Range(low=0.5, high=0.1))
    """Fraction of the usual rate. ArduPilot sends 0.45 of it when a radio's buffer is short, 0.13
    when it is nearly full; any single stream that is switched off is less than half of all."""
    satellites: Range = field(default_factory=lambda: Range(low=10.0, high=5.0))
    """A fix needs 4; autopilots refuse to arm below 6."""
    hdop: Range = field(default_factory=lambda: Range(low=1.2, high=3.0))
    """Autopilots refuse to arm above 2.5 (PX4) or 1.4 (ArduPilot)."""
    vdop: Range = field(default_factory=lambda: Range(low=2.2, high=5.0))
    """Satellites are only above: errors of height are 1.5 to 2 times those of the place."""
    horizontal_accuracy_m: Range = field(default_factory=lambda: Range(low=1.0, high=5.0))
    """A common receiver reports 1 m under open sky; PX4 arms up to 3 m, and drops its position at 5
    (COM_POS_FS_EPH), as ArduPilot does."""
    vertical_accuracy_m: Range = field(default_factory=lambda: Range(low=3.0, high=7.5))
    """Autopilots accept receivers up to 5 m (PX4) or 7.5 m (ArduPilot)."""
    receiver_lost: Annotated[float, _Fraction] = 0.25
    """Risk of an aircraft that has lost one of two receivers: the other alone is enough, but the
    cause may affect it, too."""
    innovation: Range = field(default_factory=lambda: Range(low=0.5, high=1.0))
    """Part of the estimator's limit. Above 0.5 PX4 does not arm, at 0.8 in two of them ArduPilot
    lands, and from 1 on the measurement is refused. In wind both simulators stay below 0.5, and two
    recorded quadrotors for 99 % of their flights below 0.6."""
    position_resets: Range = field(default_factory=lambda: Range(low=1.0, high=4.0))
    """Resets of the estimator within 10 s; PX4 aligns its heading once after take-off."""
    magnetic_change: Annotated[Range, _Fraction] = field(
        default_factory=lambda: Range(low=0.25, high=0.5)
    )
    """Relative change of the field's strength against its mean: motors and calibration make up to
    0.15 in recorded flights, in an old one 0.34; PX4 rejects a compass from 0.2 gauss on
    (EKF2_MAG_CHK_STR), 0.4 of the earth's field."""
    battery_remaining: Annotated[Range, _Fraction] = field(
        default_factory=lambda: Range(low=0.7, high=0.2)
    )
    """At 20 % the autopilot's own warnings are near (PX4: 15 %)."""
    cell_voltage_v: Range = field(default_factory=lambda: Range(low=3.75, high=3.4))
    """Lithium-polymer under load: 3.4 V is close to the knee."""
    cells: Annotated[int | None, Field(ge=1, le=100)] = None
    """Cells in series; without it the voltage is not used."""
    endurance_s: Annotated[float, _Positive] = 1200.0
    """Flight time of a full battery, for the return."""
    home_margin_s: Range = field(default_factory=lambda: Range(low=300.0, high=60.0))
    """Flight time left on arrival at home: a minute is the reserve for one landing; five minutes of
    twenty is where pilots turn home."""

    @property
    def drag_is_usual(self) -> bool:
        """True for the default drag, which is not measured."""
        return (self.drag_per_s, self.drag_per_m) == _USUAL_DRAG


@dataclass(frozen=True, slots=True, kw_only=True)
class Power:
    """Power consumption of flight, until it is measured (all optional in the file)."""

    hover_w: Annotated[float, _Positive] = 400.0
    """A quadrotor of 2 to 3 kg. Without `capacity_wh` only the ratios of the powers count."""
    cruise_w: Annotated[float | None, _Positive] = None
    """At `speed.horizontal_mps`; as hovering: at the speeds of an inspection the drag takes what
    the rotors gain by the moving air."""
    climb_w: Annotated[float | None, _Positive] = None
    """At `speed.up_mps`; by momentum theory, at 1.5 m/s 1.13 times hovering."""
    descent_w: Annotated[float | None, _Positive] = None
    """At `speed.down_mps`; as hovering."""
    capacity_wh: Annotated[float | None, _Positive] = None
    """Capacity of all batteries together; by `risk.endurance_s` when it is not given."""
    reserve_s: float = 60.0
    """Flight time that must be left after a landing: enough for a second one."""
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

    def rule(self, mission: Mission) -> Adaptation:
        """The adaptation of a mission's weights, not calibrated."""
        return Adaptation(base=self.weights[mission], kind=self.adaptation)

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Vehicle:
        """The vehicle in a YAML file; raises InputError with one line when it cannot be used."""
        file = yaml_file.read(path, _VehicleFile, _findings)
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
    exposure: Annotated[float, Field(ge=0.0, le=10.0)] = _EXPOSURE


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


def _known_autopilot(value: object) -> AutopilotKind | None:
    for kind in PROFILES:
        if value == kind:
            return kind
    if value is None:
        return None
    expected = " or ".join(repr(kind) for kind in PROFILES)
    raise PydanticCustomError("literal_error", "must be {expected}", {"expected": expected})


class _VehicleFile(FileModel):
    name: Name
    autopilot: Annotated[AutopilotKind | None, PlainValidator(_known_autopilot)] = None
    geometry: _GeometryFile
    safety: _SafetyFile
    speed: _SpeedFile
    weights: _WeightsFile
    adaptation: Literal["paper", "calibrated"] = "paper"
    guidance: Annotated[Guidance, Section(Guidance)] = Field(default_factory=Guidance)
    power: Annotated[Power, Section(Power)] = Field(default_factory=Power)
    risk: Annotated[RiskModel, Section(RiskModel)] = Field(default_factory=RiskModel)


def _findings(file: _VehicleFile) -> Iterator[FileFinding]:
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
    yield from _risk_findings(file.risk)


def _risk_findings(risk: RiskModel) -> Iterator[FileFinding]:
    usual = RiskModel()
    for member in dataclasses.fields(risk):
        limits, before = getattr(risk, member.name), getattr(usual, member.name)
        if not isinstance(limits, Range):
            continue
        key = ("risk", file_key(member.name))
        falls = before is not None and before.high < before.low
        if limits.low == limits.high:
            yield FileFinding(key, "has two equal values, must differ")
        elif (limits.high < limits.low) is not falls:
            first = "greater" if falls else "lesser"
            yield FileFinding(
                key, f"has its values the wrong way round, must have the {first} first"
            )


def _guidance_findings(guidance: Guidance) -> Iterator[FileFinding]:
    slow, hold, off = guidance.tracking_slow_m, guidance.tracking_hold_m, guidance.off_path_m
    if slow >= hold:
        problem = f"is {slow:g}, must be less than tracking_hold_m ({hold:g})"
        yield FileFinding(("guidance", "tracking_slow_m"), problem)
    if hold > off:
        problem = f"is {hold:g}, must be at most off_path_m ({off:g})"
        yield FileFinding(("guidance", "tracking_hold_m"), problem)
