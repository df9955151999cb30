"""The faults: causes that no measurement shows, noted until the supervisor has looked at them."""

from __future__ import annotations

from dataclasses import replace

from ..mission.conditions import Causes
from .stream import Refusal


class Faults:
    """What went wrong since the last look."""

    def __init__(self) -> None:
        self.causes = Causes()

    def note_pause(self, paused_s: float) -> None:
        """For so long nothing was thought, and then sent in time."""
        self.causes = replace(self.causes, thinking=f"control loop stalled {paused_s:.1f} s")

    def note_mode_left(self, mode: str) -> None:
        """The autopilot has left our mode, and may be back in it."""
        self.causes = replace(self.causes, pilot=f"the autopilot was in {mode}")

    def note_restart(self) -> None:
        """The autopilot restarted."""
        self.causes = replace(self.causes, restart="the autopilot restarted")

    def note_refusal(self, refused: Refusal) -> None:
        """A setpoint was not sent."""
        if refused.rest is None:
            self.causes = replace(self.causes, stream=refused.reason)
        elif refused.narrow:
            self.causes = replace(self.causes, narrow=refused.reason)
        else:
            self.causes = replace(self.causes, gate=refused.reason)

    def forget(self) -> None:
        """They have been looked at."""
        self.causes = Causes()
