"""Restart of the service in flight: it reports the earlier mission and waits for an order."""

from __future__ import annotations

import pytest

from moar_companion.companion.mission.state_machine import MissionState, Task
from moar_companion.companion.mission_snapshot import MissionSnapshot
from moar_companion.companion.planning.site_maps import SiteMaps
from moar_companion.planner.site import Site
from moar_companion.settings.config import Authority, shipped_configs
from moar_companion.types import Mission

from .desk import (
    ACCEPTED,
    DENIED,
    EXIT,
    INSPECTION,
    PAUSE_CONTINUE,
    RELEASE,
    TEMPORARILY_REJECTED,
    Desk,
)
from .scripted_autopilot import AUTO_HOLD, OFFBOARD

SITE = Site.load(shipped_configs() / "sites" / "315kv_double_circuit.yaml")
STARTED_S = 50.0
REST = Task(mission=Mission.INSPECTION, stops=("splice-inner",))
GIVEN = "MOAR: restarted, was flying inspection"


def desk_after(state=MissionState.FLYING, task=REST, mode=OFFBOARD, **config):
    """A new process after one that ended twelve seconds after its state began."""
    before = MissionSnapshot(state=state, since_s=STARTED_S - 12.0, task=task, site=SITE.name)
    desk = Desk(before=before, **config)
    assert desk.now_s == STARTED_S
    desk.mode = mode
    return desk


@pytest.mark.parametrize("resume", [False, True])
def test_after_a_crash_nothing_is_streamed_though_the_mode_is_still_on(resume):
    desk = desk_after(resume=resume).run(10.0)
    assert (desk.state, desk.setpoints(), desk.mode_requests()) == ("idle", [], [])
    assert desk.texts() == [
        GIVEN,
        "MOAR: order continue to fly the rest",
        "MOAR: OFFBOARD is on, waiting for an order",
    ]


@pytest.mark.slow
def test_continue_flies_the_remaining_mission_as_an_order():
    desk = desk_after(mode=AUTO_HOLD).run(1.2).go_on().run_until("ready")
    assert desk.answers(PAUSE_CONTINUE) == [ACCEPTED]
    assert desk.companion.status.task == REST
    desk.run(1.1).send_heartbeat(OFFBOARD).run_until("flying", 0.1).run_until("at_target", 120.0)


def test_under_observe_nothing_is_continued_either():
    desk = desk_after(mode=AUTO_HOLD, authority=Authority.OBSERVE).run(1.2).go_on().run(1.0)
    assert (desk.state, desk.answers(PAUSE_CONTINUE), desk.setpoints()) == ("idle", [DENIED], [])
    assert desk.said("MOAR: the authority is observe, denied")
    assert not desk.said("continue to fly the rest")


@pytest.mark.parametrize(
    ("case", "state", "task"),
    [
        ("overridden by the pilot", MissionState.OVERRIDDEN, REST),
        ("released", MissionState.RELEASED, None),
        ("every target done", MissionState.HOLDING, Task(mission=Mission.INSPECTION)),
    ],
)
def test_a_state_without_a_flight_is_reported_and_not_continued(case, state, task):
    desk = desk_after(state, task, AUTO_HOLD).run(1.2).go_on().run(0.2)
    assert desk.answers(PAUSE_CONTINUE) == [TEMPORARILY_REJECTED]
    assert desk.said(f"MOAR: restarted, was {state.words}")
    assert not desk.said("continue to fly the rest")


def test_a_new_order_is_flown_and_discards_the_remaining_mission():
    desk = desk_after(mode=AUTO_HOLD).run(1.2).order(EXIT).run_until("ready")
    assert desk.companion.status.task.mission is Mission.EXIT
    desk.order(RELEASE).run(0.6).go_on().run(0.2)
    assert desk.answers(PAUSE_CONTINUE) == [TEMPORARILY_REJECTED]


def test_a_release_discards_the_remaining_mission():
    desk = desk_after(mode=AUTO_HOLD).run(1.2).order(RELEASE).run(0.6).go_on().run(0.2)
    assert desk.answers(PAUSE_CONTINUE) == [TEMPORARILY_REJECTED]


