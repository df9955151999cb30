"""Commands as bytes for the whole companion: lost, doubled, late, cancelled.

Carried out: the companion recorded an order. Answered: the companion sent a COMMAND_ACK.
"""

from __future__ import annotations

import pytest

from ..mavlink.peer import Peer
from .commands import carried_out, hovering, results
from .desk import (
    ACCEPTED,
    CANCELLED,
    DENIED,
    EVACUATION,
    EXIT,
    HOLD,
    IN_PROGRESS,
    INSPECTION,
    PAUSE_CONTINUE,
    RELEASE,
    UNSUPPORTED,
    USER_1,
    Desk,
)

# Lost, doubled, late ----------------------------------------------------------------------------


def test_an_order_whose_answers_are_lost_is_carried_out_once_and_answered_each_time():
    desk = hovering()
    for confirmation in range(4):
        desk.handle(desk.operator.command(USER_1, INSPECTION, -1, confirmation=confirmation)).run(
            1.0
        )
    assert len(carried_out(desk)) == len(desk.jobs) == 1
    assert results(desk) == [ACCEPTED] * 4


def test_an_order_whose_first_copies_are_lost_is_carried_out():
    desk = hovering()
    desk.handle(desk.operator.command(USER_1, INSPECTION, -1, confirmation=2)).run(0.5)
    assert (desk.state, results(desk)) == ("ready", [ACCEPTED])


@pytest.mark.parametrize("after_s", [0.0, 0.04, 0.2, 0.4])
def test_a_packet_that_the_network_doubles_is_one_order(after_s):
    desk = hovering()
    packet = desk.operator.command(USER_1, RELEASE)
    desk.handle(packet).run(after_s).handle(packet).run(0.5)
    assert (carried_out(desk), results(desk)) == (["release"], [ACCEPTED])


def test_a_doubled_continue_does_not_undo_the_pause_that_came_between():
    desk = Desk().come_to("flying").pause().run(1.0)
    go_on = desk.operator.command(PAUSE_CONTINUE, 1)
    desk.handle(go_on).run(0.1).pause().run(0.1).handle(go_on).run(2.0)
    assert desk.state == "holding"
    assert carried_out(desk)[-3:] == ["hold", "continue", "hold"]


def test_the_same_order_given_again_is_a_new_one():
    desk = hovering()
    for _ in range(2):
        desk.handle(desk.operator.command(USER_1, RELEASE)).run(0.1)
    assert (carried_out(desk), results(desk)) == (["release"] * 2, [ACCEPTED] * 2)


@pytest.mark.parametrize("stop", [(PAUSE_CONTINUE, 0), (USER_1, HOLD)])
@pytest.mark.parametrize("motion", [(USER_1, INSPECTION, -1), (USER_1, EVACUATION, -1)])
def test_an_old_repeat_of_a_mission_does_not_undo_a_hold(motion, stop):
    desk = Desk().come_to("flying")
    desk.handle(desk.operator.command(*motion)).run(1.0)
    desk.handle(desk.operator.command(*stop)).run(1.0)
    jobs = len(desk.jobs)
    for confirmation in (1, 2):
        desk.handle(desk.operator.command(*motion, confirmation=confirmation)).run(1.0)
    assert (desk.state, len(desk.jobs)) == ("holding", jobs)
    assert results(desk)[-2:] == [CANCELLED, CANCELLED]
    desk.handle(desk.operator.command(*motion)).run(1.0)  # a new order
    assert (desk.state, results(desk)[-1]) == ("flying", ACCEPTED)


def test_an_old_repeat_of_continue_does_not_undo_a_pause():
    desk = Desk().come_to("flying").pause().run(1.0).go_on().run(0.5).pause().run(0.5)
    desk.handle(desk.operator.command(PAUSE_CONTINUE, 1, -1, confirmation=1)).run(1.0)
    assert (desk.state, results(desk)[-1]) == ("holding", CANCELLED)


def test_an_old_repeat_of_a_pause_pauses():
    desk = Desk().come_to("flying").pause().run(0.5).go_on().run(0.5)
    desk.handle(desk.operator.command(PAUSE_CONTINUE, 0, -1, confirmation=1)).run(0.5)
    assert (desk.state, results(desk)[-1]) == ("holding", ACCEPTED)


