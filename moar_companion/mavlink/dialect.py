"""MAVLink messages of the companion: pymavlink's `all` dialect and the messages it lacks.

PX4 sends LINK_NODE_STATUS, EVENT, CURRENT_EVENT_SEQUENCE, COMPONENT_METADATA and ESC_STATUS
unrequested. Ground stations send COMMAND_CANCEL, and request PROTOCOL_VERSION, COMPONENT_METADATA
or, before it, COMPONENT_INFORMATION. TIMESYNC has target fields, MISSION_COUNT an id of its plan.
No dialect of pymavlink 2.4.50 has these definitions. Importing this module adds them to the
dialect's `mavlink_map`; a definition of a later pymavlink with all these fields has precedence.

Source: the message definitions of mavlink/mavlink (common.xml, development.xml); checked against
recordings of PX4 v1.17 and v1.18.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import all as mavlink

__all__ = [
    "CURRENT_MODE_ID",
    "ESC_STATUS_ID",
    "LINK_NODE_STATUS_ID",
    "Message",
    "create",
    "id_of",
    "mavlink",
]

Message = Any
"""Instance of one of pymavlink's generated message classes."""

LINK_NODE_STATUS_ID = 8
ESC_STATUS_ID = 291
CURRENT_MODE_ID = 436
"""pymavlink has no names for these numbers."""

_FORMATS = {
    "char": "s",
    "uint8_t": "B",
    "uint16_t": "H",
    "uint32_t": "I",
    "uint64_t": "Q",
    "int32_t": "i",
    "int64_t": "q",
    "float": "f",
}


class _Definition(NamedTuple):
    """Definition of a message: fields in wire order, each a type, a name, a length."""

    message_id: int
    name: str
    crc_extra: int
    fields: tuple[tuple[str, str, int], ...]


_DEFINITIONS = (
    _Definition(
        message_id=LINK_NODE_STATUS_ID,
        name="LINK_NODE_STATUS",
        crc_extra=117,
        fields=(
            ("uint64_t", "timestamp", 0),
            ("uint32_t", "tx_rate", 0),
            ("uint32_t", "rx_rate", 0),
            ("uint32_t", "messages_sent", 0),
            ("uint32_t", "messages_received", 0),
            ("uint32_t", "messages_lost", 0),
            ("uint16_t", "rx_parse_err", 0),
            ("uint16_t", "tx_overflows", 0),
            ("uint16_t", "rx_overflows", 0),
            ("uint8_t", "tx_buf", 0),
            ("uint8_t", "rx_buf", 0),
        ),
    ),
    _Definition(
        message_id=44,
        name="MISSION_COUNT",
        crc_extra=221,
        fields=(
            ("uint16_t", "count", 0),
            ("uint8_t", "target_system", 0),
            ("uint8_t", "target_component", 0),
            ("uint8_t", "mission_type", 0),
            ("uint32_t", "opaque_id", 0),
        ),
    ),
    _Definition(
        message_id=80,
        name="COMMAND_CANCEL",
        crc_extra=14,
        fields=(
            ("uint16_t", "command", 0),
            ("uint8_t", "target_system", 0),
            ("uint8_t", "target_component", 0),
        ),
    ),
    _Definition(
        message_id=111,
        name="TIMESYNC",
        crc_extra=34,
        fields=(
            ("int64_t", "tc1", 0),
            ("int64_t", "ts1", 0),
            ("uint8_t", "target_system", 0),
            ("uint8_t", "target_component", 0),
        ),
    ),
    _Definition(
        message_id=ESC_STATUS_ID,
        name="ESC_STATUS",
        crc_extra=10,
        fields=(
            ("uint64_t", "time_usec", 0),
            ("int32_t", "rpm", 4),
            ("float", "voltage", 4),
            ("float", "current", 4),
            ("uint8_t", "index", 0),
        ),
    ),
    _Definition(
        message_id=300,
        name="PROTOCOL_VERSION",
        crc_extra=217,
        fields=(
            ("uint16_t", "version", 0),
            ("uint16_t", "min_version", 0),
            ("uint16_t", "max_version", 0),
            ("uint8_t", "spec_version_hash", 8),
            ("uint8_t", "library_version_hash", 8),
        ),
    ),
    _Definition(
        message_id=395,
        name="COMPONENT_INFORMATION",
        crc_extra=0,
        fields=(
            ("uint32_t", "time_boot_ms", 0),
            ("uint32_t", "general_metadata_file_crc", 0),
            ("uint32_t", "peripherals_metadata_file_crc", 0),
            ("char", "general_metadata_uri", 100),
            ("char", "peripherals_metadata_uri", 100),
        ),
    ),
    _Definition(
        message_id=397,
        name="COMPONENT_METADATA",
        crc_extra=182,
        fields=(
            ("uint32_t", "time_boot_ms", 0),
            ("uint32_t", "file_crc", 0),
            ("char", "uri", 100),
        ),
    ),
    _Definition(
        message_id=410,
        name="EVENT",
        crc_extra=160,
        fields=(
            ("uint32_t", "id", 0),
            ("uint32_t", "event_time_boot_ms", 0),
            ("uint16_t", "sequence", 0),
            ("uint8_t", "destination_component", 0),
            ("uint8_t", "destination_system", 0),
            ("uint8_t", "log_levels", 0),
            ("uint8_t", "arguments", 40),
        ),
    ),
    _Definition(
        message_id=411,
        name="CURRENT_EVENT_SEQUENCE",
        crc_extra=106,
        fields=(("uint16_t", "sequence", 0), ("uint8_t", "flags", 0)),
    ),
    _Definition(
        message_id=412,
        name="REQUEST_EVENT",
        crc_extra=33,
        fields=(
            ("uint16_t", "first_sequence", 0),
            ("uint16_t", "last_sequence", 0),
            ("uint8_t", "target_system", 0),
            ("uint8_t", "target_component", 0),
        ),
    ),
    _Definition(
        message_id=413,
        name="RESPONSE_EVENT_ERROR",
        crc_extra=77,
        fields=(
            ("uint16_t", "sequence", 0),
            ("uint16_t", "sequence_oldest_available", 0),
            ("uint8_t", "target_system", 0),
            ("uint8_t", "target_component", 0),
            ("uint8_t", "reason", 0),
        ),
    ),
    _Definition(
        message_id=435,
        name="AVAILABLE_MODES",
        crc_extra=134,
        fields=(
            ("uint32_t", "custom_mode", 0),
            ("uint32_t", "properties", 0),
            ("uint8_t", "number_modes", 0),
            ("uint8_t", "mode_index", 0),
            ("uint8_t", "standard_mode", 0),
            ("char", "mode_name", 35),
        ),
    ),
    _Definition(
        message_id=CURRENT_MODE_ID,
        name="CURRENT_MODE",
        crc_extra=193,
        fields=(
            ("uint32_t", "custom_mode", 0),
            ("uint32_t", "intended_custom_mode", 0),
            ("uint8_t", "standard_mode", 0),
        ),
    ),
)


