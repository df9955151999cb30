"""What operators are answered, and when."""

from __future__ import annotations

import math

import pytest

from moar_companion.config import Authority, LinkConfig, LinkRole

from .desk import (
    ACCEPTED,
    AUTO_HOLD,
    CANCELLED,
    CRITICAL,
    DENIED,
    EVACUATION,
    EXIT,
    FAILED,
    HOLD,
    IN_PROGRESS,
    INSPECTION,
    LINK,
    OFFBOARD,
    PAUSE_CONTINUE,
    POSCTL,
    RELEASE,
    TEMPORARILY_REJECTED,
    UNSUPPORTED,
    USER_1,
    Desk,
    Peer,
)

OPERATOR_LINK = "udp:127.0.0.1:14550"


def test_a_mission_ordered_in_the_air_is_accepted_once_its_plan_is_there():
    desk = Desk().run(1.2).order(INSPECTION)
    desk.step()
    assert (desk.state, desk.answers()) == ("planning", [])
    assert desk.texts() == ["MOAR planning inspection"]
    desk.run(0.1)
    assert (desk.state, desk.answers()) == ("ready", [ACCEPTED])
    acknowledged = desk.messages("COMMAND_ACK")[0]
    assert (acknowledged.target_system, acknowledged.target_component) == (255, 190)
    assert (acknowledged.get_srcSystem(), acknowledged.get_srcComponent()) == (1, 195)
    assert desk.said("MOAR ready inspection")


@pytest.mark.parametrize(
    ("case", "armed", "landed_state"),
    [
        ("armed on the ground", True, 1),
        ("disarmed on the ground", False, 1),
        ("disarmed, though it says in the air", False, 2),
        ("still taking off", True, 3),
        ("landed state unknown", True, 0),
    ],
)
def test_a_mission_is_temporarily_rejected_unless_in_the_air(case, armed, landed_state):
    desk = Desk()
    desk.armed, desk.landed_state = armed, landed_state
    desk.run(1.2).order(INSPECTION).run(1.0)
    assert (desk.state, desk.answers()) == ("idle", [TEMPORARILY_REJECTED])
    assert desk.said("not in the air")
    assert not desk.setpoints()


@pytest.mark.parametrize("mission", [INSPECTION, EXIT, EVACUATION])
def test_an_index_out_of_range_is_denied_with_the_number_there_are(mission):
    desk = Desk().run(1.2).order(mission, 7.0).run(0.2)
    assert (desk.state, desk.answers()) == ("idle", [DENIED])
    assert desk.said("7: the site has")


@pytest.mark.parametrize(
    ("mission", "index"), [(5.0, 0.0), (-1.0, 0.0), (1.5, 0.0), (math.nan, 0.0), (1.0, 0.5)]
)
def test_a_parameter_that_means_nothing_is_denied(mission, index):
    desk = Desk().run(1.2).order(mission, index).run(0.2)
    assert (desk.state, desk.answers()) == ("idle", [DENIED])
    assert len([text for text in desk.texts() if text.startswith("MOAR denied: ")]) == 1


@pytest.mark.parametrize("index", [-1.0, math.nan])
def test_without_an_index_all_targets_are_visited_in_turn(index):
    desk = Desk().run(1.2).order(INSPECTION, index).run(0.2)
    assert desk.companion.status.task.stops == ("splice-outer", "splice-inner")


def test_with_an_index_one_target_is_visited():
    desk = Desk().run(1.2).order(INSPECTION, 1.0).run(0.2)
    assert desk.companion.status.task.stops == ("splice-inner",)


def test_an_order_to_all_components_is_heard_and_what_is_not_ours_is_not_answered():
    desk = Desk().run(1.2).order(INSPECTION, target=(1, 0)).run(0.2)
    assert (desk.state, desk.answers()) == ("ready", [ACCEPTED])
    desk.order(0.0, command=1000, target=(1, 0)).run(0.2)
    assert desk.answers(1000) == []
    desk.order(0.0, command=1000).run(0.2)
    assert desk.answers(1000) == [UNSUPPORTED]


def test_an_order_to_another_component_or_system_is_none_of_ours():
    desk = Desk().run(1.2)
    desk.order(INSPECTION, target=(1, 1)).order(INSPECTION, target=(2, 195)).run(0.5)
    assert (desk.state, desk.answers()) == ("idle", [])


