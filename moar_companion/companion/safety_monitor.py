"""Safety monitor: steps the supervisor, and reports conditions that begin or end."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable

from ..mavlink.session import Severity
from ..mavlink.telemetry import PeerHeartbeat
from ..settings.config import Supervision
from .reports import Reports
from .safety import supervisor
from .safety.check_inputs import CheckInputs
from .safety.condition_types import Action, Look, Override
from .safety.conditions import causes, conditions
from .safety.supervisor import Acting, Ruling

_LISTENS_AFTER_S = 1.0
"""Delay of texts: a station's first heartbeat answers ours, before it is ready for texts."""


class _Audience:
    """Ground stations on the links. lost_s: a station that is silent for longer has left."""

    def __init__(self, lost_s: float) -> None:
        self.lost_s = lost_s
        self._received_s: dict[int, float] = {}
        self._due_s = math.inf

    def has_grown(self, stations: Iterable[PeerHeartbeat], now_s: float) -> bool:
        """True once for each new ground station, when it is ready for texts."""
        for received in stations:
            before_s = self._received_s.get(received.system_id, -math.inf)
            self._received_s[received.system_id] = received.received_s
            if received.received_s - before_s > self.lost_s:
                self._due_s = now_s + _LISTENS_AFTER_S
        if now_s < self._due_s:
            return False
        self._due_s = math.inf
        return True


class SafetyMonitor:
    """Keeps the supervisor's state. off_path_m: the vehicle's."""

    def __init__(self, limits: Supervision, off_path_m: float, reports: Reports) -> None:
        self._reports = reports
        self._watches = supervisor.HEALTHY
        self._ruling = Ruling()
        self._recorded: dict[str, str] = {}
        self._reported: dict[str, bool] = {}
        """Names of the reported conditions; True if the mission reported one by its action."""
        self._audience = _Audience(limits.ground_link_lost_s)
        self.take_settings(limits, off_path_m)

    @property
    def ruling(self) -> Ruling:
        """Ruling of the last cycle."""
        return self._ruling

    def take_settings(self, limits: Supervision, off_path_m: float) -> None:
        """Takes the settings in force."""
        self._limits, self._off_path_m = limits, off_path_m
        self._table = conditions(limits)
        self._audience.lost_s = limits.ground_link_lost_s

    def rule(self, seen: CheckInputs, now_s: float) -> Ruling:
        """Judges the causes found now; returns the new ruling."""
        found = causes(Look(seen, self._limits, self._off_path_m, now_s))
        self._watches, self._ruling = supervisor.step(self._watches, found, now_s, self._table)
        return self._ruling

    def override(self, known: Collection[str]) -> None:
        """Overrides the conditions that the operator had received before the order."""
        self._watches = supervisor.overridden(self._watches, self._table, known=known)
        self._ruling = supervisor.ruling(self._watches, self._table)

    def note_reported(self, name: str) -> None:
        """Notes that the mission has reported this condition, by its action."""
        self._reported[name] = True

    def report(
        self,
        stations: Iterable[PeerHeartbeat],
        now_s: float,
        *,
        streaming: bool,
        known: Collection[str] = (),
    ) -> None:
        """Records conditions that begin or end; sends texts the mission does not send.

        Texts are sent during a stream, about every condition against it. A new ground station
        receives all of them. known: conditions that do not count against the order with the awaited
        plan, because its operator had received them.
        """
        missed = self._audience.has_grown(stations, now_s)
        ruling = self._ruling.apart_from(known)
        acting = {item.condition.name: item for item in ruling.conditions}
        reasons = {item.reason for item in acting.values()}
        for name, item in acting.items():
            if name in self._recorded:
                continue
            self._reports.record(
                "condition",
                now_s,
                name=name,
                action=item.condition.action.name.lower(),
                began=True,
                reason=item.reason,
            )
        for name, reason in self._recorded.items():
            if name in acting:
                continue
            self._reports.record("condition", now_s, name=name, began=False, reason=reason)
            # Another condition may have begun for the same reason.
            if not self._reported.get(name, True) and reason not in reasons:
                self._reports.send_text(Severity.NOTICE, reason, now_s, action="over")
        self._recorded = {name: item.reason for name, item in acting.items()}
        self._reported = {
            name: reported for name, reported in self._reported.items() if name in acting
        }
        if missed or not streaming:
            self._reported = {}
        if not streaming:
            return
        for name, item in acting.items():
            if name in self._reported or _before_control(item) or _is_past(item):
                continue
            self._reported[name] = False
            leads = item.condition.action is ruling.action is not Action.CONTINUE
            action = ruling.action.words if leads else ""
            self._reports.send_text(
                Severity.WARNING, item.reason, now_s, action=action, is_new=missed
            )


def _is_past(item: Acting) -> bool:
    """True if a condition above SLOW is overridden, or over and not latched."""
    acts = not item.overridden and (item.lasts or item.condition.latched)
    return item.condition.action > Action.SLOW and not acts


def _before_control(item: Acting) -> bool:
    """True if the condition only prevents a start: the answer to the order reports it."""
    row = item.condition
    return row.action is Action.CONTINUE and row.override is Override.NONE