def _message_class(definition: _Definition) -> Any:
    """Message class such as pymavlink generates; its constructor takes the wire order."""
    names = [name for _, name, _ in definition.fields]
    codes = [f"{length or ''}{_FORMATS[type_name]}" for type_name, _, length in definition.fields]
    lengths = [1 if t == "char" else max(length, 1) for t, _, length in definition.fields]
    base = mavlink.MAVLink_message

    def __init__(self: Any, *values: Any, **named: Any) -> None:  # noqa: N807
        given = dict(zip(names, values, strict=False)) | named
        if sorted(given) != sorted(names):
            raise TypeError(f"{definition.name} has the fields {', '.join(names)}")
        base.__init__(self, definition.message_id, definition.name)
        self._fieldnames = names
        self._raw = tuple(given[name] for name in names)
        for (type_name, name, _), value in zip(definition.fields, self._raw, strict=True):
            text = type_name == "char"
            setattr(
                self,
                name,
                value.split(b"\x00", 1)[0].decode("ascii", errors="replace") if text else value,
            )

    def pack(self: Any, mav: Any, force_mavlink1: bool = False) -> Any:
        flat: list[Any] = []
        for value in self._raw:
            if isinstance(value, Sequence) and not isinstance(value, bytes):
                flat.extend(value)
            else:
                flat.append(value)
        payload = self.unpacker.pack(*flat)
        return self._pack(mav, self.crc_extra, payload, force_mavlink1=force_mavlink1)

    return type(
        f"MAVLink_{definition.name.lower()}_message",
        (base,),
        {
            "__init__": __init__,
            "pack": pack,
            "id": definition.message_id,
            "msgname": definition.name,
            "name": definition.name,
            "fieldnames": names,
            "ordered_fieldnames": names,
            "fieldtypes": [type_name for type_name, _, _ in definition.fields],
            "native_format": bytearray(
                ("<" + "".join("c" if c[-1] == "s" else c[-1] for c in codes)).encode()
            ),
            "orders": list(range(len(names))),
            "lengths": lengths,
            "array_lengths": [length for _, _, length in definition.fields],
            "crc_extra": definition.crc_extra,
            "unpacker": struct.Struct("<" + "".join(codes)),
        },
    )


def _register(definition: _Definition) -> None:
    """Adds a message to the map unless pymavlink's own has all its fields."""
    known = mavlink.mavlink_map.get(definition.message_id)
    if known is None or not {name for _, name, _ in definition.fields} <= set(known.fieldnames):
        mavlink.mavlink_map[definition.message_id] = _message_class(definition)


for _definition in _DEFINITIONS:
    _register(_definition)


def create(name: str, /, **fields: Any) -> Message:
    """Creates a message of the map by its MAVLink name, with all its fields by name."""
    return _BY_NAME[name](**fields)


def id_of(name: str) -> int:
    """Id of a message of the map by its MAVLink name."""
    return int(_BY_NAME[name].id)


_BY_NAME = {message_class.msgname: message_class for message_class in mavlink.mavlink_map.values()}
