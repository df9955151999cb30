"""Compiled tracing of a lidar's rays through a scene, packet by packet.

A packet's rays lie in a narrow wedge: objects outside the wedge are left out first. A wire is
thinner than the beam: the smaller the part of the beam on the wire, the weaker the return.
"""

import math
from dataclasses import dataclass
from typing import Final

import numba
import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

SEQUENCES: Final = 24
"""Firing sequences of a packet; in each, every laser fires once."""
LASERS: Final = 16
FIRING_S: Final = 2.304e-6
SEQUENCE_S: Final = 55.296e-6
RANGE_M: Final = 100.0
LEAST_RANGE_M: Final = 0.5
DIVERGENCE_RAD: Final = 3.0e-3
APERTURE_M: Final = 0.0095
"""Horizontal divergence, and width of the beam at the sensor."""
LEAST_SHARE: Final = 0.35
"""Least share of the beam's width on a wire for a return, at a reflectivity of 10 %."""
RAIN_M: Final = 10.0
"""Greatest distance of returns from drops."""
_ELEVATIONS_RAD: Final = np.radians(
    [-15.0, 1.0, -13.0, 3.0, -11.0, 5.0, -9.0, 7.0, -7.0, 9.0, -5.0, 11.0, -3.0, 13.0, -1.0, 15.0]
)
_BESIDE_RAD: Final = math.radians(1.0)
"""Angle beside a packet's turn, for the aircraft's own rotation."""
_STEEPEST_RAD: Final = math.radians(16.0)
_MARGIN_M: Final = 0.25
"""Margin above half the beam's width at the greatest range, and above the flight during a
packet."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneArrays:
    """Arrays of a scene for the compiled functions.

    pieces   (n, 8)  of wires: start, unit vector along, length, diameter
    trees    (n, 5)  centre, radius, chance of a hit per metre
    solids   (n, 6)  least and greatest y; centre and radius of a ball around
    corners  (m, 2)  x and z of all solids' cross-sections, one after another
    first    (n+1,)  index of each solid's first corner
    """

    pieces: FloatArray
    trees: FloatArray
    solids: FloatArray
    corners: FloatArray
    first: npt.NDArray[np.int64]


def ranges(
    scene: SceneArrays,
    air: tuple[float, float, float, float],
    origins_m: FloatArray,
    turns: FloatArray,
    azimuths_rad: FloatArray,
    turn_rad_s: float,
    random: np.random.Generator,
) -> FloatArray:
    """(k, 24, 16) measured ranges in m of k packets; 0 without a return.

    air: height of the ground (nan: none), noise, share of dropouts, chance of a drop's return per
    metre. origins_m: (k, 24, 3); turns: (k, 24, 3, 3) from the sensor to the world;
    azimuths_rad: (k,) of the first firing.
    """
    found: FloatArray = _walk(
        scene.pieces, scene.trees, scene.solids, scene.corners, scene.first, air,
        np.ascontiguousarray(origins_m), np.ascontiguousarray(turns), azimuths_rad, turn_rad_s,
        random,
    )  # fmt: skip
    return found


_jit = numba.njit(cache=True, nogil=True, error_model="numpy")


@_jit  # type: ignore[untyped-decorator]
def _wedge(turn: FloatArray, azimuth: float, half_rad: float) -> FloatArray:
    """(4, 3) outward normals of the planes through the sensor that enclose a packet's rays."""
    ahead = (math.cos(azimuth), -math.sin(azimuth))
    aside = (-math.sin(azimuth), -math.cos(azimuth))
    cos, sin = math.cos(half_rad), math.sin(half_rad)
    slope = math.tan(_STEEPEST_RAD) / cos
    norm = math.sqrt(1.0 + slope * slope)
    normals = np.empty((4, 3))
    for plane in range(4):
        sign = 1.0 if plane % 2 else -1.0
        if plane < 2:
            x = sign * aside[0] * cos - ahead[0] * sin
            y = sign * aside[1] * cos - ahead[1] * sin
            z = 0.0
        else:
            x, y, z = -slope * ahead[0] / norm, -slope * ahead[1] / norm, sign / norm
        for row in range(3):
            normals[plane, row] = turn[row, 0] * x + turn[row, 1] * y + turn[row, 2] * z
    return normals


@_jit  # type: ignore[untyped-decorator]
def _is_beside(
    normals: FloatArray, x: float, y: float, z: float, x2: float, y2: float, z2: float, m: float
) -> bool:
    """True if two points, relative to the sensor, are outside one plane by more than m."""
    for plane in range(4):
        a, b, c = normals[plane, 0], normals[plane, 1], normals[plane, 2]
        if a * x + b * y + c * z > m and a * x2 + b * y2 + c * z2 > m:
            return True
    return False


