"""The service's configuration: `configs/companion.yaml` and the command line's overrides.

`shipped_configs()`: the folder of the configurations that come with the program.
"""

from __future__ import annotations

import enum
from collections.abc import Iterator
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, Strict

from . import yaml_file
from .link_config import KeySource, LinkConfig, LinkFile, LinkRole, SigningFile, link_findings
from .mqtt_config import ORDER_LINK, Mqtt, MqttFile, mqtt_findings
from .perception_config import Perception, PerceptionFile, perception_findings
from .yaml_file import FileFinding
from .yaml_schema import FileModel, FilePath, Name, Section

_Seconds = Field(gt=0.0, le=3_600.0)


def shipped_configs() -> Path:
    """The folder of the shipped configurations, with `sites/` and `vehicles/`.

    The package carries them as `configs`, in a checkout as a link to the folder beside it.
    """
    package = Path(__file__).parents[1]
    inside = package / "configs"
    return inside if inside.is_dir() else package.parent / "configs"


def default_vehicle() -> Path:
    """The vehicle file of `plan` and of the service where none is named: the LineDrone as flown."""
    return shipped_configs() / "vehicles" / "linedrone_flight.yaml"


class Authority(str, enum.Enum):
    """Authority of the companion over the aircraft."""

    OBSERVE = "observe"
    """Never streams."""
    STREAM = "stream"
    """Streams when the pilot has selected the mode; changes no mode."""
    ENGAGE = "engage"
    """May also request OFFBOARD/GUIDED and LAND on an operator's command."""


class LossCheck(str, enum.Enum):
    """Response to a plan on which an action of the autopilot would hit an obstacle."""

    REFUSE = "refuse"
    WARN = "warn"


GROUND_STATION_IDS = range(240, 256)
"""The system ids that ground stations have: QGroundControl, Mission Planner and MAVROS 255, MAVSDK
245; vehicles count from 1."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Commands:
    """Senders that may command; hold and pause are accepted from any sender."""

    systems: tuple[int, ...] | None = None
    """System ids; None: those of ground stations, and the vehicle's own. This ignores commands that
    the companion of another vehicle sends to all. An id does not prove who the sender is."""
    components: tuple[int, ...] | None = None
    """Component ids; None: any, since ground stations choose theirs freely."""
    links: tuple[str, ...] | None = None
    """URLs of links; None: all, since many have their ground station behind the autopilot."""
    signed_only: bool = False
    """True: the packet must be signed. Not by default: few ground stations sign, and all others
    would be refused."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Replanning:
    """Conditions for replanning in flight."""

    period_s: Annotated[float, _Seconds] = 2.0
    """Longest time between two plans."""
    risk_change: Annotated[float, Field(gt=0.0, le=1.0)] = 0.1
    """Change of an index since the last plan that triggers the next."""
    min_interval_s: Annotated[float, _Seconds] = 0.3
    """Shortest time between two plans."""
    improvement: Annotated[float, Field(ge=0.0, le=1.0)] = 0.005
    """Fraction of its cost that a new path must save to replace the flown one. Paths between which
    noise on the risks switches differ by less; a wind that rises to 0.8 saves 0.01."""


class LinkLoss(str, enum.Enum):
    """Action without a ground station."""

    CONTINUE = "continue"
    HOLD = "hold"
    EXIT = "exit"


