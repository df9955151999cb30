"""Account of a flight: what it visited, captured and left out, from its recorded messages. Pure.

Inputs: messages of the `.mcap` by topic (`AccountBuilder.take`), rows of `inspection.jsonl`.
Output: `FlightAccount`. Times are wall clock, in seconds since 1970.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from ...planner.site import PlanePoint, Site, Target

TOPICS = frozenset({"/decision", "/aircraft", "/mission", "/telemetry"})
"""Topics of a recording that an account is made of; its site comes from the calls."""
SHOTS = frozenset({"picture", "video"})
"""Kinds of rows that have a place."""
_ROWS = SHOTS | {"view"}
_PATH_STEP_S = 0.5
_BATTERY_STEP_S = 2.0

Row = Mapping[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class Visit:
    """What became of a place of a target.

    outcome: `captured`, `incomplete`, `visited` (of a target without views), `left out`, or `not
    visited`. reason: of a place that is not done. held_s: time there.
    """

    target: Target
    outcome: str
    reason: str
    held_s: float
    shots: tuple[Row, ...]

    @property
    def done(self) -> bool:
        """True if nothing is missing."""
        return self.outcome in {"captured", "visited"}


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightAccount:
    """A flight. path: (time, x, z); battery: (time, fraction); events: (time, kind, text)."""

    name: str
    site: Site
    vehicle: str
    began_s: float
    ended_s: float
    tour: tuple[str, ...]
    visits: tuple[Visit, ...]
    shots: tuple[Row, ...]
    path: tuple[tuple[float, float, float], ...]
    battery: tuple[tuple[float, float], ...]
    events: tuple[tuple[float, str, str], ...]


class AccountBuilder:
    """Takes the messages of a flight in their order."""

    def __init__(self) -> None:
        self._times_s: list[float] = []
        self._path: list[tuple[float, float, float]] = []
        self._battery: list[tuple[float, float]] = []
        self._events: list[tuple[float, str, str]] = []
        self._rows: list[Row] = []
        self._tour: list[str] = []
        self._left_out: dict[str, str] = {}
        self._held_s: dict[str, float] = {}
        self._at: tuple[str, float] | None = None
        """Stop at which the aircraft is, and the time of the last message there."""

    def take(self, topic: str, wall_s: float, message: Mapping[str, Any]) -> None:
        """Takes a message of one of `TOPICS`."""
        self._times_s = [self._times_s[0] if self._times_s else wall_s, wall_s]
        match topic:
            case "/decision":
                self._take_decision(message["kind"], message["time_s"], message["data"])
            case "/aircraft":
                self._take_place(wall_s, message["position_m"])
            case "/mission":
                self._take_mission(wall_s, message["state"], message["goal"])
            case "/telemetry":
                self._take_batteries(wall_s, message["batteries"])

    def _take_decision(self, kind: str, time_s: float, data: Mapping[str, Any]) -> None:
        if kind in _ROWS:
            self._rows.append({"kind": kind, "time_s": time_s, **data})
        elif kind == "tour":
            self._tour += [stop for stop in data["stops"] if stop not in self._tour]
        elif kind == "left_out":
            self._left_out |= dict.fromkeys(data["stops"], data["reason"])
        elif kind == "text":
            self._events.append((time_s, "text", data["text"].removeprefix("MOAR: ")))
        elif kind == "order":
            self._events.append((time_s, "order", f"order: {data['order']}"))

    def _take_place(self, wall_s: float, place_m: list[float] | None) -> None:
        if place_m is not None and (not self._path or wall_s - self._path[-1][0] >= _PATH_STEP_S):
            self._path.append((wall_s, place_m[0], place_m[2]))

    def _take_mission(self, wall_s: float, state: str, goal: str | int | None) -> None:
        here = goal if state == "at_target" and isinstance(goal, str) else None
        if here is not None:
            self._left_out.pop(here, None)  # ordered again
            since_s = self._at[1] if self._at is not None and self._at[0] == here else wall_s
            self._held_s[here] = self._held_s.get(here, 0.0) + wall_s - since_s
        self._at = None if here is None else (here, wall_s)

    def _take_batteries(self, wall_s: float, batteries: Mapping[str, Mapping[str, Any]]) -> None:
        charges = [item["remaining"] for item in batteries.values()]
        known = [charge for charge in charges if charge is not None]
        if known and (not self._battery or wall_s - self._battery[-1][0] >= _BATTERY_STEP_S):
            self._battery.append((wall_s, min(known)))

    def account(
        self, name: str, site: Site, vehicle: str, rows: Iterable[Row] | None
    ) -> FlightAccount:
        """The account. rows: of the inspection's record; None: those of the recording."""
        kept = self._rows if rows is None else [row for row in rows if row["kind"] in _ROWS]
        shots = tuple(row for row in kept if row["kind"] in SHOTS and "stop" in row)
        began_s, ended_s = self._times_s or (0.0, 0.0)
        return FlightAccount(
            name=name,
            site=site,
            vehicle=vehicle,
            began_s=began_s,
            ended_s=ended_s,
            tour=tuple(self._tour),
            visits=tuple(self._visit(target, kept, shots) for target in self._in_order(site)),
            shots=shots,
            path=tuple(self._path),
            battery=tuple(self._battery),
            events=tuple(self._events),
        )

    def _in_order(self, site: Site) -> list[Target]:
        """Places in the order of the tour, those of no tour behind it."""
        order = {stop: index for index, stop in enumerate(self._tour)}
        return sorted(site.targets, key=lambda target: order.get(target.name, len(order)))

    def _visit(self, target: Target, rows: Iterable[Row], shots: tuple[Row, ...]) -> Visit:
        ended = [row for row in rows if row["kind"] == "view" and row["stop"] == target.name]
        last = ended[-1] if ended else None
        outcome, reason = "not visited", ""
        if target.name in self._left_out:
            outcome, reason = "left out", self._left_out[target.name]
        elif target.view is None and target.name in self._held_s:
            outcome = "visited"
        elif last is not None:
            done = last["outcome"] == "done"
            outcome, reason = ("captured" if done else "incomplete"), last["reason"]
        return Visit(
            target=target,
            outcome=outcome,
            reason=reason,
            held_s=self._held_s.get(target.name, 0.0),
            shots=tuple(row for row in shots if row["stop"] == target.name),
        )


def place_of(row: Row) -> PlanePoint:
    """Place (x, z) of a shot."""
    x_m, _, z_m = row["position_m"]
    return x_m, z_m
