"""The service's configuration: `configs/companion.yaml` and the command line's overrides.

`shipped_configs()`: the folder of the configurations that come with the program.
"""

from __future__ import annotations

import enum
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import Annotated

from pydantic import Field

from . import yaml_file
from .link_config import KeySource, LinkConfig, LinkRole, link_findings
from .mqtt_config import ORDER_LINK, Mqtt, mqtt_findings
from .page_config import PAGE_LINK, PageConfig, page_findings
from .perception_config import Perception, perception_findings
from .yaml_file import FileFinding
from .yaml_schema import FileModel, LinkUrl, Section, under

_Seconds = Field(gt=0.0, le=3_600.0)
_Patience = Field(ge=1.0, le=3_600.0)
_Period = Field(ge=0.1, le=3_600.0)
_Id = Annotated[int, Field(ge=1, le=255)]
_Ids = Annotated[tuple[_Id, ...] | None, Field(min_length=1)]
SLOWEST_HZ, FASTEST_HZ = 20.0, 100.0
"""Rates of setpoints. At the smallest one a cycle may still be a whole period late: its output is
discarded, and the reference held back, after 0.1 s (`service/app`, `companion/companion`)."""


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

    systems: _Ids = None
    """System ids that may command; none: those of ground stations (240 to 255), and the vehicle's
    own. This ignores commands that the companion of another vehicle sends to all. An id does not
    prove who the sender is."""
    components: _Ids = None
    """Component ids that may command; none: any, since ground stations choose theirs freely."""
    links: Annotated[tuple[LinkUrl, ...] | None, Field(min_length=1)] = None
    """URLs of the links (`links[].url`) on which commands are accepted; none: all, since many have
    their ground station behind the autopilot."""
    signed_only: bool = False
    """A command must come in a packet with a correct MAVLink 2 signature, so only from links with
    `signed: true`. Not by default: few ground stations sign, and all others would be refused."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Replanning:
    """Conditions for replanning in flight."""

    period_s: Annotated[float, _Period] = 2.0
    """Longest time between two plans."""
    risk_change: Annotated[float, Field(ge=0.001, le=1.0)] = 0.1
    """Change of a risk index since the last plan that causes the next."""
    min_interval_s: Annotated[float, _Period] = 0.3
    """Shortest time between two plans; at most `period_s`."""
    improvement: Annotated[float, Field(ge=0.0, le=1.0)] = 0.005
    """Fraction of its cost J that a new path must save; otherwise the active path stays while it is
    free. Paths between which noise on the risks switches differ by less; a wind that rises to 0.8
    saves 0.01."""


class VisitOrder(str, enum.Enum):
    """Order in which an inspection visits its targets and their views."""

    BEST = "best"
    """Of least total cost J, exit included."""
    FILE = "file"
    """As in the site file."""


class LinkLoss(str, enum.Enum):
    """Action without a ground station."""

    CONTINUE = "continue"
    HOLD = "hold"
    EXIT = "exit"


@dataclass(frozen=True, slots=True, kw_only=True)
class Supervision:
    """Limits of a flight; safety/conditions.py defines the effect of each."""

    position_timeout_s: Annotated[float, _Seconds] = 0.5
    """An older position ends the stream (LOCAL_POSITION_NED comes at 30 to 40 Hz)."""
    heartbeat_timeout_s: Annotated[float, _Seconds] = 3.0
    """Time without any packet of the autopilot, a heartbeat or another, until its link is lost."""
    mode_timeout_s: Annotated[float, _Seconds] = 3.0
    """A mode that was reported longer ago ends control: it may have changed. ArduPilot reports it
    20 times a second on request, PX4 three times (CURRENT_MODE twice and when it changes, HEARTBEAT
    once): on a link that loses 30 % a gap of this length occurs once in 10^31 reports of ArduPilot,
    once in some 7 hours of PX4."""
    armed_timeout_s: Annotated[float, _Seconds] = 15.0
    """An armed state that was reported longer ago ends control. Only HEARTBEAT reports it, on PX4
    once a second: on a link that loses 30 %, such a gap occurs once in 10^7."""
    ready_timeout_s: Annotated[float, _Patience] = 30.0
    """Time for which a hold is offered to the pilot, until the pilot selects the mode."""
    plane_tolerance_m: Annotated[float, Field(ge=0.1, le=1_000.0)] = 2.0
    """Greatest distance from the site's plane in flight."""
    wind_limit_mps: Annotated[float, Field(ge=0.1, le=100.0)] = 15.0
    """Greatest measured wind: the greater of the reported one and that from the tilt. With the
    default drag the tilt yields 15 m/s for a true 13 and 18 (two recorded quadrotors): 12 is a good
    limit once the vehicle's drag is measured (`replay --fit-drag`)."""
    localization_limit: Annotated[float, Field(ge=0.01, le=1.0)] = 0.9
    """Greatest localization risk of a mission; close to its maximum."""
    position_uncertainty_m: Annotated[float | None, Field(ge=0.0, le=100.0)] = None
    """Position error that distances from obstacles allow for, even where less is reported; none:
    the error measured with the vehicle's autopilot."""
    position_uncertainty_limit_m: Annotated[float, Field(ge=0.01, le=100.0)] = 2.0
    """Uncertainty of the position above which no mission is flown, at least
    `position_uncertainty_m`. Obstacles grow by the excess over that one."""
    battery_reserve: Annotated[float, Field(ge=0.0, le=1.0)] = 0.2
    """Fraction of the charge at which the exit begins."""
    ground_link_lost_s: Annotated[float, _Patience] = 10.0
    """Time since the operator's ground station was received (that of the last order, before one
    any) until it is lost. Both autopilots regard it as lost after 10 s, too."""
    ground_link_action: LinkLoss = LinkLoss.HOLD
    """Action when the ground station is lost."""
    exposure_limit_s: Annotated[float, _Patience] = 120.0
    """Longest stay, beyond the target's dwell, where a failsafe of the autopilot without a forecast
    (RC, GCS or GPS loss) would hit an obstacle: a long inspection of a splice. The next target or
    order restarts the time."""
    exposure_reserve_s: Annotated[float, Field(ge=0.0, le=3_600.0)] = 30.0
    """Flight time that must remain until the autopilot's battery action, after the last place from
    which that action would hit an obstacle: in a gust a forecast of the charge is off by as
    much."""
    failsafe_action: LossCheck = LossCheck.WARN
    """Response to a plan on which the autopilot would hit an obstacle when RC or GCS are lost, or
    when GPS is lost where no leg to a refuge helps. A warning by default: links are rarely lost,
    and places above a conductor usually exposed. Where the autopilot would stop its motors, `check`
    is NO GO for both values."""
    jump_limit_m: Annotated[float, Field(gt=0.0, le=1_000.0)] = 3.0
    """Greatest jump of the position within 10 s that the setpoint follows; a greater one needs an
    operator's decision."""
    plan_stale_s: Annotated[float, _Patience] = 12.0
    """Longest wait of an inspection for a new plan in flight; after half of it the flight slows
    down. Plans take milliseconds; without an answer the request is repeated after 5 s: twice."""
    disk_free_mb: Annotated[float, Field(ge=0.0, le=1e6)] = 200.0
    """Free disk space, below which no inspection starts: an hour of recording takes about 100
    MB."""
    memory_free_mb: Annotated[float, Field(ge=0.0, le=1e6)] = 100.0
    """Available memory of the computer, below which the exit is flown."""
    fence_margin_m: Annotated[float, Field(ge=0.0, le=100.0)] = 1.5
    """Distance of plans and setpoints from the autopilot's own fence; ArduPilot's `FENCE_MARGIN`
    where that is more. PX4's greatest distance from its setpoint was 1.15 m, and half a cell of 0.3
    m is rounding. The stopping distance, by the speed, is kept in addition."""
    loss_action: LossCheck = LossCheck.REFUSE
    """Response to a plan on which the autopilot, after a companion failure, would land or return
    through an obstacle, or return on an unknown route (`RTL_TYPE` not 0); and to one that ArduPilot
    cannot follow (`WP_ACC`, `WP_ACC_Z`, before 4.7 `WPNAV_ACCEL`, `WPNAV_ACCEL_Z`, below
    `guidance.acceleration_mps2`). A parameter corrects it, and a text in flight is easily
    missed."""


