"""Bytes that a link has left for lists, files and values to plot. Pure: the time is an argument.

A serial line of 57,600 baud carries 5,760 bytes a second. Setpoints at 50 Hz take 3,250 of them,
and bytes that the kernel holds cannot be overtaken. So all of these get a quarter of the line,
packet by packet: at 57,600 baud 1,440 B/s. A list of 100 parameters takes 6 s beside the values to
plot (bytes: configs/guides/links.md).
"""

from __future__ import annotations

import math

from ..dialect import Message, mavlink
from ..urls import line_bytes_per_s

_SHARE = 1 / 4
_SETPOINT_BYTES = 78
"""Largest packet of a setpoint: SET_POSITION_TARGET_LOCAL_NED, signed."""
_NETWORK_BYTES_PER_S = 20_000.0
"""Budget of UDP and TCP, whose rate is unknown: for eight peers some hundredths of a Wi-Fi link. A
file of 20 kB takes a second."""
_SIGNATURE_BYTES = 13
OVERHEAD_BYTES = 12 + _SIGNATURE_BYTES
"""Bytes of a signed MAVLink 2 packet around its payload: header 10, checksum 2, signature 13."""
_BURST_S = 0.02
"""Time for which an idle link saves its budget: one cycle at 50 Hz."""
_LARGEST_S = 0.02
"""Longest time that one packet of an answer takes on a serial line: one cycle at 50 Hz."""
_LARGEST_BYTES = 280
"""Largest MAVLink 2 packet without a signature is 267 bytes, a signed one 280."""
_LEAST_LARGEST_BYTES = 100
"""Largest packet on the slowest lines: nothing shorter carries a parameter or a piece of a file."""


_PACKER = mavlink.MAVLink(None)


def size_bytes(message: Message) -> int:
    """Size of a message's packet, signed, without the zeros at its end, which MAVLink 2 cuts."""
    return len(message.pack(_PACKER)) + _SIGNATURE_BYTES


def fastest_setpoints_hz(link: str) -> float:
    """Greatest rate of setpoints that leaves a line its budget; infinite for all other links."""
    line = line_bytes_per_s(link)
    return math.inf if line is None else line * (1.0 - _SHARE) / _SETPOINT_BYTES


class LinkBudget:
    """Budget of one link: open while it is not overdrawn, which one packet may do."""

    def __init__(self, link: str) -> None:
        line = line_bytes_per_s(link)
        self.bytes_per_s = _NETWORK_BYTES_PER_S if line is None else line * _SHARE
        """Rate of the bytes that answers may take."""
        largest = _LARGEST_BYTES if line is None else int(line * _LARGEST_S)
        self.largest_bytes = min(_LARGEST_BYTES, max(_LEAST_LARGEST_BYTES, largest))
        """Size of the largest packet that a service should send on this link."""
        self._left_bytes = 0.0
        self._since_s: float | None = None

    def is_open(self, now_s: float) -> bool:
        """Returns True if one more packet may be sent now."""
        if self._since_s is not None and now_s > self._since_s:
            earned = (now_s - self._since_s) * self.bytes_per_s
            self._left_bytes = min(self.bytes_per_s * _BURST_S, self._left_bytes + earned)
        self._since_s = now_s
        return self._left_bytes >= 0.0

    def spend(self, message: Message) -> None:
        """Takes the bytes of a packet that is sent."""
        self._left_bytes -= size_bytes(message)
