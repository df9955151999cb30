"""Commands received: from their arrival to their final COMMAND_ACK, executed once each. No I/O.

Inputs: packets with commands and cancels, late or repeated, and the service's decisions; outputs:
commands to execute, and answers for their senders.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import takewhile
from typing import NamedTuple

from ..settings.config import GROUND_STATION_IDS, Commands
from ..settings.mqtt_config import ORDER_LINK
from ..settings.page_config import PAGE_LINK
from ..texts import pilot_texts
from .commands import (
    Command,
    CommandAnswer,
    CommandCancelled,
    CommandResult,
    DeniedCommand,
    MessageCommand,
    MissionCommand,
    PauseContinue,
    Sender,
    UnsupportedCommand,
    holds,
    interpret,
    is_request,
    stops,
)
from .component.requested_messages import concerns_companion
from .dialect import Message
from .rate_limits import SenderLimit


@dataclass(frozen=True, slots=True)
class Permissions:
    """Rules of the configuration, for the companion of one vehicle.

    A sender chooses the ids of its packets: they separate cooperating systems only. A signature
    alone proves who the sender is.
    """

    rules: Commands

    def allows_system(self, system_id: int, *, vehicle_id: int) -> bool:
        """Returns True if a system may command. vehicle_id: of the autopilot and the companion."""
        if self.rules.systems is None:
            return system_id in GROUND_STATION_IDS or system_id == vehicle_id
        return system_id in self.rules.systems

    def may_request(self, system_id: int, *, vehicle_id: int) -> bool:
        """Returns True if a system gets what it requests: one that may command, or the vehicle's.

        An answer uses the bandwidth of a link.
        """
        return system_id == vehicle_id or self.allows_system(system_id, vehicle_id=vehicle_id)

    def objection(self, sender: Sender, *, vehicle_id: int, signed: bool) -> str | None:
        """Reason why a sender may not command, as a text; None if permitted.

        signed: True if the command's packet has a correct signature.
        """
        rules = self.rules
        if sender.link in {ORDER_LINK, PAGE_LINK}:
            return None  # each of their orders has a key or a token of its own
        if rules.links is not None and sender.link not in rules.links:
            return pilot_texts.LINK_MAY_NOT(detail=f"{sender.link}; commands.links")
        if not self.allows_system(sender.system_id, vehicle_id=vehicle_id):
            return pilot_texts.SYSTEM_MAY_NOT(id=sender.system_id, detail="commands.systems")
        if rules.components is not None and sender.component_id not in rules.components:
            return pilot_texts.COMPONENT_MAY_NOT(
                id=sender.component_id, detail="commands.components"
            )
        if rules.signed_only and not signed:
            return pilot_texts.UNSIGNED(detail="commands.signed_only")
        return None


_REPEATS_S = 30.0
"""Time in which a confirmation above 0 marks a repeat: QGroundControl takes 9 s."""
_DETOUR_S = 5.0
"""Greatest delay of a copy over another link."""
_SOON_S = 2.0
"""Time in which MAVSDK's repeats arrive, all with confirmation 0: it takes 1.5 s."""
_OVERTAKEN_S = 0.05
"""Greatest reordering by a network. In this time a ground station sends fewer than 128 packets and
does not restart (a shell starts one per command). So sequence numbers give the order."""
_DOUBLED_S = 0.5
"""Time in which the network's own copies of a packet arrive: some milliseconds suffice."""
_MAX_REMEMBERED = 64
_PROGRESS_UNKNOWN = 255
_IN_PROGRESS_AFTER_S = 0.2
"""Time without an answer after which a command is answered IN_PROGRESS."""
_IN_PROGRESS_PERIOD_S = 1.0
"""Period of these answers: each restarts the time-out of a ground station, 1 s or more."""
_COMMAND_CANCEL = 80

Accepted = MissionCommand | PauseContinue
"""Commands that the service executes and answers."""

_Key = tuple[int, int, int, tuple[float | None, ...]]
"""Sender's ids, the command's number and its parameters."""


def _key(command: Command) -> _Key:
    sender = command.sender
    return sender.system_id, sender.component_id, command.command, command.parameters


