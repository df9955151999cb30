"""Commands as bytes for the whole companion: from several senders, split, broken, at random.

Carried out: the companion recorded an order. Answered: the companion sent a COMMAND_ACK.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ..mavlink.peer import Peer
from .commands import LINKS, OPERATOR_LINK, answers, carried_out, hovering, results
from .desk import (
    ACCEPTED,
    DENIED,
    EVACUATION,
    EXIT,
    HOLD,
    IN_PROGRESS,
    INSPECTION,
    LINK,
    PAUSE_CONTINUE,
    RELEASE,
    TEMPORARILY_REJECTED,
    USER_1,
    Desk,
)

NAN = math.nan
ARM, GIMBAL = 400, 1000

# Correct commands -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("command", "parameter", "order", "result"),
    [
        (USER_1, INSPECTION, "inspection splice-outer", ACCEPTED),
        (USER_1, EXIT, "exit", ACCEPTED),
        (USER_1, EVACUATION, "evacuation", ACCEPTED),
        (USER_1, HOLD, "hold", TEMPORARILY_REJECTED),
        (USER_1, RELEASE, "release", ACCEPTED),
        (PAUSE_CONTINUE, 0, "hold", TEMPORARILY_REJECTED),
        (PAUSE_CONTINUE, 1, "continue", TEMPORARILY_REJECTED),
    ],
)
def test_a_command_as_long_or_int_is_carried_out_once_and_answered_once(
    command, parameter, order, result
):
    for pack in (Peer.command, Peer.command_int):
        desk = hovering()
        desk.handle(pack(desk.operator, command, parameter, 0)).run(0.5)
        assert carried_out(desk) == [order]
        assert answers(desk) == [(LINK, (255, 190), command, result)]
        (ack,) = desk.messages("COMMAND_ACK")
        assert (ack.get_srcSystem(), ack.get_srcComponent()) == (1, 195)


@pytest.mark.parametrize("pack", [Peer.command, Peer.command_int])
@pytest.mark.parametrize(
    ("command", "parameters"),
    [
        (USER_1, (NAN,)),
        (USER_1, (5,)),
        (USER_1, (-1,)),
        (USER_1, (1.5,)),
        (USER_1, (math.inf,)),
        (USER_1, (INSPECTION, 0.5)),
        (USER_1, (INSPECTION, 2)),
        (PAUSE_CONTINUE, (NAN,)),
        (PAUSE_CONTINUE, (2,)),
    ],
)
def test_bad_parameters_are_denied_with_one_text(pack, command, parameters):
    desk = Desk().run(1.2)
    desk.handle(pack(desk.operator, command, *parameters)).run(0.5)
    assert results(desk) == [DENIED]
    assert len([text for text in desk.texts() if text.startswith("MOAR: ")]) == 1
    assert desk.state == "idle"


def test_parameters_that_mean_nothing_here_may_be_nan():
    desk = hovering()
    desk.handle(desk.operator.command(USER_1, RELEASE, *[NAN] * 6)).run(0.1)
    assert (carried_out(desk), results(desk)) == (["release"], [ACCEPTED])


# Senders and addressees -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("target", "command", "result"),
    [
        ((1, 195), RELEASE, ACCEPTED),
        ((1, 0), RELEASE, ACCEPTED),
        ((0, 0), RELEASE, ACCEPTED),
        ((0, 195), RELEASE, ACCEPTED),
        ((1, 195), ARM, DENIED),
        ((0, 195), ARM, DENIED),
        ((1, 0), ARM, None),
        ((0, 0), GIMBAL, None),
        ((1, 1), RELEASE, None),
        ((1, 191), RELEASE, None),
        ((2, 195), RELEASE, None),
        ((2, 0), RELEASE, None),
    ],
)
def test_own_commands_are_answered_on_every_link_others_only_when_they_name_the_companion(
    target, command, result
):
    words = (USER_1, RELEASE) if command == RELEASE else (command, NAN)
    for pack in (Peer.command, Peer.command_int):
        desk = hovering()
        desk.handle(pack(desk.operator, *words, target=target)).run(0.5)
        assert results(desk) == ([] if result is None else [result])
        assert carried_out(desk) == (["release"] if result == ACCEPTED else [])


def test_two_ground_stations_at_once_are_each_answered_and_their_orders_are_two():
    desk, tablet = hovering(), Peer(254, 25)
    desk.handle(desk.operator.command(USER_1, RELEASE) + tablet.command(USER_1, RELEASE)).run(0.5)
    assert carried_out(desk) == ["release", "release"]
    assert answers(desk) == [
        (LINK, (255, 190), USER_1, ACCEPTED),
        (LINK, (254, 25), USER_1, ACCEPTED),
    ]


def test_over_two_links_an_order_is_carried_out_once_and_answered_on_both():
    desk = hovering(plan_delay_s=0.4)
    order = desk.operator.command(USER_1, INSPECTION, -1)
    desk.handle(order).handle(order, OPERATOR_LINK).run(1.0)
    desk.handle(desk.operator.command(USER_1, INSPECTION, -1), OPERATOR_LINK).run(0.5)
    assert len(carried_out(desk)) == len(desk.jobs) == 1
    assert answers(desk) == [
        (OPERATOR_LINK, (255, 190), USER_1, IN_PROGRESS),
        (LINK, (255, 190), USER_1, IN_PROGRESS),
        (LINK, (255, 190), USER_1, ACCEPTED),
        (OPERATOR_LINK, (255, 190), USER_1, ACCEPTED),
    ]


# Split and broken -------------------------------------------------------------------------------


def test_a_command_may_be_split_anywhere():
    desk = hovering()
    size = len(desk.operator.command(USER_1, RELEASE))
    for place in range(1, size):
        packet = desk.operator.command(USER_1, RELEASE)
        desk.handle(packet[:place]).handle(packet[place:]).step()
    assert carried_out(desk) == ["release"] * (size - 1)
    assert results(desk) == [ACCEPTED] * (size - 1)


def test_a_command_may_come_byte_by_byte_with_time_between():
    desk = hovering()
    for byte in desk.operator.command(USER_1, RELEASE):
        desk.handle(bytes([byte]), OPERATOR_LINK).step()
    assert answers(desk) == [(OPERATOR_LINK, (255, 190), USER_1, ACCEPTED)]


def test_a_command_with_a_broken_byte_is_no_command_and_the_next_one_is():
    desk = hovering()
    for place in range(len(desk.operator.command(USER_1, RELEASE))):
        broken = bytearray(desk.operator.command(USER_1, RELEASE))
        broken[place] ^= 0x55
        before = len(answers(desk))
        desk.handle(bytes(broken)).run(0.4)
        assert len(answers(desk)) == before, place
        desk.handle(desk.operator.command(USER_1, RELEASE)).step()
        assert len(answers(desk)) == before + 1, place


# Any behaviour of the network -------------------------------------------------------------------

SENDERS = ((255, 190), (254, 190), (255, 25))
TARGETS = (*[(1, 195)] * 6, (1, 0), (0, 0), (1, 1), (2, 195))
WORDS = (
    (USER_1, HOLD),
    (USER_1, INSPECTION),
    (USER_1, EXIT),
    (USER_1, RELEASE),
    (USER_1, 9),
    (PAUSE_CONTINUE, 0),
    (PAUSE_CONTINUE, 1),
    (ARM, 1),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Arrival:
    """A packet that arrives, how often, and how many steps pass after each."""

    order: int
    lost: bool
    copies: int
    steps: int


@st.composite
def traffic(draw):
    """Orders and their arrival; each order has one sender, one link and its own parameters.

    Repeats of one order stay in order, as they are half a second apart; the rest is shuffled.
    """
    orders = draw(
        st.lists(
            st.tuples(
                st.sampled_from([*[SENDERS[0]] * 4, *SENDERS]),
                st.sampled_from(WORDS),
                st.sampled_from(TARGETS),
                st.sampled_from([LINK, OPERATOR_LINK]),
            ),
            min_size=1,
            max_size=6,
            unique_by=lambda order: order[:2],
        )
    )
    sent = [number for number in range(len(orders)) for _ in range(draw(st.integers(1, 3)))]
    arrivals = [
        Arrival(
            order=number,
            lost=draw(st.sampled_from([False, False, False, True])),
            copies=draw(st.sampled_from([1, 1, 2, 3])),
            steps=draw(st.integers(0, 6)),
        )
        for number in draw(st.permutations(sent))
    ]
    return orders, arrivals


@settings(max_examples=20, deadline=None)
@given(traffic(), st.sampled_from(["idle", "ready", "flying"]))
def test_no_motion_is_repeated_and_every_order_is_answered_to_its_sender_alone(exchange, state):
    """A hold or release may be carried out again: an old one looks like a new one."""
    orders, arrivals = exchange
    desk = Desk(links=LINKS).come_to(state, then_s=2.1)  # what was ordered is no repeat of it
    desk.sent.clear()
    desk.decisions.clear()
    peers = {sender: Peer(*sender) for sender in SENDERS}
    copies = [0] * len(orders)
    asked = set()
    for arrival in arrivals:
        sender, (command, parameter), target, link = orders[arrival.order]
        packet = peers[sender].command(
            command, parameter, -1, target=target, confirmation=copies[arrival.order]
        )
        copies[arrival.order] += 1
        if arrival.lost:
            continue
        for _ in range(arrival.copies):
            desk.handle(packet, link)
            for _ in range(arrival.steps):
                desk.step()
        ours = target in {(1, 195), (0, 0), (1, 0)} and (command != ARM or target[1] == 195)
        if ours:
            asked.add((link, sender, command))
    desk.run(1.0)
    answered = answers(desk)
    assert {(link, sender, command) for link, sender, command, _ in answered} <= asked
    # A station's answer names the command's number alone: its newest order of that number is meant.
    last = {(sender, command): result for _, sender, command, result in answered}
    assert last.keys() == {(sender, command) for _, sender, command in asked}
    assert IN_PROGRESS not in last.values()
    moved = [
        (order["sender"], order["order"].split()[0])
        for order in desk.decided("order")
        if order["order"] not in {"hold", "release"}
    ]
    given_once = [(sender[0], MOTION[words]) for sender, words, *_ in orders if words in MOTION]
    assert all(moved.count(each) <= given_once.count(each) for each in moved)


MOTION = {
    (USER_1, INSPECTION): "inspection",
    (USER_1, EXIT): "exit",
    (PAUSE_CONTINUE, 1): "continue",
}
