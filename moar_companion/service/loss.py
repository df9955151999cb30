"""If we die now: how far the aircraft comes without us, and what its autopilot does then.

A killed process says no farewell: the last setpoint stands, with its velocity. Inputs: the
autopilot's parameters; places where the aircraft would come to rest. Outputs: the way that a speed
takes, the speed that a free way allows, and why a flight should not be flown.

PX4 holds the last point with its velocity as feed-forward, and so comes to rest v / MPC_XY_P beyond
it; where COM_OF_LOSS_T ends before that, it brakes at MPC_ACC_HOR. ArduPilot moves the point on at
that velocity for GUID_TIMEOUT, and brakes at WPNAV_ACCEL or WPNAV_ACCEL_Z, as its jerk allows.
The ways are bounds over flights of the fake autopilots, level, up, down and diagonal, at 0.7 to
5 m/s, with time-outs of 0.1 to 3 s, in wind of 0 and 6 m/s (`tests/service/test_loss.py`).
"""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..planner.grid import FloatArray
from ..planner.reach import Reach
from ..types import AutopilotKind, Vector

_PX4_OVERSHOOT = 1.2
"""Of v / MPC_XY_P: the control's integral has learnt the drag of the flight."""
_PX4_S2PM = 0.1
"""What COM_OBL_RC_ACT adds, which brakes from the velocity of its moment."""
_PX4_HARD_MPS2 = 3.0
"""MPC_ACC_HOR as it comes: v^2 / 2a of less is longer than that."""
_ARDUPILOT_S = 0.4
"""0.1 s until the silence is noticed; the rest is the shaper's jerk."""
_ARDUPILOT_SHAPING_S = 0.5
"""In that time the jerk builds the acceleration up, as it comes; 1.1 s/s of any more."""
_ARDUPILOT_SHAPED = 1.1
_ARDUPILOT_LEVEL = 0.5
"""Of WPNAV_ACCEL, by which it brakes with the wind from behind."""
_SOFT_MPS2 = 0.1
"""No autopilot brakes less hard: parameters of 0 or less mean something else."""
_TOLERANCE_MPS2 = 1e-3
"""Parameters are told as 32-bit floats."""
_LEAST_M = 1e-9
"""A way that is shorter leads nowhere."""
_LONGEST_S = 5.0
"""The end of GUID_TIMEOUT's range: with more, next to an obstacle, nothing is left of the speed."""


class LossAction(enum.Enum):
    """What the autopilot does once it has noticed."""

    HOLD = "hold"
    LAND = "land"
    RETURN = "return"
    FALL = "stop its motors"


_PX4_ACTIONS = {
    0: (LossAction.RETURN, "position mode; without sticks: return"),
    1: (LossAction.RETURN, "altitude mode; without sticks: return"),
    2: (LossAction.RETURN, "stabilized mode; without sticks: return"),
    3: (LossAction.RETURN, "return"),
    4: (LossAction.LAND, "land"),
    5: (LossAction.HOLD, "hold"),
    6: (LossAction.FALL, "terminate"),
    7: (LossAction.FALL, "disarm"),
}
"""COM_OBL_RC_ACT: what comes of it, and PX4's own word."""
_UNKNOWN_ACTION = (LossAction.RETURN, "not known here, taken for a return")

_DEFAULTS = {
    AutopilotKind.PX4: {
        "COM_OBL_RC_ACT": 0.0,
        "MPC_ACC_HOR": 3.0,
        "MPC_XY_P": 0.95,
        "MPC_Z_P": 1.0,
        "NAV_ACC_RAD": 2.0,
        "RTL_CONE_ANG": 45.0,
        "RTL_MIN_DIST": 10.0,
        "RTL_RETURN_ALT": 30.0,
        "RTL_TYPE": 0.0,
    },
    AutopilotKind.ARDUPILOT: {
        "GUID_TIMEOUT": 3.0,
        "PSC_JERK_XY": 5.0,
        "PSC_JERK_Z": 5.0,
        "WPNAV_ACCEL": 250.0,
        "WPNAV_ACCEL_Z": 100.0,
    },
}
"""As PX4 v1.17 and ArduCopter 4.6 have them: taken for what is never told."""


def px4_action(value: float) -> tuple[LossAction, str]:
    """What PX4 does for a value of COM_OBL_RC_ACT, and its own word for that."""
    return _PX4_ACTIONS.get(int(value), _UNKNOWN_ACTION)


def loss_parameters(kind: AutopilotKind) -> tuple[str, ...]:
    """What must be known of an autopilot before it is controlled."""
    return tuple(_DEFAULTS.get(kind, {}))


