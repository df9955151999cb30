from __future__ import annotations

import math

import pytest

from moar_companion.mavlink.codec import Codec
from moar_companion.mavlink.commands import (
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
def test_a_command_without_an_index_is_for_all_targets_in_turn(ground_station, index):
    assert interpreted(ground_station.command(USER_1, 1, index)).index is None


@pytest.mark.parametrize("number", [-1, 5, 0.5, NAN, math.inf, -math.inf, 1e30])
def test_a_mission_that_does_not_exist_is_denied(ground_station, number):
    command = interpreted(ground_station.command(USER_1, number))
    assert isinstance(command, DeniedCommand)
    assert "param1" in command.reason


@pytest.mark.parametrize("index", [-2, 0.5, math.inf, -math.inf, 1e9])
def test_an_invalid_index_is_denied(ground_station, index):
    command = interpreted(ground_station.command(USER_1, 1, index))
    assert isinstance(command, DeniedCommand)
    assert "param2" in command.reason


def test_do_pause_continue_is_read_and_other_values_are_denied(ground_station):
    assert interpreted(ground_station.command(PAUSE_CONTINUE, 0)).pause is True
    assert interpreted(ground_station.command(PAUSE_CONTINUE, 1)).pause is False
    for number in (2, -1, 0.5, NAN, math.inf):
        command = interpreted(ground_station.command(PAUSE_CONTINUE, number))
        assert isinstance(command, DeniedCommand)


@pytest.mark.parametrize("target", [(1, 195), (0, 195)])
def test_an_unknown_command_to_the_companion_is_unsupported(ground_station, target):
    command = interpreted(ground_station.command(401, 1, target=target))
    assert isinstance(command, UnsupportedCommand)
    assert command.command == 401


@pytest.mark.parametrize("target", [(1, 0), (0, 0)])
def test_of_broadcast_commands_only_the_companions_are_taken(ground_station, target):
    assert isinstance(interpreted(ground_station.command(USER_1, 1, target=target)), MissionCommand)
    assert isinstance(
        interpreted(ground_station.command(PAUSE_CONTINUE, 1, target=target)), PauseContinue
    )
    for number in (400, 401, 1000, 1001, 224, 192):
        assert interpreted(ground_station.command(number, NAN, target=target)) is None


@pytest.mark.parametrize("target", [(1, 1), (1, 191), (2, 195), (2, 0)])
def test_commands_to_other_components_are_ignored(ground_station, target):
    assert interpreted(ground_station.command(USER_1, 1, target=target)) is None


def test_a_command_about_a_mission_addressed_to_the_companion_is_unsupported(ground_station):
    assert isinstance(interpreted(ground_station.command(224)), UnsupportedCommand)


@pytest.mark.parametrize("number", [20, 21, 22, 176, 192, 300, 400])
def test_a_command_that_flies_the_aircraft_is_denied(ground_station, number):
    for data in (ground_station.command(number), ground_station.command_int(number)):
        command = interpreted(data)
        assert isinstance(command, DeniedCommand)
        assert "commands go to component 1" in command.reason
