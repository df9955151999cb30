"""Check of plans against the autopilot's offboard-loss action, in the whole companion.

Before the flight, and when a parameter or the home changes in flight.
"""

from __future__ import annotations

from unittest import mock

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as mavlink

from moar_companion.settings.config import LossCheck, Supervision

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

INNER = 1.0
"""The second target."""

# Before the flight ------------------------------------------------------------------------------


@pytest.mark.uncounted
def test_no_mission_starts_before_the_parameters_are_received_or_given_up():
    desk = Desk()
    desk.parameters = {}
    desk.run(1.2).order(INSPECTION).run(0.5)
    assert desk.answers() == [TEMPORARILY_REJECTED]
    assert desk.said("parameters not read yet")
    desk.run(25.0).order(INSPECTION, 0.0).run(0.5)
    assert desk.answers() == [TEMPORARILY_REJECTED] * 2
    assert desk.said(" parameters unread, taken as worst")
    assert desk.said("unread: COM_OBL_RC_ACT and 12 more")
    desk.order(EXIT).run(0.5)
    assert desk.answers()[-1] == ACCEPTED


def test_an_order_at_the_start_waits_for_the_autopilot_and_its_parameters():
    desk = Desk()
    desk.order(INSPECTION).step()
    assert desk.answers() == []
    desk.run(1.0)
    assert desk.answers() == [ACCEPTED]
    assert not desk.said("rejected")


@pytest.mark.uncounted
def test_no_mission_starts_before_the_failsafe_parameters_are_received_or_given_up():
    desk = Desk()
    del desk.parameters["NAV_DLL_ACT"]
    desk.run(1.2).order(INSPECTION).run(0.5)
    assert desk.answers() == [TEMPORARILY_REJECTED]
    assert desk.said("parameters not read yet")
    desk.run(14.0).order(INSPECTION, 0.0).run(0.5)
    assert desk.answers() == [TEMPORARILY_REJECTED] * 2
    assert desk.said("unread: NAV_DLL_ACT")
    desk.parameters["NAV_DLL_ACT"] = 0.0
    desk.run(4.0).order(INSPECTION, 0.0).run(0.5)
    assert desk.answers()[-1] == ACCEPTED


def test_a_parameter_that_is_changed_counts_from_the_next_order_on():
    desk = Desk().come_to("ready")
    desk.order(RELEASE).run(0.6)
    desk.parameters["COM_OBL_RC_ACT"] = 0.0
    desk.report_parameter("COM_OBL_RC_ACT")
    desk.step().order(INSPECTION, 1.0).run(0.5)
    assert desk.answers()[-1] == DENIED
    assert desk.said("PX4 would hit right-middle, denied")


def test_a_flight_with_an_unsafe_offboard_loss_action_holds_until_the_parameter_is_safe():
    desk = Desk().come_to("flying", then_s=2.0)
    desk.parameters["COM_OBL_RC_ACT"] = 7.0
    desk.report_parameter("COM_OBL_RC_ACT")
    desk.run(2.0)
    assert desk.state == "holding"
    assert desk.said("MOAR: PX4 would stop its motors")
    desk.go_on().run(0.5)
    assert (desk.state, desk.answers(PAUSE_CONTINUE)) == ("holding", [DENIED])
    desk.parameters["COM_OBL_RC_ACT"] = 5.0
    desk.report_parameter("COM_OBL_RC_ACT")
    desk.run(2.0).go_on().run(0.5)
    assert desk.state == "flying"


@pytest.mark.parametrize(
    ("mission", "policy"), [(INSPECTION, LossCheck.WARN), (EXIT, LossCheck.REFUSE)]
)
def test_an_unsafe_offboard_loss_action_that_is_not_refused_gives_a_warning_in_flight(
    mission, policy
):
    desk = Desk(supervision=Supervision(loss_action=policy)).come_to("flying", mission, then_s=2.0)
    desk.parameters["COM_OBL_RC_ACT"] = 7.0
    desk.report_parameter("COM_OBL_RC_ACT")
    desk.run(2.0)
    assert desk.state == "flying"
    assert desk.said("MOAR: PX4 would stop its motors")