@dataclass(frozen=True, slots=True, kw_only=True)
class Supervision:
    """Limits of a flight; safety/conditions.py defines the effect of each."""

    position_timeout_s: Annotated[float, _Seconds] = 0.5
    """Age from which a position is stale: the stream ends (LOCAL_POSITION_NED comes at 30 to 40
    Hz)."""
    heartbeat_timeout_s: Annotated[float, _Seconds] = 3.0
    """Time without any packet of the autopilot, heartbeat or other, until its link is lost."""
    mode_timeout_s: Annotated[float, _Seconds] = 3.0
    """Age of the last mode report at which control ends: the mode may have changed. The mode is
    reported 20 times a second or more: on a link that loses 30 %, a gap of this length occurs once
    in 10^31 reports."""
    armed_timeout_s: Annotated[float, _Seconds] = 15.0
    """Age of the armed state at which control ends; only HEARTBEAT reports it, on PX4 once a
    second."""
    ready_timeout_s: Annotated[float, _Seconds] = 30.0
    """Time for which a hold is offered to the pilot before the pilot selects the mode."""
    plane_tolerance_m: Annotated[float, Field(gt=0.0, le=1_000.0)] = 2.0
    """Greatest distance from the plane that is flown."""
    wind_limit_mps: Annotated[float, Field(gt=0.0, le=100.0)] = 15.0
    """With the default drag the tilt yields 15 m/s for a true 13 and 18 (two recorded quadrotors):
    12 is a good limit once the vehicle's drag is measured (`replay --fit-drag`)."""
    localization_limit: Annotated[float, Field(gt=0.0, le=1.0)] = 0.9
    """Limit of the localization risk, close to its maximum."""
    position_uncertainty_m: Annotated[float | None, Field(ge=0.0, le=100.0)] = None
    """Position error that distances from obstacles allow for, even where less is reported; None:
    the error measured with the vehicle's autopilot (`autopilots`)."""
    position_uncertainty_limit_m: Annotated[float, Field(gt=0.0, le=100.0)] = 2.0
    """Uncertainty above which the mission is held; from `position_uncertainty_m` on, obstacles grow
    by the excess."""
    battery_reserve: Annotated[float, Field(ge=0.0, le=1.0)] = 0.2
    """Fraction left at which the flight along the escape route begins."""
    ground_link_lost_s: Annotated[float, _Seconds] = 10.0
    """Both autopilots, too, regard the ground station as lost after it."""
    ground_link_action: LinkLoss = LinkLoss.HOLD
    exposure_limit_s: Annotated[float, _Seconds] = 120.0
    """Limit of the time at places where an unforeseeable failsafe would hit an obstacle, beyond a
    target's dwell: a long inspection of a splice. The next target or order restarts it."""
    exposure_reserve_s: Annotated[float, Field(ge=0.0, le=3_600.0)] = 30.0
    """Least time between the last place from where a battery's action would hit an obstacle and
    that action: in a gust a forecast of the charge is off by as much."""
    failsafe_action: LossCheck = LossCheck.WARN
    """Response to a plan on which the autopilot's action after a link loss would hit an obstacle,
    or after the loss of the fix where no short leg prevents it.
    A warning by default: links are rarely lost, and places above a conductor usually exposed."""
    jump_limit_m: Annotated[float, Field(gt=0.0, le=1_000.0)] = 3.0
    """The setpoint follows a jump of the position; a greater jump needs an operator's decision."""
    plan_stale_s: Annotated[float, _Seconds] = 12.0
    """Plans take milliseconds; without an answer the request is repeated after 5 s: twice."""
    disk_free_mb: Annotated[float, Field(ge=0.0, le=1e6)] = 200.0
    """An hour of recording takes about 100 MB."""
    memory_free_mb: Annotated[float, Field(ge=0.0, le=1e6)] = 100.0
    fence_margin_m: Annotated[float, Field(ge=0.0, le=100.0)] = 1.5
    """Distance kept from the autopilot's fence. PX4's greatest distance from its setpoint was 1.15
    m, and half a cell of 0.3 m is rounding; PX4 compares the position that it reports with its
    fence. The stopping distance, by the speed, is kept in addition."""
    loss_action: LossCheck = LossCheck.REFUSE
    """Response when the autopilot's action after a companion failure would lead through an
    obstacle: a parameter corrects it, and a text in flight is easily missed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RecorderSettings:
    """Recordings of flights. directory: None: `flights` in systemd's state folder, else none."""

    enabled: bool = True
    directory: Path | None = None
    part_mb: float = 256.0
    """Size of an .mcap at which the next part begins: Foxglove opens a file of this size at
    once."""
    part_min: float = 60.0
    """Age of a part at which the next one begins."""
    keep_gb: float = 20.0
    """Size of all recordings above which the oldest are removed: over 100 hours of flight."""
    floor_mb: float = 300.0
    """Free disk space below which the oldest are removed, or the recording ends. It is above
    `supervision.disk_free_mb`: recordings alone never cause a condition."""


