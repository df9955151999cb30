"""Offboard loss: the stopping distance after it, and the autopilot's action.

A killed process sends no last setpoint at rest: the previous one stands, with its velocity.
Inputs: the autopilot's parameters; stop points of the aircraft. Outputs: the stopping distance at
a speed, the speed that a free distance allows, and the reason why a flight should not be flown.

PX4 holds the last point with its velocity as feed-forward, and so comes to rest v / MPC_XY_P beyond
it; where COM_OF_LOSS_T ends before that, it brakes at MPC_ACC_HOR. ArduPilot moves the point on at
that velocity for GUID_TIMEOUT, and brakes at WPNAV_ACCEL or WPNAV_ACCEL_Z, as its jerk allows.
The distances are bounds over flights of the fake autopilots, level, up, down and diagonal, at 0.7
to 5 m/s, with time-outs of 0.1 to 3 s, in wind of 0 and 6 m/s
(`tests/safety/test_offboard_loss.py`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..autopilots import px4
from ..autopilots.failsafe_actions import Action, first_hit, paths
from ..planner.free_distance import FreeDistance
from ..planner.grid import FloatArray
from ..types import AutopilotKind, Vector

_PX4_OVERSHOOT = 1.2
"""Factor of v / MPC_XY_P: the controller's integral has learnt the drag of the flight."""
_PX4_S2PM = 0.1
"""Term of v^2 that COM_OBL_RC_ACT adds: it brakes from the velocity at its start."""
_PX4_HARD_MPS2 = 3.0
"""Default of MPC_ACC_HOR: v^2 / 2a is longer with a lower value."""
_ARDUPILOT_S = 0.4
"""0.1 s until ArduPilot detects missing setpoints; the rest is the shaper's jerk."""
_ARDUPILOT_SHAPING_S = 0.5
"""Time in which the default jerk builds the acceleration up; any more counts 1.1 s/s."""
_ARDUPILOT_SHAPED = 1.1
_ARDUPILOT_LEVEL = 0.5
"""Fraction of WPNAV_ACCEL with which ArduPilot brakes in a tail wind."""
_SOFT_MPS2 = 0.1
"""Lower bound of braking: a parameter of 0 or less means something else."""
_TOLERANCE_MPS2 = 1e-3
"""Autopilots report parameters as 32-bit floats."""
_LONGEST_S = 5.0
"""Upper end of GUID_TIMEOUT's range; above it no speed is left next to an obstacle."""


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
"""Defaults of PX4 v1.17 and ArduCopter 4.6, for parameters that are never reported."""


def loss_parameters(kind: AutopilotKind) -> tuple[str, ...]:
    """Names of the parameters that must be known before the companion takes control."""
    return tuple(_DEFAULTS.get(kind, {}))


@dataclass(frozen=True, slots=True, kw_only=True)
class OffboardLoss:
    """Flight after an offboard loss. The stopping distance is a v + b v^2.

    way_s, way_s2pm: a and b. untold: parameters that the autopilot never reported.
    """

    kind: AutopilotKind
    action: Action
    timeout_s: float | None
    """Time for which the autopilot moves the setpoint on; None: the setpoint stands."""
    way_s: float
    way_s2pm: float
    follows_mps2: float | None = None
    """Acceleration limit of the autopilot when it follows setpoints; None: no limit of its own."""
    home: px4.Return | None = None
    """Route of a return to home; None: it leads elsewhere, or the action is no return."""
    untold: tuple[str, ...] = ()

    @classmethod
    def of(cls, kind: AutopilotKind, parameters: Mapping[str, float | None]) -> OffboardLoss | None:
        """Returns the loss by the parameters known now; None for an unknown kind of autopilot."""
        return cls.told(kind, {**dict.fromkeys(_DEFAULTS.get(kind, ())), **parameters})

    @classmethod
    def told(
        cls, kind: AutopilotKind, parameters: Mapping[str, float | None]
    ) -> OffboardLoss | None:
        """Returns the loss by parameters (None: never reported); None until all were asked for."""
        defaults = _DEFAULTS.get(kind)
        if defaults is None or not defaults.keys() <= parameters.keys():
            return None
        untold = tuple(name for name in defaults if parameters[name] is None)
        value = {**defaults, **{n: v for n, v in parameters.items() if v is not None}}
        if kind is AutopilotKind.ARDUPILOT:
            return cls._of_ardupilot(value, untold)
        return cls._of_px4(value, untold)

    @classmethod
    def _of_ardupilot(cls, value: Mapping[str, float], untold: tuple[str, ...]) -> OffboardLoss:
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
    def _of_px4(cls, value: Mapping[str, float], untold: tuple[str, ...]) -> OffboardLoss:
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
        """Stopping distance beyond the last setpoint, at speeds (n,): (n,)."""
        return self.way_s * speed_mps + self.way_s2pm * speed_mps**2

    def speed_mps(self, free_m: FloatArray) -> FloatArray:
        """Greatest speeds (n,) whose stopping distance is within (n,)."""
        half = 0.5 * self.way_s / self.way_s2pm
        return np.asarray(np.sqrt(half**2 + free_m / self.way_s2pm) - half)

    @property
    def assumption(self) -> str | None:
        """Text about parameters taken as default; None if all were reported."""
        if not self.untold:
            return None
        count, names = len(self.untold), ", ".join(self.untold)
        what = "parameter" if count == 1 else "parameters"
        return f"{count} {what} not told ({names}), taken as default"

    def lag(self, acceleration_mps2: float) -> str | None:
        """Reason why ArduPilot cannot follow this acceleration; None if it can."""
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
        """Reason why an offboard loss is unsafe anywhere; None if that depends on the place."""
        if self.timeout_s is not None and self.timeout_s > _LONGEST_S:
            fly_on = f"it would fly on for {self.timeout_s:.3g} s"
            return f"{fly_on} (on offboard loss; set GUID_TIMEOUT 0.5)"
        if self.action is Action.RETURN and self.home is None:
            return self._against(
                f"{self.action.value} by an unknown way", why="RTL_TYPE is not 0; "
            )
        return self._against(self.action.value) if self.action is Action.FALL else None

    def objection(
        self, reach: FreeDistance, rests_m: FloatArray, home_m: Vector | None
    ) -> str | None:
        """Reason why an offboard loss at these stop points (n, 2) is unsafe; None if it is safe.

        home_m: (x, y, z) in the site's frame. Only the site's obstacles are known. A return is
        checked as far as it lies in the plane; without a home, only its climb.
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
        return f"PX4 would {what} ({how}on offboard loss; {why}set COM_OBL_RC_ACT 5)"
