"""Commands from operators: COMMAND_LONG, COMMAND_INT and COMMAND_CANCEL to values. No I/O.

MAV_CMD_USER_1 (31010), a `MissionCommand`, and MAV_CMD_DO_PAUSE_CONTINUE (193), a `PauseContinue`:
param1 by `ORDERS`; param2 of the first is the index.

Commands about messages (MAV_CMD_REQUEST_MESSAGE and its like), a `MessageCommand`, are answered by
the services of the component. Commands that fly the aircraft are the autopilot's: one that reaches
the companion by mistake, as after `set target_component 195`, is denied with a text that names
their receiver. (SET_MODE has no target component, so it is always the autopilot's.)

The companion answers every command addressed to it, unknown ones with UNSUPPORTED. Of commands to
component 0 it answers only its orders, and requests of its messages. Both autopilots broadcast
commands for other components (PX4 sends gimbal commands in landing and RTL).

Source: https://mavlink.io/en/services/command.html.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, field
from typing import Literal, TypedDict

from ..texts import pilot_texts
from ..types import Mission
from .dialect import Message, create, mavlink

MissionWord = Mission | Literal["hold", "release"]

_MISSIONS: tuple[MissionWord, ...] = (
    "hold", Mission.INSPECTION, Mission.EXIT, Mission.EVACUATION, "release"
)  # fmt: skip
"""Orders by param1 of MAV_CMD_USER_1."""
_MISSION, _PAUSE = int(mavlink.MAV_CMD_USER_1), int(mavlink.MAV_CMD_DO_PAUSE_CONTINUE)
ORDERS: dict[str, tuple[int, float]] = {
    **{
        str(getattr(word, "value", word)): (_MISSION, float(at))
        for at, word in enumerate(_MISSIONS)
    },
    "pause": (_PAUSE, 0.0),
    "continue": (_PAUSE, 1.0),
}
"""Command and its param1, by the order's word; `service/mqtt/payloads` has the same words."""
ORDER_MEANINGS = {
    "hold": "Stop, and hold here",
    "inspection": "Inspect the targets, and hold at the last",
    "exit": "Fly to a landing point of the exit",
    "evacuation": "Fly to a landing point of the evacuation",
    "release": "End the setpoint stream: the autopilot acts as after a companion failure",
    "pause": "Stop, and hold here",
    "continue": "Fly the rest of the held or interrupted mission",
}
"""One line for operators, by the order's word."""
INDEX_MEANING = (
    "number of the target or of the landing point, from 0; -1: all targets in turn, any landing "
    "point"
)
"""Param2 of MAV_CMD_USER_1."""

MESSAGE_COMMANDS = frozenset(
    {
        int(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL),
        int(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL),
        int(mavlink.MAV_CMD_REQUEST_MESSAGE),
        int(mavlink.MAV_CMD_REQUEST_PROTOCOL_VERSION),
        int(mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES),
    }
)
"""Commands about what the companion sends."""
_OF_AUTOPILOT = {
    int(mavlink.MAV_CMD_DO_SET_MODE): "mode",
    int(mavlink.MAV_CMD_COMPONENT_ARM_DISARM): "arming",
    int(mavlink.MAV_CMD_NAV_TAKEOFF): "takeoff",
    int(mavlink.MAV_CMD_NAV_LAND): "landing",
    int(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH): "return",
    int(mavlink.MAV_CMD_DO_REPOSITION): "position",
    int(mavlink.MAV_CMD_MISSION_START): "mission",
}
"""Commands that fly the aircraft, with a word for texts."""

_MAX_INDEX = 65535
"""Greatest index: no site file has more targets, and a float holds such integers exactly."""


class CommandResult(enum.IntEnum):
    """MAV_RESULT."""

    ACCEPTED = 0
    """The companion will try."""
    TEMPORARILY_REJECTED = 1
    """Busy or not ready."""
    DENIED = 2
    """A parameter is invalid, or the request is impossible."""
    UNSUPPORTED = 3
    FAILED = 4
    IN_PROGRESS = 5
    """A final answer follows."""
    CANCELLED = 6


RESULT_NAMES = {result.value: result.name for result in CommandResult}


def result_words(result: int) -> str:
    """A MAV_RESULT as text: `temporarily rejected`; `result 9` where it has no name here."""
    return RESULT_NAMES.get(result, f"result {result}").lower().replace("_", " ")


@dataclass(frozen=True, slots=True, kw_only=True)
class Sender:
    """Sender of a command, and the companion's link that received it."""

    link: str
    system_id: int
    component_id: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Command:
    """Command to the companion; its parameters 1 to 7, NaN as None."""

    sender: Sender
    command: int
    parameters: tuple[float | None, ...]
    permitted: bool = True
    """True if its sender may command; holds and pauses are accepted from any sender."""
    number: int = field(default=0, compare=False)
    """Identity among the accepted commands of this process, from 1; 0: not accepted."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionCommand(Command):
    """MAV_CMD_USER_1; its answer is awaited."""

    mission: MissionWord
    index: int | None
    """Index of the target or landing point, 0-based; None: all targets in turn, any point."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PauseContinue(Command):
    """MAV_CMD_DO_PAUSE_CONTINUE; its answer is awaited."""

    pause: bool


