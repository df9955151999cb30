"""Energy of a tour from a full battery: its legs, its stops, its way out, and the stops that fit.

Pure. As in flight (`contingency.contingency_planner`): the charge at the last stop is above that at
which the exit begins, and the way out leaves the reserve of the vehicle file.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ...mavlink.autopilots import PROFILES
from ...planner.plan_values import Plan
from ...planner.planner import Planner
from ...planner.tour import exit_request
from ...risk.power import PowerModel
from ...risk.power.model import S_PER_H
from .site_routes import SiteRoute


@dataclass(frozen=True, slots=True, kw_only=True)
class TourEnergy:
    """Times and energy of a whole tour, and the number of its stops that fit into a full battery.

    flown_s: without the stays. energy_wh: with these and the landing. left_s: flight time after it.
    """

    flown_s: float
    held_s: float
    energy_wh: float
    capacity_wh: float
    left_s: float
    reserve_s: float
    fitting: int


def tour_energy(planner: Planner, plans: Sequence[Plan], charge_reserve: float) -> TourEnergy:
    """The energy of a tour. plans: of its legs, all with a path; the exit last, if there is one.

    charge_reserve: fraction of the charge at which the exit begins.
    """
    power = PowerModel.of(planner.vehicle)
    visits = [plan for plan in plans if plan.mission.visits_targets]
    holds_s = [planner.site.target(str(plan.request.target)).hold_s for plan in visits]
    used_wh: list[float] = []
    for plan, hold_s in zip(visits, holds_s, strict=True):
        before_wh = used_wh[-1] if used_wh else 0.0
        used_wh.append(before_wh + _energy_wh(planner, plan, power) + power.hover_wh(hold_s))
    out = plans[-1] if len(plans) > len(visits) else None
    total_wh = used_wh[-1] + _out_wh(planner, out, power)

    def fits(visits_wh: float, whole_wh: float) -> bool:
        spare_wh = (1.0 - charge_reserve) * power.capacity_wh - visits_wh
        return spare_wh > 0.0 and _left_s(power, whole_wh) > power.reserve_s

    fitting = len(visits)
    if not fits(used_wh[-1], total_wh):
        fitting -= 1
    while 0 < fitting < len(visits):
        last = visits[fitting].request
        from_last = None if out is None else planner.solve(exit_request(planner, last))
        if fits(used_wh[fitting - 1], used_wh[fitting - 1] + _out_wh(planner, from_last, power)):
            break
        fitting -= 1
    return TourEnergy(
        flown_s=sum(_route(plan).flown_s(planner) for plan in plans),
        held_s=sum(holds_s),
        energy_wh=total_wh,
        capacity_wh=power.capacity_wh,
        left_s=_left_s(power, total_wh),
        reserve_s=power.reserve_s,
        fitting=fitting,
    )


def _route(plan: Plan) -> SiteRoute:
    x_m, z_m = plan.request.start_m
    return SiteRoute(name="", mission=plan.mission, start_m=(x_m, z_m), plan=plan)


def _energy_wh(planner: Planner, plan: Plan, power: PowerModel) -> float:
    return _route(plan).energy_wh(planner, power)


def _out_wh(planner: Planner, plan: Plan | None, power: PowerModel) -> float:
    """Energy of the way out and of the landing behind it."""
    height_m, kind = planner.vehicle.guidance.landing_height_m, planner.vehicle.autopilot
    kinds = PROFILES if kind is None else (kind,)
    landing_wh = max(power.landing_wh(height_m, each) for each in kinds)
    return landing_wh + (0.0 if plan is None else _energy_wh(planner, plan, power))


def _left_s(power: PowerModel, used_wh: float) -> float:
    return (power.capacity_wh - used_wh) / power.hover_w * S_PER_H
