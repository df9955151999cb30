"""The supervisor: what may be flown now. A pure step machine above the mission.

Inputs: the causes of this instant and the time; output: a ruling, the gravest action of all the
conditions that act, with their reasons.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

from ..types import Mission
from .conditions import CONDITIONS, Action, Causes, Condition, Override


@dataclass(frozen=True, slots=True, kw_only=True)
class Watch:
    """What is remembered of a condition: since when its cause lasts, and is over.

    A cause that flickers lasts: one that has not acted is forgotten only when it has been over for
    the shorter of the condition's two times.
    """

    began_s: float | None = None
    over_s: float | None = None
    acting_s: float | None = None
    """Since when it acts; None while it does not."""
    overridden: bool = False
    reason: str = ""


_HEALTHY = Watch()
Watches = tuple[Watch, ...]
HEALTHY: Watches = (_HEALTHY,) * len(CONDITIONS)


@dataclass(frozen=True, slots=True, kw_only=True)
class Acting:
    """A condition that acts now, or would if an operator had not overridden it.

    since_s: when it began to. lasts: whether its cause still does, and it is not only not over for
    long enough.
    """

    condition: Condition
    since_s: float
    reason: str
    overridden: bool
    lasts: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Ruling:
    """What may be flown. conditions: those that act, the gravest first, overridden ones too."""

    conditions: tuple[Acting, ...] = ()

    @property
    def leading(self) -> Acting | None:
        """The gravest that is not overridden; None when nothing is against the flight."""
        return next((item for item in self.conditions if not item.overridden), None)

    @property
    def action(self) -> Action:
        """What is to be done."""
        return Action.CONTINUE if self.leading is None else self.leading.condition.action

    @property
    def reason(self) -> str:
        """The gravest condition's words; empty when nothing is against the flight."""
        return "" if self.leading is None else self.leading.reason

    @property
    def name(self) -> str:
        """The gravest condition's; empty when nothing is against the flight."""
        return "" if self.leading is None else self.leading.condition.name

    @property
    def farewell(self) -> bool:
        """Whether a last setpoint at rest does good when the stream ends."""
        return all(
            item.condition.farewell
            for item in self.conditions
            if not item.overridden and item.condition.action is Action.RELEASE
        )

    def apart_from(self, known: Collection[str]) -> Ruling:
        """What may be flown if the conditions of these names were overridden."""
        return Ruling(
            conditions=tuple(
                replace(item, overridden=item.overridden or item.condition.name in known)
                for item in self.conditions
            )
        )

    @property
    def names(self) -> frozenset[str]:
        """Of all the conditions that act, overridden ones too."""
        return frozenset(item.condition.name for item in self.conditions)

    def names_since(self, time_s: float) -> frozenset[str]:
        """Of those that have acted since then, or for longer."""
        return frozenset(item.condition.name for item in self.conditions if item.since_s <= time_s)

    def acts(self, name: str) -> bool:
        """Whether a condition acts, and nobody has overridden it."""
        return any(item.condition.name == name and not item.overridden for item in self.conditions)

    def against(self, mission: Mission) -> str | None:
        """Why a mission must not be ordered now; None when it may.

        What an operator has overridden for a safer order still stands against an inspection.
        """
        return next(
            (item.reason for item in self.conditions if item.condition.objects_to(mission)), None
        )


def step(
    watches: Watches,
    causes: Causes,
    now_s: float,
    table: tuple[Condition, ...] = CONDITIONS,
) -> tuple[Watches, Ruling]:
    """One look at the causes. table: CONDITIONS, or what `conditions` made of them."""
    after = tuple(
        _watched(condition, watch, getattr(causes, condition.name), now_s)
        for condition, watch in zip(table, watches, strict=True)
    )
    return after, ruling(after, table)


def ruling(watches: Watches, table: tuple[Condition, ...] = CONDITIONS) -> Ruling:
    """What these watches allow."""
    acting = [
        Acting(
            condition=condition,
            since_s=watch.acting_s,
            reason=watch.reason,
            overridden=watch.overridden,
            lasts=watch.over_s is None,
        )
        for condition, watch in zip(table, watches, strict=True)
        if watch.acting_s is not None
    ]
    acting.sort(key=lambda item: -item.condition.action)
    return Ruling(conditions=tuple(acting))


def overridden(
    watches: Watches,
    table: tuple[Condition, ...] = CONDITIONS,
    *,
    known: Collection[str],
) -> Watches:
    """After an operator's order: what acts and may be overridden does not, until it starts anew.

    known: the conditions of which who gave it knew.
    """
    return tuple(
        replace(watch, overridden=True)
        if watch.acting_s is not None
        and condition.name in known
        and condition.override is not Override.NOBODY
        else watch
        for condition, watch in zip(table, watches, strict=True)
    )


def _watched(condition: Condition, watch: Watch, cause: str | None, now_s: float) -> Watch:
    if cause is not None:
        began_s = now_s if watch.began_s is None else watch.began_s
        acts = now_s - began_s >= condition.after_s
        return Watch(
            began_s=began_s,
            acting_s=now_s if watch.acting_s is None and acts else watch.acting_s,
            overridden=watch.overridden,
            reason=cause,
        )
    if watch.began_s is None:
        return _HEALTHY
    over_s = now_s if watch.over_s is None else watch.over_s
    acts = watch.acting_s is not None
    waits = acts and condition.latched and not watch.overridden
    lasts_s = condition.over_s if acts else min(condition.after_s, condition.over_s)
    if now_s - over_s >= lasts_s and not waits:
        return _HEALTHY
    return replace(watch, over_s=over_s)
