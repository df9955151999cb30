"""The start report: an interrupted flight, an aircraft in the air, a wrong number of cells.

Inputs: the memory of the previous process, telemetry. Outputs: texts for operators. Pure.
"""

from __future__ import annotations

from dataclasses import replace

from ..mavlink.commands import Command, holds, stops
from ..mavlink.telemetry import Telemetry
from ..risk.power.cells import misread
from ..texts import service_texts
from .estimation.pose_tracker import airborne, grounded
from .mission_snapshot import MissionSnapshot

_PATIENCE_S = 3.0
"""EXTENDED_SYS_STATE may come later than the heartbeat; ArduPilot sends it only on request."""


class StartReport:
    """Reports each finding once: those of the start when an autopilot can forward the texts."""

    def __init__(self, before: MissionSnapshot | None) -> None:
        self.before = before
        """Memory of the previous process, without a task that was released or landed since."""
        self._received_s: float | None = None
        self._reported = False
        self._pack_reported = False

    def note_order(self, command: Command) -> None:
        """Takes an executed order: a release drops the task."""
        if stops(command) and not holds(command):
            self.drop_task()

    def drop_task(self) -> None:
        """Drops the task, which the mission status has only when the planner is ready."""
        if self.before is not None:
            self.before = replace(self.before, task=None)

    def texts(
        self, telemetry: Telemetry, cells: int | None, now_s: float, *, may_continue: bool
    ) -> list[str]:
        """Texts to report now. may_continue: the operator can order the rest of the task.

        cells: of the vehicle file; None while its comparison with the pack is not due.
        """
        texts = self._start_texts(telemetry, now_s, may_continue=may_continue)
        pack = None if self._pack_reported else misread(telemetry, cells)
        if pack is not None:
            self._pack_reported = True
            texts.append(pack)
        return texts

    def _start_texts(self, telemetry: Telemetry, now_s: float, *, may_continue: bool) -> list[str]:
        autopilot, before = telemetry.autopilot, self.before
        if self._reported or autopilot is None:
            return []
        if self._received_s is None:
            self._received_s = now_s
        flying = airborne(telemetry, now_s)
        if not (flying or grounded(telemetry)) and now_s - self._received_s < _PATIENCE_S:
            return []
        self._reported = True
        texts = []
        if before is not None and (before.streamed or flying):
            texts.append(service_texts.RESTARTED(before=before.words(now_s)))
            if may_continue:
                texts.append(service_texts.CONTINUE_POSSIBLE())
        if flying and autopilot.ours:
            texts.append(service_texts.MODE_STILL_ON(own_mode=autopilot.mode))
        return texts
