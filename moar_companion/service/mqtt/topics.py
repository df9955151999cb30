"""The table of MQTT topics, and the payload of each from a status. Pure.

    moar/VEHICLE/NAME

Input: the status of `companion/status`. A topic is published once per period, or when its content
changes. After a new connection all of them are published, since a broker that was restarted may
have lost what it retained.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from pydantic import ValidationError

from . import payloads
from .payloads import Payload, error_words, payload_of, written

ROOT = "moar"
ONLINE, ORDER, REPLY = "online", "order", "reply"
"""Topics outside the table: birth and last will; orders and their answers."""
_NEVER_S = -1e12

Status = Mapping[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class Message:
    """Message to be published."""

    topic: str
    payload: bytes
    qos: int
    retain: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Topic:
    """A row of the table. period_s: None: only on a change, `time_s` aside.

    of: returns the payload of a status; None while there is none.
    """

    name: str
    payload: type[Payload]
    of: Callable[[Status], Mapping[str, Any] | None]
    period_s: float | None
    qos: int
    retain: bool


def _mission(status: Status) -> Mapping[str, Any]:
    mission, autopilot = status["mission"], status["autopilot"]
    return {
        **mission,
        "since_s": _began_s(status, mission["for_s"]),
        "target": mission["goal"],
        "mode": None if autopilot is None else autopilot["mode"],
        "armed": None if autopilot is None else autopilot["armed"],
        "text_since_s": _began_s(status, mission["text_age_s"]),
    }


def _began_s(status: Status, age_s: float | None) -> float | None:
    """Wall-clock time of an age, rounded to a tenth of a second: equal in each status."""
    return None if age_s is None else round(status["time_s"] - age_s, 1)


def _conditions(status: Status) -> Mapping[str, Any]:
    gate = status["gate"]
    event = None if gate is None else {**gate, "since_s": _began_s(status, gate["age_s"])}
    return {**status["supervision"], "gate": event}


def _risk(status: Status) -> Mapping[str, Any]:
    indices = status["risk"].items()
    return {"risk": {name: {**index, "inputs": ()} for name, index in indices}}


def _risk_inputs(status: Status) -> Mapping[str, Any]:
    received = {
        name: [item for item in index["inputs"] if item["age_s"] is not None]
        for name, index in status["risk"].items()
    }
    return {"inputs": received}


def _weights(status: Status) -> Mapping[str, Any]:
    weights: Mapping[str, Any] = status["weights"]
    return weights


def _plan(status: Status) -> Mapping[str, Any] | None:
    plan = status["plan"]
    return None if plan is None else {**plan, "time_s": _began_s(status, plan["age_s"])}


def _position(status: Status) -> Mapping[str, Any]:
    aircraft, path = status["aircraft"], status["path"]
    place = aircraft["global_position"]
    nowhere = dict.fromkeys(("latitude_deg", "longitude_deg", "altitude_amsl_m"))
    not_flown = dict.fromkeys(("error_m", "left_m", "left_s"))
    return {**aircraft, **(place or nowhere), **(path or not_flown)}


def _battery(status: Status) -> Mapping[str, Any]:
    batteries = status["batteries"]
    reported = [item["remaining"] for item in batteries if item["remaining"] is not None]
    return {"batteries": batteries, "remaining": min(reported, default=None)}


def _energy(status: Status) -> Mapping[str, Any] | None:
    energy: Mapping[str, Any] | None = status["energy"]
    return energy


def _perception(status: Status) -> Mapping[str, Any] | None:
    seen = status["perception"]
    return None if seen is None else {**seen, "conductors": len(seen["conductors"])}


def _inspection(status: Status) -> Mapping[str, Any] | None:
    inspection: Mapping[str, Any] | None = status["inspection"]
    return inspection


def _health(status: Status) -> Mapping[str, Any]:
    return status


TOPICS = tuple(
    Topic(name=name, payload=payload, of=of, period_s=period_s, qos=qos, retain=retain)
    for name, payload, of, period_s, qos, retain in (
        ("mission", payloads.MissionPayload, _mission, None, 1, True),
        ("conditions", payloads.Conditions, _conditions, None, 1, True),
        ("plan", payloads.PlanPayload, _plan, None, 1, True),
        ("position", payloads.Position, _position, 0.5, 0, True),
        ("risk", payloads.Risk, _risk, 1.0, 0, True),
        ("risk/inputs", payloads.RiskInputs, _risk_inputs, 5.0, 0, False),
        ("weights", payloads.WeightsPayload, _weights, 1.0, 0, True),
        ("battery", payloads.BatteryPayload, _battery, 2.0, 0, True),
        ("energy", payloads.Energy, _energy, 2.0, 0, True),
        ("perception", payloads.PerceptionPayload, _perception, 2.0, 0, True),
        ("inspection", payloads.InspectionPayload, _inspection, None, 1, True),
        ("health", payloads.Health, _health, 2.0, 0, False),
    )
)
"""Name, payload, its source, period (None: on a change), quality of service, retained."""


def topic_name(vehicle: str, name: str) -> str:
    """The full name of a vehicle's topic."""
    return f"{ROOT}/{vehicle}/{name}"


def online_message(vehicle: str, payload: payloads.Online) -> Message:
    """Birth or last will of a vehicle: retained, at least once."""
    topic, data = topic_name(vehicle, ONLINE), payload.model_dump_json().encode()
    return Message(topic=topic, payload=data, qos=1, retain=True)


class Publication:
    """Selects the topics that are due. now_s: a clock that never goes back."""

    def __init__(self, vehicle: str) -> None:
        self._vehicle = vehicle
        self._due_s: dict[str, float] = {}
        self._published: dict[str, Payload] = {}
        self.unfit: dict[str, str] = {}
        """Last error of each topic whose content did not fit its payload."""

    def start_anew(self) -> None:
        """Records a new connection: all topics are due."""
        self._due_s.clear()
        self._published.clear()

    def due(self, status: Status, now_s: float) -> list[Message]:
        """Messages of a status that are due at a time, in the order of the table.

        Content that does not fit a payload stops its topic alone; `unfit` has the error.
        """
        messages = []
        for topic in TOPICS:
            if now_s < self._due_s.get(topic.name, _NEVER_S):
                continue
            content = topic.of(status)
            if content is None:
                continue
            try:
                payload = payload_of(topic.payload, {"time_s": status["time_s"], **content})
            except ValidationError as error:
                self.unfit[topic.name] = error_words(error)
                continue
            if topic.period_s is None:
                values = replace(payload, time_s=0.0)
                if values == self._published.get(topic.name):
                    continue
                self._published[topic.name] = values
            else:
                self._due_s[topic.name] = self._next_s(topic.name, topic.period_s, now_s)
            messages.append(
                Message(
                    topic=topic_name(self._vehicle, topic.name),
                    payload=written(payload),
                    qos=topic.qos,
                    retain=topic.retain,
                )
            )
        return messages

    def _next_s(self, name: str, period_s: float, now_s: float) -> float:
        """Next time of a topic; late statuses do not shift it, missed periods do not return."""
        next_s = self._due_s.get(name, now_s) + period_s
        return next_s if next_s > now_s else now_s + period_s
