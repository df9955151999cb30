"""The planner becomes ready: all that the companion has learnt before stays."""

from __future__ import annotations

from moar_companion.companion.mission.values import Task
from moar_companion.companion.mission_snapshot import MissionSnapshot
from moar_companion.companion.mission_states import MissionState
from moar_companion.companion.planning.site_maps import SiteMaps
from moar_companion.perception.perception_report import PerceptionReport, SensorHealth
from moar_companion.settings.config import Authority, Supervision
from moar_companion.settings.perception_config import Perception, Sensor
from moar_companion.types import Mission

from .desk import (
    ACCEPTED,
    CANCELLED,
    IN_PROGRESS,
    INSPECTION,
    PAUSE_CONTINUE,
    STEP_S,
    TEMPORARILY_REJECTED,
    Desk,
)
from .scripted_autopilot import OFFBOARD

REST = Task(mission=Mission.INSPECTION, stops=("splice-inner",))


def waiting(**options):
    """A desk whose planner is not ready yet."""
    desk = Desk(with_site=False, **options)
    desk.companion.await_planner()
    return desk


def planner_ready(desk):
    desk.companion.take_ground(SiteMaps(site=desk.site, maps=desk.planner.maps))
    return desk


def interrupted(desk, state=MissionState.FLYING):
    """Memory of a process that ended in flight."""
    return MissionSnapshot(state=state, since_s=38.0, task=REST, site=desk.site.name)


def test_an_order_that_waited_is_planned_in_the_first_cycle():
    desk = waiting().run(3.0).order(INSPECTION).run(1.0)
    planner_ready(desk).step()
    assert desk.state == "planning"
    assert desk.run_until("ready").answers()[-1] == ACCEPTED


def test_a_position_whose_clock_stands_still_stays_old():
    desk = waiting().run(3.0)
    desk.position_boot_s = desk.boot_s
    desk.run(3.0).order(INSPECTION)
    planner_ready(desk).run(0.1)
    assert desk.answers() == [TEMPORARILY_REJECTED]
    assert desk.said("MOAR: position age 3.")


def test_a_wind_that_was_measured_counts_until_the_next_measurement():
    limits = Supervision(wind_limit_mps=5.0)
    desk = waiting(wind_mps=9.0, supervision=limits).run(5.0)
    before = desk.companion.risk.indices.wind
    desk.mute.add("WIND_COV")
    planner_ready(desk.order(INSPECTION)).step()
    assert before > 0.3
    assert desk.companion.risk.indices.wind >= before
    assert desk.answers() == [TEMPORARILY_REJECTED]


def test_a_report_of_the_sensor_is_no_news():
    desk = waiting(perception=Perception(sensor=Sensor.VELODYNE)).run(1.2)
    health = SensorHealth(scan_s=desk.now_s, received_s=desk.now_s, returns=0.5)
    report = PerceptionReport(
        time_s=desk.now_s, began_s=0.0, health=health, conductors=(), solids=()
    )
    desk.companion.perceived(report)
    planner_ready(desk.step()).step()
    assert desk.companion.state.seen_obstacles.report is report


def test_an_order_that_its_operator_cancels_is_not_executed():
    desk = waiting().run(1.2).order(INSPECTION).run(0.5).take_back()
    planner_ready(desk).run(1.0)
    assert (desk.state, desk.answers()) == ("idle", [IN_PROGRESS, CANCELLED])


def test_a_restart_of_the_autopilot_between_two_cycles_is_no_less_a_condition():
    desk = waiting().run(3.0)
    desk.boot_s = 0.5
    for _ in range(20):  # until the new clock has advanced
        desk.now_s += STEP_S
        desk.boot_s += STEP_S
        desk._count += 1
        for data in desk._autopilot_messages():
            desk.handle(data)
    planner_ready(desk).step()
    assert "autopilot_reboot" in {item["name"] for item in desk.decided("condition")}


def test_a_landing_meanwhile_ends_the_interrupted_mission():
    desk = waiting(before=interrupted(Desk())).run(1.2)
    desk.landed_state = 1
    desk.run(1.2)
    desk.landed_state = 2
    desk.run(1.2)
    planner_ready(desk).run(1.2).go_on().run(0.2)
    assert desk.answers(PAUSE_CONTINUE) == [TEMPORARILY_REJECTED]
    assert not desk.said("continue to fly the rest")


def test_after_a_landing_meanwhile_no_pilot_counts_as_having_taken_over():
    desk = waiting(
        before=interrupted(Desk(), MissionState.OVERRIDDEN), authority=Authority.ENGAGE
    ).run(1.2)
    desk.landed_state = 1
    desk.run(1.2)
    desk.landed_state = 2
    desk.run(1.2)
    planner_ready(desk).run(1.2).order(INSPECTION).run(3.0)
    assert desk.mode_requests()
    desk.send_heartbeat(OFFBOARD).run_until("flying", 0.1)
