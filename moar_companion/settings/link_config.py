"""Links of the service, and the key of those that are signed: sections `links` and `signing`."""

from __future__ import annotations

import enum
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from .yaml_file import HEXADECIMAL_KEY, FileFinding, shown
from .yaml_schema import LinkUrl


class LinkRole(str, enum.Enum):
    """Peer at the other end of a link."""

    AUTOPILOT = "autopilot"
    OPERATOR = "operator"


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkConfig:
    """One link (`mavlink/urls`)."""

    url: LinkUrl
    """`udp:HOST:PORT`, `udpout:HOST:PORT`, `tcp:HOST:PORT` or `serial:DEVICE:BAUD`, each once. USB
    devices by a name in `/dev/serial/by-id`: their numbers (`ttyUSB0`, `ttyACM0`) change. At 57600
    baud only as `serial:`: over UDP and TCP the mode is requested at 50 Hz instead of 20, too much
    for such a line behind a router with PX4."""
    role: LinkRole = LinkRole.AUTOPILOT
    """The other end of the link."""
    signed: bool = False
    """All packets on it are signed; unsigned packets are refused."""


@dataclass(frozen=True, slots=True, kw_only=True)
class KeySource:
    """Source of the key of the signed links, never the key itself."""

    key_file: Path | None = None
    """The key of the signed links: 32 bytes or 64 hexadecimal digits, in a file of root or of the
    service's user that no other user can read. A name of 64 hexadecimal digits is refused: it may
    be the key itself."""
    credential: str | None = None
    """The same in a credential of systemd (`LoadCredential=`): where systemd passes some it is
    taken in place of the file."""


def link_findings(links: tuple[LinkConfig, ...], signing: KeySource) -> Iterator[FileFinding]:
    """Yields the faults of links and key: a URL twice, a key in the file, no key."""
    seen: dict[str, int] = {}
    for index, link in enumerate(links):
        if link.url in seen:
            problem = f"is {link.url!r}, the same as links[{seen[link.url]}]: must be unique"
            yield FileFinding(("links", index, "url"), problem)
        seen.setdefault(link.url, index)
    yield from _signing_findings(links, signing)


def _signing_findings(links: tuple[LinkConfig, ...], signing: KeySource) -> Iterator[FileFinding]:
    key_file, credential = signing.key_file, signing.credential
    for name, value in (("key_file", key_file), ("credential", credential)):
        if value is not None and HEXADECIMAL_KEY.fullmatch(Path(value).name):
            problem = f"is {shown(str(value))}, must be the name of what has the key"
            yield FileFinding(("signing", name), problem)
            return
    if credential is not None and Path(credential).name != credential:
        problem = f"is {credential!r}, must be the name of a credential, without a folder"
        yield FileFinding(("signing", "credential"), problem)
    if key_file is None and credential is None:
        problem = "is true, must have a key: signing.key_file or signing.credential"
        for index, link in enumerate(links):
            if link.signed:
                yield FileFinding(("links", index, "signed"), problem)