def test_while_planning_takes_long_the_order_is_in_progress_and_then_accepted():
    desk = Desk(plan_delay_s=None).run(1.2).order(INSPECTION)
    desk.run(0.2)
    assert desk.answers() == []
    desk.run(0.04)
    assert desk.answers() == [IN_PROGRESS]
    desk.run(3.0)
    assert desk.answers() == [IN_PROGRESS]
    desk.answer_plan().step()
    assert desk.answers() == [IN_PROGRESS, ACCEPTED]
    assert desk.state == "ready"


def test_a_mission_that_cannot_be_planned_is_denied_with_the_reason_in_words():
    desk = Desk(plan_delay_s=None).run(1.2).order(INSPECTION).step()
    desk.answer_plan(plan=None, reason="the goal cannot be reached: no free way leads there")
    desk.run(0.1)
    assert (desk.state, desk.answers()) == ("idle", [DENIED])
    told = [text for text in desk.texts() if "the goal cannot be reached" in text]
    assert told == ["MOAR denied: the goal cannot be reached: no free way leads there"]
    assert not desk.setpoints()


def test_in_flight_a_mission_that_cannot_be_planned_is_denied_and_the_flight_goes_on():
    desk = Desk().come_to("flying")
    desk.plan_delay_s = None
    desk.run(3.0)  # no replan is answered any more
    desk.order(EVACUATION).step().answer_plan(plan=None, reason="no landing point can be seen")
    before = desk.now_s
    desk.plan_delay_s = 0.04
    desk.run(1.0)
    assert desk.answers()[-1] == DENIED
    assert desk.said("no landing point can be seen")
    assert desk.state == "flying"
    assert len(desk.setpoints(before)) == 50
    assert desk.run_until("at_target", 60.0).state == "at_target"


def test_a_second_order_from_another_operator_cancels_the_first():
    desk = Desk(plan_delay_s=None).run(1.2).order(INSPECTION).step()
    tablet = Peer(254, 190)
    desk.order(EXIT, peer=tablet).step()
    answered = [(message.target_system, message.result) for message in desk.messages("COMMAND_ACK")]
    assert answered == [(255, CANCELLED)]
    desk.answer_plan(0).step()  # the first plan comes too late
    assert desk.state == "planning"
    desk.answer_plan(1).step()
    assert desk.companion.status.task.mission.value == "exit"
    answered = [(message.target_system, message.result) for message in desk.messages("COMMAND_ACK")]
    assert answered == [(255, CANCELLED), (254, ACCEPTED)]


def test_a_repeated_order_is_carried_out_once():
    desk = Desk(plan_delay_s=None).run(1.2).order(INSPECTION).step()
    desk.hear(desk.operator.command(USER_1, INSPECTION, -1.0, confirmation=1)).step()
    assert len(desk.jobs) == 1
    desk.answer_plan().step()
    assert desk.answers()[-1] == ACCEPTED
    desk.hear(desk.operator.command(USER_1, INSPECTION, -1.0, confirmation=2)).step()
    assert len(desk.jobs) == 1
    assert desk.state == "ready"


def test_an_order_taken_back_on_the_ground_of_planning_is_cancelled_and_its_plan_dropped():
    desk = Desk(plan_delay_s=None).run(1.2).order(INSPECTION).step()
    desk.take_back().step()
    assert (desk.state, desk.answers()) == ("idle", [CANCELLED])
    desk.answer_plan().run(1.0)
    assert desk.state == "idle"
    assert not desk.setpoints()


def test_an_order_taken_back_in_flight_is_not_flown_when_its_plan_comes():
    desk = Desk().come_to("flying")
    desk.plan_delay_s = None
    desk.run(0.2).order(EVACUATION).step()
    evacuation = len(desk.jobs) - 1
    desk.take_back().step()
    adopted = len(desk.decided("plan"))
    desk.answer_plan(evacuation).step()
    assert len(desk.decided("plan")) == adopted
    assert desk.companion.status.task.mission.value == "inspection"
    desk.plan_delay_s = 0.04
    assert desk.run_until("at_target", 60.0).state == "at_target"


def test_pause_holds_and_continue_goes_on():
    desk = Desk().come_to("flying").run(5.0)
    desk.order(0.0, command=PAUSE_CONTINUE).run(2.0)
    assert (desk.state, desk.answers(PAUSE_CONTINUE)) == ("holding", [ACCEPTED])
    place = desk.position_ned_m
    last = desk.run(5.0).setpoints()[-1]
    assert (last.vx, last.vy, last.vz) == (0.0, 0.0, 0.0)
    assert math.dist(desk.position_ned_m, place) < 1e-3
    desk.order(1.0, command=PAUSE_CONTINUE).run(0.2)
    assert (desk.state, desk.answers(PAUSE_CONTINUE)) == ("flying", [ACCEPTED, ACCEPTED])
    assert desk.run_until("at_target", 60.0).state == "at_target"


