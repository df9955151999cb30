"""Values of a replay of a recording, and their JSON (`replay --json`).

All times are seconds since the recording's first packet, and never go back.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayEvent:
    """An event; `kind` is one word, `text` is for readers."""

    time_s: float
    kind: str
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayPlace:
    """Position of the aircraft on a site."""

    position_m: tuple[float, float, float]
    """x, y, z of the site's frame."""
    clearance_m: float | None
    """From its hull to the nearest obstacle; None outside the workspace, or without obstacles."""
    evacuation_s: float | None
    """Flight time of the evacuation planned from there; None where there is none, or none due."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplaySample:
    """State at one instant; None is unknown.

    risk: the four indices by name. why: the deciding input of each now. reasons: the same as text,
    with its value and age. weights: those of an inspection as adjusted by the indices, and the
    effect of each index.
    """

    time_s: float
    risk: Mapping[str, float | None]
    why: Mapping[str, str | None]
    armed: bool | None
    mode: str | None
    mission_state: str | None
    reasons: Mapping[str, str] = field(default_factory=dict)
    weights: Mapping[str, Any] = field(default_factory=dict)
    place: ReplayPlace | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayMeasure:
    """One input of a risk index over the recording."""

    known_s: float
    """Time for which it was known."""
    greatest_risk: float | None
    """None where it was never known."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Replay:
    """A whole recording, replayed.

    inputs: messages by source of telemetry, and the time of the last. measures: the inputs of the
    risk indices, by index and name. sources: senders, with packets received and lost.
    """

    recording: str
    vehicle: str
    """Vehicle whose thresholds define the risk."""
    autopilot: str
    vehicle_type: str | None
    duration_s: float
    samples: tuple[ReplaySample, ...]
    events: tuple[ReplayEvent, ...]
    inputs: Mapping[str, tuple[int, float | None]]
    measures: Mapping[str, Mapping[str, ReplayMeasure]]
    sources: Mapping[tuple[int, int], tuple[int, int]] = field(default_factory=dict)

    def to_json(self) -> str:
        """The JSON document of `replay --json`; one sample and one event a line."""
        head = {
            "recording": self.recording,
            "vehicle": self.vehicle,
            "autopilot": self.autopilot,
            "vehicle_type": self.vehicle_type,
            "duration_s": _rounded(self.duration_s),
            "sources": [
                {
                    "system_id": system_id,
                    "component_id": component_id,
                    "packets": received,
                    "lost": lost,
                }
                for (system_id, component_id), (received, lost) in self.sources.items()
            ],
            "inputs": {
                name: {"messages": messages, "last_s": _rounded(last_s)}
                for name, (messages, last_s) in self.inputs.items()
            },
            "measures": {
                index: {
                    name: {
                        "known_s": _rounded(measure.known_s),
                        "greatest_risk": _rounded(measure.greatest_risk),
                    }
                    for name, measure in measures.items()
                }
                for index, measures in self.measures.items()
            },
        }
        parts = [f"{_dumped(key)}: {_dumped(value)}" for key, value in head.items()]
        events = [
            {"time_s": _rounded(event.time_s), "kind": event.kind, "text": event.text}
            for event in self.events
        ]
        parts.append(f'"events": {_lines(events)}')
        parts.append(f'"samples": {_lines([_sample(sample) for sample in self.samples])}')
        return "{" + ",\n ".join(parts) + "}"


def _sample(sample: ReplaySample) -> dict[str, Any]:
    values: dict[str, Any] = {
        "time_s": _rounded(sample.time_s),
        "risk": {name: _rounded(value) for name, value in sample.risk.items()},
        "why": dict(sample.why),
        "reasons": dict(sample.reasons),
        "weights": _all_rounded(sample.weights),
        "armed": sample.armed,
        "mode": sample.mode,
        "mission_state": sample.mission_state,
    }
    place = sample.place
    if place is not None:
        values |= dict(zip(("x_m", "y_m", "z_m"), map(_rounded, place.position_m), strict=True))
        values["clearance_m"] = _rounded(place.clearance_m)
        values["evacuation_s"] = _rounded(place.evacuation_s)
    return values


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 3)


def _all_rounded(values: Mapping[str, Any]) -> dict[str, Any]:
    """The numbers in a nested mapping rounded."""
    return {
        name: _all_rounded(value)
        if isinstance(value, Mapping)
        else round(value, 3)
        if isinstance(value, float)
        else value
        for name, value in values.items()
    }


def _lines(values: list[dict[str, Any]]) -> str:
    return "[" + ",\n  ".join(map(_dumped, values)) + "]"


def _dumped(value: Any) -> str:
    return json.dumps(value, allow_nan=False)
