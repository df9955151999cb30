"""The memory of commands: what is carried out of those that come twice, late or doubled. No I/O.

Inputs: packets with commands and cancels, and the service's decisions; output: events for the
service and answers for the senders.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import takewhile

from ..config import Commands
from .commands import (
    Answer,
    Command,
    CommandCancelled,
    CommandResult,
    DeniedCommand,
    Sender,
    UnsupportedCommand,
    holds,
    interpret,
    stops,
)
from .dialect import Message
from .limits import SenderLimit
from .permissions import Permissions

_REPEATS_S = 30.0
"""How long a command may be repeated with a confirmation above 0: QGroundControl takes 9 s."""
_DETOUR_S = 5.0
"""A copy over another link comes within this."""
_SOON_S = 2.0
"""MAVSDK's repeats, all with confirmation 0, come within this: it takes 1.5 s."""
_OVERTAKEN_S = 0.05
"""Networks change the order of packets by less. A ground station sends fewer than 128 packets in it
and is not started anew, as a shell's next command is: their numbers tell the order."""
_DOUBLED_S = 0.5
"""The network's own copies of a packet come within milliseconds of it."""
_DECISION_TIMEOUT_S = 10.0
"""A command that nobody has answered for so long may be given anew."""
_MAX_REMEMBERED = 64
_PROGRESS_UNKNOWN = 255
_COMMAND_CANCEL = 80

_Key = tuple[int, int, int, tuple[float | None, ...]]
"""The sender's ids, the command's number and its parameters."""


def _key(command: Command) -> _Key:
    sender = command.sender
    return sender.system_id, sender.component_id, command.command, command.parameters


