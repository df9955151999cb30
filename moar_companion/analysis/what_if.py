"""What-if: plans of a site that is being changed, with all that explains them.

Input: a `WhatIfRequest`, as JSON has it: a site as of a site file, a mission,
risks, weights, safety distances. Output: the optimal path, its cost shares and metrics; on demand
the maps, the paper's baselines, the exact front over the triangle of weights, alternatives. Pure:
the page of the service asks, and each answer is that of the planner itself.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from ..errors import InputError
from ..planner.adaptation import Adaptation
from ..planner.analysis.alternatives import alternatives, risk_words
from ..planner.analysis.baselines import Baseline, BaselineKind, baseline
from ..planner.analysis.pareto import pareto_front
from ..planner.comparison import path_difference
from ..planner.plan_values import Metrics, Plan, Waypoints
from ..planner.planner import Clock, Planner
from ..planner.site import Margin, Site, site_document
from ..planner.site_view import maps_view, site_view
from ..settings import yaml_file
from ..settings.vehicle import Vehicle
from ..settings.yaml_file import FileFinding
from ..settings.yaml_schema import FileModel, Interval
from ..types import Mission, RiskIndices, Weights

SOURCE = "what-if"
MOST_CELLS = 200_000
"""Cells of a changed site: its maps and baselines take a second on a companion computer."""
_STRAIGHT_M = 1e-6
"""Greatest distance of a point from the straight line through its neighbours."""

_Fraction = Annotated[float, Field(ge=0.0, le=1.0)]
_Share = Annotated[float, Field(ge=0.0, le=1e6)]
_Distance = Annotated[float, Field(ge=0.01, le=100.0)]


class _Risk(FileModel):
    wind: _Fraction = 0.0
    communication: _Fraction = 0.0
    localization: _Fraction = 0.0
    battery: _Fraction = 0.0


class _Weights(FileModel):
    safety: _Share
    time: _Share
    energy: _Share


class WhatIfRequest(FileModel):
    """A what-if question. What is left out is as the vehicle and the site have it."""

    site: dict[str, Any] | None = None
    """Content of a site file."""
    mission: Literal["inspection", "exit", "evacuation"] = "inspection"
    target: str | int | None = None
    """An inspection's target by name, else the index of a landing point."""
    start_m: Interval | None = None
    """(x, z)."""
    velocity_mps: Interval = Field(default_factory=lambda: [0.0, 0.0])
    risk: _Risk = Field(default_factory=_Risk)
    weights: _Weights | None = None
    """Before the risks."""
    adaptation: Literal["paper", "calibrated"] | None = None
    d_min_m: _Distance | None = None
    d_max_m: _Distance | None = None
    margin_m: Annotated[float, Field(ge=0.0, le=100.0)] | None = None
    """Distance beyond each keep-out."""
    parts: list[Literal["maps", "baselines", "front", "alternatives"]] = Field(default_factory=list)
    """Parts of the answer beside the plan."""


class WhatIf:
    """Answers requests about one site and vehicle; not for two threads at once.

    The planner of the last site and vehicle is kept: a request that changes neither makes no maps.
    """

    def __init__(
        self,
        *,
        text: str,
        source: str,
        vehicle: Vehicle,
        margin: Margin,
        clock: Clock | None = None,
    ) -> None:
        """text: of the site file `source`. margin: with which the vehicle is flown."""
        self._document = site_document(text, source)
        self._vehicle, self._margin, self._clock = vehicle, margin, clock
        self._planned: tuple[Site, Vehicle] | None = None
        self._planner = self._planner_of(Site.of_text(text, source).flown_with(margin), vehicle)

    def document(self) -> dict[str, Any]:
        """What a request may change, as it is without one."""
        vehicle = self._vehicle
        return {
            "site": self._document,
            "vehicle": vehicle.name,
            "d_min_m": vehicle.safety.d_min_m,
            "d_max_m": vehicle.safety.d_max_m,
            "margin_m": self._margin.total_m,
            "adaptation": vehicle.adaptation.value,
            "weights": {name.value: asdict(weights) for name, weights in vehicle.weights.items()},
            "wind_mps": [vehicle.risk.wind_mps.low, vehicle.risk.wind_mps.high],
        }

    def answer(self, document: Mapping[str, Any]) -> dict[str, Any]:
        """The answer to a request; raises InputError for one that cannot be understood."""
        request = yaml_file.accepted(document, SOURCE, WhatIfRequest, _findings)
        planner = self._planner_of(self._site(request), self._changed_vehicle(request))
        plan = planner.plan(
            mission=request.mission,
            target=request.target,
            start=None if request.start_m is None else (request.start_m[0], request.start_m[1]),
            velocity=(request.velocity_mps[0], request.velocity_mps[1]),
            weights=None if request.weights is None else _weights(request.weights),
            risk=RiskIndices(**request.risk.model_dump()),
            adaptation=request.adaptation,
        )
        makers: dict[str, Callable[[], Any]] = {
            "maps": lambda: {"site": site_view(planner.site), "maps": maps_view(planner.maps)},
            "baselines": lambda: _baselines(planner, plan),
            "front": lambda: _front(planner, plan),
            "alternatives": lambda: _alternatives(planner, plan),
        }
        return {
            "plan": _explained(planner, plan),
            **{part: makers[part]() for part in dict.fromkeys(request.parts)},
        }

    def _site(self, request: WhatIfRequest) -> Site:
        document = self._document if request.site is None else request.site
        site = Site.of_document(document, SOURCE)
        count = math.prod(site.workspace.shape)
        if request.site is not None and count > MOST_CELLS:
            problem = f"has {count} cells, {MOST_CELLS} are allowed here"
            raise InputError(SOURCE, "site.workspace", problem)
        margin = self._margin if request.margin_m is None else Margin(position_m=request.margin_m)
        return site.flown_with(margin)

    def _changed_vehicle(self, request: WhatIfRequest) -> Vehicle:
        vehicle, shape = self._vehicle, self._vehicle.safety
        d_min_m = shape.d_min_m if request.d_min_m is None else request.d_min_m
        d_max_m = shape.d_max_m if request.d_max_m is None else request.d_max_m
        if d_min_m >= d_max_m:
            problem = f"is {d_min_m:g}, must be less than d_max_m ({d_max_m:g})"
            raise InputError(SOURCE, "d_min_m", problem)
        return replace(vehicle, safety=replace(shape, d_min_m=d_min_m, d_max_m=d_max_m))

    def _planner_of(self, site: Site, vehicle: Vehicle) -> Planner:
        if self._planned != (site, vehicle):
            self._planner = Planner(site, vehicle, clock=self._clock)
            self._planned = (site, vehicle)
        return self._planner