class _Received:
    """An accepted command: its sender and link, its packet's sequence number, its last answer."""

    __slots__ = (
        "answer",
        "command",
        "executed_s",
        "progress_due_s",
        "received_s",
        "sequence",
    )

    def __init__(self, command: Accepted, sequence: int, now_s: float) -> None:
        self.command = command
        self.sequence = sequence
        self.answer = answer_to(command, CommandResult.IN_PROGRESS, progress=_PROGRESS_UNKNOWN)
        self.received_s = now_s
        self.executed_s: float | None = None
        """Time when its execution began; None while it waits."""
        self.progress_due_s = now_s + _IN_PROGRESS_AFTER_S

    @property
    def open(self) -> bool:
        """True until the final answer is sent."""
        return self.answer.result is CommandResult.IN_PROGRESS

    def is_repeat(self, sender: Sender, now_s: float, *, confirmed: bool) -> bool:
        """True if the same command received now is a repeat; confirmed: confirmation > 0."""
        soon_s = _SOON_S if sender == self.command.sender else _DETOUR_S
        return now_s - self.received_s <= (_REPEATS_S if confirmed else soon_s)


class Reception(NamedTuple):
    """Result of a packet: an accepted command or an event for the service, an answer to send.

    asked: a command that the services of the component answer.
    """

    accepted: Accepted | None = None
    asked: MessageCommand | None = None
    event: UnsupportedCommand | DeniedCommand | CommandCancelled | None = None
    answer: CommandAnswer | None = None


_NOTHING = Reception()


def _answer_limit() -> SenderLimit:
    """Limit of answers that need no decision, with their texts: 90 bytes each.

    Ground stations repeat a command at most twice a second. A link of 57600 baud carries ten such
    answers a second beside telemetry.
    """
    return SenderLimit(burst=20, rate_hz=2.0, link_burst=60, link_rate_hz=10.0)


def _stop_limit() -> SenderLimit:
    """Limit of executed stop commands; one more than these changes nothing."""
    return SenderLimit(burst=50, rate_hz=20.0, link_burst=100, link_rate_hz=50.0)


def _move_limit() -> SenderLimit:
    """Limit of executed motion commands: many times the rate of an operator."""
    return SenderLimit(burst=30, rate_hz=5.0, link_burst=60, link_rate_hz=20.0)


