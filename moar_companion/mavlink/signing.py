"""MAVLink 2 message signing: acceptance of packets, and the companion's time stamps. No I/O.

A signature is the link id, a time stamp and the first 48 bits of SHA-256 over key, packet, link id
and time stamp. The unit of the time stamp is 10 us, since 2015. The wall clock is an input. Between
two of its values a link's time stamp advances with each sent packet, and to each later stamp of a
peer. New senders are compared with the wall clock alone, if it is set. Otherwise one peer with a
clock ahead would cause the refusal of all others.

Source: https://mavlink.io/en/guide/message_signing.html.
"""

from __future__ import annotations

import enum
import hashlib
import hmac
from collections.abc import Iterable, Mapping, MutableMapping
from dataclasses import dataclass, field
from typing import TypeAlias

from ..settings.link_config import LinkConfig

KEY_BYTES = 32
SIGNATURE_BYTES = 13
"""Bytes of a signature: link id 1, time stamp 6, hash 6."""
SIGNED_FLAG = 0x01
"""Flag in the incompatibility flags, the third byte of a MAVLink 2 packet."""
UNITS_PER_S = 100_000
LATEST_TIMESTAMP = (1 << 48) - 1

_MARKER_V2 = 0xFD
_HASH_BYTES = 6
_EPOCH_S = 1_420_070_400
"""2015-01-01 UTC, in seconds since 1970."""
_NEW_STREAM_UNITS = 60 * UNITS_PER_S
"""Greatest lag of a stream's first packet behind the reference (specification)."""
_DETOUR_UNITS = 5 * UNITS_PER_S
"""Greatest lag of a copy over another link: the time in which `received_commands` detects copies.
After it a packet recorded on one link cannot be replayed on another."""

_Stream: TypeAlias = tuple[int, int, int]
"""System id, component id, link id of the sender."""


class SigningKey:
    """Secret of a network; never printed. Raises ValueError unless 32 bytes, not all zero."""

    __slots__ = ("secret",)

    def __init__(self, secret: bytes) -> None:
        if len(secret) != KEY_BYTES:
            raise ValueError(f"has {len(secret)} bytes, must have {KEY_BYTES}")
        if not any(secret):
            raise ValueError("is all zero, must be random")
        self.secret = secret

    def __repr__(self) -> str:
        return "SigningKey(secret)"


class SigningRefusal(str, enum.Enum):
    """Reason why a packet is refused, as a text."""

    UNSIGNED = "unsigned"
    WRONG = "wrong signature"
    OLD = "old or replayed"


@dataclass(frozen=True, slots=True, kw_only=True)
class Signing:
    """Initial state of the signed links.

    wall_s: seconds since 1970. kept: time stamp of each link (by URL) from an earlier process; a
    link without one starts at the greatest of them. references: likewise the reference for new
    senders.
    """

    key: SigningKey
    wall_s: float
    kept: Mapping[str, int] = field(default_factory=dict)
    references: Mapping[str, int] = field(default_factory=dict)


class LinkSigning:
    """Signatures of one link. link_id: of sent packets. newest: time stamps by stream, all links.

    timestamp: the next sent stamps are later. reference: stamp with which new streams are compared,
    until the wall clock is later; None: timestamp.
    """

    def __init__(
        self,
        key: SigningKey,
        *,
        link_id: int,
        timestamp: int,
        reference: int | None = None,
        newest: MutableMapping[_Stream, int] | None = None,
    ) -> None:
        self.key = key
        self.link_id = link_id
        self.timestamp = timestamp
        """Greatest time stamp that was sent, accepted, or read from the wall clock."""
        self.reference = timestamp if reference is None else reference
        """Greatest time stamp of the wall clock, in this process or before.

        While the wall clock is not set (before 2015, or over a minute behind this), peers' time
        stamps count, too: nothing else distinguishes a recorded packet from a new one."""
        self.ahead_s = 0.0
        """Lead of the reference over the wall clock at the last reading; 0 without a lead."""
        self.behind_s: dict[int, float] = {}
        """Lag of the systems with a first packet refused as too old, by system id."""
        self._clock_is_set = False
        self.refused = dict.fromkeys(SigningRefusal, 0)
        """Count of whole packets refused by its codecs, by reason."""
        self._streams: dict[_Stream, int] = {}
        self._newest: MutableMapping[_Stream, int] = {} if newest is None else newest

    def advance(self, wall_s: float) -> None:
        """Takes the wall clock, in seconds since 1970; a clock that is set back moves no stamp."""
        wall = timestamp_at(wall_s)
        self._clock_is_set = wall > 0 and wall >= self.reference - _NEW_STREAM_UNITS
        self.reference = max(self.reference, wall)
        self.ahead_s = (self.reference - wall) / UNITS_PER_S
        self._advance_to(wall)

    def next_timestamp(self) -> int:
        """Time stamp of the next sent packet: later than all before it."""
        self._advance_to(self.timestamp + 1)
        return self.timestamp

    def refusal(self, packet: bytes) -> SigningRefusal | None:
        """Reason why a whole packet is refused; None: accepted, and refused when repeated."""
        if packet[0] != _MARKER_V2 or not packet[2] & SIGNED_FLAG:
            return SigningRefusal.UNSIGNED
        hashed = hashlib.sha256(self.key.secret + packet[:-_HASH_BYTES]).digest()
        if not hmac.compare_digest(hashed[:_HASH_BYTES], packet[-_HASH_BYTES:]):
            return SigningRefusal.WRONG
        link_id = packet[-SIGNATURE_BYTES]
        timestamp = int.from_bytes(packet[1 - SIGNATURE_BYTES : -_HASH_BYTES], "little")
        stream = packet[5], packet[6], link_id
        last = self._streams.get(stream, self.reference - _NEW_STREAM_UNITS - 1)
        newest = self._newest.get(stream, 0)
        if timestamp <= last or timestamp < newest - _DETOUR_UNITS:
            if stream not in self._streams and timestamp <= last:
                self.behind_s[packet[5]] = (self.reference - timestamp) / UNITS_PER_S
            return SigningRefusal.OLD
        self.behind_s.pop(packet[5], None)
        self._streams[stream] = timestamp
        self._newest[stream] = max(timestamp, newest)
        self._advance_to(timestamp)
        if not self._clock_is_set:
            self.reference = max(self.reference, timestamp)
        return None

    def _advance_to(self, timestamp: int) -> None:
        self.timestamp = min(LATEST_TIMESTAMP, max(self.timestamp, timestamp))


