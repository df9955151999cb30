"""Changes of packets on the companion's link.

An item is (time at which the autopilot sent it, bytes). A filter takes the items of a step and
returns those that arrive.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from pymavlink.dialects.v20 import all as mavlink

from sitl.wire import packet_header

Item = tuple[float, bytes]
Filter = Callable[[float, list[Item]], list[Item]]

HEARTBEAT, SYSTEM_TIME, ATTITUDE, LOCAL_POSITION, GLOBAL_POSITION = 0, 2, 30, 32, 33
SYS_STATUS, GPS_RAW_INT, BATTERY_STATUS, CURRENT_MODE = 1, 24, 147, 436
PARAM_VALUE, SERVO_OUTPUT, ESTIMATOR_STATUS, ODOMETRY, EXTENDED_SYS_STATE = 22, 36, 230, 331, 245
HOME_POSITION, GPS_GLOBAL_ORIGIN, TIMESYNC = 242, 49, 111
HEADER_BYTES = 10
_codec = mavlink.MAVLink(None)


def number(packet: bytes) -> int:
    """Message id of a packet."""
    return packet_header(packet)[0]


def decoded(packet: bytes):
    """The message in a whole packet; None when it is broken."""
    try:
        return _codec.decode(bytearray(packet))
    except mavlink.MAVError:
        return None


class Signature(NamedTuple):
    """Key, link and time stamp of a packet's signature."""

    key: bytes
    link_id: int
    stamp: int


def packed(
    message,
    *,
    system: int = 1,
    component: int = 1,
    seq: int = 0,
    signature: Signature | None = None,
) -> bytes:
    """A packet with these sender ids."""
    packer = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
    packer.seq = seq
    if signature is not None:
        signing = packer.signing
        signing.secret_key, signing.link_id, signing.timestamp = signature
        signing.sign_outgoing = True
    return bytes(message.pack(packer))


def _signature(packet: bytes, key: bytes) -> Signature | None:
    """The signature that a changed packet needs; None if the packet is not signed."""
    if not packet[2] & 1:
        return None
    return Signature(key=key, link_id=packet[-13], stamp=int.from_bytes(packet[-12:-6], "little"))


def drop(*ids: int) -> Filter:
    """Messages of these ids do not arrive."""
    return lambda _, items: [item for item in items if number(item[1]) not in ids]


def change(ids: set[int], edit: Callable[[object], None], key: bytes = b"") -> Filter:
    """Messages of these ids arrive edited. key: of a signed link."""

    def changed(packet: bytes) -> bytes:
        message = decoded(packet) if number(packet) in ids else None
        if message is None:
            return packet
        edit(message)
        return packed(message, seq=packet[4], signature=_signature(packet, key))

    return lambda _, items: [(sent_s, changed(packet)) for sent_s, packet in items]


def freeze(*ids: int) -> Filter:
    """The first message of each id is repeated in the place of all later ones."""
    kept: dict[int, Item] = {}

    def frozen(_: float, items: list[Item]) -> list[Item]:
        return [
            kept.setdefault(number(item[1]), item) if number(item[1]) in ids else item
            for item in items
        ]

    return frozen


def duplicate(chance: Callable[[], bool]) -> Filter:
    """Some packets arrive twice."""
    return lambda _, items: [copy for item in items for copy in [item] * (2 if chance() else 1)]


def corrupt(chance: Callable[[], bool], bit: Callable[[int], int]) -> Filter:
    """Some packets arrive with one wrong bit."""

    def broken(packet: bytes) -> bytes:
        data = bytearray(packet)
        at = bit(8 * len(data))
        data[at // 8] ^= 1 << at % 8
        return bytes(data)

    return lambda _, items: [(s, broken(p)) if chance() else (s, p) for s, p in items]


def late(by_s: float) -> Filter:
    """All packets arrive later, and count as sent then."""
    under_way: deque[tuple[float, bytes]] = deque()

    def delayed(now_s: float, items: list[Item]) -> list[Item]:
        under_way.extend((now_s + by_s, packet) for _, packet in items)
        arrived = []
        while under_way and under_way[0][0] <= now_s:
            arrived.append((now_s, under_way.popleft()[1]))
        return arrived

    return delayed


def lose(chance: Callable[[], bool]) -> Filter:
    """Some packets do not arrive."""
    return lambda _, items: [item for item in items if not chance()]


def hold_back(until_s: float) -> Filter:
    """All packets wait and arrive together at `until_s`."""
    waiting: list[Item] = []

    def held(now_s: float, items: list[Item]) -> list[Item]:
        waiting.extend(items)
        if now_s < until_s:
            return []
        arrived = list(waiting)
        waiting.clear()
        return arrived

    return held


def replay(late_s: float, ids: set[int]) -> Filter:
    """Messages of these ids are received again `late_s` later, between the present ones."""
    past: deque[tuple[float, Item]] = deque()

    def received_again(now_s: float, items: list[Item]) -> list[Item]:
        past.extend((now_s + late_s, item) for item in items if number(item[1]) in ids)
        again = []
        while past and past[0][0] <= now_s:
            again.append(past.popleft()[1])
        return items + again

    return received_again


def insert(make: Callable[[float], list[bytes]], period_s: float) -> Filter:
    """Packets of another sender, one set per `period_s`."""
    due = [0.0]

    def inserted(now_s: float, items: list[Item]) -> list[Item]:
        if now_s < due[0]:
            return items
        due[0] = now_s + period_s
        return items + [(now_s, packet) for packet in make(now_s)]

    return inserted