def test_continue_without_anything_held_is_rejected():
    desk = Desk().come_to("flying").order(1.0, command=PAUSE_CONTINUE).run(0.1)
    assert desk.answers(PAUSE_CONTINUE) == [TEMPORARILY_REJECTED]
    assert desk.state == "flying"


@pytest.mark.parametrize("state", ["ready", "flying", "at_target"])
def test_release_ends_the_stream_with_one_last_setpoint_at_rest(state):
    desk = Desk().come_to(state)
    desk.order(RELEASE).step()
    assert desk.state == "released"
    assert desk.answers()[-1] == ACCEPTED
    before = desk.now_s
    last = desk.setpoints()[-1]
    assert (last.vx, last.vy, last.vz) == (0.0, 0.0, 0.0)
    desk.run(30.0)
    assert desk.setpoints(before) == []


def test_hold_on_the_ground_of_nothing_is_rejected():
    desk = Desk().run(1.2).order(HOLD).run(0.1)
    assert (desk.state, desk.answers()) == ("idle", [TEMPORARILY_REJECTED])


def test_an_open_order_fails_when_the_pilot_takes_over():
    desk = Desk().come_to("flying")
    desk.plan_delay_s = None
    desk.order(EXIT).step().say_heartbeat(POSCTL).step()
    assert desk.state == "overridden"
    assert desk.answers()[-1] == FAILED


def test_an_operators_own_link_is_answered_there():
    links = (
        LinkConfig(url=LINK),
        LinkConfig(url=OPERATOR_LINK, role=LinkRole.OPERATOR),
    )
    desk = Desk(links=links).run(1.2)
    desk.hear(desk.operator.command(USER_1, INSPECTION, -1.0), OPERATOR_LINK).run(0.2)
    acknowledged = [link for _, link, m in desk.sent if m.get_type() == "COMMAND_ACK"]
    assert acknowledged == [OPERATOR_LINK]
    texts = {link for _, link, m in desk.sent if m.get_type() == "STATUSTEXT"}
    assert texts == {LINK, OPERATOR_LINK}
    streams = {link for _, link, m in desk.sent if m.get_type() == "SET_POSITION_TARGET_LOCAL_NED"}
    assert streams == {LINK}


# Orders that cross with something else ----------------------------------------------------------


def test_an_order_taken_back_in_the_instant_of_its_plan_is_not_flown():
    desk = Desk(plan_delay_s=None).run(1.2).order(INSPECTION).step()
    desk.take_back().answer_plan().run(1.0)
    assert (desk.state, desk.answers()) == ("idle", [CANCELLED])
    assert not desk.setpoints()


def test_in_flight_an_order_taken_back_in_the_instant_of_its_plan_is_not_flown():
    desk = Desk().come_to("flying")
    desk.plan_delay_s = None
    desk.run(0.5).order(EVACUATION).step()
    desk.take_back().answer_plan().run(0.5)
    assert (desk.state, desk.answers()[-1]) == ("flying", CANCELLED)
    assert desk.companion.status.task.mission.value == "inspection"


@pytest.mark.parametrize(("order", "state"), [(HOLD, "holding"), (RELEASE, "released")])
def test_a_hold_or_release_cancels_the_order_whose_plan_is_awaited(order, state):
    desk = Desk().come_to("flying")
    desk.plan_delay_s = None
    desk.order(EVACUATION).step()
    desk.order(order, peer=Peer(254, 190)).step()
    answered = [(m.target_system, m.result) for m in desk.messages("COMMAND_ACK")[-2:]]
    assert (desk.state, answered) == (state, [(255, CANCELLED), (254, ACCEPTED)])


def test_a_pause_cancels_the_order_whose_plan_is_awaited():
    desk = Desk().come_to("flying")
    desk.plan_delay_s = None
    desk.order(EVACUATION).step()
    desk.pause().step()
    assert (desk.state, desk.answers()[-1]) == ("holding", CANCELLED)
    assert desk.answers(PAUSE_CONTINUE) == [ACCEPTED]


