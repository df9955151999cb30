"""Bytes to messages and back: MAVLink 1 and 2 framing, checks, signatures, numbers. No I/O.

pymavlink's own parser drops as many bytes as a false start marker claims, up to 280, and builds
every message. This parser skips one byte at a false marker and builds only the wanted messages.
PX4 sends 350 messages a second; the companion needs half of them.

Source: https://mavlink.io/en/guide/serialization.html.
"""

from __future__ import annotations

import binascii
import operator
import re
from collections.abc import Callable, Container
from functools import cache
from typing import Any

from .dialect import Message, mavlink
from .packet_count import BOOT_TIME_AT, PacketCount, SourceStatistics
from .signing import SIGNATURE_BYTES, SIGNED_FLAG, LinkSigning, SigningRefusal
from .translate_radio import RADIO_IDS

_MARKERS = re.compile(b"[\xfd\xfe]")
_MARKER_V2 = 0xFD
_OVERHEAD_V1 = 8
"""Bytes of a MAVLink 1 frame around its payload: header 6, checksum 2."""
_OVERHEAD_V2 = 12
"""Bytes of a MAVLink 2 frame around its payload: header 10, checksum 2."""

SECRETS = frozenset(
    {int(mavlink.MAVLINK_MSG_ID_AUTH_KEY), int(mavlink.MAVLINK_MSG_ID_SETUP_SIGNING)}
)
"""Messages that carry a key: never recorded."""

_ANSWERS = frozenset(
    {
        int(mavlink.MAVLINK_MSG_ID_PARAM_VALUE),
        int(mavlink.MAVLINK_MSG_ID_PARAM_EXT_VALUE),
        int(mavlink.MAVLINK_MSG_ID_MISSION_ITEM),
        int(mavlink.MAVLINK_MSG_ID_MISSION_ITEM_INT),
        int(mavlink.MAVLINK_MSG_ID_LOG_ENTRY),
        int(mavlink.MAVLINK_MSG_ID_LOG_DATA),
        int(mavlink.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL),
        int(mavlink.MAVLINK_MSG_ID_STATUSTEXT),
    }
)
"""Messages that are no streams: they arrive in bursts, on a request or an event."""

_MOST_SOURCES = 256
"""Limit of sources with counted packets: invented ids must not fill the memory."""

_BITS_REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


def checksum(data: bytes | bytearray) -> int:
    """CRC-16/MCRF4XX, MAVLink's checksum, by the CRC-CCITT of `binascii` on reversed bits."""
    mirrored = binascii.crc_hqx(data.translate(_BITS_REVERSED), 0xFFFF)
    return _BITS_REVERSED[mirrored >> 8] | _BITS_REVERSED[mirrored & 0xFF] << 8