@_jit  # type: ignore[untyped-decorator]
def _near_pieces(
    pieces: FloatArray, normals: FloatArray, origin: FloatArray, chosen: npt.NDArray[np.int64]
) -> int:
    """Writes the indices of the near pieces in a wedge; returns their number."""
    count = 0
    for index in range(len(pieces)):
        piece = pieces[index]
        x, y, z = piece[0] - origin[0], piece[1] - origin[1], piece[2] - origin[2]
        along = min(max(-(x * piece[3] + y * piece[4] + z * piece[5]), 0.0), piece[6])
        nx, ny, nz = x + along * piece[3], y + along * piece[4], z + along * piece[5]
        visible = (piece[7] / LEAST_SHARE - APERTURE_M) / DIVERGENCE_RAD + _MARGIN_M
        if nx * nx + ny * ny + nz * nz > visible * visible:
            continue
        x2, y2, z2 = x + piece[6] * piece[3], y + piece[6] * piece[4], z + piece[6] * piece[5]
        if not _is_beside(normals, x, y, z, x2, y2, z2, _MARGIN_M + piece[7] / 2.0):
            chosen[count] = index
            count += 1
    return count


@_jit  # type: ignore[untyped-decorator]
def _near_balls(
    balls: FloatArray,
    column: int,
    normals: FloatArray,
    origin: FloatArray,
    chosen: npt.NDArray[np.int64],
) -> int:
    """Writes the indices of the balls (centre and radius from a column on) within a wedge."""
    count = 0
    for index in range(len(balls)):
        x = balls[index, column] - origin[0]
        y = balls[index, column + 1] - origin[1]
        z = balls[index, column + 2] - origin[2]
        if not _is_beside(normals, x, y, z, x, y, z, _MARGIN_M + balls[index, column + 3]):
            chosen[count] = index
            count += 1
    return count


@_jit  # type: ignore[untyped-decorator]
def _to_piece(piece: FloatArray, origin: FloatArray, x: float, y: float, z: float) -> float:
    """Range at which a ray passes a straight piece within half the widths of piece and beam."""
    ox, oy, oz = origin[0] - piece[0], origin[1] - piece[1], origin[2] - piece[2]
    dot = x * piece[3] + y * piece[4] + z * piece[5]
    offset = ox * piece[3] + oy * piece[4] + oz * piece[5]
    ax, ay, az = x - dot * piece[3], y - dot * piece[4], z - dot * piece[5]
    bx, by, bz = ox - offset * piece[3], oy - offset * piece[4], oz - offset * piece[5]
    reach = -(ax * bx + ay * by + az * bz) / max(ax * ax + ay * ay + az * az, 1e-12)
    place = offset + reach * dot
    if reach <= 0.0 or place < 0.0 or place >= piece[6]:
        return np.inf
    mx, my, mz = bx + reach * ax, by + reach * ay, bz + reach * az
    miss = math.sqrt(mx * mx + my * my + mz * mz)
    beam = (APERTURE_M + DIVERGENCE_RAD * reach) / 2.0
    met = min(miss + piece[7] / 2.0, beam) - max(miss - piece[7] / 2.0, -beam)
    return reach if met / (2.0 * beam) >= LEAST_SHARE else np.inf


@_jit  # type: ignore[untyped-decorator]
def _is_inside(corners: FloatArray, first: int, end: int, x: float, z: float) -> bool:
    """True if a point lies in a polygon (even-odd rule)."""
    inside = False
    before = end - 1
    for corner in range(first, end):
        if (corners[corner, 1] > z) != (corners[before, 1] > z):
            share = (z - corners[corner, 1]) / (corners[before, 1] - corners[corner, 1])
            if x < corners[corner, 0] + share * (corners[before, 0] - corners[corner, 0]):
                inside = not inside
        before = corner
    return inside


