"""Repeated, late and duplicated commands, and the answers to their senders."""

from __future__ import annotations

import math

import pytest

from moar_companion.mavlink.codec import Codec
from moar_companion.mavlink.commands import (
    CommandCancelled,
    CommandResult,
    DeniedCommand,
    MissionCommand,
    UnsupportedCommand,
)
from moar_companion.mavlink.received_commands import ReceivedCommands

USER_1 = 31010
PAUSE_CONTINUE = 193
NAN = math.nan


class Desk:
    """A command ledger with a clock."""

    def __init__(self):
        self.ledger = ReceivedCommands()
        self.now_s = 100.0

    def receive(self, data, *, link="radio"):
        (message,) = Codec(system_id=9, component_id=9).receive(data)
        reception = self.ledger.receive(
            message, link=link, system_id=1, component_id=195, now_s=self.now_s
        )
        return reception.accepted or reception.event, reception.answer

    def answer(self, command, result, **options):
        return self.ledger.answer(command, result, now_s=self.now_s, **options)


def test_an_answer_goes_to_the_commands_sender(ground_station):
    desk = Desk()
    command, answer = desk.receive(ground_station.command(USER_1, 1))
    assert answer is None
    message = desk.answer(command, CommandResult.ACCEPTED, result_param2=3).message()
    assert (message.command, message.result, message.result_param2) == (USER_1, 0, 3)
    assert (message.target_system, message.target_component) == (255, 190)


def test_an_invalid_command_is_answered_at_once(ground_station):
    desk = Desk()
    event, answer = desk.receive(ground_station.command(401))
    assert isinstance(event, UnsupportedCommand)
    assert answer.result is CommandResult.UNSUPPORTED
    event, answer = desk.receive(ground_station.command(USER_1, 9))
    assert isinstance(event, DeniedCommand)
    assert answer.result is CommandResult.DENIED
    assert desk.answer(event, CommandResult.ACCEPTED) is None


def test_a_repeat_of_an_open_command_is_answered_in_progress_and_not_repeated(ground_station):
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


def test_the_same_command_after_two_seconds_is_a_new_command(ground_station):
    desk = Desk()
    command, _ = desk.receive(ground_station.command(USER_1, 1))
    desk.answer(command, CommandResult.ACCEPTED)
    desk.now_s += 1.5  # the last of MAVSDK's repeats, which all have confirmation 0
    event, answer = desk.receive(ground_station.command(USER_1, 1))
    assert (event, answer.result) == (None, CommandResult.ACCEPTED)
    desk.now_s += 1.0
    event, answer = desk.receive(ground_station.command(USER_1, 1))
    assert isinstance(event, MissionCommand)
    assert answer is None


def test_a_confirmation_marks_a_repeat_for_30_seconds(ground_station):
    desk = Desk()
    command, _ = desk.receive(ground_station.command(USER_1, 1))
    desk.answer(command, CommandResult.ACCEPTED)
    desk.now_s += 29.0
    event, answer = desk.receive(ground_station.command(USER_1, 1, confirmation=3))
    assert (event, answer.result) == (None, CommandResult.ACCEPTED)
    desk.now_s += 2.0
    event, _ = desk.receive(ground_station.command(USER_1, 1, confirmation=3))
    assert isinstance(event, MissionCommand)


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


@pytest.mark.parametrize("stop", [(USER_1, 0), (USER_1, 4), (PAUSE_CONTINUE, 0)])
def test_every_repeat_of_a_stop_is_carried_out(peer, ground_station, stop):
    desk = Desk()
    first, _ = desk.receive(ground_station.command(*stop))
    desk.answer(first, CommandResult.ACCEPTED)
    go_on, _ = desk.receive(peer(254, 190).command(PAUSE_CONTINUE, 1))
    desk.answer(go_on, CommandResult.ACCEPTED)
    event, answer = desk.receive(ground_station.command(*stop, confirmation=1))
    assert answer is None
    assert event == first


