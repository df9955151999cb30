"""Frames with hostile fields, and bytes that are almost frames."""

from __future__ import annotations

import hashlib
import math
import re
import struct
from dataclasses import dataclass
from random import Random
from typing import Any

from moar_companion.mavlink.codec import checksum
from moar_companion.settings.flight_parameters import flight_parameters

FLOATS = (
    math.nan, math.inf, -math.inf, 0.0, -0.0, 1e-40, 1e9, -1e9, 3.4e38, -3.4e38, 1.0, -1.0, 195.0,
)  # fmt: skip
_SIZES = {"B": 8, "b": 8, "H": 16, "h": 16, "I": 32, "i": 32, "Q": 64, "q": 64}
_COMMANDS = (31010, 193, 176, 400, 511, 512, 20, 21, 22, 80, 92, 300)
_MISSIONS = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0, -1.0)
_PARAMETERS = tuple(name.encode() for name in flight_parameters())
OURS = 1, 195


@dataclass(frozen=True, slots=True)
class Shape:
    """Payload of a message: struct codes of its values, and indices of the fields."""

    message_class: Any
    codes: tuple[str, ...]
    places: dict[str, int]
    """Index of the first value of each field."""


def shape_of(message_class: Any) -> Shape:
    codes: list[str] = []
    for count, code in re.findall(r"(\d*)([a-zA-Z])", message_class.unpacker.format):
        codes += [count + code] if code == "s" else [code.replace("c", "1s")] * int(count or 1)
    places, at = {}, 0
    types = dict(zip(message_class.fieldnames, message_class.fieldtypes, strict=True))
    for name, length in zip(
        message_class.ordered_fieldnames, message_class.array_lengths, strict=True
    ):
        places[name] = at
        at += 1 if types[name] == "char" else max(1, length)
    assert at == len(codes), message_class.msgname
    return Shape(message_class, tuple(codes), places)


def hostile_value(pick: Random, code: str) -> Any:
    """A value of a struct code: limits, sentinels, NaN and infinity, any value."""
    if code[-1] == "s":
        return pick.choice((b"", b"\xff" * 99, b"MOAR", pick.randbytes(int(code[:-1] or 1))))
    if code in "fd":
        return pick.choice(FLOATS) if pick.random() < 0.8 else pick.gauss(0.0, 100.0)
    bits = _SIZES[code]
    low = -(1 << bits - 1) if code.islower() else 0
    high = low + (1 << bits) - 1
    edges = low, high, high - 1, low + 1, 0, 1, 2, 3
    return pick.choice(edges) if pick.random() < 0.7 else pick.randint(low, high)


def hostile_payload(pick: Random, shape: Shape, genuine: bytes | None, boot_s: float) -> bytes:
    """Payload of a message: a genuine one, if there is one, with hostile values in it."""
    unpacker, codes, places = shape.message_class.unpacker, shape.codes, shape.places
    if genuine is not None and pick.random() < 0.8:
        values = list(unpacker.unpack(genuine.ljust(unpacker.size, b"\0")[: unpacker.size]))
        changed = pick.sample(range(len(codes)), min(len(codes), pick.choice((1, 1, 2, 3, 99))))
    else:
        values, changed = [b"" if code[-1] == "s" else 0 for code in codes], range(len(codes))
    for index in changed:
        values[index] = hostile_value(pick, codes[index])
    for name, units in (("time_boot_ms", 1e3), ("time_usec", 1e6)):
        if name in places and pick.random() < 0.7:
            off_s = pick.choice((0.0, 0.0, 0.0, -0.3, -5.0, 0.4, 0.6, 30.0, 1e6))
            values[places[name]] = max(0, int((boot_s + off_s) * units)) % 2**32
    for name, ours in zip(("target_system", "target_component"), OURS, strict=True):
        if name in places and pick.random() < 0.8:
            values[places[name]] = ours
    if "param_id" in places and pick.random() < 0.7:
        values[places["param_id"]] = pick.choice(_PARAMETERS)
    if "command" in places and pick.random() < 0.8:
        values[places["command"]] = pick.choice(_COMMANDS)
        if "param1" in places and pick.random() < 0.7:
            values[places["param1"]] = pick.choice(_MISSIONS)
    return unpacker.pack(*values)


def frame(
    message_class: Any,
    payload: bytes,
    source: tuple[int, int],
    seq: int,
    signed: tuple[bytes, int] | None = None,
) -> bytes:
    """A valid MAVLink 2 packet. signed: key and time stamp of the signature."""
    payload = payload.rstrip(b"\0") or payload[:1]
    number = message_class.id
    body = struct.pack(
        "<BBBBBBBHB", 0xFD, len(payload), signed is not None, 0, seq, *source, number & 0xFFFF,
        number >> 16,
    ) + payload  # fmt: skip
    crc = checksum(body[1:] + bytes((message_class.crc_extra,)))
    packet = body + struct.pack("<H", crc)
    if signed is None:
        return packet
    key, timestamp = signed
    packet += b"\x09" + timestamp.to_bytes(6, "little")
    return packet + hashlib.sha256(key + packet).digest()[:6]


def nearly_frames(pick: Random, genuine: list[bytes]) -> bytes:
    """Random bytes, start markers, and genuine packets: changed, cut, joined or repeated."""
    packet = bytearray(pick.choice(genuine))
    at = pick.randrange(len(packet))
    match pick.randrange(8):
        case 0:
            return pick.randbytes(pick.choice((1, 3, 40, 300)))
        case 1:
            return pick.choice((b"\xfd", b"\xfe", b"\xfd\xff\x00", b"\xfe\xff")) * pick.randrange(
                40
            )
        case 2:
            packet[at] ^= 1 << pick.randrange(8)
        case 3:
            packet[pick.randrange(min(10, len(packet)))] = pick.randrange(256)
        case 4:
            del packet[at:]
        case 5:
            packet[at:] = pick.choice(genuine)[-pick.randrange(1, 30) :]
        case 6:
            packet[at:at] = pick.randbytes(pick.randrange(1, 20))
        case _:
            packet *= 2
    return bytes(packet)
