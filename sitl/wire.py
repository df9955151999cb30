"""MAVLink 2 packets from field values, and the messages that pymavlink does not have.

pymavlink's own `pack` builds one message object per packet; a vehicle sends 350 of them a second
on each link. Here the payload is packed once from pymavlink's field tables and framed per link.
"""

import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import all as mavlink

MAGIC_V2 = 0xFD
MAX_CHUNK = 50
"""Characters in one STATUSTEXT."""
_HEADER = struct.Struct("<BBBBBBBHB")


@dataclass(frozen=True, slots=True)
class Layout:
    """Layout of one message: fields in wire order, and the check byte."""

    msgid: int
    name: str
    crc_extra: int
    fields: tuple[str, ...]
    packer: struct.Struct
    arrays: frozenset[str]

    def payload(self, **values: Any) -> bytes:
        """Pack the fields, trailing zero bytes cut as MAVLink 2 does."""
        if self.arrays:
            flat: list[Any] = []
            for name in self.fields:
                if name in self.arrays:
                    flat.extend(values[name])
                else:
                    flat.append(values[name])
            raw = self.packer.pack(*flat)
        else:
            raw = self.packer.pack(*[values[name] for name in self.fields])
        return raw.rstrip(b"\0") or raw[:1]


def frame(
    layout: Layout, payload: bytes, *, seq: int, system: int, component: int, signed: bool = False
) -> bytes:
    """Return one whole MAVLink 2 packet; with `signed` its signature must follow."""
    msgid = layout.msgid
    body = (
        _HEADER.pack(
            MAGIC_V2,
            len(payload),
            int(signed),
            0,
            seq,
            system,
            component,
            msgid & 0xFFFF,
            msgid >> 16,
        )
        + payload
    )
    crc: int = mavlink.x25crc(body[1:] + bytes((layout.crc_extra,))).crc
    return body + crc.to_bytes(2, "little")


def packet_header(raw: bytes | bytearray) -> tuple[int, int, int]:
    """Return (message id, system, component) of a whole packet, MAVLink 1 or 2."""
    if raw[0] == MAGIC_V2:
        return raw[7] | raw[8] << 8 | raw[9] << 16, raw[5], raw[6]
    return raw[5], raw[3], raw[4]


def _from_pymavlink(name: str) -> Layout:
    cls = getattr(mavlink, f"MAVLink_{name.lower()}_message")
    lengths = dict(zip(cls.ordered_fieldnames, cls.lengths, strict=True))
    arrays = {
        field
        for field, kind in zip(cls.fieldnames, cls.fieldtypes, strict=True)
        if kind != "char" and lengths[field] > 1
    }
    return Layout(
        cls.id, name, cls.crc_extra, tuple(cls.ordered_fieldnames), cls.unpacker, frozenset(arrays)
    )


def _extra(
    msgid: int, name: str, crc_extra: int, form: str, fields: str, arrays: Iterable[str] = ()
) -> Layout:
    return Layout(
        msgid, name, crc_extra, tuple(fields.split()), struct.Struct(form), frozenset(arrays)
    )


_EXTRA = (
    _extra(
        8,
        "LINK_NODE_STATUS",
        117,
        "<QIIIIIHHHBB",
        "timestamp tx_rate rx_rate messages_sent messages_received messages_lost"
        " rx_parse_err tx_overflows rx_overflows tx_buf rx_buf",
    ),
    _extra(
        300,
        "PROTOCOL_VERSION",
        217,
        "<HHH8s8s",
        "version min_version max_version spec_version_hash library_version_hash",
    ),
    _extra(
        380,
        "TIME_ESTIMATE_TO_TARGET",
        232,
        "<iiiii",
        "safe_return land mission_next_item mission_end commanded_action",
    ),
    _extra(397, "COMPONENT_METADATA", 182, "<II100s", "time_boot_ms file_crc uri"),
    _extra(
        410,
        "EVENT",
        160,
        "<IIHBBB40s",
        "id event_time_boot_ms sequence destination_component destination_system"
        " log_levels arguments",
    ),
    _extra(411, "CURRENT_EVENT_SEQUENCE", 106, "<HB", "sequence flags"),
    _extra(
        435,
        "AVAILABLE_MODES",
        134,
        "<IIBBB35s",
        "custom_mode properties number_modes mode_index standard_mode mode_name",
    ),
    _extra(436, "CURRENT_MODE", 193, "<IIB", "custom_mode intended_custom_mode standard_mode"),
)
_BY_NAME: dict[str, Layout] = {layout.name: layout for layout in _EXTRA}


def layout(name: str) -> Layout:
    """Return the layout of a message, by name."""
    found = _BY_NAME.get(name)
    if found is None:
        found = _BY_NAME[name] = _from_pymavlink(name)
    return found


def status_texts(severity: int, text: str, message_id: int) -> list[bytes]:
    """Return STATUSTEXT payloads: one, or chunks of 50 characters that share a non-zero id."""
    raw = text.encode("ascii", "replace")
    chunks = [raw[i : i + MAX_CHUNK] for i in range(0, len(raw), MAX_CHUNK)] or [b""]
    identifier = message_id if len(chunks) > 1 else 0
    return [
        layout("STATUSTEXT").payload(severity=severity, text=chunk, id=identifier, chunk_seq=i)
        for i, chunk in enumerate(chunks)
    ]


def packets(data: bytes) -> Iterator[bytes]:
    """Cut whole packets that follow each other apart."""
    at = 0
    while at < len(data):
        header, signature = (12, 13 if data[at + 2] & 1 else 0) if data[at] == MAGIC_V2 else (8, 0)
        end = at + header + data[at + 1] + signature
        yield data[at:end]
        at = end
