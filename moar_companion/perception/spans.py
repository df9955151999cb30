"""Order of conductors by spans, circuits and earth wires, and classes of all points."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from .catenary import Catenary
from .conductors import DetectedConductor, DetectorSettings, find_conductors
from .ground import ground_height_m

FloatArray = npt.NDArray[np.float64]

_SAME_DIRECTION_DEG = 8.0
_LINE_WIDTH_M = 40.0
_CROSS_ARM_ANGLE_RAD = math.radians(45.0)
_LONGEST_CROSS_ARM_M = 40.0
"""Width of the widest towers (waist-type, one circuit: 38 to 40 m)."""
_CROSS_ARM_REACH_M = 8.0
_PHASES = 3
_GROUND_M = 0.5
"""Height above the ground up to which a point is ground, grass or stones."""
_TOWER_REACH_M = 20.0
"""Horizontal distance from the end of a conductor within which its tower is looked for."""
_TOWER_CELL_M = 1.0


class PointClass(enum.IntEnum):
    """Classes of points: the numbers of the LAS 1.4 specification (table 17)."""

    GROUND = 2
    VEGETATION = 5
    EARTH_WIRE = 13
    CONDUCTOR = 14
    TOWER = 15


@dataclass(frozen=True, kw_only=True, eq=False)
class Span:
    """Conductors between the same two towers."""

    circuits: tuple[tuple[DetectedConductor, ...], ...]
    """Phase conductors, in circuits of three where the number allows; lowest first, right to
    left."""
    earth_wires: tuple[DetectedConductor, ...]

    @property
    def conductors(self) -> tuple[DetectedConductor, ...]:
        """All conductors, phase conductors first."""
        return tuple(each for circuit in self.circuits for each in circuit) + self.earth_wires


@dataclass(frozen=True, kw_only=True, eq=False)
class PowerLine:
    """Power line in a point cloud. classes: (n,) PointClass of each point."""

    spans: tuple[Span, ...]
    classes: npt.NDArray[np.uint8]
    height_m: FloatArray
    """Height (n,) of the points above the ground."""


def find_power_line(points_m: FloatArray, settings: DetectorSettings | None = None) -> PowerLine:
    """Conductors in their spans, and the class of each of (n, 3) points."""
    height_m = points_m[:, 2] - ground_height_m(points_m)
    lines = find_conductors(points_m, height_m, settings or DetectorSettings())
    found = tuple(each for each in lines if not _is_cross_arm(each, lines))
    spans = tuple(_span(members) for members in _same_span(found))
    classes = np.where(height_m <= _GROUND_M, PointClass.GROUND, PointClass.VEGETATION)
    for span in spans:
        for conductor in span.conductors:
            is_earth_wire = conductor in span.earth_wires
            classes[conductor.inliers] = (
                PointClass.EARTH_WIRE if is_earth_wire else PointClass.CONDUCTOR
            )
    _mark_towers(points_m, height_m, classes, found)
    return PowerLine(spans=spans, classes=classes.astype(np.uint8), height_m=height_m)


def _is_cross_arm(conductor: DetectedConductor, lines: tuple[DetectedConductor, ...]) -> bool:
    """Returns True for a short line across the end of a longer conductor: part of the tower."""
    curve = conductor.curve
    samples = curve.points_at(np.linspace(*curve.extent_m, 9))
    for other in lines:
        across = abs(other.curve.direction @ curve.direction) < math.cos(_CROSS_ARM_ANGLE_RAD)
        if not across or other.curve.length_m < 2.0 * curve.length_m:
            continue
        ends = other.curve.points_at(np.array(other.curve.extent_m))
        distance = np.linalg.norm(samples[:, None] - ends[None], axis=2)
        if curve.length_m < _LONGEST_CROSS_ARM_M and distance.min() < _CROSS_ARM_REACH_M:
            return True
    return False


def _same_span(found: tuple[DetectedConductor, ...]) -> list[list[DetectedConductor]]:
    groups: list[list[DetectedConductor]] = []
    for conductor in sorted(found, key=lambda each: -each.curve.length_m):
        for group in groups:
            if _beside(group[0].curve, conductor.curve):
                group.append(conductor)
                break
        else:
            groups.append([conductor])
    return groups


def _beside(longer: Catenary, shorter: Catenary) -> bool:
    """Returns True if parallel, at most a line's width apart, and mostly side by side."""
    if abs(longer.direction @ shorter.direction) < math.cos(math.radians(_SAME_DIRECTION_DEG)):
        return False
    ends = longer.coordinates(shorter.points_at(np.array(shorter.extent_m)))
    low = max(longer.extent_m[0], float(ends[:, 0].min()))
    high = min(longer.extent_m[1], float(ends[:, 0].max()))
    return high - low > 0.5 * shorter.length_m and float(abs(ends[:, 1]).min()) < _LINE_WIDTH_M


