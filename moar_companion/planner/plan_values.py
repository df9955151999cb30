"""A plan, explained: status, states, cost per term, waypoints, metrics, weights, effort."""

from __future__ import annotations

import enum
import json
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..errors import InputError
from ..types import Mission, RiskIndices, Weights
from .adaptation import Adaptation
from .graph import Graph
from .grid import STOP, FloatArray, IntArray
from .maps import Maps
from .regions import LandingLeg

_GREATEST_MPS = 1000.0


class PlanStatus(str, enum.Enum):
    """Result of planning; the conditions are tested in this order."""

    FOUND = "found"
    OUT_OF_BOUNDS = "out_of_bounds"
    START_OCCUPIED = "start_occupied"
    TARGET_OCCUPIED = "target_occupied"
    UNREACHABLE = "unreachable"


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """J and its unweighted sums (Eq. 7): sum SC d, sum TC (s), sum EC; without the landing leg."""

    total: float
    safety: float
    time: float
    energy: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Metrics:
    """The paper's metrics (Section V-A) of the whole trajectory, landing leg included.

    Clearances are infinite where there is no obstacle.
    """

    length_m: float
    duration_s: float
    mean_clearance_m: float
    min_clearance_m: float
    velocity_change_mps: float

    def to_dict(self) -> dict[str, float | None]:
        """The metrics as JSON has them; an infinite clearance is null."""
        return {
            name: value if math.isfinite(value) else None for name, value in asdict(self).items()
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Compute:
    """Effort of the plan; the maps are built once per site.

    map_ms, search_ms: None where the planner has no clock. expanded: cells, each with all its
    headings, where there was no table; with one, states.
    """

    map_ms: float | None
    search_ms: float | None
    expanded: int

    @property
    def map_words(self) -> str:
        """Text of `map_ms`."""
        return milliseconds(self.map_ms)

    @property
    def search_words(self) -> str:
        """Text of `search_ms`."""
        return milliseconds(self.search_ms)


def milliseconds(duration_ms: float | None) -> str:
    """Text of a time: `0.3 ms`, or `unknown`."""
    return "unknown" if duration_ms is None else f"{duration_ms:.1f} ms"


@dataclass(frozen=True, kw_only=True, eq=False)
class Waypoints:
    """The path as points in the plane, landing leg included.

    position_m: (n, 2); speed_mps, time_s: (n,), of the move that entered the point.
    """

    position_m: FloatArray
    speed_mps: FloatArray
    time_s: FloatArray

    def to_list(self) -> list[dict[str, float]]:
        """The points as JSON has them."""
        return [
            {"x_m": x, "z_m": z, "speed_mps": speed, "time_s": time}
            for (x, z), speed, time in zip(
                self.position_m.tolist(), self.speed_mps.tolist(), self.time_s.tolist(), strict=True
            )
        ]


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanRequest:
    """One planning problem; the planner answers it with a `Plan` that carries it.

    Raises InputError for a start or velocity that is not finite, and for a velocity that is too
    great: its square must be a number. Raises ValueError where the two differ in dimension.
    """

    mission: Mission
    target: str | int | None
    """An inspection's target by name; the index of a landing point, or None for any."""
    start_m: tuple[float, ...]
    velocity_mps: tuple[float, ...]
    weights: Weights
    """Final, after the adaptation to risks."""
    risk: RiskIndices
    """The indices behind the weights, for the record."""
    adaptation: Adaptation | None = None
    """The source of the weights, for the record; None where they were given as final."""

    def __post_init__(self) -> None:
        if len(self.start_m) != len(self.velocity_mps):
            raise ValueError(f"start {self.start_m} and velocity {self.velocity_mps} do not agree")
        for key, values in (("start", self.start_m), ("velocity", self.velocity_mps)):
            if not all(map(math.isfinite, values)):
                raise InputError("plan", key, f"is {values}, must be finite")
        if math.hypot(*self.velocity_mps) > _GREATEST_MPS:
            raise InputError(
                "plan", "velocity", f"is {self.velocity_mps}, must be within {_GREATEST_MPS:g} m/s"
            )

    def adapted(self, adaptation: Adaptation) -> PlanRequest:
        """The request with the weights that an adaptation derives from its risks."""
        return replace(self, adaptation=adaptation, weights=adaptation.weights(self.risk))


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """The answer to one planning problem. states: (n, 3) of cell indices and heading.

    Landing leg, waypoints and metrics follow from the states and are computed at first use.
    """

    request: PlanRequest
    site: str
    graph: Graph
    maps: Maps
    status: PlanStatus
    reason: str
    """Text of the reason, when the status is not `found`."""
    compute: Compute
    states: IntArray
    cost: Cost | None = None
    land: Callable[[], LandingLeg] | None = None
    """Makes the landing leg of a path that has one."""

    @cached_property
    def landing_leg(self) -> LandingLeg | None:
        """The leg from the last state to above a landing point; None for an inspection."""
        return None if self.land is None else self.land()

    @property
    def waypoints(self) -> Waypoints:
        """The path as points, landing leg included; empty without a path."""
        return self._flight[0]

    @property
    def metrics(self) -> Metrics | None:
        """The paper's metrics; None unless there is a path."""
        return self._flight[1]

    @cached_property
    def _flight(self) -> tuple[Waypoints, Metrics | None]:
        if self.status is not PlanStatus.FOUND:
            nowhere = np.empty((0, len(self.graph.grid.shape)))
            nothing = nowhere[:, 0]
            return Waypoints(position_m=nowhere, speed_mps=nothing, time_s=nothing), None
        return trajectory(
            self.graph, self.maps, self.states, self.request.velocity_mps, self.landing_leg
        )

    @property
    def mission(self) -> Mission:
        """The mission that was planned."""
        return self.request.mission

    @property
    def weights(self) -> Weights:
        """The final weights that the plan is optimal for."""
        return self.request.weights

    def to_dict(self) -> dict[str, Any]:
        """The plan as JSON has it."""
        return {
            "site": self.site,
            "mission": self.mission.value,
            "target": self.request.target,
            "status": self.status.value,
            "reason": self.reason,
            "resolution_m": self.graph.grid.resolution_m,
            "v_max_mps": self.graph.v_max_mps,
            "heading_speed_mps": self.graph.heading_speed_mps.tolist(),
            "headings": self.graph.moves.steps.tolist(),
            "risk": self.request.risk.as_dict(),
            "weights": asdict(self.weights),
            "adaptation": None
            if self.request.adaptation is None
            else self.request.adaptation.to_dict(),
            "cost": None if self.cost is None else asdict(self.cost),
            "start_velocity_mps": list(self.request.velocity_mps),
            "states": self.states.tolist(),
            "waypoints": self.waypoints.to_list(),
            "metrics": None if self.metrics is None else self.metrics.to_dict(),
            "compute": asdict(self.compute),
        }

    def to_json(self) -> str:
        """The JSON document of `moar-companion plan --json`."""
        return json.dumps(self.to_dict(), allow_nan=False)


def trajectory(
    graph: Graph,
    maps: Maps,
    states: IntArray,
    velocity_mps: tuple[float, ...],
    leg: LandingLeg | None,
) -> tuple[Waypoints, Metrics]:
    """Waypoints and metrics of a path of states and the landing leg behind it."""
    grid = graph.grid
    flat = (states[1:, :-1] + 1) @ np.array(grid.strides)
    heading = states[1:, -1]
    position = np.array(grid.lower_m) + (states[:, :-1] + 0.5) * grid.resolution_m
    speed = np.concatenate([[math.hypot(*velocity_mps)], graph.speed[flat, heading]])
    moved = heading != STOP
    step_s = np.zeros(len(heading))
    step_s[moved] = graph.length_m[heading[moved]] / graph.speed[flat[moved], heading[moved]]
    return flight(
        position=position,
        speed=speed,
        step_s=step_s,
        clearance=maps.obstacle_distance_m[tuple(states[:, :-1].T)],
        velocity=_velocities(graph, states, velocity_mps),
        leg=leg,
    )


def flight(
    *,
    position: FloatArray,
    speed: FloatArray,
    step_s: FloatArray,
    clearance: FloatArray,
    velocity: FloatArray,
    leg: LandingLeg | None,
) -> tuple[Waypoints, Metrics]:
    """Waypoints and metrics of n points and the landing leg behind them.

    step_s: (n - 1,) between them; the others (n,) or (n, d), of each point.
    """
    if leg is not None:
        path = np.concatenate([position[-1:], leg.points_m])
        along = np.diff(path, axis=0)
        length = np.hypot(along[:, 0], along[:, 1])
        position = np.concatenate([position, leg.points_m])
        speed = np.concatenate([speed, leg.speed_mps])
        step_s = np.concatenate([step_s, length / leg.speed_mps])
        clearance = np.concatenate([clearance, leg.clearance_m])
        unit = along / np.where(length > 0.0, length, 1.0)[:, None]
        velocity = np.concatenate(
            [velocity, unit * leg.speed_mps[:, None], np.zeros((1, velocity.shape[1]))]
        )
    duration = float(step_s.sum())
    # A stop takes no time: where it is the only step, the clearance is that of its cell.
    mean = (
        clearance[1:][step_s > 0.0] @ step_s[step_s > 0.0] / duration
        if duration > 0.0
        else clearance[0]
    )
    metrics = Metrics(
        length_m=float(np.sqrt((np.diff(position, axis=0) ** 2).sum(axis=1)).sum()),
        duration_s=duration,
        mean_clearance_m=float(mean),
        min_clearance_m=float(clearance.min()),
        velocity_change_mps=float(np.sqrt((np.diff(velocity, axis=0) ** 2).sum(axis=1)).sum()),
    )
    time = np.concatenate([[0.0], np.cumsum(step_s)])
    for array in (position, speed, time):
        array.flags.writeable = False
    return Waypoints(position_m=position, speed_mps=speed, time_s=time), metrics


def _velocities(graph: Graph, states: IntArray, velocity_mps: tuple[float, ...]) -> FloatArray:
    """The velocity (n, d) in every state of a path; in the first the vehicle's own."""
    flat = (states[:, :-1] + 1) @ np.array(graph.grid.strides)
    heading = states[:, -1]
    velocity: FloatArray = graph.speed[flat, heading][:, None] * graph.unit[heading]
    velocity[0] = velocity_mps
    return velocity
