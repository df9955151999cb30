from __future__ import annotations

import math

import pytest

from moar_companion.mavlink.codec import Codec
from moar_companion.mavlink.commands import (
    CommandCancelled,
    CommandLedger,
    CommandResult,
    DeniedCommand,
    MissionCommand,
    PauseContinue,
    Sender,
    UnsupportedCommand,
    interpret,
)
from moar_companion.types import Mission

USER_1 = 31010
PAUSE_CONTINUE = 193
NAN = math.nan


def read(data):
    (message,) = Codec(system_id=9, component_id=9).receive(data)
    return message


def interpreted(data):
    return interpret(read(data), link="radio", system_id=1, component_id=195)


@pytest.mark.parametrize(
    ("number", "mission"),
    [
        (0, "hold"),
        (1, Mission.INSPECTION),
        (2, Mission.EXIT),
        (3, Mission.EVACUATION),
        (4, "release"),
    ],
)
def test_user_1_names_a_mission_in_long_and_int(ground_station, number, mission):
    for data in (
        ground_station.command(USER_1, number, 2),
        ground_station.command_int(USER_1, number, 2),
    ):
        command = interpreted(data)
        assert isinstance(command, MissionCommand)
        assert (command.mission, command.index) == (mission, 2)
        assert command.sender == Sender(link="radio", system_id=255, component_id=190)


@pytest.mark.parametrize("index", [NAN, -1])
def test_no_index_is_all_in_turn(ground_station, index):
    assert interpreted(ground_station.command(USER_1, 1, index)).index is None


@pytest.mark.parametrize("number", [-1, 5, 0.5, NAN, math.inf, -math.inf, 1e30])
def test_a_mission_that_does_not_exist_is_denied(ground_station, number):
    command = interpreted(ground_station.command(USER_1, number))
    assert isinstance(command, DeniedCommand)
    assert "param1" in command.reason


@pytest.mark.parametrize("index", [-2, 0.5, math.inf, -math.inf, 1e9])
def test_an_index_that_is_none_is_denied(ground_station, index):
    command = interpreted(ground_station.command(USER_1, 1, index))
    assert isinstance(command, DeniedCommand)
    assert "param2" in command.reason


def test_pause_and_continue(ground_station):
    assert interpreted(ground_station.command(PAUSE_CONTINUE, 0)).pause is True
    assert interpreted(ground_station.command(PAUSE_CONTINUE, 1)).pause is False
    for number in (2, -1, 0.5, NAN, math.inf):
        command = interpreted(ground_station.command(PAUSE_CONTINUE, number))
        assert isinstance(command, DeniedCommand)


@pytest.mark.parametrize("target", [(1, 195), (0, 195)])
def test_an_unknown_command_to_us_is_unsupported(ground_station, target):
    command = interpreted(ground_station.command(400, 1, target=target))
    assert isinstance(command, UnsupportedCommand)
    assert command.command == 400


@pytest.mark.parametrize("target", [(1, 0), (0, 0)])
def test_of_commands_to_all_only_ours_are_heard(ground_station, target):
    assert isinstance(interpreted(ground_station.command(USER_1, 1, target=target)), MissionCommand)
    assert isinstance(
        interpreted(ground_station.command(PAUSE_CONTINUE, 1, target=target)), PauseContinue
    )
    for number in (400, 511, 1000, 1001, 224, 192):
        assert interpreted(ground_station.command(number, NAN, target=target)) is None


@pytest.mark.parametrize("target", [(1, 1), (1, 191), (2, 195), (2, 0)])
def test_commands_to_others_are_none_of_our_business(ground_station, target):
    assert interpreted(ground_station.command(USER_1, 1, target=target)) is None


@pytest.mark.parametrize("number", [224, 192])
def test_what_belongs_to_the_autopilot_is_unsupported_when_addressed_to_us(ground_station, number):
    assert isinstance(interpreted(ground_station.command(number)), UnsupportedCommand)


class Desk:
    """A ledger with a clock."""

    def __init__(self):
        self.ledger = CommandLedger()
        self.now_s = 100.0

    def receive(self, data, *, link="radio"):
        reception = self.ledger.receive(
            read(data), link=link, system_id=1, component_id=195, now_s=self.now_s
        )
        return reception.event, reception.answer

    def answer(self, command, result, **options):
        return self.ledger.answer(command, result, now_s=self.now_s, **options)


def test_an_answer_goes_to_the_commands_sender(ground_station):
    desk = Desk()
    command, answer = desk.receive(ground_station.command(USER_1, 1))
    assert answer is None
    message = desk.answer(command, CommandResult.ACCEPTED, result_param2=3).message()
    assert (message.command, message.result, message.result_param2) == (USER_1, 0, 3)
    assert (message.target_system, message.target_component) == (255, 190)


def test_what_needs_no_decision_is_answered_at_once(ground_station):
    desk = Desk()
    event, answer = desk.receive(ground_station.command(400))
    assert isinstance(event, UnsupportedCommand)
    assert answer.result is CommandResult.UNSUPPORTED
    event, answer = desk.receive(ground_station.command(USER_1, 9))
    assert isinstance(event, DeniedCommand)
    assert answer.result is CommandResult.DENIED
    assert desk.answer(event, CommandResult.ACCEPTED) is None


