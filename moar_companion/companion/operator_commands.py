"""Operators' commands: their meaning on this site, and the answers to them."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ..config import Authority
from ..mavlink.commands import Command, CommandResult, MissionCommand, PauseContinue
from ..mavlink.session import Session, Severity
from ..mission.values import Order, Task, Verdict
from ..site import Site
from ..types import Mission
from .reports import Reports

_IN_PROGRESS_AFTER_S = 0.2
"""Planning time after which an order is answered IN_PROGRESS (contract)."""

_RESULTS = {
    Verdict.ACCEPTED: CommandResult.ACCEPTED,
    Verdict.TEMPORARILY_REJECTED: CommandResult.TEMPORARILY_REJECTED,
    Verdict.DENIED: CommandResult.DENIED,
    Verdict.FAILED: CommandResult.FAILED,
    Verdict.CANCELLED: CommandResult.CANCELLED,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Refused:
    """An order that is impossible on this site, independent of the aircraft's state."""

    reason: str


def understood(
    command: MissionCommand | PauseContinue, site: Site | None, authority: Authority
) -> Task | Order | Refused:
    """Returns the task or order in a command, or the reason for its refusal."""
    if isinstance(command, PauseContinue):
        return Order.HOLD if command.pause else Order.CONTINUE
    if not isinstance(command.mission, Mission):
        return Order(command.mission)
    if site is None:
        return Refused(reason="no site is loaded")
    if authority is Authority.OBSERVE:
        return Refused(reason="the authority is observe")
    index = command.index
    if command.mission is Mission.INSPECTION:
        names = tuple(target.name for target in site.targets)
        if not names or (index is not None and index >= len(names)):
            return Refused(reason=f"no target {index or 0}: the site has {len(names)}")
        stops = names if index is None else (names[index],)
        return Task(mission=command.mission, stops=stops)
    landings = site.landing_m.get(command.mission, ())
    if not landings or (index is not None and index >= len(landings)):
        return Refused(reason=f"no landing point {index or 0}: the site has {len(landings)}")
    return Task(mission=command.mission, landing=index)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Open:
    command: Command
    received_s: float
    progress_told: bool = False


class OperatorCommands:
    """Commands that wait for a cycle, and unanswered orders by their numbers."""

    def __init__(self, session: Session, reports: Reports) -> None:
        self._session = session
        self._reports = reports
        self._heard: list[MissionCommand | PauseContinue] = []
        self._open: dict[int, _Open] = {}
        self._last_id = 0

    def hear(self, command: MissionCommand | PauseContinue) -> None:
        """Keeps a command until the next cycle."""
        self._heard.append(command)

    def heard(self) -> list[MissionCommand | PauseContinue]:
        """Returns the commands since the last call."""
        heard, self._heard = self._heard, []
        return heard

    def reject(self, command: Command, reason: str, now_s: float) -> None:
        """Answers that a command is rejected temporarily: it may be given again later."""
        self.answer(self.enter(command, now_s), Verdict.TEMPORARILY_REJECTED, reason, now_s)

    def enter(self, command: Command, now_s: float) -> int:
        """Registers a command that will be answered; returns its number."""
        self._last_id += 1
        self._open[self._last_id] = _Open(command=command, received_s=now_s)
        return self._last_id

    def withdraw(self, command: Command) -> int | None:
        """Removes a command that its sender cancelled; returns its number, if it was open."""
        self._heard = [heard for heard in self._heard if heard != command]
        for order_id, order in self._open.items():
            if order.command == command:
                del self._open[order_id]
                return order_id
        return None

    def answer(self, order_id: int, verdict: Verdict, reason: str, now_s: float) -> None:
        """Sends the final answer to an order."""
        command = self._open.pop(order_id).command
        self._session.answer(command, _RESULTS[verdict])
        self._reports.record("answer", now_s, verdict=verdict.value, reason=reason)
        if reason:
            self.tell_why(command, verdict, reason, now_s)

    def tell_why(self, command: Command, verdict: Verdict, reason: str, now_s: float) -> None:
        """Sends the reason as a text to the sender's link: an acknowledgement carries none."""
        action, link = verdict.value.rpartition(" ")[2], command.sender.link
        self._reports.say(Severity.WARNING, reason, now_s, action=action, news=True, link=link)

    def tell_progress(self, now_s: float) -> None:
        """Answers IN_PROGRESS once to each order that has waited for long."""
        for order_id, order in self._open.items():
            if not order.progress_told and now_s - order.received_s > _IN_PROGRESS_AFTER_S:
                self._open[order_id] = replace(order, progress_told=True)
                self._session.answer(order.command, CommandResult.IN_PROGRESS)


def words(order: Task | Order | Refused) -> str:
    """Text of an order for the record."""
    if isinstance(order, Task):
        return " ".join([order.mission.value, *order.stops])
    return order.reason if isinstance(order, Refused) else order.value