def _span(members: list[DetectedConductor]) -> Span:
    places = _places(members)
    earth = _earth_wires(members, places)
    phases = [index for index in range(len(members)) if index not in earth]
    circuits = _circuits(places[phases])
    return Span(
        circuits=tuple(
            tuple(
                members[phases[index]]
                for index in sorted(circuit, key=lambda index: places[phases[index], 1])
            )
            for circuit in circuits
        ),
        earth_wires=tuple(members[index] for index in sorted(earth, key=lambda i: places[i, 0])),
    )


def _places(members: list[DetectedConductor]) -> FloatArray:
    """Lateral position and height (n, 2) of each in the middle of the first."""
    axis = members[0].curve
    middle = axis.points_at(np.array([np.mean(axis.extent_m)]))[0]
    at = [
        each.curve.points_at(np.array([each.curve.crossing(middle, axis.direction)]))
        for each in members
    ]
    return axis.coordinates(np.vstack(at))[:, 1:]


def _earth_wires(members: list[DetectedConductor], places: FloatArray) -> set[int]:
    """Indices of thin wires above all others near them: single beside bundles, or sparser.

    If the rest is no multiple of three phases, the wires that hang above all others.
    """
    if len(members) <= _PHASES:
        return set()
    wires = np.array([len(each.wires) for each in members])
    density = np.array([len(each.inliers) / max(each.curve.length_m, 1.0) for each in members])
    earth = set()
    for index, (lateral, height) in enumerate(places):
        others = np.arange(len(members)) != index
        near = others & (abs(places[:, 0] - lateral) < 5.0)
        if (places[near, 1] > height).any():
            continue
        lower = others & (places[:, 1] < height - 1.0)
        if lower.any() and (
            wires[index] < np.median(wires[lower])
            or density[index] < 0.5 * np.median(density[lower])
        ):
            earth.add(index)
    surplus = len(members) % _PHASES
    if (len(members) - len(earth)) % _PHASES and surplus:
        order = np.argsort(-places[:, 1])
        if places[order[surplus - 1], 1] > places[order[surplus], 1] + 1.0:
            return {int(index) for index in order[:surplus]}
    return earth


def _circuits(places: FloatArray) -> list[list[int]]:
    """Indices in groups of three, split across or in height, wherever the gaps are wider."""
    count = len(places)
    if count == 0:
        return []
    if count % _PHASES or count == _PHASES:
        return [list(np.argsort(places[:, 0]))]
    orders = [np.argsort(places[:, axis], kind="stable") for axis in (0, 1)]
    gaps = [
        min(
            places[order[place], axis] - places[order[place - 1], axis]
            for place in range(_PHASES, count, _PHASES)
        )
        for axis, order in enumerate(orders)
    ]
    order = orders[int(np.argmax(gaps))]
    return [list(order[place : place + _PHASES]) for place in range(0, count, _PHASES)]


def _mark_towers(
    points_m: FloatArray,
    height_m: FloatArray,
    classes: npt.NDArray[np.int_],
    found: tuple[DetectedConductor, ...],
) -> None:
    """Marks objects at the ends of conductors, as high as the lowest of these, as towers."""
    ends = [
        (end, conductor.curve)
        for conductor in found
        for end in conductor.curve.points_at(np.array(conductor.curve.extent_m))
    ]
    rest = np.flatnonzero((height_m > _GROUND_M) & (classes == PointClass.VEGETATION))
    if not ends or not len(rest):
        return
    places = np.array([end for end, _ in ends])
    low = points_m[rest, :2].min(axis=0)
    cells = ((points_m[rest, :2] - low) / _TOWER_CELL_M).astype(np.intp)
    top = np.full(cells.max(axis=0) + 1, -np.inf)
    np.maximum.at(top, (cells[:, 0], cells[:, 1]), points_m[rest, 2])
    # Trees around a tower's foot are lower than the conductors' ends, and not part of the tower.
    near = np.zeros(top.shape, dtype=bool)
    reach = int(_TOWER_REACH_M / _TOWER_CELL_M)
    for column, row in ((places[:, :2] - low) / _TOWER_CELL_M).astype(np.intp):
        near[max(column - reach, 0) : column + reach, max(row - reach, 0) : row + reach] = True
    lowest = places[:, 2].min()
    labels, count = ndimage.label((top > lowest - 3.0) & near, np.ones((3, 3)))
    for label in range(1, count + 1):
        inside = np.argwhere(labels == label) * _TOWER_CELL_M + low
        distance = np.hypot(*(places[:, None, :2] - inside[None]).transpose(2, 0, 1))
        attached = distance.min(axis=1) < 3.0
        if not attached.any() or float(np.ptp(inside, axis=0).max()) > 2.0 * _TOWER_REACH_M:
            continue
        if top[labels == label].max() < places[attached, 2].min() - 1.0:
            continue
        footprint = ndimage.binary_dilation(labels == label, iterations=2)
        classes[rest[footprint[cells[:, 0], cells[:, 1]]]] = PointClass.TOWER
