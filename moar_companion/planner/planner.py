"""The planner: built once per site and vehicle, then asked for plans.

Inputs: site and vehicle; per plan a mission, its target, the vehicle's position and velocity, and
final weights. Output: a `Plan`, which is the optimum of J on the paper's graph (Eq. 1, 7).
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError
from ..site import PlanePoint, Site, Target
from ..types import Mission, RiskIndices, Weights
from ..vehicle import Vehicle
from . import kernels
from .graph import build_graph
from .grid import STOP, FloatArray, IntArray
from .maps import build_maps
from .plan import (
    Compute,
    Plan,
    PlanRequest,
    PlanStatus,
    Waypoints,
    path_cost,
    trajectory,
)
from .regions import Cell, GoalRegion, goal_region, landing_leg

_TIE_TIME_ENERGY = 1e-11
"""Added to k_T and k_E: of paths with equal J, the one with the least sum of TC and EC.
J is off its optimum by at most this times that sum, below 1e-9 for a path of 100 s."""

_TIE_ACTION = 1e-14
"""Added per action: of those, the one with the fewest actions."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Goal:
    """Where a mission ends, in the search's terms."""

    flat_cells: IntArray
    is_goal: IntArray
    region: GoalRegion | None
    """None for an inspection, which ends at rest in its target's cell."""


