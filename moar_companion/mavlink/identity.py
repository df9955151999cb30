"""Who the autopilot is: latched once heard, refused when there are two, seen when it restarts."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from ..types import AutopilotKind
from . import translate
from .dialect import Message, mavlink

_LINK_TIMEOUT_S = 3.0
"""Three periods of the heartbeat without any packet: the autopilot's link is lost, and another that
hears it is used."""
_CONFLICT_TIMEOUT_S = 10.0
"""An autopilot that has been silent for so long is gone; nothing is streamed to it any more."""
_CONFLICT_PERIOD_S = 10.0
"""Between two reports of conflicts: ids that somebody invents are reported no more often."""
_MOST_OTHERS = 8
"""Other autopilots kept; with more, the one that has been silent longest is forgotten."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Autopilot:
    """An autopilot heard on a link with the role autopilot."""

    system_id: int
    component_id: int
    kind: AutopilotKind
    link: str

    def __str__(self) -> str:
        return f"{self.kind.value} with system id {self.system_id} on {self.link}"


@dataclass(frozen=True, slots=True, kw_only=True)
class AutopilotFound:
    """The first heartbeat of an autopilot: from now on its system id is ours."""

    autopilot: Autopilot


@dataclass(frozen=True, slots=True, kw_only=True)
class AutopilotRestarted:
    """Its clock went back, or it says that it boots: streams and origin are asked for anew."""

    autopilot: Autopilot


@dataclass(frozen=True, slots=True, kw_only=True)
class AutopilotConflict:
    """A second autopilot is heard: nothing is controlled while both are.

    reason: what shows that there are two, in short words for people.
    """

    autopilot: Autopilot
    other: Autopilot
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class _Other:
    """What was heard of a second autopilot. cause: the words for why there is no control."""

    heard_s: float
    cause: str
    told: bool


class Identity:
    """Latches the only autopilot from heartbeats of component 1 on autopilot links."""

    def __init__(self) -> None:
        self.autopilot: Autopilot | None = None
        self.heard_s: float | None = None
        """When the autopilot's last packet, of any kind, was received on its link."""
        self._others: dict[tuple[int, AutopilotKind] | str, _Other] = {}
        """By their ids; under the autopilot's own by what tells them apart."""
        self._told_s = -math.inf
        """When a conflict was last reported."""
        self._booting = False

    def hear(
        self, message: Message, *, link: str, now_s: float
    ) -> AutopilotFound | AutopilotRestarted | AutopilotConflict | None:
        """Takes a HEARTBEAT from a link with the role autopilot."""
        if message.get_srcComponent() != mavlink.MAV_COMP_ID_AUTOPILOT1:
            return None
        kind = translate.autopilot_kind(message)
        if kind is None:
            return None
        heard = Autopilot(
            system_id=message.get_srcSystem(),
            component_id=message.get_srcComponent(),
            kind=kind,
            link=link,
        )
        booting = message.system_status == mavlink.MAV_STATE_BOOT
        known = self.autopilot
        key = (heard.system_id, heard.kind)
        other = known is not None and key != (known.system_id, known.kind)
        if known is None or (other and self._is_gone(now_s) and not self._others.keys() - {key}):
            self.autopilot = heard
            self.heard_s = now_s
            self._booting = booting
            self._others.clear()
            self._told_s = -math.inf
            return AutopilotFound(autopilot=heard)
        if other:
            ids = f"systems {known.system_id} and {heard.system_id}"
            words = f"two autopilots, {ids}"
            return self._note(key, heard, words, "two autopilots are heard", now_s)
        if link != known.link:
            if self.heard_s is not None and now_s - self.heard_s <= _LINK_TIMEOUT_S:
                return None
            self.autopilot = replace(known, link=link)
        self.heard_s = now_s
        restarted = booting and not self._booting
        self._booting = booting
        return AutopilotRestarted(autopilot=self.autopilot or known) if restarted else None

    def note_other_clock(self, now_s: float) -> AutopilotConflict | None:
        """Takes note of a packet with the autopilot's ids and another clock."""
        if self.autopilot is None:
            return None
        words = f"two clocks under autopilot id {self.autopilot.system_id}"
        return self._note("clock", self.autopilot, words, words, now_s)

    def _note(
        self,
        key: tuple[int, AutopilotKind] | str,
        other: Autopilot,
        reason: str,
        cause: str,
        now_s: float,
    ) -> AutopilotConflict | None:
        """Takes note of another autopilot; the conflict when it is to be reported."""
        known, others, before = self.autopilot, self._others, self._others.get(key)
        told = before is not None and before.told
        tells = known is not None and not told and now_s - self._told_s >= _CONFLICT_PERIOD_S
        if before is None and len(others) >= _MOST_OTHERS:
            del others[min(others, key=lambda other: others[other].heard_s)]
        others[key] = _Other(heard_s=now_s, cause=cause, told=told or tells)
        if known is None or not tells:
            return None
        self._told_s = now_s
        return AutopilotConflict(autopilot=known, other=other, reason=reason)

    def _is_gone(self, now_s: float) -> bool:
        """Whether the autopilot has been silent for so long that another may take its place."""
        return self.heard_s is not None and now_s - self.heard_s > _CONFLICT_TIMEOUT_S

    def alive(self, now_s: float) -> bool:
        """Whether the autopilot's last packet is younger than three periods of its heartbeat."""
        return self.heard_s is not None and now_s - self.heard_s <= _LINK_TIMEOUT_S

    def forget_silent(self, now_s: float) -> None:
        """Ends a conflict when the other autopilot has not been heard for 10 s."""
        for key, other in list(self._others.items()):
            if now_s - other.heard_s > _CONFLICT_TIMEOUT_S:
                del self._others[key]

    @property
    def conflict(self) -> str | None:
        """Words for more than one autopilot that is heard; None while there is one at most."""
        return next((other.cause for other in self._others.values()), None)
