"""Peer addresses of a listening link: the ones it sends to, and the codec of each. No I/O.

UDP carries the sender's address, which may be forged. So the link sends to an address only after a
valid packet of an allowed system from it. Each peer has its own codec, so that bytes never mix.
A stream (TCP, a serial line) has one peer, whose address is None.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Callable
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from typing import Any

from ..settings.link_config import LinkRole
from .codec import Codec

Address = tuple[Any, ...]
"""Address of a socket: host and port, and for IPv6 two more values."""

_MOST_PEERS = 8
_PEER_TIMEOUT_S = 10.0
"""Silence after which the link stops sending to a peer."""
_SILENT_S = 3.0
"""Three heartbeat periods: the least silence after which a new peer may replace a peer. A peer
received for longer keeps its place for as long, up to the timeout."""
_AUTOPILOT_TIMEOUT_S = 3.0
"""Silence of the autopilot at its address after which it may have another address, for example
after a router's restart. The autopilot's link is lost after the same time."""
_REPORT_PERIOD_S = 60.0
"""Least time between two reports of refused systems, and of foreign addresses with the autopilot's
ids. A network may have many of both, and an operator may connect after a report."""
_SOURCES_TOLD = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class AutopilotElsewhere:
    """Packets with the autopilot's ids arrive from a foreign address; the session ignores them."""

    link: str
    address: Address


@dataclass(frozen=True, slots=True, kw_only=True)
class PeerRefused:
    """A system without permission sends to a listening link; the link does not send to it."""

    link: str
    address: Address
    system_id: int


class Precedence(enum.IntEnum):
    """Reading order of bytes: the autopilot's and a stream's, a peer's, an unknown sender's."""

    AUTOPILOT = 0
    PEER = 1
    STRANGER = 2


class _Peer:
    __slots__ = ("codec", "first_s", "last_s")

    def __init__(self, codec: Codec, now_s: float) -> None:
        self.codec = codec
        self.first_s = self.last_s = now_s

    def may_leave(self, now_s: float) -> bool:
        received_for_s = self.last_s - self.first_s
        return now_s - self.last_s > min(max(_SILENT_S, received_for_s), _PEER_TIMEOUT_S)


class Peers:
    """Peers of one link: on a listening link eight addresses at most, with the autopilot's.

    role: of the link's other end. make_codec: makes the codec of one address.
    """

    def __init__(self, link: str, role: LinkRole, make_codec: Callable[[], Codec]) -> None:
        self._link = link
        self._role = role
        self._make_codec = make_codec
        self._of_stream = make_codec()
        self._of_strangers = self._codec_of_strangers()
        self._peers: dict[Address, _Peer] = {}
        self._home: Address | None = None
        """Address of the autopilot; None on a stream, and before its first packet."""
        self._home_s: float | None = None
        self._elsewhere_due_s = -math.inf
        self._refusal_due_s = -math.inf
        self._events: list[AutopilotElsewhere | PeerRefused] = []
        self.sources: set[tuple[int, int]] = set()
        """First eight or more sources received on this link: system and component ids."""

    def events_received(self) -> list[AutopilotElsewhere | PeerRefused]:
        """Returns the events since the last call."""
        events, self._events = self._events, []
        return events

    def codec(self, address: Address | None) -> Codec:
        """Codec for the next bytes from an address; of an unknown sender, whole packets only."""
        if address is None:
            return self._of_stream
        peer = self._peers.get(address)
        if peer is not None:
            return peer.codec
        self._of_strangers.forget()
        return self._of_strangers

    def precedence(self, address: Address | None) -> Precedence:
        """Reading order of the bytes from an address under overload."""
        if address is None or address == self._home:
            return Precedence.AUTOPILOT
        return Precedence.PEER if address in self._peers else Precedence.STRANGER

    @property
    def autopilots_codec(self) -> Codec:
        """Codec of the autopilot's address."""
        peer = None if self._home is None else self._peers.get(self._home)
        return self._of_stream if peer is None else peer.codec

    def addresses(self, now_s: float) -> tuple[Address, ...]:
        """Addresses to send to."""
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
        """Returns True if these sources include the autopilot's ids at a foreign address.

        autopilot: its system and component id; None: not known yet. Its address is the one of its
        first packet, until 3 s without a packet from there. An operator's link never carries the
        autopilot.
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
        """Drops the autopilot's address after another was found; its next packet sets it."""
        self._home, self._home_s, self._elsewhere_due_s = None, None, -math.inf

    def admit(
        self,
        address: Address | None,
        sources: AbstractSet[tuple[int, int]],
        allows: Callable[[int], bool],
        now_s: float,
    ) -> None:
        """Makes an address a peer after a valid packet of an allowed system.

        sources: of the valid packets just received from it. allows: True for an allowed system id.
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
        """Adds or refreshes a peer; beyond eight, replaces the one silent longest, if long enough.

        Otherwise the new peer has to wait. The autopilot's address is never replaced, never waits.
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
