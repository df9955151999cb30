"""Link URLs of the command line and the configuration."""

from __future__ import annotations

import enum
import re
from dataclasses import dataclass

from ..errors import InputError

ALLOWED = (
    "udp:HOST:PORT or udpin:HOST:PORT (listen), udpout:HOST:PORT (send first), tcp:HOST:PORT, "
    "serial:DEVICE:BAUD"
)


_MAX_BAUD = 20_000_000
"""Greatest baud rate: faster than any serial port."""
_BITS_PER_BYTE = 10
"""Bits of a byte on a serial line: start bit, eight data bits, stop bit."""


class LinkKind(enum.Enum):
    """Transport of a link."""

    UDP_LISTEN = "udpin"
    UDP_SEND = "udpout"
    TCP = "tcp"
    SERIAL = "serial"


_SCHEMES = {
    "udp": LinkKind.UDP_LISTEN,
    "udpin": LinkKind.UDP_LISTEN,
    "udpout": LinkKind.UDP_SEND,
    "tcp": LinkKind.TCP,
    "tcpout": LinkKind.TCP,
    "serial": LinkKind.SERIAL,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkAddress:
    """Address of a link: host and port, or a device and its baud rate."""

    kind: LinkKind
    host: str = ""
    port: int = 0
    device: str = ""
    baud: int = 0

    @property
    def bytes_per_s(self) -> float | None:
        """Rate of a serial line in each direction; None for all other links."""
        return self.baud / _BITS_PER_BYTE if self.kind is LinkKind.SERIAL else None

    def __str__(self) -> str:
        if self.kind is LinkKind.SERIAL:
            return f"serial:{self.device}:{self.baud}"
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.kind.value}:{host}:{self.port}"


def parse_url(url: str, *, source: str = "--connect", key: str = "") -> LinkAddress:
    """Address of a URL: the forms of `--connect`, and MAVSDK's `udpin://…`, `serial:///dev/…:baud`.

    An empty host listens on all interfaces. Raises InputError(source, key, …) otherwise.
    """

    def refuse(why: str) -> InputError:
        return InputError(source, key, f"{url!r} {why}; allowed: {ALLOWED}")

    scheme, separator, rest = url.strip().partition(":")
    kind = _SCHEMES.get(scheme.lower())
    if not separator or kind is None:
        raise refuse("is not a link")
    rest = rest.removeprefix("//")
    place, _, number = rest.rpartition(":")
    if not re.fullmatch(r"\d{1,10}", number, re.ASCII):
        raise refuse("has no baud rate" if kind is LinkKind.SERIAL else "has no port")
    if kind is LinkKind.SERIAL:
        if not place:
            raise refuse("names no device")
        if not 1 <= int(number) <= _MAX_BAUD:
            raise refuse(f"has the baud rate {number}, which is not in 1 to {_MAX_BAUD}")
        return LinkAddress(kind=kind, device=place, baud=int(number))
    if not 1 <= int(number) <= 65535:
        raise refuse(f"has the port {number}, which is not in 1 to 65535")
    host = place.removeprefix("[").removesuffix("]")
    if ":" in host and host == place:
        raise refuse("has more than one port, or an IPv6 address without brackets")
    if not host and kind is not LinkKind.UDP_LISTEN:
        raise refuse("names no host")
    if not _is_host(host):
        raise refuse("has a host that is neither a name nor an address")
    return LinkAddress(kind=kind, host=host or "0.0.0.0", port=int(number))  # noqa: S104 — as asked


def line_bytes_per_s(link: str) -> float | None:
    """Rate of the serial line with this URL; None for all other links.

    Orders over MQTT have a link without a URL.
    """
    try:
        return parse_url(link).bytes_per_s
    except InputError:
        return None


def _is_host(host: str) -> bool:
    """Returns True for a host that a resolver accepts: labels of 1 to 63 characters, no blanks."""
    try:
        host.encode("idna")
    except UnicodeError:
        return False
    return not re.search(r"\s", host)