def test_a_failsafe_heard_with_a_release_gets_no_farewell():
    desk = Desk().come_to("flying").run(3.0)
    began = desk.now_s
    desk.say_heartbeat(AUTO_HOLD, CRITICAL).order(RELEASE).run(1.0)
    assert desk.state == "released"
    assert not desk.setpoints(began)


@pytest.mark.parametrize("failsafe_first", [True, False])
def test_an_order_that_crosses_with_a_failsafe_is_not_one_that_knew_of_it(failsafe_first):
    desk = Desk().come_to("ready").run(1.0)
    began = desk.now_s
    if failsafe_first:
        desk.say_heartbeat(AUTO_HOLD, CRITICAL).order(EXIT)
    else:
        desk.order(EXIT).say_heartbeat(AUTO_HOLD, CRITICAL)
    desk.run(2.0)
    assert (desk.state, desk.answers()[-1]) == ("released", TEMPORARILY_REJECTED)
    assert desk.said("just let go")
    assert not desk.setpoints(began)
    desk.order(EXIT).run(0.5)  # now the operator knows
    assert (desk.state, desk.answers()[-1]) == ("ready", ACCEPTED)


def test_with_a_plans_answer_too_an_order_comes_after_what_ends_control():
    desk = Desk().come_to("ready").run(1.0)
    desk.plan_delay_s = None
    desk.order(EVACUATION).step()
    began = desk.now_s
    desk.say_heartbeat(AUTO_HOLD, CRITICAL).order(EXIT).answer_plan().run(2.0)
    assert desk.state == "released"
    assert not desk.setpoints(began)


def test_with_a_plans_answer_too_a_failsafe_heard_with_a_release_gets_no_farewell():
    desk = Desk().come_to("flying").run(3.0)
    desk.plan_delay_s = None
    desk.order(EXIT).step()
    began = desk.now_s
    desk.say_heartbeat(AUTO_HOLD, CRITICAL).order(RELEASE).answer_plan().run(1.0)
    assert desk.state == "released"
    assert not desk.setpoints(began)


# While ready ------------------------------------------------------------------------------------


def test_a_mission_ordered_while_ready_interrupts_no_stream():
    desk = Desk(plan_delay_s=0.5).come_to("ready").run(1.0)
    began = desk.now_s
    desk.order(EXIT).run(0.4)
    assert desk.state == "ready"
    desk.run(0.6)
    assert (desk.state, desk.answers()[-1]) == ("ready", ACCEPTED)
    assert desk.companion.status.task.mission.value == "exit"
    assert len(desk.setpoints(began)) == 50
    assert {(m.vx, m.vy, m.vz) for m in desk.setpoints(began)} == {(0.0, 0.0, 0.0)}


def test_a_mission_that_cannot_be_planned_leaves_ready_as_it_was():
    desk = Desk().come_to("ready")
    desk.plan_delay_s = None
    desk.order(EXIT).step().answer_plan(plan=None, reason="no way out").run(0.5)
    assert (desk.state, desk.answers()[-1]) == ("ready", DENIED)
    desk.plan_delay_s = 0.04
    desk.run(1.0).say_heartbeat(OFFBOARD).run_until("flying", 0.1)
    assert desk.companion.status.task.mission.value == "inspection"


@pytest.mark.parametrize("held_by", ["pause", "order"])
def test_a_hold_given_with_the_mode_holds_and_can_be_continued(held_by):
    """The pilot gives OFFBOARD; a second later at the latest the companion hears of it."""
    desk = Desk().come_to("ready").run(1.2).run_to_heartbeat()
    desk.mode = OFFBOARD
    began = desk.now_s
    if held_by == "pause":
        desk.pause()
    else:
        desk.order(HOLD)
    desk.step()
    assert desk.state == "ready"
    assert desk.answers(PAUSE_CONTINUE if held_by == "pause" else USER_1)[-1] == ACCEPTED
    desk.run(5.0)
    assert desk.state == "holding"
    assert len(desk.setpoints(began)) == 251
    place = desk.setpoints(began)[0]
    last = desk.setpoints()[-1]
    assert math.dist((last.x, last.y, last.z), (place.x, place.y, place.z)) < 1e-6
    desk.go_on().run(0.5)
    assert desk.state == "flying"
    assert desk.run_until("at_target", 60.0).state == "at_target"


def test_a_hold_while_ready_can_be_continued_while_ready():
    desk = Desk().come_to("ready").pause().run(0.5)
    desk.go_on().run(0.5)
    assert (desk.state, desk.answers(PAUSE_CONTINUE)) == ("ready", [ACCEPTED, ACCEPTED])
    desk.run(1.0).say_heartbeat(OFFBOARD).run_until("flying", 0.1)