def test_an_escape_route_is_not_refused_for_its_offboard_loss_action_but_gives_a_warning():
    desk = Desk()
    desk.parameters["COM_OBL_RC_ACT"] = 7.0
    desk.run(1.2).order(INSPECTION).run(0.5)
    assert desk.answers() == [DENIED]
    desk.order(EXIT).run_until("ready")
    assert desk.said("MOAR: PX4 would stop its motors")


@pytest.mark.parametrize("policy", LossCheck)
def test_the_reaction_to_an_unsafe_offboard_loss_action_is_configured(policy):
    desk = Desk(supervision=Supervision(loss_action=policy))
    desk.parameters["COM_OBL_RC_ACT"] = 4.0
    desk.run(1.2).order(INSPECTION, 1.0).run(0.5)
    assert desk.answers() == [DENIED if policy is LossCheck.REFUSE else ACCEPTED]
    assert desk.said("MOAR: PX4 would hit right-lower")
    # The recording has the whole remedy.
    assert "PX4 would hit right-lower (it would land on offboard loss; set COM_OBL_RC_ACT 5)" in {
        text["reason"] for text in desk.decided("text")
    }


# Changes in flight ------------------------------------------------------------------------------


def returning(**config):
    """Flying to the outer splice; after an offboard loss the return is at 12 m, behind it."""
    desk = Desk(**config).set(accuracy_m=0.3)
    desk.parameters.update(COM_OBL_RC_ACT=0.0, RTL_RETURN_ALT=12.0)
    desk.run(1.0).report_home(27.0).run(0.5).order(INSPECTION, 0.0).run_until("ready")
    return desk.run(1.1).send_heartbeat(desk.ours).run_until("flying", 0.1).run(2.0)


@pytest.mark.slow
def test_a_home_that_moves_behind_the_conductors_in_flight_is_held():
    words = "MOAR: PX4 would hit right-middle, holding"
    desk = returning()
    desk.report_home(26.5).run(2.0)  # so little that the route is the same
    assert desk.state == "flying"
    desk.report_home(0.0).run(1.0)
    assert desk.state == "holding"
    assert desk.said(words)
    desk.report_home(27.0).run_until("flying", 4.0).run_until("at_target", 60.0)


@pytest.mark.uncounted
def test_a_hold_for_obstacles_that_have_become_wider_ends_when_they_are_narrower():
    desk = Desk().set(accuracy_m=0.3)
    desk.parameters.update(COM_OBL_RC_ACT=0.0, RTL_RETURN_ALT=4.0)
    desk.run(1.0).report_home(24.5).run(0.5).order(INSPECTION, 0.0).run_until("ready")
    desk.run(1.1).send_heartbeat(desk.ours).run_until("flying", 0.1).run(2.0)
    desk.set(accuracy_m=1.3).run_until("holding", 3.0)
    assert desk.said("MOAR: PX4 would hit right-middle, holding")
    desk.set(accuracy_m=0.3).run_until("flying", 8.0)


def test_a_hold_for_the_offboard_loss_action_ends_even_after_an_insufficient_change():
    desk = Desk().come_to("flying", then_s=2.0)
    desk.order(INSPECTION, INNER).run(1.0)
    desk.set_parameters(COM_OBL_RC_ACT=7.0).run_until("holding", 1.0)
    desk.set_parameters(COM_OBL_RC_ACT=4.0).run(3.0)  # a landing at the present place is free
    assert desk.said("MOAR: resuming")
    assert desk.said("MOAR: PX4 would hit right-lower, holding")
    assert desk.state == "holding"
    desk.set_parameters(COM_OBL_RC_ACT=5.0).run_until("flying", 4.0)


def test_an_unsafe_home_that_only_gives_a_warning_does_not_hold_the_flight():
    desk = returning(supervision=Supervision(loss_action=LossCheck.WARN))
    desk.report_home(0.0).run(1.0)
    assert desk.state == "flying"
    assert desk.said("MOAR: PX4 would hit right-middle")


def test_a_parameter_that_becomes_unsafe_during_a_hold_is_reported_at_once():
    desk = Desk().come_to("flying", then_s=2.0).pause().run(2.0)
    desk.parameters["COM_OBL_RC_ACT"] = 7.0
    desk.report_parameter("COM_OBL_RC_ACT")
    desk.run(0.1)
    assert desk.state == "holding"
    assert desk.said("MOAR: PX4 would stop its motors")
    desk.run(1.0).go_on().run(0.5)
    assert (desk.state, desk.answers(PAUSE_CONTINUE)[-1]) == ("holding", DENIED)


