"""Offboard loss as a value: the stopping distance after it, and the autopilot's action. Pure.

A killed process sends no last setpoint at rest: the previous one stands, with its velocity. The
file of each autopilot reads the value from its parameters; `safety/failsafe_paths` has the paths.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ...texts.text_format import exceeds, reason_chars, with_name
from ...types import AutopilotKind
from .failsafe_actions import AutopilotAction, ReturnHeight

FloatArray = npt.NDArray[np.floating[Any]]

SOFT_MPS2 = 0.1
"""Lower bound of braking: a parameter of 0 or less means something else."""
_TOLERANCE_MPS2 = 1e-3
"""Autopilots report parameters as 32-bit floats."""
_LONGEST_S = 5.0
"""Longest time on the last setpoint; above it no speed is left next to an obstacle."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OffboardLoss:
    """Flight after an offboard loss. The stopping distance is a v + b v^2.

    stopping_s, stopping_s2pm: a and b.
    """

    kind: AutopilotKind
    name: str
    """Name of the autopilot, for texts."""
    action: AutopilotAction
    remedy: str
    """Setting that prevents the objections, for texts."""
    timeout_s: float | None
    """Time for which the autopilot moves the setpoint on; None: the setpoint stands."""
    timeout_parameter: str = ""
    """Parameter of that time, for texts."""
    stopping_s: float
    stopping_s2pm: float
    follows_mps2: float | None = None
    """Acceleration limit of the autopilot when it follows setpoints; None: no limit of its own."""
    follows_parameters: tuple[str, ...] = ()
    """Parameters of that limit, and their unit in m/s2."""
    follows_unit_mps2: float = 1.0
    home: ReturnHeight | None = None
    """Route of a return to home; None for a return to another place, or another action."""
    unknown_return: str = ""
    """Cause of a return to another place, for texts."""

    def stopping_m(self, speed_mps: FloatArray) -> FloatArray:
        """Stopping distance beyond the last setpoint, at speeds (n,): (n,)."""
        return self.stopping_s * speed_mps + self.stopping_s2pm * speed_mps**2

    def speed_mps(self, free_m: FloatArray) -> FloatArray:
        """Greatest speeds (n,) with stopping distances within (n,)."""
        half = 0.5 * self.stopping_s / self.stopping_s2pm
        return np.asarray(np.sqrt(half**2 + free_m / self.stopping_s2pm) - half)

    def lag(self, acceleration_mps2: float) -> str | None:
        """Reason why the autopilot cannot follow this acceleration; None if it can."""
        if self.follows_mps2 is None or follows(self.follows_mps2, acceleration_mps2):
            return None
        return (
            f"{self.name} brakes {self.follows_mps2:.3g} < {acceleration_mps2:.3g} m/s2 "
            f"(guidance.acceleration_mps2; {self.follows_remedy(acceleration_mps2)})"
        )

    def follows_remedy(self, acceleration_mps2: float) -> str:
        """Settings with which the autopilot follows an acceleration, for texts."""
        value = acceleration_mps2 / self.follows_unit_mps2
        return f"set {' and '.join(self.follows_parameters)} {value:g}"

    @property
    def objection_anywhere(self) -> str | None:
        """Reason why an offboard loss is unsafe anywhere; None if that depends on the place."""
        long = exceeds(self.timeout_parameter, self.timeout_s, _LONGEST_S, "s")
        if long is not None:
            return f"{long} ({self.name} would fly on so long on offboard loss; {self.remedy})"
        if self.action is AutopilotAction.RETURN and self.home is None:
            why = f"{self.unknown_return}; "
            return self._against(f"{self.action.value}, route unknown", why=why)
        return self._against(self.action.value) if self.action is AutopilotAction.FALL else None

    def collision(self, obstacle: str) -> str:
        """Reason against a flight on which the action would hit an obstacle."""
        room = reason_chars("rejected") - len(f"{self.name} would ")
        return self._against(with_name("hit {}", obstacle, room), f"it would {self.action.value} ")

    def _against(self, what: str, how: str = "", why: str = "") -> str:
        return f"{self.name} would {what} ({how}on offboard loss; {why}{self.remedy})"


def follows(limit_mps2: float, acceleration_mps2: float) -> bool:
    """Returns True if an autopilot with this limit can follow setpoints of this acceleration."""
    return limit_mps2 >= acceleration_mps2 - _TOLERANCE_MPS2
