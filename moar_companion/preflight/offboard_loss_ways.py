"""Check of a companion failure on every route of the site. Pure.

The texts are those with which the service refuses such a flight, or warns of it.
"""

from __future__ import annotations

from ..config import LossCheck
from ..planner.planner import Planner
from ..safety.offboard_loss import OffboardLoss
from ..types import Mission, Vector
from .findings import Finding, Level
from .site_routes import ways_of

SUBJECT = "companion failure"


def objection_level(policy: LossCheck, mission: Mission = Mission.INSPECTION) -> Level:
    """Level of an objection to a mission: the service never refuses an escape route."""
    refused = policy is LossCheck.REFUSE and mission is Mission.INSPECTION
    return Level.NO_GO if refused else Level.WARNING


def loss_findings(
    planner: Planner, loss: OffboardLoss, home_m: Vector | None, policy: LossCheck
) -> list[Finding]:
    """Returns a finding for each collision, or one if there is none. home_m: site's frame."""
    objections: dict[tuple[Level, str], list[str]] = {}
    all_ways = ways_of(planner)
    for target, ways in all_ways.items():
        for way in ways:
            objection = way.objection(planner, loss, home_m)
            if objection is None:
                continue
            inspects = way.mission is Mission.INSPECTION
            name = f"to {target}" if inspects else f"{way.name} from {target}"
            level = objection_level(policy, way.mission)
            objections.setdefault((level, objection), []).append(name)
    found = [
        Finding(level=level, subject=SUBJECT, text=f"{objection} ({', '.join(names)})")
        for (level, objection), names in objections.items()
    ]
    if all_ways and not found:
        text = f"the autopilot would {loss.action.value}, and hit nothing on any way of this site"
        found = [Finding(level=Level.OK, subject=SUBJECT, text=text)]
    if loss.assumption is not None:
        found.append(Finding(level=Level.WARNING, subject=SUBJECT, text=loss.assumption))
    return found
