"""The machine with a log of its calls: all inputs, in order, and the results.

A call is a method's name, its arguments and its result; the first one, `start`, is the
construction. The same calls on a new machine give the same results, byte for byte: the machine has
no clock, no random numbers and no files. `replay.exact` replays them.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from ...companion.companion import Companion
from ...companion.mission_snapshot import MissionSnapshot
from ...companion.planning.map_jobs import MapAnswer
from ...companion.planning.plan_jobs import PlanAnswer
from ...companion.planning.site_maps import SiteMaps
from ...companion.safety.check_inputs import Host
from ...mavlink.peers import Address
from ...mavlink.signing import Signing
from ...perception.perception_report import PerceptionReport
from ...planner.site import Site
from ...settings.config import CompanionConfig
from ...settings.flight_parameters import FlightParameters
from ...settings.vehicle import Vehicle
from .answers import answer_encoded
from .value_codec import decoded, encoded

START = "start"
INPUTS = (
    "receive",
    "take_in",
    "await_planner",
    "take_ground",
    "note_host",
    "note_wall_clock",
    "plan_answered",
    "contingency_answered",
    "perceived",
    "maps_answered",
    "note_sent",
    "tick",
    "shut_down",
)
OUTPUTS = (
    "control_to_send",
    "data_to_send",
    "plan_jobs",
    "contingency_jobs",
    "map_jobs",
    "pose_notes",
    "decisions",
)
"""Calls whose results are compared; they change the machine, too: they empty its queues."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Call:
    """One call of the machine."""

    method: str
    arguments: tuple[Any, ...] = ()
    options: Mapping[str, Any] = field(default_factory=dict)
    result: Any = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Start:
    """Construction of a machine. site: of its ground; None: without a planner, or not yet.

    Of signed links: the start of their time stamps, never the key.
    """

    config: CompanionConfig
    vehicle: Vehicle
    site: Site | None = None
    before: MissionSnapshot | None = None
    signed: bool = False
    wall_s: float = 0.0
    kept: Mapping[str, int] = field(default_factory=dict)
    references: Mapping[str, int] = field(default_factory=dict)
    parameters: FlightParameters | None = None


class RecordedCompanion(Companion):
    """A companion that logs its calls; `calls` takes them."""

    def __init__(
        self,
        config: CompanionConfig,
        vehicle: Vehicle,
        site_maps: SiteMaps | None,
        *,
        before: MissionSnapshot | None = None,
        signing: Signing | None = None,
        parameters: FlightParameters | None = None,
    ) -> None:
        super().__init__(
            config, vehicle, site_maps, before=before, signing=signing, parameters=parameters
        )
        self._within = False
        """True within a logged call; the calls inside it are not logged."""
        start = Start(
            config=config,
            vehicle=vehicle,
            site=None if site_maps is None else site_maps.site,
            before=before,
            signed=signing is not None,
            wall_s=0.0 if signing is None else signing.wall_s,
            kept={} if signing is None else dict(signing.kept),
            references={} if signing is None else dict(signing.references),
            parameters=parameters,
        )
        self._calls = [Call(method=START, arguments=(start,))]

    def calls(self) -> list[Call]:
        """Returns the calls since the last time."""
        calls, self._calls = self._calls, []
        return calls


def _logged(name: str) -> Callable[..., Any]:
    method = getattr(Companion, name)

    @functools.wraps(method)
    def logged(self: RecordedCompanion, *arguments: Any, **options: Any) -> Any:
        if self._within:
            return method(self, *arguments, **options)
        self._within = True
        result = None
        try:
            result = method(self, *arguments, **options)
        finally:
            self._within = False
            self._calls.append(
                Call(method=name, arguments=arguments, options=options, result=result)
            )
        return result

    return logged


for _name in (*INPUTS, *OUTPUTS):
    setattr(RecordedCompanion, _name, _logged(_name))


def call_encoded(call: Call) -> list[Any]:
    """A call in a form for JSON: method, arguments, options, result."""
    return [
        call.method,
        [_argument(item) for item in call.arguments],
        encoded(call.options),
        encoded(call.result),
    ]


def _argument(value: Any) -> Any:
    if isinstance(value, PlanAnswer):
        return answer_encoded(value)
    if isinstance(value, MapAnswer):
        return {"job_id": value.job_id, "made": value.site_maps is not None}
    return encoded(value.site if isinstance(value, SiteMaps) else value)


def arguments_decoded(method: str, data: list[Any]) -> tuple[Any, ...]:
    """Arguments of a call; answers and ground need a planner and stay encoded."""
    return tuple(
        decoded(kind, item) for kind, item in zip(_ARGUMENTS.get(method, ()), data, strict=False)
    )


_ARGUMENTS: dict[str, tuple[Any, ...]] = {
    START: (Start,),
    "receive": (str, bytes, float, Address | None),
    "take_in": (tuple[tuple[float, str, bytes, Address | None], ...], float),
    "await_planner": (str,),
    "take_ground": (Site,),
    "note_host": (Host,),
    "note_wall_clock": (float,),
    "tick": (float,),
    "shut_down": (float,),
    "plan_answered": (Any,),
    "contingency_answered": (Any,),
    "perceived": (PerceptionReport,),
    "maps_answered": (Any,),
}
