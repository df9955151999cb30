"""The compiled loops over straight legs: their cost, their obstacles, cheaper paths.

J of a path of straight legs: a leg is sampled at equal distances. SC and v_sat are interpolated
bilinearly between the cells' centres, v_max linearly over the leg's elevation. Trapezoids sum the
costs of distance and time. The velocity's change is summed from sample to sample and, as a vector,
from leg to leg.
"""

from __future__ import annotations

import numpy as np

from .arrays import FIELD, PATH, TERMS, Field, Path, Terms
from .grid import TOLERANCE, FloatArray, IntArray
from .jit import BOOL, F8, I8, jit, read, several, written

_SUMS = several(F8, F8, F8, F8, F8, F8, F8)
_NOT_FREE = (np.inf, np.inf, np.inf, 0.0, 0.0, 0.0, 0.0)
_SAME_POINT_M = 1e-6
_BENDS = (0.5, 0.2, 0.8)
"""Positions along a leg at which a point is inserted beside it."""
_SWEEPS = 4
"""Sweeps over all points with steps of one length; most end earlier, without a gain."""
_GAIN = 1e-5
"""Relative saving that a change must bring."""
_MORE_POINTS = 60
"""Most points added to a path."""


@jit(_SUMS, F8, F8, F8, F8, FIELD)
def leg_sums(
    from_x: float, from_z: float, to_x: float, to_z: float, field: Field
) -> tuple[float, float, float, float, float, float, float]:
    """SC d, seconds and velocity change of a straight leg; its velocity at both ends.

    The sums are infinite where a sample is in an occupied cell or outside.
    """
    dx, dz = to_x - from_x, to_z - from_z
    length = np.sqrt(dx * dx + dz * dz)
    if length == 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    columns, rows = field.free.shape
    column, row = (from_x - field.left_m) / field.cell_m, (from_z - field.low_m) / field.cell_m
    across, up = dx / field.cell_m, dz / field.cell_m
    if (
        min(column, row, column + across, row + up) < -TOLERANCE
        or max(column, column + across) > columns + TOLERANCE
        or max(row, row + up) > rows + TOLERANCE
    ):
        return _NOT_FREE
    eighth = (np.arctan2(dz, abs(dx)) + 0.5 * np.pi) / (0.25 * np.pi)
    sector = min(int(eighth), 3)
    share = eighth - sector
    v_max = (1.0 - share) * field.elevation_mps[sector] + share * field.elevation_mps[sector + 1]
    count = max(int(np.ceil(length / field.spacing_m - TOLERANCE)), 1)
    across, up = across / count, up / count
    safety, seconds, change = 0.0, 0.0, 0.0
    first, last = 0.0, 0.0
    for sample in range(count + 1):
        x, z = column + sample * across, row + sample * up
        if not field.free[
            np.uint64(min(int(x + TOLERANCE), columns - 1)),
            np.uint64(min(int(z + TOLERANCE), rows - 1)),
        ]:
            return _NOT_FREE
        x, z = min(max(x - 0.5, 0.0), columns - 1.0), min(max(z - 0.5, 0.0), rows - 1.0)
        left, low = np.uint64(x), np.uint64(z)
        right, high = np.uint64(min(int(x) + 1, columns - 1)), np.uint64(min(int(z) + 1, rows - 1))
        x, z = x - int(x), z - int(z)
        ne, nw, se = x * z, (1.0 - x) * z, x * (1.0 - z)
        sw = 1.0 - x - nw
        here = (
            sw * field.values[left, low, 0]
            + se * field.values[right, low, 0]
            + nw * field.values[left, high, 0]
            + ne * field.values[right, high, 0]
        )
        speed = min(
            v_max,
            sw * field.values[left, low, 1]
            + se * field.values[right, low, 1]
            + nw * field.values[left, high, 1]
            + ne * field.values[right, high, 1],
        )
        if sample == 0:
            first = last = speed
        weight = 0.5 if sample in (0, count) else 1.0
        safety += weight * here
        seconds += weight / speed
        change += abs(speed - last)
        last = speed
    step, ux, uz = length / count, dx / length, dz / length
    return (
        safety * step, seconds * step, change, first * ux, first * uz, last * ux, last * uz
    )  # fmt: skip