def test_in_a_hold_only_an_offboard_loss_at_the_present_place_counts():
    """A landing at the present place is free, but not from every place ahead."""
    desk = Desk().come_to("flying", then_s=2.0)
    desk.order(INSPECTION, INNER).run(1.0).pause().run(2.0)
    desk.parameters["COM_OBL_RC_ACT"] = 4.0
    desk.report_parameter("COM_OBL_RC_ACT")
    desk.run(1.0)
    assert not desk.said("PX4 would")
    desk.go_on().run(0.5)
    assert (desk.state, desk.answers(PAUSE_CONTINUE)[-1]) == ("holding", DENIED)
    assert desk.said("MOAR: PX4 would hit right-lower")


def test_a_plan_that_is_refused_in_flight_keeps_the_flown_one_unless_that_is_no_better():
    desk = Desk().come_to("flying", then_s=2.0)
    survival = desk.companion.state.routes.limits.offboard_loss
    objections = ["it would land on a roof", None]
    with mock.patch.object(survival, "_objection_to", side_effect=objections):
        for _ in range(400):
            if desk.step().said(", path kept"):
                break
    assert desk.said("MOAR: it would land on a roof, path kept")
    assert desk.run(0.5).state == "flying"
    with mock.patch.object(survival, "_objection_to", return_value="it would land on a roof"):
        desk.run_until("holding", 8.0)
    assert desk.said("MOAR: it would land on a roof, holding")


# Failsafes --------------------------------------------------------------------------------------


def watched(desk, seconds):
    """Runs with a ground station, whose loss the autopilot can detect."""
    for _ in range(round(seconds)):
        desk.handle(desk.operator.pack(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))).run(
            1.0
        )
    return desk


def test_a_failsafe_that_refuses_the_flown_inspection_holds_it_until_the_failsafe_is_changed(
    monkeypatch,
):
    # Between the circuits the loss of GPS alone refuses the plan.
    protected = "moar_companion.companion.offboard_loss_check.unprotected"
    monkeypatch.setattr(protected, lambda *given: np.zeros(len(given[-1]), dtype=np.bool_))
    desk = watched(Desk(supervision=Supervision(failsafe_action=LossCheck.REFUSE)), 2)
    desk.order(INSPECTION, INNER).run_until("ready").run(1.1).send_heartbeat(desk.ours)
    watched(desk.run_until("flying", 0.1), 2).set_parameters(NAV_DLL_ACT=3.0)
    watched(desk, 1).set_parameters(COM_OBL_RC_ACT=7.0)
    assert watched(desk, 2).state == "holding"
    desk.set_parameters(COM_OBL_RC_ACT=5.0)
    watched(desk, 10)
    refusals = [text for text in desk.texts() if "GCS loss: landing hits" in text]
    assert (desk.state, len(refusals)) == ("holding", 1)
    desk.set_parameters(NAV_DLL_ACT=0.0)
    assert watched(desk, 4).state == "flying"


def test_failsafes_that_change_in_flight_cause_one_new_plan():
    desk = watched(Desk(), 2)
    desk.order(INSPECTION, INNER).run_until("ready").run(1.1).send_heartbeat(desk.ours)
    watched(desk.run_until("flying", 0.1), 1).set_parameters(NAV_DLL_ACT=3.0)
    watched(desk, 2)
    reasons = [decision.data["reason"] for decision in desk.decisions if decision.kind == "replan"]
    assert reasons.count("the autopilot's failsafes are others") == 1


@pytest.mark.parametrize("mission", [INSPECTION, EXIT])
def test_the_end_of_a_stay_at_a_target_is_reported_unless_an_exit_is_flown(mission):
    desk = Desk().come_to("flying", mission)
    watch = desk.companion.state.routes.limits.watch
    with mock.patch.object(watch, "note", return_value="GCS loss hits wire, exit in 9 s"):
        desk.run(0.1)
    assert desk.said("GCS loss hits wire, exit in 9 s") is (mission == INSPECTION)