class Codec:
    """Framing of one link: bytes in any portions to messages, messages to bytes.

    system_id, component_id: the companion's, in every encoded packet. wanted: ids of the messages
    to build; others are only checked and counted; None builds all of the dialect. signing: signs
    every sent packet and refuses packets without a correct signature; None ignores signatures.
    """

    def __init__(
        self,
        *,
        system_id: int,
        component_id: int,
        wanted: Container[int] | None = None,
        signing: LinkSigning | None = None,
    ) -> None:
        self._packer = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=component_id)
        self._wanted = wanted
        self._signing = signing
        if signing is not None:
            self._packer.signing.secret_key = signing.key.secret
            self._packer.signing.link_id = signing.link_id
            self._packer.signing.sign_outgoing = True
        self.whole_packets = False
        """True where one `receive` gets one datagram of whole packets. The first byte that starts
        no valid packet ends the datagram, so the cost is that of its packets."""
        self._buffer = bytearray()
        self._sources: dict[tuple[int, int], PacketCount] = {}
        self.packets: list[bytes] = []
        """Packets that the last `receive` completed, wanted or not, for a record.

        Without refused packets and those with a secret (SETUP_SIGNING, AUTH_KEY)."""
        self.sound_sources: set[tuple[int, int]] = set()
        """Sources of the packets of the last `receive` with a correct checksum or signature."""
        self.unwanted: list[tuple[tuple[int, int], int]] = []
        """Source and message id of the streamed messages that the last `receive` did not build."""
        self.unknown_messages = 0
        """Count of frames of messages outside the dialect; their checksum cannot be verified."""
        self.dropped_bytes = 0
        """Bytes outside frames: noise and remains of corrupted frames."""
        self.refused = dict.fromkeys(SigningRefusal, 0) if signing is None else signing.refused
        """Whole packets refused on this link for their signature or the lack of one, by reason."""

    @property
    def system_id(self) -> int:
        """System id of every packet encoded from now on."""
        return int(self._packer.srcSystem)

    @system_id.setter
    def system_id(self, system_id: int) -> None:
        self._packer.srcSystem = system_id

    def statistics(self, system_id: int, component_id: int) -> SourceStatistics:
        """Packet counts of one source on this link."""
        source = self._sources.get((system_id, component_id))
        return SourceStatistics(received=0, lost=0) if source is None else source.statistics

    @property
    def sources(self) -> list[tuple[int, int]]:
        """System and component ids of all received sources, in order."""
        return list(self._sources)

    def encode(self, message: Message) -> bytes:
        """Message as a MAVLink 2 packet with the companion's ids and the next sequence number."""
        if self._signing is not None:
            self._packer.signing.timestamp = self._signing.next_timestamp()
        data = bytes(message.pack(self._packer))
        self._packer.seq = (self._packer.seq + 1) & 0xFF
        return data

    def forget(self) -> None:
        """Resets the parser: drops incomplete frames and all known sources."""
        self._buffer.clear()
        self._sources.clear()

    def receive(self, data: bytes) -> list[Message]:
        """Returns the wanted messages that these bytes complete; never raises.

        Bytes may be split anywhere. Noise, corrupted and truncated frames are skipped, and the
        copies of packets that a loop of routers makes.
        `get_signed()` of a message is True if its packet was correctly signed.
        """
        buffer = self._buffer
        buffer += data
        self.packets = []
        self.sound_sources = set()
        self.unwanted = []
        messages: list[Message] = []
        position = 0
        end = len(buffer)
        while position < end:
            if buffer[position] not in {0xFD, 0xFE}:
                if self.whole_packets:
                    break
                marker = _MARKERS.search(buffer, position)
                start = end if marker is None else marker.start()
                self.dropped_bytes += start - position
                position = start
                continue
            size = frame_size(buffer, position, end)
            if size is None or position + size > end:
                break
            if size > 0 and self._accept(buffer, position, size, messages):
                position += size
            elif self.whole_packets:
                break
            else:
                position += 1
                self.dropped_bytes += 1
        if self.whole_packets:
            self.dropped_bytes += end - position
            position = end
        del buffer[:position]
        return messages

    def _accept(self, buffer: bytearray, position: int, size: int, messages: list[Message]) -> bool:
        """Returns True for a valid frame; counts it and appends its message if wanted."""
        length = buffer[position + 1]
        sequence, system_id, component_id, message_id, payload_start = _header(buffer, position)
        payload_end = payload_start + length
        message_class = mavlink.mavlink_map.get(message_id)
        if message_class and not _is_sound(buffer, position, payload_end, message_class):
            return False
        packet = bytes(buffer[position : position + size])
        source = self._sources.get((system_id, component_id))
        if source is not None and source.is_copy(packet):
            self.sound_sources.add((system_id, component_id))
            return True
        refusal = None if self._signing is None else self._signing.refusal(packet)
        if message_class is None:
            # A frame of an unknown message can only be checked by its signature. Unsigned, the
            # frame counts if its source is known and a frame follows; noise would pass otherwise.
            after = position + size
            if self._signing is None:
                if source is None or (after < len(buffer) and buffer[after] not in {0xFD, 0xFE}):
                    return False
            elif refusal in {SigningRefusal.UNSIGNED, SigningRefusal.WRONG}:
                return False
        if refusal is not None:
            # A radio inserts its messages unsigned: a healthy link carries one each second.
            self.refused[refusal] += refusal is not SigningRefusal.UNSIGNED or (
                message_id not in RADIO_IDS
            )
            return True
        if source is None:
            source = self._new_source(system_id, component_id)
        wanted = self._wanted is None or message_id in self._wanted
        off_stream = message_class is not None and (message_id in _ANSWERS or not wanted)
        boot_ms = _boot_ms(buffer, message_id, payload_start, payload_end)
        source.count(packet, sequence, boot_ms=boot_ms, off_stream=off_stream)
        if message_class is not None or self._signing is not None:
            self.sound_sources.add((system_id, component_id))
        if message_class is None:
            self.unknown_messages += 1
            self.packets.append(packet)
            return True
        if message_id not in SECRETS:
            self.packets.append(packet)
        if wanted:
            message = _build(message_class, bytes(buffer[payload_start:payload_end]))
            header = message.get_header()
            header.mlen = length
            header.seq = sequence
            header.srcSystem = system_id
            header.srcComponent = component_id
            message.get_msgbuf().extend(packet)
            message._signed = self._signing is not None  # noqa: SLF001 - get_signed() tells it
            messages.append(message)
        elif message_id not in _ANSWERS:
            self.unwanted.append(((system_id, component_id), message_id))
        return True

    def _new_source(self, system_id: int, component_id: int) -> PacketCount:
        """Starts to count a source; beyond the limit, drops the source with the fewest packets."""
        sources = self._sources
        if len(sources) >= _MOST_SOURCES:
            del sources[min(sources, key=lambda ids: sources[ids].received)]
        sources[system_id, component_id] = source = PacketCount()
        return source


