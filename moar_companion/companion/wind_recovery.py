"""Recovery of an aircraft after a displacement by wind, and texts about its drift.

A recovery leg leads back an aircraft outside the workspace or beside the plane. It begins while the
mission holds, unless another condition holds it, or an operator ordered a hold there. The mission
resumes when its conditions permit. Inputs: the flight, the mission's state, the ruling, holds;
outputs: a recovery leg, texts.
"""

from __future__ import annotations

import math

from ..mavlink.session import Severity
from ..texts import pilot_texts
from ..texts.text_format import distance
from .estimation.pose import Pose
from .guidance.path_follower import PathFollower
from .mission.values import MissionStatus
from .mission_states import IN_CONTROL, MissionState
from .reports import Reports
from .safety.condition_types import Action
from .safety.supervisor import Ruling

_OUTSIDE = frozenset({"autopilot_fence", "outside_workspace", "off_path"})
"""Conditions that a recovery leg ends, and that therefore do not prevent it."""
_AGAIN_S = 5.0
"""Time between two searches for a recovery leg."""
_REPORT_AGAIN = 2.0
"""A drift is reported again when it has grown by this factor."""


class WindRecovery:
    """Keeps the drift reported last, and the time of the next search for a recovery leg."""

    def __init__(self, reports: Reports) -> None:
        self._reports = reports
        self._reported_m: float | None = None
        self._due_s = -math.inf
        self._hold_ordered = False

    def note_hold(self, flight: PathFollower | None) -> None:
        """Notes that a hold was ordered: an aircraft outside then stays until the next order."""
        self._hold_ordered = flight is not None and flight.path.needs_recovery

    def act(
        self,
        flight: PathFollower | None,
        pose: Pose | None,
        status: MissionStatus,
        ruling: Ruling,
        widened_m: float,
        now_s: float,
    ) -> None:
        """Runs one cycle: reports a growing drift, begins a recovery leg, or ends it."""
        if flight is None or pose is None or status.state not in IN_CONTROL:
            self._reported_m = None
            return
        self._report_drift(flight, pose, now_s)
        if status.state is not MissionState.HOLDING or status.requested is not None:
            self._hold_ordered = False
            return
        held = any(
            item.condition.action >= Action.HOLD and item.condition.name not in _OUTSIDE
            for item in ruling.conditions
            if not item.overridden
        )
        if flight.recovers:
            if held:
                flight.brake()
            return
        if held or self._hold_ordered or not flight.must_recover or now_s < self._due_s:
            return
        self._due_s = now_s + _AGAIN_S
        if flight.begin_recovery(widened_m):
            self._reports.send_text(
                Severity.WARNING, flight.recovery_text, now_s, action="returning"
            )
        else:
            reason = pilot_texts.NO_PATH_BACK(m=distance(flight.path.outside_m))
            self._reports.send_text(Severity.WARNING, reason, now_s)

    def _report_drift(self, flight: PathFollower, pose: Pose, now_s: float) -> None:
        drifted_m = flight.drifted_m(pose)
        if drifted_m is None:
            self._reported_m = None
        elif self._reported_m is None:
            self._reported_m = drifted_m  # the condition reports it
        elif drifted_m >= _REPORT_AGAIN * self._reported_m:
            self._reported_m = drifted_m
            reason = pilot_texts.BLOWN_OFF(outside_m=f"{drifted_m:.0f}")
            self._reports.send_text(Severity.WARNING, reason, now_s, is_new=True)
