"""Reach: the free distance of a straight flight from a place.

Inputs: a site, the vehicle's radius and its position uncertainty; places and directions in the
plane. Outputs: distances. Cells are blocked as in `maps.occupied`, but by obstacles alone: a leg to
the ground may pass cells that are too low for plans.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from . import ground_profile
from .clearances import Clearances
from .geometry import obstacle_distance_m, rings
from .grid import TOLERANCE, BoolArray, FloatArray, Grid, IntArray
from .jit import F8, U1, jit, read, written
from .site import GROUND, PlanePoint, Site


@jit(written(F8), read(U1, 2), read(F8, 2), read(F8, 2), F8)
def free_ahead(
    blocked: IntArray, start: FloatArray, direction: FloatArray, farthest: float
) -> FloatArray:
    """Length of rays until they enter a blocked cell: (n,), at most `farthest`.

    blocked: (nx, nz); start: (n, 2) in cells from the lower corner; direction: (n, 2) in cells for
    each unit of the result. Cell by cell (Amanatides and Woo 1987); outside the grid all is free.
    Blocked cells that a ray begins in do not end it.
    """
    columns, rows = blocked.shape
    free = np.empty(len(start))
    for ray in range(len(start)):
        x, z = np.int64(np.floor(start[ray, 0])), np.int64(np.floor(start[ray, 1]))
        along_x, along_z = direction[ray, 0], direction[ray, 1]
        step_x, step_z = (1 if along_x > 0.0 else -1), (1 if along_z > 0.0 else -1)
        next_x, next_z = np.inf, np.inf
        every_x, every_z = np.inf, np.inf
        if along_x != 0.0:
            every_x = abs(1.0 / along_x)
            next_x = (x + (step_x > 0) - start[ray, 0]) / along_x
        if along_z != 0.0:
            every_z = abs(1.0 / along_z)
            next_z = (z + (step_z > 0) - start[ray, 1]) / along_z
        at, outside_once, ended = 0.0, False, False
        while not ended and (at < farthest or (not outside_once and at < np.inf)):
            solid = 0 <= x < columns and 0 <= z < rows and blocked[x, z] != 0
            ended = solid and outside_once
            outside_once = outside_once or not solid
            if not ended:
                if next_x < next_z:
                    at, next_x, x = next_x, next_x + every_x, x + step_x
                else:
                    at, next_z, z = next_z, next_z + every_z, z + step_z
        free[ray] = min(at, farthest)
    return free


_AROUND_M = 20.0
"""An obstacle farther outside the workspace than this is out of reach."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FreeDistance:
    """Cells blocked by obstacles, in the workspace and as far around it as obstacles stand.

    Two are equal that block the same cells for the same obstacles, even from different maps.
    blocked: (nx, nz), 1 where the hull would be nearer to an obstacle than is allowed. ground: the
    same for a ground with a profile, up to the minimum altitude: a descent by the autopilot itself
    ends above these cells, any other path of its own hits the ground there. None: level ground.
    """

    grid: Grid
    blocked: npt.NDArray[np.uint8]
    clearances: Clearances
    ground: npt.NDArray[np.uint8] | None = None

    @classmethod
    def over(
        cls,
        site: Site,
        radius_m: float,
        position_uncertainty_m: float = 0.0,
        *,
        known: tuple[Clearances, ...] = (),
    ) -> FreeDistance:
        """The reach on a site of a vehicle whose position is known to `position_uncertainty_m`.

        known: clearances that it may be made from.
        """
        widened_m = radius_m + position_uncertainty_m
        clearances = Clearances.over(_grid(site, widened_m), site.obstacles, *known)
        blocked = (clearances.room_m < widened_m - TOLERANCE).view(np.uint8)
        blocked.flags.writeable = False
        grid, space, ground = clearances.grid, site.workspace, None
        if space.ground_m:
            x_m, z_m = grid.axes_m
            # No place of a plan is as near to it.
            near_m = min(widened_m + site.margin.total_m, space.min_altitude_m or 0.0)
            floor_m = ground_profile.floor_m(space.ground_m, near_m, x_m)
            ground = (z_m[None, :] < floor_m[:, None] - TOLERANCE).view(np.uint8)
            ground.flags.writeable = False
        return cls(grid=grid, blocked=blocked, clearances=clearances, ground=ground)

    def __eq__(self, other: object) -> bool:
        return self is other or (
            isinstance(other, FreeDistance)
            and self.grid == other.grid
            and self.clearances.obstacles == other.clearances.obstacles
            and np.array_equal(self.blocked, other.blocked)
            and np.array_equal(self.ground, other.ground)  # type: ignore[arg-type] # None, too
        )

    def __hash__(self) -> int:
        return hash(self.grid)

    def free_m(self, places_m: FloatArray, directions: FloatArray, farthest_m: float) -> FloatArray:
        """Free distance from places (n, 2) in directions (n, 2), unit vectors: (n,).

        At most `farthest_m`. The keep-out that a place is in does not count: a leg out of one
        (`escape`) is checked when it is made.
        """
        cell_m = self.grid.resolution_m
        free: FloatArray = free_ahead(
            self.blocked,
            np.ascontiguousarray((places_m - np.array(self.grid.lower_m)) / cell_m),
            np.ascontiguousarray(directions / cell_m),
            farthest_m,
        )
        return free

    def over_ground_m(
        self, places_m: FloatArray, directions: FloatArray, farthest_m: float
    ) -> FloatArray:
        """As `free_m`, of the ground: 0 in its cells for a direction that does not lead up."""
        if self.ground is None:
            return np.full(len(places_m), farthest_m)
        over = FreeDistance(grid=self.grid, blocked=self.ground, clearances=self.clearances)
        free_m = over.free_m(places_m, directions, farthest_m)
        inside = self.ground[self._cells(places_m)].view(np.bool_)
        free_m[inside & (directions[:, 1] <= 0.0)] = 0.0
        return free_m

    def descent_end_m(self, x_m: FloatArray) -> FloatArray:
        """Heights (n,) at which descents at x (n,) end: half a cell above the ground's cells.

        Without a profile: at the grid's border.
        """
        ends_m = np.full(len(x_m), self.grid.lower_m[1])
        if self.ground is not None:
            columns, _ = self._cells(np.stack([x_m, ends_m], axis=1))
            ends_m += (self.ground.sum(axis=1)[columns] + 0.5) * self.grid.resolution_m
        return ends_m

    def leads_inwards(self, places_m: FloatArray, directions: FloatArray) -> BoolArray:
        """Mask (n,) of places (n, 2) in a keep-out, with directions (n, 2) not farther out."""
        here = self._cells(places_m)
        inside: BoolArray = self.blocked[here].view(np.bool_)
        if not inside.any():
            return inside
        room_m = self.clearances.room_m
        ahead = self._cells(places_m + self.grid.resolution_m * directions)
        return inside & (room_m[ahead] <= room_m[here])

    def _cells(self, places_m: FloatArray) -> tuple[IntArray, IntArray]:
        """The indices of the cells that places (n, 2) are in; those outside, of the nearest."""
        cells = np.floor((places_m - np.array(self.grid.lower_m)) / self.grid.resolution_m)
        x, z = np.clip(cells, 0, np.array(self.grid.shape) - 1).astype(np.int64).T
        return x, z

    def nearest(self, place_m: PlanePoint) -> str:
        """Name of the obstacle with the keep-out nearest to a place; of the ground in its cells."""
        place = np.array([place_m])
        if self.ground is not None and self.ground[self._cells(place)][0]:
            return GROUND
        return min(
            self.clearances.obstacles,
            key=lambda item: float(obstacle_distance_m(item, place)[0]) - item.keep_out_m,
        ).name


def _grid(site: Site, widened_m: float) -> Grid:
    """The workspace's grid, with whole cells added where obstacles stand outside it."""
    space = site.workspace
    inner = Grid.over(space.lower_m, space.upper_m, space.resolution_m)
    cell_m = space.resolution_m
    vertices, first, radius_m, keep_out_m = rings(site.obstacles)
    around_m = np.repeat(widened_m + radius_m + keep_out_m, np.diff(first))
    profile = np.array(space.ground_m).reshape(-1, 2)
    vertices, around_m = np.concatenate([vertices, profile]), np.pad(around_m, (0, len(profile)))
    lower_m, shape = [], []
    for axis, (low, high) in enumerate(zip(inner.lower_m, inner.upper_m, strict=True)):
        beyond = low - (vertices[:, axis] - around_m).min(initial=low)
        before = math.ceil(min(beyond, _AROUND_M) / cell_m)
        beyond = (vertices[:, axis] + around_m).max(initial=high) - high
        after = math.ceil(min(beyond, _AROUND_M) / cell_m)
        lower_m.append(low - before * cell_m)
        shape.append(before + inner.shape[axis] + after)
    return Grid(lower_m=tuple(lower_m), resolution_m=cell_m, shape=tuple(shape))