def is_sound(buffer: bytes | bytearray, position: int) -> bool | None:
    """Returns True if the whole frame at `position` has its checksum; None: unknown message."""
    *_, message_id, payload_start = _header(buffer, position)
    message_class = mavlink.mavlink_map.get(message_id)
    if message_class is None:
        return None
    return _is_sound(buffer, position, payload_start + buffer[position + 1], message_class)


def frame_head(buffer: bytes | bytearray, position: int) -> tuple[int, int, int] | None:
    """Message id, start and length of the payload of the frame at a marker; None: cut short."""
    begin = 10 if buffer[position] == _MARKER_V2 else 6
    if position + begin > len(buffer):
        return None
    *_, message_id, start = _header(buffer, position)
    return message_id, start, buffer[position + 1]


def checksum_of(buffer: bytes | bytearray, position: int) -> bytes:
    """The checksum, two bytes, that a frame of a known message should have."""
    *_, message_id, start = _header(buffer, position)
    checked = bytearray(buffer[position + 1 : start + buffer[position + 1]])
    checked.append(mavlink.mavlink_map[message_id].crc_extra)
    return checksum(checked).to_bytes(2, "little")


def packet_source(packet: bytes) -> tuple[int, int]:
    """System and component id of a whole packet."""
    _, system_id, component_id, _, _ = _header(packet, 0)
    return system_id, component_id


def _header(buffer: bytes | bytearray, position: int) -> tuple[int, int, int, int, int]:
    """Sequence, system, component and message id of a frame, and the start of its payload."""
    if buffer[position] == _MARKER_V2:
        sequence, system_id, component_id, low, middle, high = buffer[position + 4 : position + 10]
        return sequence, system_id, component_id, low | middle << 8 | high << 16, position + 10
    sequence, system_id, component_id, message_id = buffer[position + 2 : position + 6]
    return sequence, system_id, component_id, message_id, position + 6


def _boot_ms(buffer: bytearray, message_id: int, start: int, end: int) -> int | None:
    """Sender's clock in a payload from `start` to `end`; None for a message without it."""
    at = BOOT_TIME_AT.get(message_id)
    # MAVLink 2 cuts trailing zeros of a payload.
    return (
        None
        if at is None
        else int.from_bytes(buffer[start + at : min(start + at + 4, end)], "little")
    )


def _is_sound(
    buffer: bytes | bytearray, position: int, payload_end: int, message_class: Any
) -> bool:
    checked = bytearray(buffer[position + 1 : payload_end])
    checked.append(message_class.crc_extra)
    return checksum(checked) == buffer[payload_end] | buffer[payload_end + 1] << 8


def frame_size(buffer: bytes | bytearray, position: int, end: int) -> int | None:
    """Length of the frame at `position`; None: more bytes are needed; 0: no frame starts there.

    `position` must hold a marker; `end` is the buffer's.
    """
    if end - position < 3:
        return None
    if buffer[position] != _MARKER_V2:
        return _OVERHEAD_V1 + buffer[position + 1]
    flags = buffer[position + 2]
    if flags & ~SIGNED_FLAG:
        # "Incompatibility flags": a receiver must drop a packet with a flag that it does not
        # support.
        return 0
    return _OVERHEAD_V2 + buffer[position + 1] + (SIGNATURE_BYTES if flags else 0)


def _build(message_class: Any, payload: bytes) -> Message:
    """Message of a payload; restores the trailing zeros that MAVLink 2 cuts.

    A payload longer than the definition ends with fields of a newer one: they are ignored.
    """
    size = message_class.unpacker.size
    values = message_class.unpacker.unpack(payload.ljust(size, b"\x00")[:size])
    return message_class(*_arranger(message_class)(values))


@cache
def _arranger(message_class: Any) -> Callable[[tuple[Any, ...]], Any]:
    """Function from unpacked values in wire order to the constructor's arguments."""
    lengths = message_class.lengths
    orders = message_class.orders
    if len(orders) == 1:
        count = lengths[0]
        return (lambda values: values) if count == 1 else (lambda values: (list(values),))
    if all(length == 1 for length in lengths):
        return operator.itemgetter(*orders)
    slices = [(sum(lengths[:order]), lengths[order]) for order in orders]

    def arrange(values: tuple[Any, ...]) -> list[Any]:
        return [
            values[start] if count == 1 else list(values[start : start + count])
            for start, count in slices
        ]

    return arrange
