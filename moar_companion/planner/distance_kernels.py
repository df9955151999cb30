"""The compiled loops over all cells: distances to obstacles, and the steps between cells.

Scalar loops: operations on whole rows, and array fills, take much longer to compile. Obstacles come
as rings of vertices, one after the other: ring k has those from `first[k]` to `first[k + 1]`. A
ring of one vertex is a point, a disc with its radius; of two, a segment.
"""

from __future__ import annotations

import numpy as np

from .grid import TOLERANCE, FloatArray, IntArray
from .jit import F8, I4, I8, U1, U4, jit, read, several, written


@jit(
    several(written(F8, 2), written(I4, 2), written(F8, 2), written(I4, 2)),
    read(F8), read(F8), read(F8, 2), read(I8), read(F8), read(F8), read(I4), read(U1),
    read(F8, 2), read(I4, 2), read(F8, 2), read(I4, 2),
)  # fmt: skip
def nearest_rings(
    x_m: FloatArray,
    z_m: FloatArray,
    vertices_m: FloatArray,
    first: IntArray,
    radius_m: FloatArray,
    keep_out_m: FloatArray,
    now: IntArray,
    is_new: IntArray,
    distance_before_m: FloatArray,
    nearest_before: IntArray,
    room_before_m: FloatArray,
    closest_before: IntArray,
) -> tuple[FloatArray, IntArray, FloatArray, IntArray]:
    """Distance to the nearest obstacle, 0 inside, and to the nearest keep-out, negative inside.

    Each (nx, nz), infinite without obstacles, and followed by the ring that it belongs to, or -1.
    now: index now of each earlier ring, or -1; is_new: 1 for each ring that was not there before.
    Earlier rings are evaluated again only in a column's rows with a removed ring, or with -1, and
    in rows between such.
    """
    shape = (len(x_m), len(z_m))
    distance_m, room_m = np.empty(shape), np.empty(shape)
    nearest, closest = np.empty(shape, dtype=np.int32), np.empty(shape, dtype=np.int32)
    squared, inside = np.empty(len(z_m)), np.empty(len(z_m), dtype=np.uint8)
    least, least_room = np.empty(len(z_m)), np.empty(len(z_m))
    whose, whose_room = np.empty(len(z_m)), np.empty(len(z_m))
    for column in range(len(x_m)):
        x = x_m[column]
        lost_begin, lost_end = len(z_m), 0
        for row in range(len(z_m)):
            ring, other = nearest_before[column, row], closest_before[column, row]
            ring = now[ring] if ring >= 0 else ring
            other = now[other] if other >= 0 else other
            least[row] = distance_before_m[column, row] if ring >= 0 else np.inf
            least_room[row] = room_before_m[column, row] if other >= 0 else np.inf
            whose[row], whose_room[row] = ring, other
            if ring < 0 or other < 0:
                lost_begin, lost_end = min(lost_begin, row), row + 1
        for ring in range(len(first) - 1):
            # Unsigned: an index that might be negative prevents vectorised loops.
            begin = np.uint64(0 if is_new[ring] else lost_begin)
            end = np.uint64(len(z_m) if is_new[ring] else lost_end)
            count = first[ring + 1] - first[ring]
            for row in range(begin, end):
                squared[row], inside[row] = np.inf, 0
            for corner in range(count):
                here, there = first[ring] + corner, first[ring] + (corner + 1) % count
                start_x, start_z = vertices_m[here, 0], vertices_m[here, 1]
                stop_x, stop_z = vertices_m[there, 0], vertices_m[there, 1]
                along_x, along_z = stop_x - start_x, stop_z - start_z
                length_squared = along_x * along_x + along_z * along_z
                scale = 1.0 / length_squared if length_squared > 0.0 else 0.0
                dx = x - start_x
                for row in range(begin, end):
                    dz = z_m[row] - start_z
                    share = min(max((dx * along_x + dz * along_z) * scale, 0.0), 1.0)
                    off_x, off_z = dx - share * along_x, dz - share * along_z
                    squared[row] = min(squared[row], off_x * off_x + off_z * off_z)
                if count > 2 and along_z != 0.0:
                    slope = along_x / along_z
                    for row in range(begin, end):
                        z = z_m[row]
                        crosses = (start_z > z) != (stop_z > z)
                        inside[row] ^= crosses and x < start_x + (z - start_z) * slope
            radius, keep_out, index = radius_m[ring], keep_out_m[ring], float(ring)
            for row in range(begin, end):
                distance = max(np.sqrt(squared[row]) - radius, 0.0)
                squared[row] = 0.0 if inside[row] else distance
            for row in range(begin, end):
                distance, room = squared[row], squared[row] - keep_out
                whose[row] = index if distance < least[row] else whose[row]
                whose_room[row] = index if room < least_room[row] else whose_room[row]
                least[row] = min(least[row], distance)
                least_room[row] = min(least_room[row], room)
        for row in range(len(z_m)):
            distance_m[column, row], nearest[column, row] = least[row], np.int32(whose[row])
            room_m[column, row], closest[column, row] = least_room[row], np.int32(whose_room[row])
    return distance_m, nearest, room_m, closest