def test_a_repeat_while_deciding_is_told_so_and_not_carried_out_twice(ground_station):
    desk = Desk()
    command, _ = desk.receive(ground_station.command(USER_1, 1, NAN))
    desk.now_s += 1.0
    event, answer = desk.receive(ground_station.command(USER_1, 1, NAN, confirmation=1))
    assert event is None
    assert answer.result is CommandResult.IN_PROGRESS
    desk.answer(command, CommandResult.IN_PROGRESS, progress=30)
    event, answer = desk.receive(ground_station.command(USER_1, 1, NAN, confirmation=2))
    assert event is None
    assert (answer.result, answer.progress) == (CommandResult.IN_PROGRESS, 30)


def test_a_repeat_after_the_answer_gets_the_same_answer(ground_station):
    desk = Desk()
    command, _ = desk.receive(ground_station.command(USER_1, 1))
    desk.answer(command, CommandResult.DENIED, result_param2=7)
    desk.now_s += 3.0
    event, answer = desk.receive(ground_station.command(USER_1, 1, confirmation=1))
    assert event is None
    assert (answer.result, answer.result_param2) == (CommandResult.DENIED, 7)


def test_the_same_words_given_again_are_a_new_command(ground_station):
    desk = Desk()
    command, _ = desk.receive(ground_station.command(USER_1, 1))
    desk.answer(command, CommandResult.ACCEPTED)
    event, answer = desk.receive(ground_station.command(USER_1, 1))
    assert isinstance(event, MissionCommand)
    assert answer is None


def test_a_repeat_whose_first_copy_was_lost_is_carried_out(ground_station):
    event, _ = Desk().receive(ground_station.command(USER_1, 1, confirmation=2))
    assert isinstance(event, MissionCommand)


def test_a_second_hold_holds_although_its_first_copy_was_lost(ground_station):
    desk = Desk()
    hold, _ = desk.receive(ground_station.command(USER_1, 0))
    desk.answer(hold, CommandResult.ACCEPTED)
    go_on, _ = desk.receive(ground_station.command(PAUSE_CONTINUE, 1))
    desk.answer(go_on, CommandResult.ACCEPTED)
    event, _ = desk.receive(ground_station.command(USER_1, 0, confirmation=1))
    assert isinstance(event, MissionCommand)
    desk.answer(event, CommandResult.ACCEPTED)
    desk.now_s += 6.0
    event, _ = desk.receive(ground_station.command(USER_1, 0, confirmation=1))
    assert isinstance(event, MissionCommand)


def test_a_command_that_comes_over_two_links_is_carried_out_once(ground_station):
    desk = Desk()
    command, _ = desk.receive(ground_station.command(USER_1, 1), link="radio")
    event, answer = desk.receive(ground_station.command(USER_1, 1), link="network")
    assert event is None
    assert answer.receiver.link == "network"
    desk.answer(command, CommandResult.ACCEPTED)
    event, answer = desk.receive(ground_station.command(USER_1, 1), link="network")
    assert event is None
    assert answer.result is CommandResult.ACCEPTED


def test_a_command_nobody_answers_may_be_given_again(ground_station):
    desk = Desk()
    desk.receive(ground_station.command(USER_1, 0))
    desk.now_s += 11.0
    event, _ = desk.receive(ground_station.command(USER_1, 0))
    assert isinstance(event, MissionCommand)


def test_another_command_of_the_number_ends_the_first_ones_claim_to_an_answer(ground_station):
    desk = Desk()
    first, _ = desk.receive(ground_station.command(USER_1, 1))
    second, _ = desk.receive(ground_station.command(USER_1, 0))
    assert desk.answer(first, CommandResult.ACCEPTED) is None
    assert desk.answer(second, CommandResult.ACCEPTED) is not None
    assert desk.answer(second, CommandResult.FAILED) is None


def test_two_operators_do_not_share_their_answers(peer, ground_station):
    desk = Desk()
    other = peer(254, 190)
    first, _ = desk.receive(ground_station.command(USER_1, 1))
    second, _ = desk.receive(other.command(USER_1, 1))
    assert desk.answer(first, CommandResult.ACCEPTED).receiver.system_id == 255
    assert desk.answer(second, CommandResult.DENIED).receiver.system_id == 254


def test_a_cancel_ends_what_is_in_progress(ground_station):
    desk = Desk()
    command, _ = desk.receive(ground_station.command(USER_1, 1))
    desk.answer(command, CommandResult.IN_PROGRESS, progress=10)
    event, answer = desk.receive(ground_station.cancel(USER_1))
    assert event == CommandCancelled(command=command)
    assert answer.result is CommandResult.CANCELLED
    assert desk.answer(command, CommandResult.ACCEPTED) is None


def test_a_cancel_is_ignored_when_idle(peer, ground_station):
    desk = Desk()
    assert desk.receive(ground_station.cancel(USER_1)) == (None, None)
    command, _ = desk.receive(ground_station.command(USER_1, 1))
    assert desk.receive(ground_station.cancel(USER_1, target=(1, 1))) == (None, None)
    assert desk.receive(ground_station.cancel(USER_1, target=(2, 195))) == (None, None)
    assert desk.receive(peer(254, 190).cancel(USER_1)) == (None, None)
    desk.answer(command, CommandResult.ACCEPTED)
    assert desk.receive(ground_station.cancel(USER_1)) == (None, None)


def test_a_thousand_senders_are_not_all_remembered(peer):
    desk = Desk()
    for number in range(1000):
        event, _ = desk.receive(peer(1 + number % 250, 1 + number // 250).command(USER_1, 1))
        assert isinstance(event, MissionCommand)
    assert len(desk.ledger._remembered) == 64
