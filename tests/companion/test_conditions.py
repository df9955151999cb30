"""Conditions of the supervisor, from the autopilot's messages to the streamed setpoints."""

from __future__ import annotations

import itertools
import math

import pytest
from pymavlink.dialects.v20 import all as mavlink

from moar_companion.companion.safety.check_inputs import Host
from moar_companion.settings.config import LinkLoss, Supervision

from ..mavlink.peer import Peer
from .desk import ACCEPTED, DENIED, EVACUATION, EXIT, INSPECTION, LINK, TEMPORARILY_REJECTED, Desk
from .scripted_autopilot import OFFBOARD


def resting(desk, since_s):
    """True if the setpoint has come to rest and stays."""
    return all((m.vx, m.vy, m.vz) == (0.0, 0.0, 0.0) for m in desk.setpoints(since_s))


def flown(desk):
    return desk.companion.status.task.mission.value


HOLDS = {
    "wind": ({"wind_mps": 21.4}, {"wind_mps": 4.0}, "wind reported 21.4 m/s > 15"),
    "no fix": ({"fix_type": 1}, {"fix_type": 3}, "GNSS receiver has no 3D fix"),
    "uncertainty": (
        {"accuracy_m": 2.4},
        {"accuracy_m": 0.3},
        "uncertainty 2.4 m > 2",
    ),
}


@pytest.mark.parametrize(
    "case", [pytest.param("wind", marks=pytest.mark.slow), "no fix", "uncertainty"]
)
def test_a_condition_holds_the_mission_which_resumes_when_the_condition_clears(case):
    trouble, well, words = HOLDS[case]
    desk = Desk(wind_mps=4.0).come_to("flying", then_s=4.0)
    desk.set(**trouble).run_until("holding", 4.5)
    assert desk.said(f"MOAR: {words}")
    desk.run(3.0)
    assert resting(desk, desk.now_s - 1.0)
    began = desk.now_s
    desk.set(**well).run(2.0)
    assert desk.state == "holding"  # one good message does not end the hold
    desk.run_until("flying", 10.0)
    assert len(desk.setpoints(began)) == pytest.approx((desk.now_s - began) * 50, abs=2)
    assert not resting(desk.run(1.0), desk.now_s - 0.5)


@pytest.mark.parametrize("case", HOLDS)
def test_a_mission_that_an_operator_has_held_meanwhile_does_not_resume(case):
    trouble, well, _ = HOLDS[case]
    desk = Desk(wind_mps=4.0).come_to("flying", then_s=4.0)
    desk.set(**trouble).run_until("holding", 4.5)
    desk.pause().run(1.0).set(**well).run(8.0)
    assert desk.state == "holding"
    desk.go_on().run(0.5)
    assert desk.state == "flying"


@pytest.mark.parametrize("case", HOLDS)
def test_an_inspection_is_rejected_with_the_measured_value(case):
    trouble, _, words = HOLDS[case]
    desk = Desk().set(**trouble).run(6.0).order(INSPECTION).run(0.5)
    assert (desk.state, desk.answers()) == ("idle", [TEMPORARILY_REJECTED])
    assert desk.said(words)
    desk.order(EXIT).run(0.5)
    # An exit may be ordered in strong wind, but not without a position.
    possible = case != "uncertainty"
    assert desk.answers()[-1] == (ACCEPTED if possible else TEMPORARILY_REJECTED)


def test_an_ordered_escape_route_is_flown_in_wind_above_the_limit():
    desk = Desk().come_to("flying", then_s=4.0)
    desk.set(wind_mps=21.0).run_until("holding", 5.0).run(0.6)
    desk.order(EVACUATION).run_until("flying", 1.0)
    desk.run_until("landing_leg", 120.0)
    assert flown(desk) == "evacuation"


@pytest.mark.parametrize("state", ["ready", "planning"])
def test_a_condition_withdraws_an_offer_that_is_not_flown_yet(state):
    desk = Desk()
    if state == "ready":
        desk.come_to("ready")
    else:
        desk.run(1.2).plan_delay_s = None
        desk.order(INSPECTION).run_until("planning")
    desk.set(fix_type=0).run(2.0)
    assert desk.state == "idle"
    assert desk.said("MOAR: GNSS receiver has no 3D fix")


