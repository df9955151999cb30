"""The service's configuration: `configs/companion.yaml` and what the command line lays over it.

`shipped_configs()` is where the configurations that come with the program are.
"""

from __future__ import annotations

import enum
from collections.abc import Iterator
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import Field, Strict

from . import yaml_file
from .yaml_file import HEXADECIMAL_KEY, Finding, shown
from .yaml_schema import FileModel, FilePath, Name, Section

_Seconds = Field(gt=0.0, le=3_600.0)


def shipped_configs() -> Path:
    """The folder of the shipped configurations, with `sites/` and `vehicles/`.

    The package carries them as `configs`, in a checkout as a link to the folder beside it.
    """
    package = Path(__file__).parent
    inside = package / "configs"
    return inside if inside.is_dir() else package.parent / "configs"


class Authority(str, enum.Enum):
    """How far the companion may go."""

    OBSERVE = "observe"
    """Never streams."""
    STREAM = "stream"
    """Streams when the pilot gave the mode; changes no mode."""
    ENGAGE = "engage"
    """May also request OFFBOARD/GUIDED and LAND on an operator's command."""


class LossCheck(str, enum.Enum):
    """What is done about a plan on which we had better not die."""

    REFUSE = "refuse"
    WARN = "warn"


class LinkRole(str, enum.Enum):
    """Who is at the other end of a link."""

    AUTOPILOT = "autopilot"
    OPERATOR = "operator"


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkConfig:
    """One link: a URL of the contract and who is there."""

    url: str
    role: LinkRole = LinkRole.AUTOPILOT
    signed: bool = False
    """Whether all packets are signed, and those that are not are refused."""


