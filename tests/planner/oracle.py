"""A slow and plain planner, written from the paper and the rules of the docstrings, not the code.

Maps are loops over cells and obstacles, geometry is shapely's, the search is a Dijkstra over
(cell, heading) with a heap and dictionaries. Costs are counted in whole units of 1e-15, so that
sums do not depend on their order and equal costs are equal.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass
from itertools import pairwise

from shapely.geometry import LineString, MultiPoint, Point, Polygon, box

from moar_companion.planner.site import Conductor
from moar_companion.types import Mission

DIRECTIONS = [(0, 0), (0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1)]
UNIT = 1e15
NEAR = 1e-9
FAR = 1e4


@dataclass
class Maps:
    shape: tuple[int, int]
    occupied: dict
    d_obs: dict
    d_ch: dict
    d_hor: dict
    collision: dict
    insertion: dict
    damage: dict
    safety: dict
    v_sat: dict


def shape_of(workspace):
    return tuple(
        max(1, math.floor((upper - lower) / workspace.resolution_m + NEAR))
        for lower, upper in zip(workspace.lower_m, workspace.upper_m, strict=True)
    )


def centre_of(workspace, cell):
    return tuple(
        lower + (index + 0.5) * workspace.resolution_m
        for lower, index in zip(workspace.lower_m, cell, strict=True)
    )


def cell_of(workspace, point):
    cell = []
    for value, lower, count in zip(point, workspace.lower_m, shape_of(workspace), strict=True):
        index = math.floor((value - lower) / workspace.resolution_m + NEAR)
        if index == count and value <= lower + count * workspace.resolution_m + NEAR:
            index = count - 1
        if not 0 <= index < count:
            return None
        cell.append(index)
    return tuple(cell)


def geometry_of(obstacle):
    if isinstance(obstacle, Conductor):
        return Point(obstacle.position_m), obstacle.radius_m
    return Polygon(obstacle.vertices_m), 0.0


def clearance(obstacle, geometry):
    """Distance from any geometry to an obstacle's surface, 0 inside."""
    shape, radius = geometry_of(obstacle)
    return max(0.0, shape.distance(geometry) - radius)


def cost_of_distance(distance, safety):
    """Eq. 3."""
    if distance < safety.d_min_m:
        return 1.0
    if distance <= safety.d_max_m:
        alpha = safety.d_min_m / (safety.d_max_m - safety.d_min_m)
        return alpha * (safety.d_max_m / distance - 1.0)
    return 0.0


def speed_limit(distance, vehicle):
    """Eq. 5."""
    safety, speed = vehicle.safety, vehicle.speed
    if distance < safety.d_min_m:
        return speed.min_mps
    if distance <= safety.d_max_m:
        beta = (speed.max_mps - speed.min_mps) / (safety.d_max_m - safety.d_min_m)
        return speed.min_mps + beta * (distance - safety.d_min_m)
    return speed.max_mps


def heading_speed(heading, speed):
    dx, dz = DIRECTIONS[heading]
    if dx == 0 and dz == 0:
        return 0.0
    if dz == 0:
        return speed.horizontal_mps
    if dx == 0:
        return speed.up_mps if dz > 0 else speed.down_mps
    return speed.diagonal_up_mps if dz > 0 else speed.diagonal_down_mps


def horizontal_distance(obstacles, x, z):
    """Least horizontal distance to an obstacle point strictly below."""
    best = math.inf
    for obstacle in obstacles:
        shape, _ = geometry_of(obstacle)
        if isinstance(obstacle, Conductor):
            if obstacle.position_m[1] < z:
                best = min(best, abs(x - obstacle.position_m[0]))
            continue
        below = shape.intersection(box(-FAR, -FAR, FAR, z))
        for piece in getattr(below, "geoms", [below]):
            if piece.area > 0.0:
                left, _, right, _ = piece.bounds
                best = min(best, max(0.0, left - x, x - right))
    return best


