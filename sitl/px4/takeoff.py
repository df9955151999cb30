"""PX4's take-off ramp: the upward speed limit rises from "no thrust" to its full value.

    limit(t) = v0 + (full - v0) t / MPC_TKO_RAMP_T,   v0 = -g / MPC_Z_VEL_P_ACC

Measured on PX4 v1.17.0: "Takeoff detected" 1.6 s after arming, off the ground after 3 s, 10 m
after 8.4 s.
"""

from typing import Final

from sitl.parameters import Parameters
from sitl.quadrotor import GRAVITY_MPS2

_DETECTED_AFTER_S: Final = 0.6


class TakeoffRamp:
    """Idle state of the motors, and limit of the climb speed."""

    def __init__(self, parameters: Parameters) -> None:
        """Start on the ground."""
        self._parameters = parameters
        self._start_us: int | None = None

    def reset(self) -> None:
        """Reset to the ground."""
        self._start_us = None

    def active(self) -> bool:
        """Return True during the ramp."""
        return self._start_us is not None

    def detected(self, now_us: int) -> bool:
        """Return True if the land detector detects flight."""
        return self._start_us is not None and now_us - self._start_us >= _DETECTED_AFTER_S * 1e6

    def idle(self, now_us: int, *, landed: bool, spooled_up: bool, wants_up: bool) -> bool:
        """Return True if the motors stay at idle in this tick; starts the ramp for a climb."""
        if self._start_us is not None or not landed:
            return False
        if not (spooled_up and wants_up):
            return True
        self._start_us = now_us
        return False

    def up_limit_mps(self, now_us: int, full_mps: float) -> float:
        """Return the limit of the climb now; ends the ramp when it is over."""
        if self._start_us is None:
            return full_mps
        value = self._parameters.value
        share = (now_us - self._start_us) / 1e6 / max(0.1, value("MPC_TKO_RAMP_T"))
        if share >= 1.0:
            self._start_us = None
            return full_mps
        start_mps = -GRAVITY_MPS2 / value("MPC_Z_VEL_P_ACC")
        return start_mps + (full_mps - start_mps) * share
