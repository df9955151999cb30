"""The overseer: asks the supervisor what may be flown, and tells what began and what is over."""

from __future__ import annotations

import math
from collections.abc import Collection

from ..config import Supervision
from ..mavlink.session import Severity
from ..mission import supervisor
from ..mission.conditions import Action, Override, conditions
from ..mission.supervisor import Acting, Ruling
from ..types import Heard
from .causes import Seen, causes
from .reports import Reports

_LISTENS_AFTER_S = 1.0
"""Its first heartbeat is an answer to one of ours, before it is ready for texts."""
_DOES = {
    Action.SLOW: "slowing",
    Action.HOLD: "holding",
    Action.EXIT: "exiting",
    Action.EVACUATION: "evacuating",
    Action.RELEASE: "released",
}
"""What the companion does, for people."""


class _Audience:
    """The ground stations that are heard. lost_s: one that is silent for longer has left."""

    def __init__(self, lost_s: float) -> None:
        self._lost_s = lost_s
        self._heard_s: dict[int, float] = {}
        self._due_s = math.inf

    def has_grown(self, heard: Heard | None, now_s: float) -> bool:
        """Whether one has come that was not there before, and listens by now; once for each."""
        if heard is not None:
            before_s = self._heard_s.get(heard.system_id, -math.inf)
            self._heard_s[heard.system_id] = heard.received_s
            if heard.received_s - before_s > self._lost_s:
                self._due_s = now_s + _LISTENS_AFTER_S
        if now_s < self._due_s:
            return False
        self._due_s = math.inf
        return True


class Overseer:
    """Keeps what the supervisor remembers. off_path_m: the vehicle's."""

    def __init__(self, limits: Supervision, off_path_m: float, reports: Reports) -> None:
        self._limits = limits
        self._off_path_m = off_path_m
        self._reports = reports
        self._table = conditions(limits)
        self._watches = supervisor.HEALTHY
        self._ruling = Ruling()
        self._recorded: dict[str, str] = {}
        self._told: dict[str, bool] = {}
        """The names of those that people were told of, and whether by what the mission does."""
        self._audience = _Audience(limits.ground_link_lost_s)

    @property
    def ruling(self) -> Ruling:
        """What may be flown, as of the last look."""
        return self._ruling

    def rule(self, seen: Seen, now_s: float) -> Ruling:
        """What may be flown now."""
        found = causes(seen, self._limits, self._off_path_m, now_s)
        self._watches, self._ruling = supervisor.step(self._watches, found, now_s, self._table)
        return self._ruling

    def override(self, known: Collection[str]) -> None:
        """An operator has ordered, knowing that these conditions act."""
        self._watches = supervisor.overridden(self._watches, self._table, known=known)
        self._ruling = supervisor.ruling(self._watches, self._table)

    def note_told(self, name: str) -> None:
        """The mission has told of this condition, by what it does about it."""
        self._told[name] = True

    def tell(
        self,
        station: Heard | None,
        now_s: float,
        *,
        streaming: bool,
        known: Collection[str] = (),
    ) -> None:
        """Record what has begun and what is over; to people what the mission does not tell.

        That is, while something is streamed, whatever stands against it; and to a ground station
        that was not there before, all that does. known: what does not stand against the order that
        a plan is awaited for, as who gave it knew of it.
        """
        missed = self._audience.has_grown(station, now_s)
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
            if not self._told.get(name, True) and reason not in reasons:
                self._reports.say(Severity.NOTICE, reason, now_s, action="over")
        self._recorded = {name: item.reason for name, item in acting.items()}
        self._told = {name: told for name, told in self._told.items() if name in acting}
        if missed or not streaming:
            self._told = {}
        if not streaming:
            return
        for name, item in acting.items():
            if name in self._told or _before_control(item) or _is_past(item):
                continue
            self._told[name] = False
            leads = item.condition.action is ruling.action is not Action.CONTINUE
            action = _DOES[ruling.action] if leads else ""
            self._reports.say(Severity.WARNING, item.reason, now_s, action=action, news=missed)


def _is_past(item: Acting) -> bool:
    """Whether what would hold it or lead it out does so no more."""
    acts = not item.overridden and (item.lasts or item.condition.latched)
    return item.condition.action > Action.SLOW and not acts


def _before_control(item: Acting) -> bool:
    """Whether it only stands against beginning: who orders is told."""
    row = item.condition
    return row.action is Action.CONTINUE and row.override is Override.NOBODY
