"""Hook of the session for the services of the component, with the limits of answers. No I/O.

Answers to TIMESYNC and PING are sent at once, within a rate, since they measure a round trip. All
else waits for room in the link's budget (`link_budget`), in turn: short answers in the order of
their requests, requested messages, published ones, and of each service the lists and files that
were requested on the link. Memory and cost of a packet are bounded, for any number of requests.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from functools import partial

from ...settings.flight_parameters import FlightParameters
from ...settings.link_config import LinkRole
from ...types import AutopilotKind
from ..commands import CommandResult, MessageCommand
from ..dialect import Message
from ..rate_limits import SenderLimit
from .component_metadata import component_information, component_metadata, metadata_files
from .component_service import Asker, ComponentService, PacedService
from .file_server import FileServer
from .link_budget import LinkBudget
from .named_values import NamedValues
from .parameter_server import ParameterRefused, ParameterServer, ParameterSet
from .path_mission import MissionRefused, PathMission
from .published import PublishedMessages
from .requested_messages import (
    CLOCK_IDS,
    clock_answer,
    component_version,
    protocol_version,
    result_of,
)

_MOST_WAITING = 64
"""Limit of short answers that wait on a link; beyond it a request gets none and is repeated."""
_MOST_REQUESTED = 16
"""Limit of requested messages that wait on a link; beyond it a request is rejected for now."""
_MOST_A_CYCLE = 16
"""Limit of the packets of one cycle and link: at 50 Hz more than any budget pays for."""


class ComponentServices:
    """The services of one component on all its links.

    links: name and role of each link. `published` takes the content of messages that ground
    stations can request, `values` what they can plot.

    parameters: the settings that may be changed; None: the component has no parameters. autopilot:
    returns the kind of the autopilot; None while it is unknown.
    """

    MESSAGE_IDS: frozenset[int] = CLOCK_IDS.union(
        *(service.MESSAGE_IDS for service in (FileServer, ParameterServer, PathMission))
    )
    """Messages that a service reads."""

    def __init__(
        self,
        links: Mapping[str, LinkRole],
        component_id: int,
        parameters: FlightParameters | None = None,
        autopilot: Callable[[], AutopilotKind | None] = lambda: None,
    ) -> None:
        self.path = PathMission()
        """The planned path, for a download."""
        files = FileServer(metadata_files(component_id))
        self._paced: tuple[PacedService, ...] = (files,)
        self.parameters: ParameterServer | None = None
        """The present settings; None without parameters."""
        if parameters is not None:
            self.parameters = ParameterServer(parameters, links, autopilot)
            self._paced += (self.parameters,)
        self._services: tuple[ComponentService, ...] = (self.path, *self._paced)
        self._budgets = {link: LinkBudget(link) for link in links}
        self._waiting: dict[str, deque[Message]] = {link: deque() for link in links}
        """Short answers of the services, by link."""
        self._requested: dict[str, deque[Message]] = {link: deque() for link in links}
        """Published messages that commands have requested, by link."""
        self._turn = dict.fromkeys(links, 0)
        """Source of messages whose turn it is, by link."""
        self._at_once = _answer_limit()
        self._autopilot = autopilot
        self.values = NamedValues()
        self.published = PublishedMessages(links, self._budgets)
        self.published.offer("NAMED_VALUE_FLOAT", self.values.floats)
        self.published.offer("NAMED_VALUE_INT", self.values.integers)
        self.published.offer("AUTOPILOT_VERSION", self._component_version)
        self.published.offer("PROTOCOL_VERSION", protocol_version)
        self.published.offer("COMPONENT_METADATA", partial(component_metadata, component_id))
        self.published.offer("COMPONENT_INFORMATION", partial(component_information, component_id))

    def receive(
        self,
        message: Message,
        asker: Asker,
        *,
        ours: tuple[int, int],
        is_autopilots: bool,
        now_s: float,
    ) -> Message | None:
        """Takes a message of `MESSAGE_IDS`; returns the answer that is sent at once, if any.

        ours: system and component id of the companion. is_autopilots: True for the autopilot's.
        """
        if message.get_msgId() in CLOCK_IDS:
            answer = clock_answer(message, ours=ours, is_autopilots=is_autopilots, now_s=now_s)
            if answer is None or is_autopilots or self._at_once.allows(asker.sender, now_s):
                return answer
            return None
        waiting = self._waiting[asker.sender.link]
        if not _is_addressed_to(message, ours) or len(waiting) >= _MOST_WAITING:
            return None
        for service in self._services:
            if message.get_msgId() in service.MESSAGE_IDS:
                waiting.extend(service.handle(message, asker, now_s))
        return None

    def events_received(self) -> list[MissionRefused | ParameterRefused | ParameterSet]:
        """Returns what ground stations have set, and what was refused, since the last call."""
        set_now = [] if self.parameters is None else self.parameters.events_received()
        return [*set_now, *self.path.events_received()]

    def carry_out(self, command: MessageCommand, now_s: float) -> CommandResult | None:
        """Carries out a command about messages; returns its result, None where it gets no answer.

        The messages that it requests follow when the link has room.
        """
        requested = self._requested[command.sender.link]
        if len(requested) >= _MOST_REQUESTED:
            return None if command.to_all else CommandResult.TEMPORARILY_REJECTED
        result, messages = result_of(command, self.published, now_s)
        requested.extend(messages)
        return result

    def due(
        self, now_s: float, is_behind: Callable[[str], bool] = lambda _link: False
    ) -> list[tuple[str, Message]]:
        """Answers that the links have room for now, each with its link.

        is_behind: returns True for a link whose messages wait already; it gets no answers.
        """
        return [
            (link, message)
            for link, budget in self._budgets.items()
            if not is_behind(link)
            for message in self._due_on(link, budget, now_s)
        ]

    def _due_on(self, link: str, budget: LinkBudget, now_s: float) -> list[Message]:
        due: list[Message] = []
        while len(due) < _MOST_A_CYCLE and budget.is_open(now_s):
            message = self._next_on(link, budget.largest_bytes, now_s)
            if message is None:
                break
            budget.spend(message)
            due.append(message)
        return due

    def _next_on(self, link: str, most_bytes: int, now_s: float) -> Message | None:
        """Next message on a link, from each source in turn."""
        sources = len(self._paced) + 3
        for _ in range(sources):
            turn = self._turn[link]
            self._turn[link] = (turn + 1) % sources
            message = self._next_of(turn, link, most_bytes, now_s)
            if message is not None:
                return message
        return None

    def _next_of(self, turn: int, link: str, most_bytes: int, now_s: float) -> Message | None:
        if turn < 2:
            waiting = (self._waiting, self._requested)[turn][link]
            return waiting.popleft() if waiting else None
        if turn == 2:
            return self.published.next_due(link, now_s)
        return self._paced[turn - 3].next_answer(link, most_bytes, now_s)

    def _component_version(self, _now_s: float) -> list[Message]:
        served = frozenset[int]().union(*(service.MESSAGE_IDS for service in self._services))
        return [component_version(served, self._autopilot())]


def _answer_limit() -> SenderLimit:
    """Limit of answers at once, except to the autopilot: 5 a second for a sender, 20 for a link."""
    return SenderLimit(burst=5, rate_hz=5.0, link_burst=20, link_rate_hz=20.0)


def _is_addressed_to(message: Message, ours: tuple[int, int]) -> bool:
    return message.target_system in {0, ours[0]} and message.target_component in {0, ours[1]}