@jit(several(F8, F8, F8), read(F8, 2), F8, F8, BOOL, FIELD)
def path_sums(
    points_m: FloatArray, vx: float, vz: float, ends_at_rest: bool, field: Field
) -> tuple[float, float, float]:
    """SC d, seconds and velocity change of a path that begins with a velocity."""
    safety, seconds, change = 0.0, 0.0, 0.0
    for at in range(len(points_m) - 1):
        here, there = points_m[at], points_m[at + 1]
        if here[0] == there[0] and here[1] == there[1]:
            continue
        weighted_m, duration, within, first_x, first_z, last_x, last_z = leg_sums(
            here[0], here[1], there[0], there[1], field
        )
        safety += weighted_m
        seconds += duration
        change += within + np.sqrt((first_x - vx) ** 2 + (first_z - vz) ** 2)
        vx, vz = last_x, last_z
    if ends_at_rest:
        change += np.sqrt(vx * vx + vz * vz)
    return safety, seconds, change


@jit(F8, F8, F8, F8, F8, F8, F8)
def _to_segment(
    x: float, z: float, from_x: float, from_z: float, to_x: float, to_z: float
) -> float:
    """The square of a point's distance from a segment."""
    dx, dz = to_x - from_x, to_z - from_z
    squared = dx * dx + dz * dz
    share = 0.0
    if squared > 0.0:
        share = min(max(((x - from_x) * dx + (z - from_z) * dz) / squared, 0.0), 1.0)
    distance: float = (x - from_x - share * dx) ** 2 + (z - from_z - share * dz) ** 2
    return distance


@jit(F8, F8, F8, F8, F8, read(F8, 2), I8, I8)
def _to_outline(
    from_x: float,
    from_z: float,
    to_x: float,
    to_z: float,
    vertices_m: FloatArray,
    first: int,
    end: int,
) -> float:
    """A leg's distance from the outline of a ring; 0 where they cross."""
    least = np.inf
    for corner in range(first, end):
        following = corner + 1 if corner + 1 < end else first
        ax, az = vertices_m[corner, 0], vertices_m[corner, 1]
        bx, bz = vertices_m[following, 0], vertices_m[following, 1]
        least = min(least, _to_segment(ax, az, from_x, from_z, to_x, to_z))
        if end - first > 1:
            least = min(
                least,
                _to_segment(from_x, from_z, ax, az, bx, bz),
                _to_segment(to_x, to_z, ax, az, bx, bz),
            )
            dx, dz, ex, ez = to_x - from_x, to_z - from_z, bx - ax, bz - az
            across_leg = (dx * (az - from_z) - dz * (ax - from_x)) * (
                dx * (bz - from_z) - dz * (bx - from_x)
            )
            across_edge = (ex * (from_z - az) - ez * (from_x - ax)) * (
                ex * (to_z - az) - ez * (to_x - ax)
            )
            if across_leg < 0.0 and across_edge < 0.0:
                return 0.0
    distance: float = np.sqrt(least)
    return distance


@jit(written(F8), read(F8, 2), read(F8, 2), read(I8))
def outline_distances(points_m: FloatArray, vertices_m: FloatArray, first: IntArray) -> FloatArray:
    """Distances of a path (n, 2) from the outlines of rings (`distance_kernels`)."""
    found = np.full(len(first) - 1, np.inf)
    for ring in range(len(found)):
        for at in range(1, len(points_m)):
            here, there = points_m[at - 1], points_m[at]
            distance = _to_outline(
                here[0], here[1], there[0], there[1], vertices_m, first[ring], first[ring + 1]
            )
            found[ring] = min(found[ring], distance)
    return found


@jit(BOOL, F8, F8, F8, F8, TERMS)
def leg_is_free(from_x: float, from_z: float, to_x: float, to_z: float, terms: Terms) -> bool:
    """Returns True if a leg touches free cells alone, keeps its distances and is nowhere too low.

    Cells are touched within `TOLERANCE`: on a border both, on a corner all four.
    """
    field, limits = terms.field, terms.limits
    if min(from_z, to_z) < limits.lowest_m:
        return False
    columns, rows = field.free.shape
    column, row = (from_x - field.left_m) / field.cell_m, (from_z - field.low_m) / field.cell_m
    across, up = (to_x - from_x) / field.cell_m, (to_z - from_z) / field.cell_m
    left, right = min(column, column + across), max(column, column + across)
    low, high = min(row, row + up), max(row, row + up)
    if min(left, low) < -TOLERANCE or right > columns + TOLERANCE or high > rows + TOLERANCE:
        return False
    near = False
    for ix in range(max(int(left - TOLERANCE), 0), min(int(right + TOLERANCE), columns - 1) + 1):
        bottom, top = low, high
        if abs(across) > TOLERANCE:
            begin = min(max((ix - TOLERANCE - column) / across, 0.0), 1.0)
            end = min(max((ix + 1 + TOLERANCE - column) / across, 0.0), 1.0)
            bottom, top = row + min(begin * up, end * up), row + max(begin * up, end * up)
        for iz in range(max(int(bottom - TOLERANCE), 0), min(int(top + TOLERANCE), rows - 1) + 1):
            if field.free[ix, iz] == 0:
                return False
            near = near or field.free[ix, iz] == 1
    if near:
        for ring in range(len(limits.keep_m)):
            distance = _to_outline(
                from_x, from_z, to_x, to_z,
                limits.vertices_m, limits.first[ring], limits.first[ring + 1],
            )  # fmt: skip
            if distance < limits.keep_m[ring]:
                return False
    return True