def test_a_battery_at_its_reserve_makes_the_supervisor_begin_an_escape_route():
    desk = Desk().come_to("flying", then_s=4.0)
    desk.set(battery_percent=20).run(4.5)
    assert (desk.state, flown(desk)) == ("flying", "exit")
    assert desk.said("MOAR: battery 0 at 20% <= 20%")
    desk.set(charge_state=3).run(2.5)
    assert flown(desk) == "evacuation"
    assert desk.said("MOAR: battery 0 is critical")
    desk.set(battery_percent=60, charge_state=1).run_until("landing_leg", 120.0)
    assert flown(desk) == "evacuation"  # a started escape route is flown to its end


def test_an_escape_route_that_the_operator_orders_is_flown_instead_of_the_supervisors():
    desk = Desk().come_to("flying", then_s=4.0)
    desk.set(charge_state=3).run(3.0)
    assert flown(desk) == "evacuation"
    desk.order(EXIT).run(5.0)
    assert flown(desk) == "exit"
    desk.pause().run(5.0)
    assert desk.state == "holding"
    desk.order(INSPECTION).run(1.0)
    assert desk.answers()[-1] == TEMPORARILY_REJECTED


@pytest.mark.slow
def test_escape_routes_without_a_plan_hold_until_there_is_one_and_are_reported_seldom():
    desk = Desk().come_to("flying", then_s=4.0)
    desk.plan_delay_s = None
    desk.set(battery_percent=15)
    for mission in ("exit", "evacuation"):
        desk.run_until_requested(mission).answer_plan(plan=None, reason="no free path leads there")
    desk.run(1.0)
    assert desk.state == "holding"
    assert desk.said("no free path leads there, no exit")
    assert desk.said("no free path leads there, no evacuation")
    began, count = desk.now_s, 0
    while desk.now_s < began + 20.0:
        desk.step()
        if desk.companion.status.requested is not None:
            desk.answer_plan(plan=None, reason="no free path leads there")
            count += 1
    assert desk.state == "holding"
    assert count == pytest.approx(20, abs=2)
    assert desk.texts().count("MOAR: no free path leads there, no exit") <= 3
    desk.set(plan_delay_s=0.04).run(2.5)
    assert flown(desk) == "exit"


def test_the_escape_route_is_requested_again_when_the_planner_is_silent_once():
    desk = Desk().come_to("flying", then_s=4.0)
    desk.set(plan_delay_s=None, battery_percent=15).run_until_requested("exit").run(5.1)
    assert desk.state == "holding"
    assert desk.said("no plan in 5 s, no exit")
    desk.set(plan_delay_s=0.04).run(2.2)
    assert flown(desk) == "exit"


def test_a_denied_order_leaves_the_evacuation_on():
    desk = Desk().come_to("flying", then_s=4.0)
    desk.set(charge_state=3, plan_delay_s=None).run_until_requested("evacuation").run(0.6)
    desk.order(EXIT).run(0.5).set(plan_delay_s=0.04)
    desk.answer_plan(plan=None, reason="no free path leads there").step()
    assert desk.companion.status.requested.mission.value == "evacuation"
    desk.run(0.5)
    assert desk.answers()[-1] == DENIED
    assert flown(desk) == "evacuation"


@pytest.mark.parametrize("action", LinkLoss)
def test_the_loss_of_the_ground_station_has_the_configured_action(action):
    desk = Desk(supervision=Supervision(ground_link_action=action)).come_to("flying", then_s=2.0)
    station = Peer(255, 190)
    beat = mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, 8, 0, 0, 4, 3)
    desk.handle(station.pack(beat)).run(9.8)
    assert (desk.state, flown(desk)) == ("flying", "inspection")
    desk.run(1.0)
    expected = {
        LinkLoss.CONTINUE: ("flying", "inspection"),
        LinkLoss.HOLD: ("holding", "inspection"),
        LinkLoss.EXIT: ("flying", "exit"),
    }
    assert (desk.state, flown(desk)) == expected[action]


