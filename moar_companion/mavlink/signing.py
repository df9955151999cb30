"""MAVLink 2 message signing: which packets a link accepts, and the time stamps of ours. No I/O.

A signature is the link id, a time stamp in units of 10 us since 2015 and the first 48 bits of
SHA-256 over key, packet, link id and time stamp. The wall clock comes in as a value; between two of
its values a link's time stamp advances with each packet, and with each later one of a peer.

Source: https://mavlink.io/en/guide/message_signing.html.
"""

from __future__ import annotations

import enum
import hashlib
import hmac
from collections.abc import Iterable, Mapping, MutableMapping
from dataclasses import dataclass, field
from typing import TypeAlias

from ..config import LinkConfig

KEY_BYTES = 32
SIGNATURE_BYTES = 13
"""Link id 1, time stamp 6, hash 6."""
SIGNED_FLAG = 0x01
"""In the incompatibility flags, the third byte of a MAVLink 2 packet."""
UNITS_PER_S = 100_000
LATEST_TIMESTAMP = (1 << 48) - 1

_MARKER_V2 = 0xFD
_HASH_BYTES = 6
_EPOCH_S = 1_420_070_400
"""2015-01-01 UTC, in seconds since 1970."""
_NEW_STREAM_UNITS = 60 * UNITS_PER_S
"""How far the first packet of a stream may be behind our time stamp (specification)."""
_DETOUR_UNITS = 5 * UNITS_PER_S
"""How far a copy over another link may be behind: the time in which the command ledger knows it for
a copy. Beyond it a packet that was recorded on one link cannot be replayed on another."""

_Stream: TypeAlias = tuple[int, int, int]
"""System id, component id, link id of the sender."""


class SigningKey:
    """The secret of a network; never printed. Raises ValueError unless 32 bytes, not all zero."""

    __slots__ = ("secret",)

    def __init__(self, secret: bytes) -> None:
        if len(secret) != KEY_BYTES:
            raise ValueError(f"has {len(secret)} bytes, must have {KEY_BYTES}")
        if not any(secret):
            raise ValueError("is all zero, must be random")
        self.secret = secret

    def __repr__(self) -> str:
        return "SigningKey(secret)"


class Refusal(str, enum.Enum):
    """Why a packet is refused, in words for people."""

    UNSIGNED = "unsigned"
    WRONG = "wrong signature"
    OLD = "old or replayed"


@dataclass(frozen=True, slots=True, kw_only=True)
class Signing:
    """What the links start with.

    wall_s: seconds since 1970. kept: the time stamp of each link (by its URL) that an earlier
    process kept; a link without one starts after all of them.
    """

    key: SigningKey
    wall_s: float
    kept: Mapping[str, int] = field(default_factory=dict)


class LinkSigning:
    """One link's signatures. link_id: of ours. newest: time stamps by stream over all links."""

    def __init__(
        self,
        key: SigningKey,
        *,
        link_id: int,
        timestamp: int,
        newest: MutableMapping[_Stream, int] | None = None,
    ) -> None:
        self.key = key
        self.link_id = link_id
        self.timestamp = timestamp
        """The greatest that was sent, accepted, or told by the wall clock."""
        self.refused = dict.fromkeys(Refusal, 0)
        """Whole packets that its codecs have refused."""
        self._streams: dict[_Stream, int] = {}
        self._newest: MutableMapping[_Stream, int] = {} if newest is None else newest

    def advance(self, wall_s: float) -> None:
        """Takes the wall clock, in seconds since 1970; a clock that goes back changes nothing."""
        self._advance_to(timestamp_at(wall_s))

    def next_timestamp(self) -> int:
        """The time stamp of our next packet: later than all before it."""
        self._advance_to(self.timestamp + 1)
        return self.timestamp

    def refusal(self, packet: bytes) -> Refusal | None:
        """Why a whole packet is refused; None: it is accepted, and will not be a second time."""
        if packet[0] != _MARKER_V2 or not packet[2] & SIGNED_FLAG:
            return Refusal.UNSIGNED
        hashed = hashlib.sha256(self.key.secret + packet[:-_HASH_BYTES]).digest()
        if not hmac.compare_digest(hashed[:_HASH_BYTES], packet[-_HASH_BYTES:]):
            return Refusal.WRONG
        link_id = packet[-SIGNATURE_BYTES]
        timestamp = int.from_bytes(packet[1 - SIGNATURE_BYTES : -_HASH_BYTES], "little")
        stream = packet[5], packet[6], link_id
        last = self._streams.get(stream, self.timestamp - _NEW_STREAM_UNITS - 1)
        newest = self._newest.get(stream, 0)
        if timestamp <= last or timestamp < newest - _DETOUR_UNITS:
            return Refusal.OLD
        self._streams[stream] = timestamp
        self._newest[stream] = max(timestamp, newest)
        self._advance_to(timestamp)
        return None

    def _advance_to(self, timestamp: int) -> None:
        self.timestamp = min(LATEST_TIMESTAMP, max(self.timestamp, timestamp))


def timestamp_at(wall_s: float) -> int:
    """The time stamp of a wall clock in seconds since 1970; before 2015 it is 0."""
    return max(0, int((wall_s - _EPOCH_S) * UNITS_PER_S))


def link_signings(links: Iterable[LinkConfig], signing: Signing | None) -> dict[str, LinkSigning]:
    """The signatures of those links that ask for them, by URL; the link id is the place in `links`.

    Raises ValueError when a link asks for them and there is no key.
    """
    newest: dict[_Stream, int] = {}
    found = {}
    for link_id, link in enumerate(links):
        if not link.signed:
            continue
        if signing is None:
            raise ValueError(f"{link.url} asks for signatures, and there is no key")
        kept = signing.kept.get(link.url, max(signing.kept.values(), default=0))
        timestamp = min(LATEST_TIMESTAMP, max(kept, timestamp_at(signing.wall_s)))
        found[link.url] = LinkSigning(
            signing.key, link_id=link_id & 0xFF, timestamp=timestamp, newest=newest
        )
    return found