class _Remembered:
    """A command from one sender, its packet's number, and its last answer."""

    __slots__ = ("answer", "answered_s", "command", "given_s", "sequence")

    def __init__(self, command: Command, sequence: int, now_s: float) -> None:
        self.command = command
        self.sequence = sequence
        self.answer = _answer(command, CommandResult.IN_PROGRESS, progress=_PROGRESS_UNKNOWN)
        self.given_s = self.answered_s = now_s

    @property
    def open(self) -> bool:
        """Whether the final answer is still to come."""
        return self.answer.result is CommandResult.IN_PROGRESS

    def is_awaited(self, now_s: float) -> bool:
        """Whether its final answer will come yet."""
        return self.open and now_s - self.answered_s <= _DECISION_TIMEOUT_S

    def is_repeat(self, sender: Sender, now_s: float, *, says_so: bool) -> bool:
        """Whether its words, come again now, repeat it; says_so: by their confirmation."""
        soon_s = _SOON_S if sender == self.command.sender else _DETOUR_S
        return now_s - self.given_s <= (_REPEATS_S if says_so else soon_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class Reception:
    """What a received command leads to: an event for the service, an answer for its sender."""

    event: Command | CommandCancelled | None = None
    answer: Answer | None = None


_NOTHING = Reception()


def _answer_limit() -> SenderLimit:
    """Of answers that need no decision, and their texts: 90 bytes each.

    Ground stations repeat a command twice a second or less. A link of 57600 baud carries the ten a
    second of all its senders beside telemetry.
    """
    return SenderLimit(burst=20, rate_hz=2.0, link_burst=60, link_rate_hz=10.0)


def _stop_limit() -> SenderLimit:
    """Of commands that stop and are carried out; one more than these changes nothing."""
    return SenderLimit(burst=50, rate_hz=20.0, link_burst=100, link_rate_hz=50.0)


def _move_limit() -> SenderLimit:
    """Of commands that move and are carried out: many times what people give."""
    return SenderLimit(burst=30, rate_hz=5.0, link_burst=60, link_rate_hz=20.0)


class CommandLedger:
    """Makes repeated commands idempotent, answers what needs no decision, and serves cancels.

    commands: who may command. Hold and pause are taken from anybody; any other command of a sender
    that may not command is DENIED. Every sender has a limit; one that is beyond it is not answered.
    Commands that stop, commands that move and those of senders that may not command have limits
    of their own, so that none of them uses up another's.

    A packet that the network doubles is dropped. A command that is still being decided is told so,
    whenever it is given again. Else what stops the aircraft is always carried out, and what moves
    it unless it is old, so that nothing old undoes a stop:

    - it is a repeat: its sender's words again within 2 s, over another link within 5 s, with a
      confirmation above 0 within 30 s. It gets the last answer again, but CANCELLED when its
      sender has given another command since, or anybody a stop;
    - it was given before a stop that came before it: it has a confirmation above 0 and anybody's
      stop is not 30 s old, or its packet is not numbered after its sender's own stop on that link
      of the last 0.05 s. It is CANCELLED.
    """

    def __init__(self, commands: Commands | None = None) -> None:
        self._permissions = Permissions(commands or Commands())
        self._remembered: dict[_Key, _Remembered] = {}
        """In the order in which they were given."""
        self._packets: dict[tuple[str, bytes], float] = {}
        """When a packet first came over a link; the oldest first."""
        self._answers = _answer_limit()
        self._stops, self._strangers_holds = _stop_limit(), _stop_limit()
        self._moves = _move_limit()

    def receive(
        self,
        message: Message,
        *,
        link: str,
        system_id: int,
        component_id: int,
        now_s: float,
        signed: bool = False,
    ) -> Reception:
        """Takes a COMMAND_LONG, COMMAND_INT or COMMAND_CANCEL; system_id, component_id: ours.

        signed: whether the packet that carries it has a correct signature.
        """
        if self._is_doubled(link, bytes(message.get_msgbuf()), now_s):
            return _NOTHING
        sender = Sender(
            link=link, system_id=message.get_srcSystem(), component_id=message.get_srcComponent()
        )
        objection = self._permissions.objection(sender, vehicle_id=system_id, signed=signed)
        if message.get_msgId() == _COMMAND_CANCEL:
            if objection is not None:
                return _NOTHING
            return self._cancel(message, system_id=system_id, component_id=component_id)
        command = interpret(message, link=link, system_id=system_id, component_id=component_id)
        if command is None:
            return _NOTHING
        reception = self._reception(command, message, objection, now_s)
        if reception.answer is not None and not self._answers.allows(sender, now_s):
            return _NOTHING
        return reception

    def _reception(
        self, command: Command, message: Message, objection: str | None, now_s: float
    ) -> Reception:
        """What a command leads to, by itself. objection: why its sender may not command."""
        if isinstance(command, UnsupportedCommand):
            return Reception(event=command, answer=_answer(command, CommandResult.UNSUPPORTED))
        if objection is not None and not holds(command):
            command = DeniedCommand(
                sender=command.sender,
                command=command.command,
                parameters=command.parameters,
                reason=objection,
            )
        if isinstance(command, DeniedCommand):
            return Reception(event=command, answer=_answer(command, CommandResult.DENIED))
        command = replace(command, permitted=objection is None)
        answer = self._answer_to_old(command, message, now_s)
        if answer is not None:
            return Reception(answer=answer)
        if not self._limit_of(command).allows(command.sender, now_s):
            return Reception(answer=_answer(command, CommandResult.TEMPORARILY_REJECTED))
        self._remember(command, message.get_seq(), now_s)
        return Reception(event=command)

    def _limit_of(self, command: Command) -> SenderLimit:
        if not command.permitted:
            return self._strangers_holds
        return self._stops if stops(command) else self._moves

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
        remembered = self._latest(_key(command)[:3])
        if remembered is None or remembered.command != command or not remembered.open:
            return None
        remembered.answer = _answer(command, result, progress=progress, result_param2=result_param2)
        remembered.answered_s = now_s
        return remembered.answer

    def _is_doubled(self, link: str, packet: bytes, now_s: float) -> bool:
        """Whether the same packet, its sequence number included, has just come over this link."""
        heard_s = self._packets.get((link, packet))
        if heard_s is not None and now_s - heard_s <= _DOUBLED_S:
            return True
        self._packets.pop((link, packet), None)
        if len(self._packets) >= _MAX_REMEMBERED:
            del self._packets[next(iter(self._packets))]
        self._packets[link, packet] = now_s
        return False

    def _answer_to_old(self, command: Command, message: Message, now_s: float) -> Answer | None:
        """The answer to a command that is not to be carried out; None when it is."""
        sender, known = command.sender, self._remembered.get(_key(command))
        if known and known.is_awaited(now_s) and known is self._latest(_key(command)[:3]):
            return replace(known.answer, receiver=sender)
        if stops(command):
            return None
        says_so = getattr(message, "confirmation", 0) > 0
        if known and known.is_repeat(sender, now_s, says_so=says_so):
            if not self._is_superseded(known):
                return replace(known.answer, receiver=sender)
        elif not self._is_late(sender, message.get_seq(), now_s, says_so=says_so):
            return None
        return _answer(command, CommandResult.CANCELLED)

    def _is_superseded(self, known: _Remembered) -> bool:
        """Whether its sender has given another command since, or anybody a stop."""
        later = takewhile(lambda other: other is not known, reversed(self._remembered.values()))
        ids = _key(known.command)[:2]
        return any(stops(other.command) or _key(other.command)[:2] == ids for other in later)

    def _is_late(self, sender: Sender, sequence: int, now_s: float, *, says_so: bool) -> bool:
        """Whether what comes after a stop was given before it."""
        for stop in filter(lambda given: stops(given.command), self._remembered.values()):
            after_s = now_s - stop.given_s
            if says_so and after_s <= _REPEATS_S:
                return True
            overtaken = (stop.sequence - sequence) % 256 < 128
            if overtaken and stop.command.sender == sender and after_s <= _OVERTAKEN_S:
                return True
        return False

    def _latest(self, kind: tuple[int, ...]) -> _Remembered | None:
        """What a sender has given last of one number: system id, component id, number."""
        given = reversed(self._remembered.items())
        return next((remembered for key, remembered in given if key[:3] == kind), None)

    def _remember(self, command: Command, sequence: int, now_s: float) -> None:
        key = _key(command)
        self._remembered.pop(key, None)
        if len(self._remembered) >= _MAX_REMEMBERED:
            known = self._remembered.items()
            strangers = (key for key, given in known if not given.command.permitted)
            del self._remembered[next(strangers, next(iter(self._remembered)))]
        self._remembered[key] = _Remembered(command, sequence, now_s)

    def _cancel(self, message: Message, *, system_id: int, component_id: int) -> Reception:
        """COMMAND_CANCEL by the command's own sender; ignored when nothing is in progress."""
        if message.target_system not in {0, system_id}:
            return _NOTHING
        if message.target_component not in {0, component_id}:
            return _NOTHING
        kind = (message.get_srcSystem(), message.get_srcComponent(), message.command)
        remembered = self._latest(kind)
        if remembered is None or not remembered.open:
            return _NOTHING
        command = remembered.command
        remembered.answer = _answer(command, CommandResult.CANCELLED)
        return Reception(event=CommandCancelled(command=command), answer=remembered.answer)


def _answer(
    command: Command, result: CommandResult, *, progress: int = 0, result_param2: int = 0
) -> Answer:
    return Answer(
        receiver=command.sender,
        command=command.command,
        result=result,
        progress=progress,
        result_param2=result_param2,
    )
