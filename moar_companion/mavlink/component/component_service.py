"""Methods of a service of the component, and the sender of a request."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from ..commands import Sender
from ..dialect import Message


@dataclass(frozen=True, slots=True, kw_only=True)
class Asker:
    """Sender of a request."""

    sender: Sender
    objection: str | None
    """Reason why it may not command, and so may not set anything; None if it may."""
    on_board: bool
    """True if it has the vehicle's system id."""


class ComponentService(Protocol):
    """Short answers to some messages of ground stations. Every call takes constant time."""

    MESSAGE_IDS: frozenset[int]
    """Messages that it reads; all have a target system and component."""

    def handle(self, message: Message, asker: Asker, now_s: float) -> list[Message]:
        """Takes a request to the companion or to all components; returns its short answers."""


class PacedService(ComponentService, Protocol):
    """A service that also answers with lists or files, packet by packet."""

    def next_answer(self, link: str, most_bytes: int, now_s: float) -> Message | None:
        """Next packet of a list or a file that was requested on this link; None: none is due.

        most_bytes: size of the largest packet, with 25 bytes around the payload, where the service
        chooses its size.
        """
