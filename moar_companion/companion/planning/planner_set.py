"""Planners of a site: one for keep-outs as they are, others for changes in flight.

Changes are wider obstacles or a fence of the autopilot. Only the planning worker uses this set. A
changed planner is built at its first request. It has no tables: an inflation may end before they
are complete, and a plan takes a millisecond.
"""

from __future__ import annotations

import numpy as np

from ...mavlink.autopilots.failsafe_actions import NO_FAILSAFES, Failsafes
from ...planner.grid import BoolArray
from ...planner.maps import Maps
from ...planner.plane_fence import PlaneFence
from ...planner.planner import Planner
from ...planner.site import Site
from ...settings.vehicle import Vehicle
from ..safety.failsafe_paths import exposed_places

_MOST = 4
"""Changed planners kept: enough for the position's uncertainties within a flight."""
_MOST_CELLS = 1_000_000
"""Limit on the total cells of these, 0.2 kB each; of a greater site one planner is kept."""


class PlannerSet:
    """Planners by inflation and fence. Not safe for use by two threads at once."""

    def __init__(self, planner: Planner) -> None:
        """planner: the one for keep-outs as they are."""
        self.exact = planner
        self._most = max(1, min(_MOST, _MOST_CELLS // planner.maps.occupied.size))
        self._others: dict[tuple[float, PlaneFence | None], Planner] = {}
        self._failsafes = NO_FAILSAFES

    def expose(self, failsafes: Failsafes) -> None:
        """Sets the failsafes of the autopilot; a change of these changes the maps."""
        if failsafes == self._failsafes:
            return
        _mark(self.exact, failsafes)
        self._failsafes = failsafes
        self._others.clear()

    def set_site(self, site: Site, vehicle: Vehicle | None = None) -> None:
        """Sets the same site with other obstacles, targets or margin, in all planners.

        vehicle: another one; None: the present one.
        """
        if vehicle is None:
            self.exact.set_site(site)
        else:
            self.exact.set_vehicle(vehicle, site)
        self._others.clear()
        if self._failsafes.actions:
            _mark(self.exact, self._failsafes)

    def widened_by(self, width_m: float, fence: PlaneFence | None = None) -> Planner:
        """Returns the planner whose occupied distance is wider by `width_m`, cached while in use.

        fence: limits the site; nothing is planned outside.
        """
        if not width_m and fence is None:
            return self.exact
        planner = self._others.pop((width_m, fence), None)
        if planner is None:
            while len(self._others) >= self._most:
                del self._others[next(iter(self._others))]
            site, vehicle = self.exact.site, self.exact.vehicle
            planner = Planner(
                site,
                vehicle,
                position_uncertainty_m=width_m,
                fence=fence,
                clock=self.exact.clock,
            )
            if self._failsafes.actions:
                _mark(planner, self._failsafes)
        self._others[width_m, fence] = planner
        return planner


def _mark(planner: Planner, failsafes: Failsafes) -> None:
    planner.set_exposed(exposed_cells(planner.maps, failsafes))


def exposed_cells(maps: Maps, failsafes: Failsafes) -> BoolArray:
    """Free cells from which a failsafe would hit an obstacle: (nx, nz)."""
    exposed = np.zeros(maps.grid.shape, dtype=np.bool_)
    free = np.argwhere(~maps.occupied)
    centres_m = np.array(maps.grid.lower_m) + maps.grid.resolution_m * (free + 0.5)
    exposed[tuple(free.T)] = exposed_places(failsafes, maps.reach, centres_m)
    return exposed