@pytest.mark.parametrize("after_s", [0.6, 5.5, 29.0])
@pytest.mark.parametrize("motion", [(USER_1, 1), (USER_1, 2), (USER_1, 3), (PAUSE_CONTINUE, 1)])
def test_a_repeat_after_a_stop_of_any_operator_is_cancelled(peer, ground_station, motion, after_s):
    for stopper in (ground_station, peer(254, 190)):
        desk = Desk()
        command, _ = desk.receive(ground_station.command(*motion))
        desk.answer(command, CommandResult.ACCEPTED)
        desk.now_s += 0.3
        stop, _ = desk.receive(stopper.command(USER_1, 0))
        desk.answer(stop, CommandResult.ACCEPTED)
        desk.now_s += after_s
        event, answer = desk.receive(ground_station.command(*motion, confirmation=2))
        assert (event, answer.result) == (None, CommandResult.CANCELLED)
        if after_s < 2.0:
            event, answer = desk.receive(ground_station.command(*motion))
            assert (event, answer.result) == (None, CommandResult.CANCELLED)
        desk.now_s += 2.0
        event, _ = desk.receive(ground_station.command(*motion))  # a new command
        assert event == command


def test_a_repeat_after_a_stop_is_cancelled_although_its_first_copies_were_lost(
    peer, ground_station
):
    desk = Desk()
    desk.receive(peer(254, 190).command(USER_1, 0))
    desk.now_s += 20.0
    event, answer = desk.receive(ground_station.command(USER_1, 1, confirmation=1))
    assert (event, answer.result) == (None, CommandResult.CANCELLED)
    event, _ = desk.receive(ground_station.command(USER_1, 1))
    assert isinstance(event, MissionCommand)


def test_a_repeat_after_a_stop_and_a_newer_command_belongs_to_the_newer_command(ground_station):
    desk = Desk()
    desk.receive(ground_station.command(PAUSE_CONTINUE, 0))
    command, _ = desk.receive(ground_station.command(USER_1, 1))
    desk.answer(command, CommandResult.ACCEPTED)
    desk.now_s += 3.0
    event, answer = desk.receive(ground_station.command(USER_1, 1, confirmation=1))
    assert (event, answer.result) == (None, CommandResult.ACCEPTED)


@pytest.mark.parametrize("sent_before", [0, 200, 255])
def test_a_command_that_a_stop_overtakes_is_cancelled(peer, ground_station, sent_before):
    ground_station.skip(sent_before)
    desk = Desk()
    order, stop = ground_station.command(USER_1, 2), ground_station.command(PAUSE_CONTINUE, 0)
    desk.receive(stop)
    desk.now_s += 0.02
    assert desk.receive(peer(254, 190).command(USER_1, 2))[1] is None  # does not know of the stop
    event, answer = desk.receive(order)
    assert (event, answer.result) == (None, CommandResult.CANCELLED)
    event, _ = desk.receive(ground_station.command(USER_1, 2))
    assert isinstance(event, MissionCommand)


def test_commands_of_a_restarted_ground_station_are_accepted(ground_station):
    desk = Desk()
    ground_station.skip(9)
    desk.receive(ground_station.command(USER_1, 0))
    ground_station.restart()
    desk.now_s += 0.4
    event, _ = desk.receive(ground_station.command(USER_1, 2))
    assert isinstance(event, MissionCommand)


def test_each_link_numbers_its_own_packets(ground_station):
    desk = Desk()
    order = ground_station.command(USER_1, 2)
    desk.receive(ground_station.command(USER_1, 0), link="network")
    event, _ = desk.receive(order, link="radio")
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


def test_a_command_whose_decision_takes_long_is_in_progress_when_it_is_given_again(ground_station):
    desk = Desk()
    command, _ = desk.receive(ground_station.command(USER_1, 1))
    for _ in range(5):
        desk.now_s += 11.0
        event, answer = desk.receive(ground_station.command(USER_1, 1))
        assert (event, answer.result) == (None, CommandResult.IN_PROGRESS)
    assert desk.ledger.waiting == [command]


def test_a_newer_command_with_the_same_number_takes_over_the_answer(ground_station):
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


