"""MAVLink 2 signing of the fake autopilot, by pymavlink: one key for all links, as ArduPilot does.

Source: https://mavlink.io/en/guide/message_signing.html.
"""

import hashlib
import re
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from sitl.input_file import open_file

_DIGITS: Final = re.compile(rb"\s*([0-9A-Fa-f]{64})\s*")
_EPOCH_S: Final = 1_420_070_400
_UNITS_PER_S: Final = 100_000


@dataclass(frozen=True, slots=True, kw_only=True)
class SignOptions:
    """The key, 32 bytes, and the first time stamp, in units of 10 us since 2015."""

    key: bytes = field(repr=False)
    timestamp: int = 0

    @staticmethod
    def load(path: Path) -> "SignOptions":
        """Read a key of 32 bytes or 64 hexadecimal digits; `ValueError`, `OSError` otherwise.

        The first time stamp is that of the clock.
        """
        with open_file(path) as file:
            content = file.read()
        digits = _DIGITS.fullmatch(content)
        key = content if digits is None else bytes.fromhex(digits[1].decode())
        if len(key) != 32:
            raise ValueError("must hold 32 bytes or 64 hexadecimal digits")
        return SignOptions(key=key, timestamp=int((time.time() - _EPOCH_S) * _UNITS_PER_S))

    def start(self, parser: Any, link_id: int) -> None:
        """Have pymavlink's parser refuse packets that are not signed with the key."""
        parser.signing.secret_key = self.key
        parser.signing.timestamp = self.timestamp
        parser.signing.link_id = link_id


def sign(packet: bytes, parser: Any) -> bytes:
    """Sign a packet that has the flag; the time stamps are those of the link's parser."""
    signing = parser.signing
    signing.timestamp += 1
    packet += bytes((signing.link_id,)) + signing.timestamp.to_bytes(6, "little")
    return packet + hashlib.sha256(signing.secret_key + packet).digest()[:6]
