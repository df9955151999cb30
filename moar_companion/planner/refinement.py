"""A plan's path at any angle: bent and straightened, off the cells' centres, where that lowers J.

Inputs: a planner's maps and a plan of theirs. Output: straight legs from the start of the plan to
its goal. Their J as a continuous path (`polyline`) is at most that of the plan's own path. It is a
local optimum, found from the plan's path.

The path meets the limits of a path on the grid. It touches no occupied cell, and stays in the
workspace and above the minimum altitude. It comes no nearer to an obstacle than the occupied
distance, or than the plan's path. Straight moves between two free centres may come nearer than
either.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np

from ..settings.vehicle import SpeedLimits, Vehicle
from ..types import Weights
from .arrays import Field, LegCost, Limits, Terms
from .geometry import rings
from .graph import heading_speeds_mps
from .grid import STOP, TOLERANCE, FloatArray
from .maps import Maps
from .plan_values import Cost, Metrics, Plan, Waypoints, flight, milliseconds
from .polyline import leg_sums, outline_distances, path_sums, refined
from .regions import GoalRegion, LandingLeg, landing_leg, obstacle_clearance_m
from .site import Site

SAMPLES_PER_CELL = 4
OCCUPIED, FREE, CLEAR = 0, 1, 2
"""States of a cell: never entered; free in its centre; clear of every keep-out all over it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ContinuousCost:
    """J of continuous paths on the maps of one site: for planners without a grid, too.

    Points are joined by straight legs; J is infinite for a path that leaves the free cells.
    `polyline` defines the samples of a leg.
    """

    field: Field
    v_max_mps: float

    @classmethod
    def on(
        cls, maps: Maps, speed: SpeedLimits, *, samples_per_cell: int = SAMPLES_PER_CELL
    ) -> ContinuousCost:
        """J on maps, for a vehicle's speeds."""
        grid = maps.grid
        # No point of a cell is farther from its centre than half a diagonal.
        clear = maps.room_m >= np.sqrt(0.5) * grid.resolution_m
        free = np.where(maps.occupied, OCCUPIED, np.where(clear, CLEAR, FREE)).astype(np.uint8)
        values = np.stack([maps.safety_cost, maps.speed_limit_mps], axis=-1)
        elevation_mps = heading_speeds_mps(speed)[5:0:-1].copy()
        for array in (free, values, elevation_mps):
            array.flags.writeable = False
        return cls(
            field=Field(
                values=values,
                free=free,
                elevation_mps=elevation_mps,
                left_m=float(grid.lower_m[0]),
                low_m=float(grid.lower_m[1]),
                cell_m=float(grid.resolution_m),
                spacing_m=grid.resolution_m / samples_per_cell,
            ),
            v_max_mps=speed.max_mps,
        )

    def of_path(
        self,
        points_m: FloatArray,
        velocity_mps: tuple[float, ...],
        weights: Weights,
        *,
        ends_at_rest: bool,
    ) -> Cost:
        """J of a path (n, 2) that is entered at a velocity, and its sums; infinite if not free."""
        vx, vz = velocity_mps
        safety, time, change = path_sums(
            np.ascontiguousarray(points_m, dtype=np.float64), vx, vz, ends_at_rest, self.field
        )
        energy = 0.5 * change / self.v_max_mps
        total = weights.safety * safety + weights.time * time + weights.energy * energy
        if not np.isfinite(safety):
            total = np.inf  # and no 0 times infinity
        return Cost(total=total, safety=safety, time=time, energy=energy)


_LEVELS = np.array(
    [(1, 1), (2, 1), (4, 1), (1, 0.5), (4, 0.5), (0.5, 0.5), (0.125, 0.25)], dtype=np.float64
)
"""Steps and distances of samples, in cells. Short steps before long ones, and those again with
closer samples: this order ends in lower optima than the usual one from long to short."""
_LEVELS.flags.writeable = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Refinement:
    """The refined path of a plan, and its J. plan_cost: the J of the plan's own path.

    Both are those of continuous paths.

    points_m: (n, 2)  the ends of the legs
    """

    plan: Plan
    points_m: FloatArray
    cost: Cost
    plan_cost: Cost
    continuous: ContinuousCost
    site: Site
    land: Callable[[], LandingLeg] | None = None
    """Makes the landing leg of a path that has one."""
    compute_ms: float | None = None
    """None: not measured, as by a planner without a clock."""

    @property
    def compute_words(self) -> str:
        """Text of `compute_ms`."""
        return milliseconds(self.compute_ms)

    @cached_property
    def landing_leg(self) -> LandingLeg | None:
        """The leg from the last point to above a landing point; None for an inspection."""
        return None if self.land is None else self.land()

    @property
    def waypoints(self) -> Waypoints:
        """Points at most a cell apart, landing leg included; speeds are means to each point."""
        return self._flight[0]

    @property
    def metrics(self) -> Metrics:
        """The paper's metrics."""
        return self._flight[1]

    @cached_property
    def _flight(self) -> tuple[Waypoints, Metrics]:
        legs = np.diff(self.points_m, axis=0)
        length = np.hypot(legs[:, 0], legs[:, 1])
        pieces = np.ceil(length / self.continuous.field.cell_m).astype(int)
        leg = np.repeat(np.arange(len(legs)), pieces)
        nth = np.arange(len(leg)) - np.searchsorted(leg, leg) + 1
        ends = self.points_m[leg] + (nth / pieces[leg])[:, None] * legs[leg]
        position = np.concatenate([self.points_m[:1], ends])
        step_s = np.array(
            [
                leg_sums(from_x, from_z, to_x, to_z, self.continuous.field)[1]
                for (from_x, from_z), (to_x, to_z) in itertools.pairwise(position.tolist())
            ]
        )
        speed = (length / pieces)[leg] / step_s
        velocity = speed[:, None] * (legs / length[:, None])[leg]
        own = self.plan.request.velocity_mps
        if _stops(self.plan):
            position = np.concatenate([position, position[-1:]])
            step_s, speed = np.append(step_s, 0.0), np.append(speed, 0.0)
            velocity = np.concatenate([velocity, np.zeros((1, 2))])
        return flight(
            position=position,
            speed=np.concatenate([[math.hypot(*own)], speed]),
            step_s=step_s,
            clearance=obstacle_clearance_m(self.site, position),
            velocity=np.concatenate([[own], velocity]),
            leg=self.landing_leg,
        )

    def to_dict(self) -> dict[str, Any]:
        """The refinement for the plan's JSON; an infinite clearance is null."""
        return {
            "points": [{"x_m": x, "z_m": z} for x, z in self.points_m.tolist()],
            "cost": asdict(self.cost),
            "plan_cost": asdict(self.plan_cost),
            "waypoints": self.waypoints.to_list(),
            "metrics": self.metrics.to_dict(),
            "compute_ms": self.compute_ms,
        }