@_jit  # type: ignore[untyped-decorator]
def _to_solid(
    solid: FloatArray,
    corners: FloatArray,
    first: int,
    end: int,
    origin: FloatArray,
    x: float,
    y: float,
    z: float,
) -> float:
    """Range to a polygon of the x-z plane that is extruded along y."""
    nearest = np.inf
    for side in range(2):
        reach = (solid[side] - origin[1]) / y
        if 0.0 < reach < nearest and _is_inside(
            corners, first, end, origin[0] + reach * x, origin[2] + reach * z
        ):
            nearest = reach
    before = end - 1
    for corner in range(first, end):
        px, pz = corners[before, 0] - origin[0], corners[before, 1] - origin[2]
        ex = corners[corner, 0] - corners[before, 0]
        ez = corners[corner, 1] - corners[before, 1]
        before = corner
        turned = x * ez - z * ex
        if turned == 0.0:
            continue
        reach = (px * ez - pz * ex) / turned
        share = (px * z - pz * x) / turned
        at = origin[1] + reach * y
        if 0.0 < reach < nearest and 0.0 <= share <= 1.0 and solid[0] <= at <= solid[1]:
            nearest = reach
    return nearest


@_jit  # type: ignore[untyped-decorator]
def _to_leaf(
    tree: FloatArray,
    origin: FloatArray,
    x: float,
    y: float,
    z: float,
    random: np.random.Generator,
) -> float:
    """Range to the first leaf that a ray meets in a ball of leaves."""
    ox, oy, oz = tree[0] - origin[0], tree[1] - origin[1], tree[2] - origin[2]
    along = ox * x + oy * y + oz * z
    inside = tree[3] * tree[3] - (ox * ox + oy * oy + oz * oz - along * along)
    if inside <= 0.0:
        return np.inf
    half = math.sqrt(inside)
    if along + half <= 0.0:
        return np.inf
    hit = max(along - half, 0.0) + random.exponential(1.0 / tree[4])
    return hit if hit < along + half else np.inf


@_jit  # type: ignore[untyped-decorator]
def _walk(
    pieces: FloatArray,
    trees: FloatArray,
    solids: FloatArray,
    corners: FloatArray,
    first: npt.NDArray[np.int64],
    air: tuple[float, float, float, float],
    origins: FloatArray,
    turns: FloatArray,
    azimuths: FloatArray,
    turn_rad_s: float,
    random: np.random.Generator,
) -> FloatArray:
    ground, noise, dropout, rain = air
    found = np.zeros((len(azimuths), SEQUENCES, LASERS))
    near_pieces = np.empty(len(pieces), np.int64)
    near_trees = np.empty(len(trees), np.int64)
    near_solids = np.empty(len(solids), np.int64)
    middle = SEQUENCES // 2
    half_rad = turn_rad_s * middle * SEQUENCE_S + _BESIDE_RAD
    for packet in range(len(azimuths)):
        centre = azimuths[packet] + turn_rad_s * middle * SEQUENCE_S
        normals = _wedge(turns[packet, middle], centre, half_rad)
        piece_count = _near_pieces(pieces, normals, origins[packet, middle], near_pieces)
        tree_count = _near_balls(trees, 0, normals, origins[packet, middle], near_trees)
        solid_count = _near_balls(solids, 2, normals, origins[packet, middle], near_solids)
        for sequence in range(SEQUENCES):
            origin, turn = origins[packet, sequence], turns[packet, sequence]
            for laser in range(LASERS):
                azimuth = azimuths[packet] + turn_rad_s * (sequence * SEQUENCE_S + laser * FIRING_S)
                level, up = math.cos(_ELEVATIONS_RAD[laser]), math.sin(_ELEVATIONS_RAD[laser])
                forward, left = level * math.cos(azimuth), -level * math.sin(azimuth)
                x = turn[0, 0] * forward + turn[0, 1] * left + turn[0, 2] * up
                y = turn[1, 0] * forward + turn[1, 1] * left + turn[1, 2] * up
                z = turn[2, 0] * forward + turn[2, 1] * left + turn[2, 2] * up
                nearest = (ground - origin[2]) / z
                if not nearest > 0.0:
                    nearest = np.inf
                for number in range(solid_count):
                    solid = near_solids[number]
                    reach = _to_solid(
                        solids[solid], corners, first[solid], first[solid + 1], origin, x, y, z
                    )
                    nearest = min(nearest, reach)
                for number in range(tree_count):
                    reach = _to_leaf(trees[near_trees[number]], origin, x, y, z, random)
                    nearest = min(nearest, reach)
                for number in range(piece_count):
                    reach = _to_piece(pieces[near_pieces[number]], origin, x, y, z)
                    nearest = min(nearest, reach)
                if rain > 0.0:
                    drop = random.exponential(1.0 / rain)
                    if drop < RAIN_M:
                        nearest = min(nearest, drop)
                if nearest > RANGE_M + 1.0 or random.random() < dropout:
                    continue
                measured = nearest + noise * random.standard_normal()
                if LEAST_RANGE_M < measured < RANGE_M:
                    found[packet, sequence, laser] = measured
    return found
