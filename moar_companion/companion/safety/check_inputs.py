"""Inputs of the checks: what one cycle has observed of the flight and of the computer. Values."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from ...mavlink.telemetry import Telemetry
from ...perception.perception_report import LineOffset, SensorHealth
from ...risk import RiskEstimate
from ...settings.perception_config import Perception
from ...types import AutopilotKind, Mission
from ..estimation.pose import Pose
from .file_faults import FileFault

ROUTE_MAX_AGE_S = 15.0
"""Maximum age of escape routes, which are replanned about every 2 s; 15 s of flight correspond to
the longest interval of a battery's reports."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Host:
    """Resources of the computer, in bytes; None where unknown or not required.

    disk_total, memory_total: with what is in use. read_late_s: maximum wait of received data for
    reading in the last second.
    file_faults: faults of the files that the service writes.
    """

    disk_free: float | None = None
    memory_available: float | None = None
    read_late_s: float = 0.0
    file_faults: tuple[FileFault, ...] = ()
    disk_total: float | None = None
    memory_total: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class EscapeRoute:
    """The better escape route. left_s: flight time left after it; None: unknown.

    age_s: since its request. flown_left_s: flight time left after the active exit, where that
    exit takes too much and this route takes clearly less.
    """

    mission: Mission
    left_s: float | None
    reserve_s: float
    age_s: float
    flown_left_s: float | None = None
    exposed_s: float = 0.0
    """Time until the last place from where a battery's action would hit an obstacle is passed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Unmeasured:
    """Causes that no measurement shows, by the name of the condition; None: there is none."""

    autopilot_fence: str | None = None
    autopilot_reboot: str | None = None
    loop_stall: str | None = None
    no_clearance: str | None = None
    offboard_loss_collision: str | None = None
    offboard_loss_unknown: str | None = None
    path_barred: str | None = None
    pilot: str | None = None
    setpoint_held: str | None = None
    setpoint_rejected: str | None = None
    settings_refused: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckInputs:
    """Observations for the checks.

    faults: causes that are known as such. conflict: text about a second autopilot.
    expected: the autopilot of the vehicle file, whose margin is kept; None where it names none.
    position_late_s: extra delay against the fastest position message, by its own clock.
    jumped_m: total of recent position jumps. jump_margin_m: permitted position error here.
    origin_moved_m: distance of the origin from its place at flight begin, or at an operator's last
    override. origin_margin_m: its limit. global_off_m, home_off_m: from the local position, by the
    origin, to the autopilot's other reports of the same place.
    error_m: from the setpoint to the aircraft.
    escaping: an exit or evacuation is flown.
    drifted_m: distance that the wind has moved the aircraft; None while it holds. saturated: tilt
    or motors at their limits. held_wind_mps: maximum wind in which the aircraft can hold.
    stopped: the setpoint does not move although a path is flown.
    excursion: text for an aircraft outside the workspace and its checked legs.
    room_m: from the hull to the nearest keep-out. widening_m: required inflation of keep-outs.
    uncertainty_soon_m: the position's uncertainty, as it will be within seconds at its growth.
    error_hits: name of the obstacle that this reaches, here or where the flight would stop.
    line: the place by the line's wires.
    azimuth_rad: of +x, from north. misread: text for a wrong number of cells in the vehicle file.
    plan_awaited_s: wait for a new inspection plan. fence_silent: the autopilot does not report its
    uploaded fence. parameters_unknown: never reported, and without a most cautious value.
    """

    telemetry: Telemetry
    risk: RiskEstimate
    conflict: str | None = None
    expected: AutopilotKind | None = None
    pose: Pose | None
    position_moved_s: float
    position_late_s: float = math.inf
    jumped_m: float = 0.0
    jump_margin_m: float = math.inf
    origin_moved_m: float = 0.0
    origin_margin_m: float = math.inf
    global_off_m: float | None = None
    home_off_m: float | None = None
    room_m: float | None = None
    widening_m: float = 0.0
    uncertainty_soon_m: float | None = None
    error_hits: str | None = None
    line: LineOffset = field(default_factory=LineOffset)
    azimuth_rad: float | None = None
    misread: str | None = None
    in_control: bool = False
    escaping: bool = False
    landing: bool = False
    error_m: float | None = None
    drifted_m: float | None = None
    saturated: bool = False
    held_wind_mps: float | None = None
    stopped: bool = False
    excursion: str | None = None
    plan_awaited_s: float | None = None
    fence_silent: bool = False
    parameters_unknown: tuple[str, ...] = ()
    escape_route: EscapeRoute | None = None
    exposure: str | None = None
    """Reason to leave before an autopilot failsafe acts; None if there is none."""
    blind_hit: str | None = None
    """Text for the autopilot's action without a position that would hit an obstacle from here."""
    battery_landing: str | None = None
    """Text for a battery's action that comes before the escape route has left exposed places."""
    host: Host = field(default_factory=Host)
    sensing: Perception = field(default_factory=Perception)
    """Settings of the sensor that measures obstacles; its kind is None without one."""
    sensor_health: SensorHealth = field(default_factory=SensorHealth)
    unmapped_s: float | None = None
    """Time for which the maps have lacked an obstacle; None: they have all."""
    faults: Unmeasured = field(default_factory=Unmeasured)
