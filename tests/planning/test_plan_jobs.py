"""Precomputation of tables for plans, and its order."""

from __future__ import annotations

from dataclasses import replace
from unittest import mock

import pytest

from moar_companion.companion.planning.plan_jobs import (
    PlanJob,
    answer_job,
    preparations,
    prepare_for,
)
from moar_companion.companion.planning.planner_set import PlannerSet
from moar_companion.mavlink.autopilots.failsafe_actions import (
    NO_FAILSAFES,
    AutopilotAction,
    FailsafeAction,
    Failsafes,
    Trigger,
)
from moar_companion.planner import planner as planner_module
from moar_companion.planner.adaptation import Adaptation
from moar_companion.planner.plan_values import PlanRequest
from moar_companion.planner.planner import Planner
from moar_companion.planner.site import Site
from moar_companion.service import planner_worker
from moar_companion.service.planner_worker import PlannerWorker
from moar_companion.settings.config import shipped_configs
from moar_companion.settings.vehicle import AdaptationKind, Vehicle
from moar_companion.types import Mission, RiskIndices, Weights


@pytest.fixture
def planner(monkeypatch):
    """A planner with memory for the tables of three goals of four, 8 corners each."""
    configs = shipped_configs()
    planner = Planner(
        Site.load(configs / "sites" / "315kv_double_circuit.yaml"),
        Vehicle.load(configs / "vehicles" / "linedrone.yaml"),
    )
    one_corner = len(planner.graph.allowed) * 8 * 9
    monkeypatch.setattr(planner_module, "_TABLES_BYTES", 3 * 8 * one_corner)
    return planner


def goals(planner):
    return [(mission.value, target) for mission, target in planner._tables]


def job(target, **changes):
    request = PlanRequest(
        mission=Mission.INSPECTION,
        target=target,
        start_m=(27.0, 2.6),
        velocity_mps=(0.0, 0.0),
        weights=Weights(0.4, 0.3, 0.3),
        risk=RiskIndices(),
    )
    return PlanJob(job_id=1, request=request, **changes)


def test_tables_of_the_first_target_and_the_escape_routes_are_prepared_first(planner):
    first, second = (target.name for target in planner.site.targets)
    for prepare in preparations(planner):
        prepare()
    assert goals(planner) == [("inspection", first), ("exit", None), ("evacuation", None)]
    # A flight to the second target, then to the first again: its table is made again.
    planners = PlannerSet(planner)
    for target in (second, first):
        prepare_for(planners, job(target))
        prepare_for(planners, job(target))
        assert goals(planner)[-1] == ("inspection", target)
    assert len(planner._tables) == 3


def test_weights_are_calibrated_from_the_start_of_the_task_once_the_table_is_complete(planner):
    planners, name = PlannerSet(planner), planner.site.targets[-1].name
    rule = Adaptation(base=Weights(0.2, 0.6, 0.2), kind=AdaptationKind.CALIBRATED)
    first = job(name, origin_m=(27.0, 2.6))
    risky = replace(first.request, risk=RiskIndices(wind=0.6, localization=0.4)).adapted(rule)
    first = replace(first, request=risky)
    assert answer_job(planners, first).plan.request.adaptation.calibration is None
    prepare_for(planners, first)
    whole = answer_job(planners, first).plan
    assert whole.request.adaptation.calibration is not None
    # From halfway, with another front, the same risks give the same weights.
    half = replace(risky, start_m=tuple(whole.waypoints.position_m[len(whole.states) // 2]))
    rest = answer_job(planners, replace(first, request=half)).plan
    assert rest.weights == whole.weights != risky.weights
    assert rest.cost.total < whole.cost.total


def test_no_table_is_prepared_for_inflated_obstacles_or_an_unknown_target(planner):
    prepare_for(PlannerSet(planner), job("splice-9"))
    prepare_for(PlannerSet(planner), job(planner.site.targets[0].name, widening_m=0.3))
    assert not planner._tables


def test_the_worker_keeps_the_table_of_the_flown_goal(planner):
    worker = PlannerWorker()
    worker.take(planner)
    target = planner.site.targets[1].name
    worker.plan(job(target))
    worker.close(wait=True)
    assert goals(planner)[-1] == ("inspection", target)


def no_memory(*_, **__):
    raise MemoryError("Unable to allocate 27.1 MiB")


def test_a_plan_without_memory_is_a_failed_answer_and_the_next_one_succeeds(planner, monkeypatch):
    worker = PlannerWorker()
    worker.take(planner)
    target = planner.site.targets[0].name
    with monkeypatch.context() as lack:
        lack.setattr(planner_worker, "answer_job", no_memory)
        worker.plan(job(target))
        worker._planning_thread.submit(int).result()
    worker.plan(job(target))
    worker.close(wait=True)
    failed, found = (answer for _, answer in worker.answers())
    assert (failed.failed, failed.plan, failed.reason) == (True, None, "the planner failed")
    assert found.plan is not None


def test_missing_memory_for_tables_is_logged_once_and_planning_continues(
    planner, monkeypatch, caplog
):
    monkeypatch.setattr(Planner, "prepare", no_memory)
    worker = PlannerWorker()
    worker.take(planner)
    for _ in range(3):
        worker.plan(job(planner.site.targets[0].name))
        worker._planning_thread.submit(int).result()
    worker.close(wait=True)
    assert [answer.plan is None for _, answer in worker.answers()] == [False] * 3
    assert [record.getMessage() for record in caplog.records if record.levelname == "WARNING"] == [
        "plans without tables: MemoryError: Unable to allocate 27.1 MiB"
    ]


def test_changed_failsafes_are_marked_once_and_the_tables_are_rebuilt(planner):
    lands = FailsafeAction(trigger=Trigger.GCS_LOSS, action=AutopilotAction.LAND, setting="")
    failsafes, target = Failsafes(actions=(lands,)), planner.site.targets[0].name
    worker = PlannerWorker()
    worker.take(planner)
    with (
        mock.patch.object(PlannerSet, "expose", autospec=True) as expose,
        mock.patch.object(worker, "_prepare") as prepare,
    ):
        worker.plan_contingency(job(target, failsafes=NO_FAILSAFES))
        worker._planning_thread.submit(int).result()
        assert prepare.call_count == 0, "tables are made behind the first plan that is flown"
        worker.plan(job(target, failsafes=NO_FAILSAFES))
        worker._planning_thread.submit(int).result()
        assert prepare.call_count == 1
        for _ in range(2):
            worker.plan_contingency(job(target, failsafes=failsafes))
        worker.close(wait=True)
    assert [call.args[1] for call in expose.call_args_list][2:] == [failsafes, failsafes]
    assert prepare.call_count == 2
