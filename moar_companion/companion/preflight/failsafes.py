"""Collisions of the autopilot's failsafes, and after a companion failure, on any route. Pure.

The texts on a companion failure are those of the service when it refuses such a flight, or warns.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...mavlink.autopilots.failsafe_actions import (
    BATTERY,
    LINKS,
    UNFORESEEN,
    AutopilotAction,
    FailsafeAction,
    Failsafes,
    Trigger,
)
from ...mavlink.autopilots.offboard_loss import OffboardLoss
from ...planner.plan_values import PlanStatus
from ...planner.planner import Planner
from ...risk.power import PowerModel
from ...settings.config import LossCheck, Supervision
from ...types import Mission, Vector
from ..safety.failsafe_exposure import moving
from ..safety.failsafe_paths import exposed_places, failsafe_hit
from ..safety.refuges import blind_leg_m, unprotected
from .findings import Finding, Level
from .site_routes import SiteRoute, routes_of

SUBJECT = "failsafe"
LOSS_SUBJECT = "companion failure"


def failsafe_findings(
    planner: Planner, failsafes: Failsafes, limits: Supervision, power: PowerModel
) -> list[Finding]:
    """Returns a finding for each trigger with an unsafe action, or one finding if all are safe.

    Unsafe: the action would hit an obstacle. `loss_findings` judges the loss of the companion.
    """
    routes = [
        (target, route)
        for target, of_target in routes_of(planner).items()
        for route in of_target
        if route.plan.status is PlanStatus.FOUND
    ]
    found = []
    for item in moving(failsafes, LINKS).actions:
        alone = replace(failsafes, actions=(item,))
        words = _hits(planner, alone, routes)
        if item.trigger is Trigger.COMPANION_LOSS or not words:
            continue
        blind = item.trigger is Trigger.GPS_LOSS
        closing = _unprotected(planner, alone, routes) if blind else ""
        leg_m = blind_leg_m(planner.vehicle)
        protection = _leaving(closing, leg_m) if blind else _protection(item, limits, power)
        found.append(
            Finding(
                level=_level(item, limits, unprotected=bool(closing) or not blind),
                subject=SUBJECT,
                text=f"{item.trigger.value}, {item.setting} ({item.action.value}): {words}"
                f"{protection}",
                remedy=f"set {item.remedy}" if item.remedy else "",
                closing=closing,
            )
        )
    if routes and not found:
        text = "no failsafe action of the autopilot would hit an obstacle on any route of this site"
        found = [Finding(level=Level.OK, subject=SUBJECT, text=text)]
    returns = any(item.action is AutopilotAction.RETURN for item in failsafes.actions)
    if returns and failsafes.home_m is None:
        text = "home is unknown: of returns only the climb was checked"
        found.append(Finding(level=Level.WARNING, subject=SUBJECT, text=text))
    return found


def _level(item: FailsafeAction, limits: Supervision, *, unprotected: bool) -> Level:
    """No-go without any protection, or as configured."""
    if item.action is AutopilotAction.FALL:
        return Level.NO_GO
    refused = limits.failsafe_action is LossCheck.REFUSE and unprotected
    return Level.NO_GO if refused and item.trigger in UNFORESEEN else Level.WARNING


def _leaving(closing: str, longest_m: float) -> str:
    """Text about the leg at the loss of the fix. closing: about places where it does not help."""
    reach = (
        f"by {longest_m:.1f} m before the landing" if longest_m >= 0.1 else "late from full speed"
    )
    words = f"; the companion leaves at the loss of the fix, {reach}"
    return f"{words}: not enough everywhere" if closing else words


def _protection(item: FailsafeAction, limits: Supervision, power: PowerModel) -> str:
    """Text about the protection from a battery's action."""
    if item.trigger not in BATTERY or item.action is AutopilotAction.FALL:
        return ""
    if item.voltage_v is not None and power.cells is None:
        return "; its time cannot be forecast without risk.cells of the vehicle file"
    return (
        f"; the companion flies the exit {limits.exposure_reserve_s:g} s before, or to the nearest "
        "place clear of it; not where the charge falls below the threshold at once"
    )


def _unprotected(planner: Planner, failsafe: Failsafes, routes: list[tuple[str, SiteRoute]]) -> str:
    """Text about a landing without a position that no leg at the loss of the fix prevents."""
    for target, route in routes:
        places_m = route.plan.waypoints.position_m
        lost = unprotected(failsafe, planner.site, planner.vehicle, planner.maps, places_m)
        hit = failsafe_hit(failsafe, planner.maps.reach, places_m[lost], drifting=True)
        if hit is not None:
            name = _route_name(target, route)
            return f"where GPS is lost ({name}) the autopilot may hit {hit[1].obstacle}"
    return ""


def _route_name(target: str, route: SiteRoute) -> str:
    return f"to {target}" if route.name.startswith("from ") else f"{route.name} from {target}"


def _hits(planner: Planner, failsafe: Failsafes, routes: list[tuple[str, SiteRoute]]) -> str:
    """Text about the collisions on each route; empty if there are none."""
    reach, found = planner.maps.reach, []
    for target, route in routes:
        waypoints = route.plan.waypoints
        places_m, time_s = waypoints.position_m, waypoints.time_s
        hit = failsafe_hit(failsafe, reach, places_m, drifting=True)
        if hit is None:
            continue
        exposed = exposed_places(failsafe, reach, places_m, drifting=True)
        from_share = float(time_s[np.argmax(exposed)]) / max(1e-9, float(time_s[-1]))
        name = _route_name(target, route)
        found.append(f"{hit[1].obstacle} from {from_share:.0%} of the plan {name}")
    drift_m = max(item.drift_m for item in failsafe.actions)
    drifting = f"drifting up to {drift_m:g} m " if drift_m else ""
    return f"{drifting}it would hit {', '.join(found)}" if found else ""


def objection_level(policy: LossCheck, mission: Mission = Mission.INSPECTION) -> Level:
    """Level of an objection to a mission: the service never refuses an escape route."""
    refused = policy is LossCheck.REFUSE and mission.visits_targets
    return Level.NO_GO if refused else Level.WARNING


def loss_findings(
    planner: Planner, loss: OffboardLoss, home_m: Vector | None, policy: LossCheck
) -> list[Finding]:
    """Returns a finding for each collision, or one if there is none. home_m: site's frame."""
    objections: dict[tuple[Level, str], list[str]] = {}
    routes_by_target = routes_of(planner)
    for target, routes in routes_by_target.items():
        for route in routes:
            objection = route.objection(planner, loss, home_m)
            if objection is None:
                continue
            inspects = route.mission.visits_targets
            name = f"to {target}" if inspects else f"{route.name} from {target}"
            level = objection_level(policy, route.mission)
            objections.setdefault((level, objection), []).append(name)
    found = [
        Finding(level=level, subject=LOSS_SUBJECT, text=f"{objection} ({', '.join(names)})")
        for (level, objection), names in objections.items()
    ]
    if routes_by_target and not found:
        text = f"the autopilot would {loss.action.value}, no collision on any route of this site"
        found = [Finding(level=Level.OK, subject=LOSS_SUBJECT, text=text)]
    return found