@dataclass(frozen=True, slots=True, kw_only=True)
class State:
    """Folder of the mission's state, kept after the process; None: systemd's folder, else none."""

    directory: Path | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """Socket of the live view; None: in systemd's runtime directory, else none."""

    socket: Path | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class CompanionConfig:
    """Complete configuration of the service at its start."""

    vehicle: Path
    site: Path | None = None
    """None: without a site, telemetry and risk only."""
    links: tuple[LinkConfig, ...] = (LinkConfig(url="udp:127.0.0.1:14540"),)
    system_id: int = 1
    """Initial system id; the companion takes the id of a received autopilot."""
    component_id: int = 195
    """MAV_COMP_ID_PATHPLANNER."""
    authority: Authority = Authority.STREAM
    setpoint_rate_hz: float = 50.0
    resume: bool = False
    """True: a mode given back by the pilot resumes the mission without a new command."""
    commands: Commands = field(default_factory=Commands)
    replanning: Replanning = field(default_factory=Replanning)
    supervision: Supervision = field(default_factory=Supervision)
    recorder: RecorderSettings = field(default_factory=RecorderSettings)
    state: State = field(default_factory=State)
    view: View = field(default_factory=View)
    signing: KeySource = field(default_factory=KeySource)
    mqtt: Mqtt = field(default_factory=Mqtt)
    perception: Perception = field(default_factory=Perception)
    file: Path | None = field(default=None, compare=False)
    """File that it was read from; None without a file."""

    @property
    def has_signed_links(self) -> bool:
        """True if at least one link is signed."""
        return any(link.signed for link in self.links)

    @property
    def session_links(self) -> dict[str, LinkRole]:
        """Links of the companion and their roles, with that of orders over MQTT."""
        links = {link.url: link.role for link in self.links}
        return links | ({ORDER_LINK: LinkRole.OPERATOR} if self.mqtt.takes_orders else {})

    @classmethod
    def load(
        cls, path: str | PathLike[str], *, vehicle: str | PathLike[str] | None = None
    ) -> CompanionConfig:
        """The configuration in a YAML file; relative paths in it are relative to that file.

        `vehicle` is the vehicle file of the command line: it replaces the one in the file, which
        may then be missing. Raises InputError with one line when the file cannot be used.
        """

        def check(file: _CompanionFile) -> Iterator[FileFinding]:
            if file.vehicle is None and vehicle is None:
                yield FileFinding(("vehicle",), "is missing")
            yield from _findings(file)

        file = yaml_file.read(path, _CompanionFile, check)
        folder = Path(path).parent
        converted: dict[str, Any] = {}
        if vehicle is not None:
            converted["vehicle"] = Path(vehicle)
        if "links" in file.model_fields_set:
            links = (LinkConfig(**link.arguments(folder)) for link in file.links)
            converted["links"] = tuple(links)
        return cls(
            **file.arguments(
                folder,
                commands=Commands(**file.commands.arguments(folder)),
                recorder=RecorderSettings(**file.recorder.arguments(folder)),
                state=State(**file.state.arguments(folder)),
                view=View(**file.view.arguments(folder)),
                signing=KeySource(**file.signing.arguments(folder)),
                mqtt=file.mqtt.settings(folder),
                perception=file.perception.settings(folder),
                file=Path(path),
                **converted,
            )
        )


SLOWEST_HZ, FASTEST_HZ = 20.0, 100.0
"""Rates of setpoints. At the smallest one a cycle may still be a whole period late: its output is
discarded, and the reference held back, after 0.1 s (`service/app`, `companion/companion`)."""
_Id = Annotated[int, Field(ge=1, le=255)]


class _CommandsFile(FileModel):
    systems: Annotated[list[_Id], Field(min_length=1)] | None = None
    components: Annotated[list[_Id], Field(min_length=1)] | None = None
    links: Annotated[list[Name], Field(min_length=1)] | None = None
    signed_only: bool = False


class _RecorderFile(FileModel):
    enabled: bool = True
    directory: FilePath | None = None
    part_mb: Annotated[float, Field(ge=1.0, le=1e6)] = 256.0
    part_min: Annotated[float, Field(ge=1.0, le=1e4)] = 60.0
    keep_gb: Annotated[float, Field(ge=0.1, le=1e6)] = 20.0
    floor_mb: Annotated[float, Field(ge=0.0, le=1e6)] = 300.0


class _StateFile(FileModel):
    directory: FilePath | None = None


class _ViewFile(FileModel):
    socket: FilePath | None = None


class _CompanionFile(FileModel):
    """Keys with a default; the dataclass defines its value."""

    vehicle: FilePath | None = None
    site: FilePath | None = None
    links: list[LinkFile] = Field(default_factory=list)
    system_id: _Id = 1
    component_id: _Id = 195
    authority: Annotated[Authority, Strict(strict=False)] = Authority.STREAM
    setpoint_rate_hz: Annotated[float, Field(ge=SLOWEST_HZ, le=FASTEST_HZ)] = 50.0
    resume: bool = False
    commands: _CommandsFile = Field(default_factory=_CommandsFile)
    replanning: Annotated[Replanning, Section(Replanning)] = Field(default_factory=Replanning)
    supervision: Annotated[Supervision, Section(Supervision)] = Field(default_factory=Supervision)
    recorder: _RecorderFile = Field(default_factory=_RecorderFile)
    state: _StateFile = Field(default_factory=_StateFile)
    view: _ViewFile = Field(default_factory=_ViewFile)
    signing: SigningFile = Field(default_factory=SigningFile)
    mqtt: MqttFile = Field(default_factory=MqttFile)
    perception: PerceptionFile = Field(default_factory=PerceptionFile)


def _findings(file: _CompanionFile) -> Iterator[FileFinding]:
    yield from link_findings(file.links, file.signing)
    yield from mqtt_findings(file.mqtt)
    yield from perception_findings(file.perception)
    replanning = file.replanning
    if replanning.min_interval_s > replanning.period_s:
        yield FileFinding(
            ("replanning", "min_interval_s"),
            f"is {replanning.min_interval_s:g}, must be at most period_s ({replanning.period_s:g})",
        )
    allowed_m = file.supervision.position_uncertainty_m
    limit_m = file.supervision.position_uncertainty_limit_m
    if allowed_m is not None and limit_m < allowed_m:
        problem = f"is {limit_m:g}, must be at least position_uncertainty_m ({allowed_m:g})"
        yield FileFinding(("supervision", "position_uncertainty_limit_m"), problem)
