"""Failsafe actions of an autopilot, as values: triggers, actions, settings. Pure.

The file of each autopilot reads them from its parameters; `safety/failsafe_paths` has the paths
that they fly.
"""

from __future__ import annotations

import enum
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Protocol

from ...types import Vector


class Trigger(enum.Enum):
    """Event that triggers a failsafe of the autopilot; the value is a text for operators."""

    LOW_BATTERY = "low battery"
    CRITICAL_BATTERY = "critical battery"
    EMERGENCY_BATTERY = "emergency battery"
    RC_LOSS = "RC loss"
    GCS_LOSS = "GCS loss"
    GPS_LOSS = "GPS loss"
    COMPANION_LOSS = "companion loss"

    @property
    def noun(self) -> str:
        """The event in a text for pilots, which has little room."""
        return "battery" if self in BATTERY else self.value


BATTERY = frozenset({Trigger.LOW_BATTERY, Trigger.CRITICAL_BATTERY, Trigger.EMERGENCY_BATTERY})
LINKS = frozenset({Trigger.RC_LOSS, Trigger.GCS_LOSS})
UNFORESEEN = LINKS | {Trigger.GPS_LOSS}
"""Triggers that nothing announces; the loss of the companion has a setting of its own."""


class AutopilotAction(enum.Enum):
    """Action of the autopilot; the value completes "it would"."""

    NONE = "go on"
    HOLD = "hold"
    LAND = "land"
    RETURN = "return"
    DESCEND = "descend without a position"
    DRIFT = "hold its height without a position"
    FALL = "stop its motors"

    @property
    def noun(self) -> str:
        """The action in a text for pilots."""
        return _NOUNS.get(self, self.value)


_NOUNS = {
    AutopilotAction.LAND: "landing",
    AutopilotAction.DESCEND: "descent",
    AutopilotAction.DRIFT: "drift",
    AutopilotAction.FALL: "motor stop",
}


class ReturnHeight(Protocol):
    """Height above home at which an autopilot returns."""

    def height_m(self, height_m: float, distance_m: float) -> float:
        """Height of the return, from a height above home and a level distance to it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FailsafeAction:
    """One trigger and its action.

    setting: the deciding parameter with its value, as a text. remedy: parameter to set; empty if no
    parameter prevents the action. charge, voltage_v: thresholds of a battery; None without one.
    home: heights of a return; None for a return to another place. drift_m: measured drift to the
    side, for the preflight check only. Beside a power line every place has an obstacle within the
    drift, so that it does not distinguish paths.
    """

    trigger: Trigger
    action: AutopilotAction
    setting: str
    remedy: str = ""
    charge: float | None = None
    voltage_v: float | None = None
    home: ReturnHeight | None = None
    drift_m: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Failsafes:
    """All failsafe actions that an autopilot has enabled.

    home_m: its home in the site's frame; None if unknown.
    """

    actions: tuple[FailsafeAction, ...] = ()
    home_m: Vector | None = None

    def of(self, triggers: Iterable[Trigger]) -> Failsafes:
        """Failsafes of some triggers."""
        wanted = frozenset(triggers)
        kept = tuple(item for item in self.actions if item.trigger in wanted)
        return replace(self, actions=kept)


NO_FAILSAFES = Failsafes()
