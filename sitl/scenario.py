"""Scenarios: timed changes of the conditions, from a YAML file.

    name: wind, then battery
    changes:
      - {at_s: 0, wind_mps: 2, wind_from_deg: 250}
      - {after_takeoff_s: 40, over_s: 30, wind_mps: 9, gust_mps: 1.5}

Inputs: the file. Outputs: a `Scenario`, and a player that writes `Conditions` as time passes.
"""

import reprlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from sitl.conditions import GPS_MODES
from sitl.world import World

_NonNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
_Percent = Annotated[float, Field(ge=0.0, le=100.0, allow_inf_nan=False)]
_Rssi = Annotated[float, Field(ge=0.0, le=254.0, allow_inf_nan=False)]
_STEPPED: Final = frozenset({"drag_per_s", "gps_mode", "satellites"})
_MAX_BYTES: Final = 100_000
"""Some thousand changes; more would take seconds to read."""
_MESSAGES: Final = {
    "model_type": "must be keys and values",
    "list_type": "must be a list",
    "missing": "is missing",
}
_TIMES: Final = frozenset({"at_s", "after_takeoff_s", "over_s"})


class ScenarioError(ValueError):
    """A scenario file that cannot be used; the text is one line for the user."""


class _Change(BaseModel):
    """One change; keys are condition names, units in the names."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    at_s: _NonNegative | None = None
    after_takeoff_s: _NonNegative | None = None
    over_s: _NonNegative = 0.0
    wind_mps: _NonNegative | None = None
    wind_from_deg: Annotated[float, Field(ge=-360.0, le=360.0)] | None = None
    wind_up_mps: Annotated[float, Field(ge=-20.0, le=20.0)] | None = None
    gust_mps: _NonNegative | None = None
    drag_per_s: _NonNegative | None = None
    satellites: Annotated[int, Field(ge=0, le=60)] | None = None
    hdop: Annotated[float, Field(ge=0.3, le=99.0)] | None = None
    vdop: Annotated[float, Field(ge=0.3, le=99.0)] | None = None
    gps_mode: Literal["normal", "no_fix", "silent", "jammed"] | None = None
    gps_noise_factor: _NonNegative | None = None
    battery_percent: _Percent | None = None
    battery_voltage_v: _NonNegative | None = None
    drain_factor: _NonNegative | None = None
    radio_rssi: _Rssi | None = None
    radio_remote_rssi: _Rssi | None = None
    radio_noise: _Rssi | None = None
    link_loss_percent: _Percent | None = None
    link_delay_ms: _NonNegative | None = None
    link_jitter_ms: _NonNegative | None = None
    link_rate_bytes_per_s: Annotated[float, Field(gt=0.0, allow_inf_nan=False)] | None = None

    @model_validator(mode="after")
    def _one_time(self) -> "_Change":
        if (self.at_s is None) == (self.after_takeoff_s is None):
            raise ValueError("exactly one of at_s, after_takeoff_s")
        if not self.targets():
            raise ValueError("at least one condition to change")
        return self

    def targets(self) -> dict[str, Any]:
        """Return the conditions that this change sets."""
        return {
            name: value
            for name, value in self.model_dump().items()
            if value is not None and name not in _TIMES
        }


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    name: str
    changes: list[_Change] = []


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """At `at_s` (simulated time, or time after take-off) move conditions to the targets."""

    at_s: float
    after_takeoff: bool
    over_s: float
    targets: Mapping[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario:
    """A named list of changes."""

    name: str = "calm"
    changes: tuple[Change, ...] = ()

    @staticmethod
    def load(path: Path) -> "Scenario":
        """Read a scenario file; a `ScenarioError` names file, key, value and the allowed values."""
        try:
            with path.open("rb") as file:
                text = file.read(_MAX_BYTES + 1)
            if len(text) > _MAX_BYTES:
                raise ScenarioError(f"{path}: larger than {_MAX_BYTES} bytes")
            data = yaml.safe_load(text.decode())
        except (OSError, UnicodeDecodeError) as error:
            raise ScenarioError(f"{path}: cannot be read: {_reason(error)}") from None
        except RecursionError:
            raise ScenarioError(f"{path}: nested too deeply") from None
        except yaml.YAMLError as error:
            raise ScenarioError(f"{path}: not YAML: {' '.join(str(error).split())}") from None
        return Scenario.parse(data, str(path))

    @staticmethod
    def parse(data: object, source: str) -> "Scenario":
        """Build a scenario from YAML data; `source` names the file in errors."""
        try:
            parsed = _File.model_validate(data)
        except ValidationError as error:
            raise ScenarioError(f"{source}: {_first(error)}") from None
        return Scenario(
            name=parsed.name,
            changes=tuple(
                Change(
                    at_s=change.at_s if change.at_s is not None else change.after_takeoff_s or 0.0,
                    after_takeoff=change.at_s is None,
                    over_s=change.over_s,
                    targets=change.targets(),
                )
                for change in parsed.changes
            ),
        )


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error)


def _first(error: ValidationError) -> str:
    """Return the first finding in one line: key, value, allowed values."""
    detail = error.errors()[0]
    key = "".join(
        f"[{part}]" if isinstance(part, int) else f".{part}" for part in detail["loc"]
    ).lstrip(".")
    if detail["type"] == "extra_forbidden":
        model = _Change if key.startswith("changes[") else _File
        return f"{key}: unknown key; allowed: {', '.join(model.model_fields)}"
    said = detail["msg"].removeprefix("Value error, ").replace("Input should be", "must be")
    message = _MESSAGES.get(detail["type"], said)
    value = detail["input"]
    if isinstance(value, dict | list) or value is None:
        return f"{key or 'file'}: {message}"
    return f"{key or 'file'}: {reprlib.repr(value)}: {message}"


class _Ramp:
    """A change that is under way."""

    def __init__(self, change: Change, start_s: float, world: World) -> None:
        self.start_s = start_s
        self.over_s = change.over_s
        self.steps: dict[str, tuple[float, float]] = {}
        for name, value in change.targets.items():
            if name == "gps_mode":
                world.conditions.gps_mode = GPS_MODES.index(value)
                continue
            if name == "battery_percent":
                now = world.battery.fraction * 100.0
            else:
                now = getattr(world.conditions, name)
            if name in _STEPPED or now is None or change.over_s <= 0.0:
                setattr(world.conditions, name, value)
                continue
            if name == "wind_from_deg":
                now = value - (value - now + 180.0) % 360.0 + 180.0
            self.steps[name] = (float(now), float(value))

    def step(self, now_s: float, world: World) -> bool:
        """Move along; True when the change is complete."""
        if not self.steps:
            return True
        share = min(1.0, (now_s - self.start_s) / self.over_s)
        for name, (start, end) in self.steps.items():
            setattr(world.conditions, name, start + (end - start) * share)
        return share >= 1.0


class ScenarioPlayer:
    """Writes the world's conditions as time passes."""

    def __init__(self, scenario: Scenario) -> None:
        """Start before the first change."""
        self._pending = list(scenario.changes)
        self._ramps: list[_Ramp] = []

    def step(self, world: World) -> None:
        """Start the changes that are due and move the ramps."""
        if not self._pending and not self._ramps:
            return
        now_s = world.now_s
        if self._pending:
            waiting = []
            for change in self._pending:
                start_s: float | None = change.at_s
                if change.after_takeoff:
                    start_s = None if world.took_off_s is None else world.took_off_s + change.at_s
                if start_s is None or now_s < start_s:
                    waiting.append(change)
                else:
                    self._ramps.append(_Ramp(change, now_s, world))
            self._pending = waiting
        self._ramps = [ramp for ramp in self._ramps if not ramp.step(now_s, world)]
