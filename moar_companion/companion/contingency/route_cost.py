"""Cost of routes that may have to be flown, their duration in wind, and the better one. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ...planner.grid import FloatArray
from ...risk.braking import GRAVITY_MPS2
from ...risk.drag import Level, air_velocity_mps
from ...risk.power import Meter, PowerModel
from ...settings.vehicle import Vehicle
from ...status_values import RouteEntry
from ...types import Mission, Vector
from ..safety.check_inputs import ROUTE_MAX_AGE_S

_CLEARLY_LESS = 0.9
"""Fraction of the other route's energy: above it, the better escape route does not change."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RouteCost:
    """Cost of a route. energy_wh: as the vehicle file has it.

    asked_s: time of its request; of several parts, the oldest. exposed_s: time until the last place
    is passed from which a battery failsafe of the autopilot would hit an obstacle; 0: there is
    none.
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

    def outcome(self, meter: Meter, power: PowerModel, now_s: float) -> RouteEntry:
        """Returns its time and measured energy, the flight time left after it, and its age."""
        return RouteEntry(
            duration_s=self.duration_s,
            energy_wh=meter.factor * self.energy_wh,
            left_s=meter.left_after_s(power, self.energy_wh),
            age_s=now_s - self.asked_s,
        )


def better_of(routes: Mapping[Mission, RouteCost | None], before: Mission | None) -> Mission | None:
    """Returns the escape route of the least energy, or the present one if that needs little more.

    A route does not count if it was requested more than `ROUTE_MAX_AGE_S` before the newest one.
    """
    known = {mission: route for mission, route in routes.items() if route is not None}
    if not known:
        return None
    since_s = max(route.asked_s for route in known.values()) - ROUTE_MAX_AGE_S
    energies_wh = {
        mission: route.energy_wh for mission, route in known.items() if route.asked_s >= since_s
    }
    least = min(energies_wh, key=lambda mission: energies_wh[mission])
    if before in energies_wh and energies_wh[least] > _CLEARLY_LESS * energies_wh[before]:
        return before
    return least


def energy_wh_of(route: RouteCost | None) -> float | None:
    """Energy of a route, if it is known."""
    return None if route is None else route.energy_wh


def straight_s(here_m: Vector, there_m: Vector, power: PowerModel) -> float:
    """Duration of a straight flight from here to there at full speed."""
    x_m, y_m, up_m = (there - here for here, there in zip(here_m, there_m, strict=True))
    upward_mps = power.climb_mps if up_m > 0.0 else power.descent_mps
    return max(math.hypot(x_m, y_m) / power.cruise_mps, abs(up_m) / upward_mps)


def least_in_wind_s(steps_m: FloatArray, wind_mps: Level, vehicle: Vehicle) -> FloatArray:
    """Least durations (n,) of steps (n, 3), up last, in wind; at most those at v_MIN.

        |v - w| <= u,    (k + q u) u = g tan(limit)

    v, w: the aircraft's and the wind's velocity over ground, both level; u: the airspeed at which
    the drag equals the acceleration of the lean; k, q: of `risk.drag`; limit: the greatest lean,
    `RiskModel.tilt_rad.high`. wind_mps: towards which it blows, along the first two axes.
    """
    lean_mps2 = GRAVITY_MPS2 * math.tan(vehicle.risk.tilt_rad.high)
    u_mps, _ = air_velocity_mps((lean_mps2, 0.0), vehicle.risk)
    level_m = steps_m[:, :2]
    square, along = (level_m**2).sum(axis=1), level_m @ np.array(wind_mps)
    # The greatest of the rates 1 / t at which |step / t - w| = u, if there is one.
    root = along**2 + square * (u_mps**2 - math.hypot(*wind_mps) ** 2)
    rate = np.where(root >= 0.0, along + np.sqrt(np.abs(root)), 0.0)
    slowest_s = np.sqrt((steps_m**2).sum(axis=1)) / vehicle.speed.min_mps
    against_s: FloatArray = np.where(square > 0.0, slowest_s, 0.0)
    np.divide(square, rate, out=against_s, where=rate > 0.0)
    return np.asarray(np.minimum(against_s, slowest_s))