def test_a_cancel_ends_a_command_in_progress(ground_station):
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


def test_the_number_of_remembered_senders_is_limited(peer):
    desk = Desk()
    for number in range(1000):
        desk.now_s += 0.1
        event, _ = desk.receive(peer(240 + number % 16, 1 + number // 16).command(USER_1, 1))
        assert isinstance(event, MissionCommand)
    assert len(desk.ledger._remembered) == 64


@pytest.mark.parametrize("words", [(USER_1, 9), (401, 1), (USER_1, 1)])
def test_a_sender_gets_at_most_twenty_answers_at_once_and_then_two_a_second(
    ground_station, peer, words
):
    desk = Desk()
    command, _ = desk.receive(ground_station.command(USER_1, 1))
    desk.answer(command, CommandResult.DENIED)  # the same command again is a repeat
    received = [desk.receive(ground_station.command(*words)) for _ in range(1000)]
    assert sum(answer is not None for _, answer in received) == 20
    assert all(item == (None, None) for item in received[20:])
    desk.now_s += 0.5
    received = [desk.receive(ground_station.command(*words)) for _ in range(10)]
    assert sum(answer is not None for _, answer in received) == 1
    assert desk.receive(peer(254, 190).command(USER_1, 9))[1] is not None


def test_a_link_has_a_limit_for_all_its_senders(peer):
    desk = Desk()
    senders = [peer(240 + number % 16, 1 + number // 16) for number in range(1000)]
    answers = [desk.receive(sender.command(USER_1, 9))[1] for sender in senders]
    assert sum(answer is not None for answer in answers) == 60
    assert desk.receive(senders[0].command(USER_1, 9), link="network")[1] is not None


def test_commands_beyond_the_limit_are_rejected_and_stops_are_still_taken(ground_station):
    desk = Desk()
    taken = [desk.receive(ground_station.command(USER_1, 1, index)) for index in range(100)]
    assert sum(event is not None for event, _ in taken) == 30
    rejected = [answer.result for event, answer in taken if event is None and answer]
    assert rejected == [CommandResult.TEMPORARILY_REJECTED] * 20
    assert desk.receive(ground_station.command(USER_1, 0))[0] is not None
    assert desk.receive(ground_station.command(PAUSE_CONTINUE, 0))[0] is not None


def test_a_command_waits_until_it_is_executed_answered_or_cancelled(ground_station):
    desk = Desk()
    first, _ = desk.receive(ground_station.command(PAUSE_CONTINUE, 1))
    second, _ = desk.receive(ground_station.command(USER_1, 1))
    assert [command.number for command in desk.ledger.waiting] == [first.number, second.number]
    desk.ledger.note_executed(first, desk.now_s)
    assert desk.ledger.waiting == [second]
    desk.receive(ground_station.cancel(USER_1))
    assert desk.ledger.waiting == []
    assert desk.ledger.open(first.number) == first
    desk.answer(first, CommandResult.ACCEPTED)
    assert (desk.ledger.open(first.number), desk.ledger.open(second.number)) == (None, None)


def test_a_command_without_an_answer_is_in_progress_after_200_ms_and_then_each_second(
    ground_station,
):
    desk = Desk()
    command, _ = desk.receive(ground_station.command(USER_1, 1))
    began_s = desk.now_s
    assert desk.ledger.without_answer(began_s + 0.15) == []
    assert desk.ledger.without_answer(began_s + 0.25) == [command]
    desk.ledger.note_executed(command, began_s + 0.15)
    assert desk.ledger.is_executed(command.number)
    assert desk.ledger.without_answer(began_s + 0.3) == []
    assert desk.ledger.without_answer(began_s + 0.4) == [command]
    desk.answer(command, CommandResult.IN_PROGRESS)
    assert desk.ledger.without_answer(desk.now_s + 0.95) == []
    assert desk.ledger.without_answer(desk.now_s + 1.05) == [command]
    desk.answer(command, CommandResult.ACCEPTED)
    assert desk.ledger.without_answer(desk.now_s + 60.0) == []