@dataclass(frozen=True, slots=True, kw_only=True)
class Return:
    """PX4's way home (RTL_TYPE 0, no rally points): up, level, down; heights above home.

    As its `calculate_return_alt_from_cone_half_angle`.
    """

    altitude_m: float
    cone_rad: float
    """Half angle of the cone over home below which it stays when near; 0: there is none."""
    least_m: float
    """Nearer to home than this it is near."""
    arrived_m: float

    def height_m(self, height_m: float, distance_m: float) -> float:
        """The height of the level part, from a height and a level distance to home."""
        if self.cone_rad <= 0.0:
            return max(height_m, self.altitude_m)
        if distance_m <= self.arrived_m:
            return max(height_m, 2.0 * distance_m)
        climbs_m = self.altitude_m
        if distance_m <= self.least_m:
            cone_rad = min(max(self.cone_rad, math.radians(1.0)), math.radians(89.0))
            climbs_m = min(climbs_m, distance_m / math.tan(cone_rad))
        return max(height_m, climbs_m, 2.0 * self.arrived_m)


@dataclass(frozen=True, slots=True, kw_only=True)
class Loss:
    """What becomes of a flight that nobody steers. The way to rest is a v + b v^2.

    way_s, way_s2pm: a and b. untold: parameters that the autopilot never told.
    """

    kind: AutopilotKind
    action: LossAction
    timeout_s: float | None
    """How long the setpoint moves on; None: it stands."""
    way_s: float
    way_s2pm: float
    follows_mps2: float | None = None
    """The acceleration with which it follows setpoints; None: without a limit of its own."""
    home: Return | None = None
    """How a return leads home; None: it leads elsewhere, or there is none."""
    untold: tuple[str, ...] = ()

    @classmethod
    def of(cls, kind: AutopilotKind, parameters: Mapping[str, float | None]) -> Loss | None:
        """By what is known of the parameters now; None for a kind that nobody knows."""
        return cls.told(kind, {**dict.fromkeys(_DEFAULTS.get(kind, ())), **parameters})

    @classmethod
    def told(cls, kind: AutopilotKind, parameters: Mapping[str, float | None]) -> Loss | None:
        """By an autopilot's parameters, None for those it never told; None: not all asked yet."""
        defaults = _DEFAULTS.get(kind)
        if defaults is None or not defaults.keys() <= parameters.keys():
            return None
        untold = tuple(name for name in defaults if parameters[name] is None)
        value = {**defaults, **{n: v for n, v in parameters.items() if v is not None}}
        if kind is AutopilotKind.ARDUPILOT:
            return cls._of_ardupilot(value, untold)
        return cls._of_px4(value, untold)

    @classmethod
    def _of_ardupilot(cls, value: Mapping[str, float], untold: tuple[str, ...]) -> Loss:
        timeout_s = max(0.0, value["GUID_TIMEOUT"])
        level_mps2, upright_mps2 = (
            max(_SOFT_MPS2, value[name] / 100.0) for name in ("WPNAV_ACCEL", "WPNAV_ACCEL_Z")
        )
        shaping_s = max(
            level_mps2 / max(_SOFT_MPS2, value["PSC_JERK_XY"]),
            upright_mps2 / max(_SOFT_MPS2, value["PSC_JERK_Z"]),
        )
        longer_s = max(0.0, _ARDUPILOT_SHAPED * (shaping_s - _ARDUPILOT_SHAPING_S))
        return cls(
            kind=AutopilotKind.ARDUPILOT,
            action=LossAction.HOLD,
            timeout_s=timeout_s,
            way_s=timeout_s + _ARDUPILOT_S + longer_s,
            way_s2pm=max(0.5 / (_ARDUPILOT_LEVEL * level_mps2), 0.5 / upright_mps2),
            follows_mps2=min(level_mps2, upright_mps2),
            untold=untold,
        )

    @classmethod
    def _of_px4(cls, value: Mapping[str, float], untold: tuple[str, ...]) -> Loss:
        brakes_mps2 = max(_SOFT_MPS2, min(_PX4_HARD_MPS2, value["MPC_ACC_HOR"]))
        gain_per_s = max(0.1, min(value["MPC_XY_P"], value["MPC_Z_P"]))
        return cls(
            kind=AutopilotKind.PX4,
            action=px4_action(value["COM_OBL_RC_ACT"])[0],
            timeout_s=None,
            way_s=_PX4_OVERSHOOT / gain_per_s,
            way_s2pm=_PX4_S2PM + 0.5 / brakes_mps2 - 0.5 / _PX4_HARD_MPS2,
            home=None
            if value["RTL_TYPE"]
            else Return(
                altitude_m=value["RTL_RETURN_ALT"],
                cone_rad=math.radians(value["RTL_CONE_ANG"]),
                least_m=value["RTL_MIN_DIST"],
                arrived_m=value["NAV_ACC_RAD"],
            ),
            untold=untold,
        )

    def way_m(self, speed_mps: FloatArray) -> FloatArray:
        """How far beyond the last setpoint the aircraft comes, at speeds (n,): (n,)."""
        return self.way_s * speed_mps + self.way_s2pm * speed_mps**2

    def speed_mps(self, free_m: FloatArray) -> FloatArray:
        """The greatest speeds (n,) from which it comes no farther than (n,)."""
        half = 0.5 * self.way_s / self.way_s2pm
        return np.asarray(np.sqrt(half**2 + free_m / self.way_s2pm) - half)

    @property
    def assumption(self) -> str | None:
        """What is not known of the autopilot; None when all was told."""
        if not self.untold:
            return None
        return f"not told, taken as by default: {', '.join(self.untold)}"

    def lag(self, acceleration_mps2: float) -> str | None:
        """Why it cannot follow setpoints of an acceleration; None when it can."""
        follows_mps2 = self.follows_mps2
        if follows_mps2 is None or follows_mps2 >= acceleration_mps2 - _TOLERANCE_MPS2:
            return None
        return (
            f"ArduPilot follows with {follows_mps2:g} m/s2 only, "
            f"guidance.acceleration_mps2 is {acceleration_mps2:g}: "
            f"set WPNAV_ACCEL and WPNAV_ACCEL_Z {100.0 * acceleration_mps2:g}"
        )

    @property
    def objection_anywhere(self) -> str | None:
        """Why nobody should die anywhere; None where it depends on the place."""
        if self.timeout_s is not None and self.timeout_s > _LONGEST_S:
            return f"if we died, it would fly on for {self.timeout_s:g} s: set GUID_TIMEOUT 0.5"
        if self.action is LossAction.RETURN and self.home is None:
            return self._against(" by a way that is not known here, RTL_TYPE is not 0")
        return self._against() if self.action is LossAction.FALL else None

    def objection(self, reach: Reach, rests_m: FloatArray, home_m: Vector | None) -> str | None:
        """Why nobody should die at rest at any of some places (n, 2); None when all is well.

        home_m: (x, y, z) in the site's frame. Only what stands on the site is known: a return is
        looked at as far as it is in the plane, and without a home as far as it climbs.
        """
        if self.objection_anywhere is not None or self.action is LossAction.HOLD:
            return self.objection_anywhere
        hit = _first_hit(reach, self._ways(reach, rests_m, home_m))
        return None if hit is None else self._against(f" through {hit}")

    def _against(self, how: str = "") -> str:
        return f"if we died, PX4 would {self.action.value}{how}: set COM_OBL_RC_ACT 5"

    def _ways(
        self, reach: Reach, rests_m: FloatArray, home_m: Vector | None
    ) -> list[tuple[FloatArray, FloatArray]]:
        """The straight ways of the action: each from places (n, 2) to places (n, 2)."""
        x_m, z_m = rests_m.T
        if self.action is LossAction.LAND or self.home is None:
            return [(rests_m, np.stack([x_m, np.full_like(z_m, reach.grid.lower_m[1])], axis=1))]
        if home_m is None:
            return [(rests_m, np.stack([x_m, np.full_like(z_m, reach.grid.upper_m[1])], axis=1))]
        home_x_m, home_y_m, home_z_m = home_m
        heights = [
            self.home.height_m(z - home_z_m, math.hypot(x - home_x_m, home_y_m))
            for x, z in rests_m.tolist()
        ]
        top_m = home_z_m + np.array(heights)
        above, above_home = (
            np.stack([x_m, top_m], 1),
            np.stack([np.full_like(x_m, home_x_m), top_m], 1),
        )
        down = np.tile([home_x_m, home_z_m], (len(x_m), 1))
        return [(rests_m, above), (above, above_home), (above_home, down)]


