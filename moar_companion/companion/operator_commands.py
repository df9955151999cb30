"""Operators' commands: when they are due, their meaning on this site, the answers to them."""

from __future__ import annotations

import math
from typing import NamedTuple

from ..mavlink.commands import Command, CommandResult, PauseContinue, stops
from ..mavlink.received_commands import Accepted
from ..mavlink.session import Session, Severity
from ..planner.site import Site
from ..settings.config import Authority
from ..texts import pilot_texts, service_texts
from ..types import Mission
from .mission.values import Order, Task, Verdict
from .reports import Reports

_READING_S = 1.0
"""Maximum wait of an order, after the start, for the autopilot, which sends a heartbeat each
second; then the same wait for its parameters. Over UDP they are read within 0.3 s."""

_WAITING, _PLANNING = 0, 50
"""Progress of an order in percent: it waits for planner and parameters; its path is searched."""

_RESULTS = {
    Verdict.ACCEPTED: CommandResult.ACCEPTED,
    Verdict.TEMPORARILY_REJECTED: CommandResult.TEMPORARILY_REJECTED,
    Verdict.DENIED: CommandResult.DENIED,
    Verdict.FAILED: CommandResult.FAILED,
    Verdict.CANCELLED: CommandResult.CANCELLED,
}


class Refused(NamedTuple):
    """An order that is impossible on this site, independent of the aircraft's state."""

    reason: str


def understood(
    command: Accepted, site: Site | None, authority: Authority
) -> Task | Order | Refused:
    """Returns the task or order in a command, or the reason for its refusal."""
    refused = None
    if site is None:
        refused = Refused(reason=pilot_texts.NO_SITE())
    elif authority is Authority.OBSERVE:
        refused = Refused(reason=pilot_texts.OBSERVE())
    if isinstance(command, PauseContinue):
        return Order.HOLD if command.pause else refused or Order.CONTINUE
    if not isinstance(command.mission, Mission):
        return Order(command.mission)
    if refused is not None:
        return refused
    assert site is not None
    index = command.index
    if command.mission.visits_targets:
        names = site.target_names
        if not names or (index is not None and index >= len(names)):
            reason = pilot_texts.NO_TARGET(index=index or 0, number=len(names))
            return Refused(reason=reason)
        chosen = names if index is None else names[index : index + 1]
        stops = tuple(stop for name in chosen for stop in site.stops_of(name))
        return Task(mission=command.mission, stops=stops)
    landings = site.landing_m.get(command.mission, ())
    if not landings or (index is not None and index >= len(landings)):
        reason = pilot_texts.NO_LANDING_POINT(index=index or 0, number=len(landings))
        return Refused(reason=reason)
    return Task(mission=command.mission, landing=index)


class OperatorCommands:
    """Takes commands of the session when they are due, and answers them with their reasons."""

    def __init__(self, session: Session, reports: Reports) -> None:
        self._session = session
        self._reports = reports
        self.planner_awaited = False
        """True while the planner is in preparation."""
        self._compiling = ""
        self._read_by_s = -math.inf
        """End of the wait for the autopilot and its parameters."""

    def await_planner(self, compiling: str, now_s: float) -> None:
        """Notes that the planner is in preparation.

        Orders wait for it. During a compilation, which takes long, they are temporarily rejected.
        compiling: its progress as text; empty without one.
        """
        self.planner_awaited = True
        if compiling and not self._compiling:
            self._reports.send_text(Severity.INFO, compiling, now_s)
        self._compiling = compiling

    def planner_ready(self, now_s: float) -> None:
        """Notes that the planner is ready."""
        if self._compiling:
            self._reports.send_text(Severity.INFO, service_texts.PLANNER_READY(), now_s)
        self.planner_awaited, self._compiling = False, ""

    def await_autopilot(self, now_s: float) -> None:
        """Notes the start, or a found autopilot: orders wait for it, or for its parameters.

        An order rejected meanwhile would stay rejected for all its repeats.
        """
        self._read_by_s = now_s + _READING_S

    def due(self, now_s: float, *, unknown: bool) -> list[Accepted]:
        """Commands to execute now, in the order of arrival.

        Before planner and autopilot are known only those that end motion: the others wait, or are
        rejected during a compilation. One that ends motion cancels those that wait, as if executed
        before. unknown: the autopilot or its parameters are not known yet.
        """
        waiting = self._session.commands.waiting
        if not self.planner_awaited and not (unknown and now_s <= self._read_by_s):
            return waiting
        due: list[Accepted] = []
        earlier: list[Accepted] = []
        for command in waiting:
            if stops(command):
                for other in earlier:
                    self.answer(other.number, Verdict.CANCELLED, "", now_s)
                earlier = []
                due.append(command)
            elif self._compiling:
                self.answer(command.number, Verdict.TEMPORARILY_REJECTED, self._compiling, now_s)
            else:
                earlier.append(command)
        return due

    def end(self, now_s: float) -> None:
        """Answers all open orders before the process ends."""
        for command in self._session.commands.unanswered:
            self.answer(command.number, Verdict.FAILED, service_texts.SERVICE_ENDS(), now_s)

    def answer(self, order_id: int, verdict: Verdict, reason: str, now_s: float) -> None:
        """Sends the final answer to an order; nothing where it has one already."""
        command = self._session.commands.open(order_id)
        if command is None:
            return
        self._session.answer(command, _RESULTS[verdict], now_s)
        self._reports.record("answer", now_s, verdict=verdict.value, reason=reason)
        if reason:
            self.report_reason(command, verdict, reason, now_s)

    def report_reason(self, command: Command, verdict: Verdict, reason: str, now_s: float) -> None:
        """Sends the reason as a text to the sender's link: an acknowledgement carries none."""
        action, link = verdict.value.rpartition(" ")[2], command.sender.link
        self._reports.send_text(
            Severity.WARNING, reason, now_s, action=action, is_new=True, link=link
        )

    def report_progress(self, now_s: float) -> None:
        """Answers IN_PROGRESS to each order without an answer, with its part of the way."""
        commands = self._session.commands
        for command in commands.without_answer(now_s):
            progress = _PLANNING if commands.is_executed(command.number) else _WAITING
            self._session.answer(command, CommandResult.IN_PROGRESS, now_s, progress=progress)


def words(order: Task | Order | Refused) -> str:
    """Text of an order for the record."""
    if isinstance(order, Task):
        return " ".join([order.mission.value, *order.stops])
    return order.reason if isinstance(order, Refused) else order.value
