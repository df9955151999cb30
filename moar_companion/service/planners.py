"""The planners of a site: one for keep-outs as they are, and some for obstacles that are wider.

For the planning worker alone: what differs is built here when it is first asked for. Wider ones
plan without tables: a width may be over before they are made, and a plan takes a millisecond.
"""

from __future__ import annotations

from ..planner.planner import Planner

_MOST = 4
"""Wider ones that are kept: what the position's uncertainty comes by within a flight."""
_MOST_CELLS = 1_000_000
"""Of these together, 0.2 kB each; of a greater site one is kept."""


class Planners:
    """Not safe for use by two threads at once."""

    def __init__(self, planner: Planner) -> None:
        """planner: the one for keep-outs as they are."""
        self.exact = planner
        self._most = max(1, min(_MOST, _MOST_CELLS // planner.maps.occupied.size))
        self._wider: dict[float, Planner] = {}

    def widened_by(self, width_m: float) -> Planner:
        """The planner whose occupied distance is wider by so much, built once while it is used."""
        if not width_m:
            return self.exact
        planner = self._wider.pop(width_m, None)
        if planner is None:
            while len(self._wider) >= self._most:
                del self._wider[next(iter(self._wider))]
            site, vehicle = self.exact.site, self.exact.vehicle
            planner = Planner(site, vehicle, position_uncertainty_m=width_m, clock=self.exact.clock)
        self._wider[width_m] = planner
        return planner