@dataclass(frozen=True, slots=True, kw_only=True)
class SigningState:
    """State of the signed links, by URL.

    timestamps: a later process must start after them. references: for new senders, for a later
    process. packets_refused: counts by reason.
    """

    timestamps: Mapping[str, int]
    references: Mapping[str, int]
    packets_refused: Mapping[str, Mapping[SigningRefusal, int]]


class SignedLinks:
    """Signatures of all signed links, by link; empty without any."""

    def __init__(self, links: Mapping[str, LinkSigning]) -> None:
        self._links = dict(links)

    def of(self, link: str) -> LinkSigning | None:
        """Signatures of a link; None if it is not signed."""
        return self._links.get(link)

    def note_wall_clock(self, wall_s: float) -> None:
        """Takes the wall clock, in seconds since 1970, for the time stamps of signatures."""
        for signing in self._links.values():
            signing.advance(wall_s)

    @property
    def state(self) -> SigningState:
        """State of all of them now."""
        return SigningState(
            timestamps={link: signing.timestamp for link, signing in self._links.items()},
            references={link: signing.reference for link, signing in self._links.items()},
            packets_refused=self.packets_refused,
        )

    @property
    def behind_s(self) -> dict[str, dict[int, float]]:
        """Lag of the systems that are refused as too old, by signed link and system id."""
        return {link: dict(signing.behind_s) for link, signing in self._links.items()}

    @property
    def ahead_s(self) -> float:
        """Greatest lead of the reference for new senders over the wall clock, of all links."""
        return max((signing.ahead_s for signing in self._links.values()), default=0.0)

    @property
    def packets_refused(self) -> dict[str, dict[SigningRefusal, int]]:
        """Count of refused packets by signed link and reason."""
        return {link: dict(signing.refused) for link, signing in self._links.items()}


def timestamp_at(wall_s: float) -> int:
    """Time stamp of a wall clock in seconds since 1970; 0 before 2015 and from 2104 on.

    No time stamp can follow the greatest one.
    """
    timestamp = int((wall_s - _EPOCH_S) * UNITS_PER_S)
    return timestamp if 0 <= timestamp < LATEST_TIMESTAMP else 0


def link_signings(links: Iterable[LinkConfig], signing: Signing | None) -> dict[str, LinkSigning]:
    """Signatures of the links configured as signed, by URL; link id: the index in `links`.

    Raises ValueError if a link is signed and there is no key.
    """
    newest: dict[_Stream, int] = {}
    found = {}
    for link_id, link in enumerate(links):
        if not link.signed:
            continue
        if signing is None:
            raise ValueError(f"{link.url} asks for signatures, and there is no key")
        kept = signing.kept.get(link.url, max(signing.kept.values(), default=0))
        references = signing.references
        found[link.url] = LinkSigning(
            signing.key,
            link_id=link_id & 0xFF,
            timestamp=kept,
            reference=references.get(link.url, max(references.values(), default=0)),
            newest=newest,
        )
        found[link.url].advance(signing.wall_s)
    return found
