"""Collisions of the autopilot's own failsafes on any route of the site, and remedies. Pure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..autopilots.failsafe_actions import BATTERY, LINKS, Action, FailsafeAction, Failsafes, Trigger
from ..config import LossCheck, Supervision
from ..planner.plan_values import PlanStatus
from ..planner.planner import Planner
from ..power import PowerModel
from ..safety.failsafe_exposure import moving
from .findings import Finding, Level
from .site_routes import SiteRoute, ways_of

SUBJECT = "failsafe"


def failsafe_findings(
    planner: Planner, failsafes: Failsafes, limits: Supervision, power: PowerModel
) -> list[Finding]:
    """Returns a finding for each trigger whose action would hit something, or one if none would.

    `dead_companion` judges the loss of the companion.
    """
    ways = [
        (target, way)
        for target, of_target in ways_of(planner).items()
        for way in of_target
        if way.plan.status is PlanStatus.FOUND
    ]
    found = [
        Finding(
            level=_level(item, limits),
            subject=SUBJECT,
            text=f"{item.trigger.value}, {item.setting} ({item.action.value}): {words}"
            f"{_protection(item, limits, power)}",
            remedy=f"set {item.remedy}" if item.remedy else "",
        )
        for item in moving(failsafes, LINKS).actions
        if item.trigger is not Trigger.COMPANION_LOSS
        and (words := _hits(planner, replace(failsafes, actions=(item,)), ways))
    ]
    if ways and not found:
        text = "no action of the autopilot's own would hit anything on any way of this site"
        found = [Finding(level=Level.OK, subject=SUBJECT, text=text)]
    returns = any(item.action is Action.RETURN for item in failsafes.actions)
    if returns and failsafes.home_m is None:
        text = "home is unknown: returns were looked at as far as they climb"
        found.append(Finding(level=Level.WARNING, subject=SUBJECT, text=text))
    if failsafes.untold:
        text = f"not told, taken as by default: {', '.join(failsafes.untold)}"
        found.append(Finding(level=Level.WARNING, subject=SUBJECT, text=text))
    return found


def _level(item: FailsafeAction, limits: Supervision) -> Level:
    """No-go if nothing protects, or as configured; a note if no parameter helps."""
    if item.action is Action.FALL:
        return Level.NO_GO
    if item.trigger in LINKS and limits.failsafe_action is LossCheck.REFUSE:
        return Level.NO_GO
    if item.trigger is Trigger.GPS_LOSS and not item.remedy:
        return Level.NOTE
    return Level.WARNING


def _protection(item: FailsafeAction, limits: Supervision, power: PowerModel) -> str:
    """Text about the protection from a battery's action."""
    if item.trigger not in BATTERY or item.action is Action.FALL:
        return ""
    if item.voltage_v is not None and power.cells is None:
        return "; when, nobody can forecast without risk.cells of the vehicle file"
    return f"; the companion leaves {limits.exposure_reserve_s:g} s before"


def _hits(planner: Planner, failsafe: Failsafes, ways: list[tuple[str, SiteRoute]]) -> str:
    """Text about the collisions on each route; empty if there are none."""
    reach, found = planner.maps.reach, []
    for target, way in ways:
        waypoints = way.plan.waypoints
        places_m, time_s = waypoints.position_m, waypoints.time_s
        hit = failsafe.hit(reach, places_m, drifting=True)
        if hit is None:
            continue
        exposed = failsafe.exposed(reach, places_m, drifting=True)
        from_share = float(time_s[np.argmax(exposed)]) / max(1e-9, float(time_s[-1]))
        name = f"to {target}" if way.name.startswith("from ") else f"{way.name} from {target}"
        found.append(f"{hit[1].obstacle} from {from_share:.0%} of the plan {name}")
    drift_m = max(item.drift_m for item in failsafe.actions)
    drifting = f"drifting up to {drift_m:g} m " if drift_m else ""
    return f"{drifting}it would hit {', '.join(found)}" if found else ""
