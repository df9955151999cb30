"""Answers of the planner to JSON and back.

An answer is kept with its path, and a replay does not plan again. Which of two equal paths the
planner returns depends on the tables at that moment, and the times depend on the computer. Data
that follow from site, vehicle and job are computed again: maps, graph, reach and landing leg.
"""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

from ...companion.planning.plan_jobs import PlanAnswer, PlanJob
from ...companion.planning.planner_set import PlannerSet
from ...planner.plan_values import Compute, Cost, Plan, PlanRequest
from ...planner.planner import Planner
from .value_codec import decoded, encoded

_PLAIN = tuple(item.name for item in fields(PlanAnswer) if item.name not in {"plan", "reach"})


def answer_encoded(answer: PlanAnswer) -> dict[str, Any]:
    """The answer in a form for JSON."""
    plan = answer.plan
    data = {name: encoded(getattr(answer, name)) for name in _PLAIN}
    data["reach"] = answer.reach is not None
    data["plan"] = None
    if plan is not None:
        data["plan"] = {
            "request": encoded(plan.request),
            "states": encoded(plan.states),
            "cost": encoded(plan.cost),
            "compute": encoded(plan.compute),
        }
    return data


def answer_decoded(planners: PlannerSet, job: PlanJob, data: dict[str, Any]) -> PlanAnswer:
    """The answer to a job, on the maps that the planner had then.

    Older recordings have no stops.
    """
    plan, reach = data["plan"], None
    values = {name: data[name] for name in _PLAIN if name in data}
    values["escape_m"] = tuple((x_m, z_m) for x_m, z_m in data["escape_m"])
    values["stops"] = tuple(data.get("stops", ()))
    found = None
    if plan is not None:
        planners.expose(job.failsafes)
        planner = planners.widened_by(job.widening_m - data["narrowed_m"], job.fence)
        found = _plan(planner, plan)
        reach = planner.maps.reach if data["reach"] else None
    return PlanAnswer(plan=found, reach=reach, **values)


def _plan(planner: Planner, data: dict[str, Any]) -> Plan:
    states = np.array(data["states"], dtype=np.int64)
    states.flags.writeable = False
    return planner.found(
        decoded(PlanRequest, data["request"]),
        states,
        decoded(Cost, data["cost"]),
        decoded(Compute, data["compute"]),
    )
