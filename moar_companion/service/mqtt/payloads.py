"""Payloads of the MQTT topics: pydantic models, written as JSON. Pure.

Their JSON schemas are shipped in `schemas/`; `moar-companion docs` writes them.

Units are in the names. Times (`time_s`, `since_s`, …) are the wall clock's, in seconds since 1970.
`null`: unknown, or not present now. A number that is not finite becomes `null`; NaN never appears.
Readers must ignore unknown fields: later versions may add some.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
)

_DECIMALS, _DEGREE_DECIMALS = 4, 7
"""A tenth of a millimetre or a millisecond; 1e-7 degrees are a centimetre."""


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, _DECIMALS) + 0.0


def _rounded_degrees(value: float) -> float:
    return round(value, _DEGREE_DECIMALS) + 0.0


Number = Annotated[float | None, BeforeValidator(_finite), AfterValidator(_rounded)]
Known = Annotated[float, AfterValidator(_rounded)]
Degrees = Annotated[float, AfterValidator(_rounded_degrees)]
Fraction = Annotated[float, Field(ge=0.0, le=1.0), AfterValidator(_rounded)]
Point = Annotated[list[Known], Field(min_length=3, max_length=3)]
"""Position or velocity in the site's frame: x along the plane, y across it, z up."""


class Part(BaseModel):
    """Part of a payload. Values of a status that the model does not have are left out."""

    model_config = ConfigDict(extra="ignore", allow_inf_nan=False, frozen=True)


class Payload(Part):
    """Payload of a topic. time_s: of the state that it describes."""

    time_s: Known


class Online(Part):
    """Birth and last will: the connection of the companion to the broker.

    since_s: when it began; null in a last will, whose time only its receiver knows.
    """

    online: bool
    since_s: Number = None
    version: str | None = None


class MissionPayload(Payload):
    """Mission state and target, and the autopilot's mode.

    target: name of the target, or index of the landing point. text: last text for pilots.
    """

    state: str
    since_s: Number
    mission: str | None
    target: str | int | None
    mode: str | None
    armed: bool | None
    text: str | None
    text_since_s: Number


class ConditionPayload(Part):
    """A condition against the flight, and the companion's action."""

    name: str
    action: str
    reason: str
    overridden: bool


class Conditions(Payload):
    """Action in force, and the conditions, the gravest first."""

    action: str
    conditions: list[ConditionPayload]


class Index(Part):
    """A risk index. target: value to which it moves. known: false where nothing is measured.

    worst: input with the highest risk. cause: input that decided the value. held: at the last value
    of its cause. words: explanation for people.
    """

    value: Fraction
    target: Number
    known: bool
    worst: str | None
    cause: str | None
    held: bool
    words: str


class Indices(Part):
    """The four risk indices of the planner."""

    wind: Index
    communication: Index
    localization: Index
    battery: Index


class Risk(Payload):
    """Risk indices with their explanations."""

    risk: Indices


class RiskInput(Part):
    """Input of a risk index. reading: its value as text. risk: null where it has none now."""

    name: str
    value: Number
    unit: str
    reading: str
    age_s: Number
    risk: Number


class RiskInputs(Payload):
    """Received inputs of the risk indices, by index."""

    inputs: dict[str, list[RiskInput]]


class WeightSet(Part):
    """Weights k_S, k_T and k_E."""

    safety: Known
    time: Known
    energy: Known


class WeightsPayload(Payload):
    """Weights before and after Eq. 9. by_risk: change of each weight by each index."""

    base: WeightSet
    adjusted: WeightSet
    by_risk: dict[str, WeightSet]
    words: str


class Costs(Part):
    """Cost J of the plan, and its unweighted sums (time in s)."""

    total: Known
    safety: Known
    time: Known
    energy: Known


class Waypoint(Part):
    """Corner of the path, with the landing leg. time_s: since its start."""

    x_m: Known
    y_m: Known = 0.0
    z_m: Known
    speed_mps: Known
    time_s: Known


class PlanPayload(Payload):
    """Adopted plan. time_s: of its adoption. change: of the path before it, as text."""

    status: str
    site: str
    mission: str
    target: str | int | None
    cost: Costs | None
    reason: str
    change: str | None
    search_ms: Number
    path: list[Waypoint]