def test_a_late_repeat_of_an_order_whose_answer_was_lost_does_not_undo_a_pause():
    desk = Desk().come_to("flying", then_s=1.0)
    desk.order(EXIT).run(1.0).pause().run(4.5)
    desk.handle(desk.operator.command(USER_1, EXIT, -1, confirmation=2)).run(1.0)
    assert (desk.state, results(desk)[-1]) == ("holding", CANCELLED)


def test_a_packet_that_comes_again_late_does_not_undo_a_pause():
    desk = Desk().come_to("flying", then_s=1.0)
    order = desk.operator.command(USER_1, EXIT, -1)
    desk.handle(order).run(0.4).pause().run(0.6).handle(order).run(1.0)
    assert (desk.state, results(desk)[-1]) == ("holding", CANCELLED)


def test_an_order_does_not_undo_the_pause_that_overtook_it():
    desk = Desk().come_to("flying", then_s=1.0)
    order = desk.operator.command(USER_1, EXIT, -1)
    desk.pause().run(0.02).handle(order).run(1.0)
    assert (desk.state, results(desk)[-1]) == ("holding", CANCELLED)


@pytest.mark.parametrize("confirmation", [0, 1])
def test_a_repeat_does_not_undo_another_ground_stations_hold(confirmation):
    desk, tablet = Desk().come_to("flying", then_s=1.0), Peer(254, 190)
    desk.order(EXIT).run(0.3).order(HOLD, peer=tablet).run(0.3)
    desk.handle(desk.operator.command(USER_1, EXIT, -1, confirmation=confirmation)).run(1.0)
    assert (desk.state, results(desk)[-1]) == ("holding", CANCELLED)


def test_a_repeated_hold_ends_the_flight_that_another_ground_station_continued():
    desk, tablet = Desk().come_to("flying", then_s=1.0), Peer(254, 190)
    desk.order(HOLD).run(1.0).handle(tablet.command(PAUSE_CONTINUE, 1)).run(1.0)
    assert desk.state == "flying"
    desk.handle(desk.operator.command(USER_1, HOLD, -1, confirmation=1)).run(1.0)
    assert (desk.state, results(desk)[-1]) == ("holding", ACCEPTED)


@pytest.mark.parametrize(("orders", "state"), [((0, 1), "flying"), ((1, 0), "holding")])
def test_pause_and_continue_count_as_they_arrive(orders, state):
    desk = Desk().come_to("flying").pause().run(1.0)
    for parameter in orders:
        desk.handle(desk.operator.command(PAUSE_CONTINUE, parameter))
    desk.run(1.0)
    assert desk.state == state


def test_an_unsupported_command_in_between_makes_no_repeat_old():
    desk = hovering()
    desk.handle(desk.operator.command(USER_1, INSPECTION, -1)).run(0.5)
    desk.handle(desk.operator.command(512, 259)).handle(desk.operator.command(USER_1, 7)).run(0.5)
    desk.handle(desk.operator.command(USER_1, INSPECTION, -1, confirmation=1)).run(0.5)
    assert results(desk) == [ACCEPTED, UNSUPPORTED, DENIED, ACCEPTED]
    assert len(desk.jobs) == 1


# Cancelled --------------------------------------------------------------------------------------


def test_an_order_is_cancelled_once_and_its_repeat_does_not_restore_it():
    desk = hovering(plan_delay_s=None)
    desk.handle(desk.operator.command(USER_1, INSPECTION, -1)).step()
    packet = desk.operator.cancel(USER_1)
    desk.handle(packet).step().handle(packet).step().handle(desk.operator.cancel(USER_1)).step()
    desk.handle(desk.operator.command(USER_1, INSPECTION, -1, confirmation=1)).run(1.0)
    assert (desk.state, results(desk)) == ("idle", [CANCELLED, CANCELLED])
    assert len(desk.jobs) == 1


def test_an_order_is_cancelled_only_by_its_sender_with_its_command_and_target():
    desk, tablet = hovering(plan_delay_s=0.3), Peer(254, 190)
    desk.handle(desk.operator.command(USER_1, INSPECTION, -1)).step()
    desk.handle(tablet.cancel(USER_1)).handle(desk.operator.cancel(PAUSE_CONTINUE))
    for target in ((1, 1), (2, 195), (2, 0)):
        desk.handle(desk.operator.cancel(USER_1, target=target))
    desk.run(1.0)
    desk.handle(desk.operator.cancel(USER_1)).run(0.5)  # too late
    assert (desk.state, results(desk)) == ("ready", [IN_PROGRESS, ACCEPTED])