class OnFailure(str, enum.Enum):
    """What follows a view that could not be captured."""

    HOLD = "hold"
    """Hold there; `continue` tries the view again."""
    SKIP = "skip"
    """Leave out the target's other views, too."""
    CONTINUE = "continue"
    """Leave out this view alone."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Inspection:
    """Visits of the targets, and pictures and video of their views."""

    order: VisitOrder = VisitOrder.BEST
    """Order in which an order's targets and views are visited: `best`, of least total cost J, exit
    included, or that of the `file`."""
    on_failure: OnFailure = OnFailure.HOLD
    """What follows a view that could not be captured: `hold` there, `skip` the target's other
    views, too, or `continue` with the next view."""
    aim_deg: Annotated[float, Field(ge=0.1, le=45.0)] = 2.0
    """Greatest angle between the camera's axis and the aim point in a picture: a tenth of the
    height of most pictures is 4° or more."""
    position_m: Annotated[float, Field(ge=0.05, le=10.0)] = 0.7
    """Greatest distance from the place of the view in a picture; the gimbal aims from wherever the
    aircraft is."""
    speed_mps: Annotated[float, Field(ge=0.02, le=5.0)] = 0.3
    """Greatest speed in a picture: 4 m from a conductor, at 1/500 s, 0.3 m/s is a blur of 0.4
    pixels of a camera with 4000 pixels over 70°."""
    turn_rate_dps: Annotated[float, Field(ge=0.1, le=90.0)] = 5.0
    """Greatest turn rate of the aircraft in a picture, a blur of 0.5 pixels of the same camera;
    with a gimbal, whose yaw follows the nose, in roll and pitch four times as much."""
    settle_s: Annotated[float, Field(ge=0.0, le=60.0)] = 1.0
    """Time for which all limits hold before a picture, and least time between two."""
    timeout_s: Annotated[float, _Patience] = 20.0
    """Longest wait for the gimbal, and then for steady flight, until the view has failed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RecorderSettings:
    """Recordings of flights."""

    enabled: bool = True
    """Flights are recorded."""
    directory: Path | None = None
    """Folder of the recordings; none: `flights` in the folder that systemd gives
    (`STATE_DIRECTORY`), without that no recording."""
    part_mb: Annotated[float, Field(ge=1.0, le=1e6)] = 256.0
    """Size of an `.mcap` at which the next part begins: Foxglove opens a file of this size at
    once."""
    part_min: Annotated[float, Field(ge=1.0, le=1e4)] = 60.0
    """Age of a part at which the next one begins."""
    keep_gb: Annotated[float, Field(ge=0.1, le=1e6)] = 20.0
    """Size of all recordings in the folder above which the oldest are removed: over 100 hours of
    flight."""
    floor_mb: Annotated[float, Field(ge=0.0, le=1e6)] = 300.0
    """Free disk space below which the oldest are removed; when none is left the recording ends, and
    the flight continues. It is above `supervision.disk_free_mb`: recordings alone never cause a
    condition."""