class Refiner:
    """Refines plans of one planner's maps."""

    def __init__(self, site: Site, vehicle: Vehicle, maps: Maps) -> None:
        self.continuous = ContinuousCost.on(maps, vehicle.speed)
        self._site, self._vehicle, self._grid = site, vehicle, maps.grid
        self._vertices_m, self._first, radius_m, keep_out_m = rings(site.barriers)
        self._keep_m = radius_m + keep_out_m + vehicle.radius_m + maps.position_uncertainty_m
        if site.ground is not None:
            self._keep_m[-1] = site.ground.keep_out_m
        for array in (self._vertices_m, self._first):
            array.flags.writeable = False
        space = site.workspace
        # Above a profile the ground is one more outline, from which the path keeps away.
        lowest_m = None if space.ground_m else space.min_altitude_m
        self._lowest_m = -math.inf if lowest_m is None else lowest_m - TOLERANCE

    def refine(self, plan: Plan, goal: GoalRegion | None) -> Refinement:
        """The refined path of a plan, with its landing leg.

        goal: cells where it may end at any velocity; None where it ends at rest.
        """
        grid, (vx, vz) = plan.graph.grid, plan.request.velocity_mps
        cells = plan.states[: -1 if _stops(plan) else None]
        own_m = np.array(grid.lower_m) + (cells[:, :-1] + 0.5) * grid.resolution_m
        turns = np.flatnonzero(cells[1:-1, -1] != cells[2:, -1]) + 1
        corners_m = own_m[[0, *turns, len(cells) - 1]] if len(cells) > 1 else own_m
        points_m = refined(corners_m, vx, vz, _LEVELS, self._terms(plan, corners_m, goal))
        cost, plan_cost = (
            self.continuous.of_path(path_m, (vx, vz), plan.weights, ends_at_rest=goal is None)
            for path_m in (points_m, own_m)
        )
        if not cost.total < plan_cost.total:
            points_m, cost = own_m, plan_cost
        points_m.flags.writeable = False
        return Refinement(
            plan=plan,
            points_m=points_m,
            cost=cost,
            plan_cost=plan_cost,
            continuous=self.continuous,
            site=self._site,
            land=None if goal is None else self._leg(plan, points_m[-1], goal),
        )

    def _leg(self, plan: Plan, end_m: FloatArray, goal: GoalRegion) -> Callable[[], LandingLeg]:
        """Makes the landing leg from the end of a refined path."""
        x_m, z_m = end_m.tolist()
        column, row = self._grid.cell_of((x_m, z_m)) or plan.states[-1, :-1]
        cell = (int(column), int(row))
        return partial(landing_leg, self._site, self._vehicle, goal, cell, end_m)

    def _terms(self, plan: Plan, corners_m: FloatArray, goal: GoalRegion | None) -> Terms:
        """Costs and limits of the refined path of a plan, (n, 2)."""
        field, weights = self.continuous.field, plan.weights
        near_m = outline_distances(corners_m, self._vertices_m, self._first)
        keep_m = np.minimum(self._keep_m, near_m) - TOLERANCE
        # The end moves within cells that are clear everywhere, and so is its leg to their edge.
        ends = np.zeros((0, 0), dtype=bool) if goal is None else goal.mask & (field.free == CLEAR)
        for array in (keep_m, ends):
            array.flags.writeable = False
        return Terms(
            field=field,
            limits=Limits(
                vertices_m=self._vertices_m,
                first=self._first,
                keep_m=keep_m,
                lowest_m=self._lowest_m,
            ),
            cost=LegCost(
                safety=float(weights.safety),
                time=float(weights.time),
                energy=0.5 * weights.energy / self.continuous.v_max_mps,
            ),
            goal=ends.view(np.uint8),
            ends_at_rest=goal is None,
        )


def _stops(plan: Plan) -> bool:
    """Returns True if the last action of a plan is to come to rest."""
    return len(plan.states) > 1 and plan.states[-1, -1] == STOP
