"""The arrays that the compiled search reads and writes, named, and their types."""

from __future__ import annotations

from typing import NamedTuple

from .grid import FloatArray, IntArray
from .jit import BOOL, F8, I8, U1, U4, fields, read, written


class Steps(NamedTuple):
    """Data of the steps of a graph (`graph.Graph`)."""

    allowed: IntArray
    safety: FloatArray
    speed: FloatArray
    place: FloatArray
    offset: IntArray
    length_m: FloatArray
    axes: FloatArray
    pace: FloatArray


class StepCost(NamedTuple):
    """k_S, k_T, k_E / (2 v_MAX), and what each action costs beside them."""

    safety: float
    time: float
    energy: float
    action: float


class CellMemory(NamedTuple):
    """Arrays that `backward` writes, for each cell. Uninitialised except `touched`, zeros."""

    lead: FloatArray
    pending: IntArray
    touched: IntArray
    keys: FloatArray
    items: IntArray
    position: IntArray


class StateMemory(NamedTuple):
    """Arrays that `forward` writes, for each state. Uninitialised except `touched`, zeros."""

    cost: FloatArray
    came_by: IntArray
    touched: IntArray
    keys: FloatArray
    items: IntArray
    position: IntArray


class Criterion(NamedTuple):
    """One of two costs that are traded off.

    step:   (cells, M)  of the arrival in a state, without the change of velocity
    to_go:  (cells, M)  exact least cost from a state to the end; infinite where no path leads on
    behind: (cells,)    of the end in a goal's cell
    change: for each m/s of a change of velocity
    """

    step: FloatArray
    to_go: FloatArray
    behind: FloatArray
    change: float


class Labels(NamedTuple):
    """Paths of a bi-objective search, (room,) each, uninitialised: sums, and bounds of the whole.

    heap: (room,) labels, in its order
    """

    first_sum: FloatArray
    second_sum: FloatArray
    first_bound: FloatArray
    second_bound: FloatArray
    state: IntArray
    parent: IntArray
    heap: IntArray


class Field(NamedTuple):
    """Data of the plane (`continuous`); samples are `spacing_m` apart, or closer.

    values:        (nx, nz, 2)  SC and v_sat in the cells' centres
    free:          (nx, nz)     0 occupied, 1 free, 2 free and clear of all in the whole cell
    elevation_mps: (5,)         v_max from straight down to straight up
    """

    values: FloatArray
    free: IntArray
    elevation_mps: FloatArray
    left_m: float
    low_m: float
    cell_m: float
    spacing_m: float


class Limits(NamedTuple):
    """Limits of a path: rings (`distance_kernels`), their distances (n,), and a lowest height."""

    vertices_m: FloatArray
    first: IntArray
    keep_m: FloatArray
    lowest_m: float


class LegCost(NamedTuple):
    """k_S, k_T, k_E / (2 v_MAX)."""

    safety: float
    time: float
    energy: float


class Terms(NamedTuple):
    """Costs of a path, and its limits.

    goal: (nx, nz)  1 where a path may end that need not come to rest
    """

    field: Field
    limits: Limits
    cost: LegCost
    goal: IntArray
    ends_at_rest: bool


class Path(NamedTuple):
    """A path that is being changed: row i of `legs` leads from point i - 1 to point i.

    points_m: (capacity, 2)
    legs:     (capacity, 5)  cost, velocity at the beginning and at the end; row 0 ends with the
                             velocity of the start
    new_m, new: (2, 2), (2, 5)  what a change would put in
    """

    points_m: FloatArray
    legs: FloatArray
    new_m: FloatArray
    new: FloatArray


STEPS = fields(
    Steps,
    read(U4), read(F8), read(F8, 2), read(F8, 2),
    read(I8), read(F8), read(F8, 2), read(F8, 2),
)  # fmt: skip
STEP_COST = fields(StepCost, F8, F8, F8, F8)
HEAP = (written(F8), written(I8), written(I8))
CELL_MEMORY = fields(CellMemory, written(F8, 2), written(U4), written(I8), *HEAP)
STATE_MEMORY = fields(StateMemory, written(F8), written(U1), written(I8), *HEAP)
CRITERION = fields(Criterion, read(F8, 2), read(F8, 2), read(F8), F8)
LABELS = fields(
    Labels,
    written(F8),
    written(F8),
    written(F8),
    written(F8),
    written(I8),
    written(I8),
    written(I8),
)
FIELD = fields(Field, read(F8, 3), read(U1, 2), read(F8), F8, F8, F8, F8)
LIMITS = fields(Limits, read(F8, 2), read(I8), read(F8), F8)
LEG_COST = fields(LegCost, F8, F8, F8)
TERMS = fields(Terms, FIELD, LIMITS, LEG_COST, read(U1, 2), BOOL)
PATH = fields(Path, written(F8, 2), written(F8, 2), written(F8, 2), written(F8, 2))
