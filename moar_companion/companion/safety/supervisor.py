"""The supervisor: selects the permitted action. A pure step machine above the mission.

Inputs: the causes of this instant and the time; output: a ruling, the gravest action of all the
conditions that act, with their reasons.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

from ...types import Mission
from .condition_types import Action, Condition, Override
from .conditions import CONDITIONS


@dataclass(frozen=True, slots=True, kw_only=True)
class Watch:
    """State of a condition: times since which its cause lasts, and is over.

    A cause with breaks lasts: one that has not acted clears only when it has been over for the
    shorter of the condition's two times.
    """

    began_s: float | None = None
    over_s: float | None = None
    acting_s: float | None = None
    """Time since which it acts; None while it does not."""
    overridden: bool = False
    reason: str = ""


_HEALTHY = Watch()
Watches = tuple[Watch, ...]
HEALTHY: Watches = (_HEALTHY,) * len(CONDITIONS)


@dataclass(frozen=True, slots=True, kw_only=True)
class Acting:
    """A condition that acts now, or would if an operator had not overridden it.

    since_s: time when it began to act. lasts: its cause is still present; False while the
    condition only waits to clear.
    """

    condition: Condition
    since_s: float
    reason: str
    overridden: bool
    lasts: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Ruling:
    """Ruling on the flight. conditions: those that act, the gravest first, overridden ones too."""

    conditions: tuple[Acting, ...] = ()

    @property
    def leading(self) -> Acting | None:
        """Gravest condition that is not overridden; None if there is none."""
        return next((item for item in self.conditions if not item.overridden), None)

    @property
    def action(self) -> Action:
        """Action of the gravest condition."""
        return Action.CONTINUE if self.leading is None else self.leading.condition.action

    @property
    def reason(self) -> str:
        """Reason of the gravest condition; empty if there is none."""
        return "" if self.leading is None else self.leading.reason

    @property
    def name(self) -> str:
        """Name of the gravest condition; empty if there is none."""
        return "" if self.leading is None else self.leading.condition.name

    @property
    def last_setpoint(self) -> bool:
        """True if a last setpoint at rest is useful when the stream ends."""
        return all(
            item.condition.last_setpoint
            for item in self.conditions
            if not item.overridden and item.condition.action is Action.RELEASE
        )

    @property
    def passing(self) -> bool:
        """True if no release that orders cannot override has a lasting cause."""
        return all(
            item.condition.passing
            for item in self.conditions
            if item.condition.action is Action.RELEASE and item.condition.override is Override.NONE
        )

    def apart_from(self, known: Collection[str]) -> Ruling:
        """Returns the ruling with the conditions of these names overridden."""
        return Ruling(
            conditions=tuple(
                replace(item, overridden=item.overridden or item.condition.name in known)
                for item in self.conditions
            )
        )

    @property
    def names(self) -> frozenset[str]:
        """Names of all the conditions that act, overridden ones too."""
        return frozenset(item.condition.name for item in self.conditions)

    def names_since(self, time_s: float) -> frozenset[str]:
        """Names of the conditions that have been active continuously since `time_s`."""
        return frozenset(item.condition.name for item in self.conditions if item.since_s <= time_s)

    def acts(self, name: str) -> bool:
        """True if a condition acts and is not overridden."""
        return any(item.condition.name == name and not item.overridden for item in self.conditions)

    def against(self, mission: Mission) -> str | None:
        """Reason why a mission must not be ordered now; None if it may be ordered.

        A condition that an operator has overridden for a safer order still forbids an inspection.
        """
        return next(
            (item.reason for item in self.conditions if item.condition.objects_to(mission)), None
        )


def step(
    watches: Watches,
    causes: Mapping[str, str],
    now_s: float,
    table: tuple[Condition, ...] = CONDITIONS,
) -> tuple[Watches, Ruling]:
    """Runs one cycle on the causes, by the names of their conditions.

    table: CONDITIONS, or the result of `conditions`.
    """
    after = tuple(
        watch
        if (cause := causes.get(condition.name)) is None and watch is _HEALTHY
        else _watched(condition, watch, cause, now_s)
        for condition, watch in zip(table, watches, strict=True)
    )
    return after, ruling(after, table)


def ruling(watches: Watches, table: tuple[Condition, ...] = CONDITIONS) -> Ruling:
    """Returns the ruling of these watches."""
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
    """Returns the watches after an order, which overrides acting conditions until they clear.

    known: the conditions known to the operator; only those that may be overridden are.
    """
    return tuple(
        replace(watch, overridden=True)
        if watch.acting_s is not None
        and condition.name in known
        and condition.override is not Override.NONE
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