@pytest.mark.parametrize("compiling", ["", "compiling planner: 3 of 11"])
def test_a_release_before_the_planner_is_ready_discards_the_remaining_mission(compiling):
    desk = desk_after(mode=AUTO_HOLD, with_site=False)
    desk.companion.await_planner(compiling)
    desk.run(1.2).order(RELEASE).run(0.6)
    assert desk.answers() == [ACCEPTED]
    assert desk.companion.memory.task is None  # not continued after another crash
    desk.companion.take_ground(SiteMaps(site=desk.site, maps=desk.planner.maps))
    desk.run(1.2).go_on().run(0.2)
    assert desk.answers(PAUSE_CONTINUE) == [TEMPORARILY_REJECTED]
    assert desk.said("MOAR: restarted, was flying")
    assert not desk.said("continue to fly the rest")


def test_a_pause_before_the_planner_is_ready_keeps_the_remaining_mission():
    desk = desk_after(mode=AUTO_HOLD, with_site=False)
    desk.companion.await_planner()
    desk.run(1.2).pause().run(0.6)
    desk.companion.take_ground(SiteMaps(site=desk.site, maps=desk.planner.maps))
    desk.run(1.2).go_on().run_until("ready")
    assert desk.companion.status.task == REST


def test_accuracies_received_before_the_planner_is_ready_are_no_news_after_it():
    desk = Desk(with_site=False).set(accuracy_m=0.5)
    desk.companion.await_planner()
    desk.run(1.2)
    before = desk.companion.state.risk_monitor.accuracies
    assert before
    desk.companion.take_ground(SiteMaps(site=desk.site, maps=desk.planner.maps))
    assert desk.companion.state.risk_monitor.accuracies == before


def test_an_aircraft_on_the_ground_discards_the_remaining_mission():
    desk = desk_after(mode=AUTO_HOLD)
    desk.armed, desk.landed_state = False, 1
    desk.run(1.2)
    assert desk.texts() == [GIVEN]
    desk.armed, desk.landed_state = True, 2
    desk.run(1.2).go_on().run(0.2)
    assert desk.answers(PAUSE_CONTINUE) == [TEMPORARILY_REJECTED]
    assert desk.companion.memory.state is MissionState.IDLE


def test_without_a_crash_no_restart_is_reported():
    desk = desk_after(MissionState.IDLE, None)
    desk.armed, desk.landed_state = False, 1
    assert desk.run(5.0).texts() == []
    assert Desk().run(5.0).texts() == []


def test_a_missing_landed_state_is_waited_for_without_result():
    desk = desk_after()
    desk.mute.add("EXTENDED_SYS_STATE")
    assert desk.run(2.5).texts() == []
    assert desk.run(1.0).said("MOAR: restarted, was flying")


@pytest.mark.parametrize("state", [MissionState.FLYING, MissionState.OVERRIDDEN])
def test_under_engage_no_mode_is_requested_after_a_restart_because_a_pilot_may_have_taken_over(
    state,
):
    desk = desk_after(state, mode=AUTO_HOLD, authority=Authority.ENGAGE)
    desk.run(1.2).order(INSPECTION).run_until("ready").run(3.0)
    assert desk.mode_requests() == []
    desk.send_heartbeat(OFFBOARD).run_until("flying", 0.1)
    desk.order(RELEASE).run(0.6).send_heartbeat(OFFBOARD)
    desk.run(1.0).order(INSPECTION).run_until("flying").order(RELEASE).run(0.6)
    assert desk.mode_requests() == []


def test_the_snapshot_has_the_state_task_and_time_that_the_next_process_needs():
    desk = Desk()
    assert desk.companion.memory is None
    desk.come_to("flying")
    memory = desk.companion.memory
    assert (memory.state, memory.site) == (MissionState.FLYING, desk.site.name)
    assert memory.task.stops == ("splice-outer", "splice-inner")
    assert memory.since_s == desk.companion.status.since_s


def test_after_a_second_crash_before_any_order_the_snapshot_is_that_of_the_first():
    desk = desk_after().run(5.0)
    assert desk.companion.memory.state is MissionState.FLYING
    assert desk.companion.memory.task == REST


@pytest.mark.parametrize("pause_s", [0.6, 3.0])
def test_a_service_that_is_ended_after_a_pause_sends_no_last_setpoint(pause_s):
    desk = Desk().come_to("flying", then_s=1.0)
    sent = len(desk.setpoints())
    desk.now_s += pause_s
    desk.companion.shut_down(desk.now_s)
    desk.take_what_is_sent()
    assert len(desk.setpoints()) == sent