@pytest.mark.slow
def test_another_ground_station_does_not_hide_the_loss_of_the_operators():
    desk = Desk()
    ground_station(desk, 255, seconds=11)
    desk.come_to("flying", then_s=2.0)
    ground_station(desk, 254, seconds=12)
    assert desk.said("MOAR: no ground station for 1")
    assert desk.state == "holding"
    desk.order(INSPECTION, peer=Peer(254, 190)).run_until("flying", 4.0)
    ground_station(desk, 254, seconds=5)
    assert desk.state in {"flying", "at_target"}


def test_jumps_that_add_up_are_held_until_a_new_order():
    desk = Desk().come_to("flying", then_s=6.0)
    desk.jump(0.0, 1.4, 0.0).run(2.0)
    assert desk.state == "flying"
    desk.jump(0.0, -0.8, 0.0).run(0.1)
    assert desk.state == "holding"
    assert desk.said("the position jumped 3.6 m > ")
    desk.run(8.0)
    assert desk.state == "holding"
    desk.go_on().run(1.0)
    assert desk.state == "flying"


@pytest.mark.slow
def test_a_planner_that_fails_in_flight_slows_the_flight_down_and_then_holds_it():
    desk = Desk().come_to("flying", then_s=1.0)
    desk.plan_delay_s = None
    desk.run(8.0)
    assert desk.said("MOAR: no new plan for")
    slow = desk.setpoints(desk.now_s - 0.5)
    assert max(math.hypot(m.vx, m.vy, m.vz) for m in slow) <= 0.36
    desk.run_until("holding", 8.0)
    desk.plan_delay_s = 0.04
    desk.run(6.0)
    assert desk.state == "holding"
    desk.go_on().run(1.0)
    assert desk.state == "flying"


@pytest.mark.parametrize("pressed", ["memory", "disk"])
def test_a_full_disk_rejects_inspections_and_low_memory_also_begins_an_exit(pressed):
    host = Host(disk_free=1e6, memory_available=1e9)
    if pressed == "memory":
        host = Host(disk_free=1e9, memory_available=50e6)
    desk = Desk().come_to("flying", then_s=2.0)
    desk.companion.note_host(host)
    desk.run(6.0)
    # Without disk space the flight continues unrecorded. With low memory the system may kill the
    # service at any time, so the companion flies the exit.
    assert flown(desk) == ("exit" if pressed == "memory" else "inspection")
    desk.order(INSPECTION).run(0.5)
    assert desk.answers()[-1] == TEMPORARILY_REJECTED
    assert desk.said("disk 1 MB < " if pressed == "disk" else "memory 50 MB < ")


def test_a_larger_position_error_keeps_the_moving_setpoint_away_from_obstacles():
    desk = Desk().come_to("flying", then_s=4.0)
    desk.set(accuracy_m=1.9)
    desk.run_until("holding", 120.0)
    assert desk.said("MOAR: no path, uncertainty 1.9 m, holding")
    desk.run(2.0)
    assert resting(desk, desk.now_s - 0.5)
    x_m, _, z_m = desk.companion.pose.position_m
    cell = desk.planner.maps.grid.cell_of((x_m, z_m))
    assert desk.planner.maps.room_m[cell] >= 1.0 - 0.3


def test_missing_measurements_are_reported_once():
    desk = Desk()
    desk.mute = {"BATTERY_STATUS", "GPS_RAW_INT"}
    desk.come_to("flying", then_s=8.0)
    reported = [text for text in desk.texts() if "unknown: " in text]
    assert reported == ["MOAR: unknown: battery and 3 more"]


def ground_station(desk, *systems, seconds):
    """Sends heartbeats of these systems once a second."""
    for _ in range(round(seconds)):
        for system in systems:
            desk.handle(Peer(system, 190).ground_heartbeat()).run(1.0 / len(systems))


