"""The addresses that a listening link hears: which it sends to, and what reads their bytes. No I/O.

UDP tells who sends, and the address may be forged. So an address is sent to only after a valid
packet of a system that is allowed has come from it, and what others send cannot mix with its bytes.
A stream (TCP, a serial line) has one peer, whose address is None.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Callable
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from typing import Any

from ..config import LinkRole
from .codec import Codec

Address = tuple[Any, ...]
"""A socket's: host and port, and for IPv6 two more."""

_MOST_PEERS = 8
_PEER_TIMEOUT_S = 10.0
"""A peer that has been silent for so long is not sent to any more."""
_SILENT_S = 3.0
"""Three periods of a heartbeat: a peer that has been silent for so long may lose its place to a new
one; one that was heard for longer keeps it for as long, up to the time-out."""
_AUTOPILOT_TIMEOUT_S = 3.0
"""After so long without the autopilot at its address another one may be its new one: a router that
was started anew, for example. The autopilot's link is lost after the same time."""
_REPORT_PERIOD_S = 60.0
"""Between two reports of systems that are not sent to, and of addresses with the autopilot's ids.
Of either a network may have many, and an operator may have connected since the last report."""
_SOURCES_TOLD = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class AutopilotElsewhere:
    """Packets with the autopilot's ids come from an address where it is not; they are ignored."""

    link: str
    address: Address


@dataclass(frozen=True, slots=True, kw_only=True)
class PeerRefused:
    """A system that may not command sends to a listening link; nothing is sent to its address."""

    link: str
    address: Address
    system_id: int


class Precedence(enum.IntEnum):
    """Whose bytes are read first: the autopilot's and all of a stream, a peer's, a stranger's."""

    AUTOPILOT = 0
    PEER = 1
    STRANGER = 2


class _Peer:
    __slots__ = ("codec", "first_s", "last_s")

    def __init__(self, codec: Codec, now_s: float) -> None:
        self.codec = codec
        self.first_s = self.last_s = now_s

    def may_leave(self, now_s: float) -> bool:
        heard_for_s = self.last_s - self.first_s
        return now_s - self.last_s > min(max(_SILENT_S, heard_for_s), _PEER_TIMEOUT_S)


class Peers:
    """One link's peers: on a listening link eight addresses at most, the autopilot's among them.

    role: who is at the other end. make_codec: what reads the bytes of one address.
    """

    def __init__(self, link: str, role: LinkRole, make_codec: Callable[[], Codec]) -> None:
        self._link = link
        self._role = role
        self._make_codec = make_codec
        self._of_stream = make_codec()
        self._of_strangers = self._codec_of_strangers()
        self._peers: dict[Address, _Peer] = {}
        self._home: Address | None = None
        """Where the autopilot is heard; None on a stream, and before."""
        self._home_s: float | None = None
        self._elsewhere_due_s = -math.inf
        self._refusal_due_s = -math.inf
        self._events: list[AutopilotElsewhere | PeerRefused] = []
        self.sources: set[tuple[int, int]] = set()
        """The first eight that were heard on this link: system and component ids."""

    def events_received(self) -> list[AutopilotElsewhere | PeerRefused]:
        """What has happened since the last call."""
        events, self._events = self._events, []
        return events

    def codec(self, address: Address | None) -> Codec:
        """What reads the next bytes from an address; of a stranger it reads whole packets only."""
        if address is None:
            return self._of_stream
        peer = self._peers.get(address)
        if peer is not None:
            return peer.codec
        self._of_strangers.forget()
        return self._of_strangers

    def precedence(self, address: Address | None) -> Precedence:
        """How soon the bytes from an address are read when there are too many."""
        if address is None or address == self._home:
            return Precedence.AUTOPILOT
        return Precedence.PEER if address in self._peers else Precedence.STRANGER

    @property
    def autopilots_codec(self) -> Codec:
        """What reads the bytes from the autopilot's address."""
        peer = None if self._home is None else self._peers.get(self._home)
        return self._of_stream if peer is None else peer.codec

    def addresses(self, now_s: float) -> tuple[Address, ...]:
        """Where to send."""
        return tuple(
            address
            for address, peer in self._peers.items()
            if now_s - peer.last_s <= _PEER_TIMEOUT_S
        )

    def is_forged(
        self,
        address: Address | None,
        sources: AbstractSet[tuple[int, int]],
        autopilot: tuple[int, int] | None,
        now_s: float,
    ) -> bool:
        """Whether the autopilot's ids are among these sources, but it is heard elsewhere.

        autopilot: its system and component id; None: not known yet. It is where it was heard first,
        until it has been silent there for 3 s. On an operator's link it is heard by nobody.
        """
        if autopilot not in sources or self._role is LinkRole.OPERATOR:
            return False
        if self._home_s is None or now_s - self._home_s > _AUTOPILOT_TIMEOUT_S:
            self._home = address
        elif address != self._home:
            if address is not None and now_s >= self._elsewhere_due_s:
                self._elsewhere_due_s = now_s + _REPORT_PERIOD_S
                self._events.append(AutopilotElsewhere(link=self._link, address=address))
            return True
        self._home_s = now_s
        return False

    def forget_autopilot(self) -> None:
        """Another autopilot was found: it is where it is heard next."""
        self._home, self._home_s, self._elsewhere_due_s = None, None, -math.inf

    def admit(
        self,
        address: Address | None,
        sources: AbstractSet[tuple[int, int]],
        allows: Callable[[int], bool],
        now_s: float,
    ) -> None:
        """Take an address for a peer when a system that is allowed has sent a valid packet.

        sources: of the valid packets that have just come from it. allows: whether a system id is.
        """
        if len(self.sources) < _SOURCES_TOLD:
            self.sources |= sources
        if address is None or not sources:
            return
        systems = sorted({system_id for system_id, _ in sources})
        if any(map(allows, systems)):
            self._note_valid(address, now_s)
        elif now_s >= self._refusal_due_s:
            self._refusal_due_s = now_s + _REPORT_PERIOD_S
            self._events.append(PeerRefused(link=self._link, address=address, system_id=systems[0]))

    def _note_valid(self, address: Address, now_s: float) -> None:
        """Where eight are there, the one that has been silent longest leaves, if long enough.

        Else the new one has to wait. The autopilot's never leaves, and never waits.
        """
        peer = self._peers.get(address)
        if peer is not None:
            peer.last_s = now_s
            return
        if len(self._peers) >= _MOST_PEERS:
            others = [known for known in self._peers if known != self._home]
            oldest = min(others, key=lambda known: self._peers[known].last_s)
            if address != self._home and not self._peers[oldest].may_leave(now_s):
                return
            del self._peers[oldest]
        self._peers[address] = _Peer(self._of_strangers, now_s)
        self._of_strangers.whole_packets = False
        self._of_strangers = self._codec_of_strangers()

    def _codec_of_strangers(self) -> Codec:
        codec = self._make_codec()
        codec.whole_packets = True
        return codec