def _first_hit(reach: Reach, ways: list[tuple[FloatArray, FloatArray]]) -> str | None:
    """The name of an obstacle that is in the way; None when there is none."""
    for way in ways:
        starts_m, along = _over(reach, *way)
        if not len(starts_m):
            continue
        length_m = np.hypot(along[:, 0], along[:, 1])
        direction = along / np.where(length_m > 0.0, length_m, 1.0)[:, None]
        free_m = reach.free_m(starts_m, direction, float(length_m.max()))
        hits = np.flatnonzero(free_m < length_m)
        if len(hits):
            first = int(hits[0])
            beyond_m = free_m[first] + 0.5 * reach.grid.resolution_m
            x_m, z_m = starts_m[first] + beyond_m * direction[first]
            return reach.nearest((float(x_m), float(z_m)))
    return None


def _over(reach: Reach, starts_m: FloatArray, ends_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The part of straight ways (n, 2) on the grid, where one is: places, and to their ends.

    A home may be an ocean away, by mistake, and a way is looked at cell by cell.
    """
    along = ends_m - starts_m
    borders = np.array([reach.grid.lower_m, reach.grid.upper_m])[:, None]
    parts = (borders - starts_m) / np.where(np.abs(along) > _LEAST_M, along, _LEAST_M)
    entered = np.clip(parts.min(axis=0).max(axis=1), 0.0, 1.0)
    left = np.clip(parts.max(axis=0).min(axis=1), 0.0, 1.0)
    there = entered < left
    starts_m, along = starts_m[there], along[there]
    entered, left = entered[there, None], left[there, None]
    return starts_m + entered * along, (left - entered) * along