@jit(F8, written(F8, 2), I8, F8, F8, F8, F8, TERMS)
def _price(
    legs: FloatArray,
    at: int,
    from_x: float,
    from_z: float,
    to_x: float,
    to_z: float,
    terms: Terms,
) -> float:
    """Writes a leg to a row; its cost, infinite for a leg that is not free or has no length."""
    safety, seconds, change, legs[at, 1], legs[at, 2], legs[at, 3], legs[at, 4] = leg_sums(
        from_x, from_z, to_x, to_z, terms.field
    )
    total = np.inf
    if safety < np.inf and abs(to_x - from_x) + abs(to_z - from_z) > _SAME_POINT_M:
        cost = terms.cost
        total = cost.safety * safety + cost.time * seconds + cost.energy * change
    legs[at, 0] = total
    return total


@jit(F8, F8, F8, written(F8, 2), I8)
def _turn(vx: float, vz: float, legs: FloatArray, at: int) -> float:
    """The velocity's change at the beginning of a leg."""
    change: float = np.sqrt((legs[at, 1] - vx) ** 2 + (legs[at, 2] - vz) ** 2)
    return change


@jit(I8, PATH, I8, I8, I8, I8, TERMS)
def _put_in(path: Path, size: int, after: int, before: int, count: int, terms: Terms) -> int:
    """Replaces the points between two by `count` of `new_m`, where that is free and saves.

    size: legs of the path. before: `size + 1` for points that are its new end. Returns the new
    number of legs, 0 for an unchanged path.
    """
    points, legs, new_m, new = path.points_m, path.legs, path.new_m, path.new
    end, old, energy = min(before, size), 0.0, terms.cost.energy
    for at in range(after + 1, end + 1):
        old += legs[at, 0] + energy * _turn(legs[at - 1, 3], legs[at - 1, 4], legs, at)
    if end < size:
        old += energy * _turn(legs[end, 3], legs[end, 4], legs, end + 1)
    elif terms.ends_at_rest:
        old += energy * np.sqrt(legs[end, 3] ** 2 + legs[end, 4] ** 2)
    if before <= size:
        new_m[count] = points[before]
        count += 1
    total = 0.0
    x, z, vx, vz = points[after, 0], points[after, 1], legs[after, 3], legs[after, 4]
    for at in range(count):
        total += _price(new, at, x, z, new_m[at, 0], new_m[at, 1], terms)
        total += energy * _turn(vx, vz, new, at)
        if not total < old:
            return 0
        x, z, vx, vz = new_m[at, 0], new_m[at, 1], new[at, 3], new[at, 4]
    if end < size:
        total += energy * _turn(vx, vz, legs, end + 1)
    elif terms.ends_at_rest:
        total += energy * np.sqrt(vx * vx + vz * vz)
    if not total < (1.0 - _GAIN) * old:
        return 0
    x, z = points[after, 0], points[after, 1]
    for at in range(count):
        if not leg_is_free(x, z, new_m[at, 0], new_m[at, 1], terms):
            return 0
        x, z = new_m[at, 0], new_m[at, 1]
    if before > size:
        field, (columns, rows) = terms.field, terms.goal.shape
        ix = min(int((x - field.left_m) / field.cell_m + TOLERANCE), columns - 1)
        iz = min(int((z - field.low_m) / field.cell_m + TOLERANCE), rows - 1)
        if not terms.goal[ix, iz]:
            return 0
    shift = count - (end - after)
    for at in range(size, end, -1) if shift > 0 else range(end + 1, size + 1):
        points[at + shift] = points[at]
        legs[at + shift] = legs[at]
    for at in range(count):
        points[after + 1 + at] = new_m[at]
        legs[after + 1 + at] = new[at]
    return size + shift


