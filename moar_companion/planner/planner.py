"""The planner: built once per site and vehicle, then called for plans.

Inputs: site and vehicle; per plan a mission, its target, the vehicle's position and velocity, and
final weights. Output: a `Plan`, which is the optimum of J on the paper's graph (Eq. 1, 7).
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ..settings.vehicle import AdaptationKind, Vehicle
from ..types import Mission, RiskIndices, Weights
from .adaptation import Adaptation, Calibration
from .calibration import calibrated
from .cost_to_go_tables import TableBuilder, shares
from .graph import Graph, build_graph
from .grid import STOP, BoolArray, FloatArray, IntArray
from .maps import Maps, build_maps, with_exposed
from .plan_values import Compute, Cost, Plan, PlanRequest, PlanStatus
from .plane_fence import PlaneFence
from .regions import Cell, GoalRegion, goal_region, landing_leg
from .site import Obstacle, PlanePoint, Site
from .solver import CostToGoTable, Goal, Solver, walked

if TYPE_CHECKING:
    from .refinement import Refinement, Refiner
    from .whole_front import Choice, PowerW, Wish

_WORDS = {
    PlanStatus.OUT_OF_BOUNDS: "is outside the workspace",
    PlanStatus.START_OCCUPIED: "is too close to an obstacle or too low",
    PlanStatus.TARGET_OCCUPIED: "is too close to an obstacle or too low",
    PlanStatus.UNREACHABLE: "cannot be reached: no free path leads there",
}


def reason_of(
    status: PlanStatus, what: str, point_m: tuple[float, ...] | None, site: Site, maps: Maps
) -> str:
    """Returns the reason: the subject, its point, and the rule that excludes it.

    what: the start, the goal or a target. point_m: (x, z); None for a goal of several cells.
    """
    if point_m is None:
        return f"{what} {_WORDS[status]}"
    why = _WORDS[status]
    if status is PlanStatus.OUT_OF_BOUNDS:
        why = _uncovered(point_m, site, maps) or why
    fence = maps.fence
    crossed = None if fence is None else fence.crossed(np.array([point_m[:2]]))
    if crossed is not None and fence is not None:
        why = f"is outside the autopilot's fence, {crossed}, less {fence.margin_m:g} m"
    return f"{what} at ({point_m[0]:g}, {point_m[1]:g}) {why}"


def _uncovered(point_m: tuple[float, ...], site: Site, maps: Maps) -> str | None:
    """Reason of a point within the workspace that no cell holds; None for one outside."""
    space, grid = site.workspace, maps.grid
    if space.outside_m((point_m[0], point_m[1])):
        return None
    ends = zip("xz", point_m, grid.upper_m, space.upper_m, strict=True)
    strips = [
        f"{axis} {covered:g} to {upper:g}" for axis, at, covered, upper in ends if at > covered
    ]
    return (
        f"is in the strip of the workspace that no whole cell of {grid.resolution_m:g} m "
        f"covers ({', '.join(strips)})"
    )


_TABLES_BYTES = 128 * 2**20
"""Memory of all tables together, also while one is being built."""
_MOST_CALIBRATIONS = 64
"""Calibrations kept; the oldest is dropped."""
_NO_RISK = RiskIndices()

Clock = Callable[[], float]
_Key = tuple[Mission, str | int | None]


@dataclass(frozen=True, kw_only=True, eq=False)
class MissionGoal:
    """End of a mission: for the search, and for the landing leg (None for an inspection)."""

    goal: Goal
    cells: frozenset[int]
    region: GoalRegion | None


@dataclass(frozen=True, kw_only=True, eq=False)
class SearchProblem:
    """A request in the graph's terms. start: flat cell; velocity_mps: (3,)."""

    request: PlanRequest
    start: int
    velocity_mps: FloatArray
    goal: MissionGoal

    @property
    def is_at_goal(self) -> bool:
        """True if the start is a cell of the goal."""
        return self.start in self.goal.cells

    @property
    def stop_headings(self) -> IntArray:
        """The path that begins in the goal: at most a stop is left."""
        stops = self.goal.goal.ends_at_rest and bool(self.velocity_mps.any())
        return np.full(int(stops), STOP)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Prepared:
    """The present table of a goal. ready: it is complete."""

    table: CostToGoTable
    ready: bool