@dataclass(frozen=True, slots=True, kw_only=True)
class State:
    """The mission's state, kept after the process."""

    directory: Path | None = None
    """Folder of `mission.json`, from which a process that is started after a crash reads the
    interrupted mission, and of `parameters.json`, with what was set in flight; none: the folder
    that systemd gives (`STATE_DIRECTORY`), without that no state is kept."""


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """The live view."""

    socket: Path | None = None
    """Unix socket of `moar-companion view`; none: `view.sock` in the folder that systemd gives
    (`RUNTIME_DIRECTORY`), without that there is no view."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CompanionConfig:
    """Complete configuration of the service at its start."""

    vehicle: Path
    """The vehicle file; may be left out where the command line gives one."""
    site: Path | None = None
    """The site file; none: telemetry and risk only."""
    links: tuple[LinkConfig, ...] = (LinkConfig(url="udp:127.0.0.1:14540"),)
    """Links to the autopilot and to operators."""
    system_id: _Id = 1
    """System id until an autopilot is received; then its id."""
    component_id: _Id = 195
    """Component id; 195 is MAV_COMP_ID_PATHPLANNER."""
    authority: Authority = Authority.STREAM
    """`observe` never streams; `stream` does when the pilot has selected the mode; `engage` may
    also request modes and LAND on an operator's order."""
    setpoint_rate_hz: Annotated[float, Field(ge=SLOWEST_HZ, le=FASTEST_HZ)] = 50.0
    """Rate of the setpoints, and of the cycle."""
    resume: bool = False
    """A mode that is selected again resumes the mission without a new command. Exception: a release
    meanwhile (a failsafe, a restart, stale data). On PX4 a command is necessary anyway, since PX4
    gives OFFBOARD to a stream only."""
    commands: Commands = field(default_factory=Commands)
    replanning: Replanning = field(default_factory=Replanning)
    inspection: Inspection = field(default_factory=Inspection)
    supervision: Supervision = field(default_factory=Supervision)
    recorder: RecorderSettings = field(default_factory=RecorderSettings)
    state: State = field(default_factory=State)
    view: View = field(default_factory=View)
    signing: KeySource = field(default_factory=KeySource)
    mqtt: Mqtt = field(default_factory=Mqtt)
    page: PageConfig = field(default_factory=PageConfig)
    perception: Perception = field(default_factory=Perception)
    file: Path | None = field(default=None, compare=False)
    """File that it was read from; None without a file."""

    @property
    def has_signed_links(self) -> bool:
        """True if at least one link is signed."""
        return any(link.signed for link in self.links)

    @property
    def session_links(self) -> dict[str, LinkRole]:
        """Links of the companion and their roles, with those of orders from MQTT and the page."""
        links = {link.url: link.role for link in self.links}
        taken = {ORDER_LINK: self.mqtt.takes_orders, PAGE_LINK: self.page.takes_orders}
        return links | {name: LinkRole.OPERATOR for name, takes in taken.items() if takes}

    @classmethod
    def load(
        cls, path: str | PathLike[str], *, vehicle: str | PathLike[str] | None = None
    ) -> CompanionConfig:
        """The configuration in a YAML file; relative paths in it are relative to that file.

        `vehicle` is the vehicle file of the command line: it replaces the one in the file, which
        may then be missing. Raises InputError with one line when the file cannot be used.
        """

        def config_of(model: FileModel) -> CompanionConfig:
            given = {} if "vehicle" in model.model_fields_set else {"vehicle": None}
            return under(Path(path).parent, COMPANION_FILE.filled(model, **given))

        def check(model: FileModel) -> Iterator[FileFinding]:
            config = config_of(model)
            if config.vehicle is None and vehicle is None:
                yield FileFinding(("vehicle",), "is missing")
            yield from config_findings(config)

        config = config_of(yaml_file.read(path, COMPANION_FILE.schema, check))
        named = config.vehicle if vehicle is None else Path(vehicle)
        return replace(config, vehicle=named, file=Path(path))


COMPANION_FILE = Section(CompanionConfig, optional=frozenset({"vehicle"}), without="file")


def config_findings(config: CompanionConfig) -> Iterator[FileFinding]:
    """Yields the faults across the keys of a configuration."""
    yield from link_findings(config.links, config.signing)
    yield from mqtt_findings(config.mqtt)
    yield from page_findings(config.page)
    yield from perception_findings(config.perception)
    replanning, limits = config.replanning, config.supervision
    if replanning.min_interval_s > replanning.period_s:
        yield FileFinding(
            ("replanning", "min_interval_s"),
            f"is {replanning.min_interval_s:g}, must be at most period_s ({replanning.period_s:g})",
        )
    allowed_m, limit_m = limits.position_uncertainty_m, limits.position_uncertainty_limit_m
    if allowed_m is not None and limit_m < allowed_m:
        problem = f"is {limit_m:g}, must be at least position_uncertainty_m ({allowed_m:g})"
        yield FileFinding(("supervision", "position_uncertainty_limit_m"), problem)
