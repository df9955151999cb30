"""What a process finds when it is started: a flight that was cut short, an aircraft in the air.

Pure: what the process before it remembered and what the aircraft says in, texts for people out.
"""

from __future__ import annotations

from dataclasses import replace

from ..mavlink.commands import Command, holds
from ..types import Telemetry
from .memory import Memory
from .surroundings import airborne, grounded

_PATIENCE_S = 3.0
"""EXTENDED_SYS_STATE may come later than the heartbeat; on ArduPilot it has to be asked for."""


class Awakening:
    """Tells it once, as soon as there is an autopilot through which people hear it."""

    def __init__(self, before: Memory | None) -> None:
        self.before = before
        """What it remembered, less what was released since."""
        self._heard_s: float | None = None
        self._told = False

    def note_stop(self, command: Command) -> None:
        """Take in a hold or a release before the planner is ready: after a release no rest is left.

        Where the mission stands begins anew with the planner, from `before`.
        """
        if self.before is not None and not holds(command):
            self.before = replace(self.before, task=None)

    def texts(self, telemetry: Telemetry, now_s: float, *, may_continue: bool) -> list[str]:
        """What is to be said now. may_continue: whether there is a rest that can be ordered."""
        autopilot, before = telemetry.autopilot, self.before
        if self._told or autopilot is None:
            return []
        if self._heard_s is None:
            self._heard_s = now_s
        flying = airborne(telemetry, now_s)
        if not (flying or grounded(telemetry)) and now_s - self._heard_s < _PATIENCE_S:
            return []
        self._told = True
        texts = []
        if before is not None and (before.streamed or flying):
            texts.append(f"restarted, was {before.words(now_s)}")
            if may_continue:
                texts.append("order continue to fly the rest")
        if flying and autopilot.ours:
            texts.append(f"{autopilot.mode} is on, waiting for an order")
        return texts
