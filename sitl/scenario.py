"""Scenarios: timed changes of the conditions, from a YAML file.

    name: wind, then battery
    changes:
      - {at_s: 0, wind_mps: 2, wind_from_deg: 250}
      - {after_takeoff_s: 40, over_s: 30, wind_mps: 9, gust_mps: 1.5}

Inputs: the file. Outputs: a `Scenario`, and a player that writes `Conditions` as time passes.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from sitl.conditions import GPS_MODES
from sitl.world import World
from sitl.yaml_input import load_yaml, validated

_NonNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
_Percent = Annotated[float, Field(ge=0.0, le=100.0, allow_inf_nan=False)]
_Rssi = Annotated[float, Field(ge=0.0, le=254.0, allow_inf_nan=False)]
_STEPPED: Final = frozenset({"drag_per_s", "gps_mode", "satellites"})
_TIMES: Final = frozenset({"at_s", "after_takeoff_s", "over_s"})


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
    heading_error_deg: Annotated[float, Field(ge=-180.0, le=180.0)] | None = None
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
        """Read a scenario file; a `BadInputError` names file, key, value and the allowed values."""
        return Scenario.parse(load_yaml(path), str(path))

    @staticmethod
    def parse(data: object, source: str) -> "Scenario":
        """Build a scenario from YAML data; `source` names the file in errors."""
        parsed = validated(_File, data, source)
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