@jit(several(F8, F8, F8), PATH, I8, I8)
def _towards(path: Path, first: int, second: int) -> tuple[float, float, float]:
    """From one point to another: the unit vector and the distance."""
    dx = path.points_m[second, 0] - path.points_m[first, 0]
    dz = path.points_m[second, 1] - path.points_m[first, 1]
    length = np.sqrt(dx * dx + dz * dz)
    return (dx / length, dz / length, length) if length > 0.0 else (1.0, 0.0, 0.0)


@jit(I8, PATH, I8, I8, F8, TERMS)
def _bent(path: Path, size: int, at: int, step_m: float, terms: Terms) -> int:
    """`_put_in` of a point beside the leg to a point."""
    if size + 2 > len(path.points_m):
        return 0
    dx, dz, length = _towards(path, at - 1, at)
    for bend in _BENDS:
        along_m = bend * length
        if min(along_m, length - along_m) < step_m:
            continue
        for aside_m in (-step_m, step_m):
            path.new_m[0, 0] = path.points_m[at - 1, 0] + along_m * dx - aside_m * dz
            path.new_m[0, 1] = path.points_m[at - 1, 1] + along_m * dz + aside_m * dx
            longer = _put_in(path, size, at - 1, at, 1, terms)
            if longer:
                return longer
    return 0


@jit(BOOL, PATH, I8, I8, F8, TERMS)
def _moved(path: Path, size: int, at: int, step_m: float, terms: Terms) -> bool:
    """Moves a point along or across the path, in steps that double on success; True if moved."""
    moved = False
    dx, dz, _ = _towards(path, at - 1, min(at + 1, size))
    for _ in range(4):
        far_m = step_m
        while True:
            path.new_m[0, 0] = path.points_m[at, 0] + far_m * dx
            path.new_m[0, 1] = path.points_m[at, 1] + far_m * dz
            if not _put_in(path, size, at - 1, at + 1, 1, terms):
                break
            moved = True
            far_m *= 2.0
        dx, dz = -dz, dx
    return moved


@jit(TERMS, TERMS, F8)
def _sampled(terms: Terms, spacing_m: float) -> Terms:
    """Cost terms with samples at another distance."""
    field = terms.field
    coarser = Field(
        field.values, field.free, field.elevation_mps,
        field.left_m, field.low_m, field.cell_m, spacing_m,
    )  # fmt: skip
    return Terms(coarser, terms.limits, terms.cost, terms.goal, terms.ends_at_rest)


@jit(written(F8, 2), read(F8, 2), F8, F8, read(F8, 2), TERMS)
def refined(
    points_m: FloatArray, vx: float, vz: float, levels: FloatArray, whole: Terms
) -> FloatArray:
    """A cheaper path, (m, 2), found from a free one, (n, 2), by changes of one point that save.

    levels: (l, 2) steps and distances of samples, in cells. With each step's length in turn, a
    point is left out, put in beside a leg, or moved (at the end only within the goal), until
    no change saves: a pattern search (Hooke and Jeeves 1961), as J has a kink wherever a
    speed does. It finds a local optimum; its changes are priced at their level's samples.
    """
    capacity = len(points_m) + _MORE_POINTS
    path = Path(
        np.empty((capacity, 2)), np.zeros((capacity, 5)), np.empty((2, 2)), np.empty((2, 5))
    )
    points, size = path.points_m, len(points_m) - 1
    points[: size + 1] = points_m
    path.legs[0, 3], path.legs[0, 4] = vx, vz
    for level in range(len(levels)):
        step_m = levels[level, 0] * whole.field.cell_m
        terms = _sampled(whole, levels[level, 1] * whole.field.cell_m)
        for at in range(1, size + 1):
            before, here = points[at - 1], points[at]
            _price(path.legs, at, before[0], before[1], here[0], here[1], terms)
        for _ in range(_SWEEPS):
            better, at = False, 1
            while at <= size:
                shorter = _put_in(path, size, at - 1, at + 1, 0, terms) if at < size else 0
                if shorter:
                    size, better = shorter, True
                    continue
                longer = _bent(path, size, at, step_m, terms)
                if longer:
                    size, better = longer, True
                if at < size or not terms.ends_at_rest:
                    better = _moved(path, size, at, step_m, terms) or better
                at += 1
            if not better:
                break
    return points[: size + 1].copy()
