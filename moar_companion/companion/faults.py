"""The faults: causes that no measurement shows, kept until the supervisor has checked them."""

from __future__ import annotations

from dataclasses import replace

from ..safety.condition_types import Causes
from ..text_format import distance
from .setpoint_streamer import SetpointRefusal


class Faults:
    """Faults since the last check."""

    def __init__(self) -> None:
        self.causes = Causes()

    def note_pause(self, paused_s: float, limit_s: float) -> None:
        """Notes a control-loop stall: more than limit_s without an output sent in time.

        Data received meanwhile is old, and the autopilot may have acted on the offboard loss.
        """
        if paused_s > limit_s:
            stalled = f"control loop stalled {distance(paused_s)} s"
            self.causes = replace(self.causes, loop_stall=stalled)

    def note_mode_left(self, mode: str) -> None:
        """Notes that the autopilot has left our mode; it may be back in it."""
        self.causes = replace(self.causes, pilot=f"autopilot was in {mode}")

    def note_restart(self) -> None:
        """Notes a restart of the autopilot."""
        self.causes = replace(self.causes, autopilot_reboot="the autopilot restarted")

    def note_refusal(self, refused: SetpointRefusal) -> None:
        """Notes a setpoint that was not sent."""
        if refused.rest is None:
            self.causes = replace(self.causes, setpoint_rejected=refused.reason)
        elif refused.narrow:
            self.causes = replace(self.causes, no_clearance=refused.reason)
        else:
            self.causes = replace(self.causes, setpoint_held=refused.reason)

    def forget(self) -> None:
        """Clears the faults after a check."""
        self.causes = Causes()