GROUND_STATION_IDS = range(240, 256)
"""The system ids that ground stations have: QGroundControl, Mission Planner and MAVROS 255, MAVSDK
245; vehicles count from 1."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Commands:
    """Who may command; hold and pause are taken from anybody."""

    systems: tuple[int, ...] | None = None
    """System ids; None: those of ground stations, and the vehicle's own. A command that another
    vehicle's companion sends to all is not for this one; an id proves nothing beyond that."""
    components: tuple[int, ...] | None = None
    """Component ids; None: any, since ground stations choose theirs freely."""
    links: tuple[str, ...] | None = None
    """URLs of links; None: all, since many have their ground station behind the autopilot."""
    signed_only: bool = False
    """Whether the packet must be signed: not by default, since few ground stations are set up so,
    and without it none would be obeyed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Replanning:
    """When a plan in flight is made anew."""

    period_s: Annotated[float, _Seconds] = 2.0
    """At the latest after this time."""
    risk_change: Annotated[float, Field(gt=0.0, le=1.0)] = 0.1
    """As soon as an index has moved by this much since the last plan."""
    min_interval_s: Annotated[float, _Seconds] = 0.3
    """Never more often than this."""
    improvement: Annotated[float, Field(ge=0.0, le=1.0)] = 0.005
    """What part of its cost a new path must save, or the one that is flown stays. Paths that noise
    on the risks chooses among cost the same within that; a wind that rises to 0.8 saves 0.01."""


class LinkLoss(str, enum.Enum):
    """What is done without a ground station."""

    CONTINUE = "continue"
    HOLD = "hold"
    EXIT = "exit"


@dataclass(frozen=True, slots=True, kw_only=True)
class Supervision:
    """Limits of what is flown; mission/conditions.py says what each of them does."""

    position_timeout_s: Annotated[float, _Seconds] = 0.5
    """An older position is stale: the stream ends (LOCAL_POSITION_NED comes at 30 Hz)."""
    heartbeat_timeout_s: Annotated[float, _Seconds] = 3.0
    """Without any packet of the autopilot, a heartbeat or another, for so long its link is lost."""
    mode_timeout_s: Annotated[float, _Seconds] = 3.0
    """A mode that was told longer ago may not be the mode any more: control ends. It is told ten
    times a second: a link that loses 30 % is silent for so long once in 10^15."""
    armed_timeout_s: Annotated[float, _Seconds] = 15.0
    """The same of the armed state, which HEARTBEAT alone tells, on PX4 once a second."""
    ready_timeout_s: Annotated[float, _Seconds] = 30.0
    """How long a hold is offered to the pilot before he gives the mode."""
    plane_tolerance_m: Annotated[float, Field(gt=0.0, le=1_000.0)] = 2.0
    """Farther from the plane than this is not flown."""
    wind_limit_mps: Annotated[float, Field(gt=0.0, le=100.0)] = 15.0
    """With the default drag the tilt tells 15 m/s of a true 13 and 18 (two recorded quadrotors): 12
    is a good limit once the vehicle's drag is measured (`replay --fit-drag`)."""
    localization_limit: Annotated[float, Field(gt=0.0, le=1.0)] = 0.9
    """Of the localization risk: nearly at its worst."""
    position_uncertainty_m: Annotated[float | None, Field(ge=0.0, le=100.0)] = None
    """The position's error that distances from obstacles allow for, even where less is told; None:
    what the vehicle's autopilot was seen to have (`margin.SEEN`)."""
    position_uncertainty_limit_m: Annotated[float, Field(gt=0.0, le=100.0)] = 2.0
    """Above it the mission is held; between the two, obstacles grow by what there is too much."""
    battery_reserve: Annotated[float, Field(ge=0.0, le=1.0)] = 0.2
    """The fraction left with which the way out is begun."""
    ground_link_lost_s: Annotated[float, _Seconds] = 10.0
    """After it both autopilots, too, call the ground station lost."""
    ground_link_action: LinkLoss = LinkLoss.HOLD
    exposure_limit_s: Annotated[float, _Seconds] = 120.0
    """Of the time where a failsafe that nobody can forecast would hit something, beyond a target's
    dwell: a long look at a splice; the next target or order begins it anew."""
    exposure_reserve_s: Annotated[float, Field(ge=0.0, le=3_600.0)] = 30.0
    """Left to a battery's action that would hit something once the last place from where it would
    is behind: a forecast of the charge is off by as much in a gust."""
    failsafe_action: LossCheck = LossCheck.WARN
    """When an action of the autopilot's own on a lost link would hit something on a plan: links
    are rarely lost, and places that are exposed are usual above a conductor."""
    jump_limit_m: Annotated[float, Field(gt=0.0, le=1_000.0)] = 3.0
    """The setpoint goes along with a jump of the position; beyond this an operator must look."""
    plan_stale_s: Annotated[float, _Seconds] = 12.0
    """Plans take milliseconds; without an answer the planner is asked again after 5 s: twice."""
    disk_free_mb: Annotated[float, Field(ge=0.0, le=1e6)] = 200.0
    """An hour of recording takes about 100 MB."""
    memory_free_mb: Annotated[float, Field(ge=0.0, le=1e6)] = 100.0
    fence_margin_m: Annotated[float, Field(ge=0.0, le=100.0)] = 1.5
    """What is kept from the autopilot's fence, at which it acts. PX4's greatest distance from its
    setpoint was 1.15 m, and half a cell of 0.3 m is rounding; its fence counts by the position
    that it tells. The way to a stop is kept beyond it, by the speed."""
    loss_action: LossCheck = LossCheck.REFUSE
    """When what the autopilot does after our death would lead through an obstacle: a parameter
    mends it, and a text in flight is easily missed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Recorder:
    """Where flights are recorded; None: nowhere."""

    directory: Path | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class State:
    """Where the mission's state outlives the process; None: in systemd's folder, else nowhere."""

    directory: Path | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """Where the live view is served; None: in systemd's runtime directory, else nowhere."""

    socket: Path | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class KeySource:
    """Where the key of the signed links is, never the key itself."""

    key_file: Path | None = None
    credential: str | None = None
    """The name of a credential that systemd passes: where it passes some, in place of the file."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CompanionConfig:
    """Everything that the service is told at its start."""

    vehicle: Path
    site: Path | None = None
    """Without a site: telemetry and risk only."""
    links: tuple[LinkConfig, ...] = (LinkConfig(url="udp:127.0.0.1:14540"),)
    system_id: int = 1
    """Used until an autopilot is heard, whose id is then taken."""
    component_id: int = 195
    """MAV_COMP_ID_PATHPLANNER."""
    authority: Authority = Authority.STREAM
    setpoint_rate_hz: float = 50.0
    resume: bool = False
    """Whether a mode given back by the pilot resumes the mission without a new command."""
    commands: Commands = field(default_factory=Commands)
    replanning: Replanning = field(default_factory=Replanning)
    supervision: Supervision = field(default_factory=Supervision)
    recorder: Recorder = field(default_factory=Recorder)
    state: State = field(default_factory=State)
    view: View = field(default_factory=View)
    signing: KeySource = field(default_factory=KeySource)
    file: Path | None = field(default=None, compare=False)
    """Where it was read from; None where no file was."""

    @classmethod
    def load(
        cls, path: str | PathLike[str], *, vehicle: str | PathLike[str] | None = None
    ) -> CompanionConfig:
        """The configuration in a YAML file; relative paths in it are relative to that file.

        `vehicle` is the vehicle file of the command line: it replaces the one in the file, which
        may then be missing. Raises InputError with one line when the file cannot be used.
        """

        def check(file: _CompanionFile) -> Iterator[Finding]:
            if file.vehicle is None and vehicle is None:
                yield Finding(("vehicle",), "is missing")
            yield from _findings(file)

        file = yaml_file.read(path, _CompanionFile, check)
        folder = Path(path).parent
        values: dict[str, Any] = {
            name: getattr(file, name) for name in file.model_fields_set & _PLAIN
        }
        if "links" in file.model_fields_set:
            values["links"] = tuple(
                LinkConfig(url=link.url, role=link.role, signed=link.signed) for link in file.links
            )
        vehicle_path = Path(vehicle) if vehicle is not None else _resolved(folder, file.vehicle)
        assert vehicle_path
        return cls(
            vehicle=vehicle_path,
            site=_resolved(folder, file.site),
            commands=Commands(
                systems=_listed(file.commands.systems),
                components=_listed(file.commands.components),
                links=_listed(file.commands.links),
                signed_only=file.commands.signed_only,
            ),
            replanning=file.replanning,
            supervision=file.supervision,
            recorder=Recorder(directory=_resolved(folder, file.recorder.directory)),
            state=State(directory=_resolved(folder, file.state.directory)),
            view=View(socket=_resolved(folder, file.view.socket)),
            signing=KeySource(
                key_file=_resolved(folder, file.signing.key_file),
                credential=file.signing.credential,
            ),
            file=Path(path),
            **values,
        )


_PLAIN = {"system_id", "component_id", "authority", "setpoint_rate_hz", "resume"}
_Id = Annotated[int, Field(ge=1, le=255)]
_Item = TypeVar("_Item")


def _listed(values: list[_Item] | None) -> tuple[_Item, ...] | None:
    return None if values is None else tuple(values)


def _resolved(folder: Path, path: str | None) -> Path | None:
    return None if path is None else folder / path


class _LinkFile(FileModel):
    url: Name
    role: Annotated[LinkRole, Strict(strict=False)] = LinkRole.AUTOPILOT
    signed: bool = False


class _CommandsFile(FileModel):
    systems: Annotated[list[_Id], Field(min_length=1)] | None = None
    components: Annotated[list[_Id], Field(min_length=1)] | None = None
    links: Annotated[list[Name], Field(min_length=1)] | None = None
    signed_only: bool = False


class _RecorderFile(FileModel):
    directory: FilePath | None = None


class _StateFile(FileModel):
    directory: FilePath | None = None


class _ViewFile(FileModel):
    socket: FilePath | None = None


class _SigningFile(FileModel):
    key_file: FilePath | None = None
    credential: Name | None = None


class _CompanionFile(FileModel):
    """Keys with a default; which default, the dataclass says."""

    vehicle: FilePath | None = None
    site: FilePath | None = None
    links: list[_LinkFile] = Field(default_factory=list)
    system_id: _Id = 1
    component_id: _Id = 195
    authority: Annotated[Authority, Strict(strict=False)] = Authority.STREAM
    setpoint_rate_hz: Annotated[float, Field(ge=20.0, le=100.0)] = 50.0
    resume: bool = False
    commands: _CommandsFile = Field(default_factory=_CommandsFile)
    replanning: Annotated[Replanning, Section(Replanning)] = Field(default_factory=Replanning)
    supervision: Annotated[Supervision, Section(Supervision)] = Field(default_factory=Supervision)
    recorder: _RecorderFile = Field(default_factory=_RecorderFile)
    state: _StateFile = Field(default_factory=_StateFile)
    view: _ViewFile = Field(default_factory=_ViewFile)
    signing: _SigningFile = Field(default_factory=_SigningFile)


def _findings(file: _CompanionFile) -> Iterator[Finding]:
    seen: dict[str, int] = {}
    for index, link in enumerate(file.links):
        if link.url in seen:
            problem = f"is {link.url!r}, the same as links[{seen[link.url]}]: must be unique"
            yield Finding(("links", index, "url"), problem)
        seen.setdefault(link.url, index)
    yield from _signing_findings(file)
    replanning = file.replanning
    if replanning.min_interval_s > replanning.period_s:
        yield Finding(
            ("replanning", "min_interval_s"),
            f"is {replanning.min_interval_s:g}, must be at most period_s ({replanning.period_s:g})",
        )
    allowed_m = file.supervision.position_uncertainty_m
    limit_m = file.supervision.position_uncertainty_limit_m
    if allowed_m is not None and limit_m < allowed_m:
        problem = f"is {limit_m:g}, must be at least position_uncertainty_m ({allowed_m:g})"
        yield Finding(("supervision", "position_uncertainty_limit_m"), problem)


def _signing_findings(file: _CompanionFile) -> Iterator[Finding]:
    key_file, credential = file.signing.key_file, file.signing.credential
    for name, value in (("key_file", key_file), ("credential", credential)):
        if value is not None and HEXADECIMAL_KEY.fullmatch(Path(value).name):
            problem = f"is {shown(value)}, must be the name of what has the key"
            yield Finding(("signing", name), problem)
            return
    if credential is not None and Path(credential).name != credential:
        problem = f"is {credential!r}, must be the name of a credential, without a folder"
        yield Finding(("signing", "credential"), problem)
    if key_file is None and credential is None:
        problem = "is true, must have a key: signing.key_file or signing.credential"
        for index, link in enumerate(file.links):
            if link.signed:
                yield Finding(("links", index, "signed"), problem)