def build_maps(site, vehicle, uncertainty_m=0.0):
    space, safety = site.workspace, vehicle.safety
    shape = shape_of(space)
    points = [
        point
        for obstacle in site.obstacles
        for point in (
            [obstacle.position_m] if isinstance(obstacle, Conductor) else obstacle.vertices_m
        )
    ]
    hull = MultiPoint(points).convex_hull
    lowest = min((z for _, z in points), default=math.inf)
    maps = Maps(shape, {}, {}, {}, {}, {}, {}, {}, {}, {})
    for cell in ((ix, iz) for ix in range(shape[0]) for iz in range(shape[1])):
        x, z = centre_of(space, cell)
        here = Point(x, z)
        clearances = [clearance(obstacle, here) for obstacle in site.obstacles]
        d_obs = min(clearances, default=math.inf)
        d_ch = hull.distance(here) if points else math.inf
        d_hor = horizontal_distance(site.obstacles, x, z)
        if z - lowest < d_hor - NEAR:
            d_hor = math.inf
        occupied = any(
            distance < vehicle.radius_m + uncertainty_m + obstacle.keep_out_m - NEAR
            for distance, obstacle in zip(clearances, site.obstacles, strict=True)
        )
        if space.min_altitude_m is not None and z < space.min_altitude_m - NEAR:
            occupied = True
        maps.occupied[cell] = occupied
        maps.d_obs[cell], maps.d_ch[cell], maps.d_hor[cell] = d_obs, d_ch, d_hor
        maps.collision[cell] = cost_of_distance(d_obs, safety)
        maps.insertion[cell] = cost_of_distance(d_ch, safety)
        maps.damage[cell] = cost_of_distance(d_hor, safety)
        maps.safety[cell] = (
            safety.collision * maps.collision[cell]
            + safety.insertion * maps.insertion[cell]
            + safety.damage * maps.damage[cell]
        )
        maps.v_sat[cell] = speed_limit(d_obs, vehicle)
    return maps


def flyable_rectangle(site):
    """(x_low, z_low, x_high, z_high, lowest row), or None when every row is too low."""
    space = site.workspace
    columns, rows = shape_of(space)
    low = space.min_altitude_m
    lowest = [
        row for row in range(rows) if low is None or centre_of(space, (0, row))[1] >= low - NEAR
    ]
    if not lowest:
        return None
    r = space.resolution_m
    return (
        space.lower_m[0],
        space.lower_m[1] + lowest[0] * r,
        space.lower_m[0] + columns * r,
        space.lower_m[1] + rows * r,
        lowest[0],
    )


def leg_of(start, end):
    return Point(end) if math.dist(start, end) < NEAR else LineString([start, end])


def leg_clears(site, required_m, start, end):
    """True if a straight leg keeps that far, and their keep-out more, from all obstacles."""
    return all(
        clearance(obstacle, leg_of(start, end)) >= required_m + obstacle.keep_out_m - NEAR
        for obstacle in site.obstacles
    )


def edge_midpoints(site, cell):
    """The midpoints of a cell's edges that lie on the border of the flyable rectangle."""
    x_low, z_low, x_high, z_high, _ = flyable_rectangle(site)
    x, z = centre_of(site.workspace, cell)
    half = 0.5 * site.workspace.resolution_m
    edges = [(x - half, z), (x + half, z), (x, z - half), (x, z + half)]
    borders = [(0, x_low), (0, x_high), (1, z_low), (1, z_high)]
    return [
        edge
        for edge, (axis, border) in zip(edges, borders, strict=True)
        if abs(edge[axis] - border) < NEAR
    ]


def goal_region(site, vehicle, maps, mission, landing=None, uncertainty_m=0.0):
    """The cells in which an exit or evacuation may end."""
    rectangle = flyable_rectangle(site)
    points = site.landing_m.get(mission, ())
    if landing is not None:
        points = points[landing : landing + 1]
    required_m = vehicle.radius_m + uncertainty_m
    region = set()
    if rectangle is None:
        return region
    x_low, z_low, x_high, z_high, _ = rectangle
    interior = box(x_low + NEAR, z_low + NEAR, x_high - NEAR, z_high - NEAR)
    for x, z in points:
        above = (x, z + vehicle.guidance.landing_height_m)
        if x_low + NEAR < x < x_high - NEAR and z_low + NEAR < z < z_high - NEAR:
            cell = cell_of(site.workspace, (x, z))
            centre = centre_of(site.workspace, cell)
            if not maps.occupied[cell] and leg_clears(site, required_m, centre, above):
                region.add(cell)
            continue
        for cell, occupied in maps.occupied.items():
            if occupied:
                continue
            for edge in edge_midpoints(site, cell):
                if (
                    not leg_of(edge, (x, z)).intersects(interior)
                    and leg_clears(site, required_m, edge, (x, z))
                    and leg_clears(site, required_m, edge, above)
                    and leg_clears(site, required_m, above, (x, z))
                ):
                    region.add(cell)
    return region