class ReceivedCommands:
    """Owns each accepted command until its final answer, and recognises its repeats after that.

    Commands that need no decision are answered at once, and a cancel ends a command without a
    final answer. The service holds a command's value or its number alone.

    commands: rules for permitted senders. Hold and pause are accepted from any sender; any other
    command of a sender without permission is DENIED. Every sender has a limit, beyond which it gets
    no answer. Stop commands, motion commands and commands without permission have separate limits,
    so that none uses up another's.

    A packet that the network doubles is dropped. A repeat of an undecided command gets IN_PROGRESS,
    one of a stop only if no sender has commanded motion since. Otherwise every stop command is
    executed. A motion command is executed unless it is old, so that no old command undoes a stop.
    Old is:

    - a repeat: the same command from its sender within 2 s, over another link within 5 s, with a
      confirmation above 0 within 30 s. The table repeats the last answer, or answers CANCELLED
      if the sender has given another command since or any sender a stop;
    - a command given before a stop but received after it: its confirmation is above 0 and a stop
      of any sender is at most 30 s old; or its sequence number is not after that of its sender's
      own stop on the same link within the last 0.05 s. The table answers CANCELLED.
    """

    def __init__(self, commands: Commands | None = None) -> None:
        self.permissions = Permissions(commands or Commands())
        self._last_number = 0
        self._open: dict[int, _Received] = {}
        """Commands without a final answer by number, in the order of arrival."""
        self._remembered: dict[_Key, _Received] = {}
        """The latest of each kind, for repeats, in the order of arrival."""
        self._packets: dict[tuple[str, bytes], float] = {}
        """Time of the first reception of a packet by link; the oldest first."""
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
        """Takes a COMMAND_LONG, COMMAND_INT or COMMAND_CANCEL.

        system_id, component_id: the companion's. signed: True if the signature is correct.
        """
        if self._is_doubled(link, bytes(message.get_msgbuf()), now_s):
            return _NOTHING
        sender = Sender(
            link=link, system_id=message.get_srcSystem(), component_id=message.get_srcComponent()
        )
        objection = self.permissions.objection(sender, vehicle_id=system_id, signed=signed)
        if message.get_msgId() == _COMMAND_CANCEL:
            if objection is not None:
                return _NOTHING
            return self._cancel(message, system_id=system_id, component_id=component_id)
        command = interpret(message, link=link, system_id=system_id, component_id=component_id)
        if command is None:
            return _NOTHING
        may_request = self.permissions.may_request(sender.system_id, vehicle_id=system_id)
        if is_request(command) and not may_request:
            return _NOTHING
        reception = self._reception(command, message, objection, now_s)
        limited = reception.answer is not None or reception.asked is not None
        if limited and not self._answers.allows(sender, now_s):
            return _NOTHING
        return reception

    def _reception(
        self,
        command: Accepted | MessageCommand | UnsupportedCommand | DeniedCommand,
        message: Message,
        objection: str | None,
        now_s: float,
    ) -> Reception:
        """Result of a command before the limit on answers. objection: reason against its sender."""
        if isinstance(command, MessageCommand) and not concerns_companion(command):
            return _NOTHING
        if isinstance(command, UnsupportedCommand):
            return Reception(event=command, answer=answer_to(command, CommandResult.UNSUPPORTED))
        if objection is not None and not (holds(command) or is_request(command)):
            command = DeniedCommand(
                sender=command.sender,
                command=command.command,
                parameters=command.parameters,
                reason=objection,
            )
        if isinstance(command, MessageCommand):
            return Reception(asked=command)
        if isinstance(command, DeniedCommand):
            return Reception(event=command, answer=answer_to(command, CommandResult.DENIED))
        command = replace(command, permitted=objection is None, number=self._last_number + 1)
        answer = self._answer_to_old(command, message, now_s)
        if answer is not None:
            return Reception(answer=answer)
        if not self._limit_of(command).allows(command.sender, now_s):
            return Reception(answer=answer_to(command, CommandResult.TEMPORARILY_REJECTED))
        self._remember(command, message.get_seq(), now_s)
        return Reception(accepted=command)

    def _limit_of(self, command: Command) -> SenderLimit:
        if not command.permitted:
            return self._strangers_holds
        return self._stops if stops(command) else self._moves

    @property
    def waiting(self) -> list[Accepted]:
        """Commands that are neither executed nor answered, in the order of arrival."""
        return [received.command for received in self._open.values() if received.executed_s is None]

    @property
    def unanswered(self) -> list[Accepted]:
        """Commands without a final answer, in the order of arrival."""
        return [received.command for received in self._open.values()]

    def note_executed(self, command: Command, now_s: float) -> None:
        """Notes that the execution of a waiting command begins."""
        received = self._open[command.number]
        received.executed_s = now_s
        received.progress_due_s = max(received.progress_due_s, now_s + _IN_PROGRESS_AFTER_S)

    def open(self, number: int) -> Command | None:
        """Command of this number; None after its final answer."""
        received = self._open.get(number)
        return None if received is None else received.command

    def without_answer(self, now_s: float) -> list[Command]:
        """Commands to be answered IN_PROGRESS now: after 0.2 s without an answer, then each 1 s."""
        return [
            received.command for received in self._open.values() if now_s > received.progress_due_s
        ]

    def is_executed(self, number: int) -> bool:
        """Returns True if the execution of an open command has begun."""
        received = self._open.get(number)
        return received is not None and received.executed_s is not None

    def answer(
        self,
        command: Command,
        result: CommandResult,
        *,
        progress: int = 0,
        result_param2: int = 0,
        now_s: float,
    ) -> CommandAnswer | None:
        """Returns the answer to a received command; None if no answer is due.

        None is due after the final answer, a cancel, or another command of that number from the
        same sender, since an acknowledgement carries only the number.
        """
        received = self._open.get(command.number)
        if received is None:
            return None
        received.answer = answer_to(command, result, progress=progress, result_param2=result_param2)
        if received.open:
            received.progress_due_s = now_s + _IN_PROGRESS_PERIOD_S
        else:
            del self._open[command.number]
        return received.answer if received is self._latest(_key(command)[:3]) else None

    def _is_doubled(self, link: str, packet: bytes, now_s: float) -> bool:
        """Returns True if this link just received the same packet, sequence number included."""
        received_s = self._packets.get((link, packet))
        if received_s is not None and now_s - received_s <= _DOUBLED_S:
            return True
        self._packets.pop((link, packet), None)
        if len(self._packets) >= _MAX_REMEMBERED:
            del self._packets[next(iter(self._packets))]
        self._packets[link, packet] = now_s
        return False

    def _answer_to_old(
        self, command: Command, message: Message, now_s: float
    ) -> CommandAnswer | None:
        """Returns the answer to a repeated or late command; None if the command is executed."""
        sender, known = command.sender, self._remembered.get(_key(command))
        awaited = known and known.open and known is self._latest(_key(command)[:3])
        if known and awaited and not (stops(command) and self._moves_since(known)):
            return replace(known.answer, receiver=sender)
        if stops(command):
            return None
        confirmed = getattr(message, "confirmation", 0) > 0
        if known and known.is_repeat(sender, now_s, confirmed=confirmed):
            if not self._is_superseded(known):
                return replace(known.answer, receiver=sender)
        elif not self._is_late(sender, message.get_seq(), now_s, confirmed=confirmed):
            return None
        return answer_to(command, CommandResult.CANCELLED)

    def _since(self, known: _Received) -> list[Accepted]:
        """Commands that were received after a remembered one."""
        later = takewhile(lambda other: other is not known, reversed(self._remembered.values()))
        return [other.command for other in later]

    def _moves_since(self, stop: _Received) -> bool:
        """Returns True if any sender has given a command of motion since."""
        return not all(map(stops, self._since(stop)))

    def _is_superseded(self, known: _Received) -> bool:
        """Returns True if its sender has given another command since, or any sender a stop."""
        ids = _key(known.command)[:2]
        return any(stops(other) or _key(other)[:2] == ids for other in self._since(known))

    def _is_late(self, sender: Sender, sequence: int, now_s: float, *, confirmed: bool) -> bool:
        """Returns True if a command received after a stop was given before it."""
        for stop in filter(lambda given: stops(given.command), self._remembered.values()):
            after_s = now_s - stop.received_s
            if confirmed and after_s <= _REPEATS_S:
                return True
            overtaken = (stop.sequence - sequence) % 256 < 128
            if overtaken and stop.command.sender == sender and after_s <= _OVERTAKEN_S:
                return True
        return False

    def _latest(self, kind: tuple[int, ...]) -> _Received | None:
        """Latest command of one kind: system id, component id, command number."""
        given = reversed(self._remembered.items())
        return next((remembered for key, remembered in given if key[:3] == kind), None)

    def _remember(self, command: Accepted, sequence: int, now_s: float) -> None:
        key = _key(command)
        self._remembered.pop(key, None)
        if len(self._remembered) >= _MAX_REMEMBERED:
            known = self._remembered.items()
            strangers = (key for key, given in known if not given.command.permitted)
            del self._remembered[next(strangers, next(iter(self._remembered)))]
        received = _Received(command, sequence, now_s)
        self._last_number = command.number
        self._open[command.number] = self._remembered[key] = received

    def _cancel(self, message: Message, *, system_id: int, component_id: int) -> Reception:
        """Handles COMMAND_CANCEL by the command's own sender; no effect if none is in progress."""
        if message.target_system not in {0, system_id}:
            return _NOTHING
        if message.target_component not in {0, component_id}:
            return _NOTHING
        kind = (message.get_srcSystem(), message.get_srcComponent(), message.command)
        received = self._latest(kind)
        if received is None or not received.open:
            return _NOTHING
        command = received.command
        received.answer = answer_to(command, CommandResult.CANCELLED)
        del self._open[command.number]
        return Reception(event=CommandCancelled(command=command), answer=received.answer)


def answer_to(
    command: Command, result: CommandResult, *, progress: int = 0, result_param2: int = 0
) -> CommandAnswer:
    """COMMAND_ACK of a command to its sender."""
    return CommandAnswer(
        receiver=command.sender,
        command=command.command,
        result=result,
        progress=progress,
        result_param2=result_param2,
    )