@pytest.mark.slow
def test_a_ground_station_that_connects_later_receives_the_earlier_reports():
    desk = Desk(supervision=Supervision(ground_link_action=LinkLoss.CONTINUE))
    desk.set(mute={"BATTERY_STATUS"}).come_to("flying", then_s=8.0)
    note = "MOAR: unknown: battery"

    def reported():
        return sum(text.startswith(note) for text in desk.texts())

    assert reported() == 1
    ground_station(desk, 255, seconds=3)
    assert reported() == 2
    ground_station(desk, 255, 254, seconds=8)
    assert reported() == 3
    desk.run(12.0)  # both are silent
    assert desk.said("MOAR: no ground station for 1")
    ground_station(desk, 255, seconds=8)
    assert reported() == 4


def test_a_ground_station_that_connects_later_receives_the_reason_of_the_hold():
    desk = Desk(wind_mps=4.0).come_to("flying", then_s=4.0)
    desk.set(wind_mps=21.4).run_until("holding", 4.5).run(6.0)
    holds = "wind reported 21.4 m/s > 15"
    assert desk.texts().count(f"MOAR: {holds}, holding") == 1
    ground_station(desk, 255, seconds=3)
    assert desk.texts().count(f"MOAR: {holds}, holding") == 2
    desk.set(wind_mps=4.0)
    ground_station(desk, 255, seconds=3)
    ground_station(desk, 254, 255, seconds=1)  # no condition acts any more
    assert desk.texts().count(f"MOAR: {holds}, holding") == 2


def test_an_operators_exit_is_not_reported_as_the_supervisors_evacuation():
    desk = Desk().come_to("flying", then_s=4.0)
    desk.set(charge_state=3).run(3.0).order(EXIT).run(5.0)
    ground_station(desk, 255, seconds=2)
    assert desk.texts().count("MOAR: battery 0 is critical, evacuating") == 1


@pytest.mark.slow
def test_a_battery_that_falls_silent_is_no_battery_for_another_inspection():
    desk = Desk().set(battery_percent=22).come_to("flying", then_s=2.0)
    desk.mute = {"BATTERY_STATUS"}
    desk.run(14.0).order(INSPECTION).run(0.5)
    assert desk.answers()[-1] == ACCEPTED
    desk.run(20.0)
    assert (desk.state, flown(desk)) == ("flying", "inspection")  # the flight continues
    assert desk.said("MOAR: battery 0 is silent for 15 s")
    desk.order(INSPECTION).run(0.5)
    assert desk.answers()[-1] == TEMPORARILY_REJECTED
    assert desk.said("battery 0 is silent for 35 s, rejected")
    desk.order(EXIT).run(0.5)
    assert desk.answers()[-1] == ACCEPTED


@pytest.mark.slow
def test_a_battery_stays_critical_when_only_a_summary_without_its_charge_state_arrives():
    desk = Desk().come_to("flying", then_s=4.0)
    desk.set(charge_state=3).run(3.0).pause().run_until("holding", 1.0)
    desk.mute = {"BATTERY_STATUS"}
    summary = mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 15900, -1, 60, *[0] * 6)
    for _ in range(100):
        desk.handle(desk.autopilot.pack(summary)).run(0.2)
    desk.order(INSPECTION).run(0.5)
    assert desk.answers()[-1] == TEMPORARILY_REJECTED
    assert desk.said("MOAR: battery 0 is critical, rejected")
    desk.set(mute=set(), charge_state=1).run(12.0).order(INSPECTION).run(0.5)
    assert desk.answers()[-1] == ACCEPTED


STRAYS = {
    "too low": ((0.0, 0.0, 1.4), "altitude 1.2 m < 2, holding"),
    "outside": ((0.0, 5.0, 0.0), "2.0 m outside the workspace"),
}


@pytest.mark.parametrize("case", STRAYS)
def test_an_aircraft_outside_the_workspace_is_reported_with_its_distance(case):
    behind_ned_m, words = STRAYS[case]
    desk = Desk().come_to("flying")
    at_ned_m = desk.position_ned_m
    for step in range(200):  # the aircraft ignores its setpoints
        share = min(1.0, step / 50)
        strayed_ned_m = tuple(
            at + share * off for at, off in zip(at_ned_m, behind_ned_m, strict=True)
        )
        desk.set(position_ned_m=strayed_ned_m).step()
    assert desk.state == "holding"
    assert desk.said(f"MOAR: {words}")