def stops(command: Command) -> bool:
    """Returns True for a command that ends motion: a repeat of it is harmless."""
    return holds(command) or (isinstance(command, MissionCommand) and command.mission == "release")


def is_request(command: Command) -> bool:
    """Returns True for a command that changes nothing, neither the flight nor what is sent."""
    sets = command.command == int(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL)
    return isinstance(command, MessageCommand) and not sets


def holds(command: Command) -> bool:
    """Returns True for a hold or a pause.

    Not for a release: once setpoints end, the autopilot may return, with a climb.
    """
    if isinstance(command, PauseContinue):
        return command.pause
    return isinstance(command, MissionCommand) and command.mission == "hold"


@dataclass(frozen=True, slots=True, kw_only=True)
class UnsupportedCommand(Command):
    """Unknown command; already answered."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DeniedCommand(Command):
    """Command with an invalid parameter, or of a sender that may not command; already answered."""

    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class MessageCommand(Command):
    """Command about the companion's messages; the services of the component answer it."""

    to_all: bool
    """True if it is addressed to all components."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandCancelled:
    """COMMAND_CANCEL for a command without a final answer; already answered."""

    command: Command


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandAnswer:
    """COMMAND_ACK and its receiver."""

    receiver: Sender
    command: int
    result: CommandResult
    progress: int = 0
    result_param2: int = 0

    def message(self) -> Message:
        """COMMAND_ACK, addressed to the sender of the command."""
        return create(
            "COMMAND_ACK",
            command=self.command,
            result=int(self.result),
            progress=self.progress,
            result_param2=self.result_param2,
            target_system=self.receiver.system_id,
            target_component=self.receiver.component_id,
        )


def interpret(
    message: Message, *, link: str, system_id: int, component_id: int
) -> MissionCommand | PauseContinue | MessageCommand | UnsupportedCommand | DeniedCommand | None:
    """Returns the command of a COMMAND_LONG or COMMAND_INT; None: other addressee. Never raises.

    system_id, component_id: the companion's.
    """
    if message.target_system not in {0, system_id}:
        return None
    if message.target_component not in {0, component_id}:
        return None
    given = _Given(
        sender=Sender(
            link=link, system_id=message.get_srcSystem(), component_id=message.get_srcComponent()
        ),
        command=int(message.command),
        parameters=_parameters(message),
    )
    if message.command == _MISSION:
        return _mission_command(given)
    if message.command == _PAUSE:
        return _pause_continue(given)
    to_all = message.target_component == 0
    if message.command in MESSAGE_COMMANDS:
        return MessageCommand(**given, to_all=to_all)
    if to_all:
        return None
    if message.command in _OF_AUTOPILOT:
        reason = pilot_texts.FOR_AUTOPILOT(
            kind=_OF_AUTOPILOT[message.command], detail="the autopilot"
        )
        return DeniedCommand(**given, reason=reason)
    return UnsupportedCommand(**given)


class _Given(TypedDict):
    """Fields that all commands have."""

    sender: Sender
    command: int
    parameters: tuple[float | None, ...]


def _parameters(message: Message) -> tuple[float | None, ...]:
    values = [message.param1, message.param2, message.param3, message.param4]
    if message.get_msgId() == mavlink.MAVLINK_MSG_ID_COMMAND_INT:
        values += [message.x, message.y, message.z]
    else:
        values += [message.param5, message.param6, message.param7]
    return tuple(None if math.isnan(value) else value for value in values)


def _mission_command(given: _Given) -> MissionCommand | DeniedCommand:
    number, index = given["parameters"][:2]
    if number not in range(len(_MISSIONS)):
        detail = f"0 to {len(_MISSIONS) - 1}"
        reason = pilot_texts.NO_MISSION(value=_shown(number), detail=detail)
        return DeniedCommand(**given, reason=reason)
    if index == -1:
        index = None
    if index is not None and (not 0 <= index <= _MAX_INDEX or index != int(index)):
        reason = pilot_texts.NO_INDEX(value=_shown(index), detail="0, 1, …; -1: any")
        return DeniedCommand(**given, reason=reason)
    mission = _MISSIONS[int(number or 0)]
    return MissionCommand(**given, mission=mission, index=None if index is None else int(index))


def _pause_continue(given: _Given) -> PauseContinue | DeniedCommand:
    number = given["parameters"][0]
    if number not in {0, 1}:
        detail = "0: pause, 1: continue"
        reason = pilot_texts.NO_PAUSE(value=_shown(number), detail=detail)
        return DeniedCommand(**given, reason=reason)
    return PauseContinue(**given, pause=number == 0)


def _shown(value: float | None) -> str:
    return "NaN" if value is None else f"{value:.2g}" if abs(value) > 9_999.0 else f"{value:.5g}"