class Planner:
    """Plans on the maps of one site for one vehicle.

    The maps are built here, goals are computed once. `plan` serves one thread, `prepare` may
    run beside it in another: with its tables plans cost the same and are found sooner. The goals
    of the site share their memory; where it is too small for all tables, the goal prepared the
    longest ago loses its table.

    A plan's J is the optimum to 1e-10 for each second (and each EC) of the optimal path. Of paths
    of equal J a plan is the one of the least sum of TC and EC; then of the least weighted sum of
    actions, landing leg and SC (`solver.TIE_ACTION`, `TIE_LEG`, `TIE_SAFETY`). These are the same
    with and without a table, to rounding. Paths that are equal in all of them differ in the order
    of their actions; a plan with a table may be another one of these than a plan without.
    """

    def __init__(
        self,
        site: Site,
        vehicle: Vehicle,
        *,
        position_uncertainty_m: float = 0.0,
        fence: PlaneFence | None = None,
        clock: Clock | None = None,
    ) -> None:
        """Builds the maps; `position_uncertainty_m` widens what counts as occupied.

        fence: of the autopilot, as far as it cuts the site: nothing leads outside.
        clock: seconds, for the times in a plan's `compute`; None: they are unknown. No plan
        depends on it.
        """
        self.clock = clock
        self._build(site, vehicle, position_uncertainty_m, fence, before=None)
        self._solver = Solver(self.graph)

    def prepare(self, *, mission: Mission | str, target: str | int | None = None) -> None:
        """Precomputes the table of a goal, ready on return; `plan` never waits for it.

        Raises InputError for a target or landing point that the site does not have.
        """
        mission = Mission(mission)
        if mission.visits_targets:
            target = self.site.target(target).name
        key = (mission, target)
        # Read once: if obstacles change meanwhile, the new table is stored with dropped tables.
        tables = self._tables
        goal = self._goal(key)
        count, corners = self._shares
        if not (goal.cells and count):
            return
        known = tables.pop(key, None)
        if known is not None and known.ready:
            tables[key] = known
            return
        while len(tables) >= count:
            del tables[next(iter(tables))]
        builder = TableBuilder(self.graph, goal.goal, Adaptation.of(self.vehicle, mission), corners)
        tables[key] = _Prepared(table=builder.table(), ready=False)
        while builder.refine():
            if builder.corners & (builder.corners - 1) == 0:
                tables[key] = _Prepared(table=builder.table(), ready=False)
        tables[key] = _Prepared(table=builder.table(), ready=True)

    @property
    def most_prepared(self) -> int:
        """Number of goals whose tables are kept."""
        return self._shares[0]

    @property
    def _shares(self) -> tuple[int, int]:
        goals = len(self.site.targets) + len(self.site.landing_m)
        return shares(self.graph, goals, _TABLES_BYTES)

    def set_obstacles(self, obstacles: tuple[Obstacle, ...]) -> None:
        """Sets other obstacles on the same site: repairs the maps, drops goals and tables.

        obstacles: as a file has them, without the site's margin.
        """
        self.set_site(self.site.with_obstacles(obstacles))

    def set_site(self, site: Site) -> None:
        """Sets the same site with other obstacles or targets: repairs the maps, drops goals.

        Tables are dropped, one in preparation, too. site: its obstacles have the margin.
        """
        uncertainty_m, fence = self.maps.position_uncertainty_m, self.maps.fence
        self._build(site, self.vehicle, uncertainty_m, fence, before=self.maps)
        self._solver.graph = self.graph

    def set_vehicle(self, vehicle: Vehicle, site: Site) -> None:
        """Sets another vehicle on the same site, with its margin: builds the maps, drops goals."""
        uncertainty_m, fence = self.maps.position_uncertainty_m, self.maps.fence
        self._build(site, vehicle, uncertainty_m, fence, before=None)
        self._solver.graph = self.graph

    @contextlib.contextmanager
    def all_or_nothing(self) -> Iterator[None]:
        """Context of several changes: after an error the planner is as before all of them."""
        before = dict(vars(self))
        try:
            yield
        except BaseException:
            vars(self).update(before)
            self._solver.graph = self.graph
            raise

    def set_exposed(self, exposed: BoolArray) -> None:
        """Raises the cost of cells (nx, nz) from which a failsafe would hit an obstacle.

        Drops goals, tables and a table in preparation. Other obstacles remove the exposed cells.
        """
        began_s = self._clock_s()
        maps = with_exposed(self._unexposed, exposed, self.vehicle.safety)
        self._take(maps, build_graph(maps, self.vehicle), began_s)
        self._solver.graph = self.graph

    def _build(
        self,
        site: Site,
        vehicle: Vehicle,
        position_uncertainty_m: float,
        fence: PlaneFence | None,
        *,
        before: Maps | None,
    ) -> None:
        began_s = self._clock_s()
        maps = build_maps(site, vehicle, position_uncertainty_m, fence=fence, before=before)
        graph = build_graph(maps, vehicle)
        self.site, self.vehicle = site, vehicle
        self._unexposed = maps
        self._take(maps, graph, began_s)

    def _clock_s(self) -> float | None:
        return None if self.clock is None else self.clock()

    def _passed_ms(self, began_s: float | None) -> float | None:
        """Time since then; None without a clock."""
        return None if self.clock is None or began_s is None else 1e3 * (self.clock() - began_s)

    def _take(self, maps: Maps, graph: Graph, began_s: float | None) -> None:
        self.maps, self.graph = maps, graph
        self._map_ms = self._passed_ms(began_s)
        self._goals: dict[_Key, MissionGoal] = {}
        self._tables: dict[_Key, _Prepared] = {}
        self._calibrations: dict[tuple[_Key, Weights, int], Calibration | None] = {}
        self._refiner: Refiner | None = None

    def plan(
        self,
        *,
        mission: Mission | str,
        target: str | int | None = None,
        start: PlanePoint | None = None,
        velocity: PlanePoint = (0.0, 0.0),
        weights: Weights | None = None,
        risk: RiskIndices | None = None,
        adaptation: AdaptationKind | str | None = None,
    ) -> Plan:
        """The optimal plan of a mission.

        target: for an inspection the target's name (the first of the site by default); for exit
        and evacuation the index of a landing point (any by default).
        start, velocity: of the vehicle in the plane, m and m/s; the site's start, at rest.
        weights: before the risks; the vehicle's for this mission by default.
        risk: indices that shift the weights; none by default.
        adaptation: its kind, calibrated from the start; the vehicle's by default.

        Without a plan the status is the reason. Raises InputError for a target or landing point
        that the site does not have, if no landing point is visible, and for a start or velocity
        that is not finite.
        """
        mission = Mission(mission)
        weights = self.vehicle.weights[mission] if weights is None else weights
        request = PlanRequest(
            mission=mission,
            target=target if target is None or isinstance(target, str) else int(target),
            start_m=self.site.start_m if start is None else _point(start),
            velocity_mps=_point(velocity),
            weights=weights,
            risk=_NO_RISK if risk is None else risk,
        )
        if risk is not None:
            kind = self.vehicle.adaptation if adaptation is None else AdaptationKind(adaptation)
            request = request.adapted(Adaptation(base=weights, kind=kind))
            request = self.calibrated(request, request.start_m)
        return self.solve(request)

    def calibrated(self, request: PlanRequest, origin_m: tuple[float, ...]) -> PlanRequest:
        """The request with its weights calibrated on the front from an origin, at rest there.

        As it is, if its adaptation is of another kind, or no path leads from there. Takes the time
        of up to `calibration.MOST_PLANS` plans, once for each origin. Raises InputError as `plan`.
        """
        adaptation, cell = request.adaptation, self.maps.grid.cell_of(origin_m)
        if adaptation is None or adaptation.kind is not AdaptationKind.CALIBRATED or cell is None:
            return request
        target = request.target
        if request.mission.visits_targets:
            target = self.site.target(target).name
        key = ((request.mission, target), adaptation.base, self.graph.grid.flat(cell))
        if key not in self._calibrations:
            while len(self._calibrations) >= _MOST_CALIBRATIONS:
                del self._calibrations[next(iter(self._calibrations))]
            at_rest = (0.0,) * len(origin_m)
            first = replace(request, target=target, start_m=origin_m, velocity_mps=at_rest)
            self._calibrations[key] = self._calibration(first, adaptation.base)
        return request.adapted(replace(adaptation, calibration=self._calibrations[key]))

    def _calibration(self, request: PlanRequest, base: Weights) -> Calibration | None:
        if self.solve(request).cost is None:
            return None

        def cost(weights: Weights) -> Cost:
            found = self.solve(replace(request, weights=weights)).cost
            assert found is not None  # no weights make a way free or bar one
            return found

        return calibrated(base, cost)

    def is_prepared(self, *, mission: Mission, target: str | int | None) -> bool:
        """True once the table of a goal is complete."""
        prepared = self._tables.get((mission, target))
        return prepared is not None and prepared.ready

    def solve(self, request: PlanRequest) -> Plan:
        """The answer to a request; errors as of `plan`."""
        problem = self.problem(request)
        return problem if isinstance(problem, Plan) else self._search(problem)

    def problem(self, request: PlanRequest) -> SearchProblem | Plan:
        """A request in the graph's terms; a plan without a path where start or goal exclude one.

        Errors as of `plan`.
        """
        target = None
        if request.mission.visits_targets:
            target = self.site.target(request.target)
            if request.target != target.name:
                request = replace(request, target=target.name)
        grid, occupied = self.maps.grid, self.maps.occupied
        start_cell = grid.cell_of(request.start_m)
        if start_cell is None:
            return self._none(request, PlanStatus.OUT_OF_BOUNDS, "the start", request.start_m)
        if occupied[start_cell]:
            return self._none(request, PlanStatus.START_OCCUPIED, "the start", request.start_m)
        goal = self._goal((request.mission, request.target))
        if target is not None and not goal.cells:
            outside = grid.cell_of(target.position_m) is None
            status = PlanStatus.OUT_OF_BOUNDS if outside else PlanStatus.TARGET_OCCUPIED
            return self._none(request, status, f"target {target.name}", target.position_m)
        velocity = np.zeros(3)
        velocity[: len(start_cell)] = request.velocity_mps
        return SearchProblem(
            request=request, start=grid.flat(start_cell), velocity_mps=velocity, goal=goal
        )

    def choose(
        self,
        wish: Wish,
        *,
        mission: Mission | str,
        target: str | int | None = None,
        start: PlanePoint | None = None,
        velocity: PlanePoint = (0.0, 0.0),
        power_w: PowerW | None = None,
    ) -> Choice:
        """The best path of the whole front for a wish, exactly; arguments and errors as of `plan`.

        power_w: of level and upward speeds in m/s, needed for a limit of the energy; ValueError
        without it.
        """
        # Imported here: no flight needs it, so that no start loads its kernels.
        from .whole_front import choose  # noqa: PLC0415

        request = self.plan(mission=mission, target=target, start=start, velocity=velocity).request
        return choose(self, request, wish, power_w)

    def refine(self, plan: Plan) -> Refinement:
        """A plan's path at any angle, of no greater J as a continuous path.

        Raises ValueError for a plan without a path, or one made before the obstacles changed.
        """
        # Imported here: no flight needs it, so that no start loads its kernels.
        from .refinement import Refiner  # noqa: PLC0415

        if plan.status is not PlanStatus.FOUND or plan.maps is not self.maps:
            raise ValueError("only a path on the planner's own maps can be refined")
        if self._refiner is None:
            self._refiner = Refiner(self.site, self.vehicle, self.maps)
        region = self._goal((plan.mission, plan.request.target)).region
        began_s = self._clock_s()
        refinement = self._refiner.refine(plan, region)
        return replace(refinement, compute_ms=self._passed_ms(began_s))

    def _search(self, problem: SearchProblem) -> Plan:
        began_s = self._clock_s()
        request, goal = problem.request, problem.goal.goal
        start, velocity = problem.start, problem.velocity_mps
        headings: IntArray | None
        if problem.is_at_goal:
            headings, expanded = problem.stop_headings, 0
        else:
            prepared = self._tables.get((request.mission, request.target))
            headings, expanded = (
                self._solver.cold(goal, start, velocity, request.weights)
                if prepared is None
                else self._solver.between(goal, prepared.table, start, velocity, request.weights)
            )
        if headings is None:
            return self._none(request, PlanStatus.UNREACHABLE, "the goal", None)
        states, cost = walked(self.graph, start, velocity, headings, request.weights)
        search_ms = self._passed_ms(began_s)
        compute = Compute(map_ms=self._map_ms, search_ms=search_ms, expanded=expanded)
        return self.found(request, states, cost, compute)

    def found(self, request: PlanRequest, states: IntArray, cost: Cost, compute: Compute) -> Plan:
        """The plan of a path that was found on these maps. states: (n, 3), read-only."""
        region, land = self._goal((request.mission, request.target)).region, None
        if region is not None:
            end: Cell = (int(states[-1, 0]), int(states[-1, 1]))
            land = partial(landing_leg, self.site, self.vehicle, region, end)
        return Plan(
            request=request,
            site=self.site.name,
            graph=self.graph,
            maps=self.maps,
            status=PlanStatus.FOUND,
            reason="",
            compute=compute,
            states=states,
            cost=cost,
            land=land,
        )

    def _none(
        self,
        request: PlanRequest,
        status: PlanStatus,
        what: str,
        point_m: tuple[float, ...] | None,
    ) -> Plan:
        """A plan without a path; what, at point_m: the reason."""
        return Plan(
            request=request,
            site=self.site.name,
            graph=self.graph,
            maps=self.maps,
            status=status,
            reason=reason_of(status, what, point_m, self.site, self.maps),
            compute=Compute(map_ms=self._map_ms, search_ms=0.0, expanded=0),
            states=np.empty((0, len(self.graph.grid.shape) + 1), dtype=np.int64),
        )

    def _goal(self, key: _Key) -> MissionGoal:
        """The goal of a mission and target, computed once."""
        goals = self._goals
        if key not in goals:
            goals[key] = self._make_goal(*key)
        return goals[key]

    def _make_goal(self, mission: Mission, target: str | int | None) -> MissionGoal:
        grid = self.graph.grid
        region = None
        if mission.visits_targets:
            cell = grid.cell_of(self.site.target(target).position_m)
            cells = [] if cell is None or self.maps.occupied[cell] else [cell]
        else:
            region = goal_region(self.site, self.vehicle, self.maps, mission, target)
            cells = [tuple(cell) for cell in region.corners]
        flat = [grid.flat(cell) for cell in cells]
        leg_m = [0.0] * len(cells) if region is None else [*region.length_m.values()]
        return MissionGoal(
            goal=Goal(
                cells=np.array(flat, dtype=np.int64),
                leg_m=np.array(leg_m),
                ends_at_rest=region is None,
            ),
            cells=frozenset(flat),
            region=region,
        )


def _point(values: PlanePoint) -> PlanePoint:
    """Two floats from numbers of any type; ValueError for another count."""
    x, z = values
    return float(x), float(z)
