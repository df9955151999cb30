"""Identity of the autopilot: latched at its first heartbeat; conflicts and restarts detected."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

from ..texts import service_texts
from ..types import AutopilotKind
from . import translate
from .dialect import Message, mavlink

_LINK_TIMEOUT_S = 3.0
"""Three heartbeat periods without any packet: the link to the autopilot is lost. The companion then
uses another link that receives the autopilot."""
_CONFLICT_TIMEOUT_S = 10.0
"""Time without a heartbeat after which another autopilot may replace the present one."""
_CONFLICT_PERIOD_S = 10.0
"""Least time between two reports of conflicts, so that invented ids cannot flood the reports."""
_MOST_OTHERS = 8
"""Limit of other autopilots kept; beyond it the one received least recently is dropped."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Autopilot:
    """Autopilot received on a link with the role autopilot."""

    system_id: int
    component_id: int
    kind: AutopilotKind
    link: str

    @property
    def ids(self) -> tuple[int, int]:
        """System and component id."""
        return self.system_id, self.component_id

    def __str__(self) -> str:
        return f"{self.kind} with system id {self.system_id} on {self.link}"


@dataclass(frozen=True, slots=True, kw_only=True)
class AutopilotFound:
    """First heartbeat of an autopilot: the companion takes over its system id."""

    autopilot: Autopilot


@dataclass(frozen=True, slots=True, kw_only=True)
class AutopilotRestarted:
    """Restart of the autopilot, by its clock or its state: the session repeats its requests."""

    autopilot: Autopilot


@dataclass(frozen=True, slots=True, kw_only=True)
class AutopilotConflict:
    """A second autopilot is received: the companion controls neither while both are.

    reason: sign of the second autopilot, as a short text.
    """

    autopilot: Autopilot
    other: Autopilot
    reason: str


class _Other(NamedTuple):
    """Record of a second autopilot. cause: text of the reason for no control."""

    received_s: float
    cause: str
    reported: bool


class Identity:
    """Identification of the one autopilot, by heartbeats of component 1 on autopilot links."""

    def __init__(self) -> None:
        self.autopilot: Autopilot | None = None
        self.received_s: float | None = None
        """Time of the autopilot's last packet, of any kind, on its link."""
        self._others: dict[tuple[int, AutopilotKind] | str, _Other] = {}
        """Other autopilots by ids; one with the autopilot's own ids by its distinguishing sign."""
        self._reported_s = -math.inf
        """Time of the last report of a conflict."""
        self._booting = False

    def handle(
        self, message: Message, *, link: str, now_s: float
    ) -> AutopilotFound | AutopilotRestarted | AutopilotConflict | None:
        """Takes a HEARTBEAT from a link with the role autopilot."""
        if message.get_srcComponent() != mavlink.MAV_COMP_ID_AUTOPILOT1:
            return None
        kind = translate.autopilot_kind(message)
        if kind is None:
            return None
        received = Autopilot(
            system_id=message.get_srcSystem(),
            component_id=message.get_srcComponent(),
            kind=kind,
            link=link,
        )
        booting = message.system_status == mavlink.MAV_STATE_BOOT
        known = self.autopilot
        key = (received.system_id, received.kind)
        other = known is not None and key != (known.system_id, known.kind)
        if known is None or (other and self._is_gone(now_s) and not self._others.keys() - {key}):
            self.autopilot = received
            self.received_s = now_s
            self._booting = booting
            self._others.clear()
            self._reported_s = -math.inf
            return AutopilotFound(autopilot=received)
        if other:
            words = service_texts.TWO_AUTOPILOTS(id=known.system_id, other_id=received.system_id)
            return self._note(key, received, words, "two autopilots are received", now_s)
        if link != known.link:
            if self.received_s is not None and now_s - self.received_s <= _LINK_TIMEOUT_S:
                return None
            self.autopilot = replace(known, link=link)
        self.received_s = now_s
        restarted = booting and not self._booting
        self._booting = booting
        return AutopilotRestarted(autopilot=self.autopilot or known) if restarted else None

    def note_other_clock(self, now_s: float) -> AutopilotConflict | None:
        """Records a packet with the autopilot's ids and another clock; returns a due conflict."""
        if self.autopilot is None:
            return None
        words = service_texts.TWO_CLOCKS(id=self.autopilot.system_id)
        return self._note("clock", self.autopilot, words, words, now_s)

    def _note(
        self,
        key: tuple[int, AutopilotKind] | str,
        other: Autopilot,
        reason: str,
        cause: str,
        now_s: float,
    ) -> AutopilotConflict | None:
        """Records another autopilot; returns the conflict if it is to be reported."""
        known, others, before = self.autopilot, self._others, self._others.get(key)
        reported = before is not None and before.reported
        reports_it = (
            known is not None and not reported and now_s - self._reported_s >= _CONFLICT_PERIOD_S
        )
        if before is None and len(others) >= _MOST_OTHERS:
            del others[min(others, key=lambda other: others[other].received_s)]
        others[key] = _Other(received_s=now_s, cause=cause, reported=reported or reports_it)
        if known is None or not reports_it:
            return None
        self._reported_s = now_s
        return AutopilotConflict(autopilot=known, other=other, reason=reason)

    def _is_gone(self, now_s: float) -> bool:
        """True once the autopilot has been silent for so long that another may replace it."""
        return self.received_s is not None and now_s - self.received_s > _CONFLICT_TIMEOUT_S

    def is_present(self, now_s: float) -> bool:
        """True while the autopilot's last packet is at most three heartbeat periods old."""
        return self.received_s is not None and now_s - self.received_s <= _LINK_TIMEOUT_S

    def forget_silent(self, now_s: float) -> None:
        """Ends a conflict when the other autopilot has been silent for 10 s."""
        for key, other in list(self._others.items()):
            if now_s - other.received_s > _CONFLICT_TIMEOUT_S:
                del self._others[key]

    @property
    def conflict(self) -> str | None:
        """Text for the conflict of several received autopilots; None without one."""
        return next((other.cause for other in self._others.values()), None)
