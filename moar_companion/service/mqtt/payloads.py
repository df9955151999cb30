"""Payloads of the MQTT topics: the status's values, as JSON. Pure.

Their JSON schemas are shipped in `schemas/`; `moar-companion docs` writes them.

Times (`time_s`, `since_s`, …) are the wall clock's, in seconds since 1970. `null`: unknown, or not
present now. A number that is not finite becomes `null`; NaN never appears. Readers must ignore
unknown fields: later versions may add some.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from ...status_values import (
    AutopilotSection,
    BatteryEntry,
    ByWeight,
    CostEntry,
    EnergySection,
    GateAction,
    HostSection,
    Indices,
    InspectionSection,
    LineEntry,
    LinkSection,
    RiskInput,
    SupervisionSection,
    Triple,
    WaypointEntry,
    WeightChanges,
)

_DECIMALS, _DEGREE_DECIMALS = 4, 7
"""A tenth of a millimetre or a millisecond; 1e-7 degrees are a centimetre."""
_CONFIG = ConfigDict(allow_inf_nan=False)

_Read = TypeVar("_Read")


def payload_of(kind: type[Payload], content: Mapping[str, Any]) -> Payload:
    """The payload of this kind with the values that it has of a content.

    Raises ValidationError where the content does not fit.
    """
    known = {item.name: content[item.name] for item in fields(kind) if item.name in content}
    return TypeAdapter(kind).validate_python(_rounded(known))


def read(kind: type[_Read], data: bytes) -> _Read:
    """A payload as received. Raises ValidationError where it does not fit."""
    return TypeAdapter(kind).validate_json(data)


def written(payload: Payload) -> bytes:
    """The JSON of a payload."""
    return TypeAdapter(type(payload)).dump_json(payload)


def _rounded(value: Any, key: str = "") -> Any:
    """A value for JSON: numbers are rounded, one that is not finite is None."""
    if isinstance(value, float):
        decimals = _DEGREE_DECIMALS if key.endswith("_deg") else _DECIMALS
        return round(value, decimals) + 0.0 if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {name: _rounded(item, name) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(item) for item in value]
    return value


@dataclass(frozen=True, kw_only=True, config=_CONFIG)
class Payload:
    """Payload of a topic. time_s: of the state that it describes."""

    time_s: float


class Online(BaseModel):
    """Birth and last will: the connection of the companion to the broker.

    since_s: when it began; null in a last will, whose time only its receiver knows.
    """

    model_config = ConfigDict(frozen=True, **_CONFIG)

    online: bool
    since_s: float | None = None
    version: str | None = None


@dataclass(frozen=True, kw_only=True, config=_CONFIG)
class MissionPayload(Payload):
    """Mission state and target, and the autopilot's mode.

    target: name of the target, or index of the landing point. text: last text for pilots.
    """

    state: str
    since_s: float | None
    mission: str | None
    target: str | int | None
    mode: str | None
    armed: bool | None
    text: str | None
    text_since_s: float | None


@dataclass(frozen=True, kw_only=True, config=_CONFIG)
class GateEvent(GateAction):
    """Last setpoint that the setpoint gate refused. since_s: time of it."""

    since_s: float


@dataclass(frozen=True, kw_only=True, config=_CONFIG)
class Conditions(SupervisionSection, Payload):
    """Action in force, and the conditions, the gravest first.

    gate: null until it has refused a setpoint.
    """

    gate: GateEvent | None


@dataclass(frozen=True, kw_only=True, config=_CONFIG)
class Risk(Payload):
    """Risk indices with their explanations."""

    risk: Indices


@dataclass(frozen=True, kw_only=True, config=_CONFIG)
class RiskInputs(Payload):
    """Received inputs of the risk indices, by index."""

    inputs: dict[str, list[RiskInput]]


@dataclass(frozen=True, kw_only=True, config=_CONFIG)
class WeightsPayload(Payload):
    """Weights before and after Eq. 9. by_risk: change of each weight by each index."""

    base: ByWeight
    adjusted: ByWeight
    by_risk: WeightChanges
    words: str


@dataclass(frozen=True, kw_only=True, config=_CONFIG)
class PlanPayload(Payload):
    """Adopted plan. time_s: of its adoption. change: of the path before it, as text."""

    status: str
    site: str
    mission: str
    target: str | int | None
    cost: CostEntry | None
    reason: str
    change: str | None
    search_ms: float | None
    path: list[WaypointEntry]


@dataclass(frozen=True, kw_only=True, config=_CONFIG)
class Position(Payload):
    """Position, geodetic and on the site, and motion.

    position_m, velocity_mps: in the site's frame. clearance_m: from the hull to the nearest
    obstacle. error_m: from the setpoint; left_m, left_s: of the path that is flown.
    """

    latitude_deg: float | None
    longitude_deg: float | None
    altitude_amsl_m: float | None
    position_m: Triple | None
    velocity_mps: Triple | None
    speed_mps: float | None
    yaw_rad: float | None
    landed: str | None
    clearance_m: float | None
    error_m: float | None
    left_m: float | None
    left_s: float | None


@dataclass(frozen=True, kw_only=True, config=_CONFIG)
class BatteryPayload(Payload):
    """Reports of the batteries. remaining: of the emptiest that reports it."""

    remaining: float | None
    batteries: list[BatteryEntry]


@dataclass(frozen=True, kw_only=True, config=_CONFIG)
class Energy(EnergySection, Payload):
    """Energy left, and the demand of the mission's rest and of both escape routes.

    factor: measured power over the vehicle file's; source: its origin. better: escape route that
    leaves more.
    """


@dataclass(frozen=True, kw_only=True, config=_CONFIG)
class PerceptionPayload(Payload):
    """Obstacles that the sensor measures, and the place by the line.

    conductors, solids: numbers of them. returns: share of the beams with an echo.
    """

    scan_age_s: float | None
    returns: float
    conductors: int
    solids: int
    line: LineEntry


@dataclass(frozen=True, kw_only=True, config=_CONFIG)
class InspectionPayload(InspectionSection, Payload):
    """Pictures of the views. view: the one at which the flight is, with its phase.

    reason: of its failure. pictures, of: confirmed ones of this inspection, and those that all
    views ask for. failed: views that could not be captured. gimbal: holder of its control.
    """


@dataclass(frozen=True, kw_only=True, config=_CONFIG)
class Health(Payload):
    """Links, sources and computer. age_s: by source of telemetry. recorder: folder of the record.

    refused: packets refused by signed link and reason.
    """

    autopilot: AutopilotSection | None
    link: LinkSection | None
    host: HostSection
    age_s: dict[str, float | None]
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


class Reply(BaseModel):
    """Answer to an order: the words of MAV_RESULT. final: false for IN_PROGRESS alone.

    nonce: of the order; null where it could not be read. reason: for people.
    """

    model_config = ConfigDict(frozen=True, **_CONFIG)

    time_s: float
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