@jit(written(F8, 2), read(F8), read(F8), read(F8, 2), read(I8))
def horizontal_distances(
    x_m: FloatArray, z_m: FloatArray, vertices_m: FloatArray, first: IntArray
) -> FloatArray:
    """Least horizontal distance to a point of an obstacle strictly below, (nx, nz); inf if none.

    At any x the lowest point of a filled shape is on its outline, so the edges below suffice. The
    paper's exclusion: below a 45 degree slope from the lowest obstacle a fall does no damage.
    """
    lowest = np.inf
    for vertex in range(len(vertices_m)):
        lowest = min(lowest, vertices_m[vertex, 1])
    distance = np.empty((len(x_m), len(z_m)))
    for column in range(len(x_m)):
        for row in range(len(z_m)):
            distance[column, row] = np.inf
    for ring in range(len(first) - 1):
        count = first[ring + 1] - first[ring]
        for corner in range(count):
            low, high = first[ring] + corner, first[ring] + (corner + 1) % count
            if vertices_m[low, 1] > vertices_m[high, 1]:
                low, high = high, low
            low_x, low_z = vertices_m[low, 0], vertices_m[low, 1]
            high_x, rise = vertices_m[high, 0], vertices_m[high, 1] - low_z
            for row in range(len(z_m)):
                if not low_z < z_m[row] - TOLERANCE:
                    continue
                share = min((z_m[row] - low_z) / rise, 1.0) if rise > 0.0 else 1.0
                cut = low_x + share * (high_x - low_x)
                left, right = min(low_x, cut), max(low_x, cut)
                for column in range(len(x_m)):
                    gap = max(left - x_m[column], x_m[column] - right, 0.0)
                    distance[column, row] = min(distance[column, row], gap)
    for column in range(len(x_m)):
        for row in range(len(z_m)):
            if z_m[row] - lowest < distance[column, row] - TOLERANCE:
                distance[column, row] = np.inf
    return distance


@jit(
    several(written(U4), written(F8, 2)), read(U1), read(F8), read(F8), read(I8), read(U4)
)  # fmt: skip
def steps_of(
    free: IntArray,
    limit_mps: FloatArray,
    heading_speed_mps: FloatArray,
    offset: IntArray,
    needed: IntArray,
) -> tuple[IntArray, FloatArray]:
    """Allowed moves and speed of every padded cell: (cells,), (cells, H).

    needed: (H,) bit h: for this move, the cell that move h leads to has to be free, too.
    """
    cells, headings = len(free), len(offset)
    allowed = np.empty(cells, dtype=np.uint32)
    speed = np.empty((cells, headings))
    every = np.uint32((1 << headings) - 2)
    for cell in range(cells):
        limit = limit_mps[cell]
        for heading in range(headings):
            speed[cell, heading] = min(limit, heading_speed_mps[heading])
        allowed[cell] = 0
        if free[cell]:
            around = np.uint32(0)
            for heading in range(1, headings):
                around |= np.uint32(free[cell + offset[heading]]) << np.uint32(heading)
            allowed[cell] = every
            if around != every:
                for heading in range(1, headings):
                    if around & needed[heading] != needed[heading]:
                        allowed[cell] &= ~np.uint32(1 << heading)
    return allowed, speed