def test_the_begin_and_the_end_of_a_condition_are_recorded_once():
    desk = Desk().come_to("flying", then_s=2.0)
    desk.set(wind_mps=21.0).run(6.0).set(wind_mps=1.0).run(8.0)
    reported = [item for item in desk.decided("condition") if item["name"] == "wind"]
    assert [item["began"] for item in reported] == [True, False]
    assert reported[0]["action"] == "hold"
    assert desk.state == "flying"
    assert desk.said("MOAR: resuming")


def test_a_hold_ends_like_any_flight_when_the_pilot_takes_over():
    desk = Desk().come_to("flying", then_s=4.0)
    desk.set(fix_type=0).run_until("holding")
    desk.send_heartbeat(0x00030000).run(0.1)
    took = desk.now_s
    desk.set(fix_type=3).run(4.0).send_heartbeat(OFFBOARD).run(4.0)
    assert desk.state == "overridden"
    assert not desk.setpoints(took)


@pytest.mark.slow
def test_no_setpoint_jumps_while_conditions_begin_and_end():
    desk = Desk().come_to("flying", then_s=2.0)
    began = desk.now_s
    for seconds in (4.0, 7.0, 4.0, 9.0):
        desk.set(wind_mps=21.0 if desk.state == "flying" else 1.0).run(seconds)
    places = [(m.x, m.y, m.z) for m in desk.setpoints(began)]
    assert max(itertools.starmap(math.dist, itertools.pairwise(places))) <= 0.7 * 0.02 + 1e-3


def test_no_condition_is_reported_before_the_first_order():
    desk = Desk()
    desk.companion.receive(LINK, b"", desk.now_s)
    desk.set(wind_mps=20.0, fix_type=0, battery_percent=3).run(8.0)
    assert not [text for text in desk.texts() if "MOAR" in text]


# Missing messages -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("bad", "silent", "well"),
    [
        pytest.param(
            {"wind_mps": 25.0}, {"wind_mps": None}, {"wind_mps": 5.0}, marks=pytest.mark.slow
        ),
        (
            {"receiver_accuracy_m": 4.0},
            {"fix_type": 0, "receiver_accuracy_m": 0.0},
            {"fix_type": 3, "receiver_accuracy_m": 0.9},
        ),
        (
            {"receiver_accuracy_m": 4.0},
            {"fix_type": 1, "receiver_accuracy_m": 1.0},
            {"fix_type": 3, "receiver_accuracy_m": 0.9},
        ),
        ({"accuracy_m": 2.4}, {"accuracy_m": math.nan}, {"accuracy_m": 0.3}),
    ],
)
def test_a_hold_ends_by_a_good_measurement_and_not_by_missing_ones(bad, silent, well):
    desk = Desk(wind_mps=5.0).come_to("flying", then_s=1.0)
    desk.set(**bad).run_until("holding", 6.0)
    name = desk.companion.ruling.conditions[0].condition.name
    desk.set(**silent).run(8.0)
    assert desk.state == "holding"
    assert name in {item.condition.name for item in desk.companion.ruling.conditions}
    desk.set(**well).run_until("flying", 20.0)


def test_obstacles_stay_as_wide_as_they_were_when_the_receiver_falls_silent():
    desk = Desk().come_to("flying", then_s=1.0)
    desk.set(receiver_accuracy_m=1.7).run(3.0)
    desk.set(fix_type=0, receiver_accuracy_m=0.0).run(6.0).order(EXIT).run(1.0)
    assert desk.jobs[-1].widening_m >= 0.8


@pytest.mark.slow
def test_a_condition_that_still_holds_after_its_cause_is_over_is_reported_again():
    desk = Desk().set(reset_counter=0).come_to("flying", then_s=2.0)
    desk.jump(0.0, -2.0, -4.0).set(reset_counter=1).run(11.0)
    (jump,) = (
        item for item in desk.companion.ruling.conditions if item.condition.name == "position_jump"
    )
    assert not jump.lasts
    assert sum(text.startswith("MOAR: the position jumped") for text in desk.texts()) == 1
    ground_station(desk, 254, seconds=3)
    assert desk.texts().count("MOAR: the position jumped 4.5 m > 0.9, holding") == 2
