"""Commands from operators: COMMAND_LONG, COMMAND_INT and COMMAND_CANCEL to values. No I/O.

| command | param1 | param2 | value |
|---|---|---|---|
| MAV_CMD_USER_1 (31010) | 0 to 4, see `_MISSIONS` | index | MissionCommand |
| MAV_CMD_DO_PAUSE_CONTINUE (193) | 0 pause, 1 continue | | PauseContinue |

Addressed to us, everything is answered, the unknown with UNSUPPORTED. Addressed to component 0,
only these two: both autopilots broadcast commands that are none of our business (PX4 sends
gimbal commands in landing and RTL). What belongs to the autopilot is not in the table, so
DO_SET_MISSION_CURRENT and DO_REPOSITION are answered only when they are addressed to us exactly.

Source: https://mavlink.io/en/services/command.html.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import Literal

from ..types import Mission
from .dialect import Message, create, mavlink

MissionWord = Mission | Literal["hold", "release"]

_MISSIONS: tuple[MissionWord, ...] = (
    "hold",
    Mission.INSPECTION,
    Mission.EXIT,
    Mission.EVACUATION,
    "release",
)
"""By param1 of MAV_CMD_USER_1."""

_MAX_INDEX = 65535
"""No site file has more targets; a float holds such integers exactly."""
_REPEAT_WINDOW_S = 5.0
"""A repeat comes within this of its predecessor: ground stations repeat after 0.5 to 3 s."""
_DECISION_TIMEOUT_S = 10.0
"""A command that nobody has answered for so long may be given anew."""
_MAX_REMEMBERED = 64
_PROGRESS_UNKNOWN = 255


class CommandResult(enum.IntEnum):
    """MAV_RESULT."""

    ACCEPTED = 0
    """Will try."""
    TEMPORARILY_REJECTED = 1
    """Busy or not ready."""
    DENIED = 2
    """A parameter is bad, or what it asks for cannot be."""
    UNSUPPORTED = 3
    FAILED = 4
    IN_PROGRESS = 5
    """A final answer follows."""
    CANCELLED = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class Sender:
    """Who sent a command, and over which of our links."""

    link: str
    system_id: int
    component_id: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Command:
    """A command to us; its parameters 1 to 7, NaN as None."""

    sender: Sender
    command: int
    parameters: tuple[float | None, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionCommand(Command):
    """MAV_CMD_USER_1: awaits an answer."""

    mission: MissionWord
    index: int | None
    """Of the target or landing point, 0-based; None: all targets in turn, any landing point."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PauseContinue(Command):
    """MAV_CMD_DO_PAUSE_CONTINUE: awaits an answer."""

    pause: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class UnsupportedCommand(Command):
    """A command that we do not know; it has been answered."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DeniedCommand(Command):
    """A command with a bad parameter; it has been answered."""

    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandCancelled:
    """COMMAND_CANCEL for a command that had no final answer yet; it has been answered."""

    command: Command


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """A COMMAND_ACK and where it goes."""

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


def interpret(message: Message, *, link: str, system_id: int, component_id: int) -> Command | None:
    """What a COMMAND_LONG or COMMAND_INT asks of us (our ids); None: not for us. Never raises."""
    if message.target_system not in {0, system_id}:
        return None
    if message.target_component not in {0, component_id}:
        return None
    sender = Sender(
        link=link, system_id=message.get_srcSystem(), component_id=message.get_srcComponent()
    )
    command = int(message.command)
    parameters = _parameters(message)
    if command == mavlink.MAV_CMD_USER_1:
        return _mission_command(sender, command, parameters)
    if command == mavlink.MAV_CMD_DO_PAUSE_CONTINUE:
        return _pause_continue(sender, command, parameters)
    if message.target_component == 0:
        return None
    return UnsupportedCommand(sender=sender, command=command, parameters=parameters)


def _parameters(message: Message) -> tuple[float | None, ...]:
    values = [message.param1, message.param2, message.param3, message.param4]
    if message.get_msgId() == mavlink.MAVLINK_MSG_ID_COMMAND_INT:
        values += [message.x, message.y, message.z]
    else:
        values += [message.param5, message.param6, message.param7]
    return tuple(None if math.isnan(value) else value for value in values)


def _mission_command(
    sender: Sender, command: int, parameters: tuple[float | None, ...]
) -> MissionCommand | DeniedCommand:
    number, index = parameters[0], parameters[1]
    if number not in range(len(_MISSIONS)):
        return DeniedCommand(
            sender=sender,
            command=command,
            parameters=parameters,
            reason=f"param1 {_shown(number)} is not a mission (0 to {len(_MISSIONS) - 1})",
        )
    if index == -1:
        index = None
    if index is not None and (not 0 <= index <= _MAX_INDEX or index != int(index)):
        return DeniedCommand(
            sender=sender,
            command=command,
            parameters=parameters,
            reason=f"param2 {_shown(index)} is not an index (0, 1, …; -1: any)",
        )
    return MissionCommand(
        sender=sender,
        command=command,
        parameters=parameters,
        mission=_MISSIONS[int(number or 0)],
        index=None if index is None else int(index),
    )


def _pause_continue(
    sender: Sender, command: int, parameters: tuple[float | None, ...]
) -> PauseContinue | DeniedCommand:
    number = parameters[0]
    if number not in {0, 1}:
        return DeniedCommand(
            sender=sender,
            command=command,
            parameters=parameters,
            reason=f"param1 {_shown(number)} is neither 0 (pause) nor 1 (continue)",
        )
    return PauseContinue(sender=sender, command=command, parameters=parameters, pause=number == 0)


def _shown(value: float | None) -> str:
    return "NaN" if value is None else f"{value:g}"


class _Remembered:
    """The last command of one number from one sender, and how it was answered."""

    __slots__ = ("answer", "answered_s", "command", "heard_s")

    def __init__(self, command: Command, now_s: float) -> None:
        self.command = command
        self.answer: Answer | None = None
        self.heard_s = now_s
        self.answered_s = now_s

    @property
    def open(self) -> bool:
        """Whether the final answer is still to come."""
        return self.answer is None or self.answer.result is CommandResult.IN_PROGRESS


@dataclass(frozen=True, slots=True, kw_only=True)
class Reception:
    """What a received command leads to: an event for the service, an answer for its sender."""

    event: Command | CommandCancelled | None = None
    answer: Answer | None = None


_NOTHING = Reception()


class CommandLedger:
    """Makes repeated commands idempotent, answers what needs no decision, and serves cancels.

    A repeat has the sender and the parameters of a command that is still being decided, or that
    was the sender's last, less than 5 s ago, and comes with a confirmation above 0 or over another
    link. It gets the last answer again and is not carried out twice. After 5 s, or after another
    command, the same words are a new command: an operator's second "hold" must hold.
    """

    def __init__(self) -> None:
        self._remembered: dict[tuple[int, int, int], _Remembered] = {}
        self._last: dict[tuple[int, int], int] = {}

    def receive(
        self, message: Message, *, link: str, system_id: int, component_id: int, now_s: float
    ) -> Reception:
        """Takes a COMMAND_LONG, COMMAND_INT or COMMAND_CANCEL; system_id, component_id: ours."""
        if message.get_msgId() == _COMMAND_CANCEL:
            return self._cancel(message, system_id=system_id, component_id=component_id)
        command = interpret(message, link=link, system_id=system_id, component_id=component_id)
        if command is None:
            return _NOTHING
        sender = command.sender
        ids = (sender.system_id, sender.component_id)
        remembered = self._remembered.get((*ids, command.command))
        if remembered is not None and self._is_repeat(remembered, command, message, now_s):
            remembered.heard_s = now_s
            return Reception(answer=self._again(remembered, sender))
        self._last[ids] = command.command
        if isinstance(command, UnsupportedCommand):
            return Reception(event=command, answer=_answer(command, CommandResult.UNSUPPORTED))
        if isinstance(command, DeniedCommand):
            return Reception(event=command, answer=_answer(command, CommandResult.DENIED))
        self._remember(command, now_s)
        return Reception(event=command)

    def answer(
        self,
        command: Command,
        result: CommandResult,
        *,
        progress: int = 0,
        result_param2: int = 0,
        now_s: float,
    ) -> Answer | None:
        """The answer to a received command; None when it is not due.

        Not due: after its final answer, its cancellation, or another command of that number from
        the same sender, since an acknowledgement names no more than the number.
        """
        sender = command.sender
        slot = (sender.system_id, sender.component_id, command.command)
        remembered = self._remembered.get(slot)
        if remembered is None or remembered.command != command or not remembered.open:
            return None
        remembered.answer = Answer(
            receiver=sender,
            command=command.command,
            result=result,
            progress=progress,
            result_param2=result_param2,
        )
        remembered.answered_s = now_s
        return remembered.answer

    def _is_repeat(
        self, remembered: _Remembered, command: Command, message: Message, now_s: float
    ) -> bool:
        if remembered.command.parameters != command.parameters:
            return False
        if remembered.open:
            return now_s - remembered.answered_s <= _DECISION_TIMEOUT_S
        sender = command.sender
        if self._last.get((sender.system_id, sender.component_id)) != command.command:
            return False
        again = (
            getattr(message, "confirmation", 0) > 0 or sender.link != remembered.command.sender.link
        )
        return again and now_s - remembered.heard_s <= _REPEAT_WINDOW_S

    def _again(self, remembered: _Remembered, sender: Sender) -> Answer:
        last = remembered.answer
        if last is None:
            return Answer(
                receiver=sender,
                command=remembered.command.command,
                result=CommandResult.IN_PROGRESS,
                progress=_PROGRESS_UNKNOWN,
            )
        return Answer(
            receiver=sender,
            command=last.command,
            result=last.result,
            progress=last.progress,
            result_param2=last.result_param2,
        )

    def _remember(self, command: Command, now_s: float) -> None:
        sender = command.sender
        slot = (sender.system_id, sender.component_id, command.command)
        self._remembered.pop(slot, None)
        if len(self._remembered) >= _MAX_REMEMBERED:
            del self._remembered[next(iter(self._remembered))]
        self._remembered[slot] = _Remembered(command, now_s)

    def _cancel(self, message: Message, *, system_id: int, component_id: int) -> Reception:
        """COMMAND_CANCEL by the command's own sender; ignored when nothing is in progress."""
        if message.target_system not in {0, system_id}:
            return _NOTHING
        if message.target_component not in {0, component_id}:
            return _NOTHING
        slot = (message.get_srcSystem(), message.get_srcComponent(), message.command)
        remembered = self._remembered.get(slot)
        if remembered is None or not remembered.open:
            return _NOTHING
        command = remembered.command
        remembered.answer = _answer(command, CommandResult.CANCELLED)
        return Reception(event=CommandCancelled(command=command), answer=remembered.answer)


_COMMAND_CANCEL = 80


def _answer(command: Command, result: CommandResult) -> Answer:
    return Answer(receiver=command.sender, command=command.command, result=result)