def _findings(request: WhatIfRequest) -> list[FileFinding]:
    weights = request.weights
    if weights is None or weights.safety + weights.time + weights.energy > 0.0:
        return []
    return [FileFinding(("weights",), "are all 0, must have a positive sum")]


def _weights(given: _Weights) -> Weights:
    return Weights.normalised(given.safety, given.time, given.energy)


def _explained(planner: Planner, plan: Plan) -> dict[str, Any]:
    """A plan: status, path, cost terms weighted and not, and its change by the risks."""
    adaptation = plan.request.adaptation
    assert adaptation is not None  # the request has risks
    shown: dict[str, Any] = {
        "mission": plan.mission.value,
        "target": plan.request.target,
        "status": plan.status.value,
        "reason": plan.reason,
        "base_weights": asdict(adaptation.base),
        "weights": asdict(plan.weights),
        "adaptation": adaptation.words,
        "path": _path(plan.waypoints),
        "cost": None,
        "shares": None,
        "metrics": _metrics(plan.metrics),
        "change": None,
        "compute": asdict(plan.compute),
    }
    if plan.cost is not None:
        terms = {
            name: getattr(plan.weights, name) * getattr(plan.cost, name)
            for name in ("safety", "time", "energy")
        }
        total = sum(terms.values())
        shown["cost"] = asdict(plan.cost)
        shown["shares"] = {name: term / total if total else 0.0 for name, term in terms.items()}
        if any(plan.request.risk.as_dict().values()):
            calm = planner.solve(replace(plan.request, risk=RiskIndices()).adapted(adaptation))
            difference = path_difference(calm, plan)
            shown["change"] = None if difference is None else difference.words()
    return shown


def _path(waypoints: Waypoints) -> list[list[float]]:
    """Points (x, z, speed, time) of a path."""
    return [
        [round(x, 3), round(z, 3), round(speed, 3), round(time, 3)]
        for (x, z), speed, time in zip(
            waypoints.position_m.tolist(),
            waypoints.speed_mps.tolist(),
            waypoints.time_s.tolist(),
            strict=True,
        )
    ]


def corners(waypoints: Waypoints) -> list[list[float]]:
    """Points (x, z) at which a path begins, turns or ends."""
    points = waypoints.position_m
    if len(points) > 2:
        first, second = points[1:-1] - points[:-2], points[2:] - points[1:-1]
        turn = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
        straight = np.abs(turn) <= _STRAIGHT_M * np.hypot(*first.T)
        onward = (first * second).sum(axis=1) >= 0.0
        points = points[np.concatenate([[True], ~(straight & onward), [True]])]
    return [[round(x, 3), round(z, 3)] for x, z in points.tolist()]


def _metrics(metrics: Metrics | None) -> dict[str, float | None] | None:
    return None if metrics is None else metrics.to_dict()


def _baselines(planner: Planner, plan: Plan) -> dict[str, Any]:
    """The paper's baselines of the same problem, by name."""

    def shown(found: Baseline) -> dict[str, Any]:
        return {
            "status": found.status.value,
            "path": [] if found.waypoints is None else corners(found.waypoints),
            "metrics": _metrics(found.metrics),
        }

    return {kind.value: shown(baseline(planner, kind, plan.request)) for kind in BaselineKind}


def _front(planner: Planner, plan: Plan) -> list[dict[str, Any]]:
    """Every path that is optimal for some weights, safest first, with the region of its weights."""
    return [
        {
            "sums": dict(zip(("safety", "time", "energy"), point.sums.tolist(), strict=True)),
            "region": [[round(share, 5) for share in corner] for corner in point.region.tolist()],
            "path": corners(point.plan.waypoints),
            "metrics": _metrics(point.plan.metrics),
        }
        for point in pareto_front(planner, plan.request)
    ]


def _alternatives(planner: Planner, plan: Plan) -> list[dict[str, Any]]:
    """The mission under other risks, and the escapes under these ones, to any landing point."""
    request, adaptation = plan.request, plan.request.adaptation
    assert adaptation is not None  # the request has risks
    found = [
        (risk_words(item.request.risk), item) for item in alternatives(planner, request, adaptation)
    ]
    for mission in (Mission.EXIT, Mission.EVACUATION):
        if mission is not plan.mission and planner.site.landing_m.get(mission):
            base = Adaptation.of(planner.vehicle, mission)
            escape = replace(request, mission=mission, target=None).adapted(base)
            # A site whose landing points no cell sees has no such escape.
            with contextlib.suppress(InputError):
                found.append((mission.value, planner.solve(escape)))
    return [
        {
            "name": name,
            "mission": item.mission.value,
            "status": item.status.value,
            "path": corners(item.waypoints),
            "metrics": _metrics(item.metrics),
        }
        for name, item in found
    ]