# Planners that are slow or silent ---------------------------------------------------------------


def test_a_planner_that_never_answers_is_not_waited_for():
    desk = Desk(plan_delay_s=None).run(1.2).order(INSPECTION).run(4.9)
    assert desk.state == "planning"
    desk.run(0.3)
    assert (desk.state, desk.answers()) == ("idle", [IN_PROGRESS, DENIED])
    assert desk.said("the planner does not answer")
    desk.answer_plan().run(1.0)  # too late
    assert desk.state == "idle"
    assert not desk.setpoints()


def test_a_replan_that_never_comes_is_dropped_and_the_next_one_asked_for():
    desk = Desk().come_to("flying")
    desk.plan_delay_s = None
    began = desk.now_s
    desk.run(6.0)
    asked = len(desk.jobs)
    desk.plan_delay_s = 0.04
    desk.run(6.0)
    assert len(desk.jobs) > asked
    assert desk.state == "flying"
    assert len(desk.setpoints(began)) == 600


@pytest.mark.parametrize("delay_s", [0.4, 0.8, 1.5])
def test_a_plan_that_comes_too_late_to_be_joined_is_made_again_from_rest(delay_s):
    desk = Desk().come_to("flying").run(4.0)
    desk.plan_delay_s = delay_s
    desk.order(EVACUATION).run(4.0)
    assert desk.answers()[-1] == ACCEPTED
    assert desk.companion.status.task.mission.value == "evacuation"
    assert "at_target" not in [change["state"] for change in desk.decided("state")]


@pytest.mark.parametrize("mission", [EXIT, EVACUATION])
def test_a_way_out_that_brakes_for_a_slow_planner_has_not_come_to_its_end(mission):
    desk = Desk(authority=Authority.ENGAGE).come_to("at_target").order(mission).run(4.0)
    assert desk.state == "flying"
    began = desk.now_s
    desk.plan_delay_s = 1.5
    desk.order(INSPECTION).run(6.0)
    assert not desk.mode_requests(began)  # for the landing
    assert (desk.state, desk.answers()[-1]) == ("flying", ACCEPTED)


# The end of the mission -------------------------------------------------------------------------


def test_above_the_landing_point_nothing_is_left_to_continue():
    desk = Desk().come_to("holding", EXIT).run(2.0).go_on().run(0.5)
    assert (desk.state, desk.answers(PAUSE_CONTINUE)) == ("holding", [TEMPORARILY_REJECTED])
    assert desk.said("nothing is left to fly")


@pytest.mark.parametrize("early_s", [0.0, 0.1, 0.2, 0.3, 0.4, 0.6])
def test_a_hold_that_ends_beyond_the_gate_can_be_continued(early_s):
    way = Desk().come_to("flying", EXIT)
    began = way.now_s
    way.run_until("landing_leg", 60.0)
    desk = Desk().come_to("flying", EXIT).run(way.now_s - began - early_s - 0.02)
    assert desk.state == "flying"
    desk.pause().run(3.0)
    assert desk.state == "holding"
    desk.go_on().run(1.0)
    assert desk.answers(PAUSE_CONTINUE) == [ACCEPTED, ACCEPTED]
    assert desk.run_until("holding", 60.0).companion.status.task.done


# Authority and site -----------------------------------------------------------------------------


@pytest.mark.parametrize("mission", [INSPECTION, EXIT, EVACUATION])
def test_an_observer_denies_missions_with_a_text_and_never_streams(mission):
    desk = Desk(authority=Authority.OBSERVE).run(1.2)
    desk.order(mission).say_heartbeat(OFFBOARD).run(60.0)
    assert (desk.state, desk.answers()) == ("idle", [DENIED])
    assert desk.said("the authority is observe")
    assert not desk.setpoints()
    assert not desk.mode_requests()


def test_without_a_site_missions_are_denied_and_risks_told_all_the_same():
    desk = Desk(with_site=False).run(1.2).order(INSPECTION).run(2.0)
    assert desk.answers() == [DENIED]
    assert desk.said("no site is loaded")
    names = {message.name for message in desk.messages("NAMED_VALUE_FLOAT")}
    assert names == {
        "RISK_WIND",
        "RISK_COMM",
        "RISK_LOC",
        "RISK_BATT",
        "K_SAFETY",
        "K_TIME",
        "K_ENERGY",
    }
