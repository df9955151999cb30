"""The pilot's input: MANUAL_CONTROL messages, or a simulated remote control."""

import math
from typing import Any, Final

FULL: Final = 1000.0
CENTRE_US: Final = 1500
_SWITCH_US: Final = (1165, 1295, 1425, 1555, 1685, 1800)
"""Channel 5 at each of ArduPilot's six positions."""
_SWITCH_BOUNDS_US: Final = (1230, 1360, 1490, 1620, 1749)


class Sticks:
    """Stick positions -1 to 1, throttle too (0 in the middle), and presence of an input."""

    def __init__(self) -> None:
        """Start without a pilot."""
        self.roll = self.pitch = self.throttle = self.yaw = 0.0
        self.switch_us = CENTRE_US
        """The flight mode switch, channel 5."""
        self._override: tuple[int, int] | None = None
        """Value that a ground station sends in place of the switch, and its end."""
        self.remote_control = False
        self.last_us: int | None = None
        self.ever = False

    def hold(self, *, roll: float, pitch: float, throttle: float, yaw: float) -> None:
        """Switch the remote control on and hold the sticks there."""
        self.roll, self.pitch, self.throttle, self.yaw = roll, pitch, throttle, yaw
        self.remote_control = True

    def flip(self, position: int) -> None:
        """Turn the flight mode switch to a position, 1 to 6."""
        self.switch_us = _SWITCH_US[position - 1]

    def override_switch(self, us: int, until_us: int) -> None:
        """Use a ground station's channel 5 as the flight mode switch; 0 gives it back."""
        self._override = (us, until_us) if us else None

    @property
    def switch_position(self) -> int:
        """The position of the flight mode switch, 1 to 6."""
        return 1 + sum(self._channel_5_us > bound for bound in _SWITCH_BOUNDS_US)

    @property
    def _channel_5_us(self) -> int:
        return self.switch_us if self._override is None else self._override[0]

    def release(self) -> None:
        """Switch the remote control off."""
        self.remote_control = False
        self.last_us = None

    def take(self, message: Any, now_us: int) -> None:
        """Take a MANUAL_CONTROL message: x pitch, y roll, r yaw, z throttle 0 to 1000."""
        self.pitch, self.roll = message.x / FULL, message.y / FULL
        self.throttle, self.yaw = message.z / FULL * 2.0 - 1.0, message.r / FULL
        self.last_us = now_us

    def step(self, now_us: int) -> None:
        """Let the remote control repeat itself."""
        if self._override is not None and now_us >= self._override[1]:
            self._override = None
        if self.remote_control:
            self.last_us = now_us
        if self.last_us is not None:
            self.ever = True

    def present(self, now_us: int, timeout_s: float) -> bool:
        """Return True if input arrived within the time-out (COM_RC_LOSS_T)."""
        return self.last_us is not None and now_us - self.last_us <= timeout_s * 1e6

    def deflection(self) -> float:
        """Return the greater deflection of roll and pitch, 0 to 1."""
        return max(abs(self.roll), abs(self.pitch))

    def channels(self) -> list[int]:
        """Return RC channels 1 to 8 in microseconds: roll, pitch, throttle, yaw, mode, spare."""
        moved = [self.roll, -self.pitch, self.throttle, self.yaw]
        return [
            *(CENTRE_US + math.floor(500 * value + 0.5) for value in moved),
            self._channel_5_us,
            *[CENTRE_US] * 3,
        ]
