"""Values of the status: one field for each, with its type and meaning.

The status of the live view, the payloads of MQTT, the channels of an .mcap and their schemas are
made of these classes. Units are in the names; positions and velocities are in the site's frame
unless named otherwise; None (null): unknown, or not present now.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter

from .types import GeodeticPoint, Mission

Fraction = Annotated[float, Field(ge=0.0, le=1.0)]
Triple = tuple[float, float, float]
"""x along the plane, y across it, z up."""


def json_dict(value: Any) -> dict[str, Any]:
    """A value as a dict for JSON; several times as fast as dataclasses.asdict."""
    kind: Any = type(value)
    shown: dict[str, Any] = _adapter(kind).dump_python(value)
    return shown


@functools.cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


@dataclass(frozen=True, slots=True, kw_only=True)
class ByWeight:
    """A number for each of the weights k_S, k_T, k_E."""

    safety: float
    time: float
    energy: float


@dataclass(frozen=True, slots=True, kw_only=True)
class AutopilotSection:
    """Last report of the autopilot. ours: in the mode that follows our setpoints."""

    kind: str
    system_id: int
    mode: str
    ours: bool
    armed: bool
    failsafe: bool
    age_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ConditionEntry:
    """A condition against the flight, and the companion's action."""

    name: str
    action: str
    reason: str
    overridden: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class SupervisionSection:
    """Action in force, and the conditions, the gravest first."""

    action: str
    conditions: tuple[ConditionEntry, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class GateAction:
    """Last setpoint that the setpoint gate refused. reason: as text.

    action: held: the setpoint before was sent at rest instead; ended: the stream ended. value,
    limit: in `unit`, of the reason; null where it has none.
    """

    action: Literal["held", "ended"]
    reason: str
    value: float | None
    limit: float | None
    unit: str | None


@dataclass(frozen=True, slots=True, kw_only=True)
class GateSection(GateAction):
    """Last setpoint that the setpoint gate refused, age_s ago."""

    age_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class FailsafeEntry:
    """Action after a loss. trigger: what is lost. by: companion or autopilot.

    after_s: time from the loss to the action; null where the autopilot does not tell.
    """

    trigger: str
    by: str
    action: str
    after_s: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class FailsafesSection:
    """Actions of companion and autopilot after a loss of a link, of GPS, or of the battery."""

    actions: tuple[FailsafeEntry, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionSection:
    """Mission state since for_s. goal: name of the target, or index of the landing point.

    text: last text for pilots.
    """

    state: str
    for_s: float | None
    mission: str | None
    goal: str | int | None
    text: str | None
    text_age_s: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class AircraftSection:
    """Position and motion. clearance_m: from the hull to the nearest obstacle."""

    landed: str | None
    position_m: Triple | None
    position_ned_m: Triple | None
    velocity_mps: Triple | None
    speed_mps: float | None
    yaw_rad: float | None
    clearance_m: float | None
    global_position: GeodeticPoint | None


@dataclass(frozen=True, slots=True, kw_only=True)
class SetpointEntry:
    """The setpoint of this instant."""

    position_m: Triple
    velocity_mps: Triple
    yaw_rad: float


@dataclass(frozen=True, slots=True, kw_only=True)
class PathSection:
    """Path that is flown. error_m: from the setpoint to the aircraft.

    left_m, left_s: to the end of the plan, landing leg included.
    """

    setpoint: SetpointEntry
    error_m: float
    left_m: float
    left_s: float


@dataclass(slots=True, kw_only=True)  # not frozen: hundreds are made a second
class RiskInput:
    """Input of a risk index. reading: its value as text. risk: null where it has none now."""

    name: str
    value: float | None
    unit: str
    reading: str
    age_s: float | None
    risk: float | None


@dataclass(slots=True, kw_only=True)
class InputEntry(RiskInput):
    """An input, and whether it counts now."""

    known: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Index:
    """A risk index. target: value to which it moves. known: false where nothing is measured.

    worst: input with the highest risk. cause: input that decided the value. held: at the last value
    of its cause. words: explanation for people.
    """

    value: Fraction
    target: float | None
    known: bool
    worst: str | None
    cause: str | None
    held: bool
    words: str


@dataclass(frozen=True, slots=True, kw_only=True)
class IndexEntry(Index):
    """A risk index with all its inputs."""

    inputs: tuple[InputEntry, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Indices:
    """The four risk indices of the planner."""

    wind: Index
    communication: Index
    localization: Index
    battery: Index


@dataclass(frozen=True, slots=True, kw_only=True)
class RiskSection:
    """Risk indices with their explanations and all their inputs."""

    wind: IndexEntry
    communication: IndexEntry
    localization: IndexEntry
    battery: IndexEntry


@dataclass(frozen=True, slots=True, kw_only=True)
class BatteryEntry:
    """A battery. charge_state: MAV_BATTERY_CHARGE_STATE."""

    id: int
    remaining: float | None
    voltage_v: float | None
    current_a: float | None
    charge_state: int | None
    age_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class RoutePoint:
    """Corner of a route."""

    x_m: float
    y_m: float
    z_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class RouteEntry:
    """Time and measured battery energy of a route. left_s: flight time left after it.

    age_s: since its request; the oldest part counts. path: of an escape route as it was last
    planned, its start, corners and end; of other routes empty.
    """

    duration_s: float
    energy_wh: float
    left_s: float | None
    age_s: float
    path: tuple[RoutePoint, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class EnergySection:
    """Energy left, and the demand of the mission's rest and of both escape routes.

    left_wh and energies are absolute where the vehicle file has the capacity, else relative.
    factor: measured power over the vehicle file's; source: its origin. better: escape route that
    leaves more.
    """

    left_wh: float | None
    flight_s: float | None
    factor: float
    source: str
    finish: RouteEntry | None
    exit: RouteEntry | None
    evacuation: RouteEntry | None
    better: Mission | None


@dataclass(frozen=True, slots=True, kw_only=True)
class AdaptationEntry:
    """Rule of the weights. calibrated: its front of trade-offs is known."""

    kind: str
    calibrated: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class WeightChanges:
    """Change of each weight by each risk index."""

    wind: ByWeight
    communication: ByWeight
    localization: ByWeight
    battery: ByWeight


@dataclass(frozen=True, slots=True, kw_only=True)
class WeightsSection:
    """Weights before and after their adaptation. by_risk: change of each weight by each index."""

    adaptation: AdaptationEntry
    base: ByWeight
    adjusted: ByWeight
    by_risk: WeightChanges
    words: str


@dataclass(frozen=True, slots=True, kw_only=True)
class CostEntry:
    """Cost J of the plan, and its unweighted sums (time in s)."""

    total: float
    safety: float
    time: float
    energy: float


@dataclass(frozen=True, slots=True, kw_only=True)
class WaypointEntry:
    """Corner of the path, with the landing leg. time_s: since its start."""

    x_m: float
    y_m: float = 0.0
    z_m: float
    speed_mps: float
    time_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanSection:
    """Adopted plan. change: of the path before it, as text. path: its start, corners and end.

    paths, replans: numbers of adopted paths and of requests for a better one.
    """

    status: str
    site: str
    mission: str
    target: str | int | None
    cost: CostEntry | None
    search_ms: float | None
    age_s: float
    reason: str
    change: str | None
    path: tuple[WaypointEntry, ...]
    paths: int
    replans: int


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkSection:
    """Packets on the autopilot's link."""

    packets_received: int
    packets_lost: int
    packets_late: int
    rate_hz: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class RadioSection:
    """The telemetry radio's report, in its own units, here and at the remote end."""

    kind: str
    rssi: float | None
    remote_rssi: float | None
    noise: float | None
    remote_noise: float | None
    transmit_buffer_percent: float | None
    age_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenEntry:
    """A conductor that the sensor tracks. deviation_m: standard deviation of its place."""

    name: str
    x_m: float
    z_m: float
    deviation_m: float
    age_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class LineEntry:
    """Place of the line by its wires. offset_m: (x, z), to be added to the autopilot's estimate.

    applied_m: the part of it with which the aircraft is flown. covariance_m2: of x, of x with z, of
    z. heading_offset_rad: to be added to the autopilot's heading. wires: number that the last
    matching scan had, age_s ago.
    """

    offset_m: tuple[float, float]
    applied_m: tuple[float, float]
    covariance_m2: tuple[float, float, float] | None
    heading_offset_rad: float | None
    wires: int
    age_s: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class PerceptionSection:
    """The sensor. returns: share of the beams with an echo. refused: number of packets.

    refusal: reason, while all packets are refused. late: number of scans that were dropped. solids:
    number of other obstacles.
    """

    scan_age_s: float | None
    returns: float
    refused: int
    refusal: str | None
    late: int
    conductors: tuple[SeenEntry, ...]
    solids: int
    line: LineEntry


@dataclass(frozen=True, slots=True, kw_only=True)
class InspectionSection:
    """Pictures of the views. view: the one at which the flight is, with its phase.

    reason: of its failure. pictures, of: confirmed ones of this inspection, and those that all
    views ask for. failed: views that could not be captured. gimbal: holder of its control.
    """

    view: str | None
    phase: str | None
    reason: str | None
    pictures: int
    of: int
    failed: tuple[str, ...]
    camera: str | None
    gimbal: str


@dataclass(frozen=True, slots=True, kw_only=True)
class HostSection:
    """Companion computer. read_late_s: longest wait of received data in the last second."""

    disk_free_mb: float | None
    memory_free_mb: float | None
    read_late_s: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Status:
    """Status of the companion at one instant. time_s: wall clock, seconds since 1970.

    gate: null until it has refused a setpoint. failsafes: null until the autopilot's parameters are
    known. batteries: by id. refused: packets refused by signed link and reason. age_s: by source of
    telemetry. parameters: values that were set above the files, by name. recorder: folder of the
    record.
    """

    time_s: float
    autopilot: AutopilotSection | None
    supervision: SupervisionSection
    gate: GateSection | None
    failsafes: FailsafesSection | None
    mission: MissionSection
    aircraft: AircraftSection
    path: PathSection | None
    risk: RiskSection
    batteries: tuple[BatteryEntry, ...]
    energy: EnergySection | None
    weights: WeightsSection
    plan: PlanSection | None
    link: LinkSection | None
    refused: dict[str, dict[str, int]] | None
    radio: RadioSection | None
    age_s: dict[str, float | None]
    perception: PerceptionSection | None
    inspection: InspectionSection | None
    """None without a site that has views."""
    host: HostSection
    parameters: dict[str, float]
    recorder: str | None
