"""Cost of routes that may have to be flown, and the choice between two escape routes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from ..safety.check_inputs import WAY_MAX_AGE_S
from ..types import Mission

_CLEARLY_LESS = 0.9
"""Fraction of the other route's energy: above it, the better escape route does not change."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RouteCost:
    """Cost of a route. energy_wh: as the vehicle file has it.

    asked_s: time of its request; of several parts, the oldest. exposed_s: time until the last
    place is passed where a battery failsafe of the autopilot would hit something; 0: there is none.
    """

    duration_s: float
    energy_wh: float
    asked_s: float
    exposed_s: float = 0.0

    def then(self, other: RouteCost) -> RouteCost:
        """Returns the cost of both routes, one after the other."""
        return replace(
            self,
            duration_s=self.duration_s + other.duration_s,
            energy_wh=self.energy_wh + other.energy_wh,
            asked_s=min(self.asked_s, other.asked_s),
            exposed_s=self.duration_s + other.exposed_s if other.exposed_s else self.exposed_s,
        )

    def paced(self, pace: float) -> RouteCost:
        """Returns the cost at a fraction of the speeds; slower flight takes a hover's power."""
        return replace(
            self,
            duration_s=self.duration_s / pace,
            energy_wh=self.energy_wh / pace,
            exposed_s=self.exposed_s / pace,
        )


def better_of(ways: Mapping[Mission, RouteCost | None], before: Mission | None) -> Mission | None:
    """Returns the escape route that takes less; the one before, unless another takes clearly less.

    A route that was not found again for long, while another was, does not count.
    """
    known = {mission: way for mission, way in ways.items() if way is not None}
    if not known:
        return None
    since_s = max(way.asked_s for way in known.values()) - WAY_MAX_AGE_S
    energies_wh = {
        mission: way.energy_wh for mission, way in known.items() if way.asked_s >= since_s
    }
    least = min(energies_wh, key=lambda mission: energies_wh[mission])
    if before in energies_wh and energies_wh[least] > _CLEARLY_LESS * energies_wh[before]:
        return before
    return least


def energy_wh_of(way: RouteCost | None) -> float | None:
    """Energy of a route, if it is known."""
    return None if way is None else way.energy_wh
