"""Permission to command: by ids, by link and by signature; a hold is taken from any sender."""

from __future__ import annotations

import pytest

from moar_companion.mavlink.codec import Codec
from moar_companion.mavlink.commands import CommandResult, DeniedCommand, MissionCommand, Sender
from moar_companion.mavlink.received_commands import Permissions, ReceivedCommands
from moar_companion.settings.config import Commands

from .peer import Peer

USER_1, PAUSE_CONTINUE = 31010, 193
HOLD, INSPECTION, RELEASE = 0, 1, 4


def objection(commands, system_id=255, component_id=190, *, link="radio", signed=False):
    sender = Sender(link=link, system_id=system_id, component_id=component_id)
    return Permissions(commands).objection(sender, vehicle_id=7, signed=signed)


@pytest.mark.parametrize(
    ("system_id", "allowed"),
    [(255, True), (245, True), (240, True), (7, True), (239, False), (1, False), (0, False)],
)
def test_by_default_ground_stations_and_the_vehicle_itself_may_command(system_id, allowed):
    assert (objection(Commands(), system_id) is None) is allowed


def test_configured_systems_replace_the_default_ones():
    commands = Commands(systems=(42,))
    assert objection(commands, 42) is None
    assert objection(commands, 255) == "system 255 may not command (commands.systems)"
    assert objection(commands, 7) == "system 7 may not command (commands.systems)"


def test_a_component_that_is_not_configured_may_not_command():
    commands = Commands(components=(190, 191))
    assert objection(commands, component_id=191) is None
    assert objection(commands, component_id=25).startswith("component 25 may not command")


def test_a_link_that_is_not_configured_may_not_command():
    commands = Commands(links=("network",))
    assert objection(commands, link="network") is None
    assert objection(commands, link="radio").startswith("this link may not command")


def test_with_signed_only_an_unsigned_command_is_denied():
    commands = Commands(signed_only=True)
    assert objection(commands, signed=True) is None
    assert objection(commands).startswith("commands must be signed")
    assert objection(commands, 42, signed=True).startswith("system 42")


def received(ledger, packet, *, link="radio", now_s=0.0, **options):
    (message,) = Codec(system_id=9, component_id=9).receive(packet)
    return ledger.receive(message, link=link, system_id=1, component_id=195, now_s=now_s, **options)


@pytest.mark.parametrize(
    "words", [(USER_1, 1), (USER_1, 2), (USER_1, 3), (USER_1, RELEASE), (PAUSE_CONTINUE, 1)]
)
def test_commands_of_motion_and_release_from_other_systems_are_denied(words):
    reception = received(ReceivedCommands(), Peer(42, 1).command(*words))
    assert isinstance(reception.event, DeniedCommand)
    assert reception.event.reason == "system 42 may not command (commands.systems)"
    assert reception.answer.result is CommandResult.DENIED
    assert reception.answer.receiver == Sender(link="radio", system_id=42, component_id=1)


@pytest.mark.parametrize("words", [(USER_1, HOLD), (PAUSE_CONTINUE, 0)])
def test_a_hold_is_accepted_from_any_sender(words):
    commands = Commands(systems=(255,), components=(190,), links=("cable",), signed_only=True)
    reception = received(ReceivedCommands(commands), Peer(42, 1).command(*words))
    assert not reception.accepted.permitted
    assert reception.answer is None


def test_a_command_counts_as_unsigned_by_default():
    ledger, station = ReceivedCommands(Commands(signed_only=True)), Peer(255, 190)
    refused = received(ledger, station.command(USER_1, INSPECTION))
    assert refused.event.reason == "commands must be signed (commands.signed_only)"
    taken = received(ledger, station.command(USER_1, INSPECTION), signed=True)
    assert isinstance(taken.accepted, MissionCommand)
    assert taken.accepted.permitted


def test_a_cancel_from_a_link_without_permission_is_ignored():
    ledger = ReceivedCommands(Commands(links=("radio",)))
    station = Peer(255, 190)
    assert received(ledger, station.command(USER_1, INSPECTION)).accepted
    elsewhere = received(ledger, station.cancel(USER_1), link="network")
    assert (elsewhere.event, elsewhere.answer) == (None, None)
    assert received(ledger, station.cancel(USER_1)).event


def test_holds_of_other_systems_displace_no_operators_command():
    ledger, station = ReceivedCommands(), Peer(255, 190)
    command = received(ledger, station.command(USER_1, INSPECTION)).accepted
    for number in range(90):
        assert received(ledger, Peer(1 + number, 1).command(USER_1, HOLD)).accepted
    answer = ledger.answer(command, CommandResult.ACCEPTED, now_s=0.0)
    assert answer.receiver == command.sender


def test_holds_of_other_systems_do_not_use_up_an_operators_limit():
    ledger = ReceivedCommands()
    for number in range(1000):
        received(ledger, Peer(1 + number % 239, 1 + number // 239).command(USER_1, HOLD))
    assert received(ledger, Peer(255, 190).command(USER_1, HOLD)).accepted