def goal_of(problem, maps):
    """The cells of a problem's goal."""
    if problem.mission is Mission.INSPECTION:
        target = next(t for t in problem.site.targets if t.name == problem.target)
        return {cell_of(problem.site.workspace, target.position_m)}
    return goal_region(problem.site, problem.vehicle, maps, problem.mission, problem.target)


def moves_from(maps, cell):
    """(heading, arrival cell) of every move from a cell; no diagonal between occupied cells."""
    x, z = cell
    for heading, (dx, dz) in enumerate(DIRECTIONS[1:], start=1):
        passed = {(x + dx, z + dz), (x + dx, z), (x, z + dz)}
        if all(not maps.occupied.get(other, True) for other in passed):
            yield heading, (x + dx, z + dz)


def velocity_in(maps, vehicle, cell, heading):
    dx, dz = DIRECTIONS[heading]
    if heading == 0:
        return 0.0, 0.0
    speed = min(maps.v_sat[cell], heading_speed(heading, vehicle.speed))
    length = math.hypot(dx, dz)
    return speed * dx / length, speed * dz / length


def step_terms(problem, maps, velocity, cell, heading):
    """(SC d, TC, EC) of the step that arrives in a cell, and the velocity there."""
    arrival = velocity_in(maps, problem.vehicle, cell, heading)
    change = math.dist(arrival, velocity) / (2.0 * problem.vehicle.speed.max_mps)
    length = math.hypot(*DIRECTIONS[heading]) * problem.site.workspace.resolution_m
    time = length / math.hypot(*arrival) if heading else 0.0
    return (maps.safety[cell] * length, time, change), arrival


def weighted(weights, terms):
    return weights.safety * terms[0] + weights.time * terms[1] + weights.energy * terms[2]


def shortest(problem, maps, goal):
    """The least (J, sum TC + sum EC, actions) to a goal, in that order; None if unreachable."""
    start = cell_of(problem.site.workspace, problem.start_m)
    at_rest = tuple(problem.velocity_mps) == (0.0, 0.0)
    needs_rest = problem.mission is Mission.INSPECTION
    # The start that moves is a state of its own: the vehicle's velocity is in no table.
    origin = (start, 0) if at_rest else (start, None)
    known = {origin: (0, 0, 0)}
    queue = [((0, 0, 0), 0, origin)]
    done = set()
    pushed = 0
    while queue:
        cost, _, state = heapq.heappop(queue)
        if state in done:
            continue
        done.add(state)
        cell, heading = state
        if cell in goal and (heading == 0 or not needs_rest):
            return cost[0] / UNIT, cost[1] / UNIT, cost[2]
        velocity = (
            problem.velocity_mps
            if heading is None
            else velocity_in(maps, problem.vehicle, cell, heading)
        )
        actions = list(moves_from(maps, cell))
        if heading != 0:
            actions.append((0, cell))
        for action, there in actions:
            terms, _ = step_terms(problem, maps, velocity, there, action)
            longer = (
                cost[0] + round(weighted(problem.weights, terms) * UNIT),
                cost[1] + round((terms[1] + terms[2]) * UNIT),
                cost[2] + 1,
            )
            after = (there, action)
            if after not in known or longer < known[after]:
                known[after] = longer
                pushed += 1
                heapq.heappush(queue, (longer, pushed, after))
    return None


def cost_terms(problem, maps, states):
    """The sums (SC d, TC, EC) of a path of states; AssertionError where a step is not legal."""
    states = [tuple(int(value) for value in state) for state in states]
    assert states[0] == (*cell_of(problem.site.workspace, problem.start_m), 0)
    velocity, steps = problem.velocity_mps, []
    resting = tuple(velocity) == (0.0, 0.0)
    for (x, z, _), (to_x, to_z, heading) in pairwise(states):
        if heading == 0:
            assert (to_x, to_z) == (x, z), "a stop stays in its cell"
            assert not resting, "a stop after a stop is no action"
        else:
            assert (heading, (to_x, to_z)) in set(moves_from(maps, (x, z))), "an illegal move"
        terms, velocity = step_terms(problem, maps, velocity, (to_x, to_z), heading)
        steps.append(terms)
        resting = heading == 0
    return tuple(math.fsum(column) for column in zip(*steps, strict=True)) or (0.0, 0.0, 0.0)


def ends_as_it_must(problem, goal, states):
    """An inspection ends at rest in its target's cell, an exit when it first enters its region."""
    inside = [(int(x), int(z)) in goal for x, z, _ in states]
    if problem.mission is Mission.INSPECTION:
        return inside[-1] and states[-1][2] == 0
    return inside[-1] and not any(inside[:-1])
