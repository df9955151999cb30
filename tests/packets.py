"""Received packets, decoded by pymavlink when a test reads them: few of a flight's are."""

from __future__ import annotations

from functools import cached_property
from typing import Any

from pymavlink.dialects.v20 import all as mavlink

from sitl.wire import packet_header

_CODEC = mavlink.MAVLink(None)
_NAMES = {number: kind.msgname for number, kind in mavlink.mavlink_map.items()}


class Packet:
    """A whole packet, with the attributes of its pymavlink message.

    Raises MAVError for one that pymavlink refuses.
    """

    def __init__(self, data: bytes) -> None:
        self._data = data

    def get_msgbuf(self) -> bytes:
        return self._data

    def get_type(self) -> str:
        """The message's name, without decoding it."""
        number, *_ = packet_header(self._data)
        return _NAMES.get(number) or f"UNKNOWN_{number}"

    @cached_property
    def _message(self) -> Any:
        return decoded(self._data)

    def __getattr__(self, name: str) -> Any:
        """Attribute of the message."""
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self._message, name)


def decoded(packet: bytes) -> Any:
    """The message of a whole packet."""
    return _CODEC.decode(bytearray(packet))
