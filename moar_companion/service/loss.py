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

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..autopilots import px4
from ..autopilots.failsafe_actions import Action, first_hit, paths
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
_LONGEST_S = 5.0
"""The end of GUID_TIMEOUT's range: with more, next to an obstacle, nothing is left of the speed."""


_DEFAULTS = {
    AutopilotKind.PX4: {
        "COM_OBL_RC_ACT": px4.DEFAULTS["COM_OBL_RC_ACT"],
        "MPC_ACC_HOR": 3.0,
        "MPC_XY_P": 0.95,
        "MPC_Z_P": 1.0,
        "NAV_ACC_RAD": px4.DEFAULTS["NAV_ACC_RAD"],
        "NAV_RCL_ACT": px4.DEFAULTS["NAV_RCL_ACT"],
        "RTL_CONE_ANG": px4.DEFAULTS["RTL_CONE_ANG"],
        "RTL_MIN_DIST": px4.DEFAULTS["RTL_MIN_DIST"],
        "RTL_RETURN_ALT": px4.DEFAULTS["RTL_RETURN_ALT"],
        "RTL_TYPE": px4.DEFAULTS["RTL_TYPE"],
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


def loss_parameters(kind: AutopilotKind) -> tuple[str, ...]:
    """What must be known of an autopilot before it is controlled."""
    return tuple(_DEFAULTS.get(kind, {}))


@dataclass(frozen=True, slots=True, kw_only=True)
class Loss:
    """What becomes of a flight that nobody steers. The way to rest is a v + b v^2.

    way_s, way_s2pm: a and b. untold: parameters that the autopilot never told.
    """

    kind: AutopilotKind
    action: Action
    timeout_s: float | None
    """How long the setpoint moves on; None: it stands."""
    way_s: float
    way_s2pm: float
    follows_mps2: float | None = None
    """The acceleration with which it follows setpoints; None: without a limit of its own."""
    home: px4.Return | None = None
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
            action=Action.HOLD,
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
            action=px4.offboard_loss(value)[0],
            timeout_s=None,
            way_s=_PX4_OVERSHOOT / gain_per_s,
            way_s2pm=_PX4_S2PM + 0.5 / brakes_mps2 - 0.5 / _PX4_HARD_MPS2,
            home=px4.Return.of(value),
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
        count, names = len(self.untold), ", ".join(self.untold)
        what = "parameter" if count == 1 else "parameters"
        return f"{count} {what} not told ({names}), taken as default"

    def lag(self, acceleration_mps2: float) -> str | None:
        """Why it cannot follow setpoints of an acceleration; None when it can."""
        follows_mps2 = self.follows_mps2
        if follows_mps2 is None or follows_mps2 >= acceleration_mps2 - _TOLERANCE_MPS2:
            return None
        return (
            f"ArduPilot brakes at {follows_mps2:.3g} < {acceleration_mps2:.3g} m/s2 "
            "(guidance.acceleration_mps2; "
            f"set WPNAV_ACCEL and WPNAV_ACCEL_Z {100.0 * acceleration_mps2:g})"
        )

    @property
    def objection_anywhere(self) -> str | None:
        """Why nobody should die anywhere; None where it depends on the place."""
        if self.timeout_s is not None and self.timeout_s > _LONGEST_S:
            return f"it would fly on for {self.timeout_s:.3g} s (if we died; set GUID_TIMEOUT 0.5)"
        if self.action is Action.RETURN and self.home is None:
            return self._against(
                f"{self.action.value} by an unknown way", why="RTL_TYPE is not 0; "
            )
        return self._against(self.action.value) if self.action is Action.FALL else None

    def objection(self, reach: Reach, rests_m: FloatArray, home_m: Vector | None) -> str | None:
        """Why nobody should die at rest at any of some places (n, 2); None when all is well.

        home_m: (x, y, z) in the site's frame. Only what stands on the site is known: a return is
        looked at as far as it is in the plane, and without a home as far as it climbs.
        """
        if self.objection_anywhere is not None or self.action is Action.HOLD:
            return self.objection_anywhere
        ways = paths(self.action, self.home, reach, rests_m, home_m)
        hit = first_hit(reach, ways, from_within=True)
        return (
            None
            if hit is None
            else self._against(f"hit {hit.obstacle}", f"it would {self.action.value} ")
        )

    def _against(self, what: str, how: str = "", why: str = "") -> str:
        return f"PX4 would {what} ({how}if we died; {why}set COM_OBL_RC_ACT 5)"