class Planner:
    """Plans on the maps of one site for one vehicle.

    The maps are built here, goals are looked up once, and the cost-to-go of the cells is kept
    for each goal until the weights change. Not safe for use by two threads at once.
    """

    def __init__(
        self, site: Site, vehicle: Vehicle, *, position_uncertainty_m: float = 0.0
    ) -> None:
        """Builds the maps; `position_uncertainty_m` widens what counts as occupied."""
        self.site = site
        self.vehicle = vehicle
        began = time.perf_counter()
        self.maps = build_maps(site, vehicle, position_uncertainty_m)
        self.graph = build_graph(self.maps, vehicle)
        self._map_ms = 1e3 * (time.perf_counter() - began)
        self._goals: dict[tuple[Mission, str | int | None], _Goal] = {}
        self._fields: dict[_Goal, tuple[Weights, FloatArray]] = {}

    def prepare(self, *, mission: Mission | str, target: str | int | None = None) -> None:
        """Whatever is precomputed for a goal is ready when this returns; `plan` never waits.

        Raises InputError for a target or landing point that the site does not have.
        """
        mission = Mission(mission)
        if mission is Mission.INSPECTION:
            target = self._target(target).name
        goal = self._goal(mission, target)
        self._field(goal, self.vehicle.weights[mission])

    def plan(
        self,
        *,
        mission: Mission | str,
        target: str | int | None = None,
        start: PlanePoint | None = None,
        velocity: PlanePoint = (0.0, 0.0),
        weights: Weights | None = None,
        risk: RiskIndices | None = None,
    ) -> Plan:
        """The optimal plan of a mission.

        target: for an inspection the target's name (the first of the site by default); for exit
        and evacuation the index of a landing point (any by default).
        start, velocity: of the vehicle in the plane, m and m/s; the site's start, at rest.
        weights: final, after Eq. 9; the vehicle's for this mission by default.
        risk: the indices behind the weights, for the record.

        That there is no plan is a status. Raises InputError for a target or landing point that
        the site does not have, or landing points none of which can be seen.
        """
        mission = Mission(mission)
        return self.solve(
            PlanRequest(
                mission=mission,
                target=target if target is None or isinstance(target, str) else int(target),
                start_m=self.site.start_m if start is None else _point(start),
                velocity_mps=_point(velocity),
                weights=self.vehicle.weights[mission] if weights is None else weights,
                risk=RiskIndices() if risk is None else risk,
            )
        )

    def solve(self, request: PlanRequest) -> Plan:
        """The answer to a request; errors as of `plan`."""
        target = None
        if request.mission is Mission.INSPECTION:
            target = self._target(request.target)
            request = replace(request, target=target.name)
        grid, occupied = self.maps.grid, self.maps.occupied
        start_cell = grid.cell_of(request.start_m)
        if start_cell is None:
            return self._none(request, PlanStatus.OUT_OF_BOUNDS, "the start", request.start_m)
        if occupied[start_cell]:
            return self._none(request, PlanStatus.START_OCCUPIED, "the start", request.start_m)
        if target is not None:
            cell = grid.cell_of(target.position_m)
            where = (f"target {target.name}", target.position_m)
            if cell is None:
                return self._none(request, PlanStatus.OUT_OF_BOUNDS, *where)
            if occupied[cell]:
                return self._none(request, PlanStatus.TARGET_OCCUPIED, *where)
        return self._search(request, start_cell)

    def _search(self, request: PlanRequest, start_cell: tuple[int, ...]) -> Plan:
        goal = self._goal(request.mission, request.target)
        began = time.perf_counter()
        graph, weights = self.graph, request.weights
        field = self._field(goal, weights)
        start = graph.grid.flat(start_cell)
        if not math.isfinite(field[start]):
            return self._none(request, PlanStatus.UNREACHABLE, "the goal", None)
        path, expanded = kernels.best_path(
            start,
            np.array(request.velocity_mps, dtype=np.float64),
            goal.is_goal,
            goal.region is None,
            field,
            graph.allowed,
            graph.safety,
            graph.speed,
            graph.duration,
            graph.offset,
            graph.length_m,
            graph.unit,
            weights.safety,
            weights.time + _TIE_TIME_ENERGY,
            weights.energy + _TIE_TIME_ENERGY,
            graph.v_max_mps,
            _TIE_ACTION,
        )
        headings = len(graph.offset)
        states = np.empty((len(path) + 1, len(start_cell) + 1), dtype=np.int64)
        states[0] = (*start_cell, STOP)
        states[1:, :-1] = graph.grid.unflat(path // headings)
        states[1:, -1] = path % headings
        search_ms = 1e3 * (time.perf_counter() - began)
        leg = None
        if goal.region is not None:
            end: Cell = (int(states[-1, 0]), int(states[-1, 1]))
            leg = landing_leg(self.site, self.vehicle, goal.region, end)
        states.flags.writeable = False
        waypoints, metrics = trajectory(graph, self.maps, states, request.velocity_mps, leg)
        return Plan(
            request=request,
            site=self.site.name,
            graph=graph,
            status=PlanStatus.FOUND,
            reason="",
            compute=Compute(map_ms=self._map_ms, search_ms=search_ms, expanded=int(expanded)),
            states=states,
            waypoints=waypoints,
            cost=path_cost(graph, states, request.velocity_mps, weights),
            metrics=metrics,
            landing_leg=leg,
        )

    def _none(
        self,
        request: PlanRequest,
        status: PlanStatus,
        what: str,
        point_m: tuple[float, ...] | None,
    ) -> Plan:
        """The answer that there is no plan, with the reason in words."""
        words = {
            PlanStatus.OUT_OF_BOUNDS: "is outside the workspace",
            PlanStatus.START_OCCUPIED: "is too close to an obstacle or too low",
            PlanStatus.TARGET_OCCUPIED: "is too close to an obstacle or too low",
            PlanStatus.UNREACHABLE: "cannot be reached: no free way leads there",
        }
        place = "" if point_m is None else f" at ({point_m[0]:g}, {point_m[1]:g})"
        nowhere = np.empty((0, len(self.graph.grid.shape)))
        return Plan(
            request=request,
            site=self.site.name,
            graph=self.graph,
            status=status,
            reason=f"{what}{place} {words[status]}",
            compute=Compute(map_ms=self._map_ms, search_ms=0.0, expanded=0),
            states=np.empty((0, len(self.graph.grid.shape) + 1), dtype=np.int64),
            waypoints=Waypoints(position_m=nowhere, speed_mps=nowhere[:, 0], time_s=nowhere[:, 0]),
        )

    def _target(self, name: str | int | None) -> Target:
        """The target of this name; the first for None."""
        targets = self.site.targets
        for target in targets:
            if name in (None, target.name):
                return target
        known = ", ".join(target.name for target in targets) or "none"
        raise InputError(self.site.name, "targets", f"no target {name!r}; the site has: {known}")

    def _goal(self, mission: Mission, target: str | int | None) -> _Goal:
        """The goal of a mission, looked up once."""
        key = (mission, target)
        if key not in self._goals:
            self._goals[key] = self._make_goal(mission, target)
        return self._goals[key]

    def _make_goal(self, mission: Mission, target: str | int | None) -> _Goal:
        grid = self.graph.grid
        region = None
        if mission is Mission.INSPECTION:
            cell = grid.cell_of(self._target(target).position_m)
            cells = [] if cell is None or self.maps.occupied[cell] else [cell]
        else:
            region = goal_region(self.site, self.vehicle, self.maps, mission, target)
            cells = [tuple(cell) for cell in region.corners]
        flat = np.array([grid.flat(cell) for cell in cells], dtype=np.int64)
        is_goal = np.zeros(len(self.graph.allowed), dtype=np.uint8)
        is_goal[flat] = 1
        return _Goal(flat_cells=flat, is_goal=is_goal, region=region)

    def _field(self, goal: _Goal, weights: Weights) -> FloatArray:
        """The cell field of a goal; computed again only when the weights have changed."""
        known = self._fields.get(goal)
        if known is not None and known[0] == weights:
            return known[1]
        graph = self.graph
        field: FloatArray = kernels.cell_field(
            goal.flat_cells,
            graph.allowed,
            graph.safety,
            graph.duration,
            graph.offset,
            graph.length_m,
            weights.safety,
            weights.time + _TIE_TIME_ENERGY,
            _TIE_ACTION,
        )
        self._fields[goal] = (weights, field)
        return field


def _point(values: PlanePoint) -> PlanePoint:
    """Two plain numbers, whatever numbers they were; ValueError for another count."""
    x, z = values
    return float(x), float(z)