class Position(Payload):
    """Position and motion.

    position_m, velocity_mps: in the site's frame. clearance_m: from the hull to the nearest
    obstacle. error_m: from the setpoint; left_m, left_s: of the path that is flown.
    """

    latitude_deg: Degrees | None
    longitude_deg: Degrees | None
    altitude_amsl_m: Number
    position_m: Point | None
    velocity_mps: Point | None
    speed_mps: Number
    yaw_rad: Number
    landed: str | None
    clearance_m: Number
    error_m: Number
    left_m: Number
    left_s: Number


class OneBattery(Part):
    """A battery. charge_state: MAV_BATTERY_CHARGE_STATE."""

    id: int
    remaining: Number
    voltage_v: Number
    current_a: Number
    charge_state: int | None
    age_s: Number


class BatteryPayload(Payload):
    """Reports of the batteries. remaining: of the emptiest that reports it."""

    remaining: Number
    batteries: list[OneBattery]


class Route(Part):
    """Demand of a route. left_s: flight time left after it."""

    duration_s: Number
    energy_wh: Number
    left_s: Number
    age_s: Number


class Energy(Payload):
    """Energy left, and the demand of the mission's rest and of both escape routes.

    factor: measured power over the vehicle file's; source: its origin. better: escape route that
    leaves more.
    """

    left_wh: Number
    flight_s: Number
    factor: Number
    source: str | None
    finish: Route | None
    exit: Route | None
    evacuation: Route | None
    better: str | None


class AutopilotPayload(Part):
    """Last report of the autopilot. ours: in the mode that follows our setpoints."""

    kind: str
    system_id: int
    mode: str
    ours: bool
    armed: bool
    failsafe: bool
    age_s: Number


class LinkPayload(Part):
    """Packets on the autopilot's link."""

    packets_received: int
    packets_lost: int
    packets_late: int
    rate_hz: Number


class HostPayload(Part):
    """Companion computer. read_late_s: longest wait of received data in the last second."""

    disk_free_mb: Number
    memory_free_mb: Number
    read_late_s: Number


class Health(Payload):
    """Links, sources and computer. age_s: by source of telemetry. recorder: folder of the record.

    refused: packets refused by signed link and reason.
    """

    autopilot: AutopilotPayload | None
    link: LinkPayload | None
    host: HostPayload
    age_s: dict[str, Number]
    refused: dict[str, dict[str, int]] | None
    recorder: str | None


class OrderPayload(BaseModel):
    """Order to the companion, as the operator's side writes it; see `orders`.

    mission: hold, inspection, exit, evacuation, release, pause or continue. target: index of the
    target or landing point; null: all targets in turn, any landing point. time_s: when it was
    given. nonce: a new random text for each order.
    """

    model_config = ConfigDict(
        strict=True, extra="forbid", allow_inf_nan=False, frozen=True, title="Order"
    )

    mission: Literal["hold", "inspection", "exit", "evacuation", "release", "pause", "continue"]
    target: Annotated[int, Field(ge=0, le=65_535)] | None = None
    time_s: float
    nonce: Annotated[str, Field(min_length=16, max_length=64, pattern=r"^[A-Za-z0-9_-]+$")]


Order = OrderPayload
"""The name by which programs import it that sign orders (configs/MQTT.md)."""


class Reply(Part):
    """Answer to an order: the words of MAV_RESULT. final: false for IN_PROGRESS alone.

    nonce: of the order; null where it could not be read. reason: for people.
    """

    time_s: Known
    nonce: str | None
    result: Literal[
        "ACCEPTED",
        "TEMPORARILY_REJECTED",
        "DENIED",
        "UNSUPPORTED",
        "FAILED",
        "IN_PROGRESS",
        "CANCELLED",
    ]
    final: bool
    reason: str = ""


def error_words(error: ValidationError) -> str:
    """First error of a payload that does not fit its model: the field and what is wrong."""
    first = error.errors(include_url=False, include_context=False, include_input=False)[0]
    field = ".".join(str(part) for part in first["loc"])
    return f"{field or 'payload'}: {first['msg']}"
